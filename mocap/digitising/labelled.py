"""Names for unlabelled trajectories of an optical system, from poses of the same kind of animal."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.digitising.pose import FEWEST_OF_POSE, PoseGaussian, fit_poses
from mocap.digitising.register import POINT_GATE, POINT_MARGIN, recognise, unlikely
from mocap.errors import FormatError, MocapError
from mocap.filters.model import LearnedModel
from mocap.io.contents import FileContents
from mocap.io.format import Hints
from mocap.io.output import result_file
from mocap.io.registry import read, write, writer
from mocap.io.unstated_unit import in_metres
from mocap.records import marker_tracks
from mocap.tracking.learning import Model, load_model

_SAMPLES, _LAGS = 12, 30


@dataclass(frozen=True, kw_only=True)
class TrajectoryPiece:
    """A piece of a trajectory without gap or jump.

    Attributes:
        column: Its column.
        first: First frame.
        last: Last frame.
    """

    column: int
    first: int
    last: int

    def overlaps(self, other: "TrajectoryPiece") -> bool:
        """Whether both are there at the same time."""
        return self.first <= other.last and other.first <= self.last


@dataclass(frozen=True, eq=False, kw_only=True)
class Labelled:
    """Segments with their names.

    Attributes:
        segments: All segments.
        marker: (S,) number of the marker that each is of; -1: it stays unnamed.
    """

    segments: tuple[TrajectoryPiece, ...]
    marker: NDArray[np.int64]

    def tracks(self, xyz_m: Array, n_markers: int) -> tuple[Array, Array]:
        """The positions of the markers (T, M, 3), and what is unnamed in its columns (T, N, 3)."""
        named = np.full((len(xyz_m), n_markers, 3), np.nan)
        left = xyz_m.copy()
        for segment, marker in zip(self.segments, self.marker, strict=True):
            if marker >= 0:
                frames = slice(segment.first, segment.last + 1)
                named[frames, marker] = xyz_m[frames, segment.column]
                left[frames, segment.column] = np.nan
        return named, left


def cut(xyz_m: Array, *, jump_m: float) -> tuple[TrajectoryPiece, ...]:
    """Pieces of trajectories (T, N, 3) between gaps, and between jumps that are far from the way before.

    Args:
        xyz_m: Trajectories; NaN where there is nothing.
        jump_m: A step that differs from the one before by more than this is a jump to another marker.
    """
    out = []
    for column in range(xyz_m.shape[1]):
        path = xyz_m[:, column]
        seen = np.isfinite(path[:, 0])
        step = np.full(path.shape, np.nan)
        step[1:] = path[1:] - path[:-1]
        bend = np.linalg.norm(step - np.vstack([step[:1] * np.nan, step[:-1]]), axis=1)
        size = np.nan_to_num(np.linalg.norm(step, axis=1))
        broken = ~seen | (size > 5 * jump_m) | ((np.nan_to_num(bend) > jump_m) & (size > jump_m))
        starts = seen & (np.concatenate([[True], ~seen[:-1]]) | broken)
        for first in np.flatnonzero(starts):
            after = np.flatnonzero(~seen[first + 1 :] | starts[first + 1 :])
            last = first + int(after[0]) if len(after) else len(path) - 1
            out.append(TrajectoryPiece(column=column, first=int(first), last=int(last)))
    return tuple(out)


def label_segments(xyz_m: Array, poses: PoseGaussian) -> Labelled:
    """Name trajectories by the poses of the animal.

    In frames that show many points the animal is recognised (``mocap.digitising.register``); the others follow from
    these: a segment gets the name of the marker where the pose given the named ones puts it, and whose earlier or later
    segment goes on in it, if every other name is less likely by far. What is unsure, and what is no marker of the
    animal, stays unnamed.

    Args:
        xyz_m: (T, N, 3) trajectories; NaN where there is nothing; a column may hold several markers in turn.
        poses: Poses of M markers (``fit_poses``).

    Raises:
        MocapError: the animal is recognised in no frame.
    """
    length = float(np.linalg.norm(np.ptp(poses.mean, axis=0)))
    segments = cut(xyz_m, jump_m=0.1 * length)
    state = _Fitted(xyz_m, segments, poses)
    if not state.anchor():
        raise MocapError(
            "the animal of the model is recognised in no frame of this recording: the model must know these "
            "markers, in the same places on the animal; check the unit of lengths"
        )
    while state.grow():
        pass
    state.check()
    while state.grow():
        pass
    return Labelled(segments=segments, marker=state.marker)


class _Fitted:
    """Names while they are being found."""

    def __init__(self, xyz_m: Array, segments: tuple[TrajectoryPiece, ...], poses: PoseGaussian) -> None:
        self.xyz, self.segments, self.poses = xyz_m, segments, poses
        self.marker = np.full(len(segments), -1)
        self.refused: set[tuple[int, int]] = set()
        shape = (len(xyz_m), len(poses.mean))
        self.owner = np.full(shape, -1)  # segment that is a marker in a frame
        self.at = np.full((*shape, 3), np.nan)
        self.lag_m2 = self._lags()
        size_m = np.maximum(np.ptp(poses.mean, axis=0), 0.1 * np.ptp(poses.mean))
        # what belongs to no marker is anywhere about the animal: -2 log density, in the units of ``unlikely``
        self.ghost = 2 * float(np.log(np.prod(1.5 * size_m / 1e-3)) - 1.5 * np.log(2 * np.pi))

    def _lags(self) -> Array:
        """(L + 1,) variance by which straight lines miss trajectories so many frames later, in one coordinate."""
        out = np.zeros(_LAGS + 1)
        for lag in range(1, _LAGS + 1):
            ahead = self.xyz[3 + lag :] - self.xyz[3:-lag] - (self.xyz[3:-lag] - self.xyz[: -lag - 3]) / 3 * lag
            good = ahead[np.isfinite(ahead)]
            out[lag] = np.quantile(good**2, 0.9) if len(good) > 30 else out[lag - 1] * 1.5 + 1e-6
        return np.maximum.accumulate(out) + 1e-8

    def name(self, segment: int, marker: int) -> None:
        """Give a name."""
        s = self.segments[segment]
        self.marker[segment] = marker
        frames = slice(s.first, s.last + 1)
        self.owner[frames, marker] = segment
        self.at[frames, marker] = self.xyz[frames, s.column]

    def unname(self, segment: int) -> None:
        """Take a name away."""
        s, marker = self.segments[segment], self.marker[segment]
        frames = slice(s.first, s.last + 1)
        self.owner[frames, marker], self.at[frames, marker] = -1, np.nan
        self.refused.add((segment, int(marker)))
        self.marker[segment] = -1

    def free(self, segment: int, marker: int) -> bool:
        """Whether the marker has no other segment at that time."""
        s = self.segments[segment]
        taken = (self.owner[s.first : s.last + 1, marker] >= 0).any()
        return not taken and (segment, marker) not in self.refused

    def present(self, frame: int) -> list[int]:
        """Segments of a frame."""
        return [i for i, s in enumerate(self.segments) if s.first <= frame <= s.last]

    def anchor(self) -> bool:
        """Recognise the animal in frames with many unnamed points; True if it was, in one."""
        seen = np.isfinite(self.xyz[..., 0])
        named = (self.owner >= 0).sum(axis=1)
        lasting = np.zeros(len(self.xyz))
        for s, m in zip(self.segments, self.marker, strict=True):
            if m < 0:
                lasting[s.first : s.last + 1] += np.minimum(s.last - s.first + 1, 50) / 50
        lasting[named >= FEWEST_OF_POSE] = 0
        tried = 0
        done = False
        while tried < 12 and lasting.max(initial=0) >= FEWEST_OF_POSE:
            frame = int(np.argmax(lasting))
            lasting[max(frame - len(lasting) // 30 - 5, 0) : frame + len(lasting) // 30 + 6] = 0
            columns = np.flatnonzero(seen[frame])
            found = recognise(self.xyz[frame, columns], self.poses)
            tried += 1
            if found is None or found.margin < 12.0 or found.sure.sum() < 0.5 * (found.point >= 0).sum():
                continue
            here = {self.segments[i].column: i for i in self.present(frame)}
            for marker in np.flatnonzero(found.sure):
                segment = here[int(columns[found.point[marker]])]
                if self.marker[segment] < 0 and self.free(segment, int(marker)):
                    self.name(segment, int(marker))
                    done = True
            if done:
                break
        return done

    def cost(self, segment: int, guesses: dict[tuple[int, int], tuple[Array, Array]]) -> Array:
        """(M,) -2 log likelihood of each marker; infinite where it is taken, or nothing tells."""
        s = self.segments[segment]
        frames = np.unique(np.linspace(s.first, s.last, _SAMPLES).astype(int))
        total, counted = np.zeros(len(self.poses.mean)), 0
        for frame in frames.tolist():
            found = self.guess(frame, guesses)
            if found is None:
                continue
            at, spread = found
            away = self.xyz[frame, s.column] - at
            total += unlikely(away, spread)
            counted += 1
        if not counted:
            return np.full(len(total), np.inf)
        cost = total / counted  # samples of one segment err alike: they count as one
        for marker in range(len(cost)):
            if not self.free(segment, marker):
                cost[marker] = np.inf
            else:
                cost[marker] += self.continued(s, marker)
        return cost

    def guess(self, frame: int, guesses: dict[tuple[int, int], tuple[Array, Array]]) -> tuple[Array, Array] | None:
        """All markers of a frame, given those that are named there."""
        key = (frame, int((self.owner[frame] >= 0).sum()))
        if key not in guesses:
            found = self.poses.given(np.nan_to_num(self.at[frame]), self.owner[frame] >= 0)
            if found is None:
                return None
            guesses[key] = found
        return guesses[key]

    def continued(self, s: TrajectoryPiece, marker: int) -> float:
        """What the marker's own segments shortly before and after tell: less than 0 where this one goes on in them."""
        out = 0.0
        for sign, end in ((-1, s.first), (1, s.last)):
            for lag in range(1, _LAGS + 1):
                frame = end + sign * lag
                if not 0 <= frame < len(self.xyz):
                    break
                if self.owner[frame, marker] < 0:
                    continue
                own, path = self.xyz[frame, self.segments[self.owner[frame, marker]].column], self.xyz[:, s.column]
                inner = end - sign * 3
                rate = (path[end] - path[inner]) / 3 if s.first <= inner <= s.last else np.zeros(3)
                away = own - (path[end] + rate * lag)
                variance = self.lag_m2[lag] * (1 if s.first <= inner <= s.last else 4)
                out += min(float(away @ away) / variance, 4 * POINT_GATE) + 3 * np.log(variance / 1e-6) - 3 * np.log(
                    self.lag_m2[-1] / 1e-6
                )  # fmt: skip
                break
        return out

    def grow(self) -> bool:
        """Name what is surest now; True if anything was named."""
        guesses: dict[tuple[int, int], tuple[Array, Array]] = {}
        table = {}
        for i in np.flatnonzero(self.marker < 0).tolist():
            cost = self.cost(i, guesses)
            if np.isfinite(cost).any():
                table[i] = cost
        ranked = []
        for i, cost in table.items():
            marker = int(np.argmin(cost))
            if not self.fits(i, marker, guesses):
                continue
            rest = np.append(np.delete(cost, marker), self.ghost + 2.0)  # rather a marker than a ghost, by e
            margin = float(rest.min(initial=np.inf) - cost[marker])
            rivals = [
                c[marker] - cost[marker]
                for j, c in table.items()
                if j != i and self.segments[j].overlaps(self.segments[i]) and self.fits(j, marker, guesses)
            ]
            margin = min([margin, *rivals])
            if margin > POINT_MARGIN:
                ranked.append((margin, i, marker))
        ranked.sort(reverse=True)
        named = 0
        for margin, i, marker in ranked:
            if named and margin < 0.3 * ranked[0][0]:
                break
            if self.free(i, marker):
                self.name(i, marker)
                named += 1
        if not named:
            return self.anchor()
        return True

    def fits(self, segment: int, marker: int, guesses: dict[tuple[int, int], tuple[Array, Array]]) -> bool:
        """Whether the segment lies where the marker may be."""
        away = self.off(segment, marker, lambda frame: self.guess(frame, guesses))
        return away is not None and away < POINT_GATE

    def off(self, segment: int, marker: int, guess: Callable[[int], tuple[Array, Array] | None]) -> float | None:
        """Median squared distance of a segment from where the marker is guessed, in variances; None: nothing tells."""
        s, found = self.segments[segment], []
        for frame in np.unique(np.linspace(s.first, s.last, _SAMPLES).astype(int)).tolist():
            if (guessed := guess(frame)) is not None:
                away = self.xyz[frame, s.column] - guessed[0][marker]
                found.append(float(away @ np.linalg.solve(guessed[1][marker], away)))
        return float(np.median(found)) if found else None

    def check(self) -> None:
        """Take back the names of segments that do not fit the pose given all others."""
        for i in np.flatnonzero(self.marker >= 0).tolist():
            marker, every = self.marker[i], np.arange(len(self.poses.mean))

            def by_others(frame: int, others: NDArray[np.bool_] = every != marker) -> tuple[Array, Array] | None:
                return self.poses.given(np.nan_to_num(self.at[frame]), (self.owner[frame] >= 0) & others)

            if (self.off(i, marker, by_others) or 0.0) > 1.5 * POINT_GATE:
                self.unname(i)


PathText = str | PathLike[str]


@dataclass(frozen=True, eq=False)
class LabelledRecording:
    """A recording whose trajectories were named.

    Attributes:
        contents: The named markers, and what stays unnamed as ``U_1``, ``U_2``, ...
        found: Segments of trajectories and their names.
        names: The M markers of the model.
    """

    contents: FileContents
    found: Labelled
    names: tuple[str, ...]

    @property
    def summary(self) -> Mapping[str, int]:
        """Numbers of samples and segments that were named and that were not."""
        size = np.array([s.last - s.first + 1 for s in self.found.segments], dtype=np.int64)
        named = self.found.marker >= 0
        return {
            "named_samples": int(size[named].sum()),
            "unnamed_samples": int(size[~named].sum()),
            "named_segments": int(named.sum()),
            "unnamed_segments": int((~named).sum()),
        }

    def save(self, path: PathText, *, overwrite: bool = False) -> list[str]:
        """Write it in the format that the end of the name says; returns what that format does not hold.

        Raises:
            OutputError: it cannot be written there.
            FormatError: no format has such a name.
        """
        out = Path(path)
        with result_file(out, replace=overwrite, inputs=self.contents.paths) as file:
            return self.write(file)

    def write(self, file: Path) -> list[str]:
        """Write the file of ``save``, as ``mocap.io.output.result_file`` gives it."""
        return write(self.contents, file, writer(file, None).name)


def label(
    tracks: PathText,
    *,
    model: PathText | Model,
    unit: str | None = None,
    fps: float | None = None,
    hints: Hints | None = None,
) -> LabelledRecording:
    """Name the trajectories of a recording (C3D with ``*1``, ``U_5``, ...; Qualisys, Vicon) by a learned model.

    Whatever names the file has are not read: all trajectories are named anew. They are cut at gaps and jumps; in
    frames with many points the animal is recognised by distances between markers that hardly change, and the other
    pieces follow from where the pose puts each marker and from how pieces go on in each other. A name is given where
    every other one, and that the point is no marker at all, is less likely by exp(6); all else stays unnamed.

    Args:
        tracks: Positions in any format that mocap knows.
        model: A file of ``mocap learn``, or a model: its trials hold poses of this kind of animal with these markers.
        unit: Unit of lengths, where the file does not state it.
        fps: Frames a second, where the file does not state it.
        hints: How the file is to be read where it does not say so itself.

    Raises:
        FormatError: the file holds no positions, or cannot be read.
        MocapError: the animal is not recognised in any frame, or the model has too few poses.
    """
    contents, _ = in_metres(read(Path(tracks), replace(hints or Hints(), fps=fps)), unit)
    contents = contents if fps is None else contents.with_rate(fps)
    if contents.points is None:
        raise FormatError(f"{Path(tracks).name}: contains no positions ({contents.format}): give trajectories in space")
    learned: LearnedModel = (model if isinstance(model, Model) else load_model(model)).learned
    trunk = [learned.names.index(name) for name in learned.trunk if name in learned.names]
    poses = fit_poses(np.concatenate([trial.xyz_m for trial in learned.trials]), trunk, rank=12)
    if poses is None:
        raise FormatError("`model`: its trials hold too few poses that show half of the markers: learn it from more")
    found = label_segments(contents.points.xyz_m, poses)
    named, left = found.tracks(contents.points.xyz_m, len(learned.names))
    left = packed(left)
    count = left.shape[1]
    extra, number = [], 0
    while len(extra) < count:
        number += 1
        if f"U_{number}" not in learned.names:
            extra.append(f"U_{number}")
    points = marker_tracks((*learned.names, *extra), contents.points.t_s, np.concatenate([named, left], axis=1))
    clean = replace(contents, names=points.names, points=points, animals=(), score=None, tables={})
    return LabelledRecording(clean, found, learned.names)


def packed(left: np.ndarray) -> np.ndarray:
    """(T, K, 3) of trajectories (T, N, 3) in as few columns as they need, none joined within five frames."""
    columns: list[np.ndarray] = []
    for column in left.transpose(1, 0, 2):
        seen = np.flatnonzero(np.isfinite(column[:, 0]))
        if not len(seen):
            continue
        first, last = max(int(seen[0]) - 5, 0), int(seen[-1]) + 6
        for other in columns:
            if np.isnan(other[first:last]).all():
                other[seen] = column[seen]
                break
        else:
            columns.append(column.copy())
    return np.stack(columns, axis=1) if columns else np.zeros((len(left), 0, 3))
