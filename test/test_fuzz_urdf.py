"""URDFs from anyone: refused in one line, or an arm that can be computed; never a crash.

Pinocchio and PyBullet are C++, where a wrong text can end the process, so they are tried in one
of their own: ``python test_fuzz_urdf.py`` reads texts and says what became of each.
"""

import contextlib
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from samples import generator
from synthetic_runs import URDF

from eulerparams_control.errors import EulerParamsError, RobotError
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot
from eulerparams_control.robot.urdf import UrdfTree

END = "</robot>"
ENTITY = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
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


def laughs() -> str:
    """Return a URDF whose name is 10^10 letters, by entities of entities."""
    entities = "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(10))
    return f'<!DOCTYPE r [<!ENTITY a "ha">{entities}]>' + changed('name="rod"', 'name="&k;"')


REFUSED: dict[str, tuple[str, str]] = {
    "no mass stated": (changed('<mass value="1"/>', ""), "inertial of link 'arm': a <inertial>"),
    "a mass that is a word": (changed('mass value="1"', 'mass value="1kg"'), "'1kg'"),
    "a mass in Python's spelling": (changed('mass value="1"', 'mass value="1_0"'), "'1_0'"),
    "a mass in Arabic digits": (changed('mass value="1"', 'mass value="\u0661"'), "convert"),
    "a mass of NaN": (changed('mass value="1"', 'mass value="nan"'), "value of <mass> is nan"),
    "an endless inertia": (changed('ixx="1"', 'ixx="inf"'), "ixx of <inertia> is inf"),
    "half an inertia": (changed('ixx="1"', ""), "a <inertia> has no attribute 'ixx'"),
    "a negative mass": (changed('mass value="1"', 'mass value="-1"'), "mass -1 kg"),
    "a negative inertia": (changed('iyy="1"', 'iyy="-1"'), "negative moments {'iyy': -1.0}"),
    "an axis of zero": (changed('"0 1 0"', '"0 0 0"'), "joint 'hinge': its axis is zero"),
    "an axis of NaN": (changed('"0 1 0"', '"nan 0 0"'), "xyz of a <axis> is 'nan 0 0'"),
    "an axis of two numbers": (changed('"0 1 0"', '"0 1"'), "expected three numbers"),
    "an endless link": (changed('xyz="0.8 0 0"', 'xyz="1e308 0 0"'), "up to 1e+09"),
    "an angle that is a word": (changed('rpy="1.57', 'rpy="a 1.57'), "rpy of a <origin>"),
    "no limits": (changed(LIMIT, ""), "its <limit> is missing; expected <limit lower"),
    "half the limits": (changed('velocity="3"', ""), "'hinge': its <limit> has no velocity"),
    "a limit of NaN": (changed('lower="-4"', 'lower="nan"'), "impossible limits of joint 'hinge'"),
    "a speed of NaN": (changed('velocity="3"', 'velocity="nan"'), "impossible limits"),
    "a limit that is a word": (changed('lower="-4"', 'lower="half"'), "'hinge': could not convert"),
    "a negative speed": (changed('velocity="3"', 'velocity="-3"'), "limits of joint 'hinge'"),
    "no such link": (changed('<link name="rod"', '<link name="bar"'), "no link 'rod' as child"),
    "no child": (changed('<child link="rod"/>', ""), "joint 'roll' has no <child>"),
    "a link with no name": (changed('<link name="base"/>', "<link/>"), "has no attribute 'name'"),
    "an unknown type": (changed('type="revolute"', 'type="revolut"'), "(did you mean 'revolute'?)"),
    "no type": (changed('name="roll" type="revolute"', 'name="roll"'), "no attribute 'type'"),
    "two joints of a name": (changed('"roll"', '"hinge"'), "two joints have the name 'hinge'"),
    "two links of a name": (changed(END, f'<link name="arm"/>{END}'), "links have the name 'arm'"),
    "two tips": (changed(END, f'<link name="tip"/>{END}'), "two links have the name 'tip'"),
    "a link without a name": (changed('"sensor"', '""'), "a link has an empty name"),
    "a joint of Pinocchio's": (changed('"hinge"', '"universe"'), "which Pinocchio keeps"),
    "several roots": (changed("</robot>", '<link name="x"/></robot>'), "one root link, found 2"),
    "a loop": (changed('<parent link="base"/>', '<parent link="rod"/>'), "not carried by"),
    "a link in two places": (changed('<child link="rod"/>', '<child link="arm"/>'), "two parents"),
    "a chain without end": (chain(20_000), "links; expected at most 5000"),
    "a chain too long": (chain(3000), "more than 200 joints"),
    "too deep": (changed("</robot>", f"{'<a>' * 99}{'</a>' * 99}</robot>"), "more than 50"),
    "far too deep": (changed("</robot>", f"{'<a>' * 10**5}{'</a>' * 10**5}</robot>"), "than 50"),
    "too long": (changed("</robot>", f"<!--{'x' * 64_000_001}--></robot>"), "at most 64000000"),
    "a billion laughs": (laughs(), "it has a DOCTYPE"),
    "a file by an entity": (f"{ENTITY}{changed(END, f'<x>&a;</x>{END}')}", "it has a DOCTYPE"),
    "a file by its DOCTYPE": ('<!DOCTYPE r SYSTEM "file:///etc/hostname">' + URDF, "a DOCTYPE"),
    "an entity that is nowhere": (changed('"rod"', '"&a;"'), "not valid XML: undefined entity"),
    "half": (URDF[: len(URDF) // 2], "not valid XML"),
    "nothing": ("", "not valid XML"),
    "a NUL": (changed('"rod"', '"\0"'), "not valid XML"),
    "half a character": (changed('"rod"', '"\ud800"'), "not valid XML"),
    "another format": ("<sdf/>", "the root element is <sdf>, expected <robot>"),
    "twice": (URDF + URDF, "not valid XML: junk after document element"),
}

TAKEN: dict[str, str] = {
    "unicode": URDF.replace("hinge", "h\u00e4nge\u2603"),
    "ten megabytes": changed("</robot>", f"<!--{'x' * 10_000_000}--></robot>"),
    "an encoding that it does not have": '<?xml version="1.0" encoding="klingon"?>' + URDF,
    "a joint with the name of the tip": URDF.replace('"hinge"', '"tip"'),
    "a mesh that is elsewhere": shaped("visual", '<mesh filename="package://../../etc/passwd"/>'),
    "a shape that is none": shaped("collision", '<box size="a"/>'),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_urdf_that_is_no_arm_is_refused_in_one_line(case):
    text, words = REFUSED[case]
    with pytest.raises(RobotError, match=re.escape(words)) as refusal:
        Robot(text, "", "tip")
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < LONGEST_REFUSAL


@pytest.mark.parametrize("case", TAKEN)
def test_a_urdf_that_is_odd_but_an_arm_is_taken(case):
    robot = Robot(TAKEN[case], "base", "tip")
    state = robot.dynamic_state(np.array([0.3, -0.2]), np.zeros(2))
    expected = Robot(URDF, "base", "tip").dynamic_state(np.array([0.3, -0.2]), np.zeros(2))
    np.testing.assert_array_equal(state.arm.J, expected.arm.J)
    np.testing.assert_array_equal(state.g, expected.g)


def test_a_urdf_of_a_pipe_or_folder_is_refused_without_waiting(tmp_path):
    (tmp_path / "folder.urdf").mkdir()
    (tmp_path / "endless.urdf").symlink_to("/dev/zero")
    for name in ("folder.urdf", "endless.urdf"):
        with pytest.raises(RobotError, match=r"the URDF cannot be read: .*no file"):
            load_robot(str(tmp_path / name))


def damaged(count: int) -> list[str]:
    """Return URDFs in which some numbers, names, tags or letters are others, or are cut out."""
    random = generator(70)
    words = ['""', '"0"', '"-1"', '"nan"', '"inf"', '"1e308"', '"1e-320"', '"a b"', '"0 0 0"']
    words += ['"tip"', '"base"', '"rod"', '"fixed"', '"continuous"', '"prismatic"', '"planar"']
    quoted = list(re.finditer('"[^"]*"', URDF))
    tags = list(re.finditer("<[^>]*>", URDF))
    texts = []
    for number in range(count):
        if number % 4 == 3:  # without one tag
            tag = tags[random.integers(len(tags))]
            texts.append(URDF[: tag.start()] + URDF[tag.end() :])
            continue
        text = URDF
        for _ in range(random.integers(1, 4)):
            if number % 4 == 2:
                at, length = random.integers(len(text)), random.integers(40)
                new = "".join(map(chr, random.integers(1, 0xD800, size=random.integers(5))))
                text = text[:at] + new + text[at + length :]
            else:
                word = quoted[random.integers(len(quoted))].group()
                text = text.replace(word, words[random.integers(len(words))], random.integers(1, 3))
        texts.append(text)
    return texts


def test_a_damaged_urdf_is_a_tree_or_refused():
    for text in damaged(500):
        with contextlib.suppress(RobotError):
            tree = UrdfTree(text)
            assert tree.links.count(tree.root) == 1
            assert all(tree.chain(tree.root, link) is not None for link in tree.links)


# --- with C++, in a process of its own -------------------------------------------------------
def fate(text: str, folder: str) -> dict[str, Any]:
    """Return what Pinocchio and PyBullet make of a text: refused, or an arm that is finite."""
    from sim_bridge.parameters import SimulatorParameters
    from sim_bridge.simulator import Simulator

    found: dict[str, Any] = {}
    try:
        robot = Robot(text, "", "tip")
        q = np.full(robot.n, 0.1)
        state = robot.dynamic_state(q, q)
        found["finite"] = all(bool(np.isfinite(v).all()) for v in (*state.arm, *state[1:]))
    except EulerParamsError as error:
        found["refused"] = str(error)
    path = Path(folder) / "arm.urdf"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        simulator = Simulator(load_robot(str(path)), SimulatorParameters(control="torque"))
        try:
            for _ in range(3):
                simulator.step()
            found["simulated"] = bool(np.isfinite(simulator.read().q).all())
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
    refused = [text for text, _ in REFUSED.values() if len(text) < 10**6]
    texts = refused + damaged(200)
    found = fates(texts)
    for text, each in zip(texts, found, strict=True):
        assert each.get("finite", True), text
        assert each.get("simulated", True), text
        for reason in (each.get("refused", ""), each.get("not simulated", "")):
            assert len(reason) < LONGEST_REFUSAL
    for text, each in zip(refused, found, strict=False):
        assert "refused" in each, text
        assert not each.get("simulated"), text


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as own_folder:
        for each in json.load(sys.stdin):
            said = json.dumps(fate(each, own_folder))
            print(f"\nfate {said}", flush=True)  # PyBullet leaves lines open
