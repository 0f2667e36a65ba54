"""Sentences of /diagnostics on a robot and its commands, made from mode and cause."""

from dataclasses import dataclass

from eulerparams_control.errors import listed
from sim_bridge.drive_modes import DriveCause, DriveMode, DriveStatus

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
"""Levels of /diagnostics."""

UNLOCK = "~/unlock"
"""The service by which a robot leaves a stop that does not end by itself."""

_FIND_OUT = "find out what made it do this: the controller, a push or a contact"


@dataclass(frozen=True)
class DriveWords:
    """Says in words what a robot does.

    Attributes:
        ready: what to say of a robot that waits for its first command.
        topic: of the commands.
        timeout: without commands [s].
    """

    ready: str
    topic: str
    timeout: float

    def describe(self, status: DriveStatus) -> tuple[bytes, str, str]:
        """Return level, message and remedy of a status."""
        level, message, remedy = self._describe(status)
        if status.rejected:
            message += f"; commands are rejected: {status.rejected}"
            return max(level, WARN), message, remedy or "see what the controller sends"
        return level, message, remedy

    def _describe(self, status: DriveStatus) -> tuple[bytes, str, str]:
        match status.mode, status.cause:
            case DriveMode.STANDBY, _:
                return OK, self.ready, ""
            case DriveMode.OBEYING, DriveCause.CLIPPED:
                remedy = "keep the commands of the controller within the limits of the robot"
                return WARN, f"commanded beyond the limits: {status.clipped}", remedy
            case DriveMode.OBEYING, _:
                return OK, "commanded", ""
            case DriveMode.BRAKED, DriveCause.SILENCE:
                remedy = "see whether the controller is alive and active; the next command is taken"
                return ERROR, f"no command for {self.timeout:g} s: braked", remedy
            case DriveMode.STOPPING, DriveCause.ACCELERATION:
                refuses = f"commands are refused until {UNLOCK} is called"
                words = f"protective stop: {status.violation}; {refuses}"
                return ERROR, words, f"let the controller ask for less, then call {UNLOCK}"
            case DriveMode.STOPPING, _:
                rest = "braked, commands are refused until it is at rest"
                return ERROR, f"protective stop: {status.violation}; {rest}", _FIND_OUT
            case DriveMode.BRAKED, DriveCause.PROTECTIVE_STOP | DriveCause.ACCELERATION:
                remedy = f"{_FIND_OUT}; the next command is taken"
                return ERROR, f"at rest after a protective stop: {status.violation}", remedy
            case DriveMode.CONTESTED, _:
                remedy = "stop or deactivate one of them; the commands of the other are taken then"
                return ERROR, self._contested(status.names), remedy
            case DriveMode.BRAKED, _:
                return WARN, "braked until the next command: one of two controllers has gone", ""
            case _, DriveCause.SHUTDOWN:
                return OK, "ending: braked", ""
            case _, DriveCause.FINISHED:
                return OK, "ended", ""
            case _:
                return ERROR, status.text or f"ended; it was braked: {status.cause.value}", ""

    def _contested(self, names: tuple[str, ...]) -> str:
        return (
            f"two controllers send on '{self.topic}', whose publishers are {listed(names)}; "
            "braked, both are refused"
        )
