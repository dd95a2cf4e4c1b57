"""``mocap batch``."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.text import Text

from mocap.cli.console import errors, program, say, show_text, typed, visible
from mocap.cli.options import AsJson, BatchTracking, LimitS, RecordingOptions, with_records
from mocap.progress import in_words
from mocap.text import number_of

if TYPE_CHECKING:
    from mocap.batches.plan import Plan
    from mocap.batches.run import Progress

MOST = 10
"""Reasons why trials were not tracked that are printed."""


@with_records
def batch(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="FOLDER", help="Folders with trials, patterns in quotes ('data/**/*.c3d'), or a manifest (.csv)."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of results: one folder per trial, summary.csv, summary.html.")],
    recording_options: RecordingOptions,
    tracking: BatchTracking,
    jobs: Annotated[int, typer.Option(min=1, help="Trials that are tracked at a time, each by a process.")] = 2,
    shard: Annotated[
        str | None, typer.Option(help="i/n: every n-th trial, from the i-th (from 1), as for an array of SLURM jobs.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler that runs, as tcp://HOST:8786. It does what anybody asks who reaches it: "
            "all of its network must be trusted."
        ),
    ] = None,
    memory: Annotated[
        str | None, typer.Option(help="Memory limit of a process, as 2GB; if not given, its part of the machine's.")
    ] = None,
    limit_s: LimitS = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only write the manifest of the trials found, to be corrected.")
    ] = False,
    pictures: Annotated[
        bool, typer.Option("--pictures", help="Write figures, report.html and recording.rrd of each trial, too.")
    ] = False,
    again: Annotated[bool, typer.Option("--again", help="Track all trials, also those that have been.")] = False,
    as_json: AsJson = False,
) -> None:
    """Track every trial below a folder as mocap track does, and continue past failures; run again, it resumes.

    Options hold for all trials; a manifest (--dry-run writes one) states them for each.

    Example: mocap batch data/ --calibration data/dltCoefs.csv --fps 500 --skeleton bat.toml --out out/season
    """
    from mocap.side_by_side import context_of

    if scheduler is None:
        context_of("mocap.batches.find" if dry_run else "mocap.batches.worker")  # it imports while this process does
    import mocap
    from mocap.batches.plan import planned, write_plan
    from mocap.batches.summary import as_json as records_as_json
    from mocap.batches.summary import reasons, worst_first

    stated = recording_options.arguments()
    if dry_run:
        plan = planned(sources, out=out, limit_s=limit_s, **stated)
        path = write_plan(plan, out)
        say(*plan_lines(plan))
        say(
            f"Wrote {path}: one row per trial; columns skip, note and wrong: what cannot be tracked, and what is wrong",
            f"Correct it in a spreadsheet, then: {typed(*program(), 'batch', path)} --out RESULTS",
        )
        return
    if scheduler is not None and not scheduler.startswith("tls:"):
        say(f"Whoever reaches {scheduler} can run programs as you: use it in a network that is trusted, or with TLS")
    with _watching() as tell:
        found = mocap.batch(
            sources,
            out,
            jobs=jobs,
            shard=shard,
            scheduler=scheduler,
            memory=memory,
            limit_s=limit_s,
            again=again,
            pictures=pictures,
            progress=tell,
            **asdict(tracking),
            **stated,
        )
    own = [record for record in found.records if record.trial in found.own]
    wrong = [
        f"{status}: {reason}"
        for status in ("failed", "skipped")
        for reason in reasons({record.trial: record.error for record in own if record.status == status})
    ]
    if as_json:
        print(records_as_json(found.records))  # noqa: T201
    else:
        show_text(f"Result: {out}/ (summary.html, in a browser; summary.csv)\n{found.report_text}")
    warned = [f"{one.trial}: {one.row['warning']}" for one in worst_first(own) if one.row.get("warning")]
    if warned:
        say(f"{len(warned)} of {len(own)} trials have warnings (summary.csv, column warning):", *warned[:MOST])
    say(*wrong[:MOST], *([f"{len(wrong) - MOST} more reasons: summary.csv"] if len(wrong) > MOST else []))
    if own and not any(record.status == "done" for record in own):
        raise typer.Exit(1)


def plan_lines(plan: "Plan", *, most: int = MOST) -> list[str]:
    """Which trials cannot be tracked, and what is wrong with the others; only where that is nothing they are sound."""
    from mocap.batches.summary import reasons

    total, lines = number_of(len(plan.trials), "trial"), []
    if plan.untracked:
        lines.append(f"{len(plan.untracked)} of {total} cannot be tracked: {'; '.join(reasons(plan.untracked))}")
    if wrong := plan.wrong:
        lines.append(f"Something is wrong with {len(wrong)} of {total}, worst first:")
        for name, texts in list(wrong.items())[:most]:
            lines += [f"{name}:", *(f"  {number}. {text}" for number, text in enumerate(texts, start=1))]
        lines += [f"{len(wrong) - most} more"] if len(wrong) > most else []
    if not plan.untracked and not wrong:
        lines.append(f"all {total} can be tracked, as far as their files tell")
    return lines


def describe_folder(sources: list[str], *, as_json: bool, **arguments: Any) -> None:
    """What ``mocap info`` tells of folders: each trial, what is found in it, and what the others tell of it."""
    from mocap.batches.plan import planned
    from mocap.findings import listed

    plan = planned(sources, **{name: value for name, value in arguments.items() if value is not None})
    if as_json:
        found = [
            {
                "trial": trial.name,
                "files": [str(path) for path in trial.paths],
                "refused": plan.untracked.get(trial.name),
                **plan.columns[trial.name],
                "audit": [one.as_json() for one in plan.findings.get(trial.name, ())],
            }
            for trial in plan.trials
        ]
        print(json.dumps(found, allow_nan=False))  # noqa: T201
        return
    for trial in sorted(plan.trials, key=lambda one: -len(plan.wrong.get(one.name, ()))):
        lines = [f"{trial.name}: {plan.columns[trial.name]['note']}"]
        if trial.name in plan.untracked:
            lines.append(f"  cannot be tracked: {plan.untracked[trial.name]}")
        elif trial.name in plan.findings:
            lines += listed(plan.findings[trial.name])
        show_text("\n".join([*lines, ""]))
    show_text(plan_lines(plan)[0])


@contextmanager
def _watching() -> Iterator[Callable[["Progress"], None]]:
    """Trials done, time left, what each worker does: live on a terminal, else a line now and then."""
    if not errors.is_terminal:
        yield _Lines()
        return
    with Live(console=errors, refresh_per_second=4, transient=True) as live:

        def tell(progress: "Progress") -> None:
            workers = [Text(visible(f"  {name}  {doing}")) for name, doing in sorted(progress.workers.items())]
            bar = ProgressBar(total=max(progress.total, 1), completed=progress.done, width=40)
            live.update(Group(Text(_line(progress)), bar, *workers))

        yield tell


class _Lines:
    """A line every so often, as for a log: what has ended, and what workers do; none twice."""

    def __init__(self) -> None:
        self.at_s, self.said = monotonic(), ""

    def __call__(self, progress: "Progress") -> None:
        doing = [visible(does) for _, does in sorted(progress.workers.items())]
        line = "; ".join([_line(progress), *doing])
        if monotonic() - self.at_s >= 10.0 and line != self.said:
            self.at_s, self.said = monotonic(), line
            say(line)


def _line(progress: "Progress") -> str:
    """``12 of 100 trials done (3 before this run, 1 failed), about 3 min left``."""
    counts = [f"{progress.before} before this run"] if progress.before else []
    counts += [f"{progress.failed} failed"] if progress.failed else []
    left = "" if progress.left_s is None else f", about {in_words(progress.left_s)} left"
    more = f" ({', '.join(counts)})" if counts else ""
    return f"{progress.done} of {progress.total} trials done{more}{left}"
