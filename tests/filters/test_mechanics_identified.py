"""Mechanics identified from motion: known oscillators are recovered, to their standard errors."""

import numpy as np
import pytest
from mocap.filters.motion.shape import LinearShape, RecordedMotion, joined, linear_shape

RANK, DT_S = 2, 1 / 240
STIFFNESS = (2 * np.pi * np.array([[8.0, 1.0], [2.0, 5.0]])) ** 2
DAMPING = np.array([[6.0, -1.0], [0.5, 3.0]])
FORCE = np.array([40.0, -25.0])


def oscillation(rng, n_frames=400, *, noise=20.0, trials=3):
    """A driven, damped oscillator in several trials, whose accelerations are known to ``noise``."""
    truth = LinearShape(STIFFNESS, DAMPING, FORCE, 40 * np.eye(RANK), 0.01)
    parts = []
    for _ in range(trials):
        state = np.concatenate([0.3 * rng.normal(size=RANK), 10 * rng.normal(size=RANK), np.zeros(RANK)])
        states, drive = [], truth.noise(DT_S) @ rng.normal(size=(3 * RANK, n_frames))
        transition, offset = truth.flow(DT_S)
        for kick in drive.T:
            state = transition @ state + offset + kick
            states.append(state)
        states = np.array(states)
        push = FORCE - states[:, :RANK] @ STIFFNESS.T - states[:, RANK : 2 * RANK] @ DAMPING.T
        acceleration = push + noise * rng.normal(size=(n_frames, RANK))
        parts.append((states[:, :RANK], states[:, RANK : 2 * RANK], acceleration))
    return joined(parts, DT_S)


@pytest.mark.rare
def test_a_damped_oscillator_is_recovered_to_its_standard_error():
    """Errors of stiffness, damping and force over their standard errors have unit variance, over 60 recordings.

    Standard errors are noise sqrt((X^T X)^-1) of the regressors (z, zdot, 1). 600 errors, of which those of one
    recording are correlated: a variance between 0.75 and 1.3.
    """
    ratios = []
    for seed in range(60):
        motion = oscillation(np.random.default_rng(seed))
        found = linear_shape(motion, ridge=1e-12)
        x = np.column_stack([motion.z, motion.rate, np.ones(len(motion.z))])
        error = 20.0 * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
        off = np.column_stack([STIFFNESS - found.stiffness, DAMPING - found.damping, found.force - FORCE])
        ratios.append(off / error)
    assert 0.75 < np.mean(np.square(ratios)) < 1.3
    assert np.abs(ratios).max() < 5


def test_without_noise_the_equation_is_found_exactly():
    """Nothing but the ridge of 1e-12 is between the regression and the truth."""
    found = linear_shape(oscillation(np.random.default_rng(1), noise=0.0), ridge=1e-12)
    np.testing.assert_allclose(found.stiffness, STIFFNESS, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(found.damping, DAMPING, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.force, FORCE, rtol=1e-6)


def test_a_ridge_draws_forces_to_zero():
    """The more it penalises, the smaller the forces that depend on the state; at last the mean acceleration is left."""
    motion = oscillation(np.random.default_rng(2))
    sizes = [np.linalg.norm(linear_shape(motion, ridge=ridge).stiffness) for ridge in (0.0, 0.1, 1.0, 10.0)]
    assert (np.diff(sizes) < 0).all()
    found = linear_shape(motion, ridge=1e9)
    pull = motion.z @ found.stiffness.T + motion.rate @ found.damping.T
    np.testing.assert_allclose(found.force - pull, np.tile(motion.acceleration.mean(axis=0), (len(pull), 1)), atol=1e-3)


def harmonic(amplitude, hz, n_frames=2400):
    """One mode in whole cycles, with exact derivatives."""
    t, w = np.arange(n_frames) * DT_S, 2 * np.pi * hz
    z = amplitude * np.sqrt(2) * np.stack([np.sin(w * t)], axis=1)
    rate = amplitude * np.sqrt(2) * w * np.stack([np.cos(w * t)], axis=1)
    return RecordedMotion(z=z, rate=rate, acceleration=-(w**2) * z, trial=np.zeros(n_frames, dtype=np.int64), dt_s=DT_S)


def test_what_is_unexplained_drives_what_is_explained():
    """A sine of variance v at w that no regressor follows leaves the density 2 v / w, to (w dt)^2 / 24 of it."""
    motion, w = harmonic(0.02, 4.0), 2 * np.pi * 11.0
    t = np.arange(len(motion.z)) * DT_S
    extra = 5.0 * np.sqrt(2) * np.sin(w * t)[:, None]
    disturbed = RecordedMotion(
        z=motion.z, rate=motion.rate, acceleration=motion.acceleration + extra, trial=motion.trial, dt_s=DT_S
    )
    found = linear_shape(disturbed, ridge=1e-9).density[0, 0] ** 2
    assert found == pytest.approx(2 * 5.0**2 / w, rel=0.01)


def test_joined_stretches_keep_apart():
    """Differences are taken within a stretch: cut into stretches or not, a motion leaves the same density.

    Put on end in another order there are jumps, and still the same density, but for the differences at the cuts.
    """
    rng = np.random.default_rng(7)
    motion = oscillation(rng, n_frames=600, trials=1, noise=0.0)
    acceleration = motion.acceleration + 30 * np.cumsum(rng.normal(size=motion.z.shape), axis=0) * 0.1
    whole = joined([(motion.z, motion.rate, acceleration)], DT_S)
    order = rng.permutation(6)
    pieces = [tuple(x[100 * i : 100 * (i + 1)] for x in (motion.z, motion.rate, acceleration)) for i in order]
    cut = joined(pieces, DT_S)
    np.testing.assert_array_equal(cut.trial, np.repeat(np.arange(6), 100))
    one, other = (linear_shape(m, ridge=1e-9).density for m in (whole, cut))
    np.testing.assert_allclose(other @ other.T, one @ one.T, rtol=0.02, atol=0.02 * np.abs(one @ one.T).max())
