"""The desk's state: trials of a folder, how each is read, what is tracked, and the one that is proof-read."""

import os
import shlex
import signal
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import wait
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from time import monotonic
from typing import Any

from mocap.audit.across import COLUMNS, TrialFacts
from mocap.batches.beside import facts_here, told_by_siblings
from mocap.batches.find import PLAN, PRELOAD, find_trials
from mocap.batches.run import batch
from mocap.batches.summary import with_siblings
from mocap.batches.trial import Options, Record, Trial, earlier_record, read_manifest, read_record, write_manifest
from mocap.cameras.arrangement import ArrangementError
from mocap.cleaning.trial_audit import looked_at
from mocap.desk.draft import Draft, open_draft
from mocap.desk.label_qc import LABEL_QC, write_label_qc
from mocap.desk.proof import Proof, open_proof
from mocap.desk.session import Session
from mocap.documents import regular_bytes
from mocap.errors import MocapError
from mocap.findings import Finding, worst_first
from mocap.io.manifest import digest, occupied
from mocap.io.output import result_file, result_folder, taken_over
from mocap.reading.edits import read_edits, standing
from mocap.reading.edits_of_movement import write_committed
from mocap.reading.reading import OPTIONS, in_options
from mocap.reading.session import facts_of
from mocap.results.tracked import load
from mocap.side_by_side import Hear, Worker, opened
from mocap.text import number_of
from mocap.trouble import trouble_of

EDITS, EDITS_OF_MOVEMENT = "edits.jsonl", "edits.json"
SIBLINGS = 8
"""Trials that one is compared with at most before they are tracked: their middle is known by then."""
STOP_S = 10.0
"""Tracking that is stopped sums up what is done in that time, or is ended."""
MEND: Mapping[str, tuple[tuple[str, Any], ...]] = {
    "fit_lens": (("Estimate the lens", True),),
    "correct_lag": (("Correct the lag", True),),
    "origin": (("Rows count from above", "upper-left"), ("Rows count from below", "lower-left")),
    "fps": (("State the frame rate (Hz)", None),),
    "unit": tuple((f"Lengths are in {unit}", unit) for unit in ("m", "mm", "cm", "in", "ft")),
    "tracks": (("Swap the cameras", "in their order"),),
    "edits_anyway": (("Use the corrections all the same", True),),
}
"""What can be done about a finding, by the argument of ``mocap.read`` that mends it: what a person reads, and the
argument's value; None: a number that the person types."""
SHOWN = ("measured_percent", "rmse_mm", "fps")
"""Columns of ``summary.csv`` that the table of trials has, too."""
PASSED = {
    "report": "report.html, figures and tables",
    "xlsx": "tables for Excel",
    "nwb": "NWB",
    "osim": "OpenSim model",
    "mot": "OpenSim motion",
    "deeplabcut": "DeepLabCut",
    "bvh": "BVH",
    "page": "one page with the 3D recording",
    "edits": "corrections (movement), places to check (SLEAP)",
}
"""What a result is passed on as: ``report``, ``page`` (``mocap share``), ``edits`` (``mocap convert`` writes the
corrections; the places are the desk's), or an export of ``mocap kinematics``."""


@dataclass(eq=False, kw_only=True)
class Desk:
    """A desk.

    Attributes:
        out: The folder of results, in which ``manifest.csv`` and the edits lie, too.
        trials: By name.
        options: How they are tracked.
        jobs: How many at a time.
        limit_s: Seconds that each may take; None: by the size of its files.
        proof: What is open in the room of videos: a trial that is proof-read, or videos that are digitised; None: none.
        draft: The skeleton that is drawn; None: none yet.
        looked: The trials that are found in the folders, when they are; those of an earlier desk are there before.
    """

    out: Path
    trials: dict[str, Trial]
    options: Options
    jobs: int = 2
    limit_s: float | None = None
    proof: Proof | Session | None = None
    draft: Draft | None = None
    looked: Future[list[Trial]] = field(default_factory=lambda: _found([]))
    _written: str = ""
    _facts: dict[str, TrialFacts] = field(default_factory=dict)
    _changes: Counter[str] = field(default_factory=Counter)
    _running: Worker | None = None
    _stopped: TemporaryDirectory | None = None
    _heard: dict[str, Any] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    @property
    def manifest(self) -> Path:
        """The trials with what is stated of each, for ``mocap batch``."""
        return self.out / PLAN

    def keep(self, trials: Mapping[str, Trial]) -> None:
        """Write the manifest of trials, and then go on with them.

        Raises:
            MocapError: it cannot be written, or was changed by another program; nothing is as they say then.
        """
        if trials == self.trials and self.manifest.is_file():
            return
        if self._written and self.manifest.is_file() and digest(self.manifest) != self._written:
            raise MocapError(
                f"{self.manifest} was changed by another program while this desk is open, and nothing was kept: end "
                "the desk and start it again, and it is read"
            )
        with result_file(self.manifest, replace=True) as file:
            write_manifest(file, list(trials.values()), folder=self.out)
        self._written, self.trials = digest(self.manifest), dict(trials)

    def seen(self, name: str) -> int:
        """How many edits there are of a trial, or of all (an empty name): lines of its log, and what was stated of it.

        A page tells with each of its requests how many it has seen: another number is that of another page.
        """
        if isinstance(self.proof, Session):
            return self.proof.changes
        if not name:
            return sum(map(self.seen, self.trials))
        log = self.log(name)
        return self._changes[name] + (regular_bytes(log).count(b"\n") if log.is_file() else 0)

    def stated(self, *names: str) -> None:
        """Something was stated of trials, or drawn of their skeleton, that another page has not seen."""
        self._changes.update(names)

    def log(self, name: str) -> Path:
        """The edits of a trial."""
        return self.out / "edits" / name / EDITS

    def trial(self, name: str) -> Trial:
        """One of the trials.

        Raises:
            MocapError: there is none of that name.
        """
        if name not in self.trials:
            self.take_in(wait=True)
        if name not in self.trials:
            raise MocapError(f"there is no trial {name!r}: there are {', '.join(self.trials)}")
        return self.trials[name]

    def overview(self) -> dict[str, Any]:
        """All trials, and how far each is."""
        self.take_in()
        rows, siblings, facts = [], self._told(), self._known()
        for trial in self.trials.values():
            record, log = read_record(self.out / trial.name), self.log(trial.name)
            current = None if trial.skip else earlier_record(self._as_edited(trial), self.options, self.out)
            status = "skipped" if trial.skip else "new" if record is None else record.status
            if status == "done" and current is None:
                status = "changed"
            of_others = siblings.get(trial.name, [])
            row = with_siblings(record or Record(trial=trial.name, status="done"), of_others).row
            edits, damaged = _number_of_edits(log)
            rows.append(
                {
                    "name": trial.name,
                    "files": [path.name for path in trial.paths],
                    "status": status,
                    "error": in_options(damaged or trial.skip or ("" if record is None else record.error)),
                    "edits": edits,
                    "wrong": [in_options(text) for text in str(row.get("warning") or "").split(" | ") if text],
                    "unlike": in_options(str(row.get("unlike", ""))),
                    "mirrored": COLUMNS["mirrored"](facts[trial.name]) if trial.name in facts else None,
                    **{name: row.get(name) for name in SHOWN},
                    "stated": {key: str(value) for key, value in trial.arguments.items() if key != "hints"},
                    "command": self.command(trial),
                    "passes": {kind: [label, self.passing(trial.name, kind)] for kind, label in PASSED.items()},
                }
            )
        seen = {name: self.seen(name) for name in ("", *self.trials)}
        looking = not self.looked.done()
        told = {"trials": rows, "command": self.batch_command(), "out": str(self.out), "seen": seen}
        return told | {"looking": looking}

    def take_in(self, *, wait: bool = False) -> None:
        """Take in what was found in the folders since; what was stated meanwhile stays.

        Args:
            wait: Until they have been looked through.

        Raises:
            MocapError: nothing was found, or it cannot be kept.
        """
        if (wait or self.looked.done()) and (found := {trial.name: trial for trial in self.looked.result()}):
            self.keep(found | self.trials)
            self.looked = _found([])

    def command(self, trial: Trial) -> str:
        """The command that tracks a trial as the desk does."""
        words = ["mocap", "track", *_typed(trial), *([] if self.options.validate else ["--no-validate"])]
        return shlex.join([*words, "--model", str(self.options.model), "--out", str(self.out / trial.name), "--force"])

    def batch_command(self) -> str:
        """The command that tracks all of them."""
        words = ["mocap", "batch", self.manifest, "--out", self.out, "--jobs", self.jobs, "--model", self.options.model]
        return shlex.join([*map(str, words), *([] if self.options.validate else ["--no-validate"])])

    def passing(self, name: str, kind: str) -> str:
        """The command that passes a result on as the desk does."""
        if kind == "edits":
            words = ["mocap", "convert", self.log(name), self.out / name / "corrections" / EDITS_OF_MOVEMENT, "--force"]
            return shlex.join(map(str, words))
        to = ["--out", self.out / name / "page"] if kind == "page" else [] if kind == "report" else ["--export", kind]
        words = ["mocap", "share" if kind == "page" else "kinematics", self.out / name, *to, "--force"]
        return shlex.join(map(str, words))

    def audit(self, name: str) -> list[dict[str, Any]]:
        """What is found in a trial's files, worst first, each with what the program can do about it."""
        trial, swap = self._as_edited(self.trial(name)), None
        looked = looked_at(trial.recording, modelled=isinstance(self.options.model, Path))
        if isinstance(looked.refused, ArrangementError):
            with suppress(MocapError):
                swap = _in_order(trial)
        if looked.recording is not None:
            self._facts[name] = facts_of(looked.recording, name=name)
        self._know_siblings(trial)
        found = worst_first([*self._told().get(name, ()), *looked.findings])
        return [
            {
                "kind": one.kind,
                "text": in_options(one.text),
                "alarm": one.alarm,
                "open": one.asks and not one.alarm,
                "mend": [
                    {"said": label, "name": key, "value": value, "others": one.numbers.get("others")}
                    for key in one.mends or ()
                    if key != "tracks" or swap is not None
                    for label, value in MEND.get(key, ())
                    if value is None or trial.arguments.get(key) != value
                ],
            }
            for one in found
        ]

    def _know_siblings(self, trial: Trial) -> None:
        """Read some trials of its session of which nothing is known, so that it can be compared with them."""
        known = self._known()
        others = [one for one in self.trials.values() if one.name != trial.name and not one.skip]
        others = [one for one in others if one.arguments.get("calibration") == trial.arguments.get("calibration")]
        for one in [one for one in others if one.name not in known][: max(0, SIBLINGS - len(known))]:
            facts = facts_here(one)
            self._facts[one.name] = TrialFacts(name=one.name) if facts is None else facts

    def _known(self) -> dict[str, TrialFacts]:
        """The facts of trials that were tracked, or looked at since the desk was opened."""
        records = {name: read_record(self.out / name) for name in self.trials if name not in self._facts}
        return {k: v.facts for k, v in records.items() if v is not None and v.facts is not None} | self._facts

    def _told(self) -> dict[str, list[Finding]]:
        return told_by_siblings(list(self.trials.values()), self._known())

    def state(self, name: str, key: str, value: Any) -> str:
        """State something of a trial, as an argument of ``mocap.read``; it is kept in the manifest.

        Args:
            name: The trial.
            key: Of ``MEND``, or ``skip``: why it is not tracked (empty: it is).
            value: Its value.

        Raises:
            MocapError: no order of the files makes the cameras fit, or it cannot be kept.
        """
        trial = self.trial(name)
        if key == "skip":
            changed = replace(trial, skip=str(value))
        elif key == "tracks":
            changed = _in_order(trial)
        else:
            changed = replace(trial, arguments={**trial.arguments, key: value})
        self.keep({**self.trials, name: changed})
        self._facts.pop(name, None)
        self.stated(name)
        return f"{name}: {key.replace('_', ' ')} {value}"

    def track(self) -> str:
        """Begin to track what has not been tracked as it is now; ``progress`` tells how far it is."""
        self.take_in(wait=True)
        if self.progress()["running"]:
            return "it is being tracked"
        self.keep({name: self._as_edited(trial) for name, trial in self.trials.items()})  # with logs that came since
        how = {"jobs": self.jobs, "model": self.options.model, "validate": self.options.validate}
        how |= {"limit_s": self.limit_s}
        self._heard = {"said": "starting"}
        self._stopped = TemporaryDirectory(prefix="mocap-")  # a file for each trial that is stopped
        how |= {"stopped": partial(_is_there, Path(self._stopped.name))}
        self._running = Worker.started(get_context("spawn"), daemon=False)  # it starts others
        self._running.send("track", partial(_track, self.manifest, self.out, how), hears=True)
        return "tracking; it can be stopped, and goes on where it was"

    def progress(self) -> dict[str, Any]:
        """How far tracking is."""
        with self._turn:
            if self._running is not None:
                self._hear(self._running)
            return self._heard | {"running": self._running is not None}

    def _hear(self, worker: Worker) -> None:
        for kind, what in worker.messages():
            if kind == "said":
                self._heard |= what[0]
            elif kind != "ready":
                self._heard["said"] = str(what) if kind != "died" else "the process that tracks has ended by itself"
                self._running = None
        if self._running is None:
            self._end(worker)

    def _end(self, worker: Worker) -> None:
        worker.end(now=True)
        self._running = None
        if self._stopped is not None:
            self._stopped.cleanup()

    def stop_one(self, name: str) -> str:
        """Stop tracking a trial, or take it out of those that wait; the others go on."""
        if self._running is None or self._stopped is None:
            return "nothing is being tracked"
        (Path(self._stopped.name) / self.trial(name).name).touch()
        return f"{name} is stopped, the others go on"

    def stop(self) -> str:
        """Stop tracking; trials that have ended are kept, and ``track`` goes on."""
        with self._turn:
            worker, end_s = self._running, monotonic() + STOP_S
            if worker is None:
                return "nothing is being tracked"
            self._hear(worker)
            if os.name == "posix" and worker.begun and self._running is not None:
                os.kill(worker.name, signal.SIGINT)  # as Ctrl-C does: it ends its processes, and sums up
                while self._running is not None and (left_s := end_s - monotonic()) > 0 and wait([worker.pipe], left_s):
                    self._hear(worker)
            if self._running is not None:
                self._end(worker)
        return "stopped; trials that have ended are kept"

    def open(self, name: str) -> dict[str, Any]:
        """Open a trial that was tracked for proof-reading; a desk without trials has what was opened with it."""
        self.take_in(wait=True)
        if not self.trials:
            return self.opened().info()
        trial = self.trial(name)
        if read_record(self.out / name) is None:
            raise MocapError(f"{name} has not been tracked: track it first")
        self.proof = None
        self.proof = self._proof(trial)
        edits = {"edits": self.log(name)}
        commands = {
            "proof": self.command(replace(trial, arguments={**trial.arguments, **edits})),
            "angles": self.passing(name, "report"),
            "scene": shlex.join(["mocap", "view", str(self.out / name)]),
        }
        return self.proof.info() | {"commands": commands}

    def _proof(self, trial: Trial, *, ahead: bool = True) -> Proof:
        """A trial and its result; arguments as of ``open_proof``."""
        plain = replace(trial, arguments={key: value for key, value in trial.arguments.items() if key != "edits"})
        result, anyway = load(self.out / trial.name), trial.arguments.get("edits_anyway", False)
        return open_proof(trial.name, plain.recording(), result, self.log(trial.name), anyway=anyway, ahead=ahead)

    def is_seen(self, place: str, trial: str, edits: int | None = None) -> bool:
        """Whether a page shows what is open here, with all edits.

        Args:
            place: Where it shows it: ``proof`` or ``draft`` as of the attributes, else the table of trials.
            trial: Which it shows; empty: all.
            edits: How many it has seen (``seen``); None: it only looks.
        """
        if place == "draft":
            here = self.draft is not None and trial == self.draft.trial
        elif place == "proof":
            here = self.proof is not None and trial == self.proof.name
        else:
            here = not trial or trial in self.trials
        return here and (edits is None or edits == self.seen(trial))

    def opened(self) -> Proof | Session:
        """What is open in the room of videos; a MocapError where nothing is."""
        return _there(self.proof, Proof | Session, "open a trial first")

    def tracked(self) -> Proof:
        """The trial that is proof-read; a MocapError where none is open."""
        return _there(self.proof, Proof, "open a trial that was tracked first")

    def session(self) -> Session:
        """The videos that are digitised; a MocapError where none are open."""
        return _there(self.proof, Session, "open videos first: mocap digitise --web")

    def draw(self, name: str) -> dict[str, Any]:
        """Open the skeleton of a trial."""
        self.draft = None
        self.draft = open_draft(self.trial(name), self.out / "skeletons" / f"{name}.toml")
        return self.drawn()

    def drawn(self) -> dict[str, Any]:
        """The skeleton that is drawn, and the command that proposes one."""
        draft = self.drawing()
        without = ("skeleton", "edits", "correct_lag", "fit_lens")
        words = ["mocap", "skeleton", *_typed(self.trial(draft.trial), without=without)]
        return {**draft.info(), "command": shlex.join([*words, "--out", str(draft.path), "--force"])}

    def drawing(self) -> Draft:
        """The skeleton that is drawn; a MocapError where none is open."""
        return _there(self.draft, Draft, "open the skeleton of a trial first")

    def keep_skeleton(self, **drawn: Any) -> str:
        """Write what was drawn, and state it of all trials that had the skeleton of this one, or none as it.

        Raises:
            MocapError: it is no skeleton, or corrections of one of the trials name markers that are called otherwise.
        """
        draft = self.drawing()
        found, before = draft.changed(**drawn), self.trial(draft.trial).arguments.get("skeleton")
        same = [name for name, trial in self.trials.items() if trial.arguments.get("skeleton") == before]
        there = {None, *found.renamed(draft.recording.names)}
        for log in (log for name in same if (log := self.log(name)).is_file()):
            if lost := {marker for edit in standing(read_edits(log)) for marker in (edit.marker, edit.other)} - there:
                raise MocapError(
                    f"{log} has corrections of {', '.join(map(str, lost))}: keep these names, or undo the corrections"
                )
        draft.save(found)  # not in force before it is stated
        stated = {name: {**self.trials[name].arguments, "skeleton": draft.path} for name in same}
        self.keep(self.trials | {name: replace(self.trials[name], arguments=of) for name, of in stated.items()})
        self.stated(*same)
        if isinstance(self.proof, Proof) and self.proof.name in same:
            self.proof = None  # it has the names of before
        return f"wrote {draft.path} for {number_of(len(same), 'trial')}"

    def pass_on(self, name: str, kind: str) -> str:
        """Write a result for others: its report, or an export of ``mocap kinematics``.

        Raises:
            MocapError: it has been changed since it was tracked, or cannot be written so.
        """
        trial = self.trial(name)
        if earlier_record(self._as_edited(trial), self.options, self.out) is None:
            raise MocapError(f"{name} was changed or corrected since it was tracked: track it first")
        if kind == "edits":
            proof = self._proof(trial, ahead=False)
            with result_folder(self.out / name / "corrections", "corrections", replace=True) as folder:
                wrote = write_committed(folder / EDITS_OF_MOVEMENT, proof.edits, fps=proof.raw.fps or 1.0)
                n = len(proof.raw.camera_names)
                write_label_qc(folder / LABEL_QC, proof.places(), proof.raw.names, cameras=n)
            return f"wrote {wrote} and the places to check to {self.out / name / 'corrections'}"
        result = load(self.out / name)
        if kind == "page":
            from mocap.rerun.share import write_page

            with (
                result_folder(self.out / name / "page", "share", replace=True) as folder,
                TemporaryDirectory() as place,
            ):
                result.write_recording(Path(place) / name)
                write_page(Path(place) / name, folder)
            return f"wrote {self.out / name / 'page'}"
        place = self.out / name / "kinematics"
        with result_folder(place, "kinematics", replace=True) as folder:
            refused = result.write_kinematics(folder, exports=[] if kind == "report" else [kind])
        if refused:
            raise MocapError("; ".join(refused))
        return f"wrote {place}"

    def _as_edited(self, trial: Trial) -> Trial:
        log = self.log(trial.name)
        if not log.is_file() or "edits" in trial.arguments:
            return trial
        return replace(trial, arguments={**trial.arguments, "edits": log})


def _found(trials: list[Trial]) -> Future[list[Trial]]:
    """Trials that need not be waited for."""
    found: Future[list[Trial]] = Future()
    found.set_result(trials)
    return found


def _number_of_edits(log: Path) -> tuple[int, str]:
    """How many corrections of a log stand, and what is wrong with it."""
    try:
        return len(standing(read_edits(log))) if log.is_file() else 0, ""
    except MocapError as error:
        return 0, str(error)


def _there(what: Any, kind: Any, problem: str) -> Any:
    if not isinstance(what, kind):
        raise MocapError(problem)
    return what


def _in_order(trial: Trial) -> Trial:
    """A trial of one file per camera, with the files in the order of their calibration.

    Raises:
        MocapError: it is one file, or in no order do its files fit.
    """
    try:
        trial.recording()
    except ArrangementError as error:
        names, order = list(error.arrangement.belongs), list(error.arrangement.belongs.values())
        if len(trial.paths) != len(names):
            raise
        found = replace(trial, paths=tuple(trial.paths[order.index(name)] for name in names))
        found.recording()  # whether they fit
        return found
    raise MocapError(f"{trial.name}: its cameras are in the order of their calibration")


def _typed(trial: Trial, *, without: Sequence[str] = ()) -> list[str]:
    """A trial's files, and what is stated of them, as commands take them."""
    words = [*map(_plain, trial.paths)]
    for key, value in trial.arguments.items():
        if key in ("hints", *without) or value is False or value is None:
            continue
        for one in value if isinstance(value, list) else [value]:
            words += [OPTIONS[key]] if one is True else [OPTIONS[key], _plain(one)]
    return words


def _plain(value: Any) -> str:
    """As it is typed: numbers without needless digits, paths without needless steps."""
    return (
        f"{value:g}" if isinstance(value, float) else os.path.normpath(value) if isinstance(value, Path) else f"{value}"
    )


def _duration(seconds: float) -> str:
    """As people say it."""
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def _is_there(folder: Path, name: str) -> bool:
    return (folder / name).exists()


def _track(manifest: Path, out: Path, how: dict[str, Any], *, progress: Hear) -> str:
    """In a process of its own: track, and tell how far it is; what came of it."""

    def tell(done: Any) -> None:
        left = "" if done.left_s is None else f", about {_duration(done.left_s)} left"
        status = f"{done.done} of {done.total} done{left}"
        progress({"said": status, "done": done.done, "total": done.total, "doing": dict(done.trials)})

    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return batch(manifest, out, progress=tell, **how).report_text
    except KeyboardInterrupt as stop:
        return str(getattr(stop, "kept", "stopped"))
    except Exception as error:  # whatever it is, the page says it
        return trouble_of(error).text


@contextmanager
def opened_desk(
    sources: list[str],
    out: Path,
    *,
    options: Options,
    jobs: int = 2,
    limit_s: float | None = None,
    arguments: Mapping[str, Any] | None = None,
    behind: bool = False,
) -> Iterator[Desk]:
    """A desk of a folder's trials, which goes on where an earlier one on the same results ended.

    Args:
        sources: Folders, files, patterns.
        out: Results.
        options: How trials are tracked.
        jobs: How many at a time.
        limit_s: Seconds that each may take.
        arguments: Of ``mocap.read``, for all.
        behind: Whether it is open before the folders are looked through (``Desk.looked``).

    Raises:
        MocapError: there is no trial, or another desk works in ``out``.
    """
    out = out.absolute()
    with occupied(out / "edits", "a desk"):
        written = digest(out / PLAN) if (out / PLAN).is_file() else ""
        before = {trial.name: trial for trial in read_manifest(out / PLAN)} if written else {}
        desk = Desk(out=out, trials=before, options=options, jobs=jobs, limit_s=limit_s, looked=Future())
        if written:  # also where a person corrected it: what it states is read, and goes on
            taken_over(out / PLAN, written)
            desk._written = written

        def look() -> None:
            try:
                with opened(jobs, preload=PRELOAD) as pool:
                    found = find_trials(list(sources), arguments=arguments, out=out, pool=pool, limit_s=limit_s)
            except BaseException as error:  # whoever asks for the trials is told
                desk.looked.set_exception(error)
            else:
                desk.looked.set_result(found)

        if behind:
            Thread(target=look, daemon=True).start()
        else:
            look()
            desk.take_in()
        try:
            yield desk
        finally:
            desk.stop()
