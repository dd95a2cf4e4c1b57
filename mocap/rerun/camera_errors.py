"""How far each camera's pixels are from the filter's estimate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.pipeline.recording import Recording


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraErrors:
    """How far each camera's pixels are from what the filter says, root mean squares over the markers of a frame.

    Attributes:
        cameras: The C camera names.
        innovation_px: (C, T) before the update; NaN where a camera saw nothing.
        residual_px: (C, T) after smoothing.
    """

    cameras: tuple[str, ...]
    innovation_px: Array
    residual_px: Array


def camera_errors(run: Recording) -> CameraErrors:
    """The errors of the samples in use."""
    return CameraErrors(
        cameras=run.camera_names,
        innovation_px=rms_px(run.innovation_px, run.used),
        residual_px=rms_px(run.ideal_px - run.reprojected_px, run.used),
    )


def rms_px(differences_px: Array, used: NDArray[np.bool_]) -> Array:
    """Root mean square length of the differences in each camera and frame.

    Args:
        differences_px: (C, T, M, 2) differences; NaN where there is none.
        used: (C, T, M) those that count.

    Returns:
        (C, T) pixels; NaN where a camera saw nothing.
    """
    square = np.einsum("...i,...i->...", differences_px, differences_px)
    there = used & np.isfinite(square)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt(np.where(there, square, 0.0).sum(axis=-1) / there.sum(axis=-1))


def usual_limit(values: Array) -> float:
    """The end of a scale that 99 % of the numbers stay below; 1 where there are none."""
    known = values[np.isfinite(values)]
    return max(float(np.quantile(known, 0.99)), 1e-9) if known.size else 1.0
