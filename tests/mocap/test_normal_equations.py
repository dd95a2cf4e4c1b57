"""Normal equations of many points at once are those that NumPy solves one by one."""

import numpy as np

from mocap.cameras.triangulate import PAIRS, factor, inverse, normal_equations, solve, squared_length, towards

RNG = np.random.default_rng(0)
SLOPE, WEIGHT, ERROR = RNG.normal(size=(4, 2, 3, 50)), RNG.uniform(0.5, 2, (4, 50)), RNG.normal(size=(4, 2, 50))
ROWS = np.moveaxis(SLOPE.reshape(8, 3, 50), -1, 0)
HEAVY = np.repeat(WEIGHT, 2, axis=0).T[..., None] * ROWS
NORMAL, RIGHT = np.swapaxes(HEAVY, 1, 2) @ ROWS, np.einsum("kri,kr->ki", HEAVY, ERROR.reshape(8, 50).T)
ROUNDING = 1e-9
"""Condition numbers are below 1e4, so that results agree to 1e4 times the rounding of a double, with room."""


def test_sums_are_those_of_matrix_products():
    """J^T W J and J^T W e."""
    normal, right = normal_equations(SLOPE, WEIGHT, ERROR)
    np.testing.assert_allclose(normal, np.stack([NORMAL[:, i, j] for i, j in PAIRS]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(right.T, RIGHT, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(towards(SLOPE, WEIGHT, ERROR), right, rtol=1e-12, atol=1e-12)


def test_solutions_and_inverses_are_lapacks():
    """A x = b, A^-1 and r^T A^-1 r of each."""
    by = factor(np.stack([NORMAL[:, i, j] for i, j in PAIRS]))
    np.testing.assert_allclose(solve(by, RIGHT.T).T, np.linalg.solve(NORMAL, RIGHT[..., None])[..., 0], rtol=ROUNDING)
    np.testing.assert_allclose(inverse(by), np.linalg.inv(NORMAL), rtol=ROUNDING, atol=ROUNDING)
    length = np.einsum("kri,kij,krj->rk", ROWS, np.linalg.inv(NORMAL), ROWS)
    np.testing.assert_allclose(squared_length(by, np.moveaxis(ROWS, 0, -1)), length, rtol=ROUNDING)


def test_what_one_ray_alone_determines_is_no_point():
    """Two rows leave a direction free: singular, and NaN rather than anything large."""
    normal, right = normal_equations(SLOPE[:1], WEIGHT[:1], ERROR[:1])
    assert np.isnan(solve(factor(normal), right)).all()
    assert np.isnan(inverse(factor(normal))).any(axis=(1, 2)).all()
