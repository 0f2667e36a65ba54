"""A recorded run as arrays: from a bag to what was measured, commanded and desired.

    recording = load("out/demo/euler_parameters")             # of ``loading``
    recording.leading.orientation_error     # (N,) [rad]

Needs no ROS.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import CompliantMotion, ImpedanceRun, impedance_run
from eulerparams_control.analysis.controllers import options_of
from eulerparams_control.analysis.frames import Frames
from eulerparams_control.analysis.lyapunov import LyapunovSeries, lyapunov_series
from eulerparams_control.analysis.reports import Report
from eulerparams_control.analysis.series import Efforts, Series, comparable
from eulerparams_control.analysis.shaping import ShapedMotion
from eulerparams_control.analysis.wrenches import SensorSeries, Wrenches, at_the_tip
from eulerparams_control.bags.format import BagWarning, in_words
from eulerparams_control.errors import BagError
from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    representation,
)
from eulerparams_control.laws.rotations import Array
from eulerparams_control.robot.robot import Robot


@dataclass(frozen=True)
class Recording:
    """One run: what was measured, what was commanded, and how it was set up.

    Attributes:
        path: of the bag.
        robot: the arm.
        measured: from joint_states.
        command: from joint_reference; None if there is none.
        effort: from joint_effort; None if there is none.
        parameters: of the recorded nodes, by node and name.
        warnings: what is wrong with the bag.
        diverged: [s] when the simulation ended because its state became non-finite, or its
            controller gave up; None if it did not.
        sensed: from wrench; None if there is none.
        compliant: from compliant_frame; None if there is none.
        urdf: text of the robot's description.
        namespace: of its topics; "" if they have none.
        before: displacements, by representation, before the first instant of a later part of a run.
        options: of the representation; None: as the parameters say.
        began: [ns] stamp of the first joint_states of the recording.
        reports: what its nodes said of themselves.
        shaped: from ~/desired; None if there is none.
    """

    path: Path
    robot: Robot
    measured: Series
    command: Series | None
    effort: Efforts | None
    parameters: dict[str, dict[str, Any]]
    warnings: tuple[BagWarning, ...]
    diverged: float | None = None
    sensed: SensorSeries | None = None
    compliant: CompliantMotion | None = None
    urdf: str = field(default="", repr=False)
    namespace: str = ""

    before: Mapping[str, Any] = field(default_factory=dict, repr=False)
    options: OrientationOptions | None = None
    began: int = 0
    reports: Sequence[Report] = ()
    shaped: ShapedMotion | None = None

    @property
    def warning(self) -> str:
        """What is wrong with the bag, in words; "" if nothing."""
        return in_words(self.warnings)

    @property
    def name(self) -> str:
        """The name of the bag's folder, with the namespace of the arm if it has one."""
        return self.path.resolve().name + self.namespace

    @cached_property
    def servo_lag(self) -> tuple[Array, Array]:
        """Times (M,) [s], largest angle (M,) [rad] of a joint between command and measurement.

        Of the joints that turn; of the others [m] if none does.

        At the stamps that both have; empty without a command.
        """
        if self.command is None:
            return np.zeros(0), np.zeros(0)
        t, i, j = np.intersect1d(self.command.t, self.measured.t, return_indices=True)
        joints = comparable(self.robot)
        lag = np.abs(self.command.q[i] - self.measured.q[j])[:, joints]
        return t, lag.max(axis=1, initial=0.0)

    @property
    def leading(self) -> Series:
        """The motion that the controller answers for: joint_reference, else the measured one."""
        return self.command or self.measured

    @cached_property
    def wrench(self) -> Wrenches | None:
        """The contact wrench at the tip; None where ``why_no_wrench`` says."""
        return None if isinstance(self._wrench, str) else self._wrench

    @property
    def why_no_wrench(self) -> str:
        """Why there is no ``wrench``; "" if there is."""
        return self._wrench if isinstance(self._wrench, str) else ""

    @cached_property
    def _wrench(self) -> Wrenches | str:
        if self.sensed is None:
            return "no wrench was recorded"
        try:
            return at_the_tip(self.sensed, self.measured, self.parameters)
        except BagError as error:
            return str(error)

    @property
    def contact(self) -> Wrenches | None:
        """The wrench, where anything was felt or an impedance answers it; else None."""
        wrench = self.wrench
        if wrench is None or (self.compliant is None and not wrench.is_felt):
            return None
        return wrench

    @cached_property
    def impedance(self) -> ImpedanceRun | None:
        """Motion and wrench of the impedance equations; None without a compliant frame."""
        if self.compliant is None:
            return None
        return impedance_run(self.compliant, self.wrench, self.measured, self.parameters)

    def compliant_frames(self, series: Series) -> Frames:
        """Return the compliant frame at each instant of a series, none where there is none."""
        if self.compliant is None:
            return Frames.nowhere(len(series.t))
        return self.compliant.at(series.t)

    @cached_property
    def known(self) -> NDArray[np.intp]:
        """(M,) places of the leading series at which there is a desired frame."""
        return np.flatnonzero(self.leading.desired.known)

    def orientation(self, name: str) -> OrientationRepresentation:
        """Return a representation with the options that the controller was told."""
        return representation(name, self.options or options_of(self.parameters))

    def displacements(self, name: str) -> Any:
        """Return x_de in a representation at the M instants ``known``, its fields stacked.

        ``displacements(name).error`` is the orientation error (M, 3) in its terms.
        """
        if name not in self._displacements:
            leading, known = self.leading, self.known
            R_d, R_e = leading.desired.R[known], leading.R_e[known]
            orientation = self.orientation(name)
            with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
                x_de = orientation.displacement(R_d, R_e, self.before.get(name))
            self._displacements[name] = x_de
        return self._displacements[name]

    @cached_property
    def _displacements(self) -> dict[str, Any]:
        return {}

    @cached_property
    def lyapunov(self) -> LyapunovSeries | None:
        """V of the controller that ran, (30), (42) or (68); None where ``why_no_lyapunov`` says."""
        return None if isinstance(self._lyapunov, str) else self._lyapunov

    @property
    def why_no_lyapunov(self) -> str:
        """Why there is no ``lyapunov``; "" if there is."""
        return self._lyapunov if isinstance(self._lyapunov, str) else ""

    @cached_property
    def _lyapunov(self) -> LyapunovSeries | str:
        try:
            return lyapunov_series(self)
        except BagError as error:
            return str(error)

    @property
    def sequence(self) -> EulerSequence:
        """The sequence of Euler angles of its parameters; XYZ if they name none."""
        return (self.options or options_of(self.parameters)).sequence

    @cached_property
    def pole_distance(self) -> Array:
        """(N,) [rad] angle to the pole of ``sequence``, of the leading series."""
        return self.leading.pole_distance(self.sequence)

    def parameter(self, name: str, default: Any = None) -> Any:
        """Return the parameter of that name of the first node that has it."""
        for values in self.parameters.values():
            if name in values:
                return values[name]
        return default
