"""``watchdog``: what a driver without a timeout gets when its controller falls silent."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from ros_processes import FRAMES, HOME, MODEL, UR5, Array, TorqueArm, values
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from eulerparams_control.control.admission import AT_REST
from eulerparams_control.control.watch import Watch, WatchMode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.parameters.watchdog import WatchdogParameters
from eulerparams_control.robot.robot import Robot
from eulerparams_control.ros.senders import LOOK

DT = 0.002
PUSH = 0.4 * np.array([8.0, -20.0, 6.0, 1.0, 1.0, 1.0])  # [Nm] that sets the arm in motion
P = WatchdogParameters(base_frame=UR5.base_frame, tip_frame=UR5.tip_frame)


class Plant:
    """A frictionless arm with a driver that holds the last effort for ever."""

    def __init__(self, payload: float = 0.0) -> None:
        self.watch = Watch(P.robot(UR5.urdf), P)
        self.model: Robot = replace(P, tool_mass=payload).robot(UR5.urdf)
        self.q, self.dq, self.t, self.tau = HOME.copy(), np.zeros(6), 10.0, np.zeros(6)
        self.efforts: list[Array] = []

    def gravity(self) -> Array:
        return self.model.dynamic_state(self.q, 0 * self.q).g

    def step(self, effort: Array | None = None, *, is_seen: bool = True) -> None:
        """Let DT go by; a controller may send an effort, and the state may be seen."""
        self.t += DT
        sent = [self.watch.look(self.t)]
        if is_seen:
            sent.append(self.watch.state(self.q, self.dq, self.t))
        if effort is not None:
            sent.append(self.watch.effort(effort, self.t))
        for tau in sent:
            self.tau = self.tau if tau is None else tau
        self.efforts.append(self.tau)
        state = self.model.dynamic_state(self.q, self.dq)
        self.dq = self.dq + DT * np.linalg.solve(state.B, self.tau - state.C_dq - state.g)
        self.q = self.q + DT * self.dq

    def steps(self, count: int, error: Any = None, **seen: bool) -> None:
        """Let time go by; a controller may send efforts with an error [Nm]."""
        for _ in range(count):
            self.step(None if error is None else self.gravity() + error, **seen)

    def push(self) -> None:
        """Let a controller set the arm in motion."""
        self.tau = self.gravity()
        self.steps(50, PUSH)

    def speed(self) -> float:
        state = self.model.state(self.q, self.dq)
        return float(np.linalg.norm(state.dp_e))


def test_efforts_go_on_as_they_are_once_the_arm_is_seen_within_its_limits_also_after_short_gaps():
    plant = Plant()
    for step in range(200):
        plant.step(plant.gravity() if step % 20 == 0 else None)  # 40 ms
    assert plant.watch.mode is WatchMode.PASSING
    watch, tau = Watch(P.robot(UR5.urdf), P), np.arange(6.0)
    assert watch.effort(tau, 1.0) is None  # nobody could brake an arm that is not seen
    assert watch.state(HOME, 0 * HOME, 1.0) is None
    assert watch.effort(tau, 1.01) is tau or (watch.effort(tau, 1.01) == tau).all()
    assert (watch.effort(1e3 * tau, 1.02) == MODEL.limits.limit_effort(1e3 * tau)[0]).all()
    assert watch.mode is WatchMode.PASSING


def test_an_arm_whose_controller_falls_silent_is_braked_and_then_stays_unless_it_is_pushed():
    plant = Plant()
    plant.push()
    assert plant.speed() > 0.25
    start, fastest, p = plant.t, 0.0, plant.model.state(plant.q, plant.dq).p_e
    while plant.watch.mode is not WatchMode.HOLDING:
        plant.step()
        fastest = max(fastest, plant.speed())
        assert plant.t < start + 0.6
    assert np.abs(plant.dq).max() < 2 * AT_REST
    rest = plant.model.state(plant.q, plant.dq).p_e
    ramp = np.abs(np.array(plant.efforts) - plant.gravity()).max() / P.max_effort_rate
    assert np.linalg.norm(rest - p) < fastest * (P.timeout + 1 / P.damping + ramp)
    plant.steps(1000)
    assert plant.watch.mode is WatchMode.HOLDING
    assert np.linalg.norm(plant.model.state(plant.q, plant.dq).p_e - rest) < 1e-3
    np.testing.assert_allclose(plant.tau, plant.gravity(), atol=0.1)
    steps = np.abs(np.diff(plant.efforts[50:], axis=0)).max()
    assert steps <= P.max_effort_rate * 5 * DT + 1e-9  # the first one, after the silence
    plant.dq = plant.dq + 20 * AT_REST
    plant.step()
    assert plant.watch.mode is WatchMode.BRAKING


def test_under_a_payload_that_nobody_told_the_arm_sinks_slowly():
    plant = Plant(payload=1.0)
    plant.steps(5, 0.0)
    plant.steps(1000)
    assert plant.speed() < 0.15
    assert np.isfinite(plant.q).all()


def test_a_controller_that_is_back_is_let_through_after_resume_alone_and_without_a_jump():
    plant = Plant()
    plant.push()
    error = np.array([0.0, 30.0, 0.0, 0.0, 0.0, 0.0])
    while plant.watch.mode is not WatchMode.BRAKING:
        plant.step()
    plant.steps(1, error)
    with pytest.raises(InvalidMessageError, match="not resumed: braking; expected an arm at rest"):
        plant.watch.resume(plant.t)
    plant.steps(400)
    with pytest.raises(InvalidMessageError, match="a controller that sends"):
        plant.watch.resume(plant.t)  # nobody sends
    plant.steps(50, error)
    assert plant.watch.mode is WatchMode.HOLDING
    np.testing.assert_allclose(plant.tau, plant.gravity(), atol=0.1)
    plant.watch.resume(plant.t)
    plant.efforts[:-1] = []
    plant.steps(30, error)
    assert np.abs(np.diff(plant.efforts, axis=0)).max() <= P.max_effort_rate * DT + 1e-9
    np.testing.assert_allclose(plant.tau, plant.gravity() + error, atol=0.2)
    plant.watch.resume(plant.t)  # again: nothing to do
    assert plant.watch.mode is WatchMode.PASSING


def test_without_states_gravity_where_the_arm_was_last_stays_until_they_are_back():
    plant = Plant()
    plant.push()
    plant.steps(100, is_seen=False)
    assert plant.watch.mode is WatchMode.BLIND
    seen = plant.watch._q
    np.testing.assert_allclose(plant.tau, MODEL.dynamic_state(seen, 0 * seen).g, atol=1e-9)
    with pytest.raises(InvalidMessageError, match="not resumed: blind"):
        plant.watch.resume(plant.t)
    plant.step()
    assert plant.watch.mode is WatchMode.BRAKING
    plant.steps(400)
    assert plant.watch.mode is WatchMode.HOLDING


def test_a_robot_that_compensates_gravity_itself_is_only_damped():
    itself = replace(P, compensate_gravity=False)
    watch = Watch(itself.robot(UR5.urdf), itself)
    watch.state(HOME, 0 * HOME, 1.0)
    watch.effort(np.zeros(6), 1.0)
    np.testing.assert_allclose(watch.state(HOME, 0 * HOME, 2.0), 0.0, atol=1e-9)
    assert (watch.state(HOME, np.eye(6)[5], 2.1) * np.eye(6)[5]).sum() < 0


# --- the node --------------------------------------------------------------------------------
def be_seen(arm: Any) -> None:
    """Let an arm publish its states for so long that they are believed."""
    for _ in range(round(1.2 * LOOK / 0.01)):
        arm.graph.advance(0.01)
        arm.send_next()


@pytest.mark.parametrize("kind", ["forward", "joint_state"])
def test_the_node_brakes_when_its_controller_is_killed_and_resumes_when_it_is_told(world, kind):
    type_of = {"forward": Float64MultiArray, "joint_state": JointState}[kind]
    peer, arm = world.peer, TorqueArm(world, UR5)
    watchdog = world.start("watchdog", {**FRAMES, "command_type": kind})
    driven = peer.listen(type_of, "driver_effort")
    controller = world.start("dynamic_control", {**FRAMES, "use_sim_time": True})

    def efforts(msg: Any) -> Array:
        return np.array(msg.data if kind == "forward" else msg.effort)

    def told(mode: str) -> Any:
        return peer.status("watchdog", lambda s: values(s)["mode"] == mode, arm.send_next)

    arm.connect()
    told("passing")
    command = arm.tick()
    assert efforts(driven[-1]).tolist() == list(command.effort)
    controller.kill()
    driven.clear()
    world.advance(0.03)
    assert driven == []
    world.advance(0.03)
    status = told("holding")
    assert status.level == b"\x02"
    assert "call ~/resume" in values(status)["remedy"]
    np.testing.assert_allclose(efforts(driven[-1]), MODEL.dynamic_state(arm.q, 0 * arm.q).g)

    def resumed() -> bool:
        return bool(peer.trigger("/watchdog/resume").success)

    assert not resumed()
    world.start("dynamic_control", {**FRAMES, "use_sim_time": True})
    arm.connect()
    arm.ticks(5)
    assert resumed()
    command = arm.tick()
    np.testing.assert_allclose(efforts(driven[-1]), command.effort, atol=1e-6)
    assert watchdog.stop(arm.tick) == 0
    gravity = MODEL.dynamic_state(arm.q, 0 * arm.q).g
    np.testing.assert_allclose(efforts(driven[-1]), gravity, atol=0.1)


def test_the_watchdog_looks_by_its_own_clock_where_controller_and_robot_fall_silent(world):
    arm, peer = TorqueArm(world, UR5), world.peer
    world.start("watchdog", FRAMES)
    driven = peer.listen(Float64MultiArray, "driver_effort")
    sender = peer.publisher(JointState, "joint_effort")
    be_seen(arm)
    gravity = MODEL.dynamic_state(arm.q, 0 * arm.q).g
    sender.publish(JointState(name=list(UR5.joints), effort=(gravity + 1.0).tolist()))
    driven.clear()
    world.advance(0.5)
    np.testing.assert_allclose(driven[-1].data, gravity, atol=1e-9)
    assert values(peer.status("watchdog"))["mode"] == "blind"


def test_a_signal_brakes_the_arm_before_the_watchdog_ends(world):
    arm, peer = TorqueArm(world, UR5), world.peer
    process = world.start("watchdog", FRAMES)
    driven = peer.listen(Float64MultiArray, "driver_effort")
    sender = peer.publisher(JointState, "joint_effort")
    be_seen(arm)

    def go_on() -> None:
        """Let 20 ms go by, in which a controller sends what drives the arm on."""
        for _ in range(10):
            arm._pass(0.002, None)
            arm.send_next()
            gravity = MODEL.dynamic_state(arm.q, 0 * arm.q).g
            effort = (gravity + PUSH).tolist()
            sender.publish(JointState(name=list(UR5.joints), effort=effort))
            arm._effort = np.array(driven[-1].data)

    for _ in range(5):
        go_on()
    assert np.abs(arm.dq).max() > 0.1
    assert not world.act(process.node.at_rest)
    assert process.stop(go_on) == 0
    assert np.abs(arm.dq).max() < AT_REST
    gravity = MODEL.dynamic_state(arm.q, 0 * arm.q).g
    np.testing.assert_allclose(driven[-1].data, gravity, atol=1.0)


def test_efforts_that_cannot_be_used_or_of_a_second_sender_are_a_silence(world):
    arm, peer = TorqueArm(world, UR5), world.peer
    watchdog = world.start("watchdog", FRAMES)
    driven = peer.listen(Float64MultiArray, "driver_effort")
    sender = peer.publisher(JointState, "joint_effort")
    good = JointState(name=list(UR5.joints), effort=[1.0] * 6)
    broken = JointState(name=list(UR5.joints), effort=[float("nan")] * 6)
    be_seen(arm)
    sender.publish(good)
    assert [list(msg.data) for msg in driven] == [[1.0] * 6]
    arm.states.publish(JointState(name=["finger"], position=[0.0]))  # of another driver
    assert "rejected" not in watchdog.log
    for _ in range(10):
        sender.publish(broken)
        arm.send_next()
        world.advance(0.01)
    assert peer.counter("watchdog", "joint_effort rejected", 10) == 10
    assert np.isfinite([msg.data for msg in driven]).all()
    assert values(peer.status("watchdog"))["mode"] in ("braking", "holding", "blind")
    assert watchdog.exit_code is None
    count = len(driven)
    peer.another_node("second").create_publisher(JointState, "joint_effort", 10).publish(good)
    assert "two publishers on 'joint_effort': /peer, /second; expected one" in watchdog.log
    assert len(driven) == count
