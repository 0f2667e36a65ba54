"""Nodes publish the numbers that analyze recomputes from the bag."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eulerparams_control.analysis.loading import load
from eulerparams_control.bags import Bag
from eulerparams_control.events import Event
from eulerparams_control.lab.experiments.controllers import CONTROLLERS
from eulerparams_control.lab.experiments.definition import Variant
from eulerparams_control.lab.experiments.runner import node_parameters, wait_for_end
from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import ns_from_ros

AGREES = 1e-9

SLOW = pytest.mark.slow

REFERENCE = {
    "motion": "way_points",
    "times": [0.1, 0.6],
    "positions": [0.485, 0.02, 0.375, 0.485, 0.05, 0.395],
    "orientation_format": "ZYZ",
    "orientations": [0.5, 0.9, 1.5, 0.7, 1.1, 1.3],
}
TURNED = (0.3, -0.2, 0.4)
"""The start [rad]: an error to be seen in each representation."""

PUSH = {"hand": {"shape": "push", "force": [3.0, -2.0, 4.0], "moment": [0.4, 0.8, -0.6],
                 "start": 0.2, "end": 5.0, "ramp": 0.1}}  # fmt: skip


def record(folder: Path, controller: str, **parameters: Any) -> Path:
    """Run a controller for a second in lock-step; return the bag, with its live numbers."""
    own = {"state_rate": 100.0, "shape_motion": False}  # the error is a step
    nodes = {controller: {**own, **parameters}, "reference": REFERENCE}
    if controller == "impedance_control":
        nodes["pybullet_bridge"] = {"environment": PUSH}
    run = Variant(nodes, 0.8, "ur5", controller, start_at_reference=True, start_turn=TURNED)
    given = node_parameters(run)
    known = CONTROLLERS[controller]
    topics = [*known.answers, "robot_description", "wrench", "joint_states", "reference"]
    live = [f"{controller}/{name}" for name in ("error", "lyapunov")]
    given["bag_recorder"] = {"output": str(folder / "bag"), "topics": [*topics, *live]}
    with Nodes(folder / "logs") as running:
        for name in ("bag_recorder", controller, "pybullet_bridge", "reference"):
            running.start(name, given[name])
        running.wait_for_event("bag_recorder", Event.READY, 60.0)
        wait_for_end(running, lambda _t: None)
        running.stop("reference", controller, "bag_recorder")
    return folder / "bag"


ANGLES = {"orientation": "euler_angles", "euler_sequence": "ZYZ", "k_Po": 10.0}


@pytest.mark.parametrize(
    ("controller", "parameters"),
    [
        ("impedance_control", {"orientation": "euler_parameters"}),
        pytest.param("impedance_control", {"orientation": "rotation_vector"}, marks=SLOW),
        pytest.param("dynamic_control", {"orientation": "euler_parameters"}, marks=SLOW),
        pytest.param("dynamic_control", {"orientation": "angle_axis"}, marks=SLOW),
        pytest.param("clik", {"orientation": "euler_parameters", "k_Po": 10.0}, marks=SLOW),
        pytest.param("clik", ANGLES, marks=SLOW),
    ],
)
def test_analyze_recomputes_what_the_node_published(tmp_path, controller, parameters):
    path = record(tmp_path, controller, **parameters)
    run, bag = load(path), Bag(path)
    stamps, live = published_errors(bag, f"/{controller}/error")
    _, at, among = np.intersect1d(run.leading.t[run.known], stamps, return_indices=True)
    assert len(at) > 30  # a busy machine loses some
    p_de = (run.leading.desired.p - run.leading.p_e)[run.known[at]]
    np.testing.assert_allclose(p_de, live[among, :3], rtol=0, atol=AGREES)
    error = run.error_in(str(parameters["orientation"]))[at]
    np.testing.assert_allclose(error, live[among, 3:], rtol=0, atol=AGREES)
    assert np.abs(live[:, 3:]).max() > 0.01  # there is an error to agree on

    topic = f"/{controller}/lyapunov"
    if parameters["orientation"] not in HAVE_V[controller]:
        assert run.lyapunov is None
        assert bag.topics[topic].count == 0
        return
    assert run.lyapunov is not None
    sent, V = zip(*((m.publish_time, m.message.data) for m in bag.messages([topic])), strict=True)
    errors = [m.publish_time for m in bag.messages([f"/{controller}/error"])]
    stamps = stamps[np.searchsorted(errors, sent) - 1]  # each is sent after the error of its tick
    V = np.array(V)
    _, at, among = np.intersect1d(run.lyapunov.t, stamps, return_indices=True)
    assert len(at) > 30
    found = np.column_stack([run.lyapunov.V, run.lyapunov.dV, run.lyapunov.dV_measured])[at]
    scale = np.abs(V).max(axis=0)
    assert (scale > 1e-3).all()
    np.testing.assert_allclose(found / scale, V[among] / scale, rtol=0, atol=AGREES)


HAVE_V = {
    "clik": ("euler_parameters",),
    "dynamic_control": ("euler_parameters",),
    "impedance_control": ("euler_parameters", "angle_axis", "rotation_vector"),
}


def published_errors(bag: Bag, topic: str) -> tuple[Array, Array]:
    """Return instants (N,) [s] and position and orientation errors (N, 6) of ~/error."""
    start = ns_from_ros(next(bag.messages(["/joint_states"])).message.header.stamp)
    messages = [message.message for message in bag.messages([topic])]
    stamps = np.array([ns_from_ros(message.header.stamp) - start for message in messages]) / 1e9
    parts = [(m.twist.linear, m.twist.angular) for m in messages]
    return stamps, np.array([[v.x, v.y, v.z, w.x, w.y, w.z] for v, w in parts])
