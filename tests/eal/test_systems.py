"""Systems in closed form against automatic differentiation; energies, damping, forces."""

import jax.numpy as jnp
import numpy as np
import pytest

from eal import systems
from eal.autodiff import system_from_energies
from eal.integrators import integrate_adaptive
from eal.lagrangian import AnalyticPenalty, PenalisedModel

ALL = [
    systems.planar_pendulum(mass_kg=1.3),
    systems.spherical_pendulum(mass_kg=0.7),
    systems.free_joint(mass_kg=2.0),
]
each = pytest.mark.parametrize("system", ALL, ids=lambda s: s.name)


def none(d):
    return AnalyticPenalty(
        value=lambda q: np.zeros(q.shape[:-1]), gradient=lambda q: np.zeros((*q.shape[:-1], d)), curvature_limit=1.0
    )


@each
def test_closed_form_is_what_automatic_differentiation_derives(system, rng):
    """Mass, Coriolis and gravity terms from T and U by JAX, to rounding, on a batch."""
    derived = system_from_energies(system.kinetic, system.potential, names=system.names, units=system.units)
    q, v, f = rng.uniform(0.5, 1.5, (3, 2, 4, system.dimension))
    np.testing.assert_allclose(system.mass(q), derived.mass(q), atol=1e-13)
    np.testing.assert_allclose(system.force(q, v), derived.force(q, v), atol=1e-12)
    np.testing.assert_allclose(system.solve(q, f.copy()), derived.solve(q, f), rtol=1e-11)
    np.testing.assert_allclose(system.kinetic(q, v), derived.kinetic(q, v), rtol=1e-13)
    np.testing.assert_allclose(system.potential(q), derived.potential(q), atol=1e-13)


@each
def test_energy_is_conserved(system):
    """DOP853 at rtol 1e-11 over 2 s: drift below 1e-8 of the energies at play (~10 J), so every force has its work."""
    model = PenalisedModel(system=system, penalty=none(system.dimension), strength=0.0)
    q0, v0 = np.linspace(1.0, 1.4, system.dimension), np.linspace(0.3, -0.5, system.dimension)
    run = integrate_adaptive(model.acceleration, q0, v0, t_s=np.linspace(0, 2, 21), rtol=1e-11)
    energy = model.energy(run.q, run.v)
    assert np.abs(energy - energy[0]).max() < 1e-7


def test_free_joint_keeps_its_momentum():
    system = systems.free_joint(mass_kg=2.0)
    model = PenalisedModel(system=system, penalty=none(2), strength=0.0)
    run = integrate_adaptive(model.acceleration, np.zeros(2), np.array([1.0, -3.0]), t_s=np.linspace(0, 2, 5))
    np.testing.assert_allclose(run.v, np.tile([1.0, -3.0], (5, 1)), rtol=1e-12)


def test_damping_and_forces_enter_with_their_signs():
    """M x'' = -c x' + f from rest: x' = (f/c)(1 - exp(-c t / m))."""
    model = PenalisedModel(
        system=systems.free_joint(mass_kg=2.0),
        penalty=none(2),
        strength=0.0,
        damping=np.diag([3.0, 5.0]),
        external=lambda t, q, v: np.array([6.0, -1.0]),  # noqa: ARG005
    )
    t = np.linspace(0, 1, 5)
    run = integrate_adaptive(model.acceleration, np.zeros(2), np.zeros(2), t_s=t, rtol=1e-11)
    np.testing.assert_allclose(run.v[:, 0], 2.0 * (1 - np.exp(-1.5 * t)), atol=1e-9)
    np.testing.assert_allclose(run.v[:, 1], -0.2 * (1 - np.exp(-2.5 * t)), atol=1e-9)


def test_unnatural_kinetic_energy_is_refused():
    """T = v^2/2 + v is not quadratic in v."""
    with pytest.raises(ValueError, match="not a natural system"):
        system_from_energies(
            lambda q, v: 0.5 * jnp.sum(v * v) + v[0] + 0.0 * q[0], lambda q: q[0], names=("x",), units=("m",)
        )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: systems.planar_pendulum(mass_kg=0.0), "mass_kg"),
        (lambda: PenalisedModel(system=ALL[0], penalty=none(2), strength=-1.0), "strength"),
        (lambda: PenalisedModel(system=ALL[0], penalty=none(2), strength=1.0, damping=np.ones(2)), "damping"),
        (lambda: PenalisedModel(system=ALL[0], penalty=none(2), strength=1.0, damping=2.0), "damping"),
        (
            lambda: PenalisedModel(system=ALL[0], penalty=none(2), strength=1.0, damping=np.array([[1.0, 1], [0, 1]])),
            "symmetric",
        ),
    ],
)
def test_impossible_systems_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
