"""What is stated of positions whose dots err alike in several frames, against simulated filters."""

import numpy as np
import pytest

from mocap.digitising.errors import RayErrors, lasting_covariance, ray_errors
from mocap.digitising.naming import seen_from

EYES = np.array([[2.0, 0.0, 0.3], [-0.3, 2.0, 0.1], [-1.5, -1.5, 0.4], [0.5, 0.4, 2.0]])


def matrices():
    """Four cameras of 1000 px focal length that look at the origin."""
    out = []
    for eye in EYES:
        ahead = -eye / np.linalg.norm(eye)
        right = np.cross(ahead, [0.1, 0.2, 0.97])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        out.append(np.diag([1000.0, 1000.0, 1.0]) @ np.column_stack([rotation, -rotation @ eye]))
    return np.stack(out)


@pytest.fixture(scope="module")
def filmed():
    """Two markers in 4000 frames; dots err by 0.2 and 0.4 px, of which 0.6 of the variance has a memory of 0.9."""
    rng = np.random.default_rng(0)
    xyz = np.array([[0.02, -0.03, 0.01], [-0.05, 0.02, 0.0]])
    uv, _ = seen_from(matrices(), xyz)
    n = 4000
    slow = np.zeros((4, n, 2, 2))
    for t in range(n):
        new = rng.normal(size=(4, 2, 2))
        slow[:, t] = new if t == 0 else 0.9 * slow[:, t - 1] + np.sqrt(1 - 0.81) * new
    error = np.sqrt(0.4) * rng.normal(size=slow.shape) + np.sqrt(0.6) * slow
    return xyz, uv[:, None] + np.array([0.2, 0.4])[:, None] * error, error


def test_errors_are_found_from_residuals(filmed):
    """Variances of each marker, and the correlation 0.6 x 0.9.

    Squares that last with a correlation of up to 0.36 x 0.81^k leave about 4500 of 20000 degrees of freedom: 2.1 %.
    """
    _, uv, _ = filmed
    found = ray_errors(matrices(), uv, sd_px=0.3)
    np.testing.assert_allclose(found.variance, np.array([0.04, 0.16]) / 0.09, rtol=0.07)
    assert found.lasting[0] == pytest.approx(0.54, abs=0.03)


def test_stated_intervals_hold_where_errors_last(filmed):
    """Of a mean of 4 frames, as a filter makes it, its own 95 % intervals hold less than 85 %; those stated 95 %."""
    xyz, uv, _ = filmed
    cameras = matrices()
    errors = ray_errors(cameras, uv, sd_px=0.3)
    _, jacobian = seen_from(cameras, xyz)
    rows = np.moveaxis(jacobian, 0, 1).reshape(2, 8, 3)
    single = np.linalg.inv(np.swapaxes(rows, 1, 2) @ rows)
    gain = single @ np.swapaxes(rows, 1, 2)
    miss = np.moveaxis(uv - seen_from(cameras, xyz)[0][:, None], 2, 0)  # (2, C, T, 2)
    by_frame = np.moveaxis(miss, 2, 1).reshape(2, -1, 8)
    means = by_frame.reshape(2, -1, 4, 8).mean(axis=2)
    off = np.einsum("mij,mnj->mni", gain, means)
    naive = 0.3**2 * single / 4
    honest = lasting_covariance(errors, jacobian, np.full((4, 2), 0.3), naive, shared=0.0)

    def inside(cov):
        return float((np.abs(off) < 1.96 * np.sqrt(np.einsum("mii->mi", cov))[:, None]).mean())

    assert inside(errors.variance[:, None, None] * naive) < 0.85
    assert 0.92 < inside(honest) < 0.98


def test_without_lasting_errors_the_filter_is_right():
    """Nothing lasts, nothing differs: the covariance is the filter's, whatever lasting errors share."""
    cov = np.eye(3)[None] * 2e-9
    errors = RayErrors(sd_px=0.3, variance=np.ones(1), lasting=np.zeros(1))
    _, jacobian = seen_from(matrices(), np.zeros((1, 3)))
    np.testing.assert_allclose(lasting_covariance(errors, jacobian, np.full((4, 1), 0.3), cov), cov)


@pytest.mark.parametrize("copies", [1, 2])
def test_shared_errors_do_not_fall_with_the_number_of_cameras(copies):
    """All errors last and are shared: 0.3 px of every picture is 0.3 / 1000 of 2 m at 1000 px, with 4 or 8 cameras.

    Two rows of each picture span the two directions across its ray alone: their mean square is that of all three. What
    is not shared halves with twice the cameras.
    """
    errors = RayErrors(sd_px=0.3, variance=np.ones(1), lasting=np.ones(1))
    _, jacobian = seen_from(np.concatenate([matrices()] * copies), np.zeros((1, 3)))
    sd, filtered = np.full((4 * copies, 1), 0.3), np.eye(3)[None] * 1e-6
    far = np.linalg.norm(EYES, axis=1).mean()
    shared = lasting_covariance(errors, jacobian, sd, filtered, shared=1.0)[0]
    np.testing.assert_allclose(shared, np.eye(3) * (0.3 * far / 1000) ** 2, rtol=0.2, atol=1e-15)
    own = lasting_covariance(errors, jacobian, sd, filtered, shared=0.0)[0]
    assert np.trace(own) / np.trace(shared) == pytest.approx(1 / (4 * copies * 2 / 3), rel=0.2)
    half = lasting_covariance(errors, jacobian, sd, filtered, shared=0.5)[0]
    np.testing.assert_allclose(half, 0.5 * (own + shared))
