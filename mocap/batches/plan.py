"""What a batch would track: its trials looked at and compared, and the manifest of them; nothing is tracked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mocap.batches.beside import Seen, seen_here, told_by_siblings
from mocap.batches.find import PLAN, PRELOAD, find_trials, limit_of_look, why_not_read
from mocap.batches.trial import Trial, write_manifest
from mocap.findings import Finding, alarms, worst_first
from mocap.io.output import result_file
from mocap.side_by_side import Lost, opened


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What would be tracked.

    Attributes:
        trials: All of them.
        untracked: Why some of them cannot be tracked, by name.
        findings: What is found in those that can be read, and what the others tell of them, in the order of all
            commands.
        columns: What a manifest tells of each, by its name.
    """

    trials: tuple[Trial, ...]
    untracked: Mapping[str, str]
    findings: Mapping[str, Sequence[Finding]]
    columns: Mapping[str, dict[str, object]]

    @property
    def wrong(self) -> dict[str, list[str]]:
        """What is wrong with trials that can be tracked, worst first; trials with most of it first."""
        found = {
            name: [" ".join(one.text.split()) for one in alarms(of)]
            for name, of in self.findings.items()
            if name not in self.untracked
        }
        return dict(sorted(((k, v) for k, v in found.items() if v), key=lambda one: -len(one[1])))


def planned(
    sources: Sequence[str | Path], *, out: Path | None = None, limit_s: float | None = None, **arguments: Any
) -> Plan:
    """Find trials as ``mocap.batch`` does, read each, and compare them.

    Args:
        sources: As ``mocap.batch`` takes them.
        out: A folder of results, in which no trials are looked for.
        limit_s: Seconds that reading a trial may take at most; None: by its size.
        **arguments: Arguments of ``mocap.read`` for all trials.

    Raises:
        MocapError: no trial was found.
    """
    with opened(1, preload=PRELOAD) as pool:
        trials = find_trials(sources, arguments=arguments, out=out, pool=pool, limit_s=limit_s)
        errors = {trial.name: trial.skip for trial in trials if trial.skip}
        columns: dict[str, dict[str, object]] = {name: {"note": "not tracked"} for name in errors}
        limits = {trial.name: limit_of_look(*trial.paths, limit_s=limit_s) for trial in trials}
        calls = {trial.name: partial(seen_here, trial) for trial in trials if not trial.skip}
        found: dict[str, Seen] = {}
        for name, went in pool.each(calls, limit_s=limits.__getitem__):
            error = went.exception()
            trouble = why_not_read(error, limits[name]) if isinstance(error, Lost) else error
            if trouble is None:
                found[name] = went.result()
                columns[name], trouble = dict(found[name].columns), found[name].refused or None
            if trouble is not None:
                errors[name] = " ".join(str(trouble).split())
                columns[name] = {"note": errors[name]}
    told = told_by_siblings(trials, {name: one.facts for name, one in found.items() if one.facts is not None})
    plan = Plan(
        trials=tuple(trials),
        untracked={trial.name: errors[trial.name] for trial in trials if trial.name in errors},
        findings={name: worst_first([*told.get(name, ()), *one.findings]) for name, one in found.items()},
        columns=columns,
    )
    for name, texts in plan.wrong.items():
        columns[name]["wrong"] = " | ".join(texts)
    return plan


def write_plan(plan: Plan, out: Path) -> Path:
    """Write the manifest of a plan.

    Args:
        plan: It.
        out: The file (``.csv``), or a folder, in which it is called ``manifest.csv``.

    Returns:
        The file.

    Raises:
        MocapError: it cannot be written.
    """
    path = out if out.suffix.lower() == ".csv" else out / PLAN
    files = [file for trial in plan.trials for file in trial.paths]
    with result_file(path, replace=True, inputs=files) as file:
        write_manifest(
            file, plan.trials, folder=path.parent, columns=[plan.columns[trial.name] for trial in plan.trials]
        )
    return path
