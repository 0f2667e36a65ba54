"""The Lyapunov function of a recorded controller, from its parameters and its motion.

V_1 of (30) belongs to kinematic control, V_2 of (42) to dynamic control, V_3 of (68) to the
impedance.  The displacement x_de is that of the controller: each follows from its predecessor.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import ImpedanceRun
from eulerparams_control.analysis.controllers import parameters_to_blame, recorded
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.orientation.base import Lyapunov
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.parameters.schemes import schemes


class ControlledRun(Protocol):
    """Inputs of V; a Recording has them."""

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Of the recorded nodes, by node and name."""

    @property
    def leading(self) -> Series:
        """The motion that the controller answers for."""

    @property
    def known(self) -> NDArray[np.intp]:
        """Places of the leading series at which there is a desired frame."""

    @property
    def impedance(self) -> ImpedanceRun | None:
        """Motion and wrench of the impedance equations; None without a compliant frame."""

    def orientation(self, name: str) -> OrientationRepresentation:
        """Return a representation with the options of the controller."""

    def displacements(self, name: str) -> Any:
        """Return x_de in a representation at the instants ``known``."""


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


def lyapunov_series(recording: ControlledRun) -> LyapunovSeries:
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


def _along(recording: ControlledRun, told: Any) -> tuple[Array, Lyapunov | None]:
    """Return the instants at which there is a desired frame, and V of the law there."""
    series, known = recording.leading, recording.known
    _require_two(series.t[known])
    x_de = recording.displacements(told.orientation)
    omega_de = series.desired.omega[known] - series.omega_e[known]
    return series.t[known], told.law().lyapunov(x_de, omega_de)


def _of_impedance(
    recording: ControlledRun, told: ImpedanceParameters
) -> tuple[Array, Lyapunov | None]:
    """Return the instants at which there is a desired frame, and V_3 there, eqs. (68), (69)."""
    impedance = recording.impedance
    if impedance is None:
        raise BagError("no compliant_frame was recorded")
    motion, known = impedance.motion, impedance.motion.desired.known
    _require_two(motion.t[known])
    orientation = recording.orientation(told.orientation)
    R_cd, x, mu_d = motion.R_cd[known], motion.x[known], impedance.mu_d[known]
    return motion.t[known], orientation.lyapunov_3(R_cd, x, told.rotation(), mu_d)


def _require_two(t: Array) -> None:
    if len(t) < 2:
        raise BagError("no desired frame was recorded for the length of two samples")
