"""The main job: from a recording to tracked motion, joints, potentials and a report."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from os import PathLike
from pathlib import Path

import numpy as np

from eal.threads import one_blas_thread
from mocap.errors import MocapError, beside
from mocap.filters.bones import size_factor
from mocap.filters.joint_types import articulation
from mocap.filters.model import LearnedModel, filled_alone, for_recording, renamed
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.registry import NAMED
from mocap.filters.motion.base import MotionModel
from mocap.filters.score import Score
from mocap.findings import Finding
from mocap.pipeline import sentences
from mocap.pipeline.cleaning import clean
from mocap.pipeline.ideal_pixels import of_one_camera
from mocap.pipeline.model_choice import ModelChoice
from mocap.pipeline.one_camera import NAME, track_one_camera
from mocap.pipeline.potentials import FRAME, SPACE, Potentials, joint_potentials
from mocap.pipeline.report import Counts, consistency, make_report, readable
from mocap.pipeline.report_part import Report
from mocap.pipeline.result import Result, rate_points
from mocap.pipeline.tracking import (
    each_alone,
    learn_motion,
    marker_trial,
    seen_part,
    track,
    track_mixed,
    trial_set,
    whole_frames,
    why_no_pose,
    with_track,
)
from mocap.pipeline.two_rays import without_contradicted, worth_checking
from mocap.progress import Stages
from mocap.recording import Recording
from mocap.side_by_side import call_all
from mocap.text import as_text

Watch = Callable[[Recording, Recording, MotionModel], None]
"""Filters the seen part of a recording for somebody who watches."""
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


def run_job(
    source: Recording,
    *,
    model: str = "auto",
    learned: LearnedModel | None = None,
    stages: Stages | None = None,
    validated: bool = True,
    seed: int = 0,
    watch: Watch | None = None,
) -> tuple[Result, Recording]:
    """Track a recording.

    Args:
        source: The recording, cleaned or not.
        model: Of ``mocap.filters.models.registry.NAMED``; a ``mixture`` of ``eal`` and constant velocity, or
            (``auto``) the mixture, unless constant velocity fills hidden samples of this recording better; of fewer
            than four markers each by itself (``each_alone``).
        learned: A model of other trials to track with, in place of these.
        stages: Timer and progress.
        validated: Whether to hide samples and measure how they are filled.
        seed: Which samples to hide.
        watch: Filters for somebody who watches, before all is smoothed; not with ``learned``.

    Returns:
        The recording as it was tracked, and as it was cleaned.

    Raises:
        MocapError: what makes it impossible, with what to do.
    """
    stages = stages or Stages()
    with one_blas_thread():  # at these sizes two BLAS threads only wait for each other
        if of_one_camera(source):
            with stages.stage("track one camera") as progress:
                recording, part, smoothed, why = track_one_camera(source, learned, progress=progress)
            tracked, scores = with_track(recording, part, NAME, smoothed), {}
        else:
            tracked, recording, why, scores = track_part(
                source, model=model, learned=learned, stages=stages, validated=validated, seed=seed, watch=watch
            )
        return reported(tracked, recording, why=why, scores=scores, stages=stages), recording


def track_part(
    source: Recording,
    *,
    model: str,
    learned: LearnedModel | None,
    stages: Stages,
    validated: bool,
    seed: int = 0,
    watch: Watch | None = None,
) -> tuple[Result, Recording, str, Mapping[str, Score]]:
    """Track a recording, as ``run_job`` does, without potentials and a report.

    Returns:
        The recording as it was tracked, with joints, and as it was cleaned; why it was tracked by that model; and how
        gaps that were hidden in it were filled.
    """
    recording, part, reason, learned = _prepared(source, model, learned, stages)
    posed = reason is None and (model not in NAMED or NAMED[model].posed)
    if (posed or learned is not None) and worth_checking(recording):
        with stages.stage("check points of two rays"):
            recording = without_contradicted(recording, learned)
            part = seen_part(recording)
    if watch is not None:
        with stages.stage("filter live"):
            alone = model if model in NAMED else "eal" if posed else each_alone(part)
            watch(recording, part, learn_motion(part, NAMED[alone].settings).motion)
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
    return with_track(recording, part, name, smoothed, own), recording, why, scores


def _prepared(
    source: Recording, model: str, learned: LearnedModel | None, stages: Stages
) -> tuple[Recording, Recording, str | None, LearnedModel | None]:
    """The recording cleaned, its seen part, why no pose can be learned of it, and the model with its names."""
    with stages.stage("read, triangulate, clean"):
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


def reported(
    tracked: Result,
    recording: Recording,
    *,
    why: str,
    scores: Mapping[str, Score],
    stages: Stages,
    whole: Counts | None = None,
) -> Result:
    """The tracked recording with potentials and a report.

    Args:
        tracked: The recording as it was tracked.
        recording: As it was cleaned.
        why: Why it was tracked by that model.
        scores: How gaps that were hidden in it were filled.
        stages: Timer and progress.
        whole: Counts of the long recording of which these are some frames; None: they are all.
    """
    markers, skeleton = tracked.tracks, recording.skeleton
    with stages.stage("joints and potentials"):
        seen_m = np.where(np.isfinite(recording.xyz_m[..., :1]), markers.xyz_m, np.nan)
        build = {"trunk": skeleton.trunk, "bones": skeleton.rigid}
        axes = whole_frames(recording).rotation
        joined = articulation(recording.names, seen_m, markers.sd_m, axes, **build)
        planar, spatial = (
            joint_potentials(tracked.joints_m(frame), frame, markers, skeleton) for frame in (FRAME, SPACE)
        )
    told = sentences.too_narrow(consistency(tracked)["nis_per_row"]) + _unknown(tracked, whole)
    choice = ModelChoice(why=why, scores=scores, told=tuple(told))
    none = not planar and recording.plane is None and (skeleton.joints or not skeleton.body_joints)
    lacking = (sentences.no_joints(skeleton),) if none else ()
    tracked = tracked.with_part(choice, Potentials(planar=planar, spatial=spatial, told=lacking))
    report = make_report(recording, tracked, seconds=stages.seconds, articulated=joined, whole=whole)
    return tracked.with_part(Report(numbers=report, text=readable(report, title=recording.name)))


def _unknown(tracked: Result, whole: Counts | None) -> list[Finding]:
    """What is told of samples that are too uncertain to use."""
    empty = tracked.data["unknown"].values
    if whole is not None:
        return sentences.unknown_positions(whole["samples"]["unknown"], whole["samples"]["total"])
    return sentences.unknown_positions(empty.sum(), empty.size, (np.flatnonzero(empty.any(axis=1)) + 1).tolist())


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
