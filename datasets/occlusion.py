"""Which markers are hidden from a camera: rays against wing membranes and solid bodies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera, decompose


@dataclass(frozen=True, eq=False, kw_only=True)
class Solid:
    """An ellipsoid that moves; with one semi-axis infinite, a round rod.

    Attributes:
        centre_m: (T, 3) centre in the world.
        rotation: (T, 3, 3) from its own axes to the world's.
        semi_axes_m: (3,) semi-axes.
    """

    centre_m: Array
    rotation: Array
    semi_axes_m: Array

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "centre_m", frozen("centre_m", self.centre_m, (None, 3)))
        object.__setattr__(self, "rotation", frozen("rotation", self.rotation, (len(self.centre_m), 3, 3)))
        object.__setattr__(self, "semi_axes_m", frozen("semi_axes_m", self.semi_axes_m, (3,)))


def hidden_by_triangles(
    eye_m: Array, xyz_m: Array, triangles: NDArray[np.intp], *, clearance_m: float
) -> NDArray[np.bool_]:
    """Markers behind a triangle of other markers.

    Moeller & Trumbore 1997 with the ray's direction factored out: as all rays of a frame leave from one eye, the
    determinant and both barycentric coordinates are products of the direction with one vector a triangle.

    Args:
        eye_m: (3,) centre of projection.
        xyz_m: (T, M, 3) markers.
        triangles: (K, 3) marker indices; a marker is never hidden by a triangle that it is a corner of.
        clearance_m: A triangle closer to the marker than this does not hide it: it lies on that membrane.

    Returns:
        (T, M) True where hidden.
    """
    n_frames, n_markers = xyz_m.shape[:2]
    if not len(triangles):
        return np.zeros((n_frames, n_markers), dtype=bool)
    ray = xyz_m - eye_m
    corner, second, third = (xyz_m[:, triangles[:, i]] for i in range(3))
    e1, e2, s = second - corner, third - corner, eye_m - corner
    cross = np.cross(s, e1)
    directions = np.swapaxes(ray, 1, 2)
    det = np.cross(e2, e1) @ directions
    # (T, K, M); multiplied by the sign of det, so that no division is needed
    sign = np.sign(det)
    size = np.abs(det)
    u = (np.cross(e2, s) @ directions) * sign
    v = (cross @ directions) * sign
    depth = np.sum(e2 * cross, axis=-1)[:, :, None] * sign
    limit = 1 - clearance_m / np.linalg.norm(ray, axis=-1)
    hit = (u >= 0) & (v >= 0) & (u + v <= size) & (depth > 0) & (depth < limit[:, None, :] * size)
    hit[:, np.arange(len(triangles))[:, None], triangles] = False
    return hit.any(axis=1)


def hidden_by_solid(eye_m: Array, xyz_m: Array, solid: Solid, *, clearance_m: float) -> NDArray[np.bool_]:
    """Markers behind a solid: their ray enters it more than ``clearance_m`` before the marker.

    Args:
        eye_m: (3,) centre of projection.
        xyz_m: (T, M, 3) markers.
        solid: What may hide them.
        clearance_m: A marker on the near surface, or this deep below it, stays visible.

    Returns:
        (T, M) True where hidden.
    """
    inverse = np.swapaxes(solid.rotation, 1, 2) / solid.semi_axes_m[:, None]
    start = (inverse @ (eye_m - solid.centre_m)[..., None])[:, None, :, 0]
    ray = xyz_m - eye_m
    along = np.einsum("tij,tmj->tmi", inverse, ray)
    a, b, c = np.sum(along**2, axis=-1), np.sum(along * start, axis=-1), np.sum(start**2, axis=-1) - 1
    discriminant = b**2 - a * c
    entry = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
    limit = 1 - clearance_m / np.linalg.norm(ray, axis=-1)
    return (discriminant > 0) & (entry > 0) & (entry < limit)


def hidden_by_grazing(
    eye_m: Array, xyz_m: Array, triangles: NDArray[np.intp], *, least_rad: float
) -> NDArray[np.bool_]:
    """Markers of a membrane that is seen from its edge: a flat mark is a line there, which nobody clicks.

    Args:
        eye_m: (3,) centre of projection.
        xyz_m: (T, M, 3) markers.
        triangles: (K, 3) marker indices; the normal at a marker is the sum of those of its triangles, by area.
        least_rad: Least angle between ray and membrane.

    Returns:
        (T, M) True where hidden; never for markers without a triangle.
    """
    corner, second, third = (xyz_m[:, triangles[:, i]] for i in range(3))
    normals = np.cross(second - corner, third - corner)
    belongs = (triangles[:, None, :] == np.arange(xyz_m.shape[1])[:, None]).any(axis=-1).astype(np.float64)
    normal = np.einsum("tki,km->tmi", normals, belongs)
    ray = xyz_m - eye_m
    across = np.abs(np.sum(ray * normal, axis=-1))
    length = np.linalg.norm(ray, axis=-1) * np.linalg.norm(normal, axis=-1)
    return (length > 0) & (across < np.sin(least_rad) * length)


def occluded(
    cameras: Sequence[Camera],
    xyz_m: Array,
    *,
    triangles: NDArray[np.intp],
    solids: Sequence[Solid],
    clearance_m: float,
    grazing_rad: float = 0.0,
) -> NDArray[np.bool_]:
    """(C, T, M) True where a membrane or a solid hides a marker, or the marker's membrane is seen from its edge.

    Arguments as above; ``grazing_rad`` 0: no marker is hidden by the angle of its membrane.
    """
    hidden = []
    for camera in cameras:
        eye_m = decompose(camera).position_m
        behind = hidden_by_triangles(eye_m, xyz_m, triangles, clearance_m=clearance_m)
        for solid in solids:
            behind |= hidden_by_solid(eye_m, xyz_m, solid, clearance_m=clearance_m)
        if grazing_rad > 0:
            behind |= hidden_by_grazing(eye_m, xyz_m, triangles, least_rad=grazing_rad)
        hidden.append(behind)
    return np.stack(hidden)
