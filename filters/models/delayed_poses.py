"""Missing markers from the others, in the same frame and in frames before and after: delayed poses.

Each marker's position in the body is regressed on the others by a Gaussian process (``filters/gaussian_process.py``).
Its linear part is the standard imputation of missing markers by the covariance of all (Liu & McMillan 2006; Tits,
Tilmanne & Dutoit 2018), with delays as in singular spectrum analysis. It is done in two views, from the body and from
the marker's neighbours (``Neighbours``), and both estimates are averaged. It knows nothing of dynamics, and
so errs differently from the motion models, which makes a mixture of both better than either
(docs/experiments/mixture.md).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.body_axes import BodyFrames, nearest_rotation
from mocap.filters.gaussian_process import Covariance, Rows, fitted, predict
from mocap.filters.hide import unseen_runs
from mocap.filters.poses import PoseTrial, Shapes, known_shapes, radian
from mocap.filters.records import Estimate
from mocap.filters.whittaker import smooth_series
from numpy.typing import NDArray

from eal.arrays import Array

EDGE = np.array((0, 1, 2, 3, 5, 8))
"""Frames on each side of a gap, counted from its edge, that are regressed on with the others."""
GAPS_TOGETHER = 25
"""Gaps of a marker that are filled at once, at most."""
LAGS = np.array((-1.2, -0.4, 0.0, 0.4, 1.2))
"""Delays, in units of the time in which the motion turns by a radian, sd(z) / sd(zdot)."""
FIRM = 0.03
"""Share of the mean shape's extent that holds the frame where neighbours do not tell how they turn: on a line. Chosen,
not measured."""


@dataclass(frozen=True, eq=False)
class MarkerGap:
    """Frames in which a marker is not seen.

    Attributes:
        marker: Which.
        inside: (n,) its frames.
        edges: (e,) frames near it in which the marker is seen.
        others: (M,) True for markers that are seen in at least half of it: what the regression may look at.
    """

    marker: int
    inside: NDArray[np.int64]
    edges: NDArray[np.int64]
    others: NDArray[np.bool_]


def fill_delayed(
    seen: NDArray[np.bool_], trials: Sequence[PoseTrial], shapes: Shapes, covariance: tuple[float, ...] = ()
) -> Estimate:
    """Fill the gaps of a trial.

    Args:
        seen: (T, M) samples of it that were measured.
        trials: Poses of all trials; the last is this one.
        shapes: Their shapes.
        covariance: Logarithms of the parameters of the process (``Covariance``); none: those under which the trials are
            likeliest.

    Returns:
        NaN where the trial has a measurement, and where there is nothing to estimate from.
    """
    delayed, frames = Delayed(trials, shapes), trials[-1].frames
    law = Covariance.of(np.array(covariance)) if covariance else delayed.covariance()
    y, spread = np.full((*seen.shape, 3), np.nan), np.full((*seen.shape, 3, 3), np.nan)
    alike: dict[tuple[int, bytes], list[MarkerGap]] = {}
    for gap in gaps_of(seen):
        alike.setdefault((gap.marker, gap.others.tobytes()), []).append(gap)
    for gaps in alike.values():
        for k in range(0, len(gaps), GAPS_TOGETHER):
            delayed.fill(gaps[k : k + GAPS_TOGETHER], law, y, spread)
    track = delayed.poses[-len(seen) :]
    for gap in (gap for gaps in alike.values() for gap in gaps):
        m = gap.marker
        if np.isfinite(y[gap.inside, m]).all():
            path = np.where(seen[:, m, None], track[:, m], y[:, m])
            y[gap.inside, m] = _smoothed(path, seen[:, m], gap.inside, 4.0 / delayed.tau)  # rad per unit
    xyz = np.einsum("tij,tmj->tmi", frames.rotation, y) + frames.position_m[:, None]
    return Estimate(xyz_m=xyz, cov_m2=np.einsum("tij,tmjl,tkl->tmik", frames.rotation, spread, frames.rotation))


class Delayed:
    """Delayed poses of several trials, to regress markers of the last one on.

    Attributes:
        poses: (N, M, 3) poses of all trials on end, completed.
        tau: Frames in which the motion turns by a radian.
    """

    def __init__(self, trials: Sequence[PoseTrial], shapes: Shapes) -> None:
        """Poses that are well enough known, evenly spread over the trials."""
        whole = completed(trials, shapes)
        self.poses = np.concatenate(whole).reshape(-1, whole[0].shape[1] // 3, 3)
        self._length = np.array([len(y) for y in whole])
        self._start = np.cumsum(self._length) - self._length
        self._last = len(trials) - 1
        self.tau = radian(shapes) / trials[-1].dt_s
        self._lags = np.unique(np.round(LAGS * self.tau).astype(int))
        self._seen = np.concatenate([np.isfinite(trial.y[:, ::3]) for trial in trials])
        usable = known_shapes(shapes)
        rows = [(k, frame) for k, mask in enumerate(usable[:-1]) for frame in np.flatnonzero(mask)]
        self._rows = np.array(rows, dtype=np.int64).reshape(-1, 2)[_even(len(rows), 300)]  # at most
        self._own = usable[-1]
        self._apart = _apart(self.poses[np.concatenate(usable)])

    def covariance(self) -> Covariance:
        """The covariance by which six sets of hidden markers are likeliest: one, a quarter, half of them; two each."""
        rng = np.random.default_rng(1)
        parts = np.split(self._seen, self._start[1:])
        present = np.flatnonzero(np.mean([seen.mean(axis=0) for seen in parts], axis=0) > 0.1)
        count, tasks = len(present), []
        for size in (1, max(2, count // 4), max(3, count // 2)) * 2:
            if count < size + 2:
                continue
            hidden = rng.choice(present, size, replace=False)
            others = np.isin(np.arange(self._seen.shape[1]), np.setdiff1d(present, hidden))
            shown = np.flatnonzero(parts[-1][:, hidden[0]])
            start = int(rng.integers(max(len(shown) - 60, 1)))
            frames = self._frames(hidden[0], shown[start : start + 60 : 2], rows=250, own=60)
            if len(frames) > 20:
                tasks += [(t.rows, t.values) for t in self._tasks(hidden[0], others, frames, frames[:0])]
        return fitted(tasks)

    def fill(self, gaps: Sequence[MarkerGap], covariance: Covariance, y: Array, spread: Array) -> None:
        """Write positions in the body (T, M, 3) and covariances (T, M, 3, 3) into gaps of one marker, equal others."""
        marker, others = gaps[0].marker, gaps[0].others
        edges = np.unique(np.concatenate([gap.edges for gap in gaps]))
        inside = np.concatenate([gap.inside for gap in gaps])
        frames = self._frames(marker, edges, rows=300, own=150)  # beside the edges of gaps
        if len(frames) < 2:
            return
        hidden_frames = np.column_stack([np.full(len(inside), self._last), inside])
        means, covs = [], []
        for task in self._tasks(marker, others, frames, hidden_frames):
            if others.any():
                mean, left = predict(covariance, task.rows, task.values)
            else:  # nothing to look at: the mean, as wide as the motion
                mean, left = np.zeros((len(inside), 3)), np.tile(task.values.var(axis=0), (len(inside), 1))
            turn = task.seen_from.rotation
            means.append((turn @ (mean + task.centre)[..., None])[..., 0] + task.seen_from.position_m)
            covs.append((turn * left[:, None]) @ np.swapaxes(turn, 1, 2))
        y[inside, marker], spread[inside, marker] = averaged(np.array(means), np.array(covs))

    def _at(self, frames: NDArray[np.int64]) -> Array:
        """(n, M, 3) poses of trials and frames (n, 2)."""
        return self.poses[self._start[frames[:, 0]] + frames[:, 1]]

    def _frames(self, marker: int, edges: NDArray[np.int64], *, rows: int, own: int) -> NDArray[np.int64]:
        """(n, 2) trials and frames in which the marker is seen: of other trials, of the last one, and at edges."""
        frames = self._rows[self._seen[self._start[self._rows[:, 0]] + self._rows[:, 1], marker]]
        mine = np.flatnonzero(self._seen[self._start[-1] :, marker] & self._own)
        mine = np.union1d(mine[_even(len(mine), own)], edges)
        last = np.column_stack([np.full(len(mine), self._last), mine])
        return np.concatenate([frames[_even(len(frames), rows)], last])

    def _tasks(
        self, marker: int, others: NDArray[np.bool_], frames: NDArray[np.int64], hidden: NDArray[np.int64]
    ) -> list["Task"]:
        """A marker known in some frames and asked for in others, seen from the body, and from three neighbours or more.

        It is regressed on delayed positions of the others, of which those that move with it weigh more. The ends of
        trials are held.
        """
        both, n, apart = np.concatenate([frames, hidden]), len(frames), self._apart[marker, others]
        poses, start = self._at(both), self._start[both[:, 0], None]
        delayed = self.poses[start + np.clip(both[:, 1:] + self._lags, 0, self._length[both[:, 0], None] - 1)]
        typical = max(float(np.median(apart)) if len(apart) else 1.0, 1e-12)
        weight = np.zeros((len(others), 1))
        weight[others, 0] = 1 / (apart / typical + 0.1)
        views = [body_itself(len(both))]
        if np.count_nonzero(others) >= 3:
            views.append(Neighbours.of(others, poses[:n], apart).frames(poses))
        tasks = []
        for seen_from in views:
            x = seen_from.to_body(delayed.reshape(len(both), -1, 3)).reshape(delayed.shape)
            x = (x * weight).reshape(len(both), -1)
            x -= x[:n].mean(axis=0)
            x /= max(float(np.sqrt(np.mean(np.sum(x[:n] ** 2, axis=1)))), 1e-12)
            values = _part(seen_from, slice(n)).to_body(poses[:n, [marker]])[:, 0]
            centre = values.mean(axis=0)
            rows = Rows(x=x, trial=both[:, 0], t=both[:, 1] / self.tau)
            tasks.append(Task(rows, values - centre, centre, _part(seen_from, slice(n, None))))
        return tasks


@dataclass(frozen=True, eq=False)
class Neighbours:
    """What a marker is seen from: a frame that moves with the markers near it.

    On a rigid segment a marker rests in the frame of those beside it, however the segment turns in the body (Tits,
    Tilmanne & Dutoit 2018 take three of them). Here all others are aligned with their mean shape by Procrustes analysis
    (Gower 1975; Kabsch 1976), and those that keep their distance to the marker weigh most: rigid or not, the frame
    turns as they do.

    Attributes:
        which: (M,) True for the k markers that are looked at.
        weight: (k,) of each of them; their sum is one.
        shape: (k, 3) their mean shape about its centre.
    """

    which: NDArray[np.bool_]
    weight: Array
    shape: Array

    @classmethod
    def of(cls, which: NDArray[np.bool_], poses: Array, apart: Array) -> "Neighbours":
        """Of poses (n, M, 3) without gaps, and what each of the k markers moves apart from the one that is asked for.

        Poses are aligned once, with their mean: they are seen from the body already.

        Args:
            which: (M,) the k markers.
            poses: See above.
            apart: (k,) see above.
        """
        # in units of the median, and a twentieth of it: what keeps its distance weighs most
        weight = (apart / max(float(np.median(apart)), 1e-12) + 0.05) ** -4.0
        points = poses[:, which]
        weight /= weight.sum()
        mean = points.mean(axis=0)
        mean = cls(which, weight, mean - weight @ mean)._frames(points).to_body(points).mean(axis=0)
        return cls(which, weight, mean - weight @ mean)

    def frames(self, poses: Array) -> BodyFrames:
        """Frames of poses (n, M, 3): the origin is the weighted mean, the axes are those of the mean shape."""
        return self._frames(poses[:, self.which])

    def _frames(self, points: Array) -> BodyFrames:
        centre = self.weight @ points
        covariance = np.swapaxes(points - centre[:, None], 1, 2) @ (self.weight[:, None] * self.shape)
        extent = self.weight @ np.sum(self.shape**2, axis=1)
        return BodyFrames(rotation=nearest_rotation(covariance + FIRM / 3 * extent * np.eye(3)), position_m=centre)


def body_itself(count: int) -> BodyFrames:
    """The frame that poses are given in, so many times."""
    return BodyFrames(rotation=np.tile(np.eye(3), (count, 1, 1)), position_m=np.zeros((count, 3)))


@dataclass(frozen=True, eq=False)
class Task:
    """A regression.

    Attributes:
        rows: What is looked at in n frames, then in those that are asked for.
        values: (n, 3) centred positions of the marker.
        centre: (3,) what was taken off them.
        seen_from: The frames of reference of those that are asked for.
    """

    rows: Rows
    values: Array
    centre: Array
    seen_from: BodyFrames


def averaged(means: Array, covs: Array) -> tuple[Array, Array]:
    """Mean and covariance of K normal densities, (K, ..., 3) and (K, ..., 3, 3), mixed by their squared precisions."""
    weight = np.trace(covs, axis1=-2, axis2=-1) ** -2.0
    weight /= weight.sum(axis=0)
    mean = np.einsum("k...,k...i->...i", weight, means)
    apart = means - mean
    return mean, np.einsum("k...,k...ij->...ij", weight, covs + apart[..., :, None] * apart[..., None, :])


def gaps_of(seen: NDArray[np.bool_]) -> Iterator[MarkerGap]:
    """All gaps of (T, M) sightings, those at the ends of the trial included."""
    for marker, start, stop in unseen_runs(seen):
        near = np.concatenate([start - 1 - EDGE[::-1], stop + EDGE])
        near = near[(near >= 0) & (near < len(seen))]
        others = seen[start:stop].mean(axis=0) >= 0.5
        yield MarkerGap(marker, np.arange(start, stop), near[seen[near, marker]], others)


def completed(trials: Sequence[PoseTrial], shapes: Shapes) -> list[Array]:
    """(T, 3M) poses of each trial, as the subspace has them where a marker is not seen."""
    subspace = shapes.subspace
    return [
        np.where(np.isfinite(trial.y), trial.y, subspace.mean + offset + z @ subspace.basis.T)
        for trial, z, offset in zip(trials, shapes.z, shapes.offset, strict=True)
    ]


def _part(frames: BodyFrames, part: slice) -> BodyFrames:
    return BodyFrames(rotation=frames.rotation[part], position_m=frames.position_m[part])


def _apart(poses: Array) -> Array:
    """(M, M) root mean square by which two markers move apart, of (T, M, 3) poses."""
    centred = poses - poses.mean(axis=0)
    inner = np.einsum("tmi,tki->mk", centred, centred) / len(poses)
    square = np.diag(inner)
    return np.sqrt(np.maximum(square[:, None] + square - 2 * inner, 0.0))


def _even(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most so many of ``count`` things, evenly spread."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(int)


def _smoothed(track: Array, seen: NDArray[np.bool_], inside: NDArray[np.int64], cutoff: float) -> Array:
    """(n, 3) a gap of a track (T, 3), smoothed with the measured samples near it held; cutoff in radians a frame."""
    near = np.arange(max(0, inside[0] - 10), min(len(track), inside[-1] + 11))
    here = (near >= inside[0]) & (near <= inside[-1])
    weight = np.where(seen[near], 1e4, here * 1.0)
    return smooth_series(track[near], weight, dt_s=1.0, cutoff_hz=cutoff / (2 * np.pi))[here]
