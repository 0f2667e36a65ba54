"""The input ``target_wrench``: the force that the tool is to exert ON the environment.

``impedance_control`` regulates it, along its force axes, and is held where it ends;
``compliance_control`` adds it to its springs, and takes it back.
"""

import math
from typing import Any, cast

import numpy as np

from eulerparams_control.control.clock import steady
from eulerparams_control.control.controller import Controller
from eulerparams_control.control.mode import Cause, Mode, Why
from eulerparams_control.errors import InvalidMessageError
from eulerparams_control.laws.compliance_control import ComplianceControl
from eulerparams_control.laws.impedance_control import ImpedanceControl
from eulerparams_control.laws.rotations import Array
from eulerparams_control.messages.from_ros import shown, wrench_from_ros
from eulerparams_control.ros.state_input import StateInput

# After a stop the stream has to pause for this time [s]: who sends it may not have noticed.
_PAUSE = 0.5

# A moment [Nm] that is none.
_NO_MOMENT = 1e-6

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
        self._force: Array | None = None  # (3,) [N] that was asked for last
        self._came, self._t = -math.inf, 0  # [s], [ns] of the state
        self._breaks = 0  # of the controller, when it came

    def take(self, controller: Controller, msg: Any) -> None:
        """Take a geometry_msgs/WrenchStamped, in the axes of the tip, or of the base.

        Raises InvalidMessageError or ConfigurationError if it cannot be exerted, or must not be.
        """
        assert self._states.measured is not None
        t, q, _ = self._states.measured
        since, self._came = steady.now() - self._came, steady.now()
        robot, breaks, frame = controller.scheme.robot, _breaks(controller), msg.header.frame_id
        w = wrench_from_ros(msg, frame)
        if frame not in (robot.tip_frame, robot.base_frame):
            raise InvalidMessageError(
                f"target_wrench is in the frame '{shown(frame)}'; expected '{robot.tip_frame}' or "
                f"'{robot.base_frame}'"
            )
        if np.abs(w[3:]).max() > _NO_MOMENT:
            raise InvalidMessageError(f"target_wrench is {w.tolist()}; expected no moment")
        f = w[:3] if frame == robot.tip_frame else robot.link_at(robot.tip_frame, q).R.T @ w[:3]
        force = _scheme(controller).exerted_force(f, controller.guidance.motion.last.R_d)
        if controller.mode not in _MAY_PRESS:
            raise InvalidMessageError(
                f"the arm is {controller.mode}: a force is exerted while it holds or follows; "
                "send a reference, or call ~/resume, first"
            )
        if self._force is not None and breaks != self._breaks and since < _PAUSE:
            raise InvalidMessageError(
                f"the arm was stopped meanwhile; send nothing for {_PAUSE} s, then again"
            )
        self._force, self._t, self._breaks = force, t, breaks

    def exert(self, controller: Controller | None, t: int, timeout: float) -> None:
        """Let the tool exert what counts for the state stamped t [ns]; else end that.

        A set-point counts for ``timeout`` [s], not after the arm was stopped, nor without control.
        """
        if controller is None or self._force is None:
            self._force = None
            return
        age = (t - self._t) / 1e9 if self._states.receipt is None else steady.now() - self._came
        may_press, scheme = controller.mode in _MAY_PRESS, _scheme(controller)
        if may_press and age <= timeout and self._breaks == _breaks(controller):
            scheme.press(self._force)
        elif scheme.end_force() and may_press:
            controller.settle(ENDED)


def _breaks(controller: Controller) -> int:
    """Return how often the arm was stopped, or started again."""
    return controller.stops + controller.resets


def _scheme(controller: Controller) -> ImpedanceControl | ComplianceControl:
    return cast("ImpedanceControl | ComplianceControl", controller.scheme)
