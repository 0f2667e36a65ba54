"""Surroundings of the simulated robot: springs, pushes, solids; and efforts that nobody reports."""

import dataclasses
import hashlib
import itertools
import math
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_simulator import GRAVITY, HOLDING_TORQUE, MOTOR_SPEED, TORQUE, Model, random_q, robot, run

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.robot.catalogue import RobotDescription
from sim_bridge.environment import read_environment
from sim_bridge.environment.forces import SensorMotion
from sim_bridge.environment.push import Push
from sim_bridge.parameters import SimulatorParameters
from sim_bridge.simulator import Simulator, SimulatorState

# --- tolerances ----------------------------------------------------------------------
# The same formula in two ways, of forces and moments up to 1e3 N: rounding, two decades.
FORMULA = 1e-10
# A pose by PyBullet and by Pinocchio, 1e-14 m, times a stiffness of 1e4 N/m, two decades.
THROUGH_A_POSE = 1e-8
# PyBullet's contact solver: the force of a spring whose depth is known, relative. 1e-6 seen.
PRESSED = 1e-5
# Speed of the point that friction holds, m/s.
HELD = 1e-6
# Brakes leave speeds of MOTOR_SPEED, against which solids of 1e6 N/m and 100 Ns/m push, N.
BRAKED = 1e-3


# --- samples -------------------------------------------------------------------------
STIFFNESSES = (1e3, 1e4, 1e5, 1e6)
seeds = st.integers(0, 2**32 - 1)
# A thing of each kind, as YAML gives it, with all its keys.
POSE = {"position": [0.5, 0, 0.2], "orientation": [0.0, 0.6, 0.0, 0.8]}
TIMES = {"start": 1, "end": 3}
CONTACT = {"stiffness": 2.0e4, "damping": 100, "friction": 0.5, **TIMES}
EXAMPLES: dict[str, dict[str, Any]] = {
    "box": {**POSE, **CONTACT, "size": [1, 1, 0.1]},
    "sphere": {**POSE, **CONTACT, "radius": 0.1},
    "cylinder": {**POSE, **CONTACT, "radius": 0.1, "length": 1},
    "plane": {**POSE, **CONTACT},
    "spring": {**POSE, "stiffness": [1, 2, 3], "damping": 10, **TIMES, "point": [0, 0, 0.1]},
    "torsion_spring": {
        "orientation": [0, 0, 0, 1], "stiffness": 500, **TIMES, "damping": [1.0, 2, 3],
        "offset": [0, 0, 0],  # a path would need an end
        "amplitude": [0, 0, 0],
        "phase": [0.0, 0.5, 0.0],
        "turns": 2.0,
        "ramp": 0.5,
    },
    "push": {
        "force": [1, 2, 3], "moment": [0, 0, 1], "frame": "tool", "point": [0, 0, 0.1],
        **TIMES, "ramp": 0.5, "fall": 0.3, "fastest": 1.0,
    },
}  # fmt: skip
EXAMPLES = {shape: {"shape": shape, **keys} for shape, keys in EXAMPLES.items()}
ENDLESS_PATH = EXAMPLES["torsion_spring"] | {"amplitude": [0.1, 0, 0], "end": math.inf}
REQUIRED = {
    "box": ("position", "size"),
    "sphere": ("position", "radius"),
    "cylinder": ("position", "radius", "length"),
    "plane": ("position",),
    "spring": ("position", "stiffness"),
    "torsion_spring": ("orientation", "stiffness"),
    "push": (),
}
KEYS = [(shape, key) for shape, keys in EXAMPLES.items() for key in keys]


def unit_quaternion(rng: np.random.Generator) -> Any:
    """Return x, y, z, w, uniform on the rotations."""
    xyzw = rng.normal(size=4)
    return xyzw / np.linalg.norm(xyzw)


def rotation(xyzw: Any) -> Any:
    return pin.Quaternion(np.array(xyzw, dtype=float)).matrix()


_open: list[Simulator] = []


def simulated(name: str | RobotDescription = "ur5", **parameters: Any) -> Simulator:
    """Return a simulator, which is closed after the test."""
    description = robot(name) if isinstance(name, str) else name
    _open.append(Simulator(description, SimulatorParameters(**parameters)))
    return _open[-1]


@pytest.fixture(autouse=True)
def close_simulators() -> Iterator[None]:
    yield
    while _open:
        _open.pop().close()


@cache
def model(name: str) -> Model:
    return Model(robot(name))


def placement(name: str, q: Any) -> tuple[Any, Any]:
    """Return p (3,) and R (3, 3) of the sensor frame at q."""
    own = model(name)
    pin.forwardKinematics(own.model, own.data, q)
    frame = pin.updateFramePlacement(own.model, own.data, own.frame)
    return frame.translation.copy(), frame.rotation.copy()


def motion(name: str, state: SimulatorState) -> tuple[Any, Any, Any, Any]:
    """Return p, R, v, omega of the sensor frame, base axes."""
    p, R = placement(name, state.q)
    v, omega = (model(name).J(state.q) @ state.dq).reshape(2, 3)
    return p, R, R @ v, R @ omega


def in_sensor(R: Any, f: Any, mu: Any) -> Any:
    """Return the wrench (6,) of a force and a moment in base axes."""
    return np.concatenate((R.T @ f, R.T @ mu))


# --- what may be written -------------------------------------------------------------
@pytest.mark.parametrize("shape", EXAMPLES)
def test_a_thing_reads_as_it_is_shown(shape):
    things = read_environment({"a": EXAMPLES[shape], "b": EXAMPLES["spring"]})
    assert read_environment({name: thing.keys for name, thing in things.items()}) == things
    assert read_environment(things) == things
    assert things["a"].keys["shape"] == things["a"].shape == shape
    for key, value in EXAMPLES[shape].items():
        seen = things["a"].keys[key]
        if isinstance(value, str):
            assert seen == value
        else:
            assert np.array(seen).dtype == float  # whole numbers stand for numbers
            assert np.array(seen) == pytest.approx(np.broadcast_to(value, np.shape(seen)))
    four_digits = EXAMPLES["spring"] | {"orientation": [0, 0.7071, 0, 0.7071]}  # made a unit
    unit = read_environment({"a": four_digits})["a"].keys["orientation"]
    assert np.linalg.norm(unit) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(("shape", "key"), KEYS)
def test_a_key_that_is_missing_or_impossible_is_refused_with_its_full_name(shape, key):
    keys = {name: value for name, value in EXAMPLES[shape].items() if name != key}
    if key in (*REQUIRED[shape], "shape"):
        with pytest.raises(ConfigurationError, match=rf"^environment\.odd\.{key} is missing"):
            read_environment({"odd": keys})
    else:
        assert read_environment({"odd": keys})["odd"].keys.keys() == EXAMPLES[shape].keys()
    words = rf"environment\.odd\.{key}\b.*(expected|known)"
    numbers = (math.nan, -math.inf, True, None, [], [1.0] * 5, {"x": 1.0}, [[1.0, 0.0, 0.0]])
    for bad in ("1.0", "heavy", *numbers):
        with pytest.raises(ConfigurationError, match=words):
            read_environment({"odd": EXAMPLES[shape] | {key: bad}})


@pytest.mark.parametrize("shape", EXAMPLES)
def test_a_misspelt_key_is_refused_with_what_was_probably_meant(shape):
    key = next(reversed(EXAMPLES[shape]))
    with pytest.raises(UnknownNameError) as error:
        read_environment({"odd": EXAMPLES[shape] | {key + "s": 1.0}})
    assert f"'environment.odd.{key}s' (did you mean 'environment.odd.{key}'?)" in str(error.value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (5, "environment.odd is 5; expected environment.NAME.KEY"),
        ({}, "environment.odd.shape is missing; expected one of box, cylinder, plane, push"),
        ({"shpae": "box"}, "environment.odd.shape is missing; expected one of .*; found shpae"),
        ({"shape": "boxx"}, "unknown value of environment.odd.shape: 'boxx' (did you mean 'box'?)"),
        (EXAMPLES["spring"] | {"stiffness": [1.0, 2.0]}, "expected one finite number or 3"),
        (EXAMPLES["spring"] | {"stiffness": "2e4"}, "is '2e4', a text to YAML; write 2.0e+04"),
        (EXAMPLES["box"] | {"orientation": [0, 0, 1, 1]}, "of norm 1.41421; expected a unit"),
        (EXAMPLES["box"] | {"stiffness": 0.0}, "expected a finite number above 0 [N/m]"),
        (EXAMPLES["box"] | {"size": [1.0, 1.0, 0.0]}, "expected 3 finite numbers above 0 [m]"),
        (EXAMPLES["box"] | {"friction": 11}, "expected a finite number from 0 to 10"),
        (EXAMPLES["plane"] | {"damping": -1.0}, "expected a finite number of 0 or more [Ns/m]"),
        (EXAMPLES["push"] | {"frame": "tol"}, "environment.odd.frame: 'tol' (did you mean 'tool'?"),
        (EXAMPLES["push"] | {"end": 0.5}, "environment.odd: end is 0.5 s; expected it after start"),
        (EXAMPLES["push"] | {"ramp": 1.8}, "start 1 s and the ramps, 1.8 s and 0.3 s"),
        (EXAMPLES["box"] | {"start": 3.0}, "end is 3 s; expected it after start 3 s"),
        (ENDLESS_PATH, "end is inf s; expected it after start 1 s and, of 0.5 s each, two ramps"),
        ({"shape": "push"}, "environment.odd: force and moment are both zero"),
    ],
)
def test_a_thing_that_is_impossible_is_refused_with_what_was_expected(keys, words):
    pattern = re.escape(words).replace(re.escape(".*"), ".*")
    with pytest.raises(ConfigurationError, match=pattern):
        read_environment({"odd": keys})
    with pytest.raises(ConfigurationError, match=pattern):
        SimulatorParameters(environment={"odd": keys})


# --- springs and pushes --------------------------------------------------------------
def random_spring(rng: np.random.Generator) -> tuple[dict[str, Any], Any]:
    """Return a spring near the arm, and its force and moment about the sensor's origin."""
    U = rotation(xyzw := unit_quaternion(rng))
    position, point = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.2, 0.2, 3)
    k, d = rng.uniform(0.0, 1e3, 3), rng.uniform(0.0, 50.0, 3)
    keys = {"position": position, "orientation": xyzw, "stiffness": k, "damping": d, "point": point}

    def exerted(p: Any, R: Any, v: Any, omega: Any) -> tuple[Any, Any]:
        arm = R @ point
        dp = v + np.cross(omega, arm)
        f = sum(
            (k[i] * (position - p - arm) @ U[:, i] - d[i] * dp @ U[:, i]) * U[:, i]
            for i in range(3)
        )
        return f, np.cross(arm, f)

    return {"shape": "spring", **keys}, exerted


def random_torsion_spring(rng: np.random.Generator) -> tuple[dict[str, Any], Any]:
    U = rotation(xyzw := unit_quaternion(rng))
    k, d = rng.uniform(0.0, 50.0, 3), rng.uniform(0.0, 1.0, 3)

    def exerted(p: Any, R: Any, v: Any, omega: Any) -> tuple[Any, Any]:
        turn = R @ pin.log3(R.T @ U)  # in the sensor's axes first
        return np.zeros(3), U @ (k * (U.T @ turn) - d * (U.T @ omega))

    return {"shape": "torsion_spring", "orientation": xyzw, "stiffness": k, "damping": d}, exerted


def random_push(rng: np.random.Generator) -> tuple[dict[str, Any], Any]:
    force, moment, point = rng.uniform(-20.0, 20.0, (3, 3)) * [[1.0], [0.2], [0.01]]
    frame = rng.choice(["base", "tool"])

    def exerted(p: Any, R: Any, v: Any, omega: Any) -> tuple[Any, Any]:
        f, mu = (force, moment) if frame == "base" else (R @ force, R @ moment)
        return f, mu + np.cross(R @ point, f)

    keys = {"force": force, "moment": moment, "point": point, "frame": str(frame)}
    return {"shape": "push", **keys}, exerted


FORCES = {"spring": random_spring, "torsion_spring": random_torsion_spring, "push": random_push}


@pytest.mark.parametrize("kinds", [*((kind,) for kind in FORCES), ("spring", "push", "push")])
@pytest.mark.parametrize("name", ["ur5", "panda", "kuka_iiwa"])
@given(seed=seeds)
@settings(deadline=None, max_examples=4)
def test_springs_and_pushes_move_the_arm_and_are_read_with_sign_axes_and_moment(name, kinds, seed):
    rng = np.random.default_rng(seed)
    made = [FORCES[kind](rng) for kind in kinds]
    environment = {f"thing {k}": keys for k, (keys, _) in enumerate(made)}
    sim = simulated(name, control="torque", enforce_limits=False, environment=environment)
    sim.reset(random_q(name, rng))
    external, own = rng.uniform(-5.0, 5.0, 6), model(name)
    for k in range(10):
        before = sim.read()
        p, R, v, omega = motion(name, before)
        exerted = [law(p, R, v, omega) for _, law in made]
        acting = sum(in_sensor(R, f, mu) for f, mu in exerted)
        if k == 0:  # at once, of the state at rest
            assert before.wrench == pytest.approx(acting, abs=FORMULA)
        if k > 5:
            sim.set_external_wrench(external)
            acting = acting + external
        tau = own.tau(before.q, before.dq, rng.uniform(-20.0, 20.0, own.n))
        sim.command_effort(tau)
        after = run(sim, 1)
        assert after.wrench == pytest.approx(acting, abs=THROUGH_A_POSE)
        ddq = (after.dq - before.dq) / 1e-3
        moved = own.tau(before.q, before.dq, ddq, acting)
        assert moved == pytest.approx(tau - own.friction(before.dq), abs=1e3 * TORQUE)
    assert np.abs(acting).max() > 0.1
    sim.close()


def test_a_push_that_falls_at_once_is_whole_until_its_end():
    push = Push(force=(0, 0, 10.0), start=1.0, end=3.0, ramp=0.5, fall=0.0)
    assert [push.share(t) for t in (1.0, 1.25, 1.5, 2.999)] == pytest.approx([0.0, 0.5, 1.0, 1.0])


def test_a_push_rises_and_falls_smoothly_and_acts_from_start_to_end():
    push = Push(
        force=(0, 0, 10.0), moment=(0, 20.0, 0), frame="tool", start=0.01, end=0.05, ramp=0.01
    )
    sim = simulated(environment={"push": push})
    acting, moment = np.array([run(sim, 1).wrench[[2, 4]] for _ in range(60)]).T
    assert moment == pytest.approx(2.0 * acting, abs=1e-6)
    s = np.arange(10) / 10.0
    ramp = 10.0 * (3.0 * s**2 - 2.0 * s**3)
    expected = np.concatenate((np.zeros(10), ramp, np.full(21, 10.0), ramp[:0:-1], np.zeros(10)))
    assert acting == pytest.approx(expected, abs=1e-6)
    assert np.abs(np.diff(acting)).max() < 1.6


@pytest.mark.parametrize(("v", "left"), [(0.0, 1.0), (0.2, 0.6), (0.6, 0.0), (-0.2, 1.4)])
def test_a_hand_pushes_less_the_faster_it_has_to_follow(v, left):
    push = Push(force=(0, 0, 10.0), moment=(0, 1.0, 0), point=(0.1, 0, 0), fastest=0.5)
    turns = SensorMotion(np.zeros(3), np.eye(3), np.zeros(3), np.array([0.0, -10 * v, 0.0]))
    for moving in (turns._replace(v=np.array([1.0, 1.0, v]), omega=np.zeros(3)), turns):
        f, mu = push.exerted(0.0, moving)
        assert f == pytest.approx([0, 0, 10 * left])
        assert mu == pytest.approx([0, 1.0 - left, 0])


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_a_wall_a_spring_and_a_handle_come_and_go_within_one_step_and_again_after_a_reset(shape):
    tool, top = upright_tool("ur5", shape), lowest("ur5", shape) + 1e-3
    p, R = placement("ur5", np.array(robot("ur5").home))
    turned = pin.Quaternion(R @ pin.exp3(np.array([0.1, 0.0, 0.0]))).coeffs()
    sim = simulated(environment={
        "wall": {"shape": "plane", "position": [0, 0, top], "stiffness": 2e4, "end": 0.003},
        "again": {"shape": "plane", "position": [0, 0, top], "stiffness": 3e4, "start": 0.006},
        "spring": {"shape": "spring", "position": p + [0.1, 0, 0], "stiffness": 70.0,
                   "start": 0.002, "end": 0.005},
        "handle": {"shape": "torsion_spring", "orientation": turned, "stiffness": 50.0,
                   "start": 0.001, "end": 0.004},
    }, **tool)  # fmt: skip
    expected = np.zeros((3, 10))  # of the step from k on: t_k
    expected[0, :3], expected[0, 6:] = 20.0, 30.0
    expected[1, 2:5], expected[2, 1:4] = 7.0, 5.0
    for _ in range(2):
        sensed = []
        for _ in range(10):
            state = run(sim, 1)
            point = R.T @ [0.0, 0.0, -HEIGHT - (0.02 if shape == "sphere" else 0.03)]
            up, along = (R @ state.wrench[:3])[[2, 0]]
            touched = np.cross(point, R.T @ [0.0, 0.0, up])
            sensed.append([up, along, (state.wrench[3:] - touched)[0]])
        assert np.transpose(sensed) == pytest.approx(expected, abs=BRAKED)
        sim.reset()


def test_noise_and_bias_do_not_reach_what_acts():
    spring = {"shape": "spring", "position": [0.5, 0, 0.3], "stiffness": 1e3}
    quiet = simulated(environment={"spring": spring}, control="torque")
    noisy = simulated(
        environment={"spring": spring}, control="torque", noise_position=0.1, noise_velocity=1.0,
        noise_force=1.0, wrench_bias=(1.0,) * 6, encoder_resolution=10,
    )  # fmt: skip
    for sim in (quiet, noisy):
        sim.command_effort(np.zeros(6))
        run(sim, 20)
    assert quiet.engine.sample().q == noisy.engine.sample().q
    assert noisy.read().q != pytest.approx(quiet.read().q, abs=0.01)


# --- efforts that nobody reports -----------------------------------------------------
@pytest.mark.parametrize("control", ["position", "torque"])
def test_brakes_and_servo_hold_against_a_disturbance_from_the_first_sample_on(control):
    disturbance = np.array([3.0, -3.0, 3.0, 1.0, -1.0, 1.0])
    sim = simulated(control=control, disturbance_effort=disturbance)
    zero, home = np.zeros(6), np.array(robot("ur5").home)
    held = model("ur5").gravity(home) - disturbance
    assert sim.read().tau == pytest.approx(held, abs=HOLDING_TORQUE)
    if control == "position":
        sim.command_position(home, zero)
    state = run(sim, 100)
    assert state.tau == pytest.approx(held, abs=HOLDING_TORQUE)
    assert state.q == pytest.approx(home, abs=100 * MOTOR_SPEED)


# --- solids: depth, normal, moment ---------------------------------------------------
LONG = (0.02, 0.06)
SIZES = {"sphere": (0.02,), "capsule": LONG, "cylinder": LONG, "box": (0.04, 0.05, 0.06)}
# Of a solid in its own axes: the keys of its size, the normal of a face, and where that is.
FACES: dict[str, tuple[dict[str, Any], Any, Any]] = {
    "plane": ({}, [0, 0, 1], [0, 0, 0]),
    "box": ({"size": [1, 0.8, 0.5]}, [0, 1, 0], [0.1, 0.4, -0.1]),
    "sphere": ({"radius": 0.3}, [0.6, 0, 0.8], [0.18, 0, 0.24]),
    "cylinder": ({"radius": 0.3, "length": 0.4}, [0, 0, -1], [0.1, 0, -0.2]),
}


def deepest(shape: str, R: Any, n: Any) -> Any:
    """Return the point of a sphere or capsule that is farthest along -n, from its middle."""
    radius, *length = SIZES[shape]
    d = -R.T @ n
    cap = [0.0, 0.0, np.sign(d[2]) * length[0] / 2.0] if length else np.zeros(3)
    return R @ (radius * d + cap)


def tool_at(shape: str, middle: Any, xyzw: Any) -> dict[str, Any]:
    """Return the parameters of a tool, of which middle and orientation are in the sensor frame."""
    return {
        "tool_shape": shape, "tool_size": SIZES[shape], "tool_position": middle,
        "tool_orientation": xyzw,
    }  # fmt: skip


def solid_at(face: str, surface: Any, xyzw: Any, **contact: Any) -> dict[str, Any]:
    """Return a solid of which a face goes through a point."""
    keys, _, at = FACES[face]
    position = surface - rotation(xyzw) @ np.array(at, dtype=float)
    return {"shape": face, "position": position, "orientation": xyzw, **keys, **contact}


def normal_of(face: str, xyzw: Any) -> Any:
    return rotation(xyzw) @ np.array(FACES[face][1], dtype=float)


@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("shape", ["sphere", "capsule"])
@pytest.mark.parametrize("stiffness", STIFFNESSES)
@given(seed=seeds)
@settings(deadline=None, max_examples=2)
def test_a_solid_pushes_with_its_stiffness_along_its_normal_at_the_point_of_contact(
    face, shape, stiffness, seed
):
    rng = np.random.default_rng(seed)
    most = min(50.0, 0.8 * stiffness * SIZES[shape][0])  # its middle stays outside
    force, xyzw, turn = rng.uniform(2.0, most), unit_quaternion(rng), unit_quaternion(rng)
    p, R = placement("ur5", np.array(robot("ur5").home))
    middle, n = rng.uniform(-0.1, 0.1, 3), normal_of(face, xyzw)
    point = R @ middle + deepest(shape, R @ rotation(turn), n)
    surface = p + point + n * force / stiffness
    solid = solid_at(face, surface, xyzw, stiffness=stiffness, damping=100.0)
    sim = simulated(environment={"solid": solid}, **tool_at(shape, middle, turn))
    expected = in_sensor(R, force * n, np.cross(point, force * n))
    assert sim.read().wrench == pytest.approx(expected, abs=PRESSED * force)  # at once
    assert run(sim, 50).wrench == pytest.approx(expected, abs=PRESSED * force + BRAKED)
    sim.close()


@pytest.mark.parametrize("face", ["plane", "box"])
@pytest.mark.parametrize("tilt", [0.0, 1e-3, 0.02, 0.5])
def test_a_box_on_a_face_is_as_stiff_as_a_point_however_many_corners_touch(face, tilt):
    p, R = placement("ur5", np.array(robot("ur5").home))
    xyzw, size = unit_quaternion(np.random.default_rng(2)), np.array(SIZES["box"])
    n = normal_of(face, xyzw)
    own = {"plane": [0, 0, 0, 1], "box": [-np.sqrt(0.5), 0, 0, np.sqrt(0.5)]}[face]  # z to n
    R_box = rotation(xyzw) @ rotation(own) @ pin.exp3(tilt * np.array([0.8, 0.6, 0.0]))
    turn = pin.Quaternion(R.T @ R_box).coeffs()
    middle = np.array([0.01, 0.02, 0.1])
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size @ R_box.T
    depth = 2e-4
    surface = p + R @ middle + n * (depth + (corners @ n).min())
    solid = solid_at(face, surface, xyzw, stiffness=1e5)
    sim = simulated(environment={"solid": solid}, **tool_at("box", middle, turn))
    depths = np.clip((surface - p - R @ middle - corners) @ n, 0.0, None)
    shares = depths / depths.sum()
    f = 1e5 * (shares @ depths) * n  # the mean depth, each weighing as much as it is
    mu = np.cross(R @ middle + shares @ corners, f)
    lever = 2e-3 * np.linalg.norm(f)  # 0.2 mm of depth are seen at an angle
    assert np.count_nonzero(depths) == {0.0: 4, 1e-3: 4, 0.02: 1, 0.5: 1}[tilt]
    wrench = sim.read().wrench
    assert wrench[:3] == pytest.approx(R.T @ f, abs=PRESSED * 20.0)
    assert wrench[3:] == pytest.approx(R.T @ mu, abs=lever)


@pytest.mark.parametrize("rate", [100.0, 333.0, 8000.0])
def test_the_rate_does_not_change_how_stiff_a_solid_is(rate):
    law, top = Law("ur5"), lowest("ur5", "box") + 1e-3
    plane = {"shape": "plane", "position": [0, 0, top], "stiffness": 3e4, "damping": 1e3}
    sim = simulated(rate=rate, environment={"plane": plane}, **upright_tool("ur5", "box"))
    for state in (sim.read(), run(sim, 20)):
        assert law.R @ state.wrench[:3] == pytest.approx([0.0, 0.0, 30.0], abs=BRAKED)


# --- solids: in motion ---------------------------------------------------------------
HEIGHT = 0.1  # of the middle of the tool below the sensor, m


def touched_sum(sim: Simulator, name: str) -> tuple[Any, Any]:
    """Return force and moment about the world's origin of PyBullet's points of contact."""
    engine = sim.engine
    points = pybullet.getContactPoints(
        engine.body, sim.contacts.bodies[name], physicsClientId=engine.client
    )
    total = np.zeros((2, 3))
    for point in points:
        f = point[9] * np.array(point[7])
        f += point[10] * np.array(point[11]) + point[12] * np.array(point[13])
        total += f, np.cross(point[5], f)
    return total[0], total[1]


def upright_tool(name: str, shape: str) -> dict[str, Any]:
    """Return a tool HEIGHT below the sensor of an arm at home, with axes along the base's."""
    _, R = placement(name, np.array(robot(name).home))
    return tool_at(shape, R.T @ [0, 0, -HEIGHT], pin.Quaternion(R.T).coeffs())


def lowest(name: str, shape: str) -> float:
    """Return the height of the lowest point of that tool at home."""
    p, _ = placement(name, np.array(robot(name).home))
    return float(p[2]) - HEIGHT - {"sphere": 0.02, "box": 0.03, "cylinder": 0.03}.get(shape, 0.05)


class Law:
    """Gravity compensation, with a spring and a damper from the tip to a pose, and damping."""

    def __init__(self, name: str) -> None:
        self.name, self.home = name, np.array(robot(name).home)
        self.p, self.R = placement(name, self.home)

    def effort(self, state: SimulatorState, p_d: Any = None, push: Any = (0, 0, 0)) -> Any:
        p, R, v, omega = motion(self.name, state)
        f = 1500.0 * ((self.p if p_d is None else p_d) - p) - 150.0 * v + push
        mu = 50.0 * R @ pin.log3(R.T @ self.R) - 5.0 * omega
        zero = np.zeros_like(self.home)
        gravity = model(self.name).tau(state.q, state.dq, zero)
        J = model(self.name).J(state.q)
        return gravity + J.T @ in_sensor(R, f, mu) + (self.home - state.q) - 0.5 * state.dq


def on_a_plane(name: str, shape: str, others: Any = None, **contact: Any) -> tuple[Law, Simulator]:
    """Return a torque-controlled arm whose tool is a millimetre deep in a plane, and its law."""
    top = lowest(name, shape) + 1e-3
    plane = {"shape": "plane", "position": [0, 0, top], "stiffness": 2e4} | contact
    things = {"plane": plane} | (others or {})
    tool = upright_tool(name, shape)
    return Law(name), simulated(name, control="torque", environment=things, **tool)


@pytest.mark.parametrize("control", ["torque", "position"])
@pytest.mark.parametrize(
    ("name", "shape"), [*(("ur5", shape) for shape in SIZES), ("panda", "box")]
)
def test_the_sensor_reads_the_sum_of_contact_forces_with_sign_axes_and_moment(name, shape, control):
    law = Law(name)
    turn = pin.exp3(np.array([0.15, -0.1, 0.3]))
    top = np.array([law.p[0], law.p[1], lowest(name, shape) - 0.005])
    table = {
        "shape": "box", "size": [1, 1, 0.2], "position": top - turn @ [0, 0, 0.1],
        "orientation": pin.Quaternion(turn).coeffs(), "stiffness": 2e4, "damping": 200.0,
    }  # fmt: skip
    tool = upright_tool(name, shape)
    sim = simulated(name, control=control, environment={"table": table}, **tool)
    strongest = 0.0
    for k in range(300):
        state = sim.read()
        x = np.array([0.02 * np.sin(0.01 * k), 0.02 * np.sin(0.017 * k), 0.02 * np.cos(0.008 * k)])
        target = law.p + x - [0, 0, 0.02]
        before = sim.engine.sensor_motion()
        if control == "torque":
            sim.command_effort(law.effort(state, target))
        else:
            v = np.concatenate((before.R.T @ (20.0 * (target - before.p)), np.zeros(3)))
            sim.command_position(state.q, np.linalg.pinv(model(name).J(state.q)) @ v)
        after = run(sim, 1)
        f, mu = touched_sum(sim, "table")
        expected = in_sensor(before.R, f, mu - np.cross(before.p, f))
        assert after.wrench == pytest.approx(expected, abs=FORMULA)
        strongest = max(strongest, float(np.linalg.norm(f)))
    assert strongest > 20.0


def test_a_contact_of_a_link_beyond_the_sensor_is_read_too():
    flange = dataclasses.replace(robot("panda"), sensor_frame="panda_link8")
    own, home = Model(flange), np.array(flange.home)
    R = own.R(home)
    top = own.data.oMf[own.frame].translation - [0.0, 0.0, 0.11]  # between the tips of the fingers
    box = {"shape": "box", "size": [0.1, 0.1, 0.2], "position": top - [0.0, 0.0, 0.1]}
    sim = simulated(flange, collide_links=True, environment={"box": box | {"stiffness": 1e4}})
    for state in (sim.read(), run(sim, 20)):
        f, _ = touched_sum(sim, "box")
        assert f[2] > 1.0
        weight = 0.76 * GRAVITY  # of the hand
        assert R @ state.wrench[:3] == pytest.approx(f + weight, abs=BRAKED)


@pytest.mark.parametrize("damping", [0.0, 300.0])
def test_a_solid_is_an_implicit_spring_and_damper_that_never_pulls(damping):
    k, height = 2e4, lowest("ur5", "sphere")
    plane = {"shape": "plane", "position": [0, 0, height - 0.01], "stiffness": k}
    plane["damping"] = damping
    sim = simulated(control="torque", environment={"plane": plane}, **upright_tool("ur5", "sphere"))
    law, own, bounced, pressed = Law("ur5"), model("ur5"), 0, 0
    middle = sim.parameters.tool_position
    for step in range(400):
        before = sim.read()
        p, R = placement("ur5", before.q)
        depth = height - 0.01 - (p + R @ middle)[2] + 0.02
        push = (0.0, 0.0, 60.0 if step > 250 else -30.0)
        sim.command_effort(law.effort(before, p, push))
        after = run(sim, 1)
        v, omega = (own.J(before.q) @ after.dq).reshape(2, 3)
        rate = (R @ (v + np.cross(omega, middle + R.T @ [0, 0, -0.02 + depth / 2])))[2]
        force = (R @ after.wrench[:3])[2]
        if depth > 1e-6:
            expected = max(0.0, k * (depth - 1e-3 * rate) - damping * rate)
            assert force == pytest.approx(expected, rel=1e-3, abs=0.05)
            pressed += 1
        elif depth < -1e-3:
            assert force == pytest.approx(0.0, abs=FORMULA)
            bounced += 1
    assert min(pressed, bounced) > 20


@pytest.mark.parametrize(
    ("shape", "friction"), [("sphere", 0.0), ("sphere", 0.3), ("sphere", 1.0), ("box", 0.3)]
)
def test_a_tool_that_slides_is_braked_by_friction_times_the_normal_force(shape, friction):
    law, sim = on_a_plane("panda", shape, friction=friction)
    along = np.array([0.8, 0.6, 0.0])
    for k in range(600):
        before = sim.read()
        sim.command_effort(law.effort(before, law.p + 5e-5 * k * along, (0, 0, -20.0)))
        sim.step()
    _, R, v, omega = motion("panda", before)
    force = R @ sim.read().wrench[:3]
    slip = v + np.cross(omega, R @ sim.parameters.tool_position)
    assert np.linalg.norm(slip[:2]) > 0.01
    assert np.linalg.norm(force[:2]) == pytest.approx(friction * force[2], rel=5e-3, abs=FORMULA)
    if friction:
        assert -force[:2] @ slip[:2] > 0.95 * np.linalg.norm(force[:2]) * np.linalg.norm(slip[:2])


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_friction_holds_a_tool_that_is_pushed_less_than_it_can_bear(shape):
    hand = Push(force=(5.0, 3.0, 0.0), start=0.3)
    law, sim = on_a_plane("ur5", shape, {"hand": hand}, friction=0.5)
    middle = sim.parameters.tool_position
    for step in range(1300):
        state = sim.read()
        p, R, v, omega = motion("ur5", state)
        if step > 1000:  # it may roll, but its lowest point must not move
            low = R @ middle + [0.0, 0.0, -0.02 if shape == "sphere" else -0.03]
            assert (v + np.cross(omega, low))[:2] == pytest.approx([0.0, 0.0], abs=HELD)
        sim.command_effort(law.effort(state, [*p[:2], law.p[2]], (0, 0, -20.0)))
        sim.step()
    f, _ = touched_sum(sim, "plane")
    assert f[:2] == pytest.approx([-5.0, -3.0], abs=0.1)


def test_brakes_hold_without_the_help_of_friction_at_the_start_and_later():
    law, sim = on_a_plane("ur5", "sphere")
    _, R = placement("ur5", law.home)
    pressed = [0.0, 0.0, 20.0]
    assert R @ sim.read().wrench[:3] == pytest.approx(pressed, abs=BRAKED)
    for _ in range(200):
        sim.command_effort(law.effort(sim.read(), push=(5.0, 0.0, -20.0)))
        sim.step()
    _, R = placement("ur5", sim.read().q)
    assert np.linalg.norm((R @ sim.read().wrench[:3])[:2]) > 1.0
    sim.brake()
    _, R = placement("ur5", run(sim, 100).q)
    assert (R @ sim.read().wrench[:3])[:2] == pytest.approx([0.0, 0.0], abs=BRAKED)


# --- what touches what ---------------------------------------------------------------
def test_a_shape_of_the_tool_has_no_mass():
    runs = []
    for tool in ({}, upright_tool("ur5", "box")):
        sim = simulated(control="torque", **tool)
        sim.command_effort(np.full(6, 3.0))
        runs.append(run(sim, 100))
    assert runs[1].q == pytest.approx(runs[0].q, abs=1e-12)
    assert runs[1].wrench == pytest.approx(np.zeros(6), abs=FORMULA)


@pytest.mark.parametrize("collide", [False, True])
def test_links_touch_solids_only_if_they_are_let_and_the_brakes_feel_it(collide):
    block = {"shape": "sphere", "position": [0.0, 0.0, 0.5], "radius": 0.35, "stiffness": 1e3}
    ground = {"shape": "plane", "position": [0, 0, 0.01], "stiffness": 1e6}  # through the base
    sim = simulated(
        collide_links=collide, environment={"block": block, "ground": ground},
        **upright_tool("ur5", "sphere"),
    )  # fmt: skip
    touched = [
        pybullet.getContactPoints(sim.engine.body, body, physicsClientId=sim.engine.client)
        for body in sim.contacts.bodies.values()
    ]
    assert bool(touched[0]) == collide
    assert not touched[1]  # what cannot move
    free = model("ur5").gravity(np.array(robot("ur5").home))
    assert (np.abs(sim.read().tau - free).max() > 1.0) == collide
    assert sim.read().wrench == pytest.approx(np.zeros(6), abs=FORMULA)


# --- repeatable ----------------------------------------------------------------------
def contact_run(sim: Simulator) -> str:
    """Return a digest of a run through all that an environment can do."""
    digest = hashlib.sha256(sim.read().wrench.tobytes())
    law = Law("ur5")
    for k in range(300):
        target = law.p + [0.02 * np.sin(0.02 * k), 0.01 * np.sin(0.04 * k), -0.01]
        sim.command_effort(law.effort(sim.read(), target))
        digest.update(np.concatenate(run(sim, 1)[2:]).tobytes())
    return digest.hexdigest()


def busy() -> Simulator:
    """Return a noisy robot whose box touches a tilted table, on a spring, pushed and disturbed."""
    law = Law("ur5")
    environment = {
        "table": {
            "shape": "plane", "position": [*law.p[:2], lowest("ur5", "box")], "stiffness": 2e4,
            "orientation": [0.01, 0.0, 0.0, 0.99995],
        },
        "ball": {"shape": "sphere", "position": law.p + [0.15, 0, -0.15], "radius": 0.1},
        "spring": {"shape": "spring", "position": law.p, "stiffness": 100, "damping": 5.0},
        "turn": {"shape": "torsion_spring", "orientation": [0, 0, 0, 1], "stiffness": 5},
        "hand": {"shape": "push", "force": [1, 0, 0], "start": 0.1, "end": 0.2, "ramp": 0.05},
    }  # fmt: skip
    return simulated(
        control="torque", disturbance_effort=1.0, environment=environment, friction_viscous=0.5,
        friction_coulomb=1.0, noise_position=1e-4, noise_force=0.1, encoder_resolution=4096,
        velocity_cutoff=50.0, **upright_tool("ur5", "box"),
    )  # fmt: skip


def rolling() -> Simulator:
    return on_a_plane("ur5", "cylinder")[1]


@pytest.mark.parametrize("made", [busy, rolling])
def test_a_reset_repeats_the_bits_of_a_run_with_contact(made):
    sim = made()
    first = contact_run(sim)
    sim.set_external_wrench(np.full(6, 5.0))
    sim.reset()
    assert contact_run(sim) == first
