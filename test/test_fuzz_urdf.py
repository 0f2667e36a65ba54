"""URDFs from anyone: refused in one line, or an arm that can be computed; never a crash.

Pinocchio and PyBullet are C++, where a wrong text can end the process, so they are tried in one
of their own: ``python test_fuzz_urdf.py`` reads texts and says what became of each.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_runs import URDF

from eulerparams_control.errors import EulerParamsError, RobotError
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import DynamicState, Robot

END = "</robot>"
LIMIT = '<limit lower="-4" upper="4" velocity="3" effort="10"/>'
LONGEST_REFUSAL = 2000  # characters: one line that can be read
PATIENCE = 300  # s; a guard against hanging


def chain(count: int) -> str:
    """Return an arm whose tip is carried by so many joints, the last of which turns."""
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(count - 1)
    )
    last = (
        f'<joint name="last" type="revolute"><parent link="l{count - 1}"/>'
        f'<child link="l{count}"/>{LIMIT}</joint>'
    )
    return f'<robot name="chain">{links}{joints}{last}</robot>'


def changed(old: str, new: str) -> str:
    assert old in URDF
    return URDF.replace(old, new)


def shaped(kind: str, shape: str) -> str:
    link = f'<link name="tip"><{kind}><geometry>{shape}</geometry></{kind}></link>'
    return changed('<link name="tip"/>', link)


def beside(kind: str, more: str = "") -> str:
    """Return a link that the arm does not need, on a joint of its own at the base."""
    ends = '<parent link="base"/><child link="tool0_controller"/>'
    return f'<link name="tool0_controller"/><joint name="aside" type="{kind}">{ends}{more}</joint>'


def with_number(name: str, text: str) -> str:
    """Return the arm with another text for one number of its hinge."""
    return re.sub(rf'(name="hinge".*?{name}=")[^"]*', rf"\g<1>{text}", URDF, count=1, flags=re.S)


DECLARATION = '<?xml version="1.0" encoding="utf-8"?>'
XACRO = '<xacro:include filename="$(find arm)/arm.xacro"/><xacro:arm prefix=""/>'
MACRO = '<xacro:macro name="finger"><link name="${x}"/><xacro:tip/></xacro:macro>'
EXTRAS = """<gz:link name="arm"/><gazebo reference="arm"><mu1>0.2</mu1><joint name="x"/></gazebo>
<transmission name="t"><type>a</type><joint name="hinge"/><actuator name="m"/></transmission>
<ros2_control name="c" type="system"><joint name="hinge"><param name="p">${1}</param></joint>
<hardware/></ros2_control><sensor name="s" update_rate="1"><parent link="arm"/></sensor>"""


REFUSED: dict[str, tuple[str, str]] = {
    "no mass stated": (
        changed('<mass value="1"/>', ""),
        "link 'arm': value of its <mass> is ''; expected a number",
    ),
    "a negative mass": (
        changed('mass value="1"', 'mass value="-1"'),
        "value of its <mass> is '-1'; expected a number of 0 or more",
    ),
    "a negative inertia": (
        changed('iyy="1"', 'iyy="-1"'),
        "iyy of its <inertia> is '-1'; expected a number of 0 or more",
    ),
    "an axis of zero": (changed('"0 1 0"', '"0 0 0"'), "joint 'hinge': its axis is zero"),
    "an endless link": (changed('xyz="0.8 0 0"', 'xyz="1e308 0 0"'), "expected three numbers"),
    "an angle that is a word": (
        changed('rpy="1.57', 'rpy="a 1.57'),
        "'mount': rpy of its <origin>",
    ),
    "no limits": (
        changed(LIMIT, ""),
        "joint 'hinge': its <limit> has no velocity or no effort; expected <limit lower",
    ),
    "half the limits": (changed('velocity="3"', ""), "'hinge': its <limit> has no velocity"),
    "a limit of NaN": (with_number("lower", "nan"), "joint 'hinge': lower of its <limit> is 'nan'"),
    "a negative effort": (
        with_number("effort", "-1"),
        "velocity 3, effort -1; expected",
    ),
    "soft limits elsewhere": (
        changed(LIMIT, f'{LIMIT}<safety_controller soft_lower_limit="5" soft_upper_limit="6"/>'),
        "joint 'hinge': its limits are 5 ... 4 (by its <safety_controller>, too)",
    ),
    "no parent": (changed('<parent link="base"/>', ""), "'hinge': no link '' as parent"),
    "no such link": (changed('<link name="rod"', '<link name="bar"'), "no link 'rod' as child"),
    "an unknown type": (changed('type="revolute"', 'type="revolut"'), "(did you mean 'revolute'?)"),
    "two joints of a name": (changed('"roll"', '"hinge"'), "two joints have the name 'hinge'"),
    "a name without end": (changed('"sensor"', f'"{"x" * 3000}"'), "a name of 3000 characters"),
    "a loop": (changed('<parent link="base"/>', '<parent link="rod"/>'), "not carried by"),
    "a link in two places": (changed('<child link="rod"/>', '<child link="arm"/>'), "two parents"),
    "a chain too long": (chain(3000), "has 3001 links; expected at most 1000"),
    "an entity": (f'<!DOCTYPE r [<!ENTITY a "ha">]>{URDF}', "it has a DOCTYPE"),
    "nothing": ("", "the robot description is empty, ''; expected the text of a URDF"),
    "a path": ("/opt/robots/arm.urdf", "is a path, '/opt/robots/arm.urdf'; expected the text"),
    "YAML": ("robot_description: |\n  " + URDF, "is YAML, 'robot_description: |"),
    "USD": ('#usda 1.0\n(defaultPrim = "arm")', "is no XML, '#usda 1.0"),
    "SDF": ('<?xml version="1.0"?>\n<sdf version="1.9"/>', "no URDF: its root is <sdf>; expected"),
    "an SRDF": ('<robot name="arm"><group name="arm"/></robot>', "has no <link>, as an SRDF"),
    "xacro with a file": (
        f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{XACRO}</robot>',
        "is xacro that was not expanded: it has <xacro:include>; expand it: xacro FILE",
    ),
}

TAKEN: dict[str, str] = {
    "unicode": URDF.replace("hinge", "h\u00e4nge\u2603"),
    "a joint with the name that Pinocchio keeps": URDF.replace('"end"', '"universe"'),
    "a mesh that is elsewhere": shaped("visual", '<mesh filename="package://../../etc/passwd"/>'),
    # as text
    "a name space": URDF.replace("<robot", '<robot xmlns="http://www.ros.org"'),
    "elements deep in each other": changed(END, f"{'<a>' * 10**5}{'</a>' * 10**5}{END}"),
    "extensions": URDF.replace("<robot", '<robot xmlns:gz="http://gz"').replace(END, EXTRAS + END),
    "a macro that nothing uses": changed(END, MACRO + END),
    "a declaration after a blank line": f"\n  {DECLARATION}\n{URDF}",
    "a byte order mark": f"\ufeff{DECLARATION}{URDF}",
    "a DOCTYPE that says nothing": f"{DECLARATION}<!DOCTYPE robot>{URDF}",
    # as numbers
    "blanks around numbers": changed('xyz="0 1 0"', 'xyz="  0   1 0 "').replace(
        'lower="-4"', 'lower=" -4 "'
    ),
    "limits without end": with_number("lower", "-inf")
    .replace('upper="4"', 'upper="Infinity"')
    .replace('velocity="3"', 'velocity="inf"'),
    "axes that are not of length 1": URDF.replace('"0 1 0"', '"0 2 0"').replace(
        '<axis xyz="1 0 0"/>', '<axis xyz="1e-4 0 0"/>'
    ),
    # what is none of the arm's
    "a frame that floats": changed(END, beside("floating") + END),
    "a joint with an axis of zero": changed(END, beside("fixed", '<axis xyz="0 0 0"/>') + END),
    "a joint without limits": changed(END, beside("prismatic") + END),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_urdf_that_is_no_arm_is_refused_in_one_line(case):
    text, words = REFUSED[case]
    with pytest.raises(RobotError, match=re.escape(words)) as refusal:
        Robot(text, "", "tip")
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < LONGEST_REFUSAL


@pytest.mark.parametrize("case", TAKEN)
def test_a_urdf_that_is_odd_but_an_arm_is_taken_for_the_arm_that_it_is(case):
    robot, expected = Robot(TAKEN[case], "base", "tip"), Robot(URDF, "base", "tip")
    robot.refuse_joints()
    q, dq = np.array([0.3, -0.2]), np.array([0.5, -0.7])
    for found, same in zip(
        flat(robot.dynamic_state(q, dq)), flat(expected.dynamic_state(q, dq)), strict=True
    ):
        np.testing.assert_array_equal(found, same)


def flat(state: DynamicState) -> list[Any]:
    return [*state.arm, *state[1:]]


def test_a_urdf_of_a_pipe_or_folder_is_refused_without_waiting(tmp_path):
    (tmp_path / "folder.urdf").mkdir()
    (tmp_path / "endless.urdf").symlink_to("/dev/zero")
    for name in ("folder.urdf", "endless.urdf"):
        with pytest.raises(RobotError, match=r"the URDF cannot be read: .*no file"):
            load_robot(str(tmp_path / name))


# --- with C++, in a process of its own -------------------------------------------------------
def fate(text: str, folder: str) -> dict[str, Any]:
    """Return what Pinocchio and PyBullet make of a text: refused, or not."""
    from sim_bridge.parameters import SimulatorParameters
    from sim_bridge.simulator import Simulator

    found: dict[str, Any] = {}
    try:
        Robot(text, "", "tip")
    except EulerParamsError as error:
        found["refused"] = str(error)
    path = Path(folder) / "arm.urdf"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        simulator = Simulator(load_robot(str(path)), SimulatorParameters(control="torque"))
        try:
            simulator.step()
            found["simulated"] = True
        finally:
            simulator.close()
    except EulerParamsError as error:
        found["not simulated"] = str(error)
    return found


def fates(texts: list[str]) -> list[dict[str, Any]]:
    """Return the fate of each text; a process that dies on one leaves fewer."""
    options = {"capture_output": True, "text": True, "timeout": PATIENCE}
    done = subprocess.run([sys.executable, __file__], input=json.dumps(texts), **options)
    lines = [line for line in done.stdout.splitlines() if line.startswith("fate ")]
    found = [json.loads(line.removeprefix("fate ")) for line in lines]
    if len(found) < len(texts):
        raise AssertionError(
            f"exit code {done.returncode} on:\n{texts[len(found)]}\n{done.stderr[-2000:]}"
        )
    return found


def test_no_urdf_ends_the_process_and_what_is_refused_as_an_arm_is_not_simulated():
    texts = [text for text, _ in REFUSED.values() if len(text) < 10**6]
    for text, each in zip(texts, fates(texts), strict=True):
        assert "refused" in each, text
        assert not each.get("simulated"), text
        assert len(each["refused"] + each.get("not simulated", "")) < 2 * LONGEST_REFUSAL


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as own_folder:
        for each in json.load(sys.stdin):
            said = json.dumps(fate(each, own_folder))
            print(f"\nfate {said}", flush=True)  # PyBullet leaves lines open
