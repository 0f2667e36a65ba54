"""Vectors and matrices of three, as values of formulas.

Formulas are written once, for one sample, in plain Python on :class:`Vec` and :class:`Mat`::

    a_p = ddp_d + k_Vp * (dp_d - dp_e) + k_Pp * dp_de  # (36)

Compiled, a vector is three floats in registers: see :mod:`eulerparams_control.laws._old.compiled`.
"""

import math
import operator
from typing import Annotated, Any, overload

from eulerparams_control.laws._old.compiled import Input, Inputs, formula, kernel, layout, register


class Vec:
    """A vector (3,)."""

    __slots__ = ("x", "y", "z")
    __array_ufunc__ = None  # a number of numpy leaves products to this class

    def __init__(self, x: float, y: float, z: float) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, w: "Vec") -> "Vec":
        return Vec(self.x + w.x, self.y + w.y, self.z + w.z)

    def __sub__(self, w: "Vec") -> "Vec":
        return Vec(self.x - w.x, self.y - w.y, self.z - w.z)

    def __rmul__(self, k: float) -> "Vec":
        return _scaled_vec(k, self)

    def __truediv__(self, k: float) -> "Vec":
        return Vec(self.x / k, self.y / k, self.z / k)

    def __neg__(self) -> "Vec":
        return Vec(-self.x, -self.y, -self.z)

    def __matmul__(self, w: "Vec") -> float:
        return self.x * w.x + self.y * w.y + self.z * w.z


class Mat:
    """A matrix (3, 3)."""

    __array_ufunc__ = None
    __slots__ = ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz")

    def __init__(
        self,
        xx: float, xy: float, xz: float,
        yx: float, yy: float, yz: float,
        zx: float, zy: float, zz: float,
    ) -> None:  # fmt: skip
        self.xx, self.xy, self.xz = xx, xy, xz
        self.yx, self.yy, self.yz = yx, yy, yz
        self.zx, self.zy, self.zz = zx, zy, zz

    def __add__(self, B: "Mat") -> "Mat":
        return Mat(
            self.xx + B.xx, self.xy + B.xy, self.xz + B.xz,
            self.yx + B.yx, self.yy + B.yy, self.yz + B.yz,
            self.zx + B.zx, self.zy + B.zy, self.zz + B.zz,
        )  # fmt: skip

    def __sub__(self, B: "Mat") -> "Mat":
        return Mat(
            self.xx - B.xx, self.xy - B.xy, self.xz - B.xz,
            self.yx - B.yx, self.yy - B.yy, self.yz - B.yz,
            self.zx - B.zx, self.zy - B.zy, self.zz - B.zz,
        )  # fmt: skip

    def __rmul__(self, k: float) -> "Mat":
        return _scaled_mat(k, self)

    @overload
    def __matmul__(self, B: "Vec") -> "Vec": ...
    @overload
    def __matmul__(self, B: "Mat") -> "Mat": ...
    def __matmul__(self, B: Any) -> Any:
        return _times_vec(self, B) if isinstance(B, Vec) else _times_mat(self, B)

    @property
    def T(self) -> "Mat":
        """The transpose."""
        return transpose(self)


type VecLike = Annotated[Any, Vec]
type MatLike = Annotated[Any, Mat]
"""A field that is a vector or matrix in formulas, and elsewhere an array, of one sample or of N."""


def _times_vec(A: Mat, v: Vec) -> Vec:
    return Vec(
        A.xx * v.x + A.xy * v.y + A.xz * v.z,
        A.yx * v.x + A.yy * v.y + A.yz * v.z,
        A.zx * v.x + A.zy * v.y + A.zz * v.z,
    )


def _times_mat(A: Mat, B: Mat) -> Mat:
    return Mat(
        A.xx * B.xx + A.xy * B.yx + A.xz * B.zx,
        A.xx * B.xy + A.xy * B.yy + A.xz * B.zy,
        A.xx * B.xz + A.xy * B.yz + A.xz * B.zz,
        A.yx * B.xx + A.yy * B.yx + A.yz * B.zx,
        A.yx * B.xy + A.yy * B.yy + A.yz * B.zy,
        A.yx * B.xz + A.yy * B.yz + A.yz * B.zz,
        A.zx * B.xx + A.zy * B.yx + A.zz * B.zx,
        A.zx * B.xy + A.zy * B.yy + A.zz * B.zy,
        A.zx * B.xz + A.zy * B.yz + A.zz * B.zz,
    )


def transpose(A: Mat) -> Mat:
    """Return A'."""
    return Mat(A.xx, A.yx, A.zx, A.xy, A.yy, A.zy, A.xz, A.yz, A.zz)


def _scaled_vec(k: float, v: Vec) -> Vec:
    return Vec(k * v.x, k * v.y, k * v.z)


def _scaled_mat(k: float, A: Mat) -> Mat:
    return Mat(
        k * A.xx, k * A.xy, k * A.xz,
        k * A.yx, k * A.yy, k * A.yz,
        k * A.zx, k * A.zy, k * A.zz,
    )  # fmt: skip


register(
    (Vec, Mat),
    [
        (operator.add, (Vec, Vec), Vec.__add__),
        (operator.sub, (Vec, Vec), Vec.__sub__),
        (operator.mul, (float, Vec), _scaled_vec),
        (operator.truediv, (Vec, float), Vec.__truediv__),
        (operator.neg, (Vec,), Vec.__neg__),
        (operator.matmul, (Vec, Vec), Vec.__matmul__),
        (operator.add, (Mat, Mat), Mat.__add__),
        (operator.sub, (Mat, Mat), Mat.__sub__),
        (operator.mul, (float, Mat), _scaled_mat),
        (operator.matmul, (Mat, Vec), _times_vec),
        (operator.matmul, (Mat, Mat), _times_mat),
    ],
    properties=[(Mat, "T", transpose)],
)


# --- values and arrays ---------------------------------------------------------------------

read_vec, put_vec = layout(Vec)[1:3]


@kernel
def vec(a: Input) -> Vec:
    """Return the vector of an array (3,)."""
    return Vec(a[0], a[1], a[2])


@kernel
def mat(A: Inputs) -> Mat:
    """Return the matrix of an array (3, 3)."""
    return Mat(
        A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2], A[2, 0], A[2, 1], A[2, 2]
    )  # fmt: skip


# --- products ------------------------------------------------------------------------------


@formula
def cross(v: Vec, w: Vec) -> Vec:
    """Return v x w."""
    return Vec(v.y * w.z - v.z * w.y, v.z * w.x - v.x * w.z, v.x * w.y - v.y * w.x)


@formula
def S(v: Vec) -> Mat:
    """Return the skew-symmetric matrix with S(v) w = v x w, as in eq. (1)."""
    return Mat(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)


@formula
def identity(k: float) -> Mat:
    """Return k I."""
    return Mat(k, 0.0, 0.0, 0.0, k, 0.0, 0.0, 0.0, k)


@formula
def outer(v: Vec, w: Vec) -> Mat:
    """Return v w'."""
    return Mat(
        v.x * w.x, v.x * w.y, v.x * w.z,
        v.y * w.x, v.y * w.y, v.y * w.z,
        v.z * w.x, v.z * w.y, v.z * w.z,
    )  # fmt: skip


@formula
def columns(a: Vec, b: Vec, c: Vec) -> Mat:
    """Return the matrix of three columns."""
    return Mat(a.x, b.x, c.x, a.y, b.y, c.y, a.z, b.z, c.z)


@formula
def element(v: Vec, i: int) -> float:
    """Return the element i, 0 ... 2, of a vector."""
    return v.x if i == 0 else (v.y if i == 1 else v.z)


@formula
def row(A: Mat, i: int) -> Vec:
    """Return the row i, 0 ... 2, of a matrix."""
    if i == 0:
        return Vec(A.xx, A.xy, A.xz)
    if i == 1:
        return Vec(A.yx, A.yy, A.yz)
    return Vec(A.zx, A.zy, A.zz)


@formula
def column(A: Mat, j: int) -> Vec:
    """Return the column j, 0 ... 2, of a matrix."""
    return row(A.T, j)


@formula
def norm(v: Vec) -> float:
    """Return |v|."""
    return math.sqrt(v @ v)


@formula
def solve(A: Mat, b: Vec) -> Vec:
    """Return A^-1 b by Cramer's rule; NaN where A is singular."""
    a_1, a_2, a_3 = column(A, 0), column(A, 1), column(A, 2)
    a_23 = cross(a_2, a_3)
    det = a_1 @ a_23
    if det == 0.0:
        return Vec(math.nan, math.nan, math.nan)
    return Vec(b @ a_23, b @ cross(a_3, a_1), b @ cross(a_1, a_2)) / det


@formula
def inverse(A: Mat) -> Mat:
    """Return A^-1; NaN where A is singular."""
    x, y, z = Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0)
    return columns(solve(A, x), solve(A, y), solve(A, z))
