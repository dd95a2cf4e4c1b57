"""Cross products of vectors in space."""

import numpy as np

from eal.arrays import Array


def skew(v: Array) -> Array:
    """(..., 3, 3) matrices of the cross product with (..., 3) vectors."""
    x, y, z = np.moveaxis(np.asarray(v), -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def cross(a: Array, b: Array) -> Array:
    """(..., 3) cross products, without what NumPy's spends on checks."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
