"""GPLVM and GPDM as latent spaces of an unscented Kalman smoother.

The models of ``gplvm`` are learned from up to 200 poses: of each training trial a stretch, every so many frames that a
step is a third of the poses' deviation. In between, latent points are interpolated by splines, which gives the motion
from frame to frame: for the GPLVM linear dynamics, for the GPDM a Gaussian process of the step on the point, as in its
posterior (Wang, Fleet & Hertzmann 2008, equation 24). Both are followed by the unscented filter with Gaussian-process
prediction and observation (Ko & Fox 2009) and smoothed; the residual at the edges is carried into the gap. GPDM's
authors fill gaps by optimising all latent points at once, from a sampled start; filtering is the cheaper relative.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.ensemble import Gaussian
from scipy.interpolate import CubicSpline

from benchmarks.gaps.method import Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, learn_body
from benchmarks.gaps.peers.edges import Blend
from benchmarks.gaps.peers.gplvm import LatentPoses, fit_latent
from benchmarks.gaps.peers.intervals import tune_blended
from benchmarks.gaps.peers.latent import LatentModel, linear_dynamics, regress
from benchmarks.gaps.peers.manifold import LatentFiller
from benchmarks.gaps.peers.poses import completed
from eal.arrays import Array

POSES = 200


def stride(poses: Sequence[Array], *, share: float = 0.1) -> int:
    """Frames after which the mean squared change of a pose is a share of what it is between any two poses."""
    total = 2 * np.concatenate(poses).var(axis=0).sum()
    longest = max(1, min(len(p) for p in poses) // 8)
    for step in range(1, longest):
        change = np.concatenate([((p[step:] - p[:-step]) ** 2).sum(axis=1) for p in poses])
        if change.mean() >= share * total:
            return step
    return longest


def stretches(poses: Sequence[Array], known: Sequence[Array], step: int) -> list[Array]:
    """Of each trial the best known stretch, every ``step`` frames, ``POSES`` in all; ``known`` has shares (T,)."""
    count = max(8, POSES // len(poses))
    out = []
    for p, share in zip(poses, known, strict=True):
        length = min(len(p), count * step)
        total = np.concatenate([[0.0], np.cumsum(share)])
        start = int(np.argmax(total[length:] - total[: len(total) - length]))
        out.append(p[start : start + length : step])
    return out


def between(points: Array, lengths: Sequence[int], step: int) -> list[Array]:
    """Latent points of each stretch at every frame."""
    parts = np.split(points, np.cumsum(lengths)[:-1])
    return [CubicSpline(step * np.arange(len(p)), p)(np.arange(step * (len(p) - 1) + 1)) for p in parts if len(p) > 3]


def process_dynamics(learned: LatentPoses, z: list[Array], sd: Array, *, factor: float) -> LatentModel:
    """Points move to z + v(z) + noise, v a Gaussian process of ``POSES`` steps; ``factor`` on the noise variance."""
    here, change = np.concatenate([p[:-1] for p in z]), np.concatenate([np.diff(p, axis=0) for p in z])
    chosen = np.linspace(0, len(here) - 1, min(POSES, len(here))).astype(int)
    velocity = regress(here[chosen], change[chosen])
    spread = learned.points.std(axis=0) + 1e-9
    return LatentModel(
        decode=learned.decode,
        size=here.shape[1],
        step=lambda x: x + velocity(x),
        noise=np.diag(np.sqrt(factor) * velocity.noise_sd + 1e-6 * spread),
        start=Gaussian(learned.points.mean(axis=0), np.diag(spread)),
        sd=sd,
    )


@dataclass(frozen=True)
class GaussianProcessLatent:
    """One of the two models."""

    name: str
    dynamics: bool

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the dimension, the noises and, for the GPDM, whether its dynamics are balanced."""

        @cache
        def prepared(trials: tuple[Trial, ...]) -> tuple[Body, list[Array], int]:
            body = learn_body(trials)
            placed = [body.place(trial) for trial in trials]
            poses = completed(placed)
            step = stride(poses)
            known = [np.isfinite(p.poses).mean(axis=1) for p in placed]
            return body, stretches(poses, known, step), step

        @cache
        def learned(size: int, balanced: bool, trials: tuple[Trial, ...]) -> LatentPoses:
            _, sequences, _ = prepared(trials)
            weight = sequences[0].shape[1] / size if balanced else 1.0
            return fit_latent(sequences, size, dynamics=weight if self.dynamics else None)

        def fit(candidate: tuple[int, bool, float, float], blend: Blend, trials: Sequence[Trial]) -> Filler:
            size, balanced, noise, trust = candidate
            body, sequences, step = prepared(tuple(trials))
            model = learned(size, balanced, tuple(trials))
            sd = trust * np.hypot(model.decode.noise_sd, np.repeat(trials[0].sd_m, 3))
            z = between(model.points, [len(s) for s in sequences], step)
            if self.dynamics:
                return LatentFiller(body, process_dynamics(model, z, sd, factor=noise), blend)
            return LatentFiller(body, linear_dynamics(model.decode, z, sd, ridge=noise or None), blend)

        if self.dynamics:
            candidates = [
                (3, True, 10, 3),
                (5, True, 10, 3),
                (5, False, 10, 3),
                (5, True, 10, 10),
                (5, True, 100, 3),
                (8, True, 10, 3),
            ]
        else:
            candidates = [
                (3, False, 0.01, 3),
                (5, False, 0.01, 3),
                (5, False, 0.01, 10),
                (5, False, 0, 3),
                (8, False, 0.01, 3),
            ]
        return tune_blended(candidates, training, fit)


def peers() -> list[Method]:
    """Both."""
    return [GaussianProcessLatent("gplvm_ukf", dynamics=False), GaussianProcessLatent("gpdm_ukf", dynamics=True)]
