"""A batch: find the trials, learn from them where that is asked for, track what is missing, sum up."""

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import Any

import pandas as pd

from eal.threads import one_blas_thread
from mocap.batches.beside import facts_here, kinds_of, told_by_siblings
from mocap.batches.engine import Runner, engine, limit_of, why_lost
from mocap.batches.find import find_trials
from mocap.batches.one import basic_columns
from mocap.batches.summary import (
    ANGLES,
    COLUMNS,
    CYCLES,
    FIGURES,
    PEAKS,
    SUMMARY,
    TIMES,
    counted,
    read_times,
    read_together,
    summed,
    table,
    with_siblings,
    write_summary,
    write_times,
)
from mocap.batches.time_left import time_left
from mocap.batches.trial import Options, Record, Trial, earlier_record, keep, key_of, read_record, some, why_failed
from mocap.batches.worker import failed, track_here
from mocap.cameras.origin import OriginError
from mocap.cleaning.cleaning import clean
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError, MocapError, OutputError
from mocap.findings import Finding
from mocap.io.output import result_file
from mocap.progress import Stages, lines, silent
from mocap.reading.reading import of_session
from mocap.recording import Recording
from mocap.results.cycle_table import CycleTable, stored_table
from mocap.results.tracked import Tracked, load
from mocap.schema import Entry, checked
from mocap.side_by_side import Hear, Lost, NoProcess, Pool
from mocap.tracking.learning import Model, learn_from
from mocap.tracking.track_part import MODELS, existing_model

PathText = str | PathLike[str]
LEARN = "learn"
"""As a model: one is learned from all trials first."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a batch is.

    Attributes:
        done: Trials that have been finished, in this run or before.
        failed: Those of them that failed.
        before: Those of them that had been finished before.
        total: All trials of this run that are not skipped.
        left_s: Estimate of the seconds left; None: too early to say.
        workers: What each worker is doing, by its name.
        trials: What is done with each trial that is being tracked, by its name.
    """

    done: int
    failed: int
    before: int
    total: int
    left_s: float | None
    workers: Mapping[str, str]
    trials: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Batch:
    """What came of a batch.

    Attributes:
        out: The folder of results: that of each trial is that of its name below.
        records: How each trial went, in the order of their names; of a shard also those of other shards that are done.
        own: Names of the trials of this run.
    """

    out: Path
    records: tuple[Record, ...]
    own: tuple[str, ...] = field(default=())

    @property
    def table(self) -> pd.DataFrame:
        """A row a trial, as ``summary.csv`` has them."""
        return table(self.records)

    @property
    def cycles(self) -> CycleTable:
        """Wing beats, strides and waves of all trials: a row a cycle, with ``trial`` and ``animal``.

        ``batch.cycles.peaks("elbow_flexion_deg")`` is the peak, trough, range and mean of a quantity in each.
        """
        return stored_table(read_together(self.out / CYCLES), partial(read_together, self.out / PEAKS))

    @property
    def angles(self) -> pd.DataFrame:
        """The mean of each angle over each of these cycles, in degrees (``mocap.kinematics.cycles.mean_angles``)."""
        return read_together(self.out / ANGLES)

    def trial(self, name: str) -> Tracked:
        """The result of a trial.

        Raises:
            MocapError: there is none of that name, or it was not tracked; the message says why.
        """
        for record in self.records:
            if record.trial == name and record.status == "done":
                return load(self.out / name)
            if record.trial == name:
                raise MocapError(f"the trial {name!r} was not tracked ({record.status}): {record.error}")
        raise MocapError(f"there is no trial {name!r} in {self.out}: there are {some([r.trial for r in self.records])}")

    @property
    def report_text(self) -> str:
        """What came of it, in a line or two."""
        return "; ".join(filter(None, [counted(self.records), summed(self.records)]))

    def __repr__(self) -> str:
        """One line."""
        return f"<Batch {counted(self.records)} in {self.out}>"

    def _repr_html_(self) -> str:
        return self.table.to_html()


def load_batch(folder: PathText) -> Batch:
    """What ``mocap batch`` wrote into a folder.

    Raises:
        FormatError: it holds no ``summary.csv`` of a batch.
    """
    out = Path(folder)
    found = read_together(out / SUMMARY)
    if lacking := [name for name in COLUMNS if name not in found]:
        raise FormatError(f"{out / SUMMARY}: has no column {lacking[0]}: expected what mocap batch wrote")
    records = [
        Record(
            trial=str(row["trial"]),
            status=row["status"],
            error=str(row["error"]),
            row={name: row[name] for name in FIGURES if pd.notna(row[name])},
        )
        for row in found.to_dict("records")
    ]
    return Batch(out, tuple(records))


def batch(
    sources: PathText | Sequence[PathText],
    out: PathText,
    *,
    jobs: int = 2,
    model: str | PathLike[str] = "auto",
    shard: str | None = None,
    scheduler: str | None = None,
    memory: str | float | None = None,
    limit_s: float | None = None,
    again: bool = False,
    pictures: bool = False,
    validate: bool = True,
    seed: int = 0,
    progress: Callable[[Progress], None] = lambda _progress: None,
    stopped: Callable[[str], bool] | None = None,
    **arguments: Any,
) -> Batch:
    """Track many trials, each as ``mocap.track`` does, and go on after a bad one.

    What has been done of the same files, options and version is not done again; killed at any moment, the same call
    goes on. In a script, call it below ``if __name__ == "__main__":``.

    Args:
        sources: Folders, patterns (``data/**/*.c3d``) and manifests (``mocap.batches.find.find_trials``).
        out: Folder of results: a folder a trial, ``summary.csv``, ``cycles.csv``, ``angles.csv``, ``summary.html``,
            ``times.csv``.
        jobs: Number of processes on this machine.
        model: As ``mocap.track`` takes it; ``learn``: one is learned from all trials first, and written as
            ``model.npz``. A trial is never filled from itself.
        shard: ``i/n``: only every n-th trial, from the i-th (from 1), as for an array of jobs on a cluster; the summary
            holds what all shards have finished.
        scheduler: Address of a Dask scheduler that runs, whose workers see the same files; ``jobs``, ``memory`` and how
            long a trial may take are then its own affair. A scheduler does what anybody asks who reaches it: all of its
            network must be trusted.
        memory: Limit of each process, as ``2GB``; one that grows beyond is replaced, and its trial tried once more.
        limit_s: Seconds that a trial may take, and a look at a file at most; a process that takes longer is ended, and
            the others go on. None: an hour, and a second for each 10 kB; for a look a minute, and a second for each
            200 kB.
        again: Track all of them, also those that have been.
        pictures: Write figures, ``report.html`` and ``recording.rrd`` of each trial, too.
        validate: Hide samples of each trial and measure how they are filled.
        seed: Which samples.
        progress: Told how far it is.
        stopped: Whether a trial is not to be tracked any more, asked by its name twice a second, of this machine's
            processes: what it was before stays, and the others go on.
        **arguments: Arguments of ``mocap.read`` for all trials: ``fps``, ``unit``, ``calibration``, ``skeleton``, ...

    Raises:
        MocapError: no trial was found, the results cannot be written, or no process is left to track (what is done is
            kept).
    """
    part, parts = shard_of(shard)
    if jobs < 1:
        raise MocapError(f"`jobs` is {jobs}: give 1 or more")
    learn = str(model) == LEARN
    if learn and parts > 1:
        raise MocapError("`model` learn needs all trials: learn one first (mocap learn), and give its file to `shard`s")
    if limit_s is not None and limit_s <= 0:
        raise MocapError(f"`limit_s` is {limit_s:g}: give the seconds that a trial may take")
    folder = Path(out).absolute()
    if isinstance(sources, str | PathLike):
        sources = [sources]
    options = Options(
        model=folder / MODEL if learn else checked_model(model), validate=validate, seed=seed, pictures=pictures
    )
    with engine(jobs=jobs, memory=memory, scheduler=scheduler) as makes:
        trials = find_trials(
            [source if isinstance(source, str) else Path(source) for source in sources],
            arguments=arguments,
            out=folder,
            pool=makes if isinstance(makes, Pool) else None,
            limit_s=limit_s,
        )
        # refuse to write where trials are read from: an input is never touched
        for trial in trials:
            for path in trial.paths:
                if path.absolute().parent == folder / trial.name:
                    raise OutputError(f"{path} lies where its result would be written: choose another place")
        own = trials[part - 1 :: parts]
        state = _State(
            out=folder,
            trials=trials,
            todo=[trial for trial in own if not trial.skip],
            times=folder / (f"{TIMES}.csv" if parts == 1 else f"{TIMES}_{part}_of_{parts}.csv"),
            shared=parts > 1,
            progress=progress,
        )
        ready = not learn or is_learned(state.todo, seed, folder)
        if ready and not again:
            done = {trial.name: earlier_record(trial, options, folder) for trial in state.todo}
            state.went |= {name: record for name, record in done.items() if record is not None}
        state.begin()
        with state.summed_up_when_stopped():
            told = {} if state.shared else _compared(makes, state, limit_s)
            if state.missing and not ready:
                _learn(makes, state, seed, limit_s)
            if state.missing:
                _track(makes, state, options, told, again=again, limit_s=limit_s, stopped=stopped)
        return Batch(folder, state.sum_up(), tuple(trial.name for trial in own))


def _learn(makes: Runner, state: "_State", seed: int, limit_s: float | None) -> None:
    """Learn a model of all trials, in one process.

    Raises:
        MocapError: none can be learned.
    """
    most_s = sum(limit_of(trial.paths, limit_s) for trial in state.todo)
    call, last = partial(learn_model, state.todo, state.out, seed), "starting"

    def hear(worker: str, name: str, stage: str) -> None:
        nonlocal last
        last = stage
        state.hear(worker, name, stage)

    for _, went in makes.each({"model": call}, limit_s=lambda _: most_s, hear=hear):
        if isinstance(error := went.exception(), Lost):
            raise MocapError(f"no model was learned: at {last} {why_lost(error, most_s)}")
        went.result()
    state.forget_workers()


def _compared(makes: Runner, state: "_State", limit_s: float | None) -> dict[str, list[Finding]]:
    """What the trials tell of each other; those that are done and are told otherwise now are to be tracked again."""
    facts = {name: record.facts for name, record in state.went.items() if record.facts is not None}
    trials = {trial.name: trial for trial in state.missing}
    if len(state.todo) > 1:
        limits = {name: limit_of(trial.paths, limit_s) for name, trial in trials.items()}
        calls = {name: partial(facts_here, trial) for name, trial in trials.items()}
        for name, went in makes.each(calls, limit_s=limits.__getitem__, hear=state.hear):
            error = went.exception()
            if error is not None:  # as it would be when it is tracked
                why = why_lost(error, limits[name]) if isinstance(error, Lost) else why_failed(error)
                keep(record := failed(trials[name], why), state.out / name)
                state.ended(record, None)
            elif (found := went.result()) is not None:
                facts[name] = found
        state.forget_workers()
    told = told_by_siblings(state.todo, facts)
    state.samples |= {name: one.samples for name, one in facts.items()}
    state.forget(
        name
        for name, record in state.went.items()
        if record.status == "done" and record.beside != kinds_of(told.get(name, ()))
    )
    return told


def _track(
    makes: Runner,
    state: "_State",
    options: Options,
    told: Mapping[str, Sequence[Finding]],
    *,
    again: bool,
    limit_s: float | None,
    stopped: Callable[[str], bool] | None,
) -> None:
    """Track what is missing, each with what the others tell of it."""
    trials = {trial.name: trial for trial in state.missing}
    limits = {name: limit_of(trial.paths, limit_s) for name, trial in trials.items()}
    calls = {
        name: partial(track_here, trial, options, state.out, again, tuple(told.get(name, ())))
        for name, trial in trials.items()
    }
    for name, went in makes.each(calls, limit_s=limits.__getitem__, hear=state.hear, stopped=stopped):
        error = went.exception()
        if isinstance(error, Lost) and error.why == "stopped":
            state.leave(name)
            continue
        if isinstance(error, Lost):
            record, seconds = failed(trials[name], why_lost(error, limits[name])), None
        elif error is not None:
            record, seconds = failed(trials[name], why_failed(error)), None
        else:
            record, seconds = went.result()
        if seconds is None:
            keep(record, state.out / name)
        state.ended(record, seconds)


@dataclass(kw_only=True)
class _State:
    """A batch while it runs.

    Attributes:
        out: The folder of results.
        trials: All of them, also of other shards.
        todo: Those of this run.
        times: The file of this run's times.
        shared: Whether other shards write the same summary.
        progress: Whom to tell.
        went: How trials went that have been finished.
        taken: Seconds that trials took in this run.
        doing: The trial that each worker is at, and the stage of it, by the worker's address.
        works: Since when each trial is tracked that is, and the share of it that is done.
        took_s: How long those took that have ended, in this run.
        samples: How many a trial has; those that are not here are not known.
        numbers: What each worker is called, by its address.
        before: How many had been finished when it began.
        refreshed_s: When the summary was written last.
        turn: Workers are heard in a thread of its own; one at a time tells.
    """

    out: Path
    trials: Sequence[Trial]
    todo: Sequence[Trial]
    times: Path
    shared: bool
    progress: Callable[[Progress], None]
    went: dict[str, Record] = field(default_factory=dict)
    taken: dict[str, float] = field(default_factory=dict)
    doing: dict[str, tuple[str, str]] = field(default_factory=dict)
    works: dict[str, tuple[float, float]] = field(default_factory=dict)
    took_s: dict[str, float] = field(default_factory=dict)
    samples: dict[str, int] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)
    before: int = 0
    refreshed_s: float = 0.0
    turn: Lock = field(default_factory=Lock)

    @property
    def missing(self) -> list[Trial]:
        """Trials of this run that have not been finished."""
        return [trial for trial in self.todo if trial.name not in self.went]

    def begin(self) -> None:
        """Start the clock; a summary that cannot be written is told before hours are spent."""
        self.before = len(self.went)
        if not self.shared:
            self.sum_up()
        self._tell()

    def hear(self, worker: str, trial: str, stage: str, share: float | None = None) -> None:
        """A worker says what it does, and which share of the trial is tracked."""
        with self.turn:
            self.numbers.setdefault(worker, len(self.numbers) + 1)
            self.doing[worker] = trial, stage
            if share is not None:
                self.works[trial] = self.works.get(trial, (monotonic(), 0.0))[0], share
            self._tell()

    def forget(self, names: Iterable[str]) -> None:
        """Trials that are to be tracked again."""
        for name in list(names):
            del self.went[name]
        self.before = len(self.went)

    def leave(self, name: str) -> None:
        """A trial is not of this run any more."""
        with self.turn:
            self.todo = [trial for trial in self.todo if trial.name != name]
            self._free(name)
            self._tell()

    def _free(self, name: str) -> float | None:
        """Nobody is at a trial any more; since when it was tracked."""
        self.doing = {worker: does for worker, does in self.doing.items() if does[0] != name}
        return self.works.pop(name, (None, 0.0))[0]

    def forget_workers(self) -> None:
        """Others come."""
        with self.turn:
            self.doing.clear()
            self.numbers.clear()

    def ended(self, record: Record, seconds: float | None) -> None:
        """A trial has ended."""
        with self.turn:
            self.went[record.trial] = record
            since_s = self._free(record.trial)
            if since_s is not None and record.status == "done":
                self.took_s[record.trial] = monotonic() - since_s
            self._tell()
        if seconds is not None:
            self.taken[record.trial] = seconds
        if not self.shared and monotonic() - self.refreshed_s > 60.0:
            self.sum_up()

    def _tell(self) -> None:
        now_s, names = monotonic(), {*self.took_s, *(trial.name for trial in self.missing)}
        left = time_left(
            {name: self.samples.get(name, 0) for name in names},
            self.took_s,
            {name: (now_s - since_s, share) for name, (since_s, share) in self.works.items() if name in names},
            workers=min(len(self.numbers), len(self.missing)),
        )
        self.progress(
            Progress(
                done=len(self.went),
                failed=sum(record.status == "failed" for record in self.went.values()),
                before=self.before,
                total=len(self.todo),
                left_s=left,
                workers={f"worker {self.numbers[w]}": f"{t}: {stage}" for w, (t, stage) in self.doing.items()},
                trials=dict(self.doing.values()),
            )
        )

    def sum_up(self) -> tuple[Record, ...]:
        """Write times and summary, with what other shards have finished; how each trial went."""
        if self.taken:
            write_times({**({} if self.shared else read_times(self.out)), **self.taken}, self.times)
        found = self._gathered()
        write_summary(found, self.out)
        while self.shared and (now := self._gathered()) != found:  # another shard ended meanwhile
            found = now
            write_summary(found, self.out)
        self.refreshed_s = monotonic()
        return found

    def _gathered(self) -> tuple[Record, ...]:
        """How trials went: as this run knows, else as their folders say."""
        found = []
        own = {trial.name for trial in self.todo}
        for trial in self.trials:
            record = self.went.get(trial.name)
            if trial.skip:
                record = Record(trial=trial.name, status="skipped", error=trial.skip, row=basic_columns(trial))
            elif trial.name not in own:
                record = read_record(self.out / trial.name)
            if record is not None:  # the animal may have been stated since
                found.append(replace(record, row={**record.row, "animal": trial.animal}))
        told = told_by_siblings(self.trials, {one.trial: one.facts for one in found if one.facts is not None})
        return tuple(with_siblings(one, told.get(one.trial, ())) for one in found)

    @contextmanager
    def summed_up_when_stopped(self) -> Iterator[None]:
        """Ctrl-C, or that no process is left, leaves a summary of what has been finished, and says so."""
        try:
            yield
        except (KeyboardInterrupt, NoProcess) as stop:
            self.sum_up()
            stop.kept = (  # type: ignore[union-attr]
                f"{len(self.went)} of {len(self.todo)} trials are finished in {self.out}: the same command goes on"
            )
            raise


def shard_of(text: str | None) -> tuple[int, int]:
    """``i/n`` as numbers; None is 1/1.

    Raises:
        MocapError: it is not of that form, or i is not between 1 and n.
    """
    if text is None:
        return 1, 1
    found = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text)
    if not found or not 1 <= int(found[1]) <= int(found[2]):
        raise MocapError(
            f"`shard` {text}: expected i/n with i from 1 to n, as 3/100 (of an array of jobs: #SBATCH --array=1-100)"
        )
    return int(found[1]), int(found[2])


def checked_model(model: str | PathLike[str]) -> str | Path:
    """The name of a model, or the file of a learned one.

    Raises:
        MocapError: it is neither.
    """
    if model in MODELS:
        return str(model)
    return existing_model(model, (*MODELS, LEARN)).absolute()


LEARNING = "learning from all trials"
MODEL, OF = "model.npz", "model.json"
"""The model, and what it was learned from."""


def model_key(trials: Sequence[Trial], seed: int) -> str:
    """SHA-256 of all that a model of these trials depends on; a trial whose files are missing counts by its name."""
    keys = []
    for trial in trials:
        try:
            keys.append(key_of(trial, Options(seed=seed)))
        except OSError:
            keys.append(trial.name)
    return hashlib.sha256("\n".join(keys).encode()).hexdigest()


def is_learned(trials: Sequence[Trial], seed: int, out: Path) -> bool:
    """Whether the model of these trials, as they are now, has been written."""
    try:
        found = checked(OF, from_json(regular_bytes(out / OF), OF), {"key": Entry(kind="s")}, again="")
    except (OSError, FormatError):
        return False
    return (out / MODEL).is_file() and found["key"][()] == model_key(trials, seed)


def learn_model(trials: Sequence[Trial], out: Path, seed: int, *, progress: Hear | None = None) -> None:
    """Learn a model from all trials that can be read, and write it beside their results.

    ``model.json`` tells which trials it is of, and why others are not among them.

    Raises:
        MocapError: none can be read, or those that can have nothing in common.
    """
    used: list[str] = []
    left_out: dict[str, str] = {}
    try:
        with one_blas_thread():
            stages = Stages(tell=silent if progress is None else lines(lambda line: progress(f"{LEARNING}: {line}")))
            model = Model(learn_from(_sources(trials, used, left_out, progress), seed=seed, stages=stages))
    except MocapError as error:
        if not used:
            first = next(iter(left_out.items()))
            raise MocapError(f"no model can be learned: no trial can be read, as {first[0]}: {first[1]}") from None
        raise MocapError(
            f"no model can be learned from these {len(used)} trials together: {error}: make batches of trials that "
            "are alike, or give `model` auto"
        ) from None
    record = {"key": model_key(trials, seed), "learned_from": used, "left_out": left_out, "scores": model.scores}
    with result_file(out / MODEL, replace=True) as file:
        model.write(file)
        text = json.dumps(record, indent=1, sort_keys=True)
        file.with_name(OF).write_text(text + "\n", encoding="utf-8")


def _sources(
    trials: Sequence[Trial], used: list[str], left_out: dict[str, str], progress: Hear | None
) -> Iterator[Recording]:
    """Those that can be read, one after the other; their names are added to ``used``, reasons to ``left_out``."""

    def cleaned(number: int, trial: Trial, **corners: str) -> Recording | None:
        if progress is not None:
            progress(f"{LEARNING}: {trial.name}, {number} of {len(trials)}")
        try:
            recording = clean(trial.recording(**corners).without_needless_calibration())
        except OriginError:  # the others may tell
            raise
        except MocapError as error:
            left_out[trial.name] = " ".join(str(error).split())
            return None
        used.append(trial.name)
        return recording

    return of_session(partial(cleaned, number, trial) for number, trial in enumerate(trials, start=1))
