"""The desk's state: trials of a folder, how each is read, what is tracked, and the one that is proof-read."""

import os
import shlex
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mocap import audit
from mocap.batches.find import PLAN, find_trials
from mocap.batches.run import batch
from mocap.batches.trial import Options, Trial, earlier_record, read_manifest, read_record, write_manifest
from mocap.cameras.arrangement import ArrangementError
from mocap.desk.draft import Draft, open_draft
from mocap.desk.proof import Proof, open_proof
from mocap.desk.session import Session
from mocap.errors import MocapError
from mocap.findings import Finding, Kind, worst_first
from mocap.io.manifest import locked
from mocap.io.output import result_file, result_folder
from mocap.pipeline.cleaning import audit_points
from mocap.pipeline.decided import decided
from mocap.pipeline.edits import read_edits, standing
from mocap.pipeline.ideal_pixels import with_rays
from mocap.pipeline.reading import OPTIONS, in_options
from mocap.results.tracked import load
from mocap.text import number_of

EDITS = "edits.jsonl"
MEND: Mapping[str, tuple[tuple[str, Any], ...]] = {
    "fit_lens": (("Estimate the lens", True),),
    "correct_lag": (("Correct the lag", True),),
    "origin": (("Rows count from above", "upper-left"), ("Rows count from below", "lower-left")),
    "unit": tuple((f"Lengths are in {unit}", unit) for unit in ("m", "mm", "cm", "in", "ft")),
    "tracks": (("Swap the cameras", "in their order"),),
}
"""What can be done about a finding, by the argument of ``mocap.read`` that mends it: what a person reads, and the
argument's value."""
PASSED = {
    "report": "report.html, figures and tables",
    "xlsx": "tables for Excel",
    "nwb": "NWB",
    "osim": "OpenSim model",
    "mot": "OpenSim motion",
    "deeplabcut": "DeepLabCut",
    "bvh": "BVH",
    "page": "one page with the 3D recording",
}
"""What a result is passed on as: ``report``, ``page`` (``mocap share``), or an export of ``mocap kinematics``."""


@dataclass(eq=False, kw_only=True)
class Desk:
    """A desk.

    Attributes:
        out: The folder of results, in which ``manifest.csv`` and the edits lie, too.
        trials: By name.
        options: How they are tracked.
        jobs: How many at a time.
        proof: What is open in the room of videos: a trial that is proof-read, or videos that are digitised; None: none.
        draft: The skeleton that is drawn; None: none yet.
    """

    out: Path
    trials: dict[str, Trial]
    options: Options
    jobs: int = 2
    proof: Proof | Session | None = None
    draft: Draft | None = None
    _running: BaseProcess | None = None
    _ear: Connection | None = None
    _heard: dict[str, Any] = field(default_factory=dict)

    @property
    def manifest(self) -> Path:
        """The trials with what is stated of each, for ``mocap batch``."""
        return self.out / PLAN

    def save(self) -> None:
        """Write the manifest."""
        with result_file(self.manifest, replace=True) as file:
            write_manifest(file, list(self.trials.values()), folder=self.out)

    def log(self, name: str) -> Path:
        """The edits of a trial."""
        return self.out / "edits" / name / EDITS

    def trial(self, name: str) -> Trial:
        """One of the trials.

        Raises:
            MocapError: there is none of that name.
        """
        if name not in self.trials:
            raise MocapError(f"there is no trial {name!r}: there are {', '.join(self.trials)}")
        return self.trials[name]

    def overview(self) -> dict[str, Any]:
        """All trials, and how far each is."""
        rows = []
        for trial in self.trials.values():
            record, log = read_record(self.out / trial.name), self.log(trial.name)
            current = None if trial.skip else earlier_record(self._as_edited(trial), self.options, self.out)
            status = "skipped" if trial.skip else "new" if record is None else record.status
            if status == "done" and current is None:
                status = "changed"
            row = {} if record is None else record.row
            rows.append(
                {
                    "name": trial.name,
                    "files": [path.name for path in trial.paths],
                    "status": status,
                    "error": in_options(trial.skip or ("" if record is None else record.error)),
                    "edits": len(standing(read_edits(log))) if log.is_file() else 0,
                    "warning": str(row.get("warning", "")),
                    "measured_percent": row.get("measured_percent"),
                    "stated": {key: str(value) for key, value in trial.arguments.items() if key != "hints"},
                    "command": self.command(trial),
                    "passes": {kind: [label, self.passing(trial.name, kind)] for kind, label in PASSED.items()},
                }
            )
        return {"trials": rows, "command": self.batch_command()}

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
        to = ["--out", self.out / name / "page"] if kind == "page" else [] if kind == "report" else ["--export", kind]
        words = ["mocap", "share" if kind == "page" else "kinematics", self.out / name, *to, "--force"]
        return shlex.join(map(str, words))

    def audit(self, name: str) -> list[dict[str, Any]]:
        """What is found in a trial's files, worst first, each with what the program can do about it."""
        trial = self.trial(name)
        found: list[Finding] = []
        swap = None
        try:
            recording = trial.recording()
            found += recording.findings
            if recording.pixels is not None and len(recording.cameras) > 1:
                rows = decided(with_rays(recording)).rows
                assert rows is not None  # as two cameras see something
                found += audit_points(recording)[1]
                found += audit.audit_filmed(recording.cameras, recording.pixels, recording.ideal_px, rows)
            elif recording.pixels is not None:
                found += audit.pixel_findings(recording.pixels)
            elif recording.points is not None:
                found += audit.point_findings(recording.points)
        except ArrangementError as error:
            found.append(Finding(kind=error.arrangement.kind, alarm=True, text=str(error)))
            with suppress(MocapError):
                swap = _in_order(trial)
        except MocapError as error:
            found.append(Finding(kind=Kind.REFUSED, alarm=True, text=str(error), mends=error.mends))
        once: dict[str, Finding] = {}
        for one in worst_first(found):
            once.setdefault(one.text, one)
        return [
            {
                "kind": one.kind,
                "text": in_options(one.text),
                "alarm": one.alarm,
                "mend": [
                    {"said": label, "name": key, "value": value}
                    for key in one.mends or ()
                    if key != "tracks" or swap is not None
                    for label, value in MEND.get(key, ())
                    if trial.arguments.get(key) != value
                ],
            }
            for one in once.values()
        ]

    def state(self, name: str, key: str, value: Any) -> str:
        """State something of a trial, as an argument of ``mocap.read``; it is kept in the manifest.

        Args:
            name: The trial.
            key: Of ``MEND``, or ``skip``: why it is not tracked (empty: it is).
            value: Its value.

        Raises:
            MocapError: no order of the files makes the cameras fit.
        """
        trial = self.trial(name)
        if key == "skip":
            self.trials[name] = replace(trial, skip=str(value))
        elif key == "tracks":
            self.trials[name] = _in_order(trial)
        else:
            self.trials[name] = replace(trial, arguments={**trial.arguments, key: value})
        self.save()
        return f"{name}: {key.replace('_', ' ')} {value}"

    def track(self) -> str:
        """Begin to track what has not been tracked as it is now; ``progress`` tells how far it is."""
        if self._running is not None and self._running.is_alive():
            return "it is being tracked"
        for name in self.trials:  # a log that came since
            if self.log(name).is_file() and "edits" not in self.trials[name].arguments:
                self.state(name, "edits", self.log(name))
        self.save()
        context = get_context("spawn")
        self._ear, mouth = context.Pipe(duplex=False)
        how = {"jobs": self.jobs, "model": self.options.model, "validate": self.options.validate}
        self._running = context.Process(target=_track, args=(mouth, self.manifest, self.out, how))
        self._heard = {"said": "starting"}
        self._running.start()
        mouth.close()
        return "tracking; it can be stopped, and goes on where it was"

    def progress(self) -> dict[str, Any]:
        """How far tracking is."""
        ear = self._ear
        with suppress(EOFError, OSError):
            while ear is not None and ear.poll():
                self._heard |= ear.recv()
        running = self._running is not None and self._running.is_alive()
        return self._heard | {"running": running}

    def stop(self) -> str:
        """Stop tracking; trials that have ended are kept, and ``track`` goes on."""
        process = self._running
        if process is None or process.pid is None or not process.is_alive():
            return "nothing is being tracked"
        if os.name == "posix":
            os.kill(process.pid, signal.SIGINT)  # as Ctrl-C does: it ends its workers, and sums up
            process.join(10)
        if process.is_alive():
            process.terminate()
            process.join()
        return "stopped; trials that have ended are kept"

    def open(self, name: str) -> dict[str, Any]:
        """Open a trial that was tracked for proof-reading; a desk without trials has what was opened with it."""
        if not self.trials:
            return self.opened().info()
        trial = self.trial(name)
        if read_record(self.out / name) is None:
            raise MocapError(f"{name} has not been tracked: track it first")
        plain = replace(trial, arguments={key: value for key, value in trial.arguments.items() if key != "edits"})
        self.proof = None
        self.proof = open_proof(name, plain.recording(), load(self.out / name), self.log(name))
        edits = {"edits": self.log(name)}
        commands = {
            "proof": self.command(replace(trial, arguments={**trial.arguments, **edits})),
            "angles": self.passing(name, "report"),
            "scene": shlex.join(["mocap", "view", str(self.out / name)]),
        }
        return self.proof.info() | {"commands": commands}

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
        draft.save(found)
        for name in same:
            self.trials[name] = replace(
                self.trials[name], arguments={**self.trials[name].arguments, "skeleton": draft.path}
            )
        self.save()
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
        result = load(self.out / name)
        if kind == "page":
            from mocap.rerun.share import write_page

            with (
                result_folder(self.out / name / "page", "share", replace=True) as folder,
                TemporaryDirectory() as place,
            ):
                result.write_recording(Path(place) / name)
                write_page([Path(place) / name], folder)
            return f"wrote {self.out / name / 'page'}"
        place = self.out / name / "kinematics"
        with result_folder(place, "kinematics", replace=True) as folder:
            refused = result.write_kinematics(folder, exports=[] if kind == "report" else [kind])
        if refused:
            raise MocapError("; ".join(refused))
        return f"wrote {place}"

    def _as_edited(self, trial: Trial) -> Trial:
        log = self.log(trial.name)
        return replace(trial, arguments={**trial.arguments, "edits": log}) if log.is_file() else trial


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


def _track(mouth: Connection, manifest: Path, out: Path, how: dict[str, Any]) -> None:
    """In a process of its own: track, and tell how far it is."""

    def tell(progress: Any) -> None:
        doing = "; ".join(does for _, does in sorted(progress.workers.items()))
        left = "" if progress.left_s is None else f", about {progress.left_s:.0f} s left"
        status = f"{progress.done} of {progress.total} done{left}" + (f": {doing}" if doing else "")
        with suppress(OSError):  # nobody hears it any more
            mouth.send({"said": status, "done": progress.done, "total": progress.total})

    try:
        found = batch(manifest, out, progress=tell, **how)
    except (MocapError, KeyboardInterrupt) as stop:
        with suppress(OSError):
            mouth.send({"said": str(getattr(stop, "kept", None) or stop or "stopped")})
        sys.exit(1)
    with suppress(OSError):
        mouth.send({"said": found.report_text})


@contextmanager
def opened_desk(
    sources: list[str], out: Path, *, options: Options, jobs: int = 2, arguments: Mapping[str, Any] | None = None
) -> Iterator[Desk]:
    """A desk of a folder's trials, which goes on where an earlier one on the same results ended.

    Raises:
        MocapError: there is no trial, or another desk works in ``out``.
    """
    out = out.absolute()
    before = {trial.name: trial for trial in read_manifest(out / PLAN)} if (out / PLAN).is_file() else {}
    found = {trial.name: trial for trial in find_trials(list(sources), arguments=arguments, out=out)}
    (out / "edits").mkdir(parents=True, exist_ok=True)
    with locked(out / "edits"):
        desk = Desk(out=out, trials=found | before, options=options, jobs=jobs)
        desk.save()
        try:
            yield desk
        finally:
            desk.stop()
