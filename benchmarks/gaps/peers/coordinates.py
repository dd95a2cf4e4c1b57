"""Body coordinates that mean the same in every trial: where the trunk is taken to be at rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.body_axes import body_frames
from mocap.filters.interpolate import blended
from mocap.filters.subspace import principal_components

from benchmarks.gaps.method import Estimate, Trial
from eal.arrays import Array

BODY_HZ = 3.0
"""Faster motion of the trunk is left to the pose, as in the tracker (``mocap.filters.poses.poses_of``)."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A trial in coordinates y = R^T (x - p).

    Attributes:
        trial: The trial.
        y: (T, M, 3) positions; NaN where not seen.
        rotation: (T, 3, 3) R, body axes to world axes.
        position_m: (T, 3) p, origin of the body in the world.
    """

    trial: Trial
    y: Array
    rotation: Array
    position_m: Array

    @property
    def poses(self) -> Array:
        """(T, 3 M) rows of ``y``."""
        return self.y.reshape(len(self.y), -1)

    def leave(self, y: Array, cov: Array | None = None) -> Estimate:
        """Back in the world; ``y`` (T, M, 3), ``cov`` (T, M, 3, 3) or None."""
        xyz = np.einsum("tij,tmj->tmi", self.rotation, y) + self.position_m[:, None]
        if cov is None:
            return Estimate(xyz, None)
        return Estimate(xyz, self.rotation[:, None] @ cov @ self.rotation[:, None].swapaxes(-1, -2))


@dataclass(frozen=True, eq=False)
class World:
    """No change of coordinates."""

    def place(self, trial: Trial) -> Placed:
        """The trial as it is."""
        n = len(trial.t_s)
        return Placed(trial, trial.xyz_m, np.repeat(np.eye(3)[None], n, axis=0), np.zeros((n, 3)))


@dataclass(frozen=True, eq=False)
class Body:
    """Coordinates of a trunk of known shape.

    Attributes:
        shape: (K, 3) mean trunk of the training trials, the markers in the order of ``Trial.trunk``.
    """

    shape: Array

    def place(self, trial: Trial) -> Placed:
        """Take out how the trunk moves (``body_frames``), and bring its mean shape to that of training."""
        points = _trunk(trial)
        if not np.isfinite(points).any():
            return World().place(trial)
        frames = body_frames(points, dt_s=_step(trial), cutoff_hz=BODY_HZ)
        turn, shift = _align(_mean(frames.to_body(points)), self.shape)
        rotation = frames.rotation @ turn.T
        position = frames.position_m - rotation @ shift
        y = np.einsum("tji,tmj->tmi", rotation, trial.xyz_m - position[:, None])
        return Placed(trial, y, rotation, position)


def learn_body(training: Sequence[Trial]) -> Body:
    """The mean trunk of several trials: generalised Procrustes alignment of their mean trunks (Gower 1975)."""
    shapes = []
    for trial in training:
        points = _trunk(trial)
        if np.isfinite(points).any():
            frames = body_frames(points, dt_s=_step(trial), cutoff_hz=BODY_HZ)
            shapes.append(_mean(frames.to_body(points)))
    if not shapes:
        return Body(np.zeros((0, 3)))
    mean = shapes[0]
    for _ in range(3):
        moved = [(shape @ turn.T) + shift for shape in shapes for turn, shift in [_align(shape, mean)]]
        mean = _mean(np.array(moved))
    return Body(mean)


def _trunk(trial: Trial) -> Array:
    """(T, K, 3) markers of the trunk; all markers where the set names none."""
    wanted = [trial.names.index(name) for name in trial.trunk] or list(range(len(trial.names)))
    return trial.xyz_m[:, wanted]


def _step(trial: Trial) -> float:
    return float(np.mean(np.diff(trial.t_s))) if len(trial.t_s) > 1 else 1.0


def _mean(points: Array) -> Array:
    """(K, 3) mean of (T, K, 3) points over the frames that see them; NaN for those never seen."""
    seen = np.isfinite(points)
    count = seen.sum(axis=0)
    return np.where(count > 0, np.where(seen, points, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _align(shape: Array, target: Array) -> tuple[Array, Array]:
    """Rotation R and shift s that bring R shape + s nearest to the target (Kabsch 1976), over points known in both.

    Fewer than three known points, or points in a line, are only shifted.
    """
    known = np.isfinite(shape).all(axis=-1) & np.isfinite(target).all(axis=-1)
    if not known.any():
        return np.eye(3), np.zeros(3)
    a, b = shape[known], target[known]
    turn = np.eye(3)
    u, s, vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
    if known.sum() >= 3 and s[1] > 1e-3 * s[0]:
        u[:, -1] *= np.sign(np.linalg.det(u @ vt))
        turn = u @ vt
    return turn, b.mean(axis=0) - turn @ a.mean(axis=0)


def usable(poses: Array, *, share: float = 0.3) -> Array:
    """Rows of (N, D) poses that show more than ``share`` of their entries (all rows if none does)."""
    keep = np.isfinite(poses).mean(axis=1) > share
    return poses[keep] if keep.any() else poses


def completed(trials: Sequence[Placed], *, rank: int = 12) -> list[Array]:
    """Poses (T, D) of each trial without NaN: what is missing is filled by principal components of all trials."""
    rows = [placed.poses for placed in trials]
    if all(np.isfinite(r).all() for r in rows):
        return rows
    stacked = np.concatenate(rows)
    fit = principal_components(stacked, max(1, min(rank, stacked.shape[1] // 2, len(stacked) // 4)), iterations=12)
    models = np.split(fit.poses, np.cumsum([len(y) for y in rows])[:-1])
    return [blended(y, model) for y, model in zip(rows, models, strict=True)]
