"""The classical Runge-Kutta method of order 4, the paper's integrator."""

from collections.abc import Callable

from eal.arrays import Array


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
