"""What is known of runs that were made before, so that they need not be made again.

``logs/VARIANT/run.json`` beside the bag VARIANT says what the run was made of, and how it ended.
It is written before a node starts: a bag beside it is ours, whole or not.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eulerparams_control.catalogue import load_robot
from eulerparams_control.errors import BagError
from eulerparams_control.experiments.model import Parameters, Variant
from eulerparams_control.experiments.sources import code_of_runs, digest

_BAG_FILES = ("metadata.yaml", "*.mcap")  # what the recorder writes


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
    """What a run is made of.

    Attributes:
        definition: version of the parameters of all nodes, and of the robot.
        code: version of what acts on a run.
    """

    definition: str
    code: str

    @classmethod
    def of(cls, settings: Variant, parameters: Parameters) -> "Making":
        """Return that of a variant, whose nodes have these parameters."""
        urdf = load_robot(settings.robot).urdf
        said = [parameters, settings.duration, settings.controller, settings.may_diverge, urdf]
        return cls(digest(said), code_of_runs())

    def differs(self, before: "Making") -> str:
        """Return what has changed since, in words; "" if nothing."""
        changed = [
            what
            for what, now, then in (
                ("its definition", self.definition, before.definition),
                ("the code", self.code, before.code),
            )
            if now != then
        ]
        return " and ".join(changed)


class Record:
    """What is written of one variant of an experiment.

    Args:
        folder: of the experiment.
        variant: its name.
    """

    def __init__(self, folder: Path, variant: str) -> None:
        self.bag = folder / variant
        self.path = folder / "logs" / variant / "run.json"

    def begin(self, making: Making) -> None:
        """Write what a run that starts now is made of."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._write({"making": asdict(making)})

    def end(self, making: Making, run: Run) -> None:
        """Write how the run ended, and that its bag is whole."""
        ended = {"duration": run.duration, "diverged": run.diverged, "seconds": run.seconds}
        self._write({"making": asdict(making), "ended": ended, "bytes": _size(self.bag)})

    def _write(self, content: dict[str, Any]) -> None:
        new = self.path.with_suffix(".new")
        new.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        new.replace(self.path)  # whole, or not at all

    def finished(self) -> tuple[Making, Run] | None:
        """Return the run whose whole bag is there, and what it was made of; None if none is."""
        content = self._read()
        try:
            making, ended = Making(**content["making"]), content["ended"]
            run = Run(self.bag, ended["duration"], ended["diverged"], ended["seconds"])
            return (making, run) if content["bytes"] == _size(self.bag) else None
        except (KeyError, TypeError):
            return None

    def clear(self) -> None:
        """Remove the bag of a run before, if it is ours; nothing if there is none.

        Raises:
            BagError: if it is not known to be ours, or holds what no recorder wrote.
        """
        if not self.bag.exists():
            return
        if "making" not in self._read():
            raise BagError(f"{self.bag} exists; remove it, or choose another --out")
        for pattern in _BAG_FILES:
            for file in self.bag.glob(pattern):
                file.unlink()
        try:
            self.bag.rmdir()
        except OSError as error:
            found = ", ".join(sorted(path.name for path in self.bag.iterdir()))
            raise BagError(
                f"{self.bag} holds what no recorder wrote: {found}; move it away"
            ) from error

    def _read(self) -> dict[str, Any]:
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}


def _size(bag: Path) -> int:
    """Return the bytes of the files of a bag."""
    return sum(file.stat().st_size for pattern in _BAG_FILES for file in bag.glob(pattern))
