"""The Lyapunov function of a recorded controller, from its parameters and its motion.

V_1 of (30) belongs to kinematic control, V_2 of (42) to dynamic control, V_3 of (68) to the
impedance.  The displacement x_de is that of the controller: each follows from its predecessor.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from eulerparams_control.analysis.impedance_run import ImpedanceRun
from eulerparams_control.analysis.impedances import (
    IMPEDANCE_NODE,
    impedance_node,
    rotational_impedance,
)
from eulerparams_control.analysis.series import Series
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.orientation import (
    EulerSequence,
    OrientationOptions,
    OrientationRepresentation,
    SignRule,
    representation,
)
from eulerparams_control.orientation.base import Lyapunov
from eulerparams_control.rotations import Array


class LyapunovSeries(NamedTuple):
    """A Lyapunov function at the M instants with a desired frame.

    Attributes:
        t: (M,) [s] from the beginning of the recording.
        V: (M,) its value; not finite where the run left all numbers.
        dV: (M,) [1/s] its derivative by the paper, (31), (43) or (69), the latter with the power
            of the contact moment.
        dV_measured: (M,) [1/s] its derivative by differences of V.
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


def lyapunov_series(
    series: Series,
    parameters: Mapping[str, Mapping[str, Any]],
    impedance: ImpedanceRun | None = None,
) -> LyapunovSeries:
    """Return V of the controller that ran, along the motion that it answers for.

    Args:
        series: the motion.
        parameters: of the recorded nodes, by node and name.
        impedance: what it relates; None if there is none.

    Raises:
        BagError: if there is no V; says why.
    """
    node = impedance_node(parameters)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # a run that diverged
            if node is not None:
                rows = list(_impedance_rows(impedance, node))
            else:
                function, node = _controller(parameters)
                rows = list(_rows(series, function, _orientation(node), node))
    except (KeyError, TypeError, ValueError, ConfigurationError) as error:
        raise BagError(f"the parameters of the controller do not give V: {error}") from error
    if len(rows) < 2:
        raise BagError("no desired frame was recorded for the length of two samples")
    t, V, dV = np.array(rows).T
    with np.errstate(over="ignore", invalid="ignore"):
        return LyapunovSeries(t, V, dV, np.gradient(V, t))


def _controller(
    parameters: Mapping[str, Mapping[str, Any]],
) -> tuple[_Function, Mapping[str, Any]]:
    for name, node in parameters.items():
        function = _FUNCTIONS.get(name.rsplit("/", 1)[-1])
        if function is not None:
            return function, node
    names = f"{', '.join(_FUNCTIONS)} or {IMPEDANCE_NODE}"
    raise BagError(f"no parameters of a node {names} were recorded")


def _orientation(node: Mapping[str, Any]) -> OrientationRepresentation:
    options = OrientationOptions(_sequence(node), _sign(node))
    return representation(str(node.get("orientation")), options)


def _sequence(node: Mapping[str, Any]) -> EulerSequence:
    return EulerSequence(str(node.get("euler_sequence", "XYZ")))


def _sign(node: Mapping[str, Any]) -> SignRule:
    """Return the rule for the sign of the quaternion; what is not stated has its default."""
    rule = SignRule()
    return SignRule(
        str(node.get("quaternion_sign", rule.name)),
        float(node.get("hysteresis", rule.delta)),
        int(node.get("quaternion_initial_sign", rule.initial)),
    )


def _rows(
    series: Series,
    function: _Function,
    orientation: OrientationRepresentation,
    node: Mapping[str, Any],
) -> Iterator[tuple[float, float, float]]:
    """Yield t, V, dV where there is a desired frame."""
    x_de: Any = None
    samples = zip(series.t, series.desired, series.R_e, series.omega_e, strict=True)
    for t, desired, R_e, omega_e in samples:
        if desired is None:
            continue
        x_de = orientation.displacement(desired.R_d, R_e, x_de)  # eqs. (22), (27)
        value = function(orientation, x_de, desired.omega_d - omega_e, node)
        yield float(t), *_known(value, orientation)


def _impedance_rows(
    impedance: ImpedanceRun | None, node: Mapping[str, Any]
) -> Iterator[tuple[float, float, float]]:
    """Yield t, V_3, dV_3 where there is a desired frame, eqs. (68), (69)."""
    if impedance is None:
        raise BagError("no compliant_frame was recorded")
    motion = impedance.motion
    Z, orientation = rotational_impedance(node), _orientation(node)
    samples = zip(motion.t, motion.desired, motion.R_cd, motion.x, impedance.mu_d, strict=True)
    for t, desired, R_cd, x, mu_d in samples:
        if desired is not None:
            value = orientation.lyapunov_3(R_cd, x, Z, mu_d)
            yield float(t), *_known(value, orientation)


def _known(value: Lyapunov | None, orientation: OrientationRepresentation) -> Lyapunov:
    if value is None:
        raise BagError(f"the paper has no Lyapunov function for {orientation.name}")
    return value
