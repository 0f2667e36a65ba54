"""Sampling of SO(3) for the cells of a map."""

import math

import numpy as np

from eulerparams_control.laws.rotations import Array, cross, exp

_GOLDEN = math.pi * (3 - math.sqrt(5))


def directions(count: int) -> Array:
    """Return ``count`` unit vectors (count, 3), evenly over the sphere: Fibonacci's lattice."""
    index = np.arange(count)
    z = 1 - (2 * index + 1) / count
    r, phi = np.sqrt(1 - z**2), _GOLDEN * index
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def with_tool_axis(z: Array, roll: float) -> Array:
    """Return R (3, 3) with the unit tool axis z (3,) and a roll [rad] about it."""
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= math.sqrt(x @ x)
    R: Array = np.stack([x, cross(z, x), z], axis=1) @ exp(np.array([0.0, 0.0, roll]))
    return R


def random_axis(random: np.random.Generator) -> Array:
    """Return a unit vector (3,), uniform over the sphere."""
    v = random.normal(size=3)
    return v / math.sqrt(v @ v)


def passing(axis: int, closest: float, roll: float) -> tuple[Array, Array]:
    """Return R and the unit axis n of a turn in which the tool axis passes a pole.

    exp(phi n) R has the tool axis at the angle acos(cos(closest) cos(phi)) to the base axis.

    Args:
        axis: 0, 1, 2, the base axis at which the pole is.
        closest: [rad] how close it passes.
        roll: [rad] of the tool about its axis.
    """
    pole, beside, along = (np.eye(3)[(axis + i) % 3] for i in range(3))
    z = math.cos(closest) * pole + math.sin(closest) * beside
    return with_tool_axis(z, roll), cross(z, along)


def away(R_d: Array, error: Array) -> Array:
    """Return R_e (3, 3) with R_e exp(error) = R_d; error (3,) [rad] in the end-effector frame."""
    R_e: Array = R_d @ exp(-error)
    return R_e


def over_directions(variants: int, samples: int) -> list[dict[str, float | str]]:
    """Return the cells of a map over the direction of the tool axis: variants x directions."""
    return [
        {"variant": v, "place": p, "x": x, "y": y, "z": z}
        for v in range(variants)
        for p, (x, y, z) in enumerate(directions(samples).tolist())
    ]
