"""Mechanics of the shape: flows that SciPy integrates alike, noise that is an integral."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mocap.filters.motion.shape import LinearShape
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


@given(seed=st.integers(0, 1000), dt_s=st.floats(1e-4, 0.1))
@settings(max_examples=8)
def test_linear_shapes_flow_exactly(seed, dt_s):
    """Mean and every column of the transition as SciPy integrates them, over steps of up to a wing beat."""
    rng = np.random.default_rng(seed)
    shape = oscillator(rng)
    state = rng.normal(size=3 * RANK)

    def moved(x):
        def rate(_, x):
            z, speed, u = np.split(x, 3)
            push = shape.force - shape.stiffness @ z - shape.damping @ speed + u
            return np.concatenate([speed, push, -u / shape.memory_s])

        return solve_ivp(rate, (0, dt_s), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]

    transition, shift = shape.flow(dt_s)
    np.testing.assert_allclose(transition @ state + shift, moved(state), rtol=1e-8, atol=1e-8)
    rest = moved(np.zeros(3 * RANK))
    columns = [moved(column) - rest for column in np.eye(3 * RANK)]
    np.testing.assert_allclose(transition, np.transpose(columns), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("dt_s", [1e-4, 1 / 240, 0.1, 0.5])
def test_noise_under_forces_is_the_integral(dt_s):
    """Of [z, zdot, u] under stiffness, damping and a force that is forgotten; to the 1e-9 that keeps it definite."""
    shape = oscillator(np.random.default_rng(5))
    factor = shape.noise(dt_s)
    nodes, weights = np.polynomial.legendre.leggauss(120)
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


def test_noise_of_a_long_step_is_that_of_many_short_ones():
    """A frame that is missing for two seconds, 130 times the memory: Q of 2 s is that of 256 steps."""
    shape = oscillator(np.random.default_rng(7))
    (turn, _), root = shape.flow(2 / 256), shape.noise(2 / 256)
    total = np.zeros((3 * RANK, 3 * RANK))
    for _ in range(256):
        total = turn @ total @ turn.T + root @ root.T
    root, sd = shape.noise(2.0), np.sqrt(np.diag(total))
    np.testing.assert_allclose((root @ root.T - total) / np.outer(sd, sd), 0, atol=1e-7)
