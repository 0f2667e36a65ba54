"""A recorded run as arrays: from a bag to what was measured, commanded and desired.

    recording = load("out/demo/euler_parameters")             # of ``loading``
    recording.leading.orientation_error     # (N,) [rad]

Needs no ROS.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import (
    ActingImpedance,
    CompliantMotion,
    ImpedanceRun,
    PressedForce,
    SensorSeries,
    Wrenches,
    impedances,
    in_axes,
    shifted,
)
from eulerparams_control.analysis.controllers import options_of, parameters_to_blame, recorded
from eulerparams_control.analysis.reports import Report
from eulerparams_control.analysis.series import Efforts, Series, ShapedMotion
from eulerparams_control.analysis.stacks import displacements, errors, over, quaternions
from eulerparams_control.bags.format import BagWarning, in_words
from eulerparams_control.errors import BagError, RobotError
from eulerparams_control.laws.orientation import (
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    representation,
)
from eulerparams_control.laws.orientation.base import Lyapunov
from eulerparams_control.laws.orientation.euler_parameters import EulerParametersRepresentation
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.clik import ClikParameters
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.efforts import ResolvedParameters
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.robot.robot import Robot


class LyapunovSeries(NamedTuple):
    """A Lyapunov function at the M instants with a desired frame.

    Attributes:
        t: (M,) [s] from the beginning of the recording.
        V: (M,) its value; not finite where the run diverged.
        dV: (M,) [1/s] its derivative by the paper, (31), (43) or (69), the latter with the power
            of the contact moment.
        dV_measured: (M,) [1/s] by differences of V from the sample before; NaN at the first.
    """

    t: Array
    V: Array
    dV: Array
    dV_measured: Array


@dataclass(frozen=True)
class RecordedRun:
    """A run, whatever is kept of its samples.

    Attributes:
        path: of the bag.
        robot: the arm.
        parameters: of the recorded nodes, by node and name.
        warnings: what is wrong with the bag.
        diverged: [s] when the simulation ended because its state became non-finite, or its
            controller gave up; None if it did not.
        urdf: text of the robot's description.
        namespace: of its topics; "" if they have none.
        options: of the representation; None: as the parameters say.
    """

    path: Path
    robot: Robot = field(repr=False)
    parameters: Mapping[str, Mapping[str, Any]] = field(repr=False)
    warnings: tuple[BagWarning, ...]
    diverged: float | None = field(default=None, kw_only=True)
    urdf: str = field(default="", repr=False, kw_only=True)
    namespace: str = field(default="", kw_only=True)
    options: OrientationOptions | None = field(default=None, kw_only=True)

    @property
    def warning(self) -> str:
        """The warnings in one line; "" if there are none."""
        return in_words(self.warnings)

    @property
    def name(self) -> str:
        """The name of the bag's folder, with the namespace of the arm if it has one."""
        return self.path.resolve().name + self.namespace

    @property
    def sequence(self) -> EulerSequence:
        """The sequence of Euler angles of its parameters; XYZ if they name none."""
        return (self.options or options_of(self.parameters)).sequence


@dataclass(frozen=True)
class Recording(RecordedRun):
    """One run: what was measured, what was commanded, and how it was set up.

    Attributes:
        measured: from joint_states.
        command: from joint_reference; None if there is none.
        effort: from joint_effort; None if there is none.
        sensed: from wrench; None if there is none.
        compliant: from compliant_frame; None if there is none.
        targets: from target_wrench; None if there is none.
        acting: from ~/impedance; None if there is none.
        before: displacements, by representation, before the first instant that is looked at.
        began: [ns] stamp of the first joint_states of the recording.
        reports: of its nodes.
        stopped: [s] when they stopped the arm, first, as they reported; inf if they did not.
        shaped: from ~/desired; None if there is none.
    """

    measured: Series
    command: Series | None = None
    effort: Efforts | None = None
    sensed: SensorSeries | None = None
    compliant: CompliantMotion | None = None
    targets: SensorSeries | None = None
    acting: ActingImpedance | None = None
    before: Mapping[str, Any] = field(default_factory=dict, repr=False)
    began: int = 0
    reports: Sequence[Report] = ()
    stopped: float = math.inf
    shaped: ShapedMotion | None = None

    @property
    def leading(self) -> Series:
        """The motion that the controller answers for: joint_reference, else the measured one."""
        return self.command or self.measured

    @cached_property
    def wrench(self) -> Wrenches | None:
        """The contact wrench at the tip; None if unknown, see ``why_no_wrench``."""
        return None if isinstance(self._wrench, str) else self._wrench

    @property
    def why_no_wrench(self) -> str:
        """Why there is no ``wrench``; "" if there is."""
        return self._wrench if isinstance(self._wrench, str) else ""

    @cached_property
    def _wrench(self) -> Wrenches | str:
        try:
            return self._at_the_tip()
        except BagError as error:
            return str(error)

    def _at_the_tip(self) -> Wrenches:
        """Return the contact wrench at the tip from the measurements of the sensor.

        Without the weight of the tool and the bias that the node impedance_control was told.  Dead
        bands, the low-pass and a tare, which concern its law, are left out.

        Raises:
            BagError: if the parameters are impossible, or a frame is not fixed to the tip.
        """
        sensed, robot, told = self.sensed, self.robot, self._told
        if sensed is None:
            raise BagError("no wrench was recorded")
        with parameters_to_blame(told.scheme.name):
            bias, tool = told.sensor()
        w = told.wrench_sign * sensed.w - bias
        f_t, mu_t = np.empty((2, len(w), 3))
        for name in dict.fromkeys(sensed.frames.tolist()):
            here = sensed.frames == name
            try:
                f_t[here], mu_t[here] = shifted(w[here], robot.placement(name))
            except RobotError as error:
                raise BagError(f"the wrench cannot be moved to the tip: {error}") from error
        R_e = self.measured.R_e[self.measured.before(sensed.t)]
        if tool is not None and told.compensate_tool_weight:
            weight = tool.mass * (robot.gravity @ R_e)
            f_t, mu_t = f_t - weight, mu_t - np.cross(tool.com, weight)
        f, mu = (np.einsum("nij,nj->ni", R_e, v) for v in (f_t, mu_t))
        return Wrenches(sensed.t, f, mu)

    @cached_property
    def _told(self) -> ImpedanceParameters:
        """Parameters of its impedance; the defaults if there is none."""
        return recorded(self.parameters, ImpedanceParameters) or ImpedanceParameters()

    @property
    def contact(self) -> Wrenches | None:
        """The wrench, where anything was felt or an impedance answers it; else None."""
        wrench = self.wrench
        if wrench is None or (self.compliant is None and not wrench.is_felt):
            return None
        return wrench

    @cached_property
    def impedance(self) -> ImpedanceRun | None:
        """Motion and wrench at the centre of compliance; None without a compliant frame."""
        if self.compliant is None:
            return None
        with parameters_to_blame(self._told.scheme.name):
            centre = self._told.centre(self.robot)
        motion = self.compliant.carrying(centre)
        if self.wrench is None:
            return ImpedanceRun(motion, *np.zeros((2, len(motion.t), 3)))
        f, mu = self.wrench.at(motion.t)
        r = self.measured.R_e[self.measured.before(motion.t)] @ centre.p
        return ImpedanceRun(motion, f, mu - np.cross(r, f))

    @cached_property
    def pressed(self) -> PressedForce | None:
        """The force that the tool exerts, and the last target that still counts.

        None unless both were recorded.
        """
        targets, wrench, measured = self.targets, self.wrench, self.measured
        if targets is None or wrench is None:
            return None
        told = self._told
        with parameters_to_blame(told.scheme.name):
            centre, on = told.centre(self.robot), told.force_selection()
        R = measured.R_e[measured.before(wrench.t)] @ centre.R
        last = np.searchsorted(targets.t, wrench.t, side="right") - 1
        counts = (last >= 0) & (wrench.t - targets.t[last] <= told.target_timeout)
        asked, in_base = targets.w[last, :3], targets.frames[last] != self.robot.tip_frame
        f_d = np.where(in_base[:, None], in_axes(R, asked), asked @ centre.R)
        f_d[~counts] = np.nan
        return PressedForce(wrench.t, -on * in_axes(R, wrench.f), on * f_d, R, on)

    @cached_property
    def known(self) -> NDArray[np.intp]:
        """(M,) places of the leading series at which there is a desired frame."""
        return np.flatnonzero(self.leading.desired.known)

    def orientation(self, name: str) -> OrientationRepresentation:
        """Return a representation with the options that the controller was told."""
        return representation(name, self.options or options_of(self.parameters))

    def error_in(self, name: str) -> Array:
        """Return the orientation error (M, 3) in a representation at the instants ``known``."""
        R_d, R_e = self.known_rotations
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            return errors(self.orientation(name), R_d, R_e, self._Q_de, self.before.get(name))

    @cached_property
    def _Q_de(self) -> Array:
        """(M, 4) eta_de, eps_de_e with the signs of the controller."""
        name = EulerParametersRepresentation.name
        law, before = self.orientation(name), self.before.get(name)
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            return quaternions(x.Q_de for x in displacements(law, *self.known_rotations, before))

    @property
    def known_rotations(self) -> tuple[Array, Array]:
        """R_d, R_e (M, 3, 3) at the instants ``known``."""
        return self.leading.desired.R[self.known], self.leading.R_e[self.known]

    @cached_property
    def lyapunov(self) -> LyapunovSeries | None:
        """V of the controller that ran, (30), (42) or (68); None: see ``why_no_lyapunov``."""
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

    @cached_property
    def pole_distance(self) -> Array:
        """(N,) [rad] angle to the pole of ``sequence``, of the leading series."""
        return over(self.sequence.pole_distance, self.leading.R_e)

    def parameter(self, name: str, default: Any = None) -> Any:
        """Return the parameter of that name of the first node that has it."""
        for values in self.parameters.values():
            if name in values:
                return values[name]
        return default


def lyapunov_series(recording: Recording) -> LyapunovSeries:
    """Return V of the controller that ran, along the motion that it answers for.

    Args:
        recording: the run.

    Raises:
        BagError: if there is no V; says why.
    """
    impedance = recorded(recording.parameters, ImpedanceParameters)
    told = impedance or recorded(recording.parameters, ControlParameters, ("k_Po", "k_Vo"))
    if told is None:
        *names, last = schemes()
        raise BagError(f"no parameters of a node {', '.join(names)} or {last} were recorded")
    with (
        parameters_to_blame(told.scheme.name),
        np.errstate(over="ignore", invalid="ignore"),  # a run that diverged
    ):
        if impedance is not None:
            t, value = _of_impedance(recording, impedance)
        else:
            t, value = _along(recording, told)
        if value is None:
            raise BagError(f"the paper has no Lyapunov function for {told.orientation}")
        V, dV = value
        measured = np.diff(V, prepend=np.nan) / np.diff(t, prepend=np.nan)
    return LyapunovSeries(t, np.asarray(V), np.asarray(dV), measured)


def _along(recording: Recording, told: ControlParameters) -> tuple[Array, Lyapunov | None]:
    """Return the instants at which there is a desired frame, and V of the law there."""
    series, known = recording.leading, recording.known
    _require_two(series.t[known])
    law = recording.orientation(told.orientation)
    x_de = displacements(law, *recording.known_rotations, recording.before.get(law.name))
    omega_de = series.desired.omega[known] - series.omega_e[known]
    match told:
        case ClikParameters():
            V = [law.lyapunov_1(x, told.k_Po) for x in x_de]
        case ResolvedParameters():
            along = zip(x_de, omega_de, strict=True)
            V = [law.lyapunov_2(x, omega, told.k_Po, told.k_Vo) for x, omega in along]
        case _:
            text = f"V of {told.scheme.name} is on its topic lyapunov alone: it needs the inertia"
            raise BagError(text)
    return series.t[known], _stacked(V)


def _of_impedance(recording: Recording, told: ImpedanceParameters) -> tuple[Array, Lyapunov | None]:
    """Return the instants at which there is a desired frame, and V_3 there, eqs. (68), (69)."""
    impedance = recording.impedance
    if impedance is None:
        raise BagError("no compliant_frame was recorded")
    motion, known = impedance.motion, impedance.motion.desired.known
    _require_two(motion.t[known])
    orientation = recording.orientation(told.orientation)
    R_cd, x, mu_d = motion.R_cd[known], motion.x[known], impedance.mu_d[known]
    _, Z = impedances(motion.t[known], told, recording.acting)
    numbers = np.hstack([matrix.reshape(-1, 9) for matrix in Z])
    _, first, which = np.unique(numbers, axis=0, return_index=True, return_inverse=True)
    stages = [Z.at(place) for place in first.tolist()]
    acting = [stages[stage] for stage in which.ravel().tolist()]
    return motion.t[known], _stacked(map(orientation.lyapunov_3, R_cd, x, acting, mu_d))


def _stacked(values: Iterable[Lyapunov | None]) -> Lyapunov | None:
    """Return V and dV (N,); None where there is no Lyapunov function."""
    found = [value for value in values if value is not None]
    return Lyapunov(*np.array(found).T) if found else None


def _require_two(t: Array) -> None:
    if len(t) < 2:
        raise BagError("no desired frame was recorded for the length of two samples")
