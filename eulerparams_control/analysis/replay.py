"""The motion of the runs for the replay of the page: the robots, and where all was when."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.decimation import packed_reals
from eulerparams_control.analysis.digest import Digest, Track
from eulerparams_control.analysis.drawn_robot import Data, DrawnRobot, drawn_robot
from eulerparams_control.analysis.labels import colour, labels
from eulerparams_control.errors import EulerParamsError
from eulerparams_control.laws.rotations import Array, EulerParameters, quaternion

ARROW = 0.1
"""[m] length of an arrow for the rounded force, or moment, that the page names."""

_TRIANGLES = 100_000  # of a robot
_MOST_TRIANGLES = 240_000  # of the page
_STEPS = 12_000  # of all runs together
_LARGEST_ANGLE = 1e4  # [rad or m] largest joint position that is drawn
_SMALLEST = {"f": 0.1, "mu": 0.01}  # [N, Nm] smallest arrow; less is noise
_LARGEST_WRENCH = 1e5  # [N, Nm] largest wrench that is drawn to scale
_PER_ARROW = 4.0  # longest arrow over ARROW, about


class Replay(NamedTuple):
    """The replay.

    Attributes:
        data: what the page reads.
        notes: what cannot be shown, and why.
        layers: of its parts that some run has: frames d and c, wrench f and mu.
        per_arrow: force [N] and moment [Nm] that are drawn ``ARROW`` long.
    """

    data: Data
    notes: list[str]
    layers: set[str]
    per_arrow: dict[str, float]


def replay(digests: Sequence[Digest]) -> Replay:
    """Return the replay of some runs; a robot that cannot be drawn is left out, with a note."""
    kinds = list(dict.fromkeys(map(_kind, digests)))
    robots = [_robot(kind, len(kinds)) for kind in kinds]
    most = max(2, _STEPS // len(digests))
    runs = [
        {
            "name": name,
            "colour": colour(index),
            "robot": kinds.index(_kind(digest)),
            **_motion(_thinned(digest.track, most)),
        }
        for index, (name, digest) in enumerate(zip(labels(digests), digests, strict=True))
    ]
    largest = {name: _largest(digests, name) for name in _SMALLEST}
    per_arrow = {name: _rounded(largest[name]) for name in largest}
    data = {
        "robots": [robot.data if isinstance(robot, DrawnRobot) else None for robot in robots],
        "runs": runs,
        "arrow": {name: ARROW / scale for name, scale in per_arrow.items()},
    }
    layers = {layer for run in runs for layer in ("d", "c", "f", "mu") if run[layer] is not None}
    layers -= {name for name in largest if largest[name] < _SMALLEST[name]}
    return Replay(data, _notes(robots), layers, per_arrow)


type _Kind = tuple[str, str, str, tuple[str, ...]]


def _kind(digest: Digest) -> _Kind:
    """Return what two runs of the same robot share: URDF, base, tip, joints."""
    robot = digest.robot
    return digest.urdf, robot.base_frame, robot.tip_frame, tuple(robot.joints)


def _robot(kind: _Kind, count: int) -> DrawnRobot | str:
    """Return a robot, or why it cannot be drawn."""
    try:
        return drawn_robot(*kind, most=min(_TRIANGLES, _MOST_TRIANGLES // count))
    except EulerParamsError as error:
        return str(error)


def _notes(robots: Sequence[DrawnRobot | str]) -> list[str]:
    notes = []
    for robot in robots:
        if isinstance(robot, str):
            notes.append(f"The robot cannot be drawn: {robot}.")
        elif robot.missing:
            names = ", ".join(robot.missing)
            notes.append(f"Meshes not found, bones are drawn: {names}.")
    return notes


def _thinned(track: Track, most: int) -> Track:
    step = -(-len(track.t) // most)
    chosen = np.unique(np.append(np.arange(0, len(track.t), step), len(track.t) - 1))
    return Track(*(values[chosen] for values in track))


def _motion(track: Track) -> Data:
    """Return all poses; None for what was not recorded."""
    sane = (np.isfinite(track.q) & (np.abs(track.q) < _LARGEST_ANGLE)).all(axis=1)
    held = _held(sane)
    return {
        "t": packed_reals(track.t),
        "q": packed_reals(np.where(sane[held][:, None], track.q[held], 0.0)),
        "n": track.q.shape[1],
        "p": packed_reals(track.p_e[held]),
        "d": _frames(track.p_d, track.R_d),
        "c": _frames(track.p_c, track.R_c),
        "f": _vectors(track.f),
        "mu": _vectors(track.mu),
    }


def _held(sane: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return for each instant the index of the last one that is sane, 0 if there is none."""
    return np.maximum.accumulate(np.where(sane, np.arange(len(sane)), 0))


def _frames(p: Array, R: Array) -> dict[str, Any] | None:
    known = np.isfinite(p).all(axis=1) & np.isfinite(R).all(axis=(1, 2))
    if not known.any():
        return None
    quaternions = np.full((len(p), 4), np.nan)
    quaternions[known] = [_xyzw(quaternion(matrix)) for matrix in R[known]]
    where = np.where(known[:, None], p, np.nan)
    return {"p": packed_reals(where), "o": packed_reals(quaternions)}


def _xyzw(Q: EulerParameters) -> list[float]:
    """Return a quaternion as three.js has it: scalar last."""
    return [*Q.eps.tolist(), Q.eta]


def _vectors(v: Array) -> dict[str, str] | None:
    return packed_reals(v) if np.isfinite(v).any() else None


def _largest(digests: Sequence[Digest], name: str) -> float:
    """Return the largest finite norm of f or mu."""
    largest = 0.0
    for digest in digests:
        with np.errstate(over="ignore", invalid="ignore"):
            norms = np.linalg.norm(getattr(digest.track, name), axis=1)
        norms = norms[np.isfinite(norms) & (norms < _LARGEST_WRENCH)]
        largest = max(largest, float(norms.max(initial=0.0)))
    return largest


def _rounded(largest: float) -> float:
    """Return 1, 2 or 5 times a power of ten, so that the largest is a few arrows long."""
    wanted = max(largest, 1e-3) / _PER_ARROW
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= wanted * (1 - 1e-9))
