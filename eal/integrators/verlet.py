"""Velocity Verlet, order 2 and symmetric."""

from collections.abc import Callable

from eal.arrays import Array


def verlet_step(
    acceleration: Callable[[float, Array, Array], Array],
    t_s: float,
    q: Array,
    v: Array,
    h_s: float,
    *,
    velocity_iterations: int = 2,
) -> tuple[Array, Array]:
    """One step of h_s: v' = v + h a/2, q1 = q + h v', v1 = v' + h a(q1, v1)/2; stable up to omega h = 2.

    Where the acceleration depends on the velocity (Coriolis terms, damping) the last line is implicit and is
    iterated: twice for order 2, more for reversibility; once is exact where it does not.

    Args:
        acceleration: a(t, q, v): (..., d).
        t_s: Time.
        q: (..., d) configuration.
        v: (..., d) velocity.
        h_s: Step.
        velocity_iterations: Evaluations of the last line.

    Returns:
        q and v at t_s + h_s.
    """
    half = v + 0.5 * h_s * acceleration(t_s, q, v)
    q_new = q + h_s * half
    v_new = half
    for _ in range(velocity_iterations):
        v_new = half + 0.5 * h_s * acceleration(t_s + h_s, q_new, v_new)
    return q_new, v_new
