"""What trials tell of poses and of how they change: the prior of a recording that one camera alone has seen."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mocap.filters.bones import LEAST_SIZE, log_distances, rigid_bones, sized_like
from mocap.filters.models.pose import body_density, learn_potential, unseen_potential
from mocap.filters.motion.potential import Bones
from mocap.filters.poses import LEAST_KNOWN, MATERN_3_2_HALF, MarkerTrial, poses_of
from mocap.filters.subspace import principal_components, structure
from mocap.filters.whittaker import fastest_hz, smooth_series
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from eal.potential import EmpiricalPotential

LEAST_MARKERS = 4
"""Markers that a frame must show: a pose has six numbers of place and orientation, a ray two, and
three rays leave up to four poses (Grunert 1841)."""


@dataclass(frozen=True, eq=False)
class Barrier:
    """Weight times -log(1 - V_z): -log of a density of one frame's pose."""

    potential: EmpiricalPotential
    weight: float

    def value(self, z: Array) -> Array:
        """(S, r) to (S,)."""
        return self.weight * self.potential.barrier_value(z)

    def gradient(self, z: Array) -> Array:
        """(S, r) to (S, r)."""
        return self.weight * self.potential.barrier_gradient(z)

    def hessian(self, z: Array) -> Array:
        """(S, r) to (S, r, r); negative eigenvalues included."""
        return self.weight * self.potential.barrier_hessian(z)


@dataclass(frozen=True, eq=False)
class QuadraticPrior:
    """Half of the squared Mahalanobis distance: the Gaussian of the same poses, as ``Barrier``."""

    mean: Array
    precision: Array

    def value(self, z: Array) -> Array:
        """(S, r) to (S,)."""
        return 0.5 * np.einsum("si,ij,sj->s", z - self.mean, self.precision, z - self.mean)

    def gradient(self, z: Array) -> Array:
        """(S, r) to (S, r)."""
        return (z - self.mean) @ self.precision

    def hessian(self, z: Array) -> Array:
        """(S, r) to (S, r, r)."""
        return np.broadcast_to(self.precision, (len(z), *self.precision.shape))


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePrior:
    """Markers of a body at R, p are R (mean + offset + basis z + e) + p; M markers, r shapes.

    Attributes:
        mean: (3M,) mean pose in body axes.
        basis: (3M, r) orthonormal.
        shapes: (N, r) shapes of the trials, as they were recorded.
        now: (r, r) z(t) = now z(t-1) + before z(t-2) + constant + noise of covariance ``shape_noise``.
        before: (r, r).
        constant: (r,).
        shape_noise: (r, r).
        step: (r, r) covariance of z(t) - z(t-1).
        hold: Potential of z.
        body_noise: (6,) variance of the second differences of position (m) and orientation (rad, body axes).
        body_step: (6,) variance of their first differences.
        left_sd: (3M,) deviation of e, what the subspace leaves of poses of trials that it was not learned from.
        noise_m: What a coordinate of a measured marker is known to.
        left_decay: e is a Matern-3/2 process that keeps this share from frame to frame.
        size_sd: Deviation of the logarithm of the animal's size.
        bones: Distances that trials keep.
        turn_s: Time in which the motion of the shape turns by a radian.
        dt_s: Time step.
    """

    mean: Array
    basis: Array
    shapes: Array
    now: Array
    before: Array
    constant: Array
    shape_noise: Array
    step: Array
    hold: Barrier | QuadraticPrior
    body_noise: Array
    body_step: Array
    left_sd: Array
    noise_m: float
    left_decay: float
    size_sd: float
    bones: Bones
    turn_s: float
    dt_s: float

    @property
    def markers(self) -> int:
        """M."""
        return len(self.mean) // 3

    @property
    def rank(self) -> int:
        """Number of shapes r."""
        return self.basis.shape[1]

    @property
    def lasts(self) -> float:
        """Frames that what shapes leave errs alike for."""
        return lasting_frames(self.left_decay)

    @property
    def spread_m(self) -> float:
        """RMS distance of a marker from where the mean of all shapes has it."""
        return float(np.sqrt(self.shapes.var(axis=0).sum() / self.markers))

    def gaussian(self) -> QuadraticPrior:
        """The Gaussian of its shapes."""
        cov = np.cov(self.shapes.T).reshape(self.rank, self.rank)
        floor = (1e-9 * np.trace(cov) + 1e-12) * np.eye(self.rank)  # a micrometre where shapes do not vary
        return QuadraticPrior(self.shapes.mean(axis=0), np.linalg.inv(cov + floor))


def learn_prior(trials: Sequence[MarkerTrial], trunk: Sequence[int], *, whole: PosePrior | None = None) -> PosePrior:
    """Learn from trials of the same markers and frame rate; animals of other sizes are brought to that of the last.

    Args:
        trials: What to learn from.
        trunk: Indices of the trunk's markers.
        whole: What shapes leave is as said there; None: by trials that are left out.
    """
    size_sd = size_spread(trials)
    sized = [*sized_like(trials[:-1], trials[-1]), trials[-1]]
    poses = poses_of(sized, trunk)
    dt_s = poses[0].dt_s
    parts = [p.y for p in poses]
    cuts, y = np.cumsum([len(part) for part in parts])[:-1], np.concatenate(parts)
    # 6, 8 and 10 err within 5 % of each other on four flights of a bat
    rank = max(1, min(8, len(y) // 8, y.shape[1] - 6))
    found = principal_components(y, rank, trial=np.repeat(np.arange(len(parts)), [len(part) for part in parts]))
    basis, _, _ = np.linalg.svd(found.loading, full_matrices=False)
    certainty = np.split(found.certainty, cuts)
    smooth = [
        smooth_series(z, np.maximum(k, 1e-3), dt_s=dt_s, cutoff_hz=fastest_hz(dt_s))
        for z, k in zip(np.split(found.scores @ found.loading.T @ basis, cuts), certainty, strict=True)
    ]
    keep = [k >= min(LEAST_KNOWN, np.median(k)) for k in certainty]
    shapes = np.concatenate([z[k] for z, k in zip(smooth, keep, strict=True)])
    rate = np.concatenate([np.gradient(z, dt_s, axis=0)[k] for z, k in zip(smooth, keep, strict=True)])
    now, before, constant, noise = autoregression(smooth)
    turn = [
        Rotation.from_matrix(np.swapaxes(p.frames.rotation[:-1], 1, 2) @ p.frames.rotation[1:]).as_rotvec()
        for p in poses
    ]
    moved = [np.diff(p.frames.position_m, axis=0) for p in poses]
    if whole is None:
        apart = parts if len(parts) > 1 else np.array_split(y[np.isfinite(y).any(axis=1)], 2)
        left = left_over(apart, rank)
        left_sd, decay = np.repeat(marker_sd(left), 3), float(np.exp(-MATERN_3_2_HALF * dt_s / half_life_s(left, dt_s)))
    else:
        left_sd, decay = whole.left_sd, whole.left_decay
    unseen = float(np.mean(unseen_potential(shapes)))
    step = np.cov(np.concatenate([np.diff(z, axis=0) for z in smooth]).T).reshape(rank, rank)
    return PosePrior(
        mean=found.mean,
        basis=basis,
        shapes=shapes,
        now=now,
        before=before,
        constant=constant,
        shape_noise=noise,
        step=step + 1e-6 * np.trace(step) / rank * np.eye(rank),
        hold=Barrier(learn_potential(shapes), 0.5 * rank / max(unseen, 1e-9)),
        body_noise=np.median([body_density(p) for p in poses], axis=0) * dt_s**3,
        body_step=np.mean(np.concatenate([np.concatenate(moved), np.concatenate(turn)], axis=1) ** 2, axis=0) + 1e-12,
        left_sd=left_sd,
        noise_m=float(np.nanmedian(np.concatenate([t.sd_m[t.seen] for t in trials]))),
        left_decay=decay,
        size_sd=size_sd,
        bones=rigid_bones(sized),
        turn_s=float(np.sqrt(shapes.var(axis=0).sum() / max(rate.var(axis=0).sum(), 1e-300))),
        dt_s=dt_s,
    )


def lasting_frames(decay: float) -> float:
    """Sum of the correlations (1 + |s|) exp(-|s|) of a Matern-3/2 process that keeps ``decay`` from frame to frame."""
    return max(1.0, 4 / -np.log(decay))


def marker_sd(left: Sequence[Array]) -> Array:
    """(M,) deviation of a coordinate of what shapes leave of each marker in a trial to come.

    Markers are placed elsewhere in one trial than in another, few trials tell by how much: a marker's mean square over
    them is drawn towards that of all markers by the share under which trials that are left out are likeliest, and
    scaled so that these err by one deviation.

    Args:
        left: (T, 3M) of each trial, as ``left_over`` gives it; two or more.
    """
    squares = np.array([_mean_squares(one) for one in left])

    def expected(share: float, of: Array) -> Array:
        seen = np.isfinite(of)
        overall = of[seen].mean()
        own = np.where(seen, of, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        return np.where(seen.any(axis=0), (1 - share) * own + share * overall, overall)

    def ratios(share: float) -> tuple[Array, Array]:
        others = np.array([expected(share, np.delete(squares, k, axis=0)) for k in range(len(squares))])
        finite = np.isfinite(squares)
        return squares[finite] / others[finite], others[finite]

    def unlikely(share: float) -> float:
        ratio, variance = ratios(share)
        return float(np.log(ratio.mean()) + np.log(variance).mean())

    best: Any = minimize_scalar(unlikely, bounds=(1e-3, 1.0), method="bounded")
    return np.sqrt(ratios(best.x)[0].mean() * expected(best.x, squares))


def _mean_squares(left: Array) -> Array:
    """(M,) mean squares of a coordinate of (T, 3M); NaN of markers that were not seen."""
    seen = np.isfinite(left)
    total, count = (x.reshape(len(left), -1, 3).sum(axis=(0, 2)) for x in (np.where(seen, left, 0.0) ** 2, seen))
    return np.where(count > 0, total / np.maximum(count, 1) + 1e-14, np.nan)  # at least a tenth of a micrometre


def running(total: Array, count: Array, width: float) -> Array:
    """(T,) sums over counts in a window of so many frames; NaN where it counts nothing."""
    frames = max(1, round(width))
    total, count = (uniform_filter1d(np.asarray(one, float), frames, mode="constant") for one in (total, count))
    return np.where(count > 1e-9, total / np.maximum(count, 1e-9), np.nan)


def half_life_s(left: Sequence[Array], dt_s: float) -> float:
    """Time in seconds in which series (T, D) lose half of their correlation: they then change by their variance."""
    series = np.concatenate(left)
    trial = np.repeat(np.arange(len(left)), [len(part) for part in left])
    variance, longest = float(np.nanmean(series**2)), max(2, max(map(len, left)) // 2)
    return dt_s * next((lag for lag in range(1, longest) if structure(series, lag, trial) >= variance), longest)


def size_spread(trials: Sequence[MarkerTrial]) -> float:
    """Deviation of the logarithm of an animal's size in a trial to come, by the bones that trials keep.

    A trial's size is the median over bones of how much longer they are in it than in all: markers that are placed
    elsewhere make single bones 15 % longer. The variance of sizes is drawn towards that of animals
    (``bones.LEAST_SIZE``), which counts as one more trial. The mean of n sizes, which is taken for the one to come,
    errs by 1/n of it.
    """
    ends = rigid_bones(trials).ends
    sizes = np.array([log_distances(trial, ends)[0] for trial in trials])
    kept = np.isfinite(sizes).all(axis=0)
    if not kept.any():
        return float(LEAST_SIZE * np.sqrt(1 + 1 / len(trials)))
    sizes = np.median(sizes[:, kept] - sizes[:, kept].mean(axis=0), axis=1)
    variance = (LEAST_SIZE**2 + np.sum((sizes - sizes.mean()) ** 2)) / len(trials)
    return float(np.sqrt(variance * (1 + 1 / len(trials))))


def autoregression(parts: Sequence[Array]) -> tuple[Array, Array, Array, Array]:
    """z(t) = now z(t-1) + before z(t-2) + constant + noise by least squares over series (T, r); and the noise's size.

    Motion that would grow is damped until it does not.
    """
    r = parts[0].shape[1]
    x = np.concatenate([np.column_stack([p[1:-1], np.diff(p, axis=0)[:-1], np.ones(len(p) - 2)]) for p in parts])
    target = np.concatenate([np.diff(p, n=2, axis=0) for p in parts])
    scale = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    u = x / scale
    slope = np.linalg.solve(u.T @ u + 1e-6 * len(u) * np.eye(len(scale)), u.T @ target) / scale[:, None]
    cov = np.cov((target - x @ slope).T).reshape(r, r)
    now, before = 2 * np.eye(r) + slope[:r].T + slope[r:-1].T, -np.eye(r) - slope[r:-1].T
    grows = np.abs(np.linalg.eigvals(np.block([[now, before], [np.eye(r), np.zeros((r, r))]]))).max()
    damped = min(1.0, 1 / grows)
    return damped * now, damped**2 * before, slope[-1], cov + 1e-6 * np.trace(cov) / r * np.eye(r)


def left_over(parts: Sequence[Array], rank: int) -> list[Array]:
    """(T, 3M) what shapes that are learned from all other poses (T, 3M) leave of these; NaN where not seen."""
    out = []
    for k, own in enumerate(parts):
        others = [part for i, part in enumerate(parts) if i != k]
        member = np.repeat(np.arange(len(others)), [len(part) for part in others])
        found = principal_components(np.concatenate(others), rank, trial=member)
        seen = np.isfinite(own)
        gap = np.where(seen, own - found.mean, 0.0)
        outer = (found.loading[:, :, None] * found.loading[:, None, :]).reshape(len(found.mean), -1)
        cov = np.linalg.inv((seen @ outer).reshape(-1, rank, rank) / found.noise + np.eye(rank))
        scores = np.einsum("tij,tj->ti", cov, gap @ found.loading) / found.noise
        out.append(np.where(seen, own - found.mean - scores @ found.loading.T, np.nan))
    return out
