"""Mass, damping and stiffness as formulas take them."""

from typing import NamedTuple

from eulerparams_control.laws._old.linear import MatLike


class Matrices(NamedTuple):
    """What moves by an impedance: ddx = M^-1 (force - D dx - K x)."""

    M_inverse: MatLike
    D: MatLike
    K: MatLike
