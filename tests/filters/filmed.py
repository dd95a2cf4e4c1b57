"""Markers filmed by a ring of cameras, as a tracker takes them."""

import numpy as np
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import PixelObservations

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear, refine
from tests.mocap.rigs import cloud, ring


def pixels(rng, *, n_cameras=3, n_frames=4, n_markers=5, sd=0.5, wide_m=0.2, still=False):
    """A rig's pixels of markers, as the tracker takes them."""
    matrices = stacked(ring(n_cameras))
    count = 1 if still else n_frames
    xyz = np.broadcast_to(cloud(rng, count * n_markers).reshape(count, n_markers, 3), (n_frames, n_markers, 3))
    uv = project(matrices, xyz) + rng.normal(0, sd, (n_cameras, n_frames, n_markers, 2))
    sds = rng.uniform(0.9, 1.1, uv.shape[:3]) * sd
    points, cov = refine(matrices, uv, linear(matrices, uv), sd_px=sds)
    seen = PixelObservations(matrices=matrices, uv_px=uv, sd_px=sds, xyz_m=points, cov_m2=cov, wide_m=wide_m)
    return seen, xyz


def hide(seen, mask):
    """The same observations without some rays; points follow from those that are left."""
    uv = np.where(mask[..., None], np.nan, seen.uv_px)
    points, cov = refine(seen.matrices, uv, linear(seen.matrices, uv), sd_px=seen.sd_px)
    return PixelObservations(
        matrices=seen.matrices, uv_px=uv, sd_px=seen.sd_px, xyz_m=points, cov_m2=cov, wide_m=seen.wide_m
    )


def still(seen, **more):
    """Markers that hardly move, known to a few millimetres."""
    start = np.nan_to_num(seen.xyz_m[0])
    options = {"start_sd_m": 0.01, "speed_sd_m_s": 0.01, "density": np.full(start.shape[0], 1e-3)} | more
    return ConstantVelocity(start_m=start, **options)
