"""Rigid bodies that files state by their transforms: which markers are fixed in each, and where."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import Bodies, FileContents
from mocap.io.lines import UNIT_M


def fixed_markers(names: Sequence[str], xyz: Array, bodies: Sequence[str], transforms: Array) -> Bodies:
    """Markers that keep their place in a body that moves as its transforms say: each in the body where it moves least.

    Args:
        names: The M markers.
        xyz: (T, M, 3) positions; NaN where not seen.
        bodies: The B bodies; those with three markers at least are given back.
        transforms: (T, B, 4, 4) world from body, in the unit of the positions; NaN where a body is not known.
    """
    away = xyz[:, None] - transforms[:, :, None, :3, 3]
    local = np.einsum("tbji,tbmj->tbmi", transforms[..., :3, :3], away)
    finite = np.isfinite(local).all(axis=-1, keepdims=True)
    count = np.maximum(finite.sum(axis=0), 1)
    place = np.where(finite, local, 0.0).sum(axis=0) / count
    spread = np.sqrt(np.sum(np.where(finite, local - place, 0.0) ** 2, axis=(0, 3)) / count[..., 0])
    spread[finite.sum(axis=0)[..., 0] < 2] = np.inf  # one frame shows nothing of what moves
    own, found = spread.argmin(axis=0), {}
    for b, body in enumerate(bodies):
        mine = np.flatnonzero((own == b) & np.isfinite(spread[b]))
        if len(mine):
            extent = np.median(np.linalg.norm(place[b, mine] - np.median(place[b, mine], axis=0), axis=1))
            mine = mine[spread[b, mine] <= 0.05 * extent]  # as a rigid bone keeps its length
        if len(mine) >= 3:
            found[body] = {names[m]: place[b, m] for m in mine.tolist()}
    return found


def with_bodies(points: FileContents, others: Sequence[FileContents]) -> FileContents:
    """Positions with the bodies of files of transforms; those that never move are axes within a body of their name.

    XMALab's rigid bodies move from a bone's own space (the CT scan's) to the world; a coordinate system of Maya that
    stands still is one in that space, one that moves states a body.

    Raises:
        FormatError: the files do not belong together.
    """
    where = points.paths[0].name
    if points.points is None:
        raise FormatError(f"{others[0].paths[0].name}: rigid bodies go with positions, but {where} contains none")
    bodies: dict[str, Mapping[str, Array]] = {}
    scale = UNIT_M[points.unit] if points.unit is not None else 1.0
    still = [
        other for other in others if len(other.names) == 1 and np.ptp(other.tables["transforms"], axis=0).max() == 0
    ]
    for other in (other for other in others if other not in still):
        transforms = other.tables["transforms"].copy()
        transforms[..., :3, 3] *= scale if other.unit is None else 1.0
        _, here, there = np.intersect1d(points.frames, other.frames, return_indices=True)
        found = fixed_markers(points.names, points.points.xyz_m[here], other.names, transforms[there])
        lost = [name for name in other.names if name not in found]
        if lost:
            raise FormatError(
                f"{other.paths[0].name}: no three markers of {where} keep their places in the body {lost[0]!r}: give "
                "files of one recording, in the same unit and world"
            )
        bodies |= found
    for other in still:
        transform = other.tables["transforms"][0, 0]
        name = _body_of(other, tuple(bodies))
        bodies[name] = {
            marker: transform[:3, :3].T @ (at - scale * transform[:3, 3]) for marker, at in bodies[name].items()
        }
    paths = tuple(path for other in others for path in other.paths)
    return replace(points, paths=points.paths + paths, bodies=bodies)


def _body_of(axes: FileContents, bodies: Sequence[str]) -> str:
    """The body that a file of a coordinate system is named after."""
    file = axes.paths[0].name
    called = re.sub(r"_acs.*", "", file.partition(".")[0], flags=re.IGNORECASE)
    names = {called.casefold(), axes.names[0].casefold()}
    found = [body for body in bodies if body.casefold() in names]
    if len(found) != 1:
        raise FormatError(
            f"{file}: a coordinate system that does not move is one within a bone; rename it after its rigid body "
            f"({', '.join(f'{body}_acs_tm.csv' for body in bodies) or 'give the file of rigid bodies, too'})"
        )
    return found[0]
