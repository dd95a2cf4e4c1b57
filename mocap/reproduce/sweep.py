"""The paper's two pendulums: true motion, samples, runs over potentials, penalties and times, and figures of errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from eal.arrays import Array
from eal.integrators import integrate_adaptive, simulate
from eal.kernels import GaussianKernel
from eal.lagrangian import LagrangianSystem, PenalisedModel
from eal.potential import EmpiricalPotential, fit_potential
from eal.stack import PotentialStack
from eal.systems import (
    Constraint,
    constrained_acceleration,
    planar_pendulum,
    spherical_pendulum,
    unit_radius,
    unit_sphere,
)
from mocap.reproduce.draw import Curve, log_log
from mocap.reproduce.record import Figure, Verdict, long_table

STEP_S = 1e-4
"""Of RK4, the paper's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment:
    """A pendulum, its start, and how it is sampled. The paper gives N, beta and T; the rest are our choices.

    Attributes:
        system: The system in the paper's coordinates.
        constraint: phi, for the truth.
        start: (d,) start on the set.
        velocity: (d,) start.
        beta: Of the Gaussian kernel.
        span_s: Samples are taken over this time of the true motion.
        noisy: Number of leading coordinates that noise enters.
    """

    system: LagrangianSystem
    constraint: Constraint
    start: Array
    velocity: Array
    beta: float
    span_s: float
    noisy: int

    @property
    def kernel(self) -> GaussianKernel:
        """The kernel."""
        return GaussianKernel(self.beta)

    def violation(self, q: Array) -> Array:
        """Distance to the unit circle or sphere: (..., d) to (...)."""
        radius = q[..., 0] if self.system.dimension == 2 else np.linalg.norm(q, axis=-1)
        return np.abs(radius - 1.0)

    def truth(self, t_s: Array) -> Array:
        """q_lambda at increasing times from 0: DOP853 at rtol 1e-12 on the constrained system, (T, d)."""
        acceleration = constrained_acceleration(self.system, self.constraint)
        run = integrate_adaptive(acceleration, self.start, self.velocity, t_s=t_s, rtol=1e-12, atol=1e-13)
        return run.q

    def samples(
        self, n: int, *, delta: float = 0.0, rng: np.random.Generator | None = None, independent: bool = False
    ) -> Array:
        """N samples of the true motion, with uniform noise of width delta (section 8.1).

        Args:
            n: N.
            delta: Width of the noise, in m.
            rng: For noise and times.
            independent: Times drawn at random, so that samples are independent; else evenly spaced.

        Returns:
            (N, d) samples.
        """
        rng = np.random.default_rng(0) if rng is None else rng
        t = np.sort(rng.uniform(0.0, self.span_s, n)) if independent else np.linspace(0.0, self.span_s, n)
        z = _dense(self)(t)
        z[:, : self.noisy] += rng.uniform(-0.5 * delta, 0.5 * delta, (n, self.noisy))
        return z


@cache
def _dense(experiment: Experiment) -> CubicSpline:
    """The true motion between 4001 states: 3e-9 off for the 10 s of the planar pendulum."""
    t = np.linspace(0.0, experiment.span_s, 4001)
    return CubicSpline(t, experiment.truth(t))


@cache
def planar() -> Experiment:
    """Section 8.1: polar coordinates, at rest at theta = pi/6, beta = 3."""
    return Experiment(
        system=planar_pendulum(),
        constraint=unit_radius(),
        start=np.array([1.0, np.pi / 6]),
        velocity=np.zeros(2),
        beta=3.0,
        span_s=10.0,
        noisy=1,
    )


@cache
def spherical() -> Experiment:
    """Section 8.2: Cartesian coordinates, 45 degrees off the vertical with 1 m/s across, beta = 15."""
    half = np.sqrt(0.5)
    return Experiment(
        system=spherical_pendulum(),
        constraint=unit_sphere(),
        start=np.array([half, 0.0, -half]),
        velocity=np.array([0.0, 1.0, 0.0]),
        beta=15.0,
        span_s=1.0,
        noisy=3,
    )


def over_lambda(samples: Array, kernel: GaussianKernel, lams: Array) -> list[EmpiricalPotential]:
    """One potential a lambda from one fit at the smallest."""
    fitted = fit_potential(samples, kernel=kernel, lam=float(np.min(lams)))
    return [fitted.with_lambda(float(lam)) for lam in lams]


def errors(
    experiment: Experiment,
    potentials: Sequence[EmpiricalPotential],
    penalties: Array,
    *,
    durations_s: Sequence[float] = (0.05,),
    velocity: Array | None = None,
    h_s: float | None = None,
) -> tuple[Array, Array]:
    """Sup over [0, T] of the constraint violation and of |q_lambda - q_eps|, equation 34's norm.

    Args:
        experiment: The pendulum.
        potentials: L potentials.
        penalties: (P,) values of 1/eps^2 in J.
        durations_s: D times T.
        velocity: (d,) start; None: the experiment's.
        h_s: Step in s; None: ``STEP_S``.

    Returns:
        Constraint and state error, each (D, L, P).
    """
    grid = np.broadcast_to(penalties, (len(potentials), len(penalties)))
    model = PenalisedModel(system=experiment.system, penalty=PotentialStack(potentials), strength=grid)
    start = experiment.velocity if velocity is None else velocity
    h_s = STEP_S if h_s is None else h_s
    run = simulate(model, experiment.start, start, duration_s=max(durations_s), h_s=h_s)
    violation = np.maximum.accumulate(experiment.violation(run.q), axis=0)
    away = np.linalg.norm(run.q - experiment.truth(run.t_s)[:, None, None, :], axis=-1)
    state = np.maximum.accumulate(away, axis=0)
    ends = [round(t / h_s) for t in durations_s]
    return violation[ends], state[ends]


def slope(x: Array, y: Array) -> float:
    """Slope of log y against log x by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def slope_with_error(x: Array, y: Array) -> tuple[float, float]:
    """Slope of log y against log x by least squares, and its standard error."""
    line, covariance = np.polyfit(np.log(x), np.log(y), 1, cov=True)
    return float(line[0]), float(np.sqrt(covariance[0, 0]))


N, DELTA_M, DURATION_S, LAMBDA = 400, 1e-3, 0.05, 1e-6
PENALTY = "penalty factor 1/ε² (J)"
CONSTRAINT = "sup |r − 1| (m)"
SPHERE = "sup ||x| − 1| (m)"


def noisy_errors(experiment: Experiment, lams: Array, penalties: Array, seeds: int) -> tuple[Array, Array]:
    """Constraint and state errors (lambda, penalty, seed) of noisy samples."""
    found = []
    for seed in range(seeds):
        z = experiment.samples(N, delta=DELTA_M, rng=np.random.default_rng(seed))
        found.append([e[0] for e in errors(experiment, over_lambda(z, experiment.kernel, lams), penalties)])
    constraint, state = np.moveaxis(np.array(found), 1, 0)
    return np.moveaxis(constraint, 0, -1), np.moveaxis(state, 0, -1)


def error_table(axes: dict[str, Array], constraint: Array, state: Array, *, delta: float) -> dict[str, Array]:
    """Columns of errors over axes; T, lambda and N, where they are no axis, as in the general case."""
    columns = long_table(axes, constraint_error=constraint, state_error=state)
    fixed = {"T": DURATION_S, "lambda": LAMBDA, "N": float(N), "delta": delta}
    return columns | {name: np.full(constraint.size, value) for name, value in fixed.items() if name not in axes}


def against_penalty(
    name: str,
    over: str,
    values: Array,
    penalties: Array,
    errors: tuple[Array, Array],
    verdicts: tuple[Verdict, ...],
    *,
    delta: float = DELTA_M,
    y_label: str = CONSTRAINT,
) -> Figure:
    """A figure of errors against 1/eps^2, a curve for each lambda, N or T.

    Args:
        name: Number of the figure.
        over: ``lambda``, ``N`` or ``T``.
        values: Of it.
        penalties: 1/eps^2.
        errors: Constraint and state errors (value, penalty, seed).
        verdicts: On them.
        delta: Noise; 0: exact samples.
        y_label: Which constraint.
    """
    label = {"lambda": "λ = {:.0e}", "N": "N = {}", "T": "T = {:g} s"}[over]
    seeds = errors[0].shape[2]
    axes = {over: values, "penalty": penalties, "seed": np.arange(seeds)}
    curves = [Curve(label=label.format(one), x=penalties, y=y) for one, y in zip(values, errors[0], strict=True)]
    fixed = {"lambda": f", λ = {LAMBDA:g}", "N": f", N = {N}"}
    title = f"Fig. {name}: " + (f"noise {delta:g} m, {seeds} seeds" if delta else "exact samples")
    title += "".join(text for what, text in fixed.items() if what != over)
    return Figure(
        name=name,
        table=error_table(axes, *errors, delta=delta),
        verdicts=verdicts,
        draw=lambda canvas: log_log(canvas, curves, x_label=PENALTY, y_label=y_label, title=title),
    )
