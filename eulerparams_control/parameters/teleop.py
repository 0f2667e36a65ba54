"""Parameters of the node ``teleop``."""

from dataclasses import dataclass

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.fields import parameter

KEYBOARD, JOY = "keyboard", "joy"
NONE = -1


@dataclass(frozen=True)
class TeleopParameters:
    """Parameters of the node ``teleop``."""

    device: str = parameter(KEYBOARD, "what moves the tip", choices=(KEYBOARD, JOY))
    frame: str = parameter("", "link whose axes the twist is in; empty: the base frame")
    linear_speed: float = parameter(
        0.1, "at full deflection, or of a key", unit="m/s", bounds=(1e-3, 1.0)
    )
    angular_speed: float = parameter(
        0.4, "at full deflection, or of a key", unit="rad/s", bounds=(1e-3, 4.0)
    )
    key_timeout: float = parameter(
        0.1, "a key moves the tip for, until it repeats", unit="s", bounds=(0.02, 1.0)
    )
    joy_timeout: float = parameter(
        0.2, "silence of the device that stops the tip", unit="s", bounds=(0.02, 1.0)
    )
    axes: tuple[int, ...] = parameter(
        (1, 0, 4, NONE, NONE, 3),
        "of joy, for x, y, z and the turns about them; -1: none",
        bounds=(NONE, 99),
    )
    signs: tuple[float, ...] = parameter(
        (1.0, 1.0, 1.0, 1.0, 1.0, 1.0), "of these axes, or scales", bounds=(-1.0, 1.0)
    )
    deadman: int = parameter(4, "button of joy that has to be pressed", bounds=(0, 99))
    deadzone: float = parameter(0.05, "deflection that counts as none", bounds=(0.0, 0.9))

    def __post_init__(self) -> None:
        """Raise ConfigurationError unless there are six axes and signs."""
        for name in ("axes", "signs"):
            if len(getattr(self, name)) != 6:
                raise ConfigurationError(
                    f"{name} has {len(getattr(self, name))} values; expected 6: for x, y, z and "
                    "the turns about them"
                )
