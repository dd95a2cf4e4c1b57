"""Pixels in the coordinates of the calibration: of the whole image, and counted from the same first pixel."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.cameras.triangulate import median_miss
from mocap.errors import FormatError, MocapError
from mocap.io.contents import FileContents
from mocap.io.crop import crops_beside, crops_of, matched
from mocap.io.format import head
from mocap.records import PixelCorner, PixelTracks

FROM_ZERO = ("deeplabcut-csv", "deeplabcut-h5")
"""Formats whose first pixel has its centre at (0, 0)."""
FROM_ONE = ("easyWandData", "camud")
"""Variables of MATLAB programs' calibrations (easyWand, DLTdv): the first pixel has its centre at (1, 1)."""


def counted_from_one(contents: FileContents, made_with: Sequence[Path]) -> tuple[FileContents, tuple[str, ...]]:
    """Pixels of DeepLabCut, which counts from 0, as a calibration by MATLAB programs counts them: from 1.

    No residual shows this, as all cameras are shifted alike: the points are off by one pixel's width, all the same way.
    Left alone where the calibration does not tell which program's pixels it was made of.

    Args:
        contents: Pixels as in their files.
        made_with: The files of the calibration.

    Returns:
        The pixels, and a sentence on what was done.
    """
    made = [path.name for path in made_with if path.suffix.lower() == ".mat" and head(path).mat & set(FROM_ONE)]
    if contents.pixels is None or contents.format not in FROM_ZERO or not made:
        return contents, ()
    pixels = replace(contents.pixels, uv_px=contents.pixels.uv_px + 1.0)
    return replace(contents, pixels=pixels), (
        f"DeepLabCut counts pixels from 0, the calibration ({made[0]}) from 1: 1 px was added to both coordinates",
    )


def in_whole_picture(
    contents: FileContents,
    cameras: Sequence[Camera],
    tracks: Sequence[Path],
    given: Sequence[Path],
    *,
    pixel_origin: PixelCorner | None,
) -> tuple[FileContents, tuple[str, ...]]:
    """Pixels of cropped videos in the whole image: with the crop offsets that are given, or lie beside the tracks.

    Offsets that the user gives are added; those that merely lie there only if rays then meet better.

    Args:
        contents: Pixels as in their files.
        cameras: Of the whole images.
        tracks: The files of the pixels; several: a camera each.
        given: Files or folders with crop offsets; empty: those beside the tracks, if any.
        pixel_origin: Where pixel rows are counted from, as the user states it.

    Returns:
        The pixels, and a sentence on what was done.

    Raises:
        FormatError: the offsets cannot be read, or are not those of these cameras and frames.
        MocapError: there is no calibration, or rows are counted from the lower left, while offsets are of the upper
            left corner.
    """
    pixels = contents.pixels
    if pixels is None or not cameras:
        raise MocapError("`crop`: crop offsets are added to pixels of calibrated cameras: give both, or leave it out")
    beside = () if given else tuple(crops_beside(tracks))
    files = given or beside
    if not files:
        return contents, ()
    stems = [path.stem for path in contents.paths[: len(cameras)]] if len(tracks) > 1 else []
    stems = stems if len(stems) == len(cameras) else [""] * len(cameras)
    views = [(stem, camera) if stem else (camera,) for stem, camera in zip(stems, pixels.cameras, strict=True)]
    crops = crops_of(files)
    offsets = matched(crops, views)
    if offsets is None and not beside and len(given) == len(views) == len(crops):
        offsets = list(crops.values())  # one a camera, in their order
    if offsets is None:
        if beside:
            return contents, ()
        raise FormatError(
            f"crop offsets of {', '.join(crops)} do not name the cameras {', '.join(names[0] for names in views)}: "
            "give a file for each camera, in their order, or name the files as the cameras"
        )
    where = ", ".join(path.name for path in files)
    if pixel_origin == "lower-left":
        raise MocapError(f"{where}: crop offsets are of the upper left corner: `origin` must be upper-left")
    shifted = replace(pixels, uv_px=_added(contents, pixels, offsets))
    before, after = (median_miss(stacked(cameras), undistorted(cameras, some.uv_px)) for some in (pixels, shifted))
    result = f"the median triangulation residual is {after:.2f} px with them, {before:.2f} px without"
    if not np.isfinite([before, after]).all():
        result = "no marker is seen by two cameras, whose residual would tell whether they belong to these films"
        result += "; give `crop` if they do" if beside else ""
    if beside and not after < before:
        return contents, (f"crop offsets beside the tracks ({where}) were not added: {result}",)
    moving = sum(len(offset) > 1 for offset in offsets)
    how = "a window that moves" if moving else "constant"
    return replace(contents, pixels=shifted), (f"crop offsets ({where}; {how}) were added to the pixels: {result}",)


def _added(contents: FileContents, pixels: PixelTracks, offsets: Sequence[Array]) -> Array:
    """(C, T, M, 2) pixels plus the offsets of their frames; row n of moving offsets is that of the video's frame n.

    Raises:
        FormatError: offsets end before the recording does.
    """
    row = np.rint(pixels.t_s * (contents.fps or 1.0)).astype(np.int64)
    late = contents.tables.get("offset_frames", np.zeros((len(row), len(offsets))))
    out = pixels.uv_px.copy()
    for camera, offset in enumerate(offsets):
        at = row + np.rint(np.nan_to_num(late[:, camera])).astype(np.int64) if len(offset) > 1 else 0 * row
        seen = pixels.seen[camera].any(axis=1)
        if seen.any() and (at[seen].max() >= len(offset) or at[seen].min() < 0):
            raise FormatError(
                f"crop offsets of camera {pixels.cameras[camera]!r} have {len(offset)} rows, but it is seen in its "
                f"frame {at[seen].max() + 1}: give the offsets of this video, one row per frame"
            )
        out[camera] += offset[np.clip(at, 0, len(offset) - 1), None]
    return out
