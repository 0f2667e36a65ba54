"""Way-points as rows of numbers, the form that ROS parameters can take."""

from collections.abc import Sequence

import numpy as np

from eulerparams_control.errors import ConfigurationError, UnknownNameError
from eulerparams_control.laws.jit import Array
from eulerparams_control.laws.orientation import SEQUENCES, EulerSequence
from eulerparams_control.laws.rotations import EulerParameters, exp
from eulerparams_control.motion.trajectories import MAX_POINTS, Trajectory, way_points

FORMATS = ("quaternion_xyzw", "rotation_vector", *SEQUENCES)

# A unit quaternion printed with 4 digits is this close to norm 1.
_NORM_TOLERANCE = 1e-3

_LARGEST = 1e9  # [s, m, rad]; a duration of more does not fit into a message


def parse_way_points(
    times: Sequence[float],
    positions: Sequence[float],
    orientations: Sequence[float],
    orientation_format: str = "quaternion_xyzw",
) -> Trajectory:
    """Return the motion that rests at each of N way-points.

    Args:
        times: N times [s] from the start.
        positions: 3 N numbers, x, y, z of each way-point in a row [m], base frame.
        orientations: 4 N numbers for quaternions, else 3 N [rad], base frame.
        orientation_format: one of ``FORMATS``; a sequence means its Euler angles.

    Raises:
        UnknownNameError: if there is no such format.
        ConfigurationError: if the numbers of values do not fit, or one is impossible.
    """
    if orientation_format not in FORMATS:
        raise UnknownNameError("orientation_format", orientation_format, FORMATS)
    width = 4 if orientation_format == "quaternion_xyzw" else 3
    n = len(times)
    if n == 0 or len(positions) != 3 * n or len(orientations) != width * n:
        raise ConfigurationError(
            f"way-points: {n} times, {len(positions)} numbers in positions, {len(orientations)} in "
            f"orientations; expected N, 3 N and {width} N with orientation_format "
            f"{orientation_format}"
        )
    if n > MAX_POINTS:
        raise ConfigurationError(f"way-points: {n} of them; expected at most {MAX_POINTS}")
    if not all(np.all(np.abs(told) <= _LARGEST) for told in (times, positions, orientations)):
        raise ConfigurationError(
            f"way-points: times {list(times)}, positions {list(positions)}, orientations "
            f"{list(orientations)}; expected finite numbers up to {_LARGEST:g}"
        )
    if min(times) < 0:
        raise ConfigurationError(f"way-points: the time {min(times):g} s; expected 0 or more")
    rows = np.reshape(np.array(orientations, dtype=float), (n, width))
    rotations = [_rotation(row, orientation_format) for row in rows]
    points = np.reshape(np.array(positions, dtype=float), (n, 3))
    return way_points(times, list(zip(points, rotations, strict=True)))


def _rotation(values: Array, orientation_format: str) -> Array:
    if orientation_format == "rotation_vector":
        return exp(values)
    if orientation_format != "quaternion_xyzw":
        return EulerSequence(orientation_format).R(values)
    norm = float(np.linalg.norm(values))
    if not abs(norm - 1) <= _NORM_TOLERANCE:
        raise ConfigurationError(f"quaternion xyzw {values.tolist()} has norm {norm:g}; expected 1")
    return EulerParameters(values[3] / norm, values[:3] / norm).R
