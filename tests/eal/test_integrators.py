"""Integrators: order, stability limits, and agreement between independent ways."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from eal import GaussianKernel, LaplaceKernel, Matern52Kernel, fit_potential, systems
from eal.autodiff import system_from_energies
from eal.integrators import (
    IntegrationError,
    StabilityError,
    _least_mass,
    integrate_adaptive,
    largest_strength,
    rk4_step,
    simulate,
)
from eal.lagrangian import AnalyticPenalty, PenalisedModel
from eal.stack import PotentialStack
from eal.systems import constrained_acceleration, unit_radius

PENDULUM = systems.planar_pendulum()
START, REST = np.array([1.0, np.pi / 6]), np.zeros(2)


def cube(_t_s, q, _v):
    """A force that drives anything away."""
    return 1e30 * q**3


def run(acceleration, q, v, *, h_s, steps):
    """Steps without checks: (1 + steps, d) configurations and velocities."""
    states = [(q, v)]
    for i in range(steps):
        states.append(rk4_step(acceleration, i * h_s, *states[-1], h_s))
    return np.moveaxis(np.array(states), 1, 0)


@pytest.fixture(scope="module")
def swing():
    """400 samples evenly over 10 s of the true motion of the planar pendulum."""
    acceleration = constrained_acceleration(PENDULUM, unit_radius())
    return integrate_adaptive(acceleration, START, REST, t_s=np.linspace(0, 10, 400), rtol=1e-12, atol=1e-13).q


def slope(steps, errors):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def test_order_of_convergence():
    """The error over 1 s of an elastic pendulum falls as h^4; the next order tilts the slope by less than 0.1."""
    penalty = AnalyticPenalty(
        value=lambda q: 0.5 * (q[..., 0] - 1.0) ** 2,
        gradient=lambda q: (q - 1.0) * np.array([1.0, 0.0]),
        curvature_limit=1.0,
    )
    model = PenalisedModel(system=PENDULUM, penalty=penalty, strength=50.0)
    q0, v0 = np.array([1.0, 0.5]), np.array([0.0, 1.0])
    truth = integrate_adaptive(model.acceleration, q0, v0, t_s=np.array([0.0, 1.0]), rtol=3e-14, atol=1e-14).q[-1]
    counts = (200, 400, 800)
    errors = [np.abs(run(model.acceleration, q0, v0, h_s=1 / n, steps=n)[0][-1] - truth).max() for n in counts]
    assert slope([1 / n for n in counts], errors) == pytest.approx(4, abs=0.1)


def test_rk4_loses_the_energy_that_theory_says():
    """Harmonic oscillator, omega h = 0.3, 5000 steps: (omega h)^6/72 of the energy is lost a step."""
    omega = 30.0
    spring = lambda t, q, v: -(omega**2) * q  # noqa: ARG005, E731
    q, v = run(spring, np.array([1.0]), np.array([0.0]), h_s=0.01, steps=5000)[:, -1, 0]
    energy = (v**2 + omega**2 * q**2) / omega**2
    assert energy == pytest.approx((1 - 0.3**6 / 72) ** 5000, rel=0.01)


def test_stability_limit_is_where_the_method_breaks(swing):
    """At 0.97 of the limit V stays below Theorem 3's bound; a hand-made run at 1.06 of it does not."""
    potential = fit_potential(swing, kernel=GaussianKernel(3.0), lam=1e-8)
    h = 1e-3
    limit = largest_strength(h, curvature=potential.curvature_limit)
    assert limit == pytest.approx(8 / (4 * 3 * h**2))
    peaks = []
    for share in (0.97, 1.06):
        model = PenalisedModel(system=PENDULUM, penalty=potential, strength=share * limit)
        off = np.abs(run(model.acceleration, START, REST, h_s=h, steps=1000)[0, :, 0] - 1)
        peaks.append(np.nan_to_num(off, nan=np.inf).max())
    assert peaks[0] < 1e-4
    assert peaks[1] > 1e-2


def test_step_beyond_the_limit_is_refused(swing):
    potential = fit_potential(swing, kernel=GaussianKernel(3.0), lam=1e-6)
    model = PenalisedModel(system=PENDULUM, penalty=potential, strength=1e8)
    with pytest.raises(StabilityError, match=r"stability limit 6.67e\+07 of rk4 with a step of 0.0001 s"):
        simulate(model, START, REST, duration_s=0.01)
    stiff = integrate_adaptive(model.acceleration, START, REST, t_s=np.linspace(0, 0.002, 3), method="Radau", rtol=1e-6)
    assert np.abs(stiff.q[:, 0] - 1).max() < 1e-5


def test_heavier_systems_bear_a_stronger_penalty(swing):
    """omega^2 = V''/(eps^2 m): twice the mass, twice the limit."""
    potential = fit_potential(swing, kernel=GaussianKernel(3.0), lam=1e-6)
    limit = largest_strength(1e-4, curvature=12.0)
    assert largest_strength(1e-4, curvature=12.0, mass=2.0) == pytest.approx(2 * limit)
    heavy = systems.planar_pendulum(mass_kg=2.0)
    simulate(PenalisedModel(system=heavy, penalty=potential, strength=1.5 * limit), START, REST, duration_s=1e-3)
    with pytest.raises(StabilityError):
        simulate(PenalisedModel(system=PENDULUM, penalty=potential, strength=1.5 * limit), START, REST, duration_s=1e-3)


def _double_pendulum():
    """Two point masses of 1 kg on rods of 1 m, in relative angles: M(q) is least where the lower one folds back."""

    def kinetic(q, v):
        first, second = v[0], v[0] + v[1]
        return first**2 + 0.5 * second**2 + first * second * jnp.cos(q[1])

    return system_from_energies(kinetic, lambda q: 0.0 * q[0], names=("a", "b"), units=("rad", "rad"))


def test_stability_is_judged_with_the_mass_at_every_step():
    """A double pendulum held in its first angle starts folded, with least mass 1, and spins through stretched, 0.17.

    At 0.8 of the limit of the start it is refused, with the time, where the mass has fallen too far (before, only the
    start was looked at). At 0.8 of the limit of the least mass of all it runs and keeps its energy: RK4 damps by
    (omega h)^6/72 of what oscillates, a small share here.
    """
    system = _double_pendulum()
    angles = np.stack([np.zeros(181), np.linspace(0, np.pi, 181)], axis=1)
    least = np.linalg.eigvalsh(system.mass(angles))[:, 0]
    assert least[-1] == pytest.approx(1.0)
    assert least[0] == pytest.approx(3 - np.sqrt(8))
    penalty = AnalyticPenalty(
        value=lambda q: 0.25 * q[..., 0] ** 2, gradient=lambda q: 0.5 * q * np.array([1.0, 0.0]), curvature_limit=0.5
    )

    def run(share):
        strength = share * largest_strength(1e-3, curvature=0.5)
        model = PenalisedModel(system=system, penalty=penalty, strength=strength)
        return model, simulate(model, angles[-1], np.array([0.0, 20.0]), duration_s=0.2, h_s=1e-3)

    with pytest.raises(StabilityError, match=r"at t = 0\.\d+ s, where the mass is 0\.[67]"):
        run(0.8 * least[-1])
    model, held = run(0.8 * least[0])
    energy = model.energy(held.q, held.v)
    assert np.abs(energy / energy[0] - 1).max() < 0.01


@pytest.mark.parametrize("d", [1, 2, 3])
def test_least_mass_is_the_least_eigenvalue(d, rng):
    """The closed forms against LAPACK on a batch, to rounding."""
    root = rng.standard_normal((7, d, d))
    mass = root @ root.swapaxes(-1, -2)
    np.testing.assert_allclose(_least_mass(mass), np.linalg.eigvalsh(mass)[:, 0], atol=1e-12)


def test_a_cusp_has_no_stable_step(swing):
    model = PenalisedModel(
        system=PENDULUM, penalty=fit_potential(swing, kernel=LaplaceKernel(1.0), lam=1e-3), strength=1.0
    )
    with pytest.raises(StabilityError):
        simulate(model, START, REST, duration_s=0.01)


def test_batch_is_the_same_as_one_by_one(swing):
    """A stack over lambda and a batch over 1/eps^2 and starts gives what single runs give, to rounding."""
    potential = fit_potential(swing, kernel=GaussianKernel(3.0), lam=1e-6)
    members = [potential, potential.with_lambda(1e-3), fit_potential(swing[::2], kernel=GaussianKernel(3.0), lam=1e-4)]
    strengths = np.array([1e2, 1e4])
    starts = np.stack([START, START - 0.3 * np.eye(2)[1]])
    model = PenalisedModel(
        system=PENDULUM, penalty=PotentialStack(members), strength=np.broadcast_to(strengths, (3, 2))
    )
    together = simulate(model, np.broadcast_to(starts, (3, 2, 2)), REST, duration_s=0.01)
    np.testing.assert_allclose(
        PotentialStack(members).value(together.q[-1]),
        [p.value(x) for p, x in zip(members, together.q[-1], strict=True)],
        atol=1e-13,
    )
    for i, member in enumerate(members):
        for j, strength in enumerate(strengths):
            alone = simulate(
                PenalisedModel(system=PENDULUM, penalty=member, strength=strength), starts[j], REST, duration_s=0.01
            )
            np.testing.assert_allclose(together.q[:, i, j], alone.q, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: PotentialStack([]), "potentials of one dimension"),  # noqa: ARG005
        (lambda p: PotentialStack([p, replace(p, kernel=Matern52Kernel(2.0))]), "dimension and Gaussian kernel"),
        (lambda p: PotentialStack([p]).value(np.zeros((2, 2))), "1 rows, one a potential"),
        (lambda p: PotentialStack([p]).value(np.zeros((1, 3))), "2 coordinates on its last axis"),
    ],
)
def test_stacks_check_their_rows(make, message, swing):
    with pytest.raises(ValueError, match=message):
        make(fit_potential(swing[::4], kernel=GaussianKernel(3.0), lam=1e-4))


def test_scipy_and_rk4_agree_on_a_penalised_run(swing):
    """DOP853 at rtol 1e-10 and RK4 with omega h = 0.11: RK4's phase error, 0.11^5/120 x 500 steps of 1e-4 amplitude."""
    model = PenalisedModel(
        system=PENDULUM, penalty=fit_potential(swing, kernel=GaussianKernel(3.0), lam=1e-6), strength=1e5
    )
    plain = simulate(model, START, REST, duration_s=0.05)
    adaptive = integrate_adaptive(model.acceleration, START, REST, t_s=plain.t_s[::100], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(adaptive.q, plain.q[::100], atol=1e-7)


@pytest.mark.parametrize(
    ("start", "error", "message"),
    [
        (lambda m: simulate(m, np.zeros(3), np.zeros(3), duration_s=0.01), ValueError, "2 coordinates"),
        (
            lambda m: simulate(replace(m, system=systems.free_joint(), external=cube), START, REST, duration_s=0.01),
            IntegrationError,
            "stopped being finite near",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow|invalid:RuntimeWarning")
def test_what_cannot_be_integrated_is_named(start, error, message, swing):
    model = PenalisedModel(
        system=PENDULUM, penalty=fit_potential(swing, kernel=GaussianKernel(3.0), lam=1e-4), strength=1e3
    )
    with pytest.raises(error, match=message):
        start(model)
