"""The inverse as the laws that are not yet open Python take it: filled in place."""

import numpy as np

from eulerparams_control.laws._old.compiled import Inputs, Row, Rows, kernel
from eulerparams_control.laws.inverse import damped_inverse


@kernel
def invert(J: Inputs, eps: float, lambda_max: float, length: float, X: Rows) -> None:
    """Fill X (n, 6) with J* of J (6, n)."""
    X[:] = damped_inverse(J, eps, lambda_max, length)


@kernel
def resolve(inverse: Rows, J: Inputs, v: Row, x_0: Row, x: Row) -> None:
    """Fill x (n,) with x_0 + J* (v - J x_0): what moves the tip by v (6,), the rest as x_0 (n,)."""
    n = len(x)
    left = np.empty(6)
    for i in range(6):
        left[i] = v[i]
        for k in range(n):
            left[i] -= J[i, k] * x_0[k]
    for k in range(n):
        x[k] = x_0[k]
        for i in range(6):
            x[k] += inverse[k, i] * left[i]
