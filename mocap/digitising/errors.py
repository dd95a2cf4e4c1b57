"""Errors of dots that last from frame to frame, differ between markers, or are shared by all images."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.cameras import triangulate
from mocap.digitising.naming import seen_from

_PRIOR_COUNTS = 20  # redundant errors: so many show a scale to 1 / sqrt(2 * 20) = 16 %
SHARED = 0.3
"""Share of the lasting variance that is the same in all images: dots are drawn towards what is bright beside them.
Rays that meet do not show it; chosen on videos of the twins with 8 cameras (lizard, seeds 5 and 6; bat, seed 6)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RayErrors:
    """Errors of the places of dots.

    Attributes:
        sd_px: Standard deviation of a coordinate that rays were weighted with.
        variance: (M,) variance of each marker's dots over its square.
        lasting: (M,) share of the variance that a dot has again in the next frame.
    """

    sd_px: float
    variance: Array
    lasting: Array


def ray_errors(matrices: Array, ideal: Array, *, sd_px: float) -> RayErrors:
    """Estimate errors of dots from how the rays of each marker miss each other, in frames that follow one another.

    The squares of a marker's residuals over their degrees of freedom, 2 n - 3 for n rays, with ``_PRIOR_COUNTS`` of
    the mean; the lasting share is the correlation of the residuals of a ray in two frames.

    Args:
        matrices: (C, 3, 4) projections.
        ideal: (C, T, M, 2) ideal pixels of named dots; NaN: none.
        sd_px: Standard deviation of a coordinate that is assumed.
    """
    xyz_m, _ = triangulate.refine(matrices, ideal, triangulate.linear(matrices, ideal), sd_px=1.0)
    uv, _ = seen_from(matrices, xyz_m.reshape(-1, 3))
    miss = ideal - uv.reshape(ideal.shape)
    n = np.isfinite(miss[..., 0]).sum(axis=0)
    # rays that are another marker's are no errors of dots
    fits = np.nan_to_num(miss**2).sum(axis=(0, 3)) < 16 * sd_px**2 * np.maximum(2 * n - 3, 1)
    miss = np.where(fits[..., None], miss, np.nan)
    dof = np.where(fits & (n >= 2), 2 * n - 3, 0).sum(axis=0)
    squares = np.nansum(miss**2, axis=(0, 1, 3))
    mean = squares.sum() / max(dof.sum(), 1) if dof.sum() else sd_px**2
    variance = (squares + _PRIOR_COUNTS * mean) / (dof + _PRIOR_COUNTS)
    of_three = np.where((n >= 3)[..., None], miss, np.nan)
    both = np.isfinite(of_three[:, 1:]) & np.isfinite(of_three[:, :-1])
    a, b = of_three[:, 1:][both], of_three[:, :-1][both]
    lasting = float(np.sum(a * b) / max(np.sqrt(np.sum(a**2) * np.sum(b**2)), 1e-12)) if len(a) else 0.0
    return RayErrors(
        sd_px=sd_px, variance=variance / sd_px**2, lasting=np.full(len(variance), np.clip(lasting, 0.0, 1.0))
    )


def lasting_covariance(
    errors: RayErrors, jacobian: Array, sd_px: Array, cov_m2: Array, *, shared: float = SHARED
) -> Array:
    """Covariances (M, 3, 3) of positions when errors of dots last, differ, and are shared.

    A filter that takes errors to be new in each frame averages them. Of errors of which a share r lasts as long as it
    averages, the covariance is (1 - r) of the filter's and r of that of the frame alone, (J^T J / sd^2)^-1; of these a
    share ``shared`` is the same in all images, and stays that of one ray however many there are.

    Args:
        errors: What is known of them.
        jacobian: (C, M, 2, 3) of the pixels of rays that were used; 0 for others.
        sd_px: (C, M) standard deviations that they were weighted with.
        cov_m2: (M, 3, 3) covariances of the filter.
        shared: Share of the lasting variance that all images have in common.
    """
    heavy = jacobian / np.where(sd_px > 0, sd_px, 1.0)[..., None, None] ** 2
    information = np.einsum("cmij,cmik->mjk", heavy, jacobian)
    # what rays do not determine is not worse than ten times what the filter says
    alone = np.linalg.inv(information + np.linalg.inv(100 * cov_m2))
    coordinates = 2 * (jacobian != 0).any(axis=(2, 3)).sum(axis=0)
    one = coordinates / np.maximum(np.trace(information, axis1=1, axis2=2), 1e-12)
    lasting = errors.lasting[:, None, None]
    alike = (1 - shared) * alone + shared * one[:, None, None] * np.eye(3)
    return errors.variance[:, None, None] * ((1 - lasting) * cov_m2 + lasting * alike)
