"""The Lyapunov function of a recorded controller, from its parameters and its motion.

V_1 of (30) belongs to kinematic control, V_2 of (42) to dynamic control, V_3 of (68) to the
impedance.  The displacement x_de is that of the controller: each follows from its predecessor.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import ImpedanceRun
from eulerparams_control.analysis.controllers import (
    IMPEDANCE_NODE,
    impedance_node,
    node_of,
    rotational_impedance,
)
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.orientation import OrientationRepresentation
from eulerparams_control.laws.orientation.base import Lyapunov
from eulerparams_control.laws.rotations import Array


class ControlledRun(Protocol):
    """What V needs of a run; a Recording has it."""

    @property
    def parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Of the recorded nodes, by node and name."""

    @property
    def leading(self) -> Series:
        """What the controller answers for."""

    @property
    def known(self) -> NDArray[np.intp]:
        """Places of the leading series at which there is a desired frame."""

    @property
    def impedance(self) -> ImpedanceRun | None:
        """What the impedance equations relate."""

    def orientation(self, name: str) -> OrientationRepresentation:
        """Return a representation with the options of the controller."""

    def displacements(self, name: str) -> Any:
        """Return x_de in a representation at the instants ``known``."""


class LyapunovSeries(NamedTuple):
    """A Lyapunov function at the M instants with a desired frame.

    Attributes:
        t: (M,) [s] from the beginning of the recording.
        V: (M,) its value; not finite where the run left all numbers.
        dV: (M,) [1/s] its derivative by the paper, (31), (43) or (69), the latter with the power
            of the contact moment.
        dV_measured: (M,) [1/s] by differences of V from the sample before; NaN at the first.
    """

    t: Array
    V: Array
    dV: Array
    dV_measured: Array


type _Function = Callable[[OrientationRepresentation, Any, Array, Mapping[str, Any]], Any]


def _V_1(
    orientation: OrientationRepresentation, x_de: Any, _omega_de: Array, node: Mapping[str, Any]
) -> Lyapunov | None:
    return orientation.lyapunov_1(x_de, float(node["k_Po"]))  # eqs. (30), (31)


def _V_2(
    orientation: OrientationRepresentation, x_de: Any, omega_de: Array, node: Mapping[str, Any]
) -> Lyapunov | None:
    k_Po, k_Vo = float(node["k_Po"]), float(node["k_Vo"])
    return orientation.lyapunov_2(x_de, omega_de, k_Po, k_Vo)  # eqs. (42), (43)


_FUNCTIONS: dict[str, _Function] = {"clik": _V_1, "dynamic_control": _V_2}


def lyapunov_series(recording: ControlledRun) -> LyapunovSeries:
    """Return V of the controller that ran, along the motion that it answers for.

    Args:
        recording: the run.

    Raises:
        BagError: if there is no V; says why.
    """
    node = impedance_node(recording.parameters)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            if node is not None:
                t, (V, dV) = _of_impedance(recording, node)
            else:
                t, (V, dV) = _along(recording)
    except (KeyError, TypeError, ValueError, ConfigurationError) as error:
        raise BagError(f"the parameters of the controller do not give V: {error}") from error
    with np.errstate(over="ignore", invalid="ignore"):
        measured = np.diff(V, prepend=np.nan) / np.diff(t, prepend=np.nan)
        return LyapunovSeries(t, np.asarray(V), np.asarray(dV), measured)


def _along(recording: ControlledRun) -> tuple[Array, Lyapunov]:
    """Return the instants at which there is a desired frame, and V_1 or V_2 there."""
    found = node_of(recording.parameters, *_FUNCTIONS)
    if found is None:
        names = f"{', '.join(_FUNCTIONS)} or {IMPEDANCE_NODE}"
        raise BagError(f"no parameters of a node {names} were recorded")
    name, node = found
    series, known = recording.leading, recording.known
    _require_two(series.t[known])
    orientation = recording.orientation(str(node.get("orientation")))
    x_de = recording.displacements(orientation.name)
    omega_de = series.desired.omega[known] - series.omega_e[known]
    value = _FUNCTIONS[name](orientation, x_de, omega_de, node)
    return series.t[known], _known(value, orientation)


def _of_impedance(
    recording: ControlledRun, node: Mapping[str, Any]
) -> tuple[Array, Lyapunov]:
    """Return the instants at which there is a desired frame, and V_3 there, eqs. (68), (69)."""
    impedance = recording.impedance
    if impedance is None:
        raise BagError("no compliant_frame was recorded")
    motion, known = impedance.motion, impedance.motion.desired.known
    _require_two(motion.t[known])
    orientation = recording.orientation(str(node.get("orientation")))
    Z, mu_d = rotational_impedance(node), impedance.mu_d[known]
    value = orientation.lyapunov_3(motion.R_cd[known], motion.x[known], Z, mu_d)
    return motion.t[known], _known(value, orientation)


def _require_two(t: Array) -> None:
    if len(t) < 2:
        raise BagError("no desired frame was recorded for the length of two samples")


def _known(value: Lyapunov | None, orientation: OrientationRepresentation) -> Lyapunov:
    if value is None:
        raise BagError(f"the paper has no Lyapunov function for {orientation.name}")
    return value
