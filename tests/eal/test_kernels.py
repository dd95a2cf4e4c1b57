"""Kernels: their formulas, bounds, symmetry and derivatives."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eal import (
    CoordinateKernel,
    GaussianKernel,
    LaplaceKernel,
    Matern32Kernel,
    Matern52Kernel,
    ProductKernel,
    RotationKernel,
    SumKernel,
)
from tests.reference.empirical_potential import kernel_value

RADIAL = [GaussianKernel(1.3), LaplaceKernel(0.8), Matern32Kernel(1.7), Matern52Kernel(2.1)]
ALL = [
    *RADIAL,
    SumKernel((GaussianKernel(0.5), LaplaceKernel(1.0), Matern52Kernel(2.0)), (1.0, 2.0, 3.0)),
    ProductKernel((GaussianKernel(0.4), Matern32Kernel(1.1), LaplaceKernel(0.3))),
    CoordinateKernel(GaussianKernel(0.7), (0.5, 2.0, 1.5), (0.0, 2 * np.pi, 3.0)),
    CoordinateKernel(Matern52Kernel(1.0), (1.0, np.inf, 0.7)),
    RotationKernel(GaussianKernel(0.5), (3,), (0.8,)),
    RotationKernel(Matern52Kernel(0.9), (2, 0), (1.4, 0.6)),
    RotationKernel(GaussianKernel(0.6), (1, 2), (0.1, 1.0)),
    ProductKernel(
        (
            CoordinateKernel(GaussianKernel(1.0), (1.0, 1.0, np.inf)),
            CoordinateKernel(Matern32Kernel(1.0), (np.inf, np.inf, 1.0), (0, 0, 2.0)),
        )
    ),
]
each = pytest.mark.parametrize("kernel", ALL, ids=lambda k: type(k).__name__)


@pytest.fixture
def clouds(rng):
    return rng.standard_normal((5, 3)), rng.standard_normal((7, 3))


@pytest.mark.parametrize("kernel", RADIAL, ids=lambda k: type(k).__name__)
def test_gram_is_the_textbook_formula(kernel, clouds):
    """K agrees with the formula written out; the expanded square costs a few rounding errors of |x|^2 < 20."""
    q, z = clouds
    expected = [[kernel_value(type(kernel).__name__, kernel.beta, x, y) for y in z] for x in q]
    np.testing.assert_allclose(kernel.gram(q, z), expected, rtol=1e-13)


@each
def test_kernel_is_symmetric_positive_and_one_at_coincidence(kernel, clouds):
    """0 < K <= 1, K(x, x) = 1, K(x, y) = K(y, x), Gram matrix positive semidefinite to rounding."""
    q, z = clouds
    gram = kernel.gram(z, z)
    np.testing.assert_allclose(np.diag(gram), 1.0, atol=1e-14)
    np.testing.assert_allclose(kernel.gram(q, z), kernel.gram(z, q).T, rtol=1e-13)
    assert (gram > 0).all()
    assert (gram <= 1).all()
    assert np.linalg.eigvalsh(gram).min() > -1e-14


@each
def test_gradients_of_log_k_are_central_differences(kernel, clouds):
    """Central differences, h = 1e-5: truncation h^2 and rounding 1e-16/h are both near 1e-10."""
    q, z = clouds
    expected = np.stack([_central(lambda x: kernel.log_gram(x, z), q, j) for j in range(3)], axis=-1)
    np.testing.assert_allclose(kernel.log_gradients(q, z), expected, atol=2e-8)


@each
def test_weighted_sums_are_sums_of_single_kernels(kernel, clouds, rng):
    """weighted_gradient sums log_gradients; weighted_curvature sums the differences of log_gradients."""
    q, z = clouds
    w = rng.standard_normal((5, 7))
    by_hand = np.einsum("nm,nmd->nd", w, kernel.log_gradients(q, z))
    np.testing.assert_allclose(kernel.weighted_gradient(q, z, w), by_hand, atol=1e-12)
    hessians = np.stack([_central(lambda x: kernel.log_gradients(x, z), q, j) for j in range(3)], axis=-1)
    expected = np.einsum("nm,nmde->nde", w, hessians)
    np.testing.assert_allclose(kernel.weighted_curvature(q, z, w), expected, atol=1e-6)


@each
def test_curvature_bounds_the_second_difference_at_coincidence(kernel):
    """1 - K(x, x + h u) <= curvature h^2 / 2: equality for a radial kernel as h falls."""
    h = 1e-3
    for axis in np.eye(3):
        rise = -np.expm1(kernel.log_gram(h * axis[None], np.zeros((1, 3))))[0, 0]
        assert rise <= kernel.curvature * h * h / 2 * (1 + 1e-6)


def test_periodic_coordinate_forgets_whole_turns(rng):
    """K(x + P, y) = K(x, y), and near angles differ as on the line (chord = arc to (x - y)^2 / 24)."""
    kernel = CoordinateKernel(GaussianKernel(2.0), (0.5,), (2 * np.pi,))
    x, y = rng.uniform(-3, 3, (4, 1)), rng.uniform(-3, 3, (4, 1))
    np.testing.assert_allclose(kernel.gram(x + 2 * np.pi, y), kernel.gram(x, y), rtol=1e-12)
    near = kernel.gram(np.array([[np.pi - 0.005]]), np.array([[-np.pi + 0.005]]))[0, 0]
    assert near == pytest.approx(np.exp(-2.0 * (0.01 / 0.5) ** 2), abs=1e-7)


def test_rotations_are_compared_as_rotations(rng):
    """Of a ball the chord between SciPy's matrices, of the others that between directions; whole turns change nothing.

    Near 0 and near half a turn, where series and closed forms meet, as elsewhere.
    """
    kernel = RotationKernel(GaussianKernel(1.0), (3, 2, 1), (1.5, 0.5, 2.0))
    q, z = 2.0 * rng.normal(size=(50, 6)), 0.7 * rng.normal(size=(50, 6))
    q[:10] *= 1e-4
    axes = [np.eye(3), np.eye(3)[:2], np.eye(3)[:1]]

    def parts(x):
        cut = np.split(x, [3, 5], axis=1)
        turned = [Rotation.from_rotvec(v @ a / s).as_matrix() for v, a, s in zip(cut, axes, kernel.scales, strict=True)]
        return [1.5 * turned[0] / np.sqrt(2), 0.5 * turned[1][..., 2], 2.0 * turned[2][..., 2]]

    squared = sum(((a - b) ** 2).reshape(50, -1).sum(axis=1) for a, b in zip(parts(q), parts(z), strict=True))
    np.testing.assert_allclose(np.diag(kernel.log_gram(q, z)), -squared, atol=1e-12)
    wound = q.copy()
    for part, scale in ((slice(0, 3), 1.5), (slice(3, 5), 0.5), (slice(5, 6), 2.0)):
        wound[:, part] *= 1 + 2 * np.pi * scale / np.linalg.norm(q[:, part], axis=1, keepdims=True)
    np.testing.assert_allclose(kernel.log_gram(wound, z), kernel.log_gram(q, z), atol=1e-9)


def test_near_rotations_are_as_far_apart_as_their_coordinates(rng):
    """K of a thousandth of a radian about any pose at rest is that of the coordinates, to the fourth order."""
    step = 1e-3 * rng.normal(size=(5, 3))
    for freedoms in ((3,), (2, 1), (1, 0, 1)):
        kernel = RotationKernel(GaussianKernel(1.0), freedoms, (1.0,) * len(freedoms))
        np.testing.assert_allclose(kernel.log_gram(step, np.zeros((1, 3)))[:, 0], -np.sum(step**2, axis=1), rtol=1e-5)


def test_gradient_at_the_centre_of_a_cusp_is_zero():
    """The Laplace kernel has no gradient at x = y; the centre of the jump is taken, and nothing is NaN."""
    z = np.zeros((1, 2))
    assert (LaplaceKernel(1.0).log_gradients(z, z) == 0).all()
    assert np.isfinite(Matern32Kernel(1.0).weighted_curvature(z, z, np.ones((1, 1)))).all()


@pytest.mark.parametrize("beta", [0.0, -1.0, np.nan, np.inf])
def test_beta_must_be_positive(beta):
    with pytest.raises(ValueError, match="beta of GaussianKernel must be a finite number above 0"):
        GaussianKernel(beta)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SumKernel(()), "at least one part"),
        (lambda: ProductKernel(()), "at least one part"),
        (lambda: SumKernel((GaussianKernel(1.0),), (1.0, 2.0)), "one share a part"),
        (lambda: CoordinateKernel(GaussianKernel(1.0), (1.0, 0.0)), "scale 1 must be above 0"),
        (lambda: CoordinateKernel(GaussianKernel(1.0), (1.0,), (-1.0,)), "period 0"),
        (lambda: CoordinateKernel(GaussianKernel(1.0), (1.0,), (1.0, 1.0)), "one period a coordinate"),
        (lambda: RotationKernel(GaussianKernel(1.0), (3, 1), (1.0,)), "one scale a joint"),
        (lambda: RotationKernel(GaussianKernel(1.0), (4,), (1.0,)), "1 to 3 coordinates"),
        (lambda: RotationKernel(GaussianKernel(1.0), (2,), (0.0,)), "scale 0 of RotationKernel"),
    ],
)
def test_composites_check_their_parts(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def _central(function, q, j, h=1e-5):
    step = np.zeros(q.shape[1])
    step[j] = h
    return (function(q + step) - function(q - step)) / (2 * h)
