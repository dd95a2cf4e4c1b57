"""Figure 14a's 102 trajectories, and microseconds a step, beside a SciPy loop.

``python -m benchmarks.eal_trajectories [--quick]``. Every number is measured in this run, on one BLAS thread.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from threadpoolctl import threadpool_limits

from benchmarks.timing import timed
from eal import EmpiricalPotential
from eal.arrays import Array
from eal.compiled import simulate_compiled
from eal.integrators import simulate
from eal.lagrangian import PenalisedModel
from eal.stack import PotentialStack
from mocap.reproduce.sweep import errors, over_lambda, planar

DURATION_S, H_S = 0.05, 1e-4


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the SciPy loop, scaled up")
    quick = parser.parse_args().quick
    with threadpool_limits(1):
        experiment = planar()
        z = experiment.samples(400)
        figure_14a(z, quick)
        steps(z)


def figure_14a(z: Array, quick: bool) -> None:
    """Six lambda times seventeen penalties, 500 RK4 steps each."""
    experiment, lams, penalties = planar(), np.logspace(-2, -7, 6), np.logspace(2, 6, 17)
    ours, potentials = timed(lambda: over_lambda(z, experiment.kernel, lams))
    run, found = timed(lambda: errors(experiment, potentials, penalties)[0][0])
    pairs = [(i, j) for i in range(6) for j in range(17)][:: 10 if quick else 1]
    share = 102 / len(pairs)
    print("figure 14a: 102 trajectories of 0.05 s, planar pendulum, N = 400")
    print(f"{'method':<58}{'seconds':>10}{'ratio':>8}{'worst gap':>12}")
    print(f"{'ours: RK4, h = 1e-4 s, one batch':<58}{run:>10.3f}{1.0:>8.1f}{'':>12}")
    for label, force, settings in (
        ("solve_ivp loop, DOP853 rtol 1e-8, V from all 400 samples", full(z, lams), {"method": "DOP853", "rtol": 1e-8}),
        ("solve_ivp loop, RK45 rtol 1e-8, V from all 400 samples", full(z, lams), {"method": "RK45", "rtol": 1e-8}),
        ("solve_ivp loop, DOP853 rtol 1e-8, our V", quickened(potentials), {"method": "DOP853", "rtol": 1e-8}),
    ):
        start = time.perf_counter()
        peaks = [peak(force, i, penalties[j], settings) for i, j in pairs]
        spent = (time.perf_counter() - start) * share
        gap = max(abs(p / found[i, j] - 1) for p, (i, j) in zip(peaks, pairs, strict=True))
        note = " (scaled)" if quick else ""
        print(f"{label + note:<58}{spent:>10.3f}{spent / run:>8.1f}{gap:>12.1e}")
    print(f"learning the six potentials: {1e3 * ours:.1f} ms")


def full(z: Array, lams: Array) -> Callable[[int, Array], Array]:
    """Gradient of V of lambda i as one writes it first: all samples, the full eigendecomposition."""
    gram = np.exp(-3.0 * ((z[:, None] - z) ** 2).sum(axis=2))
    s, u = np.linalg.eigh(gram)
    matrices = [(u / np.maximum(s / len(z), lam)) @ u.T / len(z) for lam in lams]

    def gradient(i: int, q: Array) -> Array:
        away = q - z
        k = np.exp(-3.0 * (away**2).sum(axis=1))
        return 12.0 * ((matrices[i] @ k) * k) @ away

    return gradient


def quickened(potentials: list[EmpiricalPotential]) -> Callable[[int, Array], Array]:
    """Gradient of our V of lambda i."""
    return lambda i, q: potentials[i].gradient(q)


def peak(force: Callable[[int, Array], Array], i: int, penalty: float, settings: dict) -> float:
    """Sup |r - 1| of one trajectory by solve_ivp."""

    def rate(t: float, y: Array) -> list[float]:  # noqa: ARG001
        r, angle, dr, dangle = y
        pull = penalty * force(i, y[:2])
        return [
            dr,
            dangle,
            r * dangle**2 - 9.81 * np.sin(angle) - pull[0],
            (-2 * r * dr * dangle - 9.81 * r * np.cos(angle) - pull[1]) / r**2,
        ]

    t = np.linspace(0, DURATION_S, 501)
    found = solve_ivp(rate, (0, DURATION_S), [1.0, np.pi / 6, 0.0, 0.0], t_eval=t, atol=1e-12, **settings)
    return float(np.abs(found.y[0] - 1).max())


def steps(z: Array) -> None:
    """Microseconds a step and trajectory: one trajectory, and each of a batch of 64."""
    experiment = planar()
    potential = over_lambda(z, experiment.kernel, np.array([1e-6]))[0]
    print(f"\nmicroseconds per RK4 step and trajectory, m = {len(potential.centres)}")
    print(f"{'method':<42}{'single':>10}{'of 64':>10}")
    row = []
    for n in (1, 64):
        strength = np.full((1, n), 1e4)
        model = PenalisedModel(system=experiment.system, penalty=PotentialStack([potential]), strength=strength)
        spent, _ = timed(lambda m=model: simulate(m, experiment.start, experiment.velocity, duration_s=0.1, h_s=H_S))
        row.append(spent / 1000 / n * 1e6)
    print(f"{'numpy (eal.integrators)':<42}{row[0]:>10.1f}{row[1]:>10.2f}")
    row = []
    for n in (1, 64):
        strengths = np.full(n, 1e4)

        def compiled(duration_s: float, strengths: Array = strengths) -> object:
            return simulate_compiled(
                experiment.system,
                [potential],
                strengths,
                experiment.start,
                experiment.velocity,
                duration_s=duration_s,
                every=100,
                monitor=radius_error,
            )

        compiled(1.0)
        spent, _ = timed(lambda c=compiled: c(1.0), repeats=2)
        row.append(spent / 10_000 / n * 1e6)
    print(f"{'JAX (eal.compiled), without compiling':<42}{row[0]:>10.1f}{row[1]:>10.2f}")
    gradient = full(z, np.array([1e-6]))
    start = time.perf_counter()
    for _ in range(2000):
        gradient(0, experiment.start)
    plain = (time.perf_counter() - start) / 2000 * 4e6
    print(f"{'all 400 samples, four gradients alone':<42}{plain:>10.1f}{'':>10}")


def radius_error(q: Array) -> Array:
    """|r - 1|."""
    return abs(q[0] - 1.0)


if __name__ == "__main__":
    main()
