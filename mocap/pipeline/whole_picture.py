"""Pixels in the coordinates of the calibration: of the whole picture, and counted from the same first pixel."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eal.arrays import Array
from mocap.cameras import triangulate
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.errors import FormatError, MocapError
from mocap.io.contents import FileContents
from mocap.io.crop import crops_beside, crops_of, matched
from mocap.io.head import head
from mocap.records import PixelTracks

if TYPE_CHECKING:
    from mocap.pipeline.recording import Recording

FROM_ZERO = ("deeplabcut-csv", "deeplabcut-h5")
"""Formats whose first pixel has its centre at (0, 0)."""
FROM_ONE = ("easyWandData", "camud")
"""Variables of MATLAB programs' calibrations (easyWand, DLTdv): the first pixel has its centre at (1, 1)."""


def counted_from_one(source: "Recording", pixels: PixelTracks) -> tuple[PixelTracks, tuple[str, ...]]:
    """Pixels of DeepLabCut, which counts from 0, as a calibration by MATLAB programs counts them: from 1.

    No residual shows this, as all cameras are shifted alike: the points are off by one pixel's width, all the same way.
    Left alone where the calibration does not tell which program's pixels it was made of.

    Args:
        source: The recording.
        pixels: As in its files.

    Returns:
        The pixels, and a sentence on what was done.
    """
    files = [path for path in (source.calibration, source.profile) if path is not None]
    made = [path.name for path in files if path.suffix.lower() == ".mat" and head(path).mat & set(FROM_ONE)]
    if source.contents.format not in FROM_ZERO or not made:
        return pixels, ()
    return replace(pixels, uv_px=pixels.uv_px + 1.0), (
        f"DeepLabCut counts pixels from 0, the calibration ({made[0]}) from 1: 1 px was added to both coordinates",
    )


def in_whole_picture(
    source: "Recording", pixels: PixelTracks, cameras: Sequence[Camera]
) -> tuple[PixelTracks, tuple[str, ...]]:
    """Pixels of cropped films in the whole picture: with the crop offsets that are given, or lie beside the tracks.

    Offsets that the user gives are added; those that merely lie there only if rays then meet better.

    Args:
        source: The recording.
        pixels: As in its files.
        cameras: Of the whole pictures.

    Returns:
        The pixels, and a sentence on what was done.

    Raises:
        FormatError: the offsets cannot be read, or are not those of these cameras and frames.
        MocapError: rows are counted from the lower left, while offsets are of the upper left corner.
    """
    beside = () if source.crop else tuple(crops_beside((source.tracks, *source.views)))
    files = source.crop or beside
    if not files:
        return pixels, ()
    views = _view_names(source, pixels)
    crops = crops_of(files)
    offsets = matched(crops, views)
    if offsets is None and not beside and len(source.crop) == len(views) == len(crops):
        offsets = list(crops.values())  # one a camera, in their order
    if offsets is None:
        if beside:
            return pixels, ()
        raise FormatError(
            f"crop offsets of {', '.join(crops)} do not name the cameras {', '.join(names[0] for names in views)}: "
            "give a file for each camera, in their order, or name the files as the cameras"
        )
    where = ", ".join(path.name for path in files)
    if source.pixel_origin == "lower-left":
        raise MocapError(f"{where}: crop offsets are of the upper left corner: `origin` must be upper-left")
    shifted = replace(pixels, uv_px=_added(source, pixels, offsets))
    before, after = (_typical_residual(cameras, tracks.uv_px) for tracks in (pixels, shifted))
    result = f"the median triangulation residual is {after:.2f} px with them, {before:.2f} px without"
    if beside and not after < before:
        return pixels, (f"crop offsets beside the tracks ({where}) were not added: {result}",)
    moving = sum(len(offset) > 1 for offset in offsets)
    how = "a window that moves" if moving else "constant"
    return shifted, (f"crop offsets ({where}; {how}) were added to the pixels: {result}",)


def uncropped(source: "Recording") -> FileContents:
    """What a recording's files hold, with the crop offsets that are given added to the pixels.

    Args:
        source: The recording, with its calibration among its files.

    Raises:
        MocapError: there are no pixels or no calibration, or as for ``in_whole_picture``.
    """
    contents = source.contents
    if contents.pixels is None or not contents.cameras:
        raise MocapError("`crop`: crop offsets are added to pixels of calibrated cameras: give both")
    pixels, told = in_whole_picture(source, contents.pixels, contents.cameras)
    return replace(contents, pixels=pixels, findings=(*contents.findings, *told))


def _typical_residual(cameras: Sequence[Camera], uv_px: Array) -> float:
    """Median triangulation residual, rows counted from the upper left; inf where no point is seen twice."""
    ideal = undistorted(cameras, uv_px)
    residual = triangulate.residual_px(stacked(cameras), ideal, triangulate.linear(stacked(cameras), ideal))
    return float(np.nanmedian(residual)) if np.isfinite(residual).any() else np.inf


def _view_names(source: "Recording", pixels: PixelTracks) -> list[tuple[str, ...]]:
    """Words by which each view may be known: the stem of its file where it has one of its own, and its camera."""
    paths = [path.stem for path in source.contents.paths[: len(pixels.cameras)]] if source.views else []
    paths = paths if len(paths) == len(pixels.cameras) else [""] * len(pixels.cameras)
    return [(path, camera) if path else (camera,) for path, camera in zip(paths, pixels.cameras, strict=True)]


def _added(source: "Recording", pixels: PixelTracks, offsets: Sequence[Array]) -> Array:
    """(C, T, M, 2) pixels plus the offsets of their frames; row n of moving offsets is that of the film's frame n.

    Raises:
        FormatError: offsets end before the recording does.
    """
    contents = source.contents
    row = np.rint(pixels.t_s * (contents.fps or 1.0)).astype(np.int64)
    late = contents.tables.get("offset_frames", np.zeros((len(row), len(offsets))))
    out = pixels.uv_px.copy()
    for camera, offset in enumerate(offsets):
        at = row + np.rint(np.nan_to_num(late[:, camera])).astype(np.int64) if len(offset) > 1 else 0 * row
        seen = pixels.seen[camera].any(axis=1)
        if seen.any() and (at[seen].max() >= len(offset) or at[seen].min() < 0):
            raise FormatError(
                f"crop offsets of camera {pixels.cameras[camera]!r} have {len(offset)} rows, but it is seen in its "
                f"frame {at[seen].max() + 1}: give the offsets of this film, a row a frame"
            )
        out[camera] += offset[np.clip(at, 0, len(offset) - 1), None]
    return out
