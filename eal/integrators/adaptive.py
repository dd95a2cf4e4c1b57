"""Adaptive integration by SciPy: DOP853 for accuracy, Radau for stiffness."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from eal.arrays import Array
from eal.integrators.integrate import Trajectory
from eal.integrators.midpoint import IntegrationError


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
