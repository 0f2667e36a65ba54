"""Springs of compliance control: their energy, and the work that they do along a path.

They are those that acted, by ~/impedance, clips included; those of the recorded parameters where
that was not recorded.  They are taken at the recorded poses of tip and desired frame.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from eulerparams_control.analysis.controllers import parameters_to_blame
from eulerparams_control.analysis.quantities.base import (
    Samples,
    controller_parameters,
    drawn,
    metric,
    quotient,
)
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.analysis.stacks import rotation_vectors
from eulerparams_control.errors import BagError, SingularityError
from eulerparams_control.laws.elasticity import Elasticity
from eulerparams_control.laws.rotations import Array
from eulerparams_control.motion.frames import DesiredFrame
from eulerparams_control.parameters.compliance_control import ComplianceParameters


def _springs(recording: Recording) -> tuple[Array, Array]:
    """Return wrench (M, 6) and energy (M,) at the instants ``known``; NaN where is none."""
    series, known = recording.leading, recording.known
    elasticity_of = _elasticities(recording)
    acting, places = recording.acting, np.full(len(known), -1)
    if acting is not None:
        places = acting.before(series.t[known])
    w, energy = np.full((len(known), 6), np.nan), np.full(len(known), np.nan)
    for i, (k, place) in enumerate(zip(known, places.tolist(), strict=True)):
        desired = DesiredFrame(series.desired.p[k], series.desired.R[k])
        try:
            pull = elasticity_of(place).wrench(series.p_e[k], series.R_e[k], desired)
        except SingularityError:
            continue
        w[i], energy[i] = [*pull.f, *pull.mu], pull.energy
    return w, energy


def _elasticities(recording: Recording) -> Callable[[int], Elasticity]:
    """Return the springs that acted from a place of ~/impedance on; -1 is before the first."""
    parameters, acting = controller_parameters(recording, ComplianceParameters), recording.acting
    with parameters_to_blame(parameters.scheme.name):
        stated = parameters.elasticity()

    @cache
    def elasticity_of(place: int) -> Elasticity:
        if place < 0 or acting is None:
            return stated
        _, _, K_p, _, _, K_o = acting.matrices[place]
        clip_position, clip_rotation = acting.numbers[place, 36:].tolist()
        return Elasticity(stated.orientation, K_p, K_o, clip_position, clip_rotation, stated.frame)

    return elasticity_of


@metric("")
def spring_work(recording: Recording) -> float:
    """Work of the springs on the tip over what they exchange with it.

    The sum of their work over that of its magnitude, by the trapezoidal rule along the recorded
    poses.  Around a closed path before a desired frame at rest it is 0: no energy is made.
    """
    w, _ = _springs(recording)
    series, known = recording.leading, recording.known
    work = _work(w, series.p_e[known], series.R_e[known])
    return quotient(float(work.sum()), float(np.abs(work).sum()))


@metric("J")
def contact_work(recording: Recording) -> float:
    """Work of the contact on the tool: of the recorded wrench along the recorded poses.

    Around a closed path before a desired frame at rest it is what the dampers took.  Where it is
    negative the arm has given energy to what touches it.
    """
    return float(work_of_contact(recording)[1][-1])


def work_of_contact(recording: Recording) -> Samples:
    """Return the work [J] of the contact on the tool so far."""
    wrench, measured = recording.wrench, recording.measured
    if wrench is None:
        raise BagError(f"{recording.path}: {recording.why_no_wrench}")
    t, at, among = np.intersect1d(measured.t, wrench.t, return_indices=True)
    w = np.hstack([wrench.f, wrench.mu])[among]
    return t[1:], _work(w, measured.p_e[at], measured.R_e[at]).cumsum()


def _work(w: Array, p: Array, R: Array) -> Array:
    """Return the work (N - 1,) [J] of wrenches (N, 6) between poses, by the trapezoidal rule."""
    turned = rotation_vectors(R[1:] @ np.swapaxes(R[:-1], 1, 2))
    work: Array = ((w[1:] + w[:-1]) / 2 * np.hstack([np.diff(p, axis=0), turned])).sum(axis=1)
    return work


@drawn(
    18, "Elastic energy", "energy of the springs [J]",
    "Energy of the springs of compliance control, of which force and moment, (60), (66), are minus "
    "the gradient.",
    unit="J", floor=1e-9,
)  # fmt: skip
def elastic_energy(recording: Recording) -> Samples:
    """Return the energy [J] of the springs."""
    return recording.leading.t[recording.known], _springs(recording)[1]
