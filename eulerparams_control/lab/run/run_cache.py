"""Cache of runs, so that they need not be repeated.

``run.json`` in the bag of a run says what the run was made of, and how it ended: a bag without it
is not ours.
"""

import contextlib
import fcntl
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eulerparams_control.analysis.quantities.real_time import USAGE
from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.lab.run.fingerprint import code_of_runs, digest
from eulerparams_control.robot.catalogue import load_robot

LOGS = "logs"
"""The folder beside the bags of the variants, with the logs of their nodes."""

_RECORD = "run.json"
_OLDER = ".run"  # which bags had instead
_NEW = ".new"  # suffix of a record that is not whole
_METADATA = "metadata.yaml"

_LOCK = ".lock"
_ADVICE = "remove it yourself, or choose another --out"


@dataclass(frozen=True)
class Run:
    """A run that has ended.

    Attributes:
        bag: its recording.
        duration: [s] of simulated time.
        diverged: [s] when it ended early; None if it did not.
        seconds: that it took.
    """

    bag: Path
    duration: float
    diverged: float | None
    seconds: float = 0.0


@dataclass(frozen=True)
class Making:
    """Versions of what a run is made of.

    Attributes:
        definition: version of the parameters of all nodes, and of the robot.
        code: version of what acts on a run.
    """

    definition: str
    code: str

    @classmethod
    def of(cls, settings: Sequence[Any], robot: str, faulty: bool) -> "Making":
        """Return the versions for a run with these settings."""
        said = [*settings, asdict(load_robot(robot))]
        return cls(digest(said), code_of_runs(faulty))

    def differs(self, before: "Making") -> str:
        """Return what has changed since then, in words; "" if nothing."""
        names = {"definition": "its definition", "code": "the code"}
        changed = [text for k, text in names.items() if getattr(self, k) != getattr(before, k)]
        return " and ".join(changed)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock an experiment's folder against other calls; the lock also ends with this process.

    Raises:
        ConfigurationError: if another call has it, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(folder / _LOCK, "wb")  # noqa: SIM115  # closed by the stack below
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ConfigurationError(
                f"another call of experiment writes to {folder}; wait for its end, or choose "
                "another --out"
            ) from error
        except OSError:
            pass  # a file system without locks
        yield


class RunRecord:
    """Record of a run of a variant of an experiment, in its bag.

    Args:
        folder: of the experiment.
        variant: its name.

    Attributes:
        bag: the bag.
        logs: folder of the logs of its nodes.
        path: of the record.
    """

    def __init__(self, folder: Path, variant: str) -> None:
        self.bag, self.logs = folder / variant, folder / LOGS / variant
        self.path = self.bag / _RECORD

    def claim(self, making: Making) -> None:
        """Write what the run is made of into the bag that the recorder has made, if there is."""
        if any(map(self._is_ours, self._entries())):
            with contextlib.suppress(OSError):  # a full disk: what filled it says so
                self._write({"making": asdict(making)})

    def end(self, making: Making, run: Run) -> None:
        """Write how the run ended, and that its bag is whole."""
        ended = {"duration": run.duration, "diverged": run.diverged, "seconds": run.seconds}
        self._write({"making": asdict(making), "ended": ended, "bytes": self._size()})

    def _write(self, content: dict[str, Any]) -> None:
        new = self.path.with_suffix(_NEW)
        new.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        new.replace(self.path)  # whole, or not at all

    def finished(self) -> tuple[Making, Run] | None:
        """Return the run whose complete bag exists, and its versions; None if there is none."""
        content = self._read()
        try:
            making, run = Making(**content["making"]), Run(self.bag, **content["ended"])
        except (KeyError, TypeError):
            return None
        return None if self._foreign(content) else (making, run)

    def clear(self) -> None:
        """Remove the bag of an earlier run, if there is one and it is ours.

        Raises:
            BagError: if it is not, was changed since, or holds what no recorder wrote.
        """
        if not (self.bag.exists() or self.bag.is_symlink()):
            return
        if why := self._foreign(self._read()):
            raise BagError(f"{self.bag} {why}; {_ADVICE}")
        others = [path.name for path in self._entries() if not self._is_ours(path)]
        if others:
            found = ", ".join(sorted(others))
            raise BagError(f"{self.bag} holds what no recorder wrote: {found}; move it away")
        for file in sorted(self._entries(), key=lambda path: path == self.path):  # the record last
            file.unlink()
        self.bag.rmdir()

    def _foreign(self, content: dict[str, Any]) -> str:
        """Return why the bag is not that of a run; "" if it is."""
        if self.bag.is_symlink():
            return "is a symbolic link, which no run has made"
        if not (content or (self.bag / _OLDER).is_file()):
            return "exists, and is not the bag of a run"
        if "ended" in content and content.get("bytes") != self._size():
            then = content.get("bytes")
            return f"was changed since its run: it had {then} bytes, and has {self._size()}"
        return ""

    def _entries(self) -> list[Path]:
        return list(self.bag.iterdir()) if self.bag.is_dir() else []

    def _is_ours(self, path: Path) -> bool:
        """Return whether a file has a name that the recorder, or we, give in this bag."""
        recorded = re.fullmatch(rf"{re.escape(self.bag.name)}_\d+\.mcap", path.name)
        own = (_RECORD, self.path.with_suffix(_NEW).name, _OLDER, _METADATA, USAGE)
        is_named = recorded or path.name in own
        return bool(is_named) and path.is_file() and not path.is_symlink()

    def _size(self) -> int:
        """Return the bytes of the files of the bag."""
        files = (path for path in self._entries() if path != self.path and path.is_file())
        return sum(file.stat().st_size for file in files)

    def _read(self) -> dict[str, Any]:
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}
