"""Compliance: where the compliant frame is relative to the desired one, and why.

Options as in ``contact``; displacement and turn are in the axes of the desired frame.  What is
compared with a force or a moment is that at the centre of compliance, which may be off the tip.
"""

import math

import numpy as np
from numpy.typing import NDArray

from eulerparams_control.analysis.compliant import (
    CompliantMotion,
    ImpedanceRun,
    impedances,
    rotational_residual,
    translational_residual,
)
from eulerparams_control.analysis.controllers import parameters_to_blame
from eulerparams_control.analysis.quantities.base import (
    XYZ,
    Axis,
    Samples,
    along,
    compared,
    controller_parameters,
    drawn,
    known,
    mean_at_end,
    metric,
    needed,
    quotient,
    reduced,
    row,
    within,
)
from eulerparams_control.analysis.quantities.contact import GROUP, lengths
from eulerparams_control.analysis.quantities.stability import growth
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import BagError
from eulerparams_control.laws.rotations import Array
from eulerparams_control.parameters.impedance_control import ImpedanceParameters


@drawn(
    21.5, "Turn of the compliant frame, desired axes", "turn [deg]",
    "Rotation vector of R_d' R_c, axis times angle of the compliant relative to the desired "
    "frame: with Euler parameters along the moment where that is along an axis of K_o (65).",
    unit="deg", floor=1e-6, name="rho_cd_d", components=XYZ, group=GROUP,
)  # fmt: skip
@reduced("turn", "deg", "turn of the compliant frame", "peak", "final", vectors=True)
def turn(recording: Recording) -> Samples:
    """Return the rotation vector (N, 3) [deg] of R_d' R_c."""
    compliant: CompliantMotion = needed(recording, "compliant")
    return compared(compliant.t, np.degrees(compliant.rho_cd_d))


@drawn(
    21, "Displacement of the compliant frame, desired axes", "displacement [mm]",
    "R_d' (p_c - p_d): the compliant relative to the desired origin, in the desired frame.",
    unit="mm", floor=1e-6, name="p_cd_d", components=XYZ, group=GROUP,
)  # fmt: skip
@reduced("displacement", "mm", "displacement of the compliant frame", "peak", "final", vectors=True)
def displacement(recording: Recording) -> Samples:
    """Return R_d' (p_c - p_d) (N, 3) [mm] at the tip."""
    compliant: CompliantMotion = needed(recording, "compliant")
    return compared(compliant.t, 1e3 * compliant.p_cd_d)


@reduced("compliant_speed", "mm/s", "speed of the compliant frame", "final")
def compliant_speed(recording: Recording) -> Samples:
    """Return the speed [mm/s] of the compliant frame."""
    compliant: CompliantMotion = needed(recording, "compliant")
    return compliant.t, 1e3 * np.linalg.norm(compliant.frames.dp, axis=1)


@metric("deg")
def moment_axis_angle(recording: Recording, window: float = 0.0, before: float = math.inf) -> float:
    """Angle between the axes of turn and moment at the end.

    Of the rotation vector of R_d' R_c and mu^d: 0 by (65) about an axis of K_o.
    """
    run = _impedance(recording)
    rho = mean_at_end(run.motion.t, run.motion.rho_cd_d, window, before)
    mu = mean_at_end(run.motion.t, run.mu_d, window, before)
    if not (rho.any() and mu.any()):
        raise BagError(f"{recording.path}: no turn or no moment, so that its axis is not known")
    across = float(np.linalg.norm(np.cross(rho, mu)))
    return math.degrees(math.atan2(across, float(rho @ mu)))


@metric("Nm/rad")
def apparent_stiffness(
    recording: Recording, window: float = 0.0, before: float = math.inf
) -> float:
    """Moment over turn at the end.

    The stiffness that the environment feels about the axis of the moment:
    mu' mu / (mu' rho) with the rotation vector rho of R_d' R_c, all in the desired frame.
    """
    run = _impedance(recording)
    rho = mean_at_end(run.motion.t, run.motion.rho_cd_d, window, before)
    mu = mean_at_end(run.motion.t, run.mu_d, window, before)
    return quotient(float(mu @ mu), float(mu @ rho))


@metric("N/m")
def apparent_translational_stiffness(
    recording: Recording, window: float = 0.0, before: float = math.inf
) -> float:
    """Force over displacement at the end.

    The stiffness that the environment feels along the force: f' f / (f' p) with p = p_c - p_d.
    """
    run = _impedance(recording)
    p = mean_at_end(run.motion.t, run.motion.p_cd_d, window, before)
    f = mean_at_end(run.motion.t, run.f_d, window, before)
    return quotient(float(f @ f), float(f @ p))


@metric("1/s")
def escape_rate(recording: Recording, low: float, high: float) -> float:
    """Rate at which a turn of 180 deg is left.

    That of 180 deg less the turn of the compliant frame, where this first passes from ``low`` to
    ``high`` [deg]: about an axis of K_o the equilibrium Q3 (67) is unstable (70), (71).
    """
    compliant: CompliantMotion = needed(recording, "compliant")
    turn = np.degrees(np.linalg.norm(compliant.rho_cd_d, axis=1))
    known = np.isfinite(turn)
    try:
        return growth(compliant.t[known], 180.0 - turn[known], low, high)
    except BagError as error:
        raise BagError(f"{recording.path}: 180 deg less the turn {error}") from error


@metric("mm")
def guided_distance(recording: Recording, axis: Axis = (), before: float = math.inf) -> float:
    """Distance of the compliant frame from its start at the end.

    With an axis, in the base frame, its component.
    """
    compliant: CompliantMotion = needed(recording, "compliant")
    p_c = compliant.frames.p[within(compliant.t, 0.0, before)]
    return 1e3 * float(along(p_c[-1] - p_c[0], axis))


@metric("N")
def force_residual(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Largest contact force that (52) does not account for.

    Of f - (M_p ddx + D_p dx + K_p x) with the accelerations of the compliant frame
    that was recorded; without dead band and low-pass it is rounding.  While a force is exerted
    (52) is not the law: those instants are left out.
    """
    run, parameters = _impedance(recording), controller_parameters(recording, ImpedanceParameters)
    with parameters_to_blame(parameters.scheme.name):
        Z, _ = impedances(run.motion.t, parameters, recording.acting)
    left = translational_residual(run.motion, run.f, Z, parameters.translational_frame)
    left[_is_pressed(recording, run.motion.t)] = np.nan
    return float(np.linalg.norm(known(run.motion.t, left, after, before)[1], axis=1).max())


@metric("Nm")
def moment_residual(recording: Recording, after: float = 0.0, before: float = math.inf) -> float:
    """Largest contact moment that (59) does not account for.

    Of mu^d - (M_o dx + D_o x + K_o' eps), eq. (60), of Euler parameters, with the
    accelerations of the compliant frame that was recorded; without dead band and low-pass it is
    rounding, however the desired frame turns.
    """
    run, parameters = _impedance(recording), controller_parameters(recording, ImpedanceParameters)
    if (used := parameters.orientation) != "euler_parameters":
        raise BagError(f"{recording.path}: (59) is of euler_parameters, not {used}")
    with parameters_to_blame(parameters.scheme.name):
        _, Z = impedances(run.motion.t, parameters, recording.acting)
    left = rotational_residual(run.motion, run.mu, Z)
    return float(np.linalg.norm(known(run.motion.t, left, after, before)[1], axis=1).max())


def _impedance(recording: Recording) -> ImpedanceRun:
    """Return what an impedance relates; raises BagError unless the wrench is known."""
    run: ImpedanceRun = needed(recording, "impedance")
    needed(recording, "wrench")
    return run


def _is_pressed(recording: Recording, t: Array) -> NDArray[np.bool_]:
    """Return at which instants (N,) [s] a force is exerted."""
    pressed = recording.pressed
    if pressed is None:
        return np.zeros(len(t), dtype=bool)
    last = np.searchsorted(pressed.t, t, side="right") - 1
    is_asked = ~np.isnan(pressed.f_d).any(axis=1)
    return (last >= 0) & is_asked[last]


drawn(
    4, "Displacement of the compliant frame", "|p_c - p_d| [mm]",
    "Distance between the compliant and the desired origin: what the contact force makes of the "
    "translational impedance (52).",
    unit="mm", floor=1e-6, name="displacement",
)(lengths(displacement))  # fmt: skip
drawn(
    5, "Turn of the compliant frame", "angle of R_d' R_c [deg]",
    "Angle of the compliant frame relative to the desired one: what the contact moment makes of "
    "the rotational impedance (55), (59).",
    unit="deg", floor=1e-6, name="turn",
)(lengths(turn))  # fmt: skip

row(20, "compliant frame, end", "final_displacement")
row(21, "compliant frame, end", "final_turn")
