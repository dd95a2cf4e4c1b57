"""Where cameras see points."""

import numpy as np

from eal.arrays import Array


def project(matrices: Array, xyz_m: Array) -> Array:
    """Ideal pixels of world points in every camera.

    Args:
        matrices: (C, 3, 4) projections.
        xyz_m: (..., 3) points in metres.

    Returns:
        (C, ..., 2) pixels; NaN where the point is NaN.
    """
    # numerator and denominator as one matrix product over all points and cameras
    flat = xyz_m.reshape(-1, 3)
    homogeneous = matrices[:, :, :3] @ flat.T + matrices[:, :, 3:]
    uv = homogeneous[:, :2] / homogeneous[:, 2:]
    return np.moveaxis(uv, 1, -1).reshape(len(matrices), *xyz_m.shape[:-1], 2)
