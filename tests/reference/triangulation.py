"""Triangulation by the letter: one point at a time, one equation after the other. Slow on purpose."""

import numpy as np
from scipy.optimize import least_squares


def pixel(matrix, point):
    """(u, v) of one point in one camera, from its twelve numbers."""
    x, y, z = point
    row = [sum(m * c for m, c in zip(line, (x, y, z, 1.0), strict=True)) for line in matrix]
    return np.array([row[0] / row[2], row[1] / row[2]])


def linear_point(coefficients, pixels):
    """The DLT equations of one point, solved by an orthogonal factorisation: Hedrick 2008, as DLTdv does it.

    Args:
        coefficients: A list of L1..L11, a camera each.
        pixels: A list of (u, v), NaN where a camera does not see the point.
    """
    left, right = [], []
    for c, (u, v) in zip(coefficients, pixels, strict=True):
        if np.isnan(u) or np.isnan(v):
            continue
        left += [
            [u * c[8] - c[0], u * c[9] - c[1], u * c[10] - c[2]],
            [v * c[8] - c[4], v * c[9] - c[5], v * c[10] - c[6]],
        ]
        right += [c[3] - u, c[7] - v]
    if len(left) < 4:
        return np.full(3, np.nan)
    return np.linalg.lstsq(np.array(left), np.array(right), rcond=None)[0]


def optimal_point(matrices, pixels, sd, start):
    """The point of least weighted squared reprojection error, and (J^T J)^-1, by SciPy's Levenberg-Marquardt."""
    seen = [i for i, p in enumerate(pixels) if np.isfinite(p).all()]

    def misses(point):
        return np.concatenate([(pixels[i] - pixel(matrices[i], point)) / sd[i] for i in seen])

    def slope(point):  # SciPy's own step is a share of a coordinate, which may be next to nothing
        return np.stack([(misses(point + e) - misses(point - e)) / 2e-6 for e in 1e-6 * np.eye(3)], axis=1)

    found = least_squares(misses, start, slope, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    jacobian = slope(found.x)
    return found.x, np.linalg.inv(jacobian.T @ jacobian)
