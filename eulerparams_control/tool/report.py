"""The report on an identified tool: a table, warnings, and parameters of controllers."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from eulerparams_control.laws.rotations import Array
from eulerparams_control.tool.identification import Identification
from eulerparams_control.tool.mount import Carried, SensorMount
from eulerparams_control.tool.poses import Pose

_CERTAIN = 5.0  # standard deviations of an average: what it is off by more is no noise
_LEAST_MASS = 1e-3  # [kg] that a tool has


class ToolReport(NamedTuple):
    """What was found, and from what.

    Attributes:
        found: the result.
        poses: from which it comes.
        mount: of the sensor.
        wrench_sign: with which the wrenches were multiplied first.
        max_residual_force: [N] accuracy of the sensor: what is left unexplained in a pose.
        max_residual_torque: [Nm] the same.
    """

    found: Identification
    poses: Sequence[Pose]
    mount: SensorMount
    wrench_sign: int = 1
    max_residual_force: float = 0.5
    max_residual_torque: float = 0.05

    @property
    def tool(self) -> Carried:
        """What the URDF lacks, mass [kg] and centre of mass (3,) [m] in the tip frame."""
        tool = Carried(self.found.mass, self.found.com).without(self.mount.carried)
        if tool.mass <= max(_LEAST_MASS, 3 * self.found.mass_std):
            return Carried(0.0, np.zeros(3))
        return Carried(tool.mass, self.mount.in_tip(tool.com))

    def warnings(self) -> list[str]:
        """Return what may be wrong with it, each in a sentence."""
        return [*self._misfits(), *self._weight_of_the_urdf()]

    def _misfits(self) -> Iterator[str]:
        """Yield what does not fit into one tool and one bias."""
        std = np.array([pose.wrench_std for pose in self.poses])
        for what, unit, residual, noise, most in (
            ("force", "N", self.found.residual_force, std[:, :3], self.max_residual_force),
            ("torque", "Nm", self.found.residual_torque, std[:, 3:], self.max_residual_torque),
        ):
            worst = int(np.argmax(residual))
            bound = max(most, _CERTAIN * float(np.linalg.norm(noise[worst])))
            if residual[worst] > bound:
                yield (
                    f"pose {worst + 1} leaves {residual[worst]:.3g} {unit} of {what} unexplained, "
                    f"more than {bound:.3g} {unit}: does the tool touch something there, or does a "
                    f"cable pull? Else max_residual_{what} is less than the sensor's accuracy"
                )

    def _weight_of_the_urdf(self) -> Iterator[str]:
        """Yield that the URDF knows some of what the sensor feels."""
        known = self.mount.carried.mass
        if known > 0:
            yield (
                f"the URDF has {known:.3g} kg beyond the sensor; tool_mass and tool_com are what "
                "comes on top of it"
            )
        if self.found.mass - known < -max(_LEAST_MASS, 3 * self.found.mass_std):
            yield (
                f"the URDF has more beyond the sensor than the {self.found.mass:.4g} kg measured; "
                "correct its inertials"
            )

    def table(self) -> str:
        """Return the result as a table for a terminal."""
        found, sensor = self.found, self.mount.frame
        rows = (
            ("", "", "+-"),
            ("mass [kg]", f"{found.mass:.4f}", f"{found.mass_std:.4f}"),
            (f"centre of mass in {sensor} [mm]", *_rows(1e3 * found.com, 1e3 * found.com_std, 2)),
            ("bias of the force [N]", *_rows(found.bias[:3], found.bias_std[:3], 3)),
            ("bias of the torque [Nm]", *_rows(found.bias[3:], found.bias_std[3:], 4)),
            ("unexplained force [N]", _worst(found.residual_force), ""),
            ("unexplained torque [Nm]", _worst(found.residual_torque), ""),
            ("difference of the poses [deg]", f"{np.degrees(found.spread):.0f}", ""),
        )
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = (f"{name:{widths[0]}}  {value:>{widths[1]}}  {std:>{widths[2]}}"
                 for name, value, std in rows)  # fmt: skip
        title = f"The tool and the sensor, from {len(self.poses)} poses"
        return "\n".join((title, *map(str.rstrip, lines)))

    def yaml(self) -> str:
        """Return the result as parameters: an overlay after the file of a controller."""
        found, mount, tool = self.found, self.mount, self.tool
        return (
            f"# found by identify_tool in {len(self.poses)} poses; give it as a further\n"
            "# --params-file after the one of the controller\n"
            "/**:\n"
            "  ros__parameters:\n"
            f"    tool_mass: {_digits(tool.mass)}  # [kg] +- {found.mass_std:.1g}\n"
            f"    tool_com: {_list(tool.com)}  # [m] in the tip frame {mount.tip_frame}\n"
            "/**/impedance_control:\n"
            "  ros__parameters:\n"
            f"    wrench_sign: {self.wrench_sign}\n"
            f"    # [N, Nm] in the sensor frame {mount.frame}: measured = true + bias\n"
            f"    wrench_bias: {_list(found.bias)}\n"
            f"{self._sensed()}"
        )

    def _sensed(self) -> str:
        """Return as parameters all that the sensor feels, where that is more than the tool."""
        if self.mount.carried.mass == 0:
            return ""
        com = self.mount.in_tip(self.found.com)
        return (
            f"    sensed_mass: {_digits(self.found.mass)}  # [kg] with what the URDF has\n"
            f"    sensed_com: {_list(com)}  # [m] in the tip frame {self.mount.tip_frame}\n"
        )


def _rows(values: Array, std: Array, digits: int) -> tuple[str, str]:
    return _line(values, digits), _line(std, digits)


def _line(values: Array, digits: int) -> str:
    return " ".join(f"{round(value, digits) + 0.0:.{digits}f}" for value in values.tolist())


def _worst(residual: Array) -> str:
    return f"{residual.max():.3g} in pose {int(np.argmax(residual)) + 1}"


def _digits(value: float) -> str:
    """Return a number with a point, as YAML needs it for one that is no integer."""
    return f"{round(value, 6) + 0.0:.6f}"


def _list(values: Array) -> str:
    return "[" + ", ".join(map(_digits, values.tolist())) + "]"
