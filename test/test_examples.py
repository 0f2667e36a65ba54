"""The examples, as their users run them: real processes, in real time where time is theirs."""

import re
import signal
import subprocess
import sys
from contextlib import ExitStack
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from gymnasium.utils.env_checker import check_env
from pyarrow import parquet
from ros_processes import SpunPeer, wrench_stamped

from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.laws.orientation import ORIENTATIONS
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

FOLDER = Path(__file__).parents[1] / "examples"
FRAMES = {"base_frame": "base_link", "tip_frame": "tool0"}
LOCKSTEP = {"mode": "lockstep"}, {"use_sim_time": True}  # of the bridge, of a controller

pytestmark = pytest.mark.slow


def test_each_example_is_short_and_documented():
    page = (FOLDER.parent / "docs" / "examples.md").read_text(encoding="utf-8")
    for example in FOLDER.glob("*.py"):
        lines = example.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= (60 if "rclpy" in "".join(lines) else 150)
        assert f"`{example.name}`" in page


# --- laws without ROS ------------------------------------------------------------------
def numbers(name, figure):
    """Return the numbers that an example prints, but those of equations, and draw its figure."""
    command = [sys.executable, FOLDER / f"{name}.py", figure]
    out = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout
    out = out.replace(str(figure), "")
    assert figure.stat().st_size > 10_000
    return [float(number) for number in re.findall(r"(?<![(_\d.])\d+(?:\.\d+)?", out)]


def test_euler_angles_fail_at_their_pole_and_euler_parameters_do_not(tmp_path):
    speed_angles, error_angles, speed, error = numbers("clik_through_the_pole", tmp_path / "a.png")
    assert speed_angles > 100.0  # the joints can do 3.15 rad/s
    assert speed < 3.15
    assert error_angles > 1.5 * error


def test_an_arm_yields_to_a_wall_as_the_impedance_says(tmp_path):
    figure = tmp_path / "a.png"
    f, f_rest, off, V_start, V_end, rises, _ = numbers("impedance_against_a_spring", figure)
    assert f == pytest.approx(f_rest, rel=1e-2)
    assert off < 0.5  # [mm] by friction
    assert V_end < 1e-2 * V_start
    assert rises == 0  # (69)


@pytest.fixture
def start():
    """Yield what starts an example, which is killed at the end of the test if it still runs."""
    with ExitStack() as stack:

        def start(nodes, name, *arguments):
            command = [sys.executable, FOLDER / f"{name}.py", *arguments]
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
            running = subprocess.Popen(command, env=nodes.environment, **pipes)
            stack.enter_context(running)
            stack.callback(running.kill)
            return running

        yield start


def said(running, code=0):
    """Return what an example has said, that ended as expected."""
    out, err = running.communicate(timeout=120)
    assert running.returncode == code, out + err
    return out + err


@pytest.mark.parametrize("example", ["jog", "send_pose", "stream_poses"])
def test_an_example_moves_the_tip(example, start, tmp_path):
    with Nodes(tmp_path) as nodes:
        nodes.start("pybullet_bridge", {"robot": "ur5", "rate": 250.0})  # the time is theirs
        nodes.start("clik", FRAMES)
        assert "the tip" in said(start(nodes, example))


def test_a_recording_becomes_a_picture_and_a_table(start, tmp_path):
    bag, table = tmp_path / "bag", tmp_path / "table.parquet"
    with Nodes(tmp_path) as nodes:
        for_bridge, for_controller = LOCKSTEP
        nodes.start("pybullet_bridge", {"robot": "ur5", **for_bridge})
        nodes.start("clik", FRAMES | for_controller)
        assert "poses in" in said(start(nodes, "record_and_plot", bag))
        assert (bag / "tip.png").stat().st_size > 10_000
        assert str(table) in said(start(nodes, "bag_to_table", bag, table))
    rows = parquet.read_table(table).to_pydict()
    way = sum(np.hypot.reduce([rows[f"dp.{x} [m]"] for x in "xyz"]))
    ends = [np.array([rows[f"p.{x} [m]"][k] for x in "xyz"]) for k in (0, -1)]
    assert way == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=0.1)  # straight up
    assert max(np.abs(rows[f"dr.{x} [rad]"]).max() for x in "xyz") < 1e-3


# --- pressing --------------------------------------------------------------------------
def wall(ahead, stiffness):
    """Return a plane across the axis of the tool at home, so far [m] before the sensor."""
    about = load_robot("ur5")
    robot = Robot(about.urdf, about.base_frame, about.tip_frame)
    at = robot.state(np.array(about.home), np.zeros(robot.n))
    x, y, z = -at.R_e[:, 2]
    turn = np.array([-y, x, 0.0, 1.0 + z])  # from z to the normal
    place = {"position": (at.p_e + ahead * at.R_e[:, 2]).tolist(),
             "orientation": (turn / np.linalg.norm(turn)).tolist()}  # fmt: skip
    return {"shape": "plane", **place, "stiffness": stiffness, "damping": stiffness**0.5}


@pytest.fixture
def presses(start, tmp_path):
    """Yield what starts the robot before a wall, and presses."""
    with Nodes(tmp_path) as nodes:

        def press(ahead, stiffness=1e4, **of_robot):
            of_bridge, of_controller = LOCKSTEP
            robot = {"robot": "ur5", "control": "torque", **of_robot, **of_bridge}
            robot |= {"environment": {"wall": wall(ahead, stiffness)}}
            robot |= {"tool_shape": "sphere", "tool_size": [0.01]}
            nodes.start("pybullet_bridge", robot)
            nodes.start("impedance_control", {"wrench_pairing": "stamp", **FRAMES, **of_controller})
            source = (FOLDER / "press.py").read_text(encoding="utf-8")
            assert ", 0.5, 20.0  # [Hz]" in source
            patient = source.replace(", 0.5, 20.0  # [Hz]", ", 10.0, 20.0  # [Hz]")  # SILENCE
            (tmp_path / "press.py").write_text(patient, encoding="utf-8")
            return start(nodes, tmp_path / "press"), nodes

        yield press


@pytest.mark.parametrize(("stiffness", "noise"), [(1e4, 0.0), (1e5, 0.0), (1e4, 1.0)])
def test_it_presses_with_the_force(presses, stiffness, noise):
    running, _ = presses(0.03, stiffness, noise_force=noise)
    assert float(said(running).split()[-2]) == pytest.approx(10.0, rel=0.01)


def test_it_goes_back_where_nothing_is(presses):
    running, _ = presses(0.5)
    assert "nothing is there" in said(running, 1)


@pytest.fixture
def way(presses, closing):
    """Return the example on its way, its nodes and targets; a push, and what awaits the end.

    The push is on the tool along z [N], as the environment would.
    """
    running, nodes = presses(0.5)
    peer = closing(SpunPeer(SimpleNamespace(domain=int(nodes.environment["ROS_DOMAIN_ID"]))))
    targets = peer.listen(PoseStamped, "target_pose")
    hand = peer.publisher(WrenchStamped, "external_wrench")

    def push(force):
        hand.publish(wrench_stamped(0.0, 0.0, force, frame=FRAMES["tip_frame"]))

    def ends(word):
        """Assert that it says so at its end, and that it has gone back to the start."""
        while running.poll() is None:
            peer.spin_once()
        assert word in said(running, 1)
        assert targets[-1].pose.position.z < targets[0].pose.position.z

    while len(targets) < 3 or not hand.get_subscription_count():
        peer.spin_once()
        assert running.poll() is None, said(running)
    return running, nodes, targets, push, ends


def test_it_goes_back_when_contact_is_lost(way):
    running, _, _, push, ends = way
    push(-5.0)
    assert "contact" in running.stdout.readline()
    push(0.0)
    ends("contact is lost")


@pytest.mark.parametrize(
    ("harm", "word"),
    [
        (lambda running, nodes, push: push(5.0), "the sign is wrong"),
        (lambda running, nodes, push: nodes.kill("pybullet_bridge"), "no wrench comes"),
        (lambda running, nodes, push: running.send_signal(signal.SIGINT), "interrupted"),
    ],
)
def test_it_goes_back_when_something_is_wrong(way, harm, word):
    running, nodes, _, push, ends = way
    harm(running, nodes, push)
    ends(word)


def test_it_goes_no_deeper_than_a_bound_and_gives_up_where_the_force_never_comes(way):
    running, _, targets, push, ends = way
    push(-3.0)
    contact = 1e-3 * float(running.stdout.readline().split()[-2])
    ends("never steady")
    places = np.array([[getattr(each.pose.position, name) for name in "xyz"] for each in targets])
    deepest = max(np.linalg.norm(places - places[-1], axis=1))
    assert deepest == pytest.approx(contact + 0.03, abs=1e-3)


# --- learning --------------------------------------------------------------------------
def environment(**options):
    spec = spec_from_file_location("gym_env", FOLDER / "gym_env.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.ReachEnv(**options)


@pytest.mark.filterwarnings("ignore:.*render modes")
@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_the_environment_passes_the_checks_of_gymnasium(orientation):
    check_env(environment(orientation=orientation))


def test_a_policy_that_goes_straight_ahead_ends_an_episode():
    env = environment(orientation="rotation_vector")
    seen, info = env.reset(seed=1)
    far, ended, steps = info["distance [m]"], False, 0
    while not ended:
        seen, reward, ended, is_over, info = env.step(5.0 * seen[:6])
        steps += 1
        assert not is_over
    assert info["distance [m]"] < 0.01 < far
    assert reward > -0.02
    assert not env.controller.fault
