"""Self-calibration: camera poses refined until the rays of the markers intersect; known lengths keep the scale."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.calibration.bundle import adjust
from mocap.calibration.scene import (
    CLICK_PX,
    Free,
    KnownLengths,
    distinct,
    in_world,
    point_scene,
    rig_camera,
    similarity,
    turned_rad,
)
from mocap.cameras.camera import Camera, stacked
from mocap.cameras.triangulate import linear, misses, robust
from mocap.errors import CalibrationError
from mocap.text import number_of

FEWEST_REFINED = 30  # of two cameras one equation a point is left; chosen


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownDistance:
    """Two markers at a known distance: the ends of a wand, or of a bone.

    Attributes:
        first: Number of a marker.
        second: Number of another.
        length_m: Their distance; None: what the present calibration says (the median), which keeps its scale.
    """

    first: int
    second: int
    length_m: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Refined:
    """A refined rig.

    Attributes:
        cameras: The cameras, for ideal pixels as before; their lenses are those given.
        before_px: Median residual of held-out points with the cameras given.
        after_px: The same with cameras refined on the other points.
        moved_m: (C,) how far each camera moved.
        turned_rad: (C,) how far it turned.
        f_ratio: (C,) focal length over the old one.
        length_ratio: (bones) median length over the wanted one, with the refined cameras.
        points: Number of points used.
    """

    cameras: tuple[Camera, ...]
    before_px: float
    after_px: float
    moved_m: Array
    turned_rad: Array
    f_ratio: Array
    length_ratio: Array
    points: int


def refine_cameras(
    cameras: Sequence[Camera],
    ideal_px: Array,
    *,
    bones: Sequence[KnownDistance] = (),
    focal: bool = False,
    most_points: int = 2000,
) -> Refined:
    """Refine poses (and focal lengths) from marker tracks.

    Points of two interleaved sets of poses are refined apart, each judged on the other's; the cameras returned are
    fitted to both. The world stays where it was, as the points tell it; its scale is that of the bones, else the old.

    Args:
        cameras: The C cameras.
        ideal_px: (C, T, M, 2) ideal (undistorted) pixels, in the convention of the cameras; NaN where not seen.
        bones: Known distances.
        focal: Whether focal lengths move too; only where bones or many directions hold them.
        most_points: Points to use, spread over the frames.

    Raises:
        CalibrationError: too few points, or held-out points fit worse with the refined cameras.
    """
    found = robust(stacked(cameras), ideal_px)
    ideal = np.where(found.rejected[..., None], np.nan, ideal_px)
    frames = np.flatnonzero(np.isfinite(found.xyz_m[..., 0]).any(axis=1))
    points = int(np.isfinite(found.xyz_m[..., 0]).sum())
    if points < FEWEST_REFINED:
        raise CalibrationError(
            f"{number_of(points, 'point is', 'points are')} seen by two cameras, and {FEWEST_REFINED} are "
            "needed: give more frames"
        )
    count = min(len(frames), max(2, most_points * len(frames) // points))
    keep = frames[np.linspace(0, len(frames) - 1, count).astype(int)]
    lengths = [_length(found.xyz_m, b) for b in bones]

    def solve(use: NDArray[np.intp]) -> tuple[Camera, ...]:
        return _solve(cameras, ideal[:, use], found.xyz_m[use], bones, lengths, focal)

    pose = distinct(np.moveaxis(ideal[:, keep], 1, 0).reshape(len(keep), -1), within=CLICK_PX)
    apart = int(np.isfinite(found.xyz_m[keep[np.unique(pose, return_index=True)[1]], :, 0]).sum())
    if apart < FEWEST_REFINED or not pose.any():
        raise CalibrationError(
            f"the markers hardly move: {apart} of {points} points are in different places, and {FEWEST_REFINED} are "
            "needed: give frames in which they move"
        )
    halves = [keep[pose % 2 == i] for i in (0, 1)]  # frames of one pose in one half
    after = np.concatenate([_misses(solve(a), ideal[:, b]) for a, b in (halves, halves[::-1])])
    before = _misses(cameras, ideal[:, keep])
    refined = solve(keep)
    if not np.median(after) < np.median(before):
        raise CalibrationError(
            f"refining does not help: the residual of held-out points is {np.median(after):.3f} px with refined "
            f"cameras and {np.median(before):.3f} px with the present ones: keep the present calibration"
        )
    old, new = ([rig_camera(replace(c, lens=None)) for c in rig] for rig in (cameras, refined))
    xyz = linear(stacked(refined), ideal[:, keep])
    return Refined(
        cameras=refined,
        before_px=float(np.median(before)),
        after_px=float(np.median(after)),
        moved_m=np.array([np.linalg.norm(a.position_m - b.position_m) for a, b in zip(old, new, strict=True)]),
        turned_rad=np.array([turned_rad(a.rotation.T @ b.rotation) for a, b in zip(old, new, strict=True)]),
        f_ratio=np.array([b.lens.f_px[0] / a.lens.f_px[0] for a, b in zip(old, new, strict=True)]),
        length_ratio=np.array([_length(xyz, b)[0] / w[0] for b, w in zip(bones, lengths, strict=True)]),
        points=int(np.isfinite(xyz[..., 0]).sum()),
    )


def _length(xyz_m: Array, bone: KnownDistance) -> tuple[float, float]:
    length = np.linalg.norm(xyz_m[:, bone.first] - xyz_m[:, bone.second], axis=-1)
    length = length[np.isfinite(length)]
    if not len(length):
        raise CalibrationError(f"markers {bone.first} and {bone.second} are never seen together: choose another bone")
    median = float(np.median(length))
    wanted = median if bone.length_m is None else bone.length_m
    return wanted, max(1.4826 * float(np.median(np.abs(length - median))), 1e-3 * wanted)


def _misses(cameras: Sequence[Camera], ideal: Array) -> Array:
    matrices = stacked([replace(c, lens=None) for c in cameras])
    return misses(matrices, ideal)


def _solve(
    cameras: Sequence[Camera],
    ideal: Array,
    xyz_m: Array,
    bones: Sequence[KnownDistance],
    lengths: Sequence[tuple[float, float]],
    focal: bool,
) -> tuple[Camera, ...]:
    finite = np.isfinite(xyz_m[..., 0])
    rig = [rig_camera(replace(c, lens=None)) for c in cameras]
    scene, sightings, number = point_scene(rig, xyz_m.reshape(-1, 3), ideal.reshape(len(ideal), -1, 2), finite.ravel())
    number = number.reshape(finite.shape)
    both = [np.flatnonzero(finite[:, b.first] & finite[:, b.second]) for b in bones]
    empty = [np.zeros(0, int)]
    fixed = KnownLengths(
        first=np.concatenate([number[t, b.first] for b, t in zip(bones, both, strict=True)] or empty),
        second=np.concatenate([number[t, b.second] for b, t in zip(bones, both, strict=True)] or empty),
        length_m=np.concatenate([np.full(len(t), w) for t, (w, _) in zip(both, lengths, strict=True)] or [np.zeros(0)]),
        sd_m=np.concatenate([np.full(len(t), s) for t, (_, s) in zip(both, lengths, strict=True)] or [np.ones(0)]),
    )
    free = Free(focal="one" if focal else "none", centre=False)
    adjusted = adjust(scene, sightings, free=free, lengths=fixed)
    places = adjusted.scene.position_m
    T = similarity(places, xyz_m[finite], scaled=not bones)
    if bones:  # soft lengths hold the shape; the scale is that of their medians, which bones that stretch do not pull
        apart = np.linalg.norm(places[fixed.first] - places[fixed.second], axis=-1)
        T = similarity(places * np.median(fixed.length_m / apart), xyz_m[finite], scaled=False)
        T[:3, :3] *= np.median(fixed.length_m / apart)
    moved = in_world(adjusted.scene.cameras, T)
    return tuple(replace(c, matrix=m.camera().matrix) for c, m in zip(cameras, moved, strict=True))
