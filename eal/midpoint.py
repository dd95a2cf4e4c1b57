"""The implicit midpoint rule for penalised models: symmetric in time, and stable at any stiffness of the penalty."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.integrators import IntegrationError, Trajectory
from eal.lagrangian import PenalisedModel
from eal.threads import one_blas_thread

Array = NDArray[Any]
"""Numbers, indices or masks."""

Acceleration = Callable[[float, Array, Array], Array]

HALVINGS = 8
"""A step that does not converge is taken in halves, at most so often. Chosen; not measured."""


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
