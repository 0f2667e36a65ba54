"""Where representations fail or distort: sweeps of simulations; importing this registers them."""

from eulerparams_control.lab.maps import (
    arm_map,
    chart_pictures,
    gain_map,
    pressed_maps,
    sphere_pictures,
    turning_maps,
)
from eulerparams_control.lab.maps.base import MapKind, MapVariant, Picture, pictures

__all__ = [
    "MapKind",
    "MapVariant",
    "Picture",
    "arm_map",
    "chart_pictures",
    "gain_map",
    "pictures",
    "pressed_maps",
    "sphere_pictures",
    "turning_maps",
]
