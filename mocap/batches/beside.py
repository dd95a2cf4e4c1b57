"""Trials of a batch beside each other: the facts of each, and what the others of its session tell of it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mocap.audit.across import TrialFacts, compared
from mocap.batches.trial import Trial
from mocap.cleaning.trial_audit import looked_at
from mocap.errors import MocapError
from mocap.findings import Finding
from mocap.reading.session import facts_of
from mocap.side_by_side import Hear


def facts_here(trial: Trial, *, progress: Hear | None = None) -> TrialFacts | None:
    """In a process: the facts of a trial; None: it cannot be read, which tracking tells.

    Args:
        trial: It.
        progress: Told once what is done.
    """
    if progress is not None:
        progress("comparing it with the others")
    try:
        return facts_of(trial.recording(), name=trial.name)
    except (MocapError, OSError):
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """What a look at a trial shows, before it is tracked.

    Attributes:
        columns: What a manifest tells of it.
        facts: What it is compared with others by; None: it cannot be read.
        findings: What is found in its files, in the order of all commands.
        refused: Why it cannot be tracked; empty: it can, as far as its files tell.
    """

    columns: Mapping[str, object] = field(default_factory=dict)
    facts: TrialFacts | None = None
    findings: tuple[Finding, ...] = ()
    refused: str = ""


def seen_here(trial: Trial, *, progress: Hear | None = None) -> Seen:
    """In a process: what a look at a trial shows."""
    del progress
    looked = looked_at(trial.recording)
    found = looked.recording
    if looked.refused is not None or found is None:
        return Seen(findings=looked.findings, refused=" ".join(str(looked.refused).split()))
    unit = found.data.attrs.get("space_unit")
    columns = {
        "frames": len(found.t_s),
        "markers": len(found.names),
        "cameras": len(found.camera_names),
        "note": f"{found.format}, {found.fps:g} frames a second" + (f", {unit}" if unit else ""),
    }
    return Seen(columns=columns, facts=facts_of(found, name=trial.name), findings=looked.findings)


def told_by_siblings(trials: Sequence[Trial], facts: Mapping[str, TrialFacts]) -> dict[str, list[Finding]]:
    """What is odd of each trial beside the others of its session, by its name.

    A session are trials of one calibration, or of none that is stated; a trial may differ in what is stated for it
    and not for most.

    Args:
        trials: All of them.
        facts: What is known of them, by name.
    """
    here = [trial for trial in trials if trial.name in facts]
    found: dict[str, list[Finding]] = {}
    for session in dict.fromkeys(map(_session, here)):
        some = [trial for trial in here if _session(trial) == session]
        own = _stated_alone(some)
        found |= compared(
            [
                replace(facts[one.name], name=one.name, session=session, animal=one.animal, stated=own[one.name])
                for one in some
            ]
        )
    return found


def _session(trial: Trial) -> str:
    return str(trial.arguments.get("calibration", ""))


def _stated_alone(trials: Sequence[Trial]) -> dict[str, tuple[str, ...]]:
    """Arguments that are stated of each trial, and otherwise or not of most."""
    count = Counter((key, _word(value)) for trial in trials for key, value in trial.arguments.items())
    return {
        trial.name: tuple(
            key
            for key, value in trial.arguments.items()
            if 2 * count[key, _word(value)] <= len(trials) and key != "edits"
        )
        for trial in trials
    }


def _word(value: Any) -> str:
    return str(value)


def kinds_of(findings: Sequence[Finding]) -> tuple[str, ...]:
    """What a trial differs in, in a word each: the same however many others there are."""
    return tuple(sorted({one.text.partition(":")[0] for one in findings}))
