"""Errors of rays that last: what they add to the covariance of a point that no camera shows is a covariance."""

import numpy as np
from mocap.datasets import make_bat

from mocap.cleaning.cleaning import clean
from mocap.reading.ideal_pixels import of_pixels
from mocap.tracking.tracking import lasting_cov


def test_a_gap_gets_the_covariance_of_one_of_the_samples_of_its_marker():
    """Points that are uncertain along one of three lines: the median of each entry is not positive definite."""
    film = make_bat(seed=0, n_frames=40, n_cameras=3)
    prepared = clean(of_pixels(film.pixels, film.cameras, film.skeleton, name="bat"))
    long = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
    each = long[np.arange(39) % 3]
    cov = prepared.cov_m2.copy()
    cov[0, 0] = np.nan
    cov[1:, 0] = np.einsum("ti,tj->tij", each, each) + 1e-3 * np.eye(3)
    assert np.linalg.eigvalsh(np.median(cov[1:, 0], axis=0))[0] < -0.1
    found = lasting_cov(prepared.having(covariance=cov, persistent=np.ones(len(prepared.names))))[:, 0]
    assert np.linalg.eigvalsh(found[0])[0] > 0
    assert any(np.allclose(found[0], one) for one in found[1:])
