"""Results of a campaign: what came of each sequence, a page for people and a file for programs."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eulerparams_control.analysis.checks import speed_of_limit
from eulerparams_control.analysis.html import write_html
from eulerparams_control.lab.campaign.oracles import Oracle, Violation, judge
from eulerparams_control.lab.campaign.plan import CONTROLLERS, SequencePlan, faults_of
from eulerparams_control.lab.campaign.record import ERROR, STOPS, SequenceRecord


@dataclass(frozen=True)
class SequenceOutcome:
    """Outcome of a sequence.

    Attributes:
        plan: the sequence.
        violations: what must not be, in the order of time.
        error: why it could not be run; "" if it could.
        digest: hash of all commands.
        duration: [s] of the sequence.
        seconds: [s] that it took.
        commands: how many.
        troubled: [s] in which the controller said that something is wrong.
        tip_error: [m], [deg] at the end.
        peak_speed: of a joint of the arm, as a part of its limit.
        stops: how many protective stops the simulated robot made.
        story: what was done and said, with the times [s].
    """

    plan: SequencePlan
    violations: tuple[Violation, ...] = ()
    error: str = ""
    digest: str = ""
    duration: float = 0.0
    seconds: float = 0.0
    commands: int = 0
    troubled: float = 0.0
    tip_error: tuple[float, float] = (0.0, 0.0)
    peak_speed: float = 0.0
    stops: int = 0
    story: tuple[str, ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether it was run, and nothing was found."""
        return not self.error and not self.violations

    @property
    def faults(self) -> list[str]:
        """The names of its faults."""
        return [fault.name for fault in faults_of(self.plan)]

    def as_json(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        plan = self.plan
        return {
            "controller": plan.controller,
            "seed": plan.seed,
            "repeat": plan.repeat,
            "kind": plan.kind,
            "motion": plan.motion,
            "robot": asdict(plan.robot),
            "stream": asdict(plan.stream),
            "parameters": plan.parameters(),
            "faults": [str(fault) for fault in faults_of(plan)],
            "violations": [violation._asdict() for violation in self.violations],
            "error": self.error,
            "commands": self.commands,
            "commands_sha256": self.digest,
            "duration": self.duration,
            "seconds": round(self.seconds, 3),
            "troubled": self.troubled,
            "peak_speed_of_limit": round(self.peak_speed, 4),
            "protective_stops": self.stops,
            "tip_error": {"m": self.tip_error[0], "deg": self.tip_error[1]},
            "story": list(self.story),
        }


def look(plan: SequencePlan, record: SequenceRecord, seconds: float) -> SequenceOutcome:
    """Return the outcome of a sequence from its record."""
    speeds = speed_of_limit(np.array([truth.dq for truth in record.truth]), record.limits)
    return SequenceOutcome(
        plan,
        violations=tuple(judge(record)),
        digest=record.digest(),
        duration=record.end,
        seconds=seconds,
        commands=len(record.commands),
        troubled=_troubled(record),
        tip_error=record.tip_error,
        peak_speed=float(speeds.max()),
        stops=sum(event.what == STOPS for event in record.events),
        story=_story(record),
    )


def _troubled(record: SequenceRecord) -> float:
    """Return for how long [s] the controller said that something is wrong."""
    ends = [*(said.t for said in record.said[1:]), record.end]
    pairs = zip(record.said, ends, strict=False)
    return round(sum(end - said.t for said, end in pairs if said.level == ERROR), 6)


def _story(record: SequenceRecord) -> tuple[str, ...]:
    """Return the events and messages, each once per change."""
    lines, last = [], ""
    for t, text in sorted(
        [(event.t, event.what) for event in record.events]
        + [(said.t, f"says: {said.message}") for said in record.said],
        key=lambda pair: pair[0],
    ):
        if text != last:
            lines.append(f"{t:.3f} s: {text}")
        last = text if text.startswith("says") else last
    return tuple(lines)


def count_by_oracle(outcomes: Sequence[SequenceOutcome]) -> Counter[str]:
    """Return in how many sequences each oracle found something."""
    return Counter(name for o in outcomes for name in {v.oracle for v in o.violations})


def headline(outcomes: Sequence[SequenceOutcome]) -> str:
    """Return the result of a campaign in one sentence."""
    failed = [o for o in outcomes if o.violations]
    lost = sum(bool(o.error) for o in outcomes)
    commands = sum(o.commands for o in outcomes)
    faults = sum(len(o.faults) for o in outcomes)
    text = (
        f"{len(outcomes)} random fault sequences with {faults} faults and {commands:,} commands: "
        f"{sum(len(o.violations) for o in failed)} violations in {len(failed)} sequences"
    )
    return text + (f"; {lost} could not be run" if lost else "")


def write_summary(path: Path, outcomes: Sequence[SequenceOutcome]) -> None:
    """Write all outcomes as JSON."""
    found = count_by_oracle(outcomes)
    content = {
        "sentence": headline(outcomes),
        "met": all(outcome.is_good for outcome in outcomes),
        "protective_stops": sum(outcome.stops for outcome in outcomes),
        "oracles": {
            name: {"claim": kind.claim, "sequences_with_a_violation": found[name]}
            for name, kind in Oracle.registry.items()
        },
        "sequences": [outcome.as_json() for outcome in outcomes],
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def write_page(path: Path, outcomes: Sequence[SequenceOutcome]) -> None:
    """Write the page; it loads nothing."""
    found = count_by_oracle(outcomes)
    write_html(
        path,
        "campaign.html",
        headline=headline(outcomes),
        outcomes=outcomes,
        faults_of=faults_of,
        oracles=[(name, kind.claim, found[name]) for name, kind in Oracle.registry.items()],
        faults={
            name: _with(name, outcomes) for name in sorted({n for o in outcomes for n in o.faults})
        },
        controllers=CONTROLLERS,
    )


def _with(fault: str, outcomes: Sequence[SequenceOutcome]) -> list[tuple[int, int]]:
    """Return for each controller its sequences with a fault, and those of them that failed."""
    some = [
        [o for o in outcomes if o.plan.controller == c and fault in o.faults] for c in CONTROLLERS
    ]
    return [(len(mine), sum(not outcome.is_good for outcome in mine)) for mine in some]
