"""Learn a model from several recordings of the same kind of animal."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

import numpy as np

from mocap.audit.across import compared
from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError
from mocap.filters.hidden_gaps import MODELS, USUAL_EFFORT, WITH_JOINTS, Effort, best_of
from mocap.filters.model import LearnedModel, learn_model, own_trials
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.poses import MarkerTrial
from mocap.findings import Kind
from mocap.io.output import result_file
from mocap.progress import Stages, Tell, bars
from mocap.reading.decided import decided
from mocap.reading.session import Siblings, facts_of, own_findings
from mocap.recording import Recording, as_recording
from mocap.side_by_side import call_all
from mocap.skeleton import Skeleton
from mocap.text import number_of, plain
from mocap.tracking.model_file import load_model as read_model
from mocap.tracking.model_file import save_model
from mocap.tracking.tracking import PREPARE, marker_trial, seen_frames

MOST_FRAMES = 20_000
"""Of all recordings together: no more teaches anything that could be measured (docs/experiments/batch_cost.md), and
what is learned is read again in each recording that is tracked with it."""
LONGEST = MOST_FRAMES // 4
"""Frames of one recording."""


@dataclass(frozen=True, eq=False)
class Model:
    """How one kind of animal moves, learned from recordings of it.

    Attributes:
        learned: The recordings and what was chosen on them.
    """

    learned: LearnedModel

    @property
    def scores(self) -> dict[str, dict[str, list[float]]]:
        """Of each motion model, by length of gap: ``rmse_mm``, ``coverage95``, ``z`` in gaps hidden while learning."""
        return self.learned.scores

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write it to an ``.npz`` file.

        Args:
            path: The file.
            overwrite: Whether a model that was written there before may be replaced.

        Raises:
            OutputError: it cannot be written there, or a file that is not ours is in its place.
        """
        with result_file(Path(path), replace=overwrite) as file:
            self.write(file)

    def write(self, file: Path) -> None:
        """Write the file of ``save``, as ``mocap.io.output.result_file`` gives it."""
        save_model(self.learned, file)

    def __repr__(self) -> str:
        """One line."""
        trials = ", ".join(trial.name for trial in self.learned.trials)
        return f"<Model of {number_of(len(self.learned.names), 'marker')}, learned from {trials}>"

    @property
    def report_text(self) -> str:
        """What was learned and how well it fills gaps, as markdown."""
        return readable_scores(self.learned)

    @property
    def scores_text(self) -> str:
        """How well it fills gaps, as markdown: the first part of ``report_text``."""
        return self.report_text.partition("\nDistances that")[0]

    def _repr_markdown_(self) -> str:
        return self.report_text


def learn(
    recordings: Sequence[Recording],
    *,
    joints: bool = False,
    seed: int = 0,
    progress: Tell | None = None,
    tell: Callable[[str], None] = lambda _line: None,
) -> Model:
    """Learn a motion model of one kind of animal from several recordings, to track others with.

    Args:
        recordings: As ``mocap.read`` gives them, of one frame rate; markers of the same name are the same.
        joints: Whether joint angles of rigid segments are a model as well, mixed with that of the pose: nearer on
            animals with rigid bones and of other sizes, tracking takes 1.5 to 2.3 times as long. The skeleton states
            the bones.
        seed: Which samples are hidden to choose and to calibrate.
        progress: Called with the name of a stage and the share of it that is done; None: bars, where errors go to a
            terminal.
        tell: Called with a line for each recording, and for each in which hidden gaps are filled.

    Raises:
        MocapError: they cannot be learned from together; or joints are wanted, and the skeleton states none.
    """
    if isinstance(recordings, str | PathLike | Recording):
        raise MocapError(f"mocap.learn takes a list of recordings, not {type(recordings).__name__}: mocap.learn([...])")
    recordings = _told_apart([as_recording(recording, "learn") for recording in recordings])
    told = compared([facts_of(recording) for recording in recordings])
    recordings = [one.with_part(Siblings(told=tuple(told[one.name]))) if told[one.name] else one for one in recordings]
    models = WITH_JOINTS if joints else MODELS
    with bars() if progress is None else nullcontext(progress) as shown:
        return Model(learn_from(recordings, seed=seed, models=models, stages=Stages(tell=shown), tell=tell))


def _told_apart(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings; of several that bear one name each has its folder before it."""
    count = Counter(one.name for one in recordings)
    return [
        one
        if count[one.name] == 1 or one.file is None
        else replace(one, name=f"{one.file.absolute().parent.name}/{one.name}")
        for one in recordings
    ]


def load_model(path: str | PathLike[str]) -> Model:
    """A model that ``mocap learn`` or ``Model.save`` wrote.

    Raises:
        FormatError: the file is none, or damaged, or of another version.
    """
    return Model(read_model(Path(path)))


def learn_from(
    sources: Iterable[Recording],
    *,
    seed: int = 0,
    effort: Effort = USUAL_EFFORT,
    models: Sequence[TrajectoryModel] = MODELS,
    stages: Stages | None = None,
    tell: Callable[[str], None] = lambda _line: None,
) -> LearnedModel:
    """Clean recordings as ``track`` does, and learn from all of them, or from some of very many.

    They are read one after the other. Of more than ``MOST_FRAMES`` frames, recordings are kept that are drawn by
    chance, so that time and memory do not grow with their number.

    Args:
        sources: Recordings of one frame rate, cleaned or not; markers of the same name are the same.
        seed: Which samples are hidden, to learn weights and intervals.
        effort: How much is hidden.
        models: Motion models; the last is a filter.
        stages: Timer and progress.
        tell: Called with a line for each recording, and for each that gaps are filled in.

    Raises:
        MocapError: a recording cannot be read, or they cannot be learned from together.
    """
    stages = stages or Stages()
    with stages.stage(PREPARE) as share:
        some = _kept(sources, tell, share)
    if not some.kept:
        raise MocapError("there is no recording to learn from")
    shown = some.in_order
    if len(shown) < some.offered:
        tell(f"learned from {len(shown)} of {some.offered} recordings, drawn by chance: {some.frames} frames")
    names = list(dict.fromkeys(name for one in shown for name in one.names))
    trials = [one.with_markers(names) for one in shown]
    seen = np.any([trial.seen.any(axis=0) for trial in trials], axis=0)
    if seen.sum() < 4:
        few = number_of(int(seen.sum()), "marker is", "markers are")
        raise MocapError(f"only {few} ever seen in these recordings: a model needs at least 4")
    kept = [name for name, ever in zip(names, seen, strict=True) if ever]
    trials = [replace(trial, xyz_m=trial.xyz_m[:, seen], sd_m=trial.sd_m[:, seen]) for trial in trials]
    skeleton = shown[0].skeleton
    trunk = [name for name in skeleton.trunk if name in kept]
    rng = np.random.default_rng(seed)
    with stages.stage("learn, fill hidden gaps") as share:
        return learn_model(
            kept,
            trunk,
            trials,
            rng,
            bones=skeleton.rigid,
            bodies=[*skeleton.bodies.values()],
            models=models,
            effort=effort,
            tell=tell,
            progress=share,
            call_all=call_all,
        )


@dataclass(frozen=True, eq=False)
class _Kept:
    """What is kept of a recording: the seen frames of all its markers, of ``LONGEST`` those that show most."""

    names: tuple[str, ...]
    trial: MarkerTrial
    skeleton: Skeleton

    @classmethod
    def of(cls, recording: Recording) -> "_Kept":
        part = recording.at(seen_frames(recording))
        return cls(recording.names, best_of(marker_trial(part), LONGEST), recording.skeleton)

    def with_markers(self, names: Sequence[str]) -> MarkerTrial:
        """All markers of the model, in its order."""
        xyz = np.full((len(self.trial.t_s), len(names), 3), np.nan)
        sd = np.full(xyz.shape[:2], np.nan)
        index = [names.index(name) for name in self.names]
        xyz[:, index], sd[:, index] = self.trial.xyz_m, self.trial.sd_m
        return replace(self.trial, xyz_m=xyz, sd_m=sd)


@dataclass(eq=False)
class _Some:
    """Recordings of at most ``MOST_FRAMES`` frames: those with the lowest lots of all that were offered."""

    kept: dict[tuple[float, int], _Kept] = field(default_factory=dict)
    offered: int = 0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def add(self, number: int, shown: _Kept) -> None:
        """Offer one; which are kept does not depend on how many follow that are not."""
        self.offered += 1
        self.kept[float(self.rng.random()), number] = shown
        while self.frames > MOST_FRAMES and len(self.kept) > 1:
            del self.kept[max(self.kept)]

    @property
    def frames(self) -> int:
        return sum(len(shown.trial.t_s) for shown in self.kept.values())

    @property
    def in_order(self) -> list[_Kept]:
        return [self.kept[lot] for lot in sorted(self.kept, key=lambda lot: lot[1])]


def _kept(sources: Iterable[Recording], tell: Callable[[str], None], progress: Callable[[float], None]) -> _Some:
    """What is kept of the recordings, cleaned; of a generator nobody knows how far it is."""
    some, known = _Some(), len(sources) if isinstance(sources, Sequence) else None
    for number, one in enumerate(_cleaned(sources, tell)):
        seen = np.isfinite(one.xyz_m[..., 0])
        frames, samples = number_of(int(seen.any(axis=1).sum()), "frame"), number_of(int(seen.sum()), "sample")
        tell(f"{one.name}: {frames}, {samples}")
        some.add(number, _Kept.of(one))
        if known:
            progress((number + 1) / known)
    return some


def _cleaned(sources: Iterable[Recording], tell: Callable[[str], None]) -> Iterator[Recording]:
    """The recordings, cleaned.

    Raises:
        MocapError: a recording cannot be cleaned; the message names its file.
    """
    for source in sources:
        one = clean(source.without_needless_calibration()).in_space("learning")
        read_so = decided(source).of_files
        known = own_findings(source) if source.cleaned else ()  # whoever cleaned it was told
        for finding in one.findings:  # in the order of all commands
            if finding not in known and (finding.asks or finding in read_so or finding.kind is Kind.UNLIKE_SIBLINGS):
                tell(f"{one.name}: {finding.text}")
        yield one


def readable_scores(learned: LearnedModel) -> str:
    """What was learned, as markdown."""
    lengths = next(iter(learned.scores.values()))["gap_frames"]
    lines = [
        f"# A model of {number_of(len(learned.trials), 'recording')}",
        "",
        f"{len(learned.names)} markers, {1 / learned.dt_s:.6g} frames a second. Root mean square errors in mm in "
        "gaps that were hidden, of the mixture as the other gaps teach it. Inside: the share of its errors in their "
        "95 % intervals; z: the root mean square of error over stated deviation, 1 is right.",
        "",
        "| gaps of | " + " | ".join(f"{n} frames" for n in lengths) + " |",
        "|---" * (len(lengths) + 1) + "|",
    ]
    rows = {name: [f"{error:.3g}" for error in found["rmse_mm"]] for name, found in learned.scores.items()}
    mixture = list(learned.scores.values())[-1]
    rows["inside"] = [f"{share:.0f} %" for share in mixture["coverage95"]]
    rows["z"] = [f"{z:.2f}" for z in mixture["z"]]
    lines += [f"| {plain(name)} | {' | '.join(cells)} |" for name, cells in rows.items()]
    bones = own_trials(learned).bones
    if len(bones.ends):
        lines += [
            "",
            "Distances that models with bones keep constant (bones of the skeleton, and pairs of markers "
            "found to be as rigid):",
            "",
        ]
        lines += ["| markers | length in mm, in the last recording | varies by |", "|---|---|---|"]
        for (a, b), length, sd in zip(bones.ends, bones.length_m, bones.sd_m, strict=True):
            pair = plain(f"{learned.names[a]}, {learned.names[b]}")
            lines.append(f"| {pair} | {1e3 * length:.4g} | {100 * sd / length:.1f} % |")
    return "\n".join(lines) + "\n"
