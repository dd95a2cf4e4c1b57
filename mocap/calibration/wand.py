"""A rig from a wand of known length moved through the volume, and background points if there are any."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.calibration.bundle import adjust, camera_rms
from mocap.calibration.chain import first_stands, rigid
from mocap.calibration.scene import (
    CLICK_PX,
    Adjusted,
    Free,
    KnownLengths,
    RigCamera,
    RigScene,
    Sightings,
    distinct,
    in_world,
    point_scene,
)
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.cameras.lens import Lens
from mocap.cameras.triangulate import linear
from mocap.errors import CalibrationError

FEWEST_WANDS = 10  # two points each: more than ``FEWEST_SHARED``; chosen
MOVES = ("none", "focal", "focal+centre", "lens")
"""What of a lens may move: nothing, its focal length, the principal point too, the first two distortion terms too."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WandCalibration:
    """A rig calibrated with a wand.

    Attributes:
        cameras: The C cameras; the world's origin is the median of the wand's ends, its axes are those of the first
            camera (x right, y down, z forward).
        wands: Number of instants at which the wand was used.
        score: 100 x standard deviation / mean of the wand's length, by linear triangulation (easyWand's wandScore).
        held_out_score: The same on instants that the fit did not see.
        camera_px: (C,) root mean square error of each camera.
        median_px: Median error.
        believed: Share of the sightings believed by more than half.
        good_wands: Instants at which all sightings of the wand, and its length, were believed by more than a tenth.
        good_score: The score on these.
        good_held_out_score: The held-out score on these.
        f_sd_px: (C,) standard deviations of focal lengths; 0 where held.
    """

    cameras: tuple[RigCamera, ...]
    wands: int
    score: float
    held_out_score: float
    camera_px: tuple[float, ...]
    median_px: float
    believed: float
    good_wands: int
    good_score: float
    good_held_out_score: float
    f_sd_px: Array


def calibrate_wand(
    lenses: Sequence[Lens],
    sizes_px: Sequence[tuple[int, int] | None],
    wand_px: Array,
    background_px: Array,
    *,
    length_m: float,
    moves: str = "focal",
    folds: int = 8,
) -> WandCalibration:
    """Calibrate by a wand.

    Args:
        lenses: Of the C cameras, at least roughly known.
        sizes_px: Their image sizes.
        wand_px: (C, T, 2, 2) recorded pixels of its two ends, origin upper-left; NaN where not seen.
        background_px: (C, N, B, 2) recorded pixels of other points that several cameras saw at one instant.
        length_m: Distance of the wand's ends.
        moves: What of the lenses may move (``MOVES``).
        folds: Parts of the instants for the held-out score; 0 or 1: it is not computed (NaN).

    Raises:
        CalibrationError: too few wands, cameras without common points, or a result that cannot be.
    """
    names = [f"cam{i + 1}" for i in range(len(lenses))]
    if moves not in MOVES:
        raise CalibrationError(f"`free` {moves!r}: expected one of {', '.join(MOVES)}")
    sd = 1e-3 * length_m  # how well wands are measured
    pairs = np.moveaxis(wand_px, 2, 1).reshape(len(lenses), -1, 2)  # first ends, then second ends
    xy = np.stack([u.normalised(u.undistort(uv)) for u, uv in zip(lenses, pairs, strict=True)])
    whole = (np.isfinite(xy).all(axis=-1).sum(axis=0) >= 2).reshape(2, -1).all(axis=0)
    if np.count_nonzero(whole) < FEWEST_WANDS:
        raise CalibrationError(
            f"two cameras saw both ends of the wand at {np.count_nonzero(whole)} instants, and {FEWEST_WANDS} are "
            "needed: record more of it, moved through the whole volume"
        )

    at = np.flatnonzero(whole)
    used_px = wand_px[:, at]
    place = distinct(np.moveaxis(used_px, 1, 0).reshape(len(at), -1), within=CLICK_PX)
    if place.max() + 1 < FEWEST_WANDS:
        raise CalibrationError(
            f"the wand was in {place.max() + 1} different places at {len(at)} instants, and {FEWEST_WANDS} are needed: "
            "move it through the whole volume"
        )
    points_px = np.concatenate(
        [used_px[:, :, 0], used_px[:, :, 1], background_px.reshape(len(lenses), -1, 2)], axis=1
    )  # (C, P, 2)
    T, points = first_stands(
        np.stack([u.normalised(u.undistort(uv)) for u, uv in zip(lenses, points_px, strict=True)]),
        names,
        [u.f_px[0] for u in lenses],
    )
    scale = length_m / np.nanmedian(np.linalg.norm(points[: len(at)] - points[len(at) : 2 * len(at)], axis=-1))
    start = tuple(
        RigCamera(name=name, lens=lens, rotation=t[:3, :3], translation_m=scale * t[:3, 3], size_px=size)
        for name, lens, t, size in zip(names, lenses, T, sizes_px, strict=True)
    )
    free = Free(
        focal="none" if moves == "none" else "one",
        centre=moves in ("focal+centre", "lens"),
        coefficients=tuple(tuple(moves == "lens" and i < 2 for i in range(u.n_coefficients)) for u in lenses),
    )

    def solve(used: NDArray[np.bool_]) -> tuple[Adjusted, Sightings]:
        keep = np.isfinite(points[:, 0])
        keep[: 2 * len(at)] &= np.tile(used, 2)
        return _solve(start, scale * points, points_px, keep, len(at), length_m, sd, free)

    adjusted, sightings = solve(np.ones(len(at), dtype=bool))
    cameras = adjusted.scene.cameras
    held_out = np.full(len(at), np.nan)
    for fold in range(folds if folds > 1 else 0):
        out = place % folds == fold  # a wand that lies still is left out whole
        held_out[out] = wand_lengths([c.camera() for c in solve(~out)[0].scene.cameras], used_px[:, out])
    lengths = wand_lengths([c.camera() for c in cameras], used_px)
    least = np.ones(2 * len(at))
    ends = sightings.body < 2 * len(at)  # all wands were kept: the first bodies are their ends
    np.minimum.at(least, sightings.body[ends], adjusted.weight[ends])
    good = np.minimum(least.reshape(2, -1).min(axis=0), adjusted.length_weight) > 0.1
    result = WandCalibration(
        cameras=cameras,
        wands=len(at),
        score=wand_score(lengths),
        held_out_score=wand_score(held_out),
        camera_px=tuple(camera_rms(adjusted, sightings, len(cameras))),
        median_px=float(np.median(np.hypot(*adjusted.error_px.T))),
        believed=float(np.mean(adjusted.weight > 0.5)),
        good_wands=int(good.sum()),
        good_score=wand_score(lengths[good]),
        good_held_out_score=wand_score(held_out[good]),
        f_sd_px=adjusted.f_sd_px,
    )
    _refuse(result, lenses, names)
    return result


def wand_lengths(cameras: Sequence[Camera], wand_px: Array) -> Array:
    """(T,) distances of the wand's ends by linear triangulation (DLT); NaN where an end is seen by fewer than two."""
    ends = linear(stacked(cameras), undistorted(cameras, wand_px))
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1)


def wand_score(length: Array) -> float:
    """The score of easyWand: 100 x standard deviation / mean of the (T,) lengths of the wand, NaN left out.

    NaN where fewer than two are left.
    """
    length = length[np.isfinite(length)]
    return float(100 * length.std(ddof=1) / length.mean()) if len(length) > 1 else float("nan")


def _solve(
    start: tuple[RigCamera, ...],
    points_m: Array,
    points_px: Array,
    keep: NDArray[np.bool_],
    wands: int,
    length_m: float,
    sd_m: float,
    free: Free,
) -> tuple[Adjusted, Sightings]:
    """Bundle adjustment of the points kept, in the frame that ``WandCalibration`` states."""
    scene, sightings, number = point_scene(start, points_m, points_px, keep)
    both = np.flatnonzero(keep[:wands] & keep[wands : 2 * wands])
    wand_lengths = KnownLengths(
        first=number[both],
        second=number[both + wands],
        length_m=np.full(len(both), length_m),
        sd_m=np.full(len(both), sd_m),
    )
    adjusted = adjust(scene, sightings, free=free, lengths=wand_lengths)
    first = adjusted.scene.cameras[0]
    middle = np.median(adjusted.scene.position_m[: 2 * len(both)], axis=0)
    T_world = rigid(first.rotation, -first.rotation @ middle)
    moved = RigScene(
        cameras=in_world(adjusted.scene.cameras, T_world),
        rotation=adjusted.scene.rotation,
        position_m=(adjusted.scene.position_m - middle) @ first.rotation.T,
    )
    return replace(adjusted, scene=moved), sightings


def _refuse(result: WandCalibration, lenses: Sequence[Lens], names: Sequence[str]) -> None:
    """What no wand calibration of real cameras is.

    Raises:
        CalibrationError: a focal length far from the stated one or left open, or a wand whose length is not constant.
    """
    for camera, lens, sd, name in zip(result.cameras, lenses, result.f_sd_px, names, strict=True):
        ratio = camera.lens.f_px[0] / lens.f_px[0]
        if not 0.7 < ratio < 1.4:  # these three limits are chosen, not measured
            raise CalibrationError(
                f"camera {name!r}: the focal length went from {lens.f_px[0]:.0f} to {camera.lens.f_px[0]:.0f} px: "
                "check its lens, or keep it fixed with `free` none"
            )
        if sd > 0.1 * camera.lens.f_px[0]:
            raise CalibrationError(
                f"camera {name!r}: the wand does not determine its focal length ({camera.lens.f_px[0]:.0f} +- "
                f"{sd:.0f} px): keep it fixed with `free` none, or move the wand nearer and farther"
            )
    if not result.good_score < 10:
        raise CalibrationError(
            f"the wand's length varies by {result.good_score:.0f} % of its mean: check that the two ends are the same "
            "markers in all cameras, and that the cameras were synchronised"
        )
