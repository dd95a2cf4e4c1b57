"""Smooth random curves against quadrature and finite differences."""

import numpy as np
from mocap.datasets.linkage import draw_wander, skin_motion
from scipy.integrate import quad


def test_unit_mean_square():
    """Over a time much longer than 1 / (difference of frequencies), sinusoids are uncorrelated: mean square 1."""
    wander = draw_wander(np.random.default_rng(1), band_hz=(1.0, 6.0))
    t_s = np.linspace(0, 2000, 400_000)
    # cross terms fall as 1 / (2 pi df T), here below 1e-2 for neighbours 0.1 Hz apart
    assert abs(np.mean(wander.value(t_s) ** 2) - 1) < 1e-2


def test_integral_and_acceleration():
    """The integral is SciPy's quadrature; the acceleration is the second difference, to its h^2 w'''' / 12."""
    wander = draw_wander(np.random.default_rng(2), band_hz=(0.3, 2.0))
    expected = quad(lambda t: wander.value(np.array([t]))[0], 0, 1.7, epsabs=1e-12)[0]
    np.testing.assert_allclose(wander.integral(np.array([1.7]))[0], expected, atol=1e-11)
    h = 1e-4
    w = wander.value(1.3 + h * np.arange(-1, 2))
    # |w| <= sqrt(10), so |w''''| <= sqrt(10) (4 pi)^4 = 8e4: truncation 7e-5, rounding 4e-8
    np.testing.assert_allclose(wander.acceleration(np.array([1.3]))[0], (w[0] - 2 * w[1] + w[2]) / h**2, atol=1e-4)


def test_skin_motion_has_the_size_asked_for():
    """Each coordinate has the root mean square of its marker; a marker of scale 0 does not move at all."""
    t_s = np.arange(0, 400, 0.01)
    offsets = skin_motion(np.random.default_rng(3), t_s, 2 * np.pi * 9 * t_s, np.array([1e-3, 0.0]))
    # the wander's cross terms as above, with at least 0.05 Hz between most neighbours
    np.testing.assert_allclose(np.sqrt(np.mean(offsets[:, 0] ** 2, axis=0)), 1e-3, rtol=0.05)
    assert not offsets[:, 1].any()
