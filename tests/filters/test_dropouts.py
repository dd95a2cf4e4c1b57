"""The engine under random dropouts: always a covariance, and an honest one."""

import numpy as np
import pytest
from mocap.filters.ensemble import Gaussian, default_points, predict, update

START_SD = 10.0


def bent(rows):
    """(S, n) states to (S, m) observations: a plane wave on a slope in each row's direction."""
    return lambda x: x[:, : rows.shape[1]] @ rows.T + 0.1 * np.sin(x[:, : rows.shape[1]] @ rows.T)


@pytest.mark.parametrize(("n", "n_frames"), [(12, 2000), (60, 200)])
def test_dropouts_leave_a_covariance(n, n_frames):
    """A body on springs; rows come and go, with dark stretches and rows as precise as 1e-6 of the prior.

    Of 20 x 12 components looked at 95 % lie inside 1.96 deviations, to three of the 1.4 % that chance allows were they
    independent, and three times that as neighbours in time and space are not.
    """
    rng, half, points, dt = np.random.default_rng(0), n // 2, default_points(n), 0.01
    transition = np.eye(n) + dt * np.diag(np.ones(half), half)
    transition[half:, :half] = -dt * np.eye(half)  # a spring keeps the truth near
    transition[half:, half:] *= 0.999
    noise = np.diag(np.repeat([1e-3, 3e-2], half))
    directions = rng.normal(size=(2 * half, half)) / np.sqrt(half)
    truth, state = rng.normal(size=n), Gaussian(np.zeros(n), START_SD * np.eye(n))
    dark, inside = np.arange(n_frames // 4, n_frames // 2), []
    for frame in range(n_frames):
        truth = transition @ truth + noise @ rng.normal(size=n)
        state = predict(state, lambda x: x @ transition.T, noise, points).state
        keep = np.flatnonzero(rng.random(2 * half) < rng.choice([0.0, 0.05, 0.3, 0.95]))
        if len(keep) and frame not in dark:
            h, sd = bent(directions[keep]), START_SD * 10.0 ** rng.uniform(-6, -1, len(keep))
            y = h(truth[None])[0] + sd * rng.normal(size=len(keep))
            state = update(state, lambda x, h=h: h(x[:, :half]), y, sd, points).state
        assert np.isfinite(state.mean).all()
        assert np.isfinite(state.factor).all()
        assert np.diag(state.factor).min() > 0
        if frame % (n_frames // 20) == 0:
            deviation = np.sqrt(np.diag(state.cov))
            assert np.linalg.eigvalsh(state.cov / np.outer(deviation, deviation)).min() > 0
            inside.append(np.mean(np.abs(state.mean - truth) <= 1.96 * deviation))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.13)
