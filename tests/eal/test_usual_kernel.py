"""A potential of samples alone: the kernel that is taken where none is given, and its picture."""

import numpy as np
import pytest
from matplotlib import pyplot

from eal import GaussianKernel, fit_potential, usual_kernel


def samples(n=60, d=2, seed=0):
    angle = np.random.default_rng(seed).uniform(0, 4, n)
    return np.column_stack([np.cos(angle), np.sin(angle), angle][:d])


@pytest.mark.parametrize("unit", [1e-3, 1.0, 180 / np.pi])
def test_the_unit_of_the_coordinates_does_not_matter(unit):
    """V_z of scaled samples at scaled points is the same: distances count in units of their own median."""
    z, q = samples(), np.random.default_rng(1).normal(size=(20, 2))
    np.testing.assert_allclose(fit_potential(unit * z).value(unit * q), fit_potential(z).value(q), rtol=0, atol=1e-9)


def test_it_is_the_stated_gaussian():
    """Beta = 4 / median squared distance, of all pairs counted one by one."""
    z = samples(n=9)
    squared = [float(np.sum((a - b) ** 2)) for i, a in enumerate(z) for b in z[:i]]
    kernel = usual_kernel(z)
    assert kernel == GaussianKernel(kernel.curvature / 2)
    x, y = z[:1], z[4:5]
    expected = np.exp(-4 * np.sum((x - y) ** 2) / np.median(squared))
    np.testing.assert_allclose(kernel.gram(x, y), [[expected]], rtol=1e-12)


@pytest.mark.parametrize("z", [np.zeros((1, 2)), np.ones((5, 3))])
def test_one_point_has_a_potential(z):
    """No distance to take a scale from: a kernel of unit scale, zero-like at the point."""
    assert fit_potential(z).value(z[0]) < 0.01


@pytest.mark.parametrize("d", [1, 2])
def test_the_picture_shows_the_samples(d):
    """A curve in one coordinate, a map in two, none in three."""
    z = samples(d=d)
    ax = fit_potential(z, names=["a", "b"][:d]).plot()
    np.testing.assert_allclose(ax.get_lines()[-1].get_xdata(), z[:, 0])
    assert ax.get_xlabel() == "a"
    pyplot.close("all")


def test_three_coordinates_have_no_map():
    """The message says what to do."""
    with pytest.raises(ValueError, match="3 coordinates has no map: fix all but two"):
        fit_potential(samples(d=3)).plot()
