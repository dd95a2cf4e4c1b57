"""The main job: from a recording to tracked motion, joints, potentials and a report."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from eal.threads import one_blas_thread
from mocap.filters.joint_types import articulation
from mocap.filters.model import LearnedModel
from mocap.filters.score import Score
from mocap.findings import MOST, Finding, Kind
from mocap.progress import Stages
from mocap.recording import Recording
from mocap.report.report import Counts, consistency, make_report, readable
from mocap.skeleton import Skeleton
from mocap.text import number_of
from mocap.tracking.model_choice import ModelChoice
from mocap.tracking.potentials import FRAME, SPACE, Potentials, joint_potentials
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result
from mocap.tracking.track_part import track_part
from mocap.tracking.tracking import (
    whole_frames,
)


def run_job(
    source: Recording,
    *,
    model: str = "auto",
    learned: LearnedModel | None = None,
    stages: Stages | None = None,
    validated: bool = True,
    seed: int = 0,
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

    Returns:
        The recording as it was tracked, and as it was cleaned.

    Raises:
        MocapError: what makes it impossible, with what to do.
    """
    stages = stages or Stages()
    with one_blas_thread():  # at these sizes two BLAS threads only wait for each other
        tracked, recording, why, scores = track_part(
            source, model=model, learned=learned, stages=stages, validated=validated, seed=seed
        )
        return reported(tracked, recording, why=why, scores=scores, stages=stages), recording


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
    told = _too_narrow(consistency(tracked)["nis_per_row"]) + _left(tracked) + _unknown(tracked, whole)
    choice = ModelChoice(why=why, scores=scores, told=tuple(told))
    none = not planar and recording.plane is None and (skeleton.joints or not skeleton.body_joints)
    lacking = (_no_joints(skeleton),) if none else ()
    tracked = tracked.with_part(choice, Potentials(planar=planar, spatial=spatial, told=lacking))
    report = make_report(recording, tracked, seconds=stages.seconds, articulated=joined, whole=whole)
    return tracked.with_part(Report(numbers=report, text=readable(report, title=recording.name)))


def _too_narrow(nis_per_row: float | None) -> list[Finding]:
    """Prediction errors (innovations) that are much larger than the filter expects."""
    if nis_per_row is None or nis_per_row < 2:
        return []
    times = float(np.sqrt(nis_per_row))
    text = f"prediction errors are {times:.1f} times as large as the filter expects: its intervals are too narrow by "
    return [Finding(kind=Kind.INTERVALS, alarm=True, text=f"{text}that factor", numbers={"times": times})]


def _left(tracked: Result) -> list[Finding]:
    """Markers whose positions the track leaves for longer than noise does: their deviation was enlarged."""
    if "departure" not in tracked.data:
        return []
    size_mm = 1e3 * tracked.data["departure"].values
    which = np.flatnonzero(size_mm > 0)
    if not len(which):
        return []
    names = tuple(tracked.names[m] for m in which)
    text = (
        f"the track leaves the positions of {len(which)} of {len(size_mm)} markers by more than their noise explains: "
        f"{float(np.median(size_mm[which])):.2g} mm (RMS, median of these markers). Intervals were "
        "widened by it, and the samples stay measured; if their noise is known, state `point_sd_mm`"
    )
    numbers = {"markers": float(len(which)), "median_mm": float(np.median(size_mm[which]))}
    return [Finding(kind=Kind.WIDER_INTERVALS, text=text, numbers=numbers, markers=names[:MOST])]


def _no_joints(skeleton: Skeleton) -> Finding:
    """Why there are no joints, and how to come by them."""
    text = "no joint is seen often enough to learn a potential from"
    if not skeleton.joints:
        what = "the skeleton has no joints" if skeleton.bones or skeleton.trunk else "no skeleton with joints was given"
        text = (
            f"{what}: joints.csv is empty, no potentials were learned, and identity switches and body motion are "
            "estimated without what is not stated. The command mocap skeleton proposes what the recording shows. State "
            'the rest yourself ([joints], elbow = ["shoulder", "elbow", "wrist"]), and give it as `skeleton`'
        )
    return Finding(kind=Kind.JOINTS, alarm=True, text=text)


def _unknown(tracked: Result, whole: Counts | None) -> list[Finding]:
    """What is told of samples that are too uncertain to use."""
    empty = tracked.data["unknown"].values
    if whole is not None:
        return unknown_positions(whole["samples"]["unknown"], whole["samples"]["total"])
    return unknown_positions(empty.sum(), empty.size, (np.flatnonzero(empty.any(axis=1)) + 1).tolist())


def unknown_positions(count: float, total: float, frames: Sequence[int] = ()) -> list[Finding]:
    """Filled samples of which nothing is known.

    Args:
        count: How many there are.
        total: Of how many samples.
        frames: In which, from 1; of a long recording none.
    """
    if not count:
        return []
    longest = max(runs_of(frames), key=len, default=range(0))
    most = f"; most of them in frames {longest[0]} to {longest[-1]}" if len(longest) > 1 else ""
    return [
        Finding(
            kind=Kind.UNKNOWN_POSITIONS,
            text=f"{number_of(int(count), 'position is', 'positions are')} too uncertain to use and left empty: "
            f"95 % intervals are as wide as the animal is long{most}",
            numbers={"samples": count, "share": count / total},
            frames=tuple(frames[:MOST]),
        )
    ]


def runs_of(frames: Sequence[int]) -> list[range]:
    """Runs of frames that follow each other."""
    breaks = [i for i in range(1, len(frames)) if frames[i] != frames[i - 1] + 1]
    edges = [0, *breaks, len(frames)] if frames else []
    return [range(frames[a], frames[b - 1] + 1) for a, b in pairwise(edges)]
