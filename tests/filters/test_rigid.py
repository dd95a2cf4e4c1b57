"""Rigid bodies: found where distances keep, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.filters.rigid import distance_spread, find_bodies

from tests.filters.bodies_trials import two_bodies


@pytest.mark.parametrize("count", [(3, 4), (5, 5), (6, 8)])
@pytest.mark.parametrize(("noise_m", "slip_m"), [(1e-6, 0.0), (2e-4, 0.0), (1e-4, 3e-4)])
def test_two_bodies_are_found(count, noise_m, slip_m):
    """Both, exactly, whether their distances vary by micrometres of noise or by half a millimetre of slip.

    Between bodies they vary by some millimetres.
    """
    found = find_bodies(two_bodies(count, noise_m=noise_m, slip_m=slip_m, seed=sum(count)).trial)
    assert found == [[*range(count[0])], [*range(count[0], sum(count))]]


def test_markers_that_go_missing():
    """A quarter of all samples, in gaps of 25 frames, changes nothing; a marker that is never seen is in no body."""
    trial = two_bodies().trial
    lost = np.random.default_rng(0).random((20, 10)).repeat(25, axis=0) < 0.25
    lost[:, 9] = True
    found = find_bodies(replace(trial, xyz_m=np.where(lost[..., None], np.nan, trial.xyz_m)))
    assert found == [[0, 1, 2, 3, 4], [5, 6, 7, 8]]


def test_one_body_alone_is_judged_by_the_noise():
    """Nothing moves against it: its distances vary by the noise, which is stated. Stated ten times less, it is none."""
    trial = two_bodies((6, 3), noise_m=1e-4).trial
    alone = replace(trial, xyz_m=trial.xyz_m[:, :6], sd_m=trial.sd_m[:, :6])
    assert find_bodies(alone) == [[0, 1, 2, 3, 4, 5]]
    assert find_bodies(replace(alone, sd_m=0.1 * alone.sd_m)) == []


def test_what_bends_is_no_body():
    """Wings, membranes and fingers: no three markers of a flying bat are found, and none of points in a cloud."""
    bat = make_bat(seed=3, n_frames=300).truth
    trial = two_bodies().trial
    rng = np.random.default_rng(0)
    flying = replace(trial, t_s=bat.t_s, xyz_m=bat.xyz_m, sd_m=np.full(bat.xyz_m.shape[:2], 3e-4))
    assert find_bodies(replace(flying, xyz_m=bat.xyz_m + 3e-4 * rng.normal(size=bat.xyz_m.shape))) == []
    assert find_bodies(replace(trial, xyz_m=rng.normal(size=trial.xyz_m.shape))) == []


def test_independent_samples():
    """White distances count fully; of an autoregression with rho the share (1 - rho^2) / (1 + rho^2).

    The sum over all lags of rho^(2 |k|) is (1 + rho^2) / (1 - rho^2). Both from 2000 frames, to 10 %.
    """
    rng = np.random.default_rng(0)
    n, rho = 2000, 0.9
    steps, path = rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        path[k] = rho * path[k - 1] + np.sqrt(1 - rho**2) * steps[k]
    xyz = np.zeros((n, 3, 3))
    xyz[:, 1, 0], xyz[:, 2, 1] = 1 + 1e-3 * steps, 1 + 1e-3 * path
    trial = replace(two_bodies().trial, t_s=np.arange(n) / 100, xyz_m=xyz, sd_m=np.full((n, 3), 1e-5))
    spread, samples = distance_spread(trial)
    np.testing.assert_allclose(spread[0, 1:], [1e-3, 1e-3], rtol=0.1)
    np.testing.assert_allclose(samples[0, 1:], [n, n * (1 - rho**2) / (1 + rho**2)], rtol=0.1)
