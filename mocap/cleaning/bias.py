"""Slowly varying pixel errors, which do not average out: the residual of a camera and marker keeps its sign for long.

Errors of lens and calibration reach several pixels where a digitiser's jitter is half a pixel. Treated as white noise
such errors make a smoothed track too confident, and let it jump when a camera loses the marker. With the eight rounds
below such a jump shrinks by about a quarter, with 128 by half: an error common to all rays of a point stays.
"""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import project
from mocap.cameras.triangulate import linear, pixel_sd, refine, residual_px
from mocap.filters.whittaker import smoother


@dataclass(frozen=True, eq=False, kw_only=True)
class RayBias:
    """Slowly varying error of every observation (camera, frame, marker).

    Attributes:
        bias_px: (C, T, M, 2) to subtract from ideal pixels; 0 where nothing is known or nothing was found.
        sd_px: Standard deviation of the bias over all rays but those of cameras that went bad; 0 where none was found.
        jitter_px: Standard deviation of a pixel coordinate once the bias is subtracted.
    """

    bias_px: Array
    sd_px: float
    jitter_px: float


def ray_bias(
    matrices: Array,
    uv_px: Array,
    *,
    dt_s: float,
    iterations: int = 8,
    relative: Array | None = None,
) -> RayBias:
    """Slowly varying pixel errors, estimated from the residuals of triangulation.

    Alternates between points (least squares on corrected pixels) and biases (residuals of each camera and marker,
    smoothed over time): the minimum of sum |uv - project(x) - b|^2 + penalty on the second difference of b, in which a
    point may move freely but a bias may not jump. An error common to all rays of a point is not observable and stays
    in the point. Found only if the smoothed residuals exceed three times the variance that white noise would leave.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels without rays that miss; NaN where not seen.
        dt_s: Time step.
        iterations: Rounds.
        relative: (C, T, M) deviations of rays, relative to a usual one's; None: 1.
    """
    cutoff_hz = min(8.0, 0.05 / dt_s)  # faster errors count as jitter
    seen = np.isfinite(uv_px[..., 0])
    count = seen.sum(axis=0)
    none = np.zeros_like(uv_px)
    spread = np.ones(seen.shape) if relative is None else relative
    xyz = linear(matrices, uv_px, relative=spread)
    total = pixel_sd(residual_px(matrices, uv_px, xyz, relative=spread), count)
    if len(xyz) < 3:
        return RayBias(bias_px=none, sd_px=0.0, jitter_px=total)
    redundant = count >= 2
    weight = np.where(seen & redundant, 1 / spread**2, 0.0).swapaxes(1, 2)  # (C, M, T)
    many = np.count_nonzero(weight, axis=-1) >= 3
    smooth = smoother(weight[many], dt_s=dt_s, cutoff_hz=cutoff_hz) if many.any() else None
    bias = none
    for _ in range(iterations):
        corrected = uv_px - bias
        xyz, _ = refine(matrices, corrected, linear(matrices, corrected, relative=spread), sd_px=spread, iterations=3)
        if smooth is None:
            break
        residual = np.nan_to_num(np.swapaxes(uv_px - project(matrices, xyz), 1, 2))  # (C, M, T, 2)
        slow = np.zeros_like(residual)
        slow[many] = smooth(residual[many])
        bias = np.where(seen[..., None], slow.swapaxes(1, 2), 0.0)
    corrected = uv_px - bias
    good = seen & redundant & (spread <= 1.0)  # a camera that went bad is no measure of the others
    if (good.sum(axis=0) >= 2).any():
        corrected, count = np.where(good[..., None], corrected, np.nan), good.sum(axis=0)
    else:
        good = seen & redundant
    jitter = pixel_sd(residual_px(matrices, corrected, linear(matrices, corrected)), count)
    sd = float(np.sqrt(np.mean(bias[good] ** 2)))
    white = jitter**2 * 2 * cutoff_hz * dt_s  # variance of white noise after a low pass of that cutoff
    if sd**2 < 3 * white:
        return RayBias(bias_px=none, sd_px=0.0, jitter_px=total)
    return RayBias(bias_px=bias, sd_px=sd, jitter_px=jitter)


def lasting_bias(bias_px: Array, uv_px: Array) -> Array:
    """(C, T, M, 2) slow errors of each camera and marker in all frames: between those that it saw, interpolated.

    Args:
        bias_px: (C, T, M, 2) ``RayBias.bias_px``.
        uv_px: (C, T, M, 2) what it was estimated from; NaN where not seen.
    """
    out = np.zeros_like(bias_px)
    every = np.arange(bias_px.shape[1])
    for camera, marker in np.ndindex(bias_px.shape[0], bias_px.shape[2]):
        seen = np.flatnonzero(np.isfinite(uv_px[camera, :, marker, 0]))
        for axis in range(2 if len(seen) else 0):
            out[camera, :, marker, axis] = np.interp(every, seen, bias_px[camera, seen, marker, axis])
    return out
