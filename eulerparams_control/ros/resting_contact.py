"""The contact that is felt while the arm is at rest: it refuses activation, and is tared."""

from collections import deque

import numpy as np

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.laws.impedance_control import ImpedanceControl
from eulerparams_control.laws.rotations import Array
from eulerparams_control.laws.wrench import RestingSample, WrenchChain, is_still, mean_felt
from eulerparams_control.parameters.impedance_control import ImpedanceParameters
from eulerparams_control.robot.robot import Robot

# Number of wrenches that decide whether the arm touches something.
_FEW = 10


class RestingContact:
    """What the tool feels while the arm is at rest, by a sensor that was not tared at first."""

    def __init__(self, robot: Robot, parameters: ImpedanceParameters) -> None:
        self._parameters = parameters
        self.chain = WrenchChain(robot, parameters)  # from the sensor to the contact
        # the last ones, each with the state of the arm
        self.wrenches: deque[RestingSample] = deque(maxlen=parameters.tare_samples)

    def refusal(self, topic: str, *, waits: bool) -> str:
        """Return why the arm must not be controlled yet; "" if it may.

        ``waits``: whether a simulator waits for its answer, so that no more wrenches come.
        """
        p = self._parameters
        if len(self.wrenches) < (1 if waits else min(_FEW, p.tare_samples)):
            return f"waiting for {_FEW} wrenches on {topic}"
        if not self._touches(*self._felt()):
            return ""
        return (
            f"a wrench above max_activation_force {p.max_activation_force:g} N or "
            f"max_activation_torque {p.max_activation_torque:g} Nm is felt: move the arm away "
            "from what it touches, or call ~/tare if it touches nothing"
        )

    def _felt(self) -> tuple[float, float]:
        return norms(mean_felt(self.chain, [*self.wrenches][-_FEW:]) - self.chain.tared)

    def _touches(self, force: float, torque: float) -> bool:
        p = self._parameters
        return force > p.max_activation_force or torque > p.max_activation_torque

    def values(self) -> dict[str, str | int | float]:
        """Return what /diagnostics shows of it."""
        force, moment = self._felt() if self.wrenches else ("unknown", "unknown")
        return {"contact force [N]": force, "contact moment [Nm]": moment}

    def tare(self, scheme: ImpedanceControl | None) -> tuple[Array, Array]:
        """Take the mean of the last wrenches for no contact, also in a scheme that is active.

        Return it, and the standard deviations, (6,) [N, Nm] about the tip, in its axes.  Raises
        ConfigurationError if too few have come, or the arm moves, or touches something.
        """
        chain, wrenches, wanted = self.chain, self.wrenches, self._parameters.tare_samples
        if len(wrenches) < wanted:
            raise ConfigurationError(
                f"{wanted - len(wrenches)} more valid wrenches are needed, {wanted} in all "
                "(tare_samples)"
            )
        if not is_still(wrenches):
            raise ConfigurationError("the arm moves; hold it still")
        felt, spread = mean_felt(chain, wrenches), np.std([w for (w, _), _, _ in wrenches], axis=0)
        if scheme is None:
            self._refuse_bias(*norms(felt))
        else:
            self._refuse_contact(*norms(felt - chain.tared))
        (scheme or chain).tare(felt)
        return felt, spread

    def _refuse_contact(self, force: float, torque: float) -> None:
        """Raise ConfigurationError if the tool of an arm that is controlled touches something."""
        if self._touches(force, torque):
            raise ConfigurationError(
                f"{force:.3g} N and {torque:.3g} Nm are felt while the arm is controlled, more "
                "than max_activation_force or max_activation_torque: does it touch something? "
                "Deactivate first if it does not"
            )

    def _refuse_bias(self, force: float, torque: float) -> None:
        """Raise ConfigurationError for a wrench that is no bias: the tool touches something."""
        p = self._parameters
        if force > p.max_tare_force or torque > p.max_tare_torque:
            raise ConfigurationError(
                f"{force:.3g} N and {torque:.3g} Nm are felt; at most max_tare_force "
                f"{p.max_tare_force:g} N and max_tare_torque {p.max_tare_torque:g} Nm are taken "
                "for no contact: does the tool touch something? is its weight declared "
                "(tool_mass)? else state wrench_bias"
            )


def norms(w: Array) -> tuple[float, float]:
    """Return the sizes [N], [Nm] of force and moment (6,)."""
    return float(np.linalg.norm(w[:3])), float(np.linalg.norm(w[3:]))
