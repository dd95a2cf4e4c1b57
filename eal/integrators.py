"""Trajectories over any batch: by RK4 as in the paper, with the largest penalty that it can follow, and by SciPy."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, read_only
from eal.lagrangian import PenalisedModel
from eal.threads import one_blas_thread

LIMIT = 2.0 * np.sqrt(2.0)
"""Largest omega h of an undamped oscillation that RK4 does not amplify."""


class IntegrationError(ArithmeticError):
    """A step did not converge or the state is not finite any more."""


class StabilityError(ValueError):
    """The step is too long for the penalty."""


def largest_strength(h_s: float, *, curvature: float, mass: float = 1.0) -> float:
    """The 1/eps^2 up to which RK4 is stable: (omega h)_max^2 m / (V'' h^2), 8 / (4 beta h^2) for the Gaussian kernel.

    Args:
        h_s: Step in s.
        curvature: Largest eigenvalue of the Hessian of V, 4 beta for the Gaussian kernel, in 1/unit^2.
        mass: Smallest eigenvalue of the mass matrix.

    Returns:
        1/eps^2 in J.
    """
    return float(LIMIT**2 * mass / (curvature * h_s**2))


def check_step(h_s: float, model: PenalisedModel, q: Array, *, t_s: float = 0.0) -> None:
    """Refuse a step that the penalty makes unstable, with the mass as it is at q.

    Args:
        h_s: Step in s.
        model: System, penalty and 1/eps^2.
        q: (..., d) configurations; the smallest eigenvalue of the mass matrix counts, of each member of a batch with
            its own 1/eps^2.
        t_s: Time of q, for the message.

    Raises:
        StabilityError: 1/eps^2 is above the limit; the message names the limit and the step that would do.
    """
    mass = _least_mass(model.system.mass(q))
    limit = largest_strength(h_s, curvature=model.penalty.curvature_limit) * mass
    strength, limit, mass = np.broadcast_arrays(np.asarray(model.strength), limit, mass)
    over = strength >= limit
    if over.any():
        at = np.unravel_index(int(np.argmax(np.where(over, strength - limit, -np.inf))), over.shape)
        when = f" at t = {t_s:g} s, where the mass is {mass[at]:.3g}" if t_s > 0 else ""
        raise StabilityError(
            f"1/eps^2 = {strength[at]:.3g} is above the stability limit {limit[at]:.3g} of rk4 with a step of "
            f"{h_s:g} s{when}: take a step below {h_s * np.sqrt(limit[at] / strength[at]):.2g} s, or "
            "integrate_adaptive with method='Radau', which has no limit"
        )


def _least_mass(mass: Array) -> Array:
    """Smallest eigenvalue of (..., d, d) mass matrices; one and two coordinates in closed form."""
    d = mass.shape[-1]
    if all(stride == 0 for stride in mass.strides[:-2]):
        mass = mass[(0,) * (mass.ndim - 2)]
    if d == 1:
        return mass[..., 0, 0]
    if d == 2:
        middle = 0.5 * (mass[..., 0, 0] + mass[..., 1, 1])
        return middle - np.hypot(0.5 * (mass[..., 0, 0] - mass[..., 1, 1]), mass[..., 0, 1])
    return np.asarray(np.linalg.eigvalsh(mass)[..., 0], dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """States over time, of one system or a batch.

    Attributes:
        t_s: (T,) times in seconds.
        q: (T, ..., d) configurations.
        v: (T, ..., d) velocities.
    """

    t_s: Array
    q: Array
    v: Array

    def __post_init__(self) -> None:
        """Copy and freeze."""
        for name in ("t_s", "q", "v"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def rk4_step(
    acceleration: Callable[[float, Array, Array], Array], t_s: float, q: Array, v: Array, h_s: float
) -> tuple[Array, Array]:
    """One step of h_s: order 4, four evaluations, stable on the imaginary axis up to omega h = 2 sqrt 2.

    Args:
        acceleration: a(t, q, v): (..., d).
        t_s: Time.
        q: (..., d) configuration.
        v: (..., d) velocity.
        h_s: Step.

    Returns:
        q and v at t_s + h_s.
    """
    half = 0.5 * h_s
    a1 = acceleration(t_s, q, v)
    v2 = v + half * a1
    a2 = acceleration(t_s + half, q + half * v, v2)
    v3 = v + half * a2
    a3 = acceleration(t_s + half, q + half * v2, v3)
    v4 = v + h_s * a3
    a4 = acceleration(t_s + h_s, q + h_s * v3, v4)
    sixth = h_s / 6.0
    return q + sixth * (v + 2.0 * (v2 + v3) + v4), v + sixth * (a1 + 2.0 * (a2 + a3) + a4)


def integrate(
    acceleration: Callable[[float, Array, Array], Array],
    q0: Array,
    v0: Array,
    *,
    h_s: float,
    steps: int,
    every: int = 1,
    check: Callable[[float, Array], None] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """``steps`` steps of ``rk4_step`` from (q0, v0) at t = 0.

    On one BLAS thread: the matrices of a step are small, and two threads took ten times as long.

    Args:
        acceleration: a(t, q, v): (..., d).
        q0: (..., d) start.
        v0: (..., d) start.
        h_s: Step in s.
        steps: Number of steps.
        every: Keep each such state.
        check: Told time and configuration before every step; raises where the run must not go on.
        progress: Told the fraction done, some hundred times.

    Returns:
        1 + steps // every states, the first at t = 0.

    Raises:
        IntegrationError: the state is not finite any more.
    """
    q, v = (np.array(x, dtype=np.float64) for x in np.broadcast_arrays(q0, v0))
    kept = 1 + steps // every
    positions, velocities = np.empty((kept, *q.shape)), np.empty((kept, *q.shape))
    positions[0], velocities[0] = q, v
    with one_blas_thread():
        for i in range(1, steps + 1):
            if check is not None:
                check((i - 1) * h_s, q)
            q, v = rk4_step(acceleration, (i - 1) * h_s, q, v, h_s)
            if i % every == 0:
                positions[i // every], velocities[i // every] = q, v
            if progress is not None and i % max(steps // 100, 1) == 0:
                progress(i / steps)
    if not np.isfinite(q).all():
        first = int(np.argmax(~np.isfinite(positions.reshape(kept, -1)).all(axis=1)))
        raise IntegrationError(
            f"the state stopped being finite near t = {first * every * h_s:g} s: take a smaller step than {h_s:g} s"
        )
    return Trajectory(t_s=np.arange(kept, dtype=np.float64) * (every * h_s), q=positions, v=velocities)


def simulate(
    model: PenalisedModel,
    q0: Array,
    v0: Array,
    *,
    duration_s: float,
    h_s: float = 1e-4,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """A penalised model from (q0, v0), EAL paper, equation 7, over any batch of starts and of 1/eps^2.

    Args:
        model: System, penalty and 1/eps^2.
        q0: (..., d) start.
        v0: (..., d) start.
        duration_s: Time in s, rounded to whole steps.
        h_s: Step in s, the paper's 1e-4.
        every: Keep each such state.
        progress: Told the fraction done.

    Returns:
        The trajectory; the batch is that of q0, v0 and 1/eps^2 together.

    Raises:
        StabilityError: the step is too long for 1/eps^2, with the mass at any step of the run.
        ValueError: a start of another dimension.
    """
    q, v = np.asarray(q0, dtype=np.float64), np.asarray(v0, dtype=np.float64)
    d = model.system.dimension
    if q.shape[-1] != d or v.shape[-1] != d:
        raise ValueError(f"q0 and v0 must have the {d} coordinates of the {model.system.name}, but have {q.shape[-1]}")
    batch = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], np.shape(model.strength))
    q, v = np.broadcast_to(q, (*batch, d)), np.broadcast_to(v, (*batch, d))
    return integrate(
        model.acceleration,
        q,
        v,
        h_s=h_s,
        steps=round(duration_s / h_s),
        every=every,
        check=lambda t_s, at: check_step(h_s, model, at, t_s=t_s),
        progress=progress,
    )


def integrate_adaptive(
    acceleration: Callable[[float, Array, Array], Array],
    q0: Array,
    v0: Array,
    *,
    t_s: Array,
    method: str = "DOP853",
    rtol: float = 1e-9,
    atol: float = 1e-11,
) -> Trajectory:
    """States at given times; a batch is one system with one step for all.

    SciPy's error norm is a mean over components: for a batch of B the tolerances are divided by sqrt(B), so that no
    member is worse than alone.

    Args:
        acceleration: a(t, q, v): (..., d).
        q0: (..., d) start.
        v0: (..., d) start.
        t_s: (T,) increasing times, the first is that of the start.
        method: A method of ``scipy.integrate.solve_ivp``.
        rtol: Relative tolerance.
        atol: Absolute tolerance.

    Returns:
        The trajectory at t_s.

    Raises:
        IntegrationError: SciPy gave up; its message is repeated.
    """
    from scipy.integrate import solve_ivp  # 0.15 s, for those who integrate

    q0, v0 = np.broadcast_arrays(np.asarray(q0, dtype=np.float64), np.asarray(v0, dtype=np.float64))
    shape, size = q0.shape, q0.size
    share = np.sqrt(max(size // shape[-1], 1))

    def rate(t: float, y: Array) -> Array:
        q, v = y[:size].reshape(shape), y[size:].reshape(shape)
        return np.concatenate([y[size:], acceleration(t, q, v).reshape(-1)])

    start = np.concatenate([q0.reshape(-1), v0.reshape(-1)])
    t_s = np.asarray(t_s, dtype=np.float64)
    found = solve_ivp(
        rate, (t_s[0], t_s[-1]), start, method=method, t_eval=t_s, rtol=max(rtol / share, 3e-14), atol=atol / share
    )
    if not found.success:
        raise IntegrationError(f"{method} stopped at t = {found.t[-1]:g} s: {found.message}")
    states = found.y.T
    return Trajectory(t_s=t_s, q=states[:, :size].reshape(-1, *shape), v=states[:, size:].reshape(-1, *shape))


Array = NDArray[Any]
"""Numbers, indices or masks."""

Acceleration = Callable[[float, Array, Array], Array]

HALVINGS = 8
"""A step that does not converge is taken in halves, at most so often."""


def midpoint_step(
    acceleration: Acceleration, t_s: float, q: Array, v: Array, h_s: float, *, halvings: int = HALVINGS
) -> tuple[Array, Array]:
    """One step q' = q + h w, v' = v + h a(t + h/2, q + h w / 2, w) with w = (v + v')/2: order 2.

    The rule is its own inverse backwards in time, and keeps quadratic invariants; on reversible systems its energy
    oscillates by O(h^2) and does not drift (Hairer, Lubich, Wanner 2006, IV.2 and XI). With a constant mass matrix it
    is the variational midpoint rule of the same Lagrangian (Marsden and West 2001, 2.3). w is found by Newton's
    method with differences for derivatives; members of a batch that do not converge go in two halves.

    Args:
        acceleration: a(t, q, v): (..., d).
        t_s: Time.
        q: (n, d) configurations.
        v: (n, d) velocities.
        h_s: Step.
        halvings: How often a step may be halved.

    Returns:
        q and v at t_s + h_s.

    Raises:
        IntegrationError: a step of h_s / 2^halvings does not converge.
    """
    w, good = _mean_velocity(acceleration, t_s + 0.5 * h_s, q, v, h_s)
    q1, v1 = q + h_s * w, 2.0 * w - v
    if good.all():
        return q1, v1
    if halvings == 0:
        raise IntegrationError(
            f"the implicit midpoint rule did not converge near t = {t_s:g} s with a step of {h_s:g} s: "
            "the state is not finite or the penalty too strong for it"
        )
    bad = ~good
    middle = midpoint_step(acceleration, t_s, q[bad], v[bad], 0.5 * h_s, halvings=halvings - 1)
    q1[bad], v1[bad] = midpoint_step(acceleration, t_s + 0.5 * h_s, *middle, 0.5 * h_s, halvings=halvings - 1)
    return q1, v1


def _mean_velocity(acceleration: Acceleration, t_s: float, q: Array, v: Array, h_s: float) -> tuple[Array, Array]:
    """W with w = v + (h/2) a(q + h w / 2, w), and which members (n,) have it to 1e-11 of their speed.

    Members of a batch are near one another: the derivatives at the first do for most (chords), the others get their
    own.
    """
    n, d = q.shape
    half = 0.5 * h_s
    everyone = np.arange(n)

    def missing(w: Array, which: Array) -> Array:
        return w - v[which] - half * acceleration(t_s, q[which] + half * w, w)

    def solved(w: Array, which: Array, *, shared: bool, most: int) -> tuple[Array, Array]:
        """Newton's method, or that of chords, from w (m, d) of some members."""
        left = missing(w, which)
        good = np.zeros(len(which), dtype=bool)
        slope, before = None, np.inf
        for _ in range(most):
            if slope is None or not shared:
                slope = _slope(missing, w[:1] if shared else w, which[:1] if shared else which)
                usable = np.isfinite(slope).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(slope))) > 1e-12)
                inverse = np.linalg.inv(np.where(usable[:, None, None], slope, np.eye(d)))
            step = (inverse @ left[..., None])[..., 0]
            w = w - np.where(usable[:, None], step, 0.0)
            left = missing(w, which)
            off = np.abs(left).max(axis=1) / (1.0 + np.abs(w).max(axis=1))
            good = usable & (off <= 1e-11)
            worst = float(np.nanmax(off)) if np.isfinite(off).any() else np.inf
            if good.all() or (shared and not worst < 0.5 * before):
                break
            before = worst
        return w, good

    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        w, good = solved(v.copy(), everyone, shared=True, most=25) if n > 1 else (v.copy(), np.zeros(1, dtype=bool))
        rest = np.flatnonzero(~good)
        if len(rest):
            w[rest], good[rest] = solved(v[rest], rest, shared=False, most=12)
    return w, good


def _slope(missing: Callable[[Array, Array], Array], w: Array, which: Array) -> Array:
    """(m, d, d) derivatives of what is missing by w (m, d), by differences, all in one batch."""
    m, d = w.shape
    tilt = 1e-6 * (1.0 + np.abs(w))
    ahead = w[:, None] + tilt[:, None] * np.eye(d)  # (m, d, d): row i tilts coordinate i
    there = missing(ahead.reshape(m * d, d), np.repeat(which, d)).reshape(m, d, d)
    return np.swapaxes((there - missing(w, which)[:, None]) / tilt[..., None], 1, 2)


def simulate_midpoint(model: PenalisedModel, q0: Array, v0: Array, *, duration_s: float, h_s: float) -> Trajectory:
    """A penalised model from one start (q0, v0), EAL paper, equation 7, by ``midpoint_step``.

    Args:
        model: System, penalty and 1/eps^2, a number.
        q0: (d,) start.
        v0: (d,) start.
        duration_s: Time in s, rounded to whole steps.
        h_s: Step in s; there is no stability limit.

    Returns:
        The trajectory, q and v of shape (T, d).
    """
    steps = round(duration_s / h_s)
    q, v = np.atleast_2d(np.asarray(q0, dtype=np.float64)), np.atleast_2d(np.asarray(v0, dtype=np.float64))
    positions, velocities = [q[0]], [v[0]]
    with one_blas_thread():
        for i in range(steps):
            q, v = midpoint_step(model.acceleration, i * h_s, q, v, h_s)
            positions.append(q[0])
            velocities.append(v[0])
    return Trajectory(
        t_s=np.asarray(h_s * np.arange(steps + 1), dtype=np.float64), q=np.array(positions), v=np.array(velocities)
    )
