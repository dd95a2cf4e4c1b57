"""Long recordings in blocks: what is learned is learned once, and each block is tracked with frames on either side.

Memory is that of one block, whatever the number of frames, and time is linear. What a smoother says of a frame depends
on frames far from it by a factor that falls exponentially with their distance, once each marker was seen for some
frames; a block is therefore tracked with a margin in which that has happened (``margin``), and only its own frames are
kept. docs/howto/long_recordings.md has what differs from tracking the whole at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap.cleaning.cleaned import Cleaned
from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError
from mocap.filters.model import LearnedModel
from mocap.filters.models.registry import NAMED
from mocap.filters.score import Score
from mocap.io.tables_long import LongTable
from mocap.progress import Stages
from mocap.reading.decided import decided
from mocap.reading.reading import animal
from mocap.recording import Recording, Source, dataset, of_points
from mocap.records import Status, marker_tracks
from mocap.text import as_text
from mocap.tracking.learning import learn_from
from mocap.tracking.result import Result, rate_points
from mocap.tracking.track_part import track_part
from mocap.tracking.tracking import PREPARE, each_alone, motion_of, of_tracks, seen_part, why_no_pose

Mask = NDArray[np.bool_]

LEAST_S, LEAST, MOST = 0.5, 60, 1000
"""A margin is this long in seconds and in frames at least, in frames at most. After 60 frames constant velocity has
forgotten all but e^-20 (tests/mocap/test_blocks.py); the others are chosen, not measured."""
EXCERPTS, EXCERPT = 6, 400
"""What is learned once is learned from so many stretches of so many frames, evenly over the recording; chosen."""


def blocks_of(n_frames: int, size: int) -> list[range]:
    """Blocks of at most so many frames, all of about one length."""
    count = max(1, -(-n_frames // size))
    edges = np.linspace(0, n_frames, count + 1).astype(int)
    return [range(int(a), int(b)) for a, b in pairwise(edges)]


def sighted(recording: Recording) -> Mask:
    """(T, M) True where a position, or two rays, are given; nothing is cleaned."""
    return recording.seen.sum(axis=0) >= 2 if "pixels" in recording.data else recording.seen


def margin(seen: Mask, dt_s: float) -> int:
    """Frames that a block is tracked with beyond its end, given (n, M) sightings from there on, nearest first.

    So many that each marker that is seen in the next ``MOST`` frames was seen in 30 of these.
    """
    least = max(LEAST, round(LEAST_S / dt_s))
    count = np.cumsum(seen[:MOST], axis=0)
    if not len(count):
        return 0
    wanted = np.minimum(30, count[-1])  # chosen, not measured
    steady = (count >= wanted).argmax(axis=0) + 1
    return min(len(count), MOST, max(least, int(steady.max(initial=0))))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class OnDisk(Recording):
    """A recording whose positions are read where some of its frames are asked for; its Dataset has times and names.

    Attributes:
        table: Where they are; samples that were not measured are left out.
    """

    table: LongTable

    @classmethod
    def of(cls, path: Path, skeleton_file: Path | None = None) -> "OnDisk":
        """Positions in a Parquet table, with a skeleton TOML; None: none.

        Raises:
            FormatError: the file is no such table, or is not sorted.
            SkeletonError: the skeleton cannot be read, or names markers that the recording lacks.
        """
        table = LongTable(path)
        skeleton, names = animal(skeleton_file, table.names)
        data = dataset(names, table.t_s)
        inputs = (path,) if skeleton_file is None else (path, skeleton_file)
        source = Source(file=path, inputs=inputs)
        return cls(name=as_text(path.stem), data=data, skeleton=skeleton, source=source, table=table)

    def at(self, frames: slice) -> Recording:  # type: ignore[override]
        """Some of its frames, in memory."""
        found, _ = self.table.read(frames)
        xyz = np.where((found.status == Status.MEASURED)[..., None], found.xyz_m, np.nan)
        tracks = marker_tracks(self.names, found.t_s, xyz, cov_m2=found.cov_m2)
        return of_points(tracks, self.skeleton, name=self.name)


def learn_excerpts(
    recording: Recording, *, model: str = "auto", seed: int = 0, stages: Stages | None = None
) -> tuple[LearnedModel | None, str]:
    """What all blocks are tracked with: the model of stretches of a recording (``learn_from``), and why.

    Args:
        recording: The recording.
        model: ``mixture``, or ``auto``: none, where these teach no pose.
        seed: Where gaps are hidden.
        stages: Timer and progress.

    Raises:
        MocapError: a mixture is asked for and cannot be learned.
    """
    n_frames = len(recording.t_s)
    length = min(EXCERPT, n_frames)
    count = EXCERPTS if n_frames > EXCERPTS * EXCERPT else n_frames // length
    shown, stages = [], stages or Stages()
    with stages.stage(PREPARE) as share:
        for number, start in enumerate(np.linspace(0, n_frames - length, count).astype(int).tolist(), start=1):
            part = recording.at(slice(start, start + length))
            if sighted(part).any():
                shown.append(replace(clean(part, first=start), name=f"frames {start + 1} to {start + length}"))
            share(number / count)
    shown = [one for one in shown if np.isfinite(one.xyz_m[..., 0]).any()]
    reasons = [why_no_pose(seen_part(one)) for one in shown]
    try:
        if None not in reasons:
            raise MocapError(reasons[0] if reasons else "no marker is seen in the frames that are learned from")
        return learn_from(shown, seed=seed, stages=stages), f"learned from {len(shown)} x {length} frames of it"
    except MocapError as error:
        if model == "mixture":
            raise MocapError(
                f"{recording.name}: no EAL model can be learned: {error}; use `model` constant_velocity"
            ) from None
        return None, str(error)


def track_block(
    recording: Recording,
    core: range,
    *,
    model: str = "constant_velocity",
    learned: LearnedModel | None = None,
    excerpts: bool = False,
    validated: bool = False,
    seed: int = 0,
) -> tuple[Result, Recording, slice, Mapping[str, Score]]:
    """Track one block with its margins, as ``run_job`` tracks a recording; where no pose is shown, each marker alone.

    Args:
        recording: The recording.
        core: The block's own frames.
        model: Of ``mocap.filters.models.registry.NAMED``.
        learned: A model to track with in its place.
        excerpts: Whether that was learned from stretches of this recording; those of these frames are left out.
        validated: Whether to hide samples and measure how they are filled.
        seed: Which samples to hide.

    Returns:
        The block with its margins as it was tracked, and as it was cleaned; which of its frames are the block's own;
        and how gaps that were hidden in it were filled.
    """
    first = max(0, core.start - MOST)
    around = recording.at(slice(first, min(len(recording.t_s), core.stop + MOST)))
    seen, dt_s = sighted(around), recording.dt_s
    before, after = margin(seen[: core.start - first][::-1], dt_s), margin(seen[core.stop - first :], dt_s)
    start = core.start - before - first
    own = slice(before, before + len(core))
    part = around.at(slice(start, start + own.stop + after))
    part = part.with_part(replace(decided(part), assumed_unit=None, of_pixels=(), of_files=(), beside=None))
    seen = seen[start : start + own.stop + after]
    cleaned = clean(part, first=first + start) if seen.any() else part
    if not cleaned.cleaned or not np.isfinite(cleaned.xyz_m[..., 0]).any():
        nowhere = marker_tracks(part.names, part.t_s, np.full((*seen.shape[-2:], 3), np.nan))
        empty = of_tracks(nowhere, part.skeleton, name=part.name, model=model)
        empty = empty.with_motion(motion_of(nowhere, slice(0, 0), None, rate_points(part)))
        return empty, empty.with_part(Cleaned(told=cleaned.findings)), own, {}
    posed = why_no_pose(seen_part(cleaned)) is None
    if not posed and NAMED[model].posed:
        model = each_alone(seen_part(cleaned))
    if excerpts and learned is not None:
        begin, end = part.t_s[0], part.t_s[-1]
        learned = replace(learned, trials=tuple(t for t in learned.trials if t.t_s[-1] < begin or t.t_s[0] > end))
    tracked, cleaned, _, scores = track_part(
        cleaned,
        model=model,
        learned=learned if posed else None,
        stages=Stages(),
        validated=validated,
        seed=seed,
    )
    return tracked, cleaned, own, scores
