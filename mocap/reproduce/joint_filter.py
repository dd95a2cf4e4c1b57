"""The EAL model of a joint or a limb as the prediction of an unscented filter: L = v'M(q)v/2 - U(q) - V_z(q)/eps^2.

Here the state is the relative joint coordinates q of the paper and their velocities, with the true mass matrix M(q),
and the step in time is the implicit midpoint step of that Lagrangian: without noise the filter's model conserves its
energy to the integrator's order, and Theorem 3 of the paper is a statement about it. What the Lagrangian lacks
(muscles, air) is white noise of the forces. The tracker of whole animals (``models``) is another thing: it
holds the coordinates of all markers, and its potentials are conditionings, no forces of a mechanics.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from eal import bounds
from eal.arrays import frozen
from eal.integrators import IntegrationError
from eal.lagrangian import PenalisedModel
from eal.midpoint import midpoint_step
from eal.over_time import OverTime, Time
from eal.threads import one_blas_thread
from mocap.filters.ensemble import default_points
from mocap.filters.unscented import UnscentedKalmanFilter

Array = NDArray[Any]
"""Of any type of number: this file stands between libraries that name theirs."""

FINEST = 64
"""Most steps of the integrator in a frame."""
LONGEST = 1.5
"""omega h up to which a step of the integrator goes, omega the fastest oscillation in the penalty: V is followed, not
only held."""
ROUNDS = 3
"""Reweightings of the cameras of a frame by Student's t."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointSights:
    """Where cameras see the J markers that hang on a root, and how joint coordinates become places in the world.

    Attributes:
        t_s: (T,) times, evenly spaced.
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, J, 2) ideal pixels of the markers; NaN where not seen.
        sd_px: (C, T, J) scale of Student's t of a coordinate.
        dof: (C,) its degrees of freedom.
        centre_m: (T, 3) the root in the world; NaN where not known: such frames are predicted only.
        centre_cov_m2: (T, 3, 3) its covariance.
        axes: (T, 3, k) axes of the coordinates in the world, lengths 1.
        chart: Joint coordinates (n, d) to places from the root (n, J, k) along the axes, in metres.
    """

    t_s: OverTime[Array]
    matrices: Array
    uv_px: Annotated[Array, Time(1)]
    sd_px: Annotated[Array, Time(1)]
    dof: Array
    centre_m: OverTime[Array]
    centre_cov_m2: OverTime[Array]
    axes: OverTime[Array]
    chart: Callable[[Array], Array]

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "t_s", frozen("t_s", self.t_s, (None,)))
        n_frames, n_cameras = len(self.t_s), len(self.matrices)
        shapes = {
            "matrices": (n_cameras, 3, 4),
            "uv_px": (n_cameras, n_frames, None, 2),
            "sd_px": (n_cameras, n_frames, None),
            "dof": (n_cameras,),
            "centre_m": (n_frames, 3),
            "centre_cov_m2": (n_frames, 3, 3),
            "axes": (n_frames, 3, None),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape))

    def places(self, frame: int, q: Array) -> Array:
        """(n, J, 3) places in the world of the markers for joint coordinates (n, d)."""
        return self.centre_m[frame] + self.chart(q) @ self.axes[frame].T

    def pixels(self, frame: int, q: Array) -> Array:
        """Pixels (n, 2CJ) of the markers for joint coordinates (n, d)."""
        return _pixels(self.matrices, self.places(frame, q))

    def noise(self, frame: int, q: Array, weight: Array) -> Array:
        """(2CJ, 2CJ) covariance of the pixels at q (d,): of the clicks over their weight (C, J), and of the root."""
        step = 1e-5
        both = self.places(frame, q[None]) + step * np.concatenate([np.eye(3), -np.eye(3)])[:, None]
        seen = _pixels(self.matrices, both)
        slope = (seen[:3] - seen[3:]).T / (2.0 * step)
        sd = np.where(np.isfinite(self.sd_px[:, frame]), self.sd_px[:, frame], 1.0)
        return np.diag(np.repeat(sd**2 / weight, 2)) + slope @ self.centre_cov_m2[frame] @ slope.T


def _pixels(matrices: Array, places: Array) -> Array:
    """(n, 2CJ) pixels of places (n, J, 3) in the cameras of (C, 3, 4) projections."""
    flat = places.reshape(-1, 3)
    seen = flat @ np.swapaxes(matrices[:, :, :3], 1, 2) + matrices[:, None, :, 3]  # (C, nJ, 3)
    pixels = (seen[..., :2] / seen[..., 2:]).reshape(len(matrices), *places.shape[:2], 2)
    return pixels.transpose(1, 0, 2, 3).reshape(len(places), -1)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointTrack:
    """Smoothed joint coordinates, and what the model says of them.

    Attributes:
        t_s: (T,) times.
        q: (T, d) joint coordinates.
        v: (T, d) their velocities.
        cov: (T, 2d, 2d) covariance of [q, v].
        measured: (T,) frames in which at least one camera was believed.
        log_likelihood: Of all pixels, in the filter.
        energy_j: (T,) T + U + V_z/eps^2 at the means.
        value: (T,) V_z at the means.
    """

    t_s: Array
    q: Array
    v: Array
    cov: Array
    measured: Array
    log_likelihood: float
    energy_j: Array
    value: Array

    @property
    def sd(self) -> Array:
        """(T, d) standard deviations of q."""
        d = self.q.shape[1]
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2)[:, :d])


def track_joint(
    model: PenalisedModel,
    sights: JointSights,
    q0: Array,
    v0: Array,
    *,
    power_w: float,
    start_sd: tuple[float, float],
    valley: Callable[[Array], Array] | None = None,
) -> JointTrack:
    """Filter and smooth a joint with its own mechanics.

    A frame is some midpoint steps of every sigma point, as many as the penalty's fastest oscillation asks for. The
    noise is white force whose power is the same in every direction of the metric M: accelerations have the covariance
    power M^-1 a second, and each degree of freedom gains power/2 joules a second on average.

    Args:
        model: The Lagrangian: system, V_z and 1/eps^2, a number.
        sights: What the cameras saw.
        q0: (d,) start, at the first frame.
        v0: (d,) start.
        power_w: Power of the force noise.
        start_sd: Standard deviations of q0 and v0.
        valley: (T, d) joint coordinates to the covariance (T, d, d) of V_z's own valley there, which is added to that
            of q: a V_z that is off takes the state along; None: V_z is exact.

    Returns:
        The track.

    Raises:
        ValueError: a power that is negative, or a start of another dimension.
        IntegrationError: the model's motion cannot be followed.
    """
    d = model.system.dimension
    if np.shape(q0) != (d,) or np.shape(v0) != (d,):
        raise ValueError(f"q0 and v0 must be the {d} coordinates of the {model.system.name}, not {np.shape(q0)}")
    if not power_w >= 0.0:
        raise ValueError(f"power_w must be at least 0, but is {power_w!r}")
    dt = float(np.diff(sights.t_s).mean())
    steps = substeps(model, np.asarray(q0, dtype=np.float64), dt)

    def move(states: Array, dt_s: float) -> Array:
        q, v = states[:, :d].copy(), states[:, d:].copy()
        for i in range(steps):
            q, v = midpoint_step(model.acceleration, i * dt_s / steps, q, v, dt_s / steps)
        return np.concatenate([q, v], axis=1)

    def look(states: Array, frame: int = 0) -> Array:
        return sights.pixels(frame, states[:, :d])

    filtered = UnscentedKalmanFilter(
        2 * d, sights.uv_px[:, 0].size, dt, look, move, default_points(2 * d), vectorised=True
    )
    filtered.x = np.concatenate([q0, v0])
    filtered.P = np.diag(np.repeat(np.square(start_sd), d))
    means, covs, noises, measured = [], [], [], []
    total = 0.0
    with one_blas_thread():
        for frame in range(len(sights.t_s)):
            if frame:
                filtered.Q = noises[-1]
                filtered.predict()
            finite = np.isfinite(sights.centre_m[frame]).all() and np.isfinite(sights.uv_px[:, frame]).any()
            measured.append(bool(finite))
            if finite:
                total += _condition(filtered, sights, frame, look)
            means.append(filtered.x)
            covs.append(filtered.P)
            noises.append(_noise(model, filtered.x[:d], power_w, dt))
        smooth, cov, _ = filtered.rts_smoother(np.array(means), np.array(covs), Qs=np.array(noises))
    q, v = np.asarray(smooth[:, :d], dtype=np.float64), np.asarray(smooth[:, d:], dtype=np.float64)
    if valley is not None:
        cov[:, :d, :d] += valley(q)
    return JointTrack(
        t_s=sights.t_s,
        q=q,
        v=v,
        cov=cov,
        measured=np.array(measured),
        log_likelihood=total,
        energy_j=model.energy(q, v),
        value=model.penalty.value(q),
    )


def substeps(model: PenalisedModel, q: Array, dt_s: float) -> int:
    """Steps of the integrator in a frame: so many that omega h is at most ``LONGEST``, and at most ``FINEST``."""
    mass = float(np.linalg.eigvalsh(model.system.mass(q)).min())
    omega = np.sqrt(float(np.max(model.strength)) * model.penalty.curvature_limit / mass)
    return int(np.clip(np.ceil(omega * dt_s / LONGEST), 1, FINEST))


def _noise(model: PenalisedModel, q: Array, power_w: float, dt_s: float) -> Array:
    inverse = np.linalg.inv(model.system.mass(q))
    return np.kron(power_w * np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]]), inverse)


def _condition(state: UnscentedKalmanFilter, sights: JointSights, frame: int, look: Callable[..., Array]) -> float:
    """Condition on the pixels of a frame, and give their log likelihood.

    Errors of clicks follow Student's t: normal ones whose precision is scaled by (nu + 2)/(nu + r^2), r the distance of
    a camera's click from the state that the others leave (Lange et al. 1989), in some rounds from weight 1.
    """
    mean, cov = state.x, state.P
    n = len(mean)
    seen = sights.uv_px[:, frame]
    weight = np.ones(seen.shape[:-1])
    dof = sights.dof[:, None]
    for turn in range(ROUNDS + 1):
        state.x, state.P = mean, cov
        state.update(seen.reshape(-1), R=sights.noise(frame, mean[: n // 2], weight), frame=frame)
        if turn < ROUNDS:
            spread = np.linalg.cholesky(state.P + 1e-18 * np.eye(n)).T
            middle = look(state.x[None], frame)[0]
            vary = ((look(state.x + spread, frame) - middle) ** 2).sum(axis=0).reshape(seen.shape)
            square = ((seen - middle.reshape(seen.shape)) ** 2 + vary).sum(axis=-1) / sights.sd_px[:, frame] ** 2
            weight = np.where(np.isfinite(square), (dof + 2.0) / (dof + square), 1.0)
    return state.log_likelihood


def learned_noise(
    model: PenalisedModel,
    sights: JointSights,
    q0: Array,
    v0: Array,
    *,
    powers_w: Array,
    strengths_j: Array,
    start_sd: tuple[float, float],
) -> tuple[PenalisedModel, float]:
    """The 1/eps^2 and the power of the force noise under which the pixels are most likely.

    The power at the middle 1/eps^2, 1/eps^2 at that power, and the power once more.

    Args:
        model: The Lagrangian.
        sights: A recording that V_z was not learned from.
        q0: (d,) start.
        v0: (d,) start.
        powers_w: Powers to choose from.
        strengths_j: Values of 1/eps^2 to choose from.
        start_sd: As of ``track_joint``.

    Returns:
        The model with that 1/eps^2, and the power.
    """

    @cache
    def likelihood(strength: float, power: float) -> float:
        try:
            tried = replace(model, strength=strength)
            track = track_joint(tried, sights, q0, v0, power_w=power, start_sd=start_sd)
            return track.log_likelihood if np.isfinite(track.log_likelihood) else -np.inf
        except (IntegrationError, np.linalg.LinAlgError):
            return -np.inf

    powers, strengths = [float(p) for p in powers_w], [float(s) for s in strengths_j]
    strength = strengths[len(strengths) // 2]
    power = max(powers, key=lambda p: likelihood(strength, p))
    strength = max(strengths, key=lambda s: likelihood(s, power))
    power = max(powers, key=lambda p: likelihood(strength, p))
    return replace(model, strength=strength), power


def theorem_3(model: PenalisedModel, q: Array, v: Array, *, potential_min_j: float) -> float:
    """V_z that no motion of the model released at (q, v) exceeds: V(q0) + eps^2 (T0 + U0 - min U), errata 13.

    Args:
        model: The Lagrangian, with one 1/eps^2, without damping or external forces.
        q: (d,) release.
        v: (d,) release.
        potential_min_j: Least U over what the motion can reach.
    """
    return float(
        bounds.theorem3(
            model.strength,
            value0=model.penalty.value(q),
            kinetic0=float(model.system.kinetic(q, v)),
            potential0=float(model.system.potential(q)),
            potential_min=potential_min_j,
        )
    )
