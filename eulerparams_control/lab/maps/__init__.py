"""Where representations fail or distort: sweeps of simulations; importing this registers them."""

from eulerparams_control.lab.maps import (
    arm_map,
    deflection_map,
    error_map,
    gain_map,
    orientation_map,
    stiffness_map,
)
from eulerparams_control.lab.maps.base import MapKind, Picture, Variant

__all__ = [
    "MapKind",
    "Picture",
    "Variant",
    "arm_map",
    "deflection_map",
    "error_map",
    "gain_map",
    "orientation_map",
    "stiffness_map",
]
