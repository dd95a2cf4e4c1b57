"""What the pose tracker learns from marker tracks: subspace, noise and empirical potential."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import pdist

from eal import EmpiricalPotential, GaussianKernel, fit_potential
from filters.motion.constant_velocity import ConstantVelocity
from filters.motion.pose import PoseMotion, rigid_modes
from filters.subspace import bridge, fit_subspace
from mocap.arrays import Array
from mocap.body import BodyFrames, smooth_series


@dataclass(frozen=True, kw_only=True)
class PoseSettings:
    """Choices of the pose model; those of the potential were settled by ``design/potential_stiffness.py``.

    Attributes:
        ranks: Ranks of the pose subspace to choose from, on hidden samples.
        body_hz: Faster motion of the trunk is left to the shape.
        beta: Kernel width: beta over the median squared distance of the samples.
        lam: Spectral filtering parameter lambda.
        centres: Most samples that the potential is learned from.
        certain: Poses known better than this (``Components.known``) are samples of the potential.
        weight: Potential that an unseen pose of the same motion is charged while the motion turns by a radian, in units
            of the log density (``with_potential``).
    """

    ranks: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 11, 15, 20, 26, 34)
    body_hz: float = 3.0
    beta: float = 1.0
    lam: float = 1e-4
    centres: int = 400
    certain: float = 0.8
    weight: float = 4.0


def acceleration_density(y: Array, *, dt_s: float, cutoff_hz: float) -> Array:
    """Spectral density of a white acceleration that moves like a series: S = 2 sd(velocity) sd(acceleration).

    For an oscillation of variance a^2 at w, S = 2 a^2 w^3: its acceleration has variance a^2 w^4 and keeps its sign for
    about 1 / w.

    Args:
        y: (T, k) series.
        dt_s: Time step.
        cutoff_hz: Faster motion is taken for noise.

    Returns:
        (k,) densities in unit^2/s^3, positive.
    """
    smooth = smooth_series(y, np.ones(len(y)), dt_s=dt_s, cutoff_hz=cutoff_hz)
    velocity = np.gradient(smooth, dt_s, axis=0)
    acceleration = np.gradient(velocity, dt_s, axis=0)
    density = 2 * velocity.std(axis=0) * acceleration.std(axis=0)
    return np.maximum(density, 1e-6 * max(density.max(), 1e-12))


def learn_pose(
    xyz_m: Array, frames: BodyFrames, *, dt_s: float, settings: PoseSettings
) -> tuple[PoseMotion, Array, Array]:
    """Learn a pose model without a potential from one recording.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen.
        frames: Body frames of the recording.
        dt_s: Time step.
        settings: Choices.

    Returns:
        The model, the shapes z (T, r) of all frames, and (T,) how well each is known (``fit_subspace``).
    """
    y = frames.to_body(xyz_m).reshape(len(xyz_m), -1)
    block = max(3, round(0.05 / dt_s))
    subspace, z, known = fit_subspace(y, ranks=settings.ranks, block=block, rng=np.random.default_rng(0))
    left = np.where(np.isfinite(y), y - subspace.mean - z @ subspace.basis.T, 0.0)
    g = left @ rigid_modes(subspace.mean)
    both = np.column_stack([z, g])
    cutoff = min(30.0, 0.2 / dt_s)
    density = acceleration_density(both, dt_s=dt_s, cutoff_hz=cutoff)
    velocity = np.gradient(smooth_series(both, np.ones(len(both)), dt_s=dt_s, cutoff_hz=cutoff), dt_s, axis=0)
    residual = smooth_series(left, np.ones(len(left)), dt_s=dt_s, cutoff_hz=cutoff)
    rate = np.gradient(residual, dt_s, axis=0).std() / max(residual.std(), 1e-12)
    start = np.concatenate([both.std(axis=0), velocity.std(axis=0)])
    model = PoseMotion(
        frames=frames,
        subspace=subspace,
        density=density,
        start_sd=2 * np.maximum(start, 1e-4 * start.max()),
        residual_rate_hz=float(rate),
        name="pose_constant_velocity",
    )
    return model, z, known


def learn_potential(z: Array, *, settings: PoseSettings) -> tuple[EmpiricalPotential, float]:
    """V_z of pose coordinates in units of the first coordinate's deviation.

    Args:
        z: (N, r) shapes.
        settings: Choices.

    Returns:
        The potential, and that unit.
    """
    unit = float(z[:, 0].std())
    samples = z[np.linspace(0, len(z) - 1, min(len(z), settings.centres)).astype(int)] / unit
    beta = settings.beta / float(np.median(pdist(samples, "sqeuclidean")))
    return fit_potential(samples, kernel=GaussianKernel(beta), lam=settings.lam), unit


def with_potential(model: PoseMotion, z: Array, *, settings: PoseSettings) -> PoseMotion:
    """The model with its shape held by the empirical potential of the shapes z (N, r), in the order of time.

    The stiffness 1/eps^2 follows from what the potential says of poses that it has not seen: learned without a fifth
    of the recording it has the mean value v there, and 1/eps^2 = weight w / v a second, w the rate sd(zdot) / sd(z) of
    the motion. Where the samples cover the motion v is small and the potential stiff; where a recording holds few
    cycles it is soft. ``design/potential_stiffness.py`` has the numbers.

    Args:
        model: The pose model.
        z: (N, r) shapes to learn from.
        settings: Choices.
    """
    potential, unit = learn_potential(z, settings=settings)
    rate = float(np.mean(model.start_sd[model.rank + 6 :][: model.rank]) / np.mean(model.start_sd[: model.rank]))
    charged = float(np.mean(unseen_potential(z, settings=settings)))
    return replace(model, gradient=penalty(potential, unit, settings.weight * rate / max(charged, 1e-9)), name="eal")


def unseen_potential(z: Array, *, settings: PoseSettings, folds: int = 5) -> Array:
    """(N,) -log(1 - V) of each shape under a potential that was learned without its fifth of the recording."""
    fold = np.arange(len(z)) * folds // len(z)
    parts = []
    for i in range(folds):
        potential, unit = learn_potential(z[fold != i], settings=settings)
        parts.append(potential.barrier_value(z[fold == i] / unit))
    return np.concatenate(parts)


def penalty(potential: EmpiricalPotential, unit: float, stiffness: float) -> Callable[[Array], Array]:
    """Gradient of -log(1 - V_z) / eps^2 in shape coordinates: as V_z near the data, but it pulls at any distance.

    ``stiffness`` is 1/eps^2 a second.
    """
    return lambda z: potential.barrier_gradient(z / unit) * (stiffness / unit)


def learn_constant_velocity(xyz_m: Array, *, dt_s: float) -> ConstantVelocity:
    """Constant velocity for each marker, with the acceleration that the recording shows.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen; every marker seen at least once.
        dt_s: Time step.
    """
    seen = np.isfinite(xyz_m[..., 0])
    start = xyz_m[np.argmax(seen, axis=0), np.arange(xyz_m.shape[1])]
    density = np.full(xyz_m.shape[1], np.nan)
    for marker in np.flatnonzero(seen.sum(axis=0) >= 10):
        frames = np.flatnonzero(seen[:, marker])
        series = bridge(xyz_m[frames[0] : frames[-1] + 1, marker])
        density[marker] = acceleration_density(series, dt_s=dt_s, cutoff_hz=min(30.0, 0.2 / dt_s)).mean()
    speed = np.linalg.norm(np.diff(xyz_m, axis=0), axis=-1) / dt_s
    speed_sd = float(np.sqrt(np.mean(speed[np.isfinite(speed)] ** 2))) if np.isfinite(speed).any() else 1.0
    extent = float(np.sqrt(np.mean(np.nanvar(xyz_m.reshape(-1, 3), axis=0))))
    if np.isfinite(density).any():
        density = np.where(np.isfinite(density), density, np.nanmedian(density))
    else:
        density = np.full(len(density), max(speed_sd, 1e-3) ** 2 / dt_s)
    density = np.maximum(density, 1e-9)  # m^2/s^3: a marker that never moves still has a covariance
    return ConstantVelocity(
        start_m=start, start_sd_m=max(extent, 1e-3), speed_sd_m_s=2 * max(speed_sd, 1e-3), density=density
    )
