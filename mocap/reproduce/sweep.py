"""The paper's two pendulums: true motion, samples, and runs over potentials, penalties and times."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from eal import EmpiricalPotential, GaussianKernel, fit_potential
from eal.arrays import Array
from eal.constraints import Constraint, constrained_acceleration, unit_radius, unit_sphere
from eal.integrators import integrate_adaptive, simulate
from eal.lagrangian import LagrangianSystem, PenalisedModel
from eal.stack import PotentialStack
from eal.systems import planar_pendulum, spherical_pendulum


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
    h_s: float = 1e-4,
    velocity: Array | None = None,
) -> tuple[Array, Array]:
    """Sup over [0, T] of the constraint violation and of |q_lambda - q_eps|, equation 34's norm.

    Args:
        experiment: The pendulum.
        potentials: L potentials.
        penalties: (P,) values of 1/eps^2 in J.
        durations_s: D times T.
        h_s: RK4 step.
        velocity: (d,) start; None: the experiment's.

    Returns:
        Constraint and state error, each (D, L, P).
    """
    grid = np.broadcast_to(penalties, (len(potentials), len(penalties)))
    model = PenalisedModel(system=experiment.system, penalty=PotentialStack(potentials), strength=grid)
    start = experiment.velocity if velocity is None else velocity
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
