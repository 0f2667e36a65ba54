"""Kinds "stiffness" and "deflection": how moments turn the compliant frame.

A constant moment is applied to the compliance law at rest until it is at rest again.
"""

import math
from dataclasses import dataclass

import numpy as np

from eulerparams_control.errors import SingularityError
from eulerparams_control.lab.maps.base import MapKind, MapVariant, Row
from eulerparams_control.lab.maps.sampling import (
    directions,
    over_directions,
    random_axis,
    with_tool_axis,
)
from eulerparams_control.laws.compliant_frame import ComplianceLaw, CompliantFrame
from eulerparams_control.laws.impedance_matrices import Impedance, damping_of_ratio
from eulerparams_control.laws.rotations import Array, log
from eulerparams_control.motion.frames import DesiredFrame

_AT_REST = 0.02  # [rad/s]
_NO_ANSWER = {"k_min": math.nan, "k_max": math.nan, "deviation": math.nan}


@dataclass(frozen=True, kw_only=True)
class PressedMap(MapKind):
    """A compliant frame is pressed by a moment.

    Attributes:
        K_o: [Nm/rad] stiffness about the desired axes x, y, z.
        rate: [1/s] of the critically damped impedance about the softest axis.
        dt: [s] a step.
        duration: [s] after which it is at rest.
    """

    K_o: tuple[float, ...] = (100.0, 100.0, 100.0)
    rate: float = 20.0
    dt: float = 5e-3
    duration: float = 0.8

    def law(self, variant: MapVariant) -> ComplianceLaw:
        """Return the compliance law."""
        K = np.diag(self.K_o)
        M = min(self.K_o) / self.rate**2 * np.eye(3)
        Z = Impedance(M, damping_of_ratio(M, K, 1.0), K)
        return ComplianceLaw(variant.representation, Z, Z)

    def turn(self, law: ComplianceLaw, R_d: Array, mu: Array) -> Array:
        """Return the rotation vector (3,) of R_d' R_c at rest under the moment mu, base frame.

        NaN if it does not come to rest.

        Raises:
            SingularityError: if the representation has no finite answer on the way.
        """
        desired, frame = DesiredFrame(np.zeros(3), R_d), CompliantFrame(law)
        wrench = np.concatenate((np.zeros(3), mu))
        for _ in range(round(self.duration / self.dt)):
            compliant = frame.step(self.dt, desired, wrench)
        if not np.abs(compliant.omega_d).max() < _AT_REST:
            return np.full(3, math.nan)
        return log(R_d.T @ compliant.R_d)


@dataclass(frozen=True, kw_only=True)
class StiffnessMap(PressedMap):
    """Small moments about three axes of the desired frame give the apparent stiffness.

    ``samples`` counts the directions of the tool axis.

    Attributes:
        moment: over the stiffness about its axis [rad]: small.
        shown: "stiffness", or "deviation" of the turn from the axis of the moment.
    """

    kind = "stiffness"

    moment: float = 1e-3
    shown: str = "stiffness"

    def cells(self) -> list[Row]:
        """Return variants x directions."""
        return over_directions(len(self.variants), self.samples)

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return least and largest apparent over chosen stiffness, and the worst deviation [deg].

        The apparent stiffness is the inverse of the matrix of turns by moment.
        """
        z = np.array([cell["x"], cell["y"], cell["z"]], dtype=float)
        R_d = with_tool_axis(z, self.random(cell).uniform(-math.pi, math.pi))
        moments = self.moment * np.diag(self.K_o)
        try:
            law = self.law(self.variant(cell))
            turns = np.array([self.turn(law, R_d, R_d @ mu) for mu in moments])
            K = np.linalg.inv(np.linalg.solve(moments, turns).T)
        except (SingularityError, np.linalg.LinAlgError):
            return _NO_ANSWER
        root = np.diag(np.array(self.K_o) ** -0.5)
        if not np.isfinite(K).all():
            return _NO_ANSWER
        relative = np.linalg.eigvalsh(root @ (K + K.T) / 2 @ root)
        cosines = np.diag(turns) / np.linalg.norm(turns, axis=1)
        worst = math.degrees(math.acos(float(np.clip(cosines.min(), -1, 1))))
        return {"k_min": float(relative[0]), "k_max": float(relative[-1]), "deviation": worst}


@dataclass(frozen=True, kw_only=True)
class DeflectionMap(PressedMap):
    """Moments about random axes at random orientations, from small to almost the stiffness.

    ``samples`` counts the sizes of the moment.

    Attributes:
        trials: orientations and axes for each size.
        largest: moment over stiffness [rad].
    """

    kind = "deflection"

    trials: int = 20
    largest: float = 0.98

    def cells(self) -> list[Row]:
        """Return variants x sizes x trials; a trial has the same orientation for each size."""
        sizes = self.largest * np.arange(1, self.samples + 1) / self.samples
        return [
            {"variant": v, "place": trial, "moment": moment}
            for v in range(len(self.variants))
            for moment in sizes.tolist()
            for trial in range(self.trials)
        ]

    def simulate(self, cell: Row) -> dict[str, float]:
        """Return the angle [deg] of the turn, and that between its axis and the moment."""
        random = self.random(cell)
        z = directions(self.trials)[int(cell["place"])]
        R_d = with_tool_axis(z, random.uniform(-math.pi, math.pi))
        axis = random_axis(random)
        mu = float(cell["moment"]) * self.K_o[0] * axis
        try:
            turn = self.turn(self.law(self.variant(cell)), R_d, mu)
        except SingularityError:
            return {"turn": math.nan, "deviation": math.nan}
        theta = math.sqrt(turn @ turn)
        if not theta > 0:  # it does not come to rest
            return {"turn": math.nan, "deviation": math.nan}
        cosine = float(turn @ (R_d.T @ axis)) / theta
        deviation = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
        return {"turn": math.degrees(theta), "deviation": deviation}
