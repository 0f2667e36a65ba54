"""``watchdog``: what a driver without a timeout gets when its controller falls silent."""

from dataclasses import replace

import numpy as np
import pytest
from ros_processes import FRAMES, HOME, MODEL, UR5, TorqueArm, values
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from eulerparams_control.control.admission import AT_REST
from eulerparams_control.control.watch import Watch, WatchMode
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.parameters.watchdog import WatchdogParameters
from eulerparams_control.ros.senders import LOOK

DT = 0.002
PUSH = 0.4 * np.array([8.0, -20.0, 6.0, 1.0, 1.0, 1.0])  # [Nm] that sets the arm in motion
P = WatchdogParameters(base_frame=UR5.base_frame, tip_frame=UR5.tip_frame)
MOST_STEP = P.max_effort_rate * DT + 1e-9  # [Nm]


def gravity(q):
    return MODEL.dynamic_state(q, 0 * q).g


class Plant:
    """A frictionless arm with a driver that holds the last effort for ever."""

    def __init__(self):
        self.watch = Watch(P.robot(UR5.urdf), P)
        self.q, self.dq, self.t, self.tau = HOME.copy(), np.zeros(6), 10.0, np.zeros(6)
        self.efforts = []

    @property
    def mode(self):
        return self.watch.mode

    @property
    def tip(self):
        return MODEL.state(self.q, self.dq)

    @property
    def speed(self):
        return np.linalg.norm(self.tip.dp_e)

    def steps(self, count, error=None, *, every=1, is_seen=True):
        """Let time go by; a controller may send efforts with an error [Nm], the arm be seen."""
        for k in range(count):
            self.t += DT
            sent = [self.watch.look(self.t)]
            if is_seen:
                sent.append(self.watch.state(self.q, self.dq, self.t))
            if error is not None and k % every == 0:
                sent.append(self.watch.effort(gravity(self.q) + error, self.t))
            for tau in sent:
                self.tau = self.tau if tau is None else tau
            self.efforts.append(self.tau)
            state = MODEL.dynamic_state(self.q, self.dq)
            self.dq = self.dq + DT * np.linalg.solve(state.B, self.tau - state.C_dq - state.g)
            self.q = self.q + DT * self.dq


@pytest.fixture
def pushed():
    """An arm that its controller has set in motion."""
    plant = Plant()
    plant.tau = gravity(plant.q)
    plant.steps(50, PUSH)
    assert plant.speed > 0.25
    return plant


def test_efforts_go_on_as_they_are_once_the_arm_is_seen_within_its_limits_also_after_short_gaps():
    plant = Plant()
    plant.steps(200, 0.0, every=20)  # 40 ms
    assert plant.mode is WatchMode.PASSING
    watch, tau = Watch(P.robot(UR5.urdf), P), np.arange(6.0)
    assert watch.effort(tau, 1.0) is None  # nobody could brake an arm that is not seen
    assert watch.state(HOME, 0 * HOME, 1.0) is None
    assert (watch.effort(tau, 1.01) == tau).all()
    assert (watch.effort(1e3 * tau, 1.02) == MODEL.limits.limit_effort(1e3 * tau)[0]).all()


def test_an_arm_whose_controller_falls_silent_is_braked_and_then_stays_unless_it_is_pushed(pushed):
    fastest, start = pushed.speed, pushed.tip.p_e
    for _ in range(300):
        pushed.steps(pushed.mode is not WatchMode.HOLDING)
        fastest = max(fastest, pushed.speed)
    assert pushed.mode is WatchMode.HOLDING
    assert np.abs(pushed.dq).max() < 2 * AT_REST
    rest = pushed.tip.p_e
    ramp = np.abs(np.array(pushed.efforts) - gravity(pushed.q)).max() / P.max_effort_rate
    assert np.linalg.norm(rest - start) < fastest * (P.timeout + 1 / P.damping + ramp)
    pushed.steps(1000)
    assert pushed.mode is WatchMode.HOLDING
    assert np.linalg.norm(pushed.tip.p_e - rest) < 1e-3
    np.testing.assert_allclose(pushed.tau, gravity(pushed.q), atol=0.1)
    # the first one comes after the silence
    assert np.abs(np.diff(pushed.efforts[50:], axis=0)).max() <= 5 * MOST_STEP
    pushed.dq = pushed.dq + 20 * AT_REST
    pushed.steps(1)
    assert pushed.mode is WatchMode.BRAKING


def test_a_controller_that_is_back_is_let_through_after_resume_alone_and_without_a_jump(pushed):
    error = np.array([0.0, 30.0, 0.0, 0.0, 0.0, 0.0])
    pushed.steps(40)
    pushed.steps(1, error)
    with pytest.raises(InvalidMessageError, match="not resumed: braking; expected an arm at rest"):
        pushed.watch.resume(pushed.t)
    pushed.steps(400)
    with pytest.raises(InvalidMessageError, match="a controller that sends"):
        pushed.watch.resume(pushed.t)  # nobody sends
    pushed.steps(50, error)
    assert pushed.mode is WatchMode.HOLDING
    np.testing.assert_allclose(pushed.tau, gravity(pushed.q), atol=0.1)
    for _ in range(2):  # the second time there is nothing to do
        pushed.watch.resume(pushed.t)
        assert pushed.mode is WatchMode.PASSING
    pushed.steps(30, error)
    assert np.abs(np.diff(pushed.efforts[-31:], axis=0)).max() <= MOST_STEP
    np.testing.assert_allclose(pushed.tau, gravity(pushed.q) + error, atol=0.2)


def test_without_states_gravity_where_the_arm_was_last_stays_until_they_are_back(pushed):
    seen = pushed.q
    pushed.steps(100, is_seen=False)
    assert pushed.mode is WatchMode.BLIND
    with pytest.raises(InvalidMessageError, match="not resumed: blind"):
        pushed.watch.resume(pushed.t)
    np.testing.assert_allclose(pushed.tau, gravity(seen), atol=0.2)  # seen a tick before that
    pushed.steps(1)
    assert pushed.mode is WatchMode.BRAKING
    pushed.steps(400)
    assert pushed.mode is WatchMode.HOLDING


def test_a_robot_that_compensates_gravity_itself_is_only_damped():
    itself = replace(P, compensate_gravity=False)
    watch = Watch(itself.robot(UR5.urdf), itself)
    watch.state(HOME, 0 * HOME, 1.0)
    watch.effort(np.zeros(6), 1.0)
    np.testing.assert_allclose(watch.state(HOME, 0 * HOME, 2.0), 0.0, atol=1e-9)
    assert (watch.state(HOME, np.eye(6)[5], 2.1) * np.eye(6)[5]).sum() < 0


# --- the node --------------------------------------------------------------------------------
class Watched:
    """The node, an arm, and who sends efforts."""

    def __init__(self, world, kind="forward", *, is_seen=True):
        self.world, self.peer, self.arm = world, world.peer, TorqueArm(world, UR5)
        self.process = world.start("watchdog", {**FRAMES, "command_type": kind})
        is_forward = kind == "forward"
        type_of = Float64MultiArray if is_forward else JointState
        self.driven = self.peer.listen(type_of, "driver_effort")
        self._field = "data" if is_forward else "effort"
        self._sender = None
        for _ in range(round(1.2 * LOOK / 0.01) * is_seen):  # until its states are believed
            world.advance(0.01)
            self.arm.send_next()

    def send(self, effort):
        self._sender = self._sender or self.peer.publisher(JointState, "joint_effort")
        self._sender.publish(JointState(name=list(UR5.joints), effort=list(map(float, effort))))

    @property
    def drives(self):
        """The efforts that the driver got last."""
        return np.array(getattr(self.driven[-1], self._field))

    @property
    def gravity(self):
        return gravity(self.arm.q)

    def told(self, mode):
        is_said = lambda status: values(status)["mode"] == mode  # noqa: E731
        return self.peer.status("watchdog", is_said, self.arm.send_next)


@pytest.mark.parametrize("kind", ["forward", "joint_state"])
def test_the_node_brakes_when_its_controller_is_killed_and_resumes_when_it_is_told(world, kind):
    node = Watched(world, kind, is_seen=False)
    arm, control = node.arm, {**FRAMES, "use_sim_time": True}
    controller = world.start("dynamic_control", control)
    arm.connect()
    node.told("passing")
    command = arm.tick()
    assert node.drives.tolist() == list(command.effort)
    controller.kill()
    node.driven.clear()
    world.advance(0.03)
    assert node.driven == []
    world.advance(0.03)
    status = node.told("holding")
    assert status.level == b"\x02"
    assert "call ~/resume" in values(status)["remedy"]
    np.testing.assert_allclose(node.drives, node.gravity)
    assert not node.peer.trigger("/watchdog/resume").success
    world.start("dynamic_control", control)
    arm.connect()
    arm.ticks(5)
    assert node.peer.trigger("/watchdog/resume").success
    command = arm.tick()
    np.testing.assert_allclose(node.drives, command.effort, atol=1e-6)
    assert node.process.stop(arm.tick) == 0
    np.testing.assert_allclose(node.drives, node.gravity, atol=0.1)


def test_the_watchdog_looks_by_its_own_clock_where_controller_and_robot_fall_silent(world):
    node = Watched(world)
    node.send(node.gravity + 1.0)
    node.driven.clear()
    world.advance(0.5)
    np.testing.assert_allclose(node.drives, node.gravity, atol=1e-9)
    assert values(node.peer.status("watchdog"))["mode"] == "blind"


def test_a_signal_brakes_the_arm_before_the_watchdog_ends(world):
    node = Watched(world)
    arm = node.arm

    def go_on():
        """Let 20 ms go by, in which a controller sends what drives the arm on."""
        for _ in range(10):
            arm._pass(0.002, None)
            arm.send_next()
            node.send(node.gravity + PUSH)
            arm._effort = node.drives

    for _ in range(5):
        go_on()
    assert np.abs(arm.dq).max() > 0.1
    assert not world.act(node.process.node.at_rest)
    assert node.process.stop(go_on) == 0
    assert np.abs(arm.dq).max() < AT_REST
    np.testing.assert_allclose(node.drives, node.gravity, atol=1.0)


def test_efforts_that_cannot_be_used_or_of_a_second_sender_are_a_silence(world):
    node = Watched(world)
    node.send([1.0] * 6)
    assert [list(msg.data) for msg in node.driven] == [[1.0] * 6]
    node.arm.states.publish(JointState(name=["finger"], position=[0.0]))  # of another driver
    assert "rejected" not in node.process.log
    for _ in range(10):
        node.send([np.nan] * 6)
        node.arm.send_next()
        world.advance(0.01)
    assert node.peer.counter("watchdog", "joint_effort rejected", 10) == 10
    assert np.isfinite([msg.data for msg in node.driven]).all()
    assert values(node.peer.status("watchdog"))["mode"] in ("braking", "holding", "blind")
    assert node.process.exit_code is None
    count, good = len(node.driven), JointState(name=list(UR5.joints), effort=[1.0] * 6)
    node.peer.another_node("second").create_publisher(JointState, "joint_effort", 10).publish(good)
    assert "two publishers on 'joint_effort': /peer, /second; expected one" in node.process.log
    assert len(node.driven) == count
