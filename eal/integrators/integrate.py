"""Repeating a step over time and over a batch."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array, frozen
from eal.integrators.midpoint import IntegrationError, midpoint_step
from eal.integrators.rk4 import rk4_step
from eal.integrators.stability import LIMITS, check_step
from eal.integrators.verlet import verlet_step
from eal.lagrangian import PenalisedModel
from eal.threads import one_blas_thread

STEPS = {"rk4": rk4_step, "verlet": verlet_step, "midpoint": midpoint_step}


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
            object.__setattr__(self, name, frozen(getattr(self, name)))


def integrate(
    step: Callable[..., tuple[Array, Array]],
    acceleration: Callable[[float, Array, Array], Array],
    q0: Array,
    v0: Array,
    *,
    h_s: float,
    steps: int,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """``steps`` steps of h_s from (q0, v0) at t = 0.

    On one BLAS thread: the matrices of a step are small, and two threads took ten times as long.

    Args:
        step: ``rk4_step``, ``verlet_step``, ``midpoint_step`` or one from ``rattle_step``.
        acceleration: a(t, q, v): (..., d).
        q0: (..., d) start.
        v0: (..., d) start.
        h_s: Step in s.
        steps: Number of steps.
        every: Keep each such state.
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
            q, v = step(acceleration, (i - 1) * h_s, q, v, h_s)
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
    method: str = "rk4",
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
        method: ``rk4`` (the paper's), ``verlet`` or ``midpoint``.
        every: Keep each such state.
        progress: Told the fraction done.

    Returns:
        The trajectory; the batch is that of q0, v0 and 1/eps^2 together.

    Raises:
        StabilityError: the step is too long for 1/eps^2.
        ValueError: unknown method, or a start of another dimension.
    """
    if method not in LIMITS:
        raise ValueError(f"method must be one of {', '.join(LIMITS)}, but is {method!r}")
    q, v = np.asarray(q0, dtype=np.float64), np.asarray(v0, dtype=np.float64)
    d = model.system.dimension
    if q.shape[-1] != d or v.shape[-1] != d:
        raise ValueError(f"q0 and v0 must have the {d} coordinates of the {model.system.name}, but have {q.shape[-1]}")
    check_step(method, h_s, model, q)
    batch = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], np.shape(model.strength))
    q, v = np.broadcast_to(q, (*batch, d)), np.broadcast_to(v, (*batch, d))
    return integrate(
        STEPS[method],
        model.acceleration,
        q,
        v,
        h_s=h_s,
        steps=round(duration_s / h_s),
        every=every,
        progress=progress,
    )
