"""A limb of rods: its mass matrix beside quadrature and a compound pendulum, its forces beside its energies."""

import numpy as np
import pytest

from eal import GaussianKernel, fit_potential
from eal.integrators import integrate_adaptive
from eal.lagrangian import AnalyticPenalty, PenalisedModel
from eal.midpoint import simulate_midpoint
from eal.rods import DirectionPenalty, RodLimb

LIMB = RodLimb(
    parents=(-1, 0, 1, 1),
    length_m=np.array([0.3, 0.25, 0.1, 0.15]),
    mass_kg=np.array([1.0, 0.6, 0.1, 0.2]),
    centre=np.array([0.5, 0.5, 0.5, 0.4]),
    mean=np.array([[1.0, 0, 0], [0, 1.0, 0], [0.6, 0.8, 0], [0, 0.6, 0.8]]),
)
Q = np.random.default_rng(0).normal(0, 0.7, (5, 8))
V = np.random.default_rng(1).normal(0, 2.0, (5, 8))


def test_kinetic_energy_is_that_of_many_points_along_each_rod():
    """Of uniform rods, by Simpson's rule, which is exact for squares of velocities that are linear along a rod."""
    limb = RodLimb(
        parents=LIMB.parents, length_m=LIMB.length_m, mass_kg=LIMB.mass_kg, centre=np.full(4, 0.5), mean=LIMB.mean
    )
    h = 1e-6
    ends = (limb.joints_m(Q + h * V) - limb.joints_m(Q - h * V)) / (2 * h)  # velocities of outer ends
    starts = np.stack([ends[:, p] if p >= 0 else np.zeros((5, 3)) for p in limb.parents], axis=1)
    squares = [np.sum((starts + s * (ends - starts)) ** 2, axis=-1) for s in (0.0, 0.5, 1.0)]
    energy = 0.5 * (squares[0] + 4 * squares[1] + squares[2]) / 6 @ limb.mass_kg
    system = limb.system()
    np.testing.assert_allclose(system.kinetic(Q, V), energy, rtol=1e-8)
    np.testing.assert_allclose(0.5 * np.einsum("ni,nij,nj->n", V, system.mass(Q), V), energy, rtol=1e-8)


def test_forces_are_those_of_the_lagrangian():
    """M a of the closed form is dL/dq - d/dt(dL/dv) + M a by differences of the energies; step errors below 1e-6."""
    system = LIMB.system(gravity_m_s2=(1.0, -2.0, -9.0))
    h = 1e-5

    def partial(i, q, v):
        e = np.zeros(8)
        e[i] = h
        up, down = q + e, q - e
        return (system.kinetic(up, v) - system.potential(up) - system.kinetic(down, v) + system.potential(down)) / (
            2 * h
        )

    slope = np.stack([partial(i, Q, V) for i in range(8)], axis=-1)
    turning = np.einsum("nij,nj->ni", (system.mass(Q + h * V) - system.mass(Q - h * V)) / (2 * h), V)
    np.testing.assert_allclose(system.force(Q, V), slope - turning, atol=1e-6)


def test_one_rod_swings_as_a_compound_pendulum():
    """A uniform rod of length l released near its rest has omega^2 = 3 g / (2 l); amplitude 1e-3, period to 1e-6."""
    rod = RodLimb(parents=(-1,), length_m=[0.4], mass_kg=[0.7], centre=[0.5], mean=[[0.0, 0.0, -1.0]])
    nothing = AnalyticPenalty(value=lambda q: 0.0 * q[..., 0], gradient=np.zeros_like, curvature_limit=0.0)
    model = PenalisedModel(system=rod.system(gravity_m_s2=(0, 0, -9.81)), penalty=nothing, strength=0.0)
    period = 2 * np.pi / np.sqrt(1.5 * 9.81 / 0.4)
    run = integrate_adaptive(
        model.acceleration, np.array([1e-3, 0.0]), np.zeros(2), t_s=np.array([0.0, period]), rtol=1e-10, atol=1e-13
    )
    np.testing.assert_allclose(run.q[-1], [1e-3, 0.0], atol=2e-9)


def test_coordinates_and_directions_are_inverse_and_bones_keep_their_length():
    back = LIMB.coordinates(LIMB.directions(Q) * 3.0)
    small = np.abs(Q.reshape(5, 4, 2)).sum(axis=-1).max() < np.pi
    assert small
    np.testing.assert_allclose(back, Q, atol=1e-12)
    joints = LIMB.joints_m(Q)
    np.testing.assert_allclose(np.linalg.norm(joints[:, 3] - joints[:, 1], axis=-1), 0.15, rtol=1e-12)


def test_energy_is_conserved_to_the_order_of_the_midpoint_rule_under_a_learned_potential():
    """V_z of directions holds the limb: the error of T + V_z/eps^2 falls as h^2, V stays below its bound."""
    rng = np.random.default_rng(2)
    swing = np.linspace(0, 6 * np.pi, 120)
    q = np.stack([0.8 * np.sin(swing), 0.3 * np.cos(swing), 0.5 * np.cos(swing), 0.2 * np.sin(2 * swing)], axis=1)
    limb = RodLimb(parents=(-1, 0), length_m=[0.3, 0.2], mass_kg=[0.6, 0.4], centre=[0.5, 0.5], mean=LIMB.mean[:2])
    samples = limb.directions(q + rng.normal(0, 0.01, q.shape)).reshape(-1, 6)
    penalty = DirectionPenalty(limb=limb, potential=fit_potential(samples, kernel=GaussianKernel(2.0), lam=1e-3))
    model = PenalisedModel(system=limb.system(), penalty=penalty, strength=20.0)
    h = 1e-6
    slope = [(penalty.value(q[:3] + h * e) - penalty.value(q[:3] - h * e)) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(penalty.gradient(q[:3]), np.stack(slope, axis=-1), atol=1e-7)
    drift = []
    for step in (4e-3, 2e-3, 1e-3):
        run = simulate_midpoint(model, q[0], np.array([0.0, 2.0, 0.0, 1.0]), duration_s=0.2, h_s=step)
        energy = model.energy(run.q, run.v)
        drift.append(np.abs(energy - energy[0]).max())
        bound = penalty.value(q[0]) + system_kinetic(model, run) / 20.0
        assert penalty.value(run.q).max() <= bound + drift[-1] / 20.0
    assert np.log2(drift[0] / drift[2]) / 2 == pytest.approx(2.0, abs=0.2)


def system_kinetic(model, run):
    return float(model.system.kinetic(run.q[0], run.v[0]))


def test_what_is_no_limb_is_refused():
    with pytest.raises(ValueError, match="parents must come before"):
        RodLimb(parents=(1, -1), length_m=[1, 1], mass_kg=[1, 1], centre=[0.5, 0.5], mean=np.eye(3)[:2])
    with pytest.raises(ValueError, match="above 0"):
        RodLimb(parents=(-1,), length_m=[0], mass_kg=[1], centre=[0.5], mean=np.eye(3)[:1])
