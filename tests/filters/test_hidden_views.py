"""Gaps hidden in what one camera saw."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.hidden_views import across
from mocap.filters.hide import Hidden, hide_neighbours
from mocap.filters.one_view import Views
from mocap.filters.poses import MarkerTrial

from tests.filters.flapping_trials import MATRIX, filmed, flapping


def hidden_and_seen(noise_px: float) -> tuple[Hidden[MarkerTrial], Views]:
    """A trial with gaps, and its pixels."""
    hidden = hide_neighbours(flapping(1), np.random.default_rng(0))
    uv = filmed(hidden.trial, np.random.default_rng(1), noise_px=noise_px)
    return hidden, Views(matrices=MATRIX[None], uv_px=uv, sd_px=np.full(uv.shape[:3], max(noise_px, 1e-3)))


def test_an_error_across_counts_whole_and_one_along_the_line_of_sight_hardly():
    """1 mm across at 1.5 m is 1 mm in x; 1 mm away, at most 10 degrees off the axis, is less than 0.2 mm."""
    hidden, views = hidden_and_seen(0.0)
    cov = np.tile(1e-6 * np.eye(3), (*hidden.mask.shape, 1, 1))
    moved = (np.array([1e-3, 0, 0]), np.array([0, 0, 1e-3]))
    beside, behind = (across(hidden, views, hidden.trial.xyz_m + by, cov) for by in moved)
    assert np.abs(beside.error_m - [-1e-3, 0]).max() < 3e-5  # sqrt(s1 s2) is a metre in the middle of the image
    assert np.linalg.norm(behind.error_m, axis=1).max() < 2e-4
    assert beside.variance == pytest.approx(1e-6, rel=0.06)  # 1 / cos of 10 degrees, squared twice


def test_intervals_of_right_covariances_hold():
    """Errors of 3 mm in three axes and pixels of 0.5 px: z is 1 within 3 / sqrt(2 n) of 2 n coordinates."""
    hidden, views = hidden_and_seen(0.5)
    views = replace(views, sd_px=views.sd_px * np.sqrt((views.dof - 2) / views.dof))  # scales of Student's t
    error = np.random.default_rng(2).normal(scale=3e-3, size=hidden.trial.xyz_m.shape)
    cov = np.tile(9e-6 * np.eye(3), (*hidden.mask.shape, 1, 1))
    found = across(hidden, views, hidden.trial.xyz_m + error, cov).score()
    assert found.z == pytest.approx(1.0, abs=3 / np.sqrt(4 * found.samples))
