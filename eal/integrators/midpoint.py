"""The implicit midpoint rule, for penalties too stiff for an explicit step."""

from collections.abc import Callable

import numpy as np

from eal.arrays import Array


class IntegrationError(ArithmeticError):
    """A step did not converge or the state is not finite any more."""


def midpoint_step(
    acceleration: Callable[[float, Array, Array], Array],
    t_s: float,
    q: Array,
    v: Array,
    h_s: float,
    *,
    tolerance: float = 1e-12,
    iterations: int = 30,
) -> tuple[Array, Array]:
    """One step of h_s: order 2, symplectic for a constant mass, stable for every omega h.

    The middle velocity w solves w = v + (h/2) a(q + (h/2) w, w) by Newton's method with one Jacobian a step, from
    d differences of the acceleration.

    Args:
        acceleration: a(t, q, v): (..., d).
        t_s: Time.
        q: (..., d) configuration.
        v: (..., d) velocity.
        h_s: Step.
        tolerance: Largest last correction, relative to 1 + |w|; where rounding of a stiff force stops it earlier,
            a correction below 1e-7 that shrinks no more is accepted.
        iterations: Most Newton iterations.

    Returns:
        q and v at t_s + h_s.

    Raises:
        IntegrationError: Newton's method did not converge.
    """
    half, t_mid = 0.5 * h_s, t_s + 0.5 * h_s
    d = q.shape[-1]
    base = acceleration(t_mid, q + half * v, v)
    jacobian = np.empty((*q.shape, d))
    step = 1e-7 * (1.0 + np.abs(v).max(axis=-1))
    for j in range(d):
        moved = v.copy()
        moved[..., j] += step
        difference = (acceleration(t_mid, q + half * moved, moved) - base) / step[..., None]
        jacobian[..., :, j] = -half * difference
        jacobian[..., j, j] += 1.0
    inverse = np.linalg.inv(jacobian)
    w, residual, last = v, -half * base, np.inf
    for _ in range(iterations):
        correction = np.einsum("...ij,...j->...i", inverse, residual)
        w = w - correction
        size = float((np.abs(correction) / (1.0 + np.abs(w))).max())
        if size <= tolerance or (size <= 1e-7 and size >= 0.5 * last):
            return q + h_s * w, 2.0 * w - v
        last = size
        residual = w - v - half * acceleration(t_mid, q + half * w, w)
    raise IntegrationError(
        f"implicit midpoint: no convergence in {iterations} iterations at t = {t_s:g} s: "
        f"take a smaller step than {h_s:g} s"
    )
