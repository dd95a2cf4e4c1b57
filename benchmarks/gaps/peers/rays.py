"""Peers that use the rays of a marker that one camera sees: Kalman smoothers of single markers on pixels.

``constant_velocity_pixels`` is the smoother of ``kalman`` with the rays of all cameras as observations.
``eks_multicam`` is the multi-camera ensemble Kalman smoother in its form for calibrated cameras: a random walk of the
marker in three dimensions, observed through the projection of each camera, the variance of views that disagree with the
others inflated (Biderman, Whiteway et al. 2024, Nature Methods 21, and the package ensemble-kalman-smoother). Here a
view is left out where rays do not meet and it misses what is predicted. Both are given the pixels that the product
believes, with slow ray errors removed, and its deviation of each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.intervals import tune
from benchmarks.gaps.peers.kalman import Pass, likeliest_density, smooth_series, transition, wide_prior
from benchmarks.gaps.prepared import recording
from eal.arrays import Array

GATE = 13.82
"""99.9 % of a chi-square variable of two degrees of freedom: of rays that do not meet, one farther off is left out."""
WIDE = 0.05
"""A ray is not taken by a marker that is predicted more vaguely than this share of its distance from the camera."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rays:
    """What C cameras see of M markers.

    Attributes:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        sd_px: (C, T, M) deviation of a coordinate.
        xyz_m: (T, M, 3) points in which they meet; NaN where fewer than two are believed.
        cov_m2: (T, M, 3, 3) their covariance.
    """

    matrices: Array
    uv_px: Array
    sd_px: Array
    xyz_m: Array
    cov_m2: Array


def rays_of(trial: Trial) -> Rays:
    """The pixels of a trial that the product believes."""
    found = recording(trial)
    if not found.cameras:
        raise ValueError(f"{trial.name} has no pixels")
    return Rays(
        matrices=found.matrices,
        uv_px=found.uv_px,
        sd_px=found.ray_sd_px,
        xyz_m=found.xyz_m,
        cov_m2=found.cov_m2,
    )


def projected(matrices: Array, xyz_m: Array) -> tuple[Array, Array]:
    """Pixels (..., 2) of points (..., 3), each in a camera (..., 3, 4), and their derivatives (..., 2, 3)."""
    flat = np.einsum("...ij,...j->...i", matrices[..., :3], xyz_m) + matrices[..., 3]
    uv = flat[..., :2] / flat[..., 2:]
    return uv, (matrices[..., :2, :3] - uv[..., None] * matrices[..., 2:, :3]) / flat[..., 2, None, None]


def filter_rays(rays: Rays, step: Array, noise: Array, *, mean: Array, cov: Array) -> Pass:
    """Extended Kalman filter of all markers at once: states of ``order`` derivatives times three coordinates.

    Rays that meet are observed through the point in which they do, which needs no linearisation. Elsewhere the ray that
    is nearest to the prediction is taken first, and of several one that misses what is known by then by more than
    ``GATE`` is left out.

    Args:
        rays: What is seen.
        step: (n, n) transition, n = 3 order; the first three components are the position.
        noise: (M, n, n) process noise.
        mean: (M, n) before the first frame.
        cov: (M, n, n) before the first frame.
    """
    n_frames, n_markers = rays.xyz_m.shape[:2]
    size, each = len(step), np.arange(n_markers)
    met = np.isfinite(rays.xyz_m[..., 0])
    seen = np.isfinite(rays.uv_px[..., 0]) & ~met
    sd_px = np.where(np.isfinite(rays.sd_px), rays.sd_px, 1.0)
    several = seen.sum(axis=0) > 1
    point_cov = np.where(met[..., None, None], rays.cov_m2, np.eye(3))
    out = Pass(
        np.empty((n_frames, n_markers, size, 1)),
        np.empty((n_frames, n_markers, size, size)),
        np.empty((n_frames, n_markers, size, 1)),
        np.empty((n_frames, n_markers, size, size)),
        np.zeros(n_markers),
    )
    for t in range(n_frames):
        if t:
            mean, cov = mean @ step.T, step @ cov @ step.T + noise
        out.ahead_mean[t, ..., 0], out.ahead_cov[t] = mean, cov
        gain = cov[:, :, :3] @ np.linalg.inv(cov[:, :3, :3] + point_cov[t]) * met[t, :, None, None]
        mean = mean + np.einsum("mij,mj->mi", gain, np.where(met[t, :, None], rays.xyz_m[t] - mean[:, :3], 0.0))
        cov = cov - gain @ cov[:, :3]
        miss = np.linalg.norm(rays.uv_px[:, t] - projected(rays.matrices[:, None], mean[:, :3])[0], axis=-1)
        order = np.argsort(np.where(seen[:, t], miss, np.inf), axis=0)
        for camera in order[: int(seen[:, t].sum(axis=0).max())]:
            matrix = rays.matrices[camera]
            uv, slope = projected(matrix, mean[:, :3])
            away = np.einsum("mi,mi->m", matrix[:, 2, :3], mean[:, :3]) + matrix[:, 2, 3]
            vague = np.sqrt(np.trace(cov[:, :3, :3], axis1=1, axis2=2) / 3) > WIDE * np.abs(away)
            taken = seen[camera, t, each] & ~vague
            innovation = np.where(taken[:, None], rays.uv_px[camera, t, each] - uv, 0.0)
            total = slope @ cov[:, :3, :3] @ slope.swapaxes(-1, -2)
            inverse = np.linalg.inv(total + (sd_px[camera, t, each] ** 2)[:, None, None] * np.eye(2))
            near = np.einsum("mi,mij,mj->m", innovation, inverse, innovation) < GATE
            gain = cov[:, :, :3] @ slope.swapaxes(-1, -2) @ inverse * (taken & (near | ~several[t]))[:, None, None]
            mean = mean + np.einsum("mij,mj->mi", gain, innovation)
            cov = cov - gain @ slope @ cov[:, :3]
        cov = 0.5 * (cov + cov.swapaxes(-1, -2))
        out.mean[t, ..., 0], out.cov[t] = mean, cov
    return out


@dataclass(frozen=True, eq=False)
class RayFiller:
    """A smoother whose noise is known.

    Attributes:
        order: Derivatives of the position in the state.
        density: (M,) process noise.
    """

    order: int
    density: Array

    def __call__(self, trial: Trial) -> Estimate:
        """Smooth every marker on its own."""
        rays = rays_of(trial)
        step, unit = transition(self.order)
        step, unit = np.kron(step, np.eye(3)), np.kron(unit, np.eye(3))
        mean, cov = wide_prior(rays.xyz_m, self.order)
        run = filter_rays(
            rays,
            step,
            self.density[:, None, None] * unit,
            mean=mean.reshape(len(mean), -1),
            cov=np.kron(cov, np.eye(3)),
        )
        smoothed, spread = smooth_series(run, step)
        return Estimate(smoothed[:, :, :3, 0], spread[:, :, :3, :3] + (trial.sd_m**2)[:, None, None] * np.eye(3))


@dataclass(frozen=True)
class RaySmoother:
    """Constant velocity (order 2) or a random walk (order 1) of single markers, on pixels."""

    name: str
    order: int
    needs_film: bool = True

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Noise by likelihood on positions, its factor by hidden gaps that keep 0, 1 and 2 rays."""

        @cache
        def likeliest(trials: tuple[Trial, ...]) -> Array:
            return likeliest_density([trial.xyz_m for trial in trials], trials[0].sd_m, self.order)

        def fit(factor: float, trials: Sequence[Trial]) -> Filler:
            return RayFiller(self.order, factor * likeliest(tuple(trials)))

        return tune([1.0, 10.0, 0.03], training, fit)


def peers() -> list[Method]:
    """Both smoothers."""
    return [RaySmoother("constant_velocity_pixels", 2), RaySmoother("eks_multicam", 1)]
