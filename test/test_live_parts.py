"""The parts of the page that need no browser: joints, passages, and who may do what."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped, WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from std_srvs.srv import Trigger
from tolerances import assert_close
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import EulerParameters, exp, log
from eulerparams_control.live import page
from eulerparams_control.live.desk import HELD, KEPT, Deed, Desk, Order
from eulerparams_control.live.geometry import (
    MARGIN,
    R_rpy,
    joint_motion,
    passage,
    stiffness_of,
    wxyz,
)
from eulerparams_control.live.panel import what_to_do
from eulerparams_control.live.ros.exchange import Exchange
from eulerparams_control.live.ros.pilot import Pilot
from eulerparams_control.live.view import View
from eulerparams_control.messages.to_ros import vector_to_ros
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.robot.robot import Robot

ROUNDING = 1e-7  # of angles near a pole, where their cosine is flat
PUSH = np.array([0.0, 20.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", schemes())
def test_a_page_draws_the_stiffness_of_each_controller_that_has_one(name):
    """300 N/m along u = (1, 1, 0) / sqrt(2), 100 across: 100 I + 200 u u'."""
    scheme, h = schemes()[name], 0.5**0.5
    axes = [h, h, 0.0, -h, h, 0.0, 0.0, 0.0, 1.0]
    values = {"K_p": [300.0, 100.0, 100.0], "K_p_axes": axes, "translational_frame": "desired"}
    if not hasattr(scheme.parameters(), "K_p"):
        assert stiffness_of(scheme, {}) is None
        return
    K, frame = stiffness_of(scheme, values)
    assert_close(K, [[200.0, 100.0, 0.0], [100.0, 200.0, 0.0], [0.0, 0.0, 100.0]], 1e-9)
    assert frame == "desired"
    assert stiffness_of(scheme, values | {"K_p": [1.0]}) is None


def test_joints_turn_and_slide_as_the_urdf_says():
    turned = joint_motion("revolute", [0, 0, 2], math.pi / 2)
    assert_close(turned.R @ [1, 0, 0], [0, 1, 0], 1e-15)
    assert_close(joint_motion("prismatic", [0, 0, 2], 0.3).p, [0, 0, 0.3], 1e-15)
    assert_close(R_rpy(0.0, 0.0, math.pi / 2) @ [1, 0, 0], [0, 1, 0], 1e-15)
    R = R_rpy(0.1, 0.2, 0.3)  # about the fixed x, y, z
    assert_close(R, EulerSequence("ZYX").R(np.array([0.3, 0.2, 0.1])), 1e-15)
    assert_close(EulerParameters(wxyz(R)[0], wxyz(R)[1:]).R, R, 1e-15)


def test_the_page_names_its_button_where_the_node_names_the_service():
    said = ("halt", "call ~/resume"), ("not_following", "lower the gains"), ("silence", "wait")
    found = [what_to_do(View(cause=cause, remedy=remedy)) for cause, remedy in said]
    assert found == ["press Resume", "lower the gains", "wait"]


@pytest.mark.parametrize("name", ["ur5", "panda", "baxter"])
def test_a_passage_leads_through_the_pole_where_the_arm_can_reach_it(name):
    arm = load_robot(name)
    robot = Robot(arm.urdf, arm.base_frame, arm.tip_frame, arm.joints)
    sequence, q = EulerSequence("XYZ"), np.array(arm.home)
    found = passage(robot, q, sequence.axes)
    if name == "baxter":
        assert found is None
        return
    before, beyond = found
    assert sequence.pole_distance(before) == pytest.approx(MARGIN)
    assert sequence.pole_distance(beyond) == pytest.approx(MARGIN)
    middle = exp(log(beyond @ before.T) / 2) @ before
    assert sequence.pole_distance(middle) < ROUNDING


def test_a_jog_ends_when_nobody_holds_the_button_with_one_zero_and_a_push_with_some():
    desk = Desk()
    assert desk.twist(0.0) is None
    desk.jog(PUSH, 1.0)
    assert_close(desk.twist(1.0 + 0.9 * HELD), PUSH, 0)
    assert_close(desk.twist(1.0 + HELD), np.zeros(6), 0)
    assert desk.twist(1.0 + HELD) is None
    desk.push(PUSH, 1.0, KEPT)
    assert_close(desk.wrench(KEPT), PUSH, 0)
    assert_close(desk.wrench(1.0 + KEPT), np.zeros(6), 0)
    assert desk.wrench(2.0 + KEPT) is None
    desk.jog(PUSH, 0.0)
    assert desk.twist(0.1) is not None
    desk.end_jog()  # as a goal follows it, without zeros
    assert desk.twist(0.1) is None


def test_what_a_page_asked_for_ends_when_it_is_closed_and_not_when_another_is():
    desk = Desk()
    assert desk.may(1, 0.0)
    desk.push(PUSH, 0.0, KEPT)
    desk.left(2, 1.0)
    assert_close(desk.wrench(1.0), PUSH, 0)
    desk.left(1, 2.0)
    assert_close(desk.wrench(2.0), np.zeros(6), 0)
    assert desk.may(2, 2.0)


def test_one_page_at_a_time_moves_the_arm():
    desk = Desk()
    assert desk.may(1, 0.0)
    assert not desk.may(2, 0.5)
    assert desk.may(1, 0.9)
    assert not desk.may(2, 1.8)
    assert desk.may(2, 2.0)
    assert desk.owner == 2
    desk.push(PUSH, 2.0, KEPT)
    assert not desk.may(1, 20.0)


def test_a_held_button_whose_values_change_asks_for_nothing_until_it_is_pressed_again():
    desk = Desk()
    along_x, along_y = (Order(1, Deed.JOG, (1.0, axis, 0.3, "base")) for axis in (0, 1))
    assert desk.holds(along_x, 0.0)
    assert desk.holds(along_x, 0.1)
    assert not desk.holds(along_y, 0.2)
    assert not desk.holds(along_y, 0.3)
    assert not desk.holds(along_x, 0.4)
    assert desk.holds(along_y, 1.5)
    assert desk.holds(Order(1, Deed.JOG, (-1.0, 0, -0.3, "base")), 1.6)  # the other button


def test_what_a_page_asked_for_before_it_was_closed_is_dropped_but_for_a_halt():
    desk = Desk()
    for deed in (Deed.LEFT, Deed.KEEP, Deed.HALT):
        desk.put(Order(1, deed))
    desk.put(Order(2, Deed.KEEP))
    taken = []
    for order in desk.taken():
        taken.append((order.page, order.deed))
        if order.deed is Deed.LEFT:
            desk.left(order.page, 0.0)
    assert taken == [(1, Deed.LEFT), (1, Deed.HALT), (2, Deed.KEEP)]


def test_an_order_is_not_obeyed_late_unless_it_ends_a_motion():
    in_time = [deed for deed in Deed if not Order(1, deed, at=0.0).is_late(2.0)]
    assert in_time == [Deed.HALT, Deed.LEFT, Deed.RELEASE]
    soon = [deed for deed in Deed if Order(1, deed, at=0.0).is_late(0.5)]
    assert soon == [Deed.JOG, Deed.PUSH]


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_pages_of_this_server_may_connect_and_no_others(host, monkeypatch):
    server = page.serve(host, 0)
    port = server.get_port()
    try:
        for origin in (f"http://localhost:{port}", f"http://{host}:{port}", None):
            connect(f"ws://127.0.0.1:{port}", origin=origin).close()
        for origin in ("http://example.com", f"http://example.com:{port}", "http://localhost:1"):
            with pytest.raises(InvalidStatus):
                connect(f"ws://127.0.0.1:{port}", origin=origin)
    finally:
        page.stop(server)
    monkeypatch.setattr(page, "websockets", SimpleNamespace(serve=None))
    with pytest.raises(ConfigurationError, match="guarded"):
        page.serve(host, 0)


def test_services_are_called_one_after_the_other_and_none_after_a_refusal(graph):
    names, called, refused, said = ("halt", "resume", "unlock"), [], set(), []
    node = graph.peer.node

    def serve(name):
        def answer(_request, response):
            called.append(name)
            response.success = name not in refused
            return response

        return node.create_service(Trigger, f"arm/{name}", answer)

    services = [serve(name) for name in names]
    owners = dict.fromkeys(names, "arm")
    exchange = Exchange(node, "arm", [], owners, *2 * [lambda *words: said.append(words)])
    clients = exchange._triggers.values()
    graph.until(lambda: all(client.service_is_ready() for client in clients), "the services")

    def ends(on, *called_now):
        exchange.call(*called_now or names)
        graph.until(lambda: exchange.hear(0.0) or not exchange._calls, f"an answer of {on}")
        taken = called[:]
        called.clear()
        return taken

    assert ends("unlock") == list(names)
    assert not said
    refused.add("resume")
    assert ends("resume") == ["halt", "resume"]
    assert [title for title, _ in said] == ["No resume"]
    exchange.call(*names)
    exchange.call("halt")  # by somebody else, before anything is answered
    assert ends("halt, called later", "halt") == ["halt"] * 3
    assert len(services) == 3


def test_a_jog_is_along_the_axes_chosen_and_a_pushed_moment_is_a_force_at_a_tenth_of_a_metre(world):
    def in_base(w):
        msg = WrenchStamped()
        msg.wrench.force, msg.wrench.torque = map(vector_to_ros, np.split(w, 2))
        return msg

    twists = world.peer.listen(TwistStamped, "target_twist")
    wrenches = world.peer.listen(WrenchStamped, "external_wrench")
    robot = SimpleNamespace(base_frame="base", tip_frame="tip")
    arm = SimpleNamespace(robot=robot, wrench_to_ros=in_base)
    exchange = SimpleNamespace(values={"max_linear_speed": 0.2, "max_angular_speed": 0.4})
    notices = SimpleNamespace(guarded=lambda _, act, *args: act(*args))
    pilot = Pilot(world.create_node("page"), exchange, arm, None, notices)

    def obey(deed, *value):
        pilot.desk.put(Order(1, deed, value, world.now))
        world.act(lambda: (pilot.turn(world.now), pilot.send(world.now)))

    for axes, frame in (("base", "base"), ("tool", "tip")):
        obey(Deed.JOG, 1.0, 0, 0.5, axes)
        assert (twists[-1].header.frame_id, twists[-1].twist.linear.x) == (frame, 0.1)
        obey(Deed.RELEASE)
        world.advance(2.0)  # another button: the one before is not held any more
    obey(Deed.PUSH, 1.0, 1, 20.0)
    assert wrenches[-1].wrench.force.y == 20.0
    obey(Deed.RELEASE)
    world.advance(2.0)
    obey(Deed.PUSH, 1.0, 4, 20.0)
    assert wrenches[-1].wrench.torque.y == pytest.approx(2.0)


def test_a_parameter_that_the_controller_refuses_is_shown_as_it_was(graph):
    def answer(request, response):
        response.results = [
            SetParametersResult(successful=each.name == "k", reason="too much")
            for each in request.parameters
        ]
        return response

    node, said = graph.peer.node, []
    service = node.create_service(SetParameters, "arm/set_parameters", answer)
    exchange = Exchange(node, "arm", [], {}, *2 * [lambda *words: said.append(words)])
    graph.until(exchange._set.service_is_ready, "the service")
    exchange.values = {"k": 1.0, "K": [1.0, 2.0]}
    exchange.want("k", 0, 3.0)
    exchange.want("K", 1, 9.0)
    exchange.turn(0.0)
    graph.until(lambda: exchange.hear(0.0) or not exchange._calls, "the answer")
    assert exchange.values == {"k": 3.0, "K": [1.0, 2.0]}
    assert said == [("The controller refuses this", "too much")]
    node.destroy_service(service)
