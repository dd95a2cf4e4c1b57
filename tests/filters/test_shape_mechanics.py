"""Mechanics of the shape: flows that SciPy integrates alike, moments that Monte Carlo finds alike."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.ensemble import Gaussian
from mocap.filters.motion.shape import FieldShape, FreeShape, LinearShape
from scipy.integrate import solve_ivp
from scipy.linalg import expm

RANK = 3


def lower(rng, n, size=1.0):
    """Lower factor with a positive diagonal."""
    return size * (np.tril(rng.normal(0, 0.3, (n, n)), -1) + np.diag(rng.uniform(0.5, 1.5, n)))


def oscillator(rng, rank=RANK, hz=9.0):
    """Coupled modes about ``hz``, damped, with a constant force; not symmetric, as identified ones are not."""
    coupling, damping = rng.normal(0, 0.2, (2, rank, rank))
    return LinearShape(
        stiffness=(2 * np.pi * hz) ** 2 * (np.eye(rank) + coupling),
        damping=10 * (np.eye(rank) + damping),
        force=30 * rng.normal(size=rank),
        density=lower(rng, rank),
        memory_s=0.015,
    )


def duffing_van_der_pol(x):
    """One mode with a hardening spring and damping that is negative near rest."""
    z, rate = x[:, :1], x[:, 1:]
    return -900 * z * (1 + z**2) + 12 * (1 - z**2) * rate


def integrated(acceleration, state, dt_s):
    """State a step later by SciPy's Dormand-Prince of order 8."""

    def rate(_, x):
        return np.concatenate([x[len(x) // 2 :], acceleration(x[None])[0]])

    return solve_ivp(rate, (0, dt_s), state, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


def test_free_shapes_fly_on():
    """A shape that nothing pushes moves by dt zdot, as SciPy integrates it."""
    rng = np.random.default_rng(1)
    state = Gaussian(rng.normal(size=2 * RANK), lower(rng, 2 * RANK))
    mean, transition, bent = FreeShape(np.eye(RANK)).linearised(state, 0.02)
    np.testing.assert_allclose(mean, integrated(lambda x: 0 * x[:, :RANK], state.mean, 0.02), atol=1e-12)
    np.testing.assert_allclose(transition, expm(0.02 * np.eye(2 * RANK, k=RANK)), atol=1e-15)
    assert bent.shape == (2 * RANK, 0)


@given(seed=st.integers(0, 1000), dt_s=st.floats(1e-4, 0.1))
def test_linear_shapes_flow_exactly(seed, dt_s):
    """Mean and every column of the transition as SciPy integrates them, over steps of up to a wing beat."""
    rng = np.random.default_rng(seed)
    shape = oscillator(rng)
    state = Gaussian(rng.normal(size=3 * RANK), lower(rng, 3 * RANK))

    def moved(x):
        def rate(_, x):
            force = x[2 * RANK :]
            return np.concatenate([x[RANK : 2 * RANK], shape.acceleration(x[None])[0] + force, -force / shape.memory_s])

        return solve_ivp(rate, (0, dt_s), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]

    mean, transition, bent = shape.linearised(state, dt_s)
    np.testing.assert_allclose(mean, moved(state.mean), rtol=1e-8, atol=1e-8)
    rest = moved(np.zeros(3 * RANK))
    columns = [moved(column) - rest for column in np.eye(3 * RANK)]
    np.testing.assert_allclose(transition, np.transpose(columns), rtol=1e-8, atol=1e-8)
    assert bent.shape == (3 * RANK, 0)


def test_a_field_that_is_linear_flows_as_linear_shapes_do():
    """To the error of a Runge-Kutta step, (rate dt)^5 / 120: half the step, a thirty-second of it. Nothing bends."""
    rng = np.random.default_rng(2)
    linear = oscillator(rng)
    field = FieldShape(linear.acceleration, linear.density)
    scale = np.repeat([1.0, 2 * np.pi * 9], RANK)  # shapes and velocities of the same motion
    state = Gaussian(scale * rng.normal(size=2 * RANK), scale[:, None] * lower(rng, 2 * RANK))

    def apart(dt_s):
        there = linear.linearised(Gaussian(np.append(state.mean, np.zeros(RANK)), np.eye(3 * RANK)), dt_s)
        mean, transition = there[0][: 2 * RANK], there[1][: 2 * RANK, : 2 * RANK]
        ours, slope, bent = field.linearised(state, dt_s)
        assert np.abs(bent / scale[:, None]).max() < 1e-12
        return max(np.abs((ours - mean) / scale).max(), np.abs((slope - transition) * scale / scale[:, None]).max())

    coarse, fine = apart(1 / 240), apart(1 / 480)
    assert coarse < 10 * (2 * np.pi * 9 * 1.3 / 240) ** 5 / 120
    assert fine == pytest.approx(coarse / 32, rel=0.2)


def test_a_bent_field_flows_as_scipy_integrates_it():
    """A state known to 1e-6: its mean as by Dormand and Prince, its transition their derivative; order four."""
    field = FieldShape(duffing_van_der_pol, np.eye(1))
    state = Gaussian(np.array([0.8, -25.0]), 1e-6 * np.array([[1.0, 0], [5.0, 30.0]]))

    def apart(dt_s):
        mean, transition, bent = field.linearised(state, dt_s)
        assert np.abs(bent).max() < 1e-9
        steps = np.diag([1e-4, 3e-3])
        ends = [integrated(duffing_van_der_pol, state.mean + s * step, dt_s) for step in steps for s in (1, -1)]
        slope = np.stack([(ends[0] - ends[1]) / 2e-4, (ends[2] - ends[3]) / 6e-3], axis=1)
        np.testing.assert_allclose(transition, slope, rtol=1e-3, atol=1e-4 * np.abs(slope).max())
        return np.abs(mean - integrated(duffing_van_der_pol, state.mean, dt_s)).max()

    coarse, fine = apart(1 / 120), apart(1 / 240)
    assert coarse < 0.02
    assert fine == pytest.approx(coarse / 32, rel=0.3)  # the error of one step


def test_a_bent_field_spreads_a_state_as_monte_carlo_does():
    """Mean and covariance T P T^T + bent bent^T of a wide state: to a tenth of what the bending does to them.

    At a deviation of 0.2 the cubic terms move the mean and widen the cloud visibly. 2e5 samples, the linear part a
    control variate.
    """
    field = FieldShape(duffing_van_der_pol, np.eye(1))
    factor = np.array([[0.2, 0], [1.0, 5.0]])
    state, dt_s = Gaussian(np.array([0.8, -25.0]), factor), 1 / 60
    mean, transition, bent = field.linearised(state, dt_s)
    steps = np.random.default_rng(3).normal(size=(100_000, 2)) @ factor.T
    steps = np.concatenate([steps, -steps])
    moved = field._flow(state.mean + steps, dt_s)
    centre = field._flow(state.mean[None], dt_s)[0]
    shift = moved.mean(axis=0) - centre
    assert np.abs(mean - centre - shift).max() < 0.1 * np.abs(shift).max()
    cov = np.cov(moved.T)
    ours = transition @ state.cov @ transition.T + bent @ bent.T
    sd = np.sqrt(np.diag(cov))
    assert np.abs((ours - cov) / np.outer(sd, sd)).max() < 0.02


def test_a_force_that_is_even_pushes_and_blurs():
    """Of zddot = k z^2 about z = 0 of variance v: speed k v dt, and its variance 2 (k v dt)^2, all of it bend."""
    k, sd, dt_s = 1000.0, 0.05, 1e-4
    field = FieldShape(lambda x: k * x[:, :1] ** 2, np.eye(1))
    mean, transition, bent = field.linearised(Gaussian(np.zeros(2), np.diag([sd, 1e-6])), dt_s)
    push = k * sd**2 * dt_s
    assert mean[1] == pytest.approx(push, rel=1e-3)
    assert (bent @ bent.T)[1, 1] == pytest.approx(2 * push**2, rel=1e-3)
    np.testing.assert_allclose(transition, [[1, dt_s], [0, 1]], atol=1e-3 * push / sd)


@pytest.mark.parametrize("dt_s", [1e-4, 1 / 240, 0.1])
def test_noise_is_the_integral(dt_s):
    """Q = int exp(A s) B S B^T exp(A s)^T ds by quadrature, A the free motion: exactly, at any step."""
    rng = np.random.default_rng(4)
    shape = FreeShape(lower(rng, RANK))
    factor = shape.noise(dt_s)
    assert not np.triu(factor, 1).any()
    np.testing.assert_allclose(factor @ factor.T, quadrature(shape, np.eye(2 * RANK, k=RANK), dt_s), rtol=1e-10)


@pytest.mark.parametrize("dt_s", [1e-4, 1 / 240, 0.1])
def test_noise_under_forces_is_the_integral(dt_s):
    """Of [z, zdot, u] under stiffness, damping and a force that is forgotten; to the 1e-9 that keeps it definite."""
    shape = oscillator(np.random.default_rng(5))
    factor = shape.noise(dt_s)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    drive = np.concatenate([np.zeros((2 * RANK, RANK)), shape.density / shape.memory_s])
    exact = np.zeros((3 * RANK, 3 * RANK))
    for node, weight in zip(nodes, weights, strict=True):
        pushed = expm(shape._generator[:-1, :-1] * (node + 1) / 2 * dt_s) @ drive
        exact += weight / 2 * dt_s * pushed @ pushed.T
    sd = np.sqrt(np.diag(exact))
    np.testing.assert_allclose((factor @ factor.T - exact) / np.outer(sd, sd), 0, atol=1e-8)


def test_the_force_keeps_its_size():
    """U of ``lasting_sd`` forgets as much in a step as noise adds to it: 2 memory sd^2 is its density."""
    shape = oscillator(np.random.default_rng(6), rank=1)
    variance, kept = shape.lasting_sd[0] ** 2, np.exp(-0.01 / shape.memory_s)
    added = (shape.noise(0.01) @ shape.noise(0.01).T)[2, 2]
    assert kept**2 * variance + added == pytest.approx(variance, rel=1e-8)


def quadrature(shape, generator, dt_s):
    """The integral by Gauss and Legendre with 12 nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    drive = np.concatenate([np.zeros_like(shape.density), shape.density])
    total = 0.0
    for node, weight in zip(nodes, weights, strict=True):
        pushed = expm(generator * (node + 1) / 2 * dt_s) @ drive
        total = total + weight / 2 * dt_s * pushed @ pushed.T
    return total
