"""Track a cleaned recording by the model that is asked for, or by the one that fills its hidden samples best."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from os import PathLike
from pathlib import Path

from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError, beside
from mocap.filters.bones import size_factor
from mocap.filters.model import LearnedModel, filled_alone, for_recording, renamed
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.registry import NAMED
from mocap.filters.score import Score
from mocap.progress import Stages
from mocap.reading.ideal_pixels import of_one_camera
from mocap.recording import Recording
from mocap.side_by_side import call_all
from mocap.text import as_text
from mocap.tracking.one_camera import NAME, track_one_camera
from mocap.tracking.result import Result, rate_points
from mocap.tracking.tracking import (
    PREPARE,
    each_alone,
    learn_motion,
    marker_trial,
    seen_part,
    track,
    track_mixed,
    trial_set,
    why_no_pose,
    with_track,
)
from mocap.tracking.two_rays import without_contradicted, worth_checking

MODELS = ("auto", "mixture", *NAMED)
"""What ``model`` may be called."""


def existing_model(model: object, names: Sequence[str] = MODELS) -> Path:
    """The file of a learned model.

    Raises:
        MocapError: there is none; the message lists the models, of these names, and what has a name like it.
    """
    if isinstance(model, str | PathLike) and Path(model).is_file():
        return Path(model)
    like = get_close_matches(str(model), names, n=1)
    what = f"there is no such model ({like[0]} is one): " if like else ""
    if not like and isinstance(model, str | PathLike):
        path = Path(model)
        if path.exists():
            what = "is a folder: "
        elif path.suffix or len(path.parts) > 1:  # a word alone was meant to be a name
            what = f"there is no such file{beside(path)}: "
    raise MocapError(f"`model` {as_text(str(model))}: {what}give {', '.join(names)}, or a file that mocap learn wrote")


def track_part(
    source: Recording,
    *,
    model: str,
    learned: LearnedModel | None,
    stages: Stages,
    validated: bool,
    seed: int = 0,
) -> tuple[Result, Recording, str, Mapping[str, Score]]:
    """Track a recording, as ``run_job`` does, without potentials and a report.

    Returns:
        The recording as it was tracked, with joints, and as it was cleaned; why it was tracked by that model; and how
        gaps that were hidden in it were filled.
    """
    if of_one_camera(source):
        recording, part, smoothed, why, scores = track_one_camera(
            source, learned, stages=stages, validated=validated, seed=seed
        )
        return with_track(recording, part, NAME, smoothed), recording, why, scores
    recording, part, reason, learned = _prepared(source, model, learned, stages)
    posed = reason is None and (model not in NAMED or NAMED[model].posed)
    if (posed or learned is not None) and worth_checking(recording):
        with stages.stage("check points of two rays") as progress:
            recording = without_contradicted(recording, learned, progress=progress)
            part = seen_part(recording)
    mixing = learned is None and posed and model not in NAMED
    single = each_alone(part)
    beside = _compared(model, reason, single, mixing=mixing) if validated else None
    mixed, scores = None, {}
    if mixing or learned is not None:
        with stages.stage("track with a mixture of models" if mixing else "track") as progress:
            mixed = track_mixed(
                part, learned, rate_points=rate_points(recording), compared=beside, seed=seed, progress=progress
            )
        scores = {} if mixed is None else mixed.scores
    elif beside:
        with stages.stage("validate on hidden samples") as progress:
            scores = filled_alone(trial_set(part), beside, seed=seed, progress=progress, call_all=call_all)
    name, why = _choose(model, reason, single, scores)
    if learned is not None:
        name, why = "learned", _learned_from(learned, part)
    smoothed, own = None if mixed is None or name in NAMED else mixed.markers, None
    if smoothed is None:
        name = "eal" if name == "mixture" else name
        with stages.stage("learn"):
            own = learn_motion(part, NAMED[name].settings)
        with stages.stage("track") as progress:
            smoothed = track(part, own, rate_points=rate_points(recording), progress=progress)
    return with_track(recording, part, name, smoothed), recording, why, scores


def _prepared(
    source: Recording, model: str, learned: LearnedModel | None, stages: Stages
) -> tuple[Recording, Recording, str | None, LearnedModel | None]:
    """The recording cleaned, its seen part, why no pose can be learned of it, and the model with its names."""
    with stages.stage(PREPARE):
        recording = clean(source)
        part = seen_part(recording)
        reason = why_no_pose(part)
        learned = None if learned is None else renamed(learned, recording.skeleton.renamed(learned.names))
    if reason is not None and (model == "mixture" or (model in NAMED and NAMED[model].posed)):
        raise MocapError(f"{recording.name}: no EAL model can be learned: {reason}; use `model` {each_alone(part)}")
    return recording, part, reason, learned


def _compared(model: str, reason: str | None, single: str, *, mixing: bool) -> dict[str, TrajectoryModel]:
    """Models that fill hidden gaps, too, beside a mixture; of a model alone, this is one of them."""
    names = {model, *NAMED[model].beside} if model in NAMED else set() if mixing else {"eal"}
    names |= {"constant_velocity"} if model == "auto" or reason is not None else set()
    names |= {single} if model == "auto" and reason is not None else set()
    posed = reason is None
    return {name: one.settings for name, one in NAMED.items() if name in names and (posed or not one.posed)}


def _learned_from(learned: LearnedModel, part: Recording) -> str:
    """Names of the trials that are used, how they were scaled, and which is the recording itself."""
    own = marker_trial(part)
    factors = {t.name: size_factor(t, own) for t in for_recording(learned, part.names, own)}
    used = [name if factor == 1 else f"{name} (x {factor:.3g})" for name, factor in factors.items()]
    itself = [trial.name for trial in learned.trials if trial.name not in factors]
    scaled = "; scaled to this animal's size" if any(factor != 1 for factor in factors.values()) else ""
    left_out = f"; {', '.join(itself)} is this recording itself and was left out" if itself else ""
    return f"learned from {', '.join(used) or 'no other'}{scaled}{left_out}"


def _choose(model: str, reason: str | None, single: str, scores: Mapping[str, Score]) -> tuple[str, str]:
    """The model to track with, and why."""
    if model != "auto":
        return model, "as asked"
    if reason is not None:
        return single, reason
    mixture, steady = scores.get("mixture"), scores.get("constant_velocity")
    if mixture is None or steady is None:
        return "mixture", "the default"
    if mixture.rmse_mm <= steady.rmse_mm:
        return "mixture", "it fills hidden samples of this recording better than constant velocity"
    return "constant_velocity", (
        "it fills hidden samples of this recording better than the mixture that includes the EAL model"
    )
