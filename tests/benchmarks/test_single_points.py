"""What single points are compared with: splines and filters of known motions, by closed forms."""

import numpy as np
import pytest

from benchmarks.single_points import Point, cubic, flight, lowpass, quintic, rms, with_gaps
from eal.systems import GRAVITY_M_S2


def swing(noise=0.0):
    """A point that swings at 1 Hz along x, and its acceleration."""
    t_s, w = np.arange(200) / 100, 2 * np.pi
    xyz = np.stack([np.sin(w * t_s), 0 * t_s, 0 * t_s], axis=1)
    seen = xyz + noise * np.random.default_rng(0).normal(size=xyz.shape)
    return Point(name="swing 0", t_s=t_s, xyz_m=seen, truth=-(w**2) * xyz)


@pytest.mark.parametrize("gaps", [False, True])
def test_a_spline_of_degree_five_bends_as_the_motion(gaps):
    """Without noise to 1e-3 of w^2, across gaps of ten frames to 2 %; as stiff as can be it is a parabola."""
    point = with_gaps(swing()) if gaps else swing()
    assert rms(point.error(quintic(point)(1e-12))) < (0.02 if gaps else 1e-3) * (2 * np.pi) ** 2
    assert np.ptp(quintic(point)(1e6), axis=0).max() < 1e-2


def test_a_low_pass_takes_what_is_faster():
    """Far above the motion it is second differences (off by (w dt)^2 / 6); far below it nothing is left."""
    point = swing()
    w = 2 * np.pi
    assert rms(point.error(lowpass(point)(30.0))) < 0.01 * w**2
    assert rms(lowpass(point)(0.1)) < 0.1 * w**2
    assert rms(point.error(cubic(swing(1e-3)))) < 0.1 * w**2


def test_known_accelerations():
    """A ball falls; a swallow's second differences of its noiseless path are its accelerations, but for noise."""
    np.testing.assert_array_equal(flight("ball", 0).truth[:, 2], -GRAVITY_M_S2)
    bird, gaps = flight("swallow", 1), with_gaps(flight("swallow", 1))
    assert rms(bird.error(quintic(bird)(1e-8))) < 0.3 * rms(bird.truth)
    assert np.isnan(gaps.xyz_m[:, 0]).mean() == pytest.approx(0.2)
    np.testing.assert_array_equal(gaps.truth, bird.truth)
