"""The input ``target_wrench``: the force that the tool is to exert ON the environment.

``impedance_control`` regulates it, along its force axes, and is held where it ends;
``compliance_control`` adds it to its springs, and takes it back.
"""

import math
from typing import Any

import numpy as np

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Cause, Mode, Why
from eulerparams_control.errors import ConfigurationError, InvalidMessageError
from eulerparams_control.laws.compliance_control import ComplianceControl
from eulerparams_control.laws.impedance_control import ImpedanceControl
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.scheme import Scheme
from eulerparams_control.messages.from_ros import shown, wrench_from_ros
from eulerparams_control.ros.state_input import StateInput

# After a stop the stream has to pause for this time [s]: who sends it may not have noticed.
_PAUSE = 0.5

# A moment [Nm] that is none, and the part of a force that may be across the force axes.
_NO_MOMENT, _ACROSS = 1e-6, 0.7072

_MAY_PRESS = (Mode.HOLDING, Mode.FOLLOWING)

ENDED = Why(
    Cause.STREAM_ENDED,
    note="the end of target_wrench",
    remedy="see to the node that sends it, unless that was meant; send it again to press",
)
AT_ITS_END = Why(
    Cause.FORCE_NOT_REACHED,
    note="the force is not reached within max_displacement_position of the desired frame",
    remedy="is there a surface? bring the desired frame nearer to it, or raise "
    "max_displacement_position",
)


class TargetWrench:
    """Takes set-points, and lets them be exerted for as long as they count.

    In simulated time that goes by the stamps of the states, else by the time of receipt.
    """

    def __init__(self, states: StateInput) -> None:
        self._states = states
        self.forget()

    def forget(self) -> None:
        """Forget what came before."""
        self._force: Array | None = None  # (3,) [N] that was asked for last
        self._came, self._t = -math.inf, 0  # [s], [ns] of the state
        self._breaks = 0  # of the controller, when it came

    def take(self, controller: Controller, msg: Any) -> None:
        """Take a geometry_msgs/WrenchStamped, in the axes of the tip, or of the base.

        Raises:
            InvalidMessageError: if it cannot be exerted, or must not be now.
        """
        state = self._states.measured
        since, self._came = steady.now() - self._came, steady.now()
        if state is None:
            raise InvalidMessageError("no valid joint_states yet")
        scheme, breaks = controller.scheme, _breaks(controller)
        force = _force(msg, scheme, state[1], controller.guidance.motion.last.R_d)
        if controller.mode not in _MAY_PRESS:
            raise InvalidMessageError(
                f"the arm is {controller.mode}: a force is exerted while it holds or follows; "
                "send a reference, or call ~/resume, first"
            )
        if self._force is not None and breaks != self._breaks and since < _PAUSE:
            raise InvalidMessageError(
                f"the arm was stopped meanwhile; send nothing for {_PAUSE} s, then again"
            )
        self._force, self._t, self._breaks = force, state[0], breaks

    def exert(self, controller: Controller, t: int, timeout: float) -> None:
        """Let the tool exert what counts for the state stamped t [ns]; else end that.

        A set-point counts for ``timeout`` [s], and not after the arm was stopped.
        """
        scheme = controller.scheme
        if self._force is None:
            return
        assert isinstance(scheme, ImpedanceControl | ComplianceControl)
        age = (t - self._t) / 1e9 if self._states.receipt is None else steady.now() - self._came
        may_press = controller.mode in _MAY_PRESS
        if may_press and age <= timeout and self._breaks == _breaks(controller):
            scheme.press(self._force)
        elif isinstance(scheme, ComplianceControl):
            scheme.press(np.zeros(3))
        elif may_press and scheme.force.is_on:
            controller.settle(ENDED)


def _breaks(controller: Controller) -> int:
    """Return how often the arm was stopped, or started again."""
    return controller.stops + controller.resets


def _force(msg: Any, scheme: Scheme, q: Array, R_d: Array) -> Array:
    """Return the force (3,) [N] of a message along the axes of the compliance, or of the tip."""
    frame, robot = msg.header.frame_id, scheme.robot
    w = wrench_from_ros(msg, frame)
    if frame not in (robot.tip_frame, robot.base_frame):
        raise InvalidMessageError(
            f"target_wrench is in the frame '{shown(frame)}'; expected '{robot.tip_frame}' or "
            f"'{robot.base_frame}'"
        )
    if np.abs(w[3:]).max() > _NO_MOMENT:
        raise InvalidMessageError(
            f"target_wrench is {w.tolist()} in '{shown(frame)}'; expected no moment"
        )
    f = w[:3]
    if frame == robot.base_frame:
        f = robot.state(q, np.zeros_like(q)).R_e.T @ f
    if isinstance(scheme, ImpedanceControl):
        return _regulated(scheme, scheme.centre.R.T @ f)
    assert isinstance(scheme, ComplianceControl)
    try:
        scheme.elasticity.refuse_force(R_d @ f, R_d)
    except ConfigurationError as error:
        raise InvalidMessageError(str(error)) from error
    return f


def _regulated(scheme: ImpedanceControl, f: Array) -> Array:
    """Return a force (3,) [N] along the axes of the compliance, of which some are force axes."""
    parameters, on = scheme.parameters, scheme.force.selection
    size = float(np.linalg.norm(f))
    if not parameters.inner_loop:
        raise InvalidMessageError("target_wrench needs the motion loop: set inner_loop: true")
    if np.linalg.norm((1.0 - on) * f) > _ACROSS * size:
        raise InvalidMessageError(
            f"target_wrench is {f.tolist()} N along x, y, z of the compliance; expected a force "
            f"along force_axes {list(parameters.force_axes)}"
        )
    most = parameters.max_contact_force
    if size > most:
        raise InvalidMessageError(
            f"target_wrench is {size:.3g} N; at most max_contact_force {most:g} N"
        )
    exerted: Array = on * f
    return exerted
