"""A tracked recording as files of the programs whose key points it was made of, and of neuroscience's archives."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, flipped, stacked
from mocap.cameras.triangulate import linearise
from mocap.errors import MocapError
from mocap.io.contents import FileContents
from mocap.io.registry import by_name, write
from mocap.records import PixelTracks
from mocap.tracking.result import Result

KEYPOINTS = {
    "deeplabcut": {"deeplabcut-h5": "markers.dlc.h5", "deeplabcut-csv": "markers.dlc.csv"},
    "sleap": {"sleap-analysis": "markers.analysis.h5", "sleap-anipose-3d": "markers.points3d.h5"},
    "nwb": {"nwb": "markers.nwb"},
}
"""Formats and files of each program; pixels have a file a camera, with its name before the ending."""
NEAR_PX = 17.0
"""What DeepLabCut's likelihood is the probability of: that the point is so near (its ``pos_dist_thresh``)."""


def write_keypoints(run: Result, files: Mapping[str, str], folder: Path) -> None:
    """Write positions, and what each camera would show of them, with all filled samples.

    Raises:
        MocapError: a package that writes the format is missing, or the height of the image is not known where
            pixels are counted from below.
    """
    run.in_space("an export of key points")
    whole = contents_of(run)
    for name, file in files.items():
        format = by_name(name)
        if "points" in format.holds:
            write(whole, folder / file, name, filled=True)
        if "pixels" in format.holds and run.cameras and not format.both:
            write(replace(whole, points=None), folder / file, name)


def contents_of(run: Result) -> FileContents:
    """A tracked recording as the contents of a file: positions, and pixels with likelihoods where there are cameras.

    The likelihood of a sample is the probability that its true pixel is at most ``NEAR_PX`` away, by the standard
    deviation s of its projection: 1 - exp(-NEAR_PX^2 / (2 s^2)), with 2 s^2 the trace of J P J^T, P the position's
    covariance and J the slope of the projection (exact for a round covariance).

    Raises:
        MocapError: the height of the image is not known where pixels are counted from below.
    """
    markers, cameras = run.tracks, run.cameras
    pixels, score = None, None
    if cameras:
        uv, variance = _projected(run)
        pixels = PixelTracks(names=markers.names, cameras=tuple(c.name for c in cameras), t_s=markers.t_s, uv_px=uv)
        with np.errstate(divide="ignore"):
            score = np.where(pixels.seen, -np.expm1(-(NEAR_PX**2) / variance), np.nan)
    fps = run.report.get("fps")
    return FileContents(
        format="eal-mocap",
        paths=(Path(run.name),),
        names=markers.names,
        frames=1 + np.arange(len(markers.t_s)),
        fps=float(fps) if isinstance(fps, float | int) else None,
        unit="m",
        points=markers,
        pixels=pixels,
        camera_names=tuple(c.name for c in cameras),
        cameras=cameras,
        pixel_origin="upper-left" if cameras else None,
        score=score,
    )


def _projected(run: Result) -> tuple[Array, Array]:
    """(C, T, M, 2) pixels as cameras record them, from the upper left, and (C, T, M) traces of their covariances."""
    markers, cameras = run.tracks, run.cameras
    shape = (len(cameras), *markers.status.shape)
    xyz = markers.xyz_m.reshape(-1, 3)
    ideal = run.reprojected_px
    slope = linearise(stacked(cameras), ideal.reshape(len(cameras), -1, 2), xyz).jacobian
    variance = np.einsum("ckij,kjl,ckil->ck", slope, markers.cov_m2.reshape(-1, 3, 3), slope).reshape(shape)
    recorded = [_recorded(camera, uv, y_up=run.y_up) for camera, uv in zip(cameras, ideal, strict=True)]
    return np.stack(recorded), variance


def _recorded(camera: Camera, uv: Array, *, y_up: bool) -> Array:
    """Ideal pixels as the camera records them, from the upper left."""
    if y_up and camera.size_px is None:
        raise MocapError(
            f"camera {camera.name} counts pixels from the lower left and the height of its image is not known: track "
            "with a camera profile (--profile), or with --video"
        )
    uv = flipped(uv, float(camera.size_px[1])) if y_up and camera.size_px else uv
    return uv if camera.lens is None else camera.lens.distort(uv)
