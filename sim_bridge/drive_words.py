"""What /diagnostics says of a robot and its commands: sentences, made from mode and cause."""

from collections.abc import Callable
from dataclasses import dataclass

from sim_bridge.drive import DriveCause, DriveMode, DriveStatus

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
"""Levels of /diagnostics."""

Said = tuple[bytes, str, str]
"""Level, message and remedy."""

_COMMANDED = "commanded"
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

    def describe(self, status: DriveStatus) -> Said:
        """Return what to say of a status."""
        say: Callable[[DriveWords, DriveStatus], Said]
        say = _WORDS.get((status.mode, status.cause), _WORDS_OF_MODE[status.mode])
        level, message, remedy = say(self, status)
        if status.rejected:
            message += f"; commands are rejected: {status.rejected}"
            return max(level, WARN), message, remedy or "see what the controller sends"
        return level, message, remedy

    def _standby(self, _status: DriveStatus) -> Said:
        return OK, self.ready, ""

    def _obeying(self, _status: DriveStatus) -> Said:
        return OK, _COMMANDED, ""

    def _clipping(self, status: DriveStatus) -> Said:
        remedy = "keep the commands of the controller within the limits of the robot"
        return WARN, f"{_COMMANDED} beyond the limits: {status.clipped}", remedy

    def _silence(self, _status: DriveStatus) -> Said:
        remedy = "see whether the controller is alive and active; the next command is taken"
        return ERROR, f"no command for {self.timeout:g} s: braked", remedy

    def _stopping(self, status: DriveStatus) -> Said:
        message = f"protective stop: {status.violation}; braked, commands are refused until it "
        return ERROR, message + "stands", _FIND_OUT

    def _stopped(self, status: DriveStatus) -> Said:
        message = f"stands after a protective stop: {status.violation}"
        return ERROR, message, f"{_FIND_OUT}; the next command is taken"

    def _contested(self, status: DriveStatus) -> Said:
        count = status.names.count
        each = [f"{name} {count(name)} times" if count(name) > 1 else name
                for name in dict.fromkeys(status.names)]  # fmt: skip
        message = f"two controllers send on '{self.topic}', whose publishers are {', '.join(each)}"
        remedy = "stop or deactivate one of them; the commands of the other are taken then"
        return ERROR, f"{message}; braked, both are refused", remedy

    def _settled(self, _status: DriveStatus) -> Said:
        return WARN, "braked until the next command: one of two controllers has gone", ""

    def _shut_down(self, _status: DriveStatus) -> Said:
        return ERROR, "ending: braked", ""

    def _ended(self, status: DriveStatus) -> Said:
        return (ERROR, status.text, "") if status.text else (OK, "ended", "")


_WORDS_OF_MODE = {
    DriveMode.STANDBY: DriveWords._standby,
    DriveMode.OBEYING: DriveWords._obeying,
    DriveMode.BRAKED: DriveWords._settled,
    DriveMode.STOPPING: DriveWords._stopping,
    DriveMode.CONTESTED: DriveWords._contested,
    DriveMode.ENDED: DriveWords._ended,
}
_WORDS = {
    (DriveMode.OBEYING, DriveCause.CLIPPED): DriveWords._clipping,
    (DriveMode.BRAKED, DriveCause.SILENCE): DriveWords._silence,
    (DriveMode.BRAKED, DriveCause.PROTECTIVE_STOP): DriveWords._stopped,
    (DriveMode.ENDED, DriveCause.SHUTDOWN): DriveWords._shut_down,
}
