"""Relative joint coordinates: the child of a joint as its centre sees it."""

import numpy as np

from eal.arrays import Array
from mocap.filters.body_axes import BodyFrames
from mocap.records import MarkerTracks
from mocap.skeleton import Skeleton

FRAMES = ("world", "body", "plane", "limb")
"""Frames of reference of ``joint_variables``."""


def joint_variables(tracks: MarkerTracks, skeleton: Skeleton, frames: BodyFrames) -> dict[str, Array]:
    """The child of every joint relative to its centre, in four frames of reference.

    - ``world``: axes of the world.
    - ``body``: axes of the trunk.
    - ``plane``: the mean plane of the limb in the body, across the mean normal of parent, centre and child; first axis
      the mean direction from parent to centre.
    - ``limb``: the plane of parent, centre and child at every instant, first axis from parent to centre: the paper's
      shoulder-elbow-wrist plane with the elbow at the origin. The second axis keeps its side while
      the plane turns, so that a joint that bends over its straight position changes sign.

    Args:
        tracks: Markers.
        skeleton: Joints; all their markers must be in the tracks.
        frames: Body frames of the same recording.

    Returns:
        Variables of a recording: ``joint_world``, ``joint_body`` (T, J, 3), ``joint_plane``, ``joint_limb`` (T, J, 2)
        in metres, and ``joint_sd`` (T, J), the root mean square standard deviation of a coordinate.
    """
    index = {name: i for i, name in enumerate(tracks.names)}
    triple = np.array([[index[j.parent], index[j.centre], index[j.child]] for j in skeleton.joints], dtype=int)
    triple = triple.reshape(-1, 3)
    child = tracks.xyz_m[:, triple[:, 2]] - tracks.xyz_m[:, triple[:, 1]]
    along = tracks.xyz_m[:, triple[:, 1]] - tracks.xyz_m[:, triple[:, 0]]
    sd = np.hypot(tracks.sd_m[:, triple[:, 2]], tracks.sd_m[:, triple[:, 1]])
    child_body = np.einsum("tji,tmj->tmi", frames.rotation, child)
    along_body = np.einsum("tji,tmj->tmi", frames.rotation, along)
    normal, mean_normal = _normals(along_body, child_body)
    return {
        "joint_world": child,
        "joint_body": child_body,
        "joint_plane": _in_plane(child_body, _mean_direction(along_body), mean_normal),
        "joint_limb": _in_plane(child_body, along_body, normal),
        "joint_sd": np.where(np.isfinite(child[..., 0]), sd, np.nan),
    }


def _normals(along: Array, child: Array) -> tuple[Array, Array]:
    """Unit normals (T, J, 3) of the limbs' planes on one side all along, and their mean directions (J, 3).

    A cross product changes its side where a joint bends over its straight position. There its length, the sine of the
    bend, goes through zero, while the plane itself turns on steadily: each normal takes the side of a running mean of
    those before it, weighted by the sine. A straight limb has no plane and gets the mean normal.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.linalg.norm(along, axis=-1, keepdims=True) * np.linalg.norm(child, axis=-1, keepdims=True)
        normal = np.cross(along, child) / scale  # length: sine of the bend
    filled = np.nan_to_num(normal)
    running = np.zeros(filled.shape[1:])
    side = np.ones(filled.shape[:2])
    for t, one in enumerate(filled):
        side[t] = np.where(np.sum(one * running, axis=-1) < 0, -1.0, 1.0)
        running = np.where(np.any(one != 0, axis=-1, keepdims=True), 0.8 * running + side[t, :, None] * one, running)
    kept = filled * side[..., None]
    total = kept.sum(axis=0)
    natural = np.where(np.sum(total * filled.sum(axis=0), axis=-1) < 0, -1.0, 1.0)
    kept, total = kept * natural[:, None], total * natural[:, None]
    length = np.linalg.norm(kept, axis=-1, keepdims=True)
    mean = total / np.maximum(np.linalg.norm(total, axis=-1, keepdims=True), 1e-300)
    unit = np.where(length > 1e-9, kept / np.maximum(length, 1e-300), mean)
    return np.where(np.isfinite(normal), unit, np.nan), mean


def _mean_direction(along: Array) -> Array:
    """(J, 3) mean of the directions over time."""
    with np.errstate(invalid="ignore"):
        unit = along / np.linalg.norm(along, axis=-1, keepdims=True)
    count = np.maximum(np.isfinite(unit[..., :1]).sum(axis=0), 1)
    return np.nansum(unit, axis=0) / count


def _in_plane(child: Array, along: Array, normal: Array) -> Array:
    """(T, J, 2) coordinates of the child along a direction made normal to ``normal``, and across it."""
    first = along - np.sum(along * normal, axis=-1, keepdims=True) * normal
    with np.errstate(invalid="ignore", divide="ignore"):
        first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(normal, first)
    return np.stack([np.sum(child * first, axis=-1), np.sum(child * second, axis=-1)], axis=-1)
