"""Trajectories over any batch: by RK4 as in the paper, with the largest penalty that it can follow, and by SciPy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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


def simulate(
    model: PenalisedModel,
    q0: Array,
    v0: Array,
    *,
    duration_s: float,
    h_s: float = 1e-4,
    every: int = 1,
) -> Trajectory:
    """A penalised model from (q0, v0) by ``rk4_step``, EAL paper, equation 7, over any batch of starts and of 1/eps^2.

    On one BLAS thread: the matrices of a step are small, and two threads took ten times as long.

    Args:
        model: System, penalty and 1/eps^2.
        q0: (..., d) start.
        v0: (..., d) start.
        duration_s: Time in s, rounded to whole steps.
        h_s: Step in s, the paper's 1e-4.
        every: Keep each such state.

    Returns:
        1 + steps // every states, the first at t = 0; the batch is that of q0, v0 and 1/eps^2 together.

    Raises:
        StabilityError: the step is too long for 1/eps^2, with the mass at any step of the run.
        IntegrationError: the state is not finite any more.
        ValueError: a start of another dimension.
    """
    q, v = np.asarray(q0, dtype=np.float64), np.asarray(v0, dtype=np.float64)
    d = model.system.dimension
    if q.shape[-1] != d or v.shape[-1] != d:
        raise ValueError(f"q0 and v0 must have the {d} coordinates of the {model.system.name}, but have {q.shape[-1]}")
    batch = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], np.shape(model.strength))
    q, v = np.broadcast_to(q, (*batch, d)), np.broadcast_to(v, (*batch, d))
    steps = round(duration_s / h_s)
    kept = 1 + steps // every
    positions, velocities = np.empty((kept, *q.shape)), np.empty((kept, *q.shape))
    positions[0], velocities[0] = q, v
    with one_blas_thread():
        for i in range(steps):
            check_step(h_s, model, q, t_s=i * h_s)
            q, v = rk4_step(model.acceleration, i * h_s, q, v, h_s)
            if (i + 1) % every == 0:
                positions[(i + 1) // every], velocities[(i + 1) // every] = q, v
    if not np.isfinite(q).all():
        first = int(np.argmax(~np.isfinite(positions.reshape(kept, -1)).all(axis=1)))
        raise IntegrationError(
            f"the state stopped being finite near t = {first * every * h_s:g} s: take a smaller step than {h_s:g} s"
        )
    return Trajectory(t_s=np.arange(kept, dtype=np.float64) * (every * h_s), q=positions, v=velocities)


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
