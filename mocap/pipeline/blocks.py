"""Long recordings in blocks: what is learned is learned once, and each block is tracked with frames on either side.

Memory is that of one block, whatever the number of frames, and time is linear. What a smoother says of a frame depends
on frames far from it by a factor that falls exponentially with their distance, once each marker was seen for some
frames; a block is therefore tracked with a margin in which that has happened (``margin``), and only its own frames are
kept. docs/howto/long_recordings.md has what differs from tracking the whole at once.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError, MocapError
from mocap.filters.body_axes import BodyFrames
from mocap.filters.hidden_gaps import EACH_MARKER, Effort
from mocap.filters.model import LearnedModel, learn_model, renamed
from mocap.filters.models.base import FittedMotion
from mocap.filters.models.constant_velocity import learn_constant_velocity
from mocap.filters.models.pose import PoseSettings
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.velocities import Asked
from mocap.findings import Finding
from mocap.io.tables_long import ParquetPoints
from mocap.joints import joint_tracks
from mocap.kinematics.points import asked_for
from mocap.pipeline.cleaning import clean
from mocap.pipeline.job import whole_frames
from mocap.pipeline.motion import motion_of
from mocap.pipeline.reading import animal
from mocap.pipeline.recording import Recording, of_points, with_ideal_pixels
from mocap.pipeline.sentences import pixel_origin
from mocap.pipeline.tracking import (
    Part,
    marker_trial,
    seen_part,
    track,
    track_mixed,
    tracks_alone,
    why_no_pose,
    with_track,
)
from mocap.pipeline.two_rays import without_contradicted, worth_checking
from mocap.pipeline.variables import with_joints
from mocap.progress import Stages
from mocap.records import MarkerTracks, Status, marker_tracks
from mocap.side_by_side import call_all
from mocap.skeleton import Skeleton
from mocap.text import as_text

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class LongRecording:
    """A recording in stretches.

    Attributes:
        name: Of the recording.
        skeleton: Its skeleton.
        names: The M markers, named as in the skeleton.
        t_s: (T,) times.
        part: Frames to the recording of them, not cleaned.
        findings: On how the file was read.
    """

    name: str
    skeleton: Skeleton
    names: tuple[str, ...]
    t_s: Array
    part: Callable[[slice], Recording]
    findings: tuple[Finding, ...] = ()

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.t_s)

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0

    def seen(self, frames: slice) -> Mask:
        """(n, M) True where a position, or two rays, are given; nothing is cleaned."""
        part = self.part(frames)
        seen = part.seen
        return seen if not part.cameras else seen.sum(axis=0) >= 2

    def cleaned(self, frames: slice) -> Recording:
        """What ``mocap.clean`` makes of some frames, its findings with their numbers here."""
        return clean(self.part(frames), first=frames.start)


def long_recording(source: Recording) -> LongRecording:
    """A recording that is in memory, to be tracked in blocks; where pixels are counted from is decided on all of it.

    Raises:
        MocapError: pixels and calibration do not belong together, or nothing is seen.
    """
    findings = source.findings
    if source.filmed:
        source = with_ideal_pixels(source)
        assert source.rows is not None  # it was decided
        findings = (*source.told, *findings, pixel_origin(source.rows))
    elif not source.seen.any():
        raise FormatError(f"{source.where}: no marker is ever seen: there is nothing to track")
    bare = replace(source, findings=(), stored=None)
    return LongRecording(
        name=source.name,
        skeleton=source.skeleton,
        names=source.names,
        t_s=source.t_s,
        part=bare.at,
        findings=findings,
    )


def long_parquet(path: Path, skeleton_file: Path | None = None) -> LongRecording:
    """Positions of a Parquet table that is read by range: the recording never is in memory.

    Args:
        path: mocap's long table (``mocap.io.tables_long``); samples that were not measured are left out.
        skeleton_file: Skeleton TOML; None: none.

    Raises:
        FormatError: the file is none, or is not sorted.
        SkeletonError: the skeleton cannot be read, or names markers that the recording lacks.
    """
    points = ParquetPoints(path)
    skeleton, names = animal(skeleton_file, points.names)

    def tracks(frames: slice) -> MarkerTracks:
        found, _ = points.read(frames)
        measured = found.status == Status.MEASURED
        return replace(
            found,
            names=names,
            xyz_m=np.where(measured[..., None], found.xyz_m, np.nan),
            cov_m2=np.where(measured[..., None, None], found.cov_m2, np.nan),
            status=np.where(measured, found.status, Status.MISSING),
        )

    name = as_text(path.stem)
    return LongRecording(
        name=name,
        skeleton=skeleton,
        names=names,
        t_s=points.t_s,
        part=lambda frames: of_points(tracks(frames), skeleton, name=name),
    )


BLOCK = 4000
"""Frames of a block."""
LONG = 20_000
"""Recordings of more frames are tracked in blocks unless something else is asked for."""
LEAST_S, LEAST, MOST, STEADY = 0.5, 60, 1000, 30
"""A margin is this long in seconds and in frames at least, in frames at most; each marker is seen in so many."""
EXCERPTS, EXCERPT = 6, 400
"""What is learned once is learned from so many stretches of so many frames, evenly over the recording."""
Model = Literal["auto", "mixture", "constant_velocity"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What is learned once of a long recording.

    Attributes:
        name: Of the motion model: ``constant_velocity``, ``mixture``, ``learned``.
        why: Why that one.
        steady: Each marker by constant velocity.
        learned: Model of poses, mixed with constant velocity; None: constant velocity alone.
    """

    name: str
    why: str
    steady: ConstantVelocity
    learned: LearnedModel | None


def blocks_of(n_frames: int, size: int) -> list[range]:
    """Blocks of at most so many frames, all of about one length."""
    count = max(1, -(-n_frames // size))
    edges = np.linspace(0, n_frames, count + 1).astype(int)
    return [range(int(a), int(b)) for a, b in pairwise(edges)]


def margin(seen: Mask, dt_s: float) -> int:
    """Frames that a block is tracked with beyond its end, given (n, M) sightings from there on, nearest first.

    So many that each marker that is seen in the next ``MOST`` frames was seen in ``STEADY`` of these.
    """
    least = max(LEAST, round(LEAST_S / dt_s))
    count = np.cumsum(seen[:MOST], axis=0)
    if not len(count):
        return 0
    wanted = np.minimum(STEADY, count[-1])
    steady = (count >= wanted).argmax(axis=0) + 1
    return min(len(count), MOST, max(least, int(steady.max(initial=0))))


def learn_once(
    recording: LongRecording, *, model: Model = "auto", learned: LearnedModel | None = None, seed: int = 0
) -> Known:
    """Learn from stretches of the recording what all blocks are tracked with.

    Args:
        recording: The recording.
        model: ``auto``: the mixture, unless constant velocity fills gaps that are hidden in these stretches better.
        learned: A model of other trials, in place of these.
        seed: Where gaps are hidden.

    Raises:
        MocapError: nothing is seen in them, or a mixture is asked for and cannot be learned.
    """
    count = EXCERPTS if recording.n_frames > EXCERPTS * EXCERPT else max(1, recording.n_frames // EXCERPT)
    length = min(EXCERPT, recording.n_frames)
    starts = np.linspace(0, recording.n_frames - length, count).astype(int)
    stretches = [slice(int(s), int(s) + length) for s in starts]
    shown = [recording.cleaned(frames) for frames in stretches if recording.seen(frames).any()]
    shown = [one for one in shown if np.isfinite(one.xyz_m[..., 0]).any()]
    if not shown:
        raise MocapError(f"{recording.name}: no marker is seen in the stretches that are learned from")
    parts = [replace(seen_part(one), markers=np.arange(len(recording.names))) for one in shown]
    trials = [
        replace(marker_trial(one, part), name=f"{one.name} {i}")
        for i, (one, part) in enumerate(zip(shown, parts, strict=True))
    ]
    best = int(np.argmax([trial.seen.sum() for trial in trials]))
    others = [trial.xyz_m for i, trial in enumerate(trials) if i != best]
    steady = learn_constant_velocity(trials[best].xyz_m, dt_s=recording.dt_s, others=others)
    name, why = "constant_velocity", "as asked"
    if learned is not None:
        learned = renamed(learned, recording.skeleton.renamed(learned.names))
        name, why = "learned", f"learned from {', '.join(trial.name for trial in learned.trials[:6])}"
    elif model != "constant_velocity":
        reason = why_no_pose(shown[best], seen_part(shown[best]))
        if reason is not None and model == "mixture":
            raise MocapError(f"{recording.name}: no EAL model can be learned: {reason}; use `model` constant_velocity")
        learned = None if reason is not None else _mixture(recording, trials, seed)
        name, why = _choice(model, reason, learned)
        learned = learned if name == "mixture" else None
    return Known(name=name, why=why, steady=steady, learned=learned)


def _mixture(recording: LongRecording, trials: Sequence[MarkerTrial], seed: int) -> LearnedModel | None:
    seen = np.any([trial.seen.any(axis=0) for trial in trials], axis=0)
    names = [name for name, ever in zip(recording.names, seen, strict=True) if ever]
    kept = [replace(t, xyz_m=t.xyz_m[:, seen], sd_m=t.sd_m[:, seen]) for t in trials]
    skeleton, rng = recording.skeleton, np.random.default_rng(seed)
    trunk = [name for name in skeleton.trunk if name in names]
    try:
        return learn_model(
            names,
            trunk,
            kept,
            rng,
            bones=skeleton.rigid,
            models=[EACH_MARKER, PoseSettings(ranks=(8,))],
            effort=Effort(most_frames=300),
            call_all=call_all,
        )
    except MocapError:
        return None


def _choice(model: Model, reason: str | None, learned: LearnedModel | None) -> tuple[str, str]:
    if learned is None:
        return "constant_velocity", reason or "no gap could be hidden in the recording to learn how models are mixed"
    if model == "mixture":
        return "mixture", "as asked"
    rows = learned.scores
    first = next(iter(rows))
    errors = {name: float(np.mean(np.log(rows[name]["rmse_mm"]))) for name in (first, "mixture")}
    if errors["mixture"] <= errors[first]:
        return "mixture", "it fills gaps hidden in stretches of this recording better than constant velocity"
    return "constant_velocity", "it fills gaps hidden in stretches of this recording better than the mixture"


def track_block(recording: LongRecording, known: Known, core: range) -> tuple[Recording, slice, tuple[Finding, ...]]:
    """Track one block with its margins.

    Args:
        recording: The recording.
        known: What was learned of it.
        core: The block's own frames.

    Returns:
        The run of the block and its margins, without potentials; which of its frames are the block's own; and findings.
    """
    n, dt = recording.n_frames, recording.dt_s
    before = recording.seen(slice(max(0, core.start - MOST), core.start))[::-1]
    after = recording.seen(slice(core.stop, min(n, core.stop + MOST)))
    window = slice(core.start - margin(before, dt), core.stop + margin(after, dt))
    own = slice(core.start - window.start, core.stop - window.start)
    asked = asked_for(recording.names, recording.skeleton, n_frames=window.stop - window.start)
    if not recording.seen(window).any():
        return _nothing(recording, window, known, asked), own, ()
    prepared = recording.cleaned(window)
    if not np.isfinite(prepared.xyz_m[..., 0]).any():
        return _nothing(recording, window, known, asked), own, prepared.findings
    part, learned = seen_part(prepared), known.learned
    posed = learned is not None and why_no_pose(prepared, part) is None
    if posed and worth_checking(prepared):
        prepared = without_contradicted(prepared, part, learned)
        part = seen_part(prepared)
    mixed = track_mixed(prepared, part, learned, asked=asked) if posed else None
    name = "constant_velocity" if mixed is None else known.name
    smoothed = _steady(prepared, part, known, asked) if mixed is None else mixed.markers
    tracked = with_track(prepared, part, name, smoothed, asked)
    joints = joint_tracks(tracked.tracks, recording.skeleton, whole_frames(prepared))
    return replace(tracked, data=with_joints(tracked.data, joints)), own, prepared.findings


def _steady(prepared: Recording, part: Part, known: Known, asked: Asked) -> Estimate:
    """By constant velocity with what is known."""
    xyz = prepared.xyz_m[part.frames][:, part.markers]
    first = xyz[np.isfinite(xyz[..., 0]).argmax(axis=0), np.arange(xyz.shape[1])]
    motion = replace(known.steady, start_m=first, density=known.steady.density[part.markers])
    return track(prepared, part, FittedMotion(motion, prepared.t_s[part.frames]), asked=asked)


def _nothing(recording: LongRecording, window: slice, known: Known, asked: Asked) -> Recording:
    """A stretch in which nothing is seen."""
    t_s = recording.t_s[window]
    markers = marker_tracks(recording.names, t_s, np.full((len(t_s), len(recording.names), 3), np.nan))
    still = BodyFrames(rotation=np.repeat(np.eye(3)[None], len(t_s), axis=0), position_m=np.zeros((len(t_s), 3)))
    motion = motion_of(markers, slice(0, 0), None, asked)
    found = tracks_alone(of_points(markers, recording.skeleton, name=recording.name), known.name, motion)
    return replace(found, data=with_joints(found.data, joint_tracks(markers, recording.skeleton, still)))


def tracked_blocks(
    recording: LongRecording, known: Known, *, size: int = BLOCK, stages: Stages | None = None
) -> Iterator[tuple[range, Recording, slice, tuple[Finding, ...]]]:
    """All blocks, one after the other: the frames of each, then as ``track_block`` returns them."""
    stages = stages or Stages()
    blocks = blocks_of(recording.n_frames, size)
    for i, core in enumerate(blocks):
        with stages.stage("track in blocks") as progress:
            progress(i / len(blocks))
            found = track_block(recording, known, core)
        yield (core, *found)
        del found  # or it would live on while the next one is tracked
