"""``mocap learn``: a model from several recordings of the same kind of animal."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from filters.hidden_gaps import MODELS, USUAL_EFFORT, Effort
from filters.model import LearnedModel, learn_model, own_trials
from filters.models.base import TrajectoryModel
from filters.poses import MarkerTrial
from mocap.cameras.origin import OriginError
from mocap.errors import MocapError
from mocap.markdown import plain
from mocap.pipeline.prepare import Prepared, prepare
from mocap.pipeline.recording import Recording
from mocap.pipeline.tracking import marker_trial, seen_part


def learn_from(
    sources: Sequence[Recording | Prepared],
    *,
    seed: int = 0,
    effort: Effort = USUAL_EFFORT,
    models: Sequence[TrajectoryModel] = MODELS,
    tell: Callable[[str], None] = lambda _line: None,
) -> LearnedModel:
    """Prepare recordings as ``track`` does, and learn from all of them.

    Args:
        sources: Recordings of one frame rate, or what was prepared of them; markers of the same name are the same.
        seed: Which samples are hidden, to learn weights and intervals.
        effort: How much is hidden.
        models: Motion models; the last is a filter.
        tell: Called with a line for each recording, and for each that gaps are filled in.

    Raises:
        MocapError: a recording cannot be read, or they cannot be learned from together.
    """
    recordings = []
    for source, one in zip(sources, _prepared(sources, tell), strict=True):
        recordings.append(one)
        seen = np.isfinite(recordings[-1].xyz_m[..., 0])
        for finding in () if isinstance(source, Prepared) else source.frame_findings:
            tell(f"{recordings[-1].name}: {finding}")
        tell(f"{recordings[-1].name}: {seen.any(axis=1).sum()} frames, {seen.sum()} samples")
    names = list(dict.fromkeys(name for recording in recordings for name in recording.names))
    trunk = [name for name in recordings[0].skeleton.trunk if name in names]
    trials = [_with_markers(recording, names) for recording in recordings]
    seen = np.any([trial.seen.any(axis=0) for trial in trials], axis=0)
    if seen.sum() < 4:
        raise MocapError(f"only {seen.sum()} markers are ever seen in these recordings: a model needs at least 4")
    kept = [name for name, ever in zip(names, seen, strict=True) if ever]
    trials = [replace(trial, xyz_m=trial.xyz_m[:, seen], sd_m=trial.sd_m[:, seen]) for trial in trials]
    trunk, bones = [name for name in trunk if name in kept], recordings[0].skeleton.rigid
    rng = np.random.default_rng(seed)
    return learn_model(kept, trunk, trials, rng, bones=bones, models=models, effort=effort, tell=tell)


def _prepared(sources: Sequence[Recording | Prepared], tell: Callable[[str], None]) -> list[Prepared]:
    """The recordings, prepared; where one cannot tell which corner its pixels are counted from, the others tell.

    Raises:
        MocapError: a recording cannot be prepared; the message names its file.
    """
    found: list[Prepared | None] = []
    doubt: dict[int, OriginError] = {}
    for i, source in enumerate(sources):
        try:
            found.append(source if isinstance(source, Prepared) else prepare(source).in_space("learning"))
        except OriginError as error:
            found.append(None)
            doubt[i] = error
    told = {(f.pixel_origin.pixels, f.pixel_origin.coefficients) for p in found if p and (f := p.filmed)}
    for i, error in doubt.items():
        source = sources[i]
        if len(told) != 1 or not isinstance(source, Recording):
            raise error
        (corners,) = told
        found[i] = prepare(replace(source, pixel_origin=corners[0], calibration_origin=corners[1]))
        tell(f"{source.name}: pixel origin {corners[0]}, as in the other recordings of this session")
    return [p for p in found if p is not None]


def _with_markers(recording: Prepared, names: Sequence[str]) -> MarkerTrial:
    """The seen frames of a recording, with all markers of the model in its order."""
    part = seen_part(recording)
    trial = marker_trial(recording, replace(part, markers=np.arange(len(recording.names))))
    xyz = np.full((len(trial.t_s), len(names), 3), np.nan)
    sd = np.full(xyz.shape[:2], np.nan)
    index = [names.index(name) for name in recording.names]
    xyz[:, index], sd[:, index] = trial.xyz_m, trial.sd_m
    return replace(trial, xyz_m=xyz, sd_m=sd)


def readable_scores(learned: LearnedModel) -> str:
    """What was learned, as markdown."""
    lengths = next(iter(learned.scores.values()))["gap_frames"]
    lines = [
        f"# A model of {len(learned.trials)} recordings",
        "",
        f"{len(learned.names)} markers, {1 / learned.dt_s:.6g} frames a second. Root mean square errors in mm in "
        "the hidden gaps on which models were chosen (in brackets the share inside 95 % intervals, whose width was "
        "set on the same gaps):",
        "",
        "| model | " + " | ".join(f"{n} frames" for n in lengths) + " |",
        "|---" * (len(lengths) + 1) + "|",
    ]
    for name, rows in learned.scores.items():
        cells = [f"{e:.3g} ({c:.0f} %)" for e, c in zip(rows["rmse_mm"], rows["coverage95"], strict=True)]
        lines.append(f"| {plain(name)} | " + " | ".join(cells) + " |")
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
