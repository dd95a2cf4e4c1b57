"""The engine where the textbook's formulas run out of digits: against fifty, and against trajectories at once."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints
from mocap.filters.ensemble import Gaussian, default_points, predict, smooth_step, update

from tests.reference import fifty_digits
from tests.reference import gaussian_filter as reference

CAMERAS = np.array(
    [
        [[1000.0, 0, 500, 0], [0, 1000, 500, 0], [0, 0, 1, 8]],
        [[500.0, 0, -1000, 500], [500, 1000, 0, 500], [-0.25, 0, 0, 8]],
    ]
)


def pinholes(x):
    """Pixels (..., 4) of a point x[..., :3] in two cameras; works on floats and on decimals."""
    cameras = CAMERAS if x.dtype != object else fifty_digits.exact(CAMERAS)
    position = x[..., :3]
    rows = [position @ camera[:, :3].T + camera[:, 3] for camera in cameras]
    return np.concatenate([row[..., :2] / row[..., 2:] for row in rows], axis=-1)


def moved(dt):
    """Constant velocity over a step: a function of (..., 6), of floats and of decimals."""

    def step(x):
        h = dt if x.dtype != object else fifty_digits.exact(dt).item()
        return np.concatenate([x[..., :3] + h * x[..., 3:], x[..., 3:]], axis=-1)

    return step


def problem(rng, *, prior_m, speed_m_s, noise_m, pixel):
    """A point before two cameras: start, and frames of uneven steps, changing noise and missing rays."""
    state = Gaussian(rng.normal(0, 0.1, 6), np.diag([prior_m] * 3 + [speed_m_s] * 3))
    truth, frames = state.mean + state.factor @ rng.normal(0, 0.3, 6), []
    for k in range(8):
        dt = float(rng.uniform(0.001, 0.05))
        truth = moved(dt)(truth)
        noise = noise_m * (1 + k % 3) * np.eye(6)
        seen = [np.arange(4), np.arange(0), np.array([0, 1]), np.array([2, 3]), np.arange(4)][k % 5]
        sd = np.full(len(seen), pixel * 10.0 ** rng.integers(-1, 2))
        frames.append((moved(dt), noise, seen, pinholes(truth)[seen] + sd * rng.normal(size=len(seen)), sd))
    return state, frames


def fifty(state, frames, points):
    """What fifty digits make of a problem: means and covariances of every frame."""
    return fifty_digits.filtered(
        state.mean,
        state.cov,
        [(step, noise @ noise.T, lambda x, s=seen: pinholes(x)[s], y, sd) for step, noise, seen, y, sd in frames],
        alpha=points.alpha,
        beta=points.beta,
        kappa=points.kappa,
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("prior_m", "speed_m_s", "noise_m", "pixel", "alpha", "tolerance"),
    [
        (0.5, 3.0, 1e-3, 0.5, None, 6e-9),  # a day's work
        (0.5, 3.0, 1e-3, 0.5, 1e-2, 6e-5),  # points so near to each other that weights of 1e4 cancel
        (1.0, 10.0, 1e-4, 0.1, None, 2e-7),
        (1.0, 10.0, 1e-6, 1e-3, None, 2e-3),  # one in 1e6 of the prior is left, 1e12 in variance
    ],
)
def test_the_engine_is_right_to_digits_that_doubles_have(prior_m, speed_m_s, noise_m, pixel, alpha, tolerance, seed):
    """Means in deviations, covariances in units of correlation, before pinholes, with rays that come and go.

    The prior is 125 pixels a metre wide, pixels are known to a tenth of ``pixel`` at best: the square of that ratio, as
    is the condition of I + A A^T, times 1e-16, and ten for eight frames; a spread alpha divides by its square.
    """
    rng = np.random.default_rng(seed)
    state, frames = problem(rng, prior_m=prior_m, speed_m_s=speed_m_s, noise_m=noise_m, pixel=pixel)
    points = default_points(6) if alpha is None else MerweScaledSigmaPoints(6, alpha=alpha, beta=2.0, kappa=0.0)
    expected = fifty(state, frames, points)
    for (step, noise, seen, y, sd), (mean, cov) in zip(frames, expected, strict=True):
        state = predict(state, step, noise, points).state
        state = update(state, lambda x, s=seen: pinholes(x)[:, s], y, sd, points).state
        deviation = np.sqrt(np.diag(cov))
        assert np.abs((state.mean - mean) / deviation).max() < tolerance
        assert np.abs((state.cov - cov) / np.outer(deviation, deviation)).max() < tolerance
        assert np.diag(state.factor).min() > 0


def test_where_subtraction_stops_the_engine_goes_on():
    """A metre, then rays to 1e-6 pixels: filterpy's covariance turns indefinite and it stops.

    The engine's stays a covariance and of the right size: deviations to half of what fifty digits say.
    """
    state, frames = problem(np.random.default_rng(0), prior_m=1.0, speed_m_s=10.0, noise_m=1e-8, pixel=1e-5)
    points = default_points(6)
    expected = fifty(state, frames, points)
    theirs, stopped = (state.mean, state.cov), False
    for (step, noise, seen, y, sd), (_, cov) in zip(frames, expected, strict=True):
        state = predict(state, step, noise, points).state
        state = update(state, lambda x, s=seen: pinholes(x)[:, s], y, sd, points).state
        assert np.diag(state.factor).min() > 0
        np.testing.assert_allclose(np.sqrt(np.diag(state.cov)), np.sqrt(np.diag(cov)), rtol=0.5)
        if stopped:
            continue
        if not len(y):
            a = np.stack([step(axis) for axis in np.eye(6)], axis=1)
            theirs = a @ theirs[0], a @ theirs[1] @ a.T + noise @ noise.T
            continue
        try:
            means, covs, *_ = reference.filterpy_filter(
                points,
                theirs,
                step=step,
                noise_cov=noise @ noise.T,
                frames=[(lambda x, s=seen: pinholes(x)[s], y, sd)],
            )
            theirs = means[0], covs[0]
        except np.linalg.LinAlgError:
            stopped = True
    assert stopped


@pytest.mark.parametrize("seed", range(4))
def test_uneven_steps_and_changing_noise_are_the_whole_trajectory(seed):
    """Filter and smoother with a step, a process noise and row deviations of their own in every frame, dark stretches.

    The dense posterior of all frames at once, whose matrix has a condition of 1e8 (deviations from 1e-3 to 10): 1e-16
    times that, and ten times for sums over 240 states.
    """
    rng = np.random.default_rng(seed)
    n, n_frames, points = 8, 30, default_points(8)
    start = Gaussian(rng.normal(size=n), np.diag(10.0 ** rng.uniform(-1, 1, n)))
    steps = 10.0 ** rng.uniform(-3, -0.5, n_frames - 1)
    half = n // 2
    transitions, factors, frames = [], [], []
    for dt in steps:
        spring = np.diag(rng.uniform(0.5, 5, half))
        transitions.append(np.block([[np.eye(half), dt * np.eye(half)], [-dt * spring, (1 - 0.1 * dt) * np.eye(half)]]))
        factors.append(np.sqrt(dt) * np.diag(10.0 ** rng.uniform(-3, 0, n)))
    for k in range(n_frames):
        m = 0 if 10 <= k < 18 else int(rng.integers(0, n))
        frames.append((rng.normal(size=(m, n)), rng.normal(size=m), 10.0 ** rng.uniform(-3, 0, m)))
    state, states, predictions, density = start, [], [], 0.0
    for k, (rows, y, sd) in enumerate(frames):
        if k:
            a = transitions[k - 1]
            predictions.append(predict(state, lambda x, a=a: x @ a.T, factors[k - 1], points))
            state = predictions[-1].state
        if len(y):
            result = update(state, lambda x, r=rows: x @ r.T, y, sd, points)
            state, density = result.state, density + result.log_likelihood
        states.append(state)
    smoothed = [states[-1]]
    for k in range(n_frames - 2, -1, -1):
        smoothed.insert(0, smooth_step(states[k], predictions[k], smoothed[0]))
    means, covs, expected = reference.whole_trajectory(
        start.mean, start.cov, transitions, [f @ f.T for f in factors], frames
    )
    assert density == pytest.approx(expected, rel=1e-7)
    for ours, mean, cov in zip(smoothed, means, covs, strict=True):
        deviation = np.sqrt(np.diag(cov))
        assert np.abs((ours.mean - mean) / deviation).max() < 1e-6
        assert np.abs((ours.cov - cov) / np.outer(deviation, deviation)).max() < 1e-6
