"""Clicks that stay off, poses that differ: both are found in the misfit, and intervals hold for either."""

from functools import partial

import numpy as np
import pytest
from mocap.filters import one_camera
from mocap.filters.misfit import Matern
from mocap.filters.one_camera import left_out, track_views
from mocap.filters.one_view import Views
from mocap.filters.pose_prior import learn_prior
from mocap.filters.trajectory import Quadratic, most_probable

from eal.arrays import Z95
from eal.threads import one_blas_thread
from tests.filters.flapping_trials import MATRIX, NAMES, TRUNK, filmed, flapping

CLICKS_PX = 10.0
RHO = 0.85


def tracked(off_px, lift=(-0.6, 0.9), frames=60):
    """A trial whose clicks stay off, by three others; and what share of relative coordinates is in 95 % intervals."""
    trunk, trials = [NAMES.index(m) for m in TRUNK], [flapping(k, lift=lift) for k in (1, 2, 3)]
    trial, rng, prior = flapping(9, frames=frames), np.random.default_rng(0), learn_prior(trials, trunk)
    uv = filmed(trial, rng)
    uv += off_px * Matern(rho=RHO).drawn(rng, uv.shape[1:])
    views = Views(matrices=MATRIX[None], uv_px=uv, sd_px=np.full(uv.shape[:3], 0.5))
    with one_blas_thread():
        found = track_views(prior, views, doubt=partial(left_out, trials=trials, trunk=trunk))
    error = found.estimate.xyz_m - trial.xyz_m
    markers = error.shape[1]
    less = np.kron(np.eye(markers) - 1 / markers, np.eye(3))
    sd = np.sqrt(np.einsum("tij,tij->ti", less @ found.joint, np.broadcast_to(less, found.joint.shape)))
    off = (error - error.mean(axis=1, keepdims=True)).reshape(sd.shape)
    return found, float(np.mean(np.abs(off) < Z95 * sd)), float(np.sqrt(np.mean((off / sd) ** 2)))


def test_clicks_that_stay_off_are_found_and_empty_no_frame():
    """Of 10 px; with jitter alone, which is all that differences show, every frame was empty."""
    found, inside, z = tracked(CLICKS_PX)
    assert found.misfit.sd_px == pytest.approx(CLICKS_PX, rel=0.4)
    assert found.misfit.posed < 0.3
    assert found.unlike.mean() < 0.1
    assert inside > 0.9
    assert 0.6 < z < 1.4


def test_poses_that_differ_are_no_worse_for_it():
    """Wings are never lowered in trials: 99 % are inside, 84 without misfit, 89 if it is clicks alone."""
    found, inside, _ = tracked(0.0, lift=(0.15, 0.9))
    assert found.misfit.sd_m > 0
    assert found.misfit.posed > 0.5
    assert inside > 0.9


def test_clicks_and_poses_as_those_of_trials_have_no_misfit():
    """Nothing is widened where nothing is missed."""
    found, inside, _ = tracked(0.0)
    assert found.misfit.sd_m == 0
    assert inside > 0.9


def test_a_misfit_as_large_as_poses_differ_leaves_all_empty(monkeypatch):
    """Where poses of trials say nothing of what was seen, they do not stand for it."""
    monkeypatch.setattr(one_camera, "LARGEST", 0.01)
    assert tracked(CLICKS_PX, frames=40)[0].unlike.all()


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_drawn_errors_vary_and_last_as_stated(rho):
    """Variance 1 and the correlations of three frames, of 4000 series of 3 frames."""
    process = Matern(rho=rho)
    drawn = process.drawn(np.random.default_rng(0), (3, 4000))
    assert np.mean(drawn[:, None] * drawn, axis=-1) == pytest.approx(
        np.array([[process.correlations[abs(a - b)] for a in range(3)] for b in range(3)]), abs=0.06
    )


class Creeping:
    """A parabola whose curvature is taken for so many times what it is: each step goes that share of the way."""

    times = 300.0

    def cost(self, at):
        """Least at 7."""
        return 0.5 * float(np.sum((at - 7.0) ** 2))

    def quadratic(self, at):
        """Slope and curvature."""
        return Quadratic(gradient=at - 7.0, band=(np.full((1, 1, 1), self.times),))

    def moved(self, at, step):
        """A number."""
        return at + step


def test_a_search_that_creeps_goes_on_along_its_steps():
    """A hundred steps of a three-hundredth of the way had no end; pixels tell as little of a far animal's depth."""
    assert most_probable(Creeping(), np.zeros((1, 1)))[0, 0] == pytest.approx(7.0, abs=0.05)
