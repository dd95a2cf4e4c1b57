"""Long runs: RK4 on Gaussian potentials, compiled by JAX with the equations of motion derived from the energies.

Some microseconds a step where ``eal.integrators`` needs fifty; a second to compile. The results are the same to
rounding.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from eal.arrays import Array
from eal.autodiff import generalised_force, mass_matrix
from eal.integrators import IntegrationError, Trajectory, check_step, rk4_step
from eal.kernels import GaussianKernel
from eal.lagrangian import LagrangianSystem, PenalisedModel
from eal.optional_jax import jax, jnp
from eal.potential import EmpiricalPotential
from eal.stack import PotentialStack


def simulate_compiled(
    system: LagrangianSystem,
    potentials: Sequence[EmpiricalPotential],
    strengths: Array,
    q0: Array,
    v0: Array,
    *,
    duration_s: float,
    h_s: float = 1e-4,
    every: int = 100,
    monitor: Callable[[Any], Any],
) -> tuple[Trajectory, Array]:
    """Equation 7 for every pair of a potential and a 1/eps^2, by RK4.

    Args:
        system: A system whose energies take JAX arrays, as those of ``eal.systems`` do.
        potentials: L potentials with Gaussian kernels.
        strengths: (n,) values of 1/eps^2 in J.
        q0: (d,) start.
        v0: (d,) start.
        duration_s: Time in s, rounded to whole spans of ``every`` steps.
        h_s: Step in s.
        every: Steps from one kept state to the next.
        monitor: A number >= 0 from (d,) configurations, written with operators or ``jax.numpy``.

    Returns:
        States kept, q and v of shape (T, L, n, d), and the largest value of the monitor up to each, (T, L, n), all
        steps counted.

    Raises:
        ValueError: a kernel is not Gaussian.
        StabilityError: the step is too long, with the mass at any state kept.
        IntegrationError: the state is not finite any more.
    """
    for p in potentials:
        if not isinstance(p.kernel, GaussianKernel):
            raise ValueError(f"compiled runs take Gaussian kernels, not a {type(p.kernel).__name__}: use simulate")
    strengths = np.asarray(strengths, dtype=np.float64)
    model = PenalisedModel(system=system, penalty=PotentialStack(potentials), strength=strengths)
    check_step(h_s, model, np.asarray(q0, dtype=np.float64))
    width = max(len(p.centres) for p in potentials)
    columns = max(p.root.shape[1] for p in potentials)
    centres = np.zeros((len(potentials), width, system.dimension))
    roots = np.zeros((len(potentials), width, columns))
    for i, p in enumerate(potentials):
        centres[i, : len(p.centres)] = p.centres
        roots[i, : len(p.centres), : p.root.shape[1]] = p.root
    beta = np.array([p.kernel.beta for p in potentials if isinstance(p.kernel, GaussianKernel)])
    frames = round(duration_s / (every * h_s))
    with jax.enable_x64(True):
        run = _runner(system.kinetic, system.potential, monitor, frames, every)
        q, v, peaks = run(centres, roots, beta, strengths, np.asarray(q0, float), np.asarray(v0, float), h_s)
        q, v, peaks = (np.moveaxis(np.asarray(x), 2, 0) for x in (q, v, peaks))
    if not np.isfinite(q).all():
        raise IntegrationError(f"the state stopped being finite: take a smaller step than {h_s:g} s")
    trajectory = Trajectory(t_s=np.arange(frames + 1, dtype=np.float64) * (every * h_s), q=q, v=v)
    for t_s, at in zip(trajectory.t_s, trajectory.q, strict=True):
        check_step(h_s, model, at, t_s=float(t_s))
    return trajectory, peaks


@lru_cache(maxsize=32)
def _runner(kinetic: Any, potential: Any, monitor: Any, frames: int, every: int) -> Any:
    """The compiled loop over frames of ``every`` steps, over potentials and over strengths."""

    def one(centres: Any, root: Any, beta: Any, strength: Any, q0: Any, v0: Any, h: Any) -> Any:
        def acceleration(t: Any, q: Any, v: Any) -> Any:  # noqa: ARG001
            away = q - centres
            k = jnp.exp(-beta * jnp.sum(away * away, axis=1))
            w = (root @ (k @ root)) * k
            pull = 4.0 * beta * strength * (w @ away)
            return _solve(mass_matrix(kinetic, q, v), generalised_force(kinetic, potential, q, v) - pull)

        def step(_: Any, state: Any) -> Any:
            q, v, peak = state
            q, v = rk4_step(acceleration, 0.0, q, v, h)
            return q, v, jnp.maximum(peak, monitor(q))

        def frame(state: Any, _: Any) -> Any:
            state = jax.lax.fori_loop(0, every, step, state)
            return state, state

        start = (q0, v0, monitor(q0))
        _, kept = jax.lax.scan(frame, start, None, length=frames)
        return tuple(jnp.concatenate([s[None], k]) for s, k in zip(start, kept, strict=True))

    over_strengths = jax.vmap(one, in_axes=(None, None, None, 0, None, None, None))
    return jax.jit(jax.vmap(over_strengths, in_axes=(0, 0, 0, None, None, None, None)))


def _solve(mass: Any, force: Any) -> Any:
    """M^-1 f by elimination without pivots (M is positive definite), unrolled: no library call inside the loop."""
    d = force.shape[0]
    rows, right = [[mass[i, j] for j in range(d)] for i in range(d)], [force[i] for i in range(d)]
    for i in range(d):
        for k in range(i + 1, d):
            factor = rows[k][i] / rows[i][i]
            rows[k] = [a - factor * b for a, b in zip(rows[k], rows[i], strict=True)]
            right[k] = right[k] - factor * right[i]
    result: list[Any] = [None] * d
    for i in reversed(range(d)):
        result[i] = (right[i] - sum(rows[i][j] * result[j] for j in range(i + 1, d))) / rows[i][i]
    return jnp.stack(result)
