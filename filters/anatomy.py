"""What is known of an animal's build: its trunk, its bones, its limbs and their mirror images."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eal.arrays import Array

Part = tuple[str, str, float, float]
"""A part of the body: its first and last marker, its kilograms, its centre as a share of the way between them."""

_SWAPPED = {"left": "right", "right": "left", "l": "r", "r": "l"}
_SIDE = (
    re.compile(r"left|right", re.IGNORECASE),
    re.compile(r"(?<![^\W_])[lr](?![^\W_])", re.IGNORECASE),  # elbow_l, L.Elbow
    re.compile(r"(?<=[a-z0-9])[LR]$"),  # elbL, t3R
    re.compile(r"^[LR](?=[A-Z])"),  # LElbow
)


@dataclass(frozen=True, eq=False)
class Limb:
    """Bones of a limb from the trunk outward.

    Relative joint coordinates q are the vectors along its bones, x_child - x_parent, in the axes of the body: where
    each joint is, seen from the one before it.

    Attributes:
        children: (J,) outer end of each bone.
        parents: (J,) inner end; of the first bones it is a marker of the trunk.
    """

    children: tuple[int, ...]
    parents: tuple[int, ...]

    def map(self, n_markers: int, turn: Array | None = None) -> Array:
        """(3J, 3M) from markers to q; each bone's vector then times ``turn`` (3, 3)."""
        out = np.zeros((len(self.children), 3, n_markers, 3))
        axes = np.eye(3) if turn is None else turn.T
        for i, (child, parent) in enumerate(zip(self.children, self.parents, strict=True)):
            out[i, :, child], out[i, :, parent] = axes, -axes
        return out.reshape(3 * len(self.children), 3 * n_markers)


class Mass(NamedTuple):
    """Of a part of the body between two markers: kilograms, its centre as a share of the way from start to end."""

    start: int
    end: int
    kg: float
    centre: float = 0.5


@dataclass(frozen=True)
class Anatomy:
    """What is known of the build of an animal, by indices of its markers.

    Attributes:
        trunk: Markers of the trunk.
        bones: Both ends of each bone that the skeleton states as rigid.
        mirror: Each marker's counterpart on the other side, itself where it has none; empty: not known.
        masses: Parts whose mass is stated.
        bodies: Markers of each rigid body; None: none is stated, and the recording shows which there are.
    """

    trunk: tuple[int, ...]
    bones: tuple[tuple[int, int], ...] = ()
    mirror: tuple[int, ...] = ()
    masses: tuple[Mass, ...] = ()
    bodies: tuple[tuple[int, ...], ...] | None = None

    @cached_property
    def limbs(self) -> list[Limb]:
        """A limb for every bone that leaves the trunk, with all bones that hang on it."""
        out = []
        placed = set(self.trunk)
        for start in self.trunk:
            for first in self._next(start, placed):
                if first in placed:
                    continue
                children, parents, at = [first], [start], 0
                placed.add(first)
                while at < len(children):
                    for outer in self._next(children[at], placed):
                        children.append(outer)
                        parents.append(children[at])
                        placed.add(outer)
                    at += 1
                out.append(Limb(tuple(children), tuple(parents)))
        return out

    def _next(self, marker: int, placed: set[int]) -> list[int]:
        ends = [b if a == marker else a for a, b in self.bones if marker in (a, b)]
        return [end for end in dict.fromkeys(ends) if end not in placed]

    def mirrored(self, limb: Limb) -> Limb | None:
        """The same limb of the other side; None: it has no counterpart."""
        if not self.mirror or any(self.mirror[child] == child for child in limb.children):
            return None
        return Limb(tuple(self.mirror[m] for m in limb.children), tuple(self.mirror[m] for m in limb.parents))


def ends_among(names: Sequence[str], bones: Sequence[tuple[str, str]]) -> list[tuple[int, int]]:
    """Indices into names of both ends of each bone that has both there."""
    return [(names.index(a), names.index(b)) for a, b in bones if a in names and b in names]


def anatomy_of(
    names: Sequence[str],
    trunk: Sequence[str],
    bones: Sequence[tuple[str, str]],
    parts: Iterable[Part] = (),
    *,
    bodies: Iterable[Sequence[str]] = (),
) -> Anatomy:
    """The anatomy of markers by name; all of them are the trunk where none of its markers is there.

    Args:
        names: Markers.
        trunk: Those of the trunk.
        bones: Ends of rigid bones.
        parts: Parts whose mass is stated.
        bodies: Markers of each rigid body that is stated.
    """
    body = tuple(names.index(name) for name in trunk if name in names) or tuple(range(len(names)))
    masses = masses_of(names, parts)
    rigid = tuple(tuple(names.index(name) for name in one if name in names) for one in bodies)
    return Anatomy(
        trunk=body,
        bones=tuple(ends_among(names, bones)),
        mirror=counterparts(names),
        masses=masses,
        bodies=rigid or None,
    )


def masses_of(names: Sequence[str], parts: Iterable[Part]) -> tuple[Mass, ...]:
    """Stated masses by indices of markers; of parts whose ends are among them."""
    return tuple(
        Mass(names.index(start), names.index(end), kg, centre)
        for start, end, kg, centre in parts
        if start in names and end in names
    )


def counterparts(names: Sequence[str]) -> tuple[int, ...]:
    """Index of each marker's counterpart on the other side, by name (``elbow_l``, ``elbL``, ``LElbow``)."""
    out = list(range(len(names)))
    for i, name in enumerate(names):
        for pattern in _SIDE:
            found = [j for m in pattern.finditer(name) if (j := _named(names, name, m)) is not None]
            if found:
                out[i] = found[0]
                break
    return tuple(j if out[j] == i else i for i, j in enumerate(out))


def _named(names: Sequence[str], name: str, side: re.Match[str]) -> int | None:
    other = _SWAPPED[side[0].lower()]
    other = other.upper() if side[0].isupper() else other.capitalize() if side[0][0].isupper() else other
    swapped = name[: side.start()] + other + name[side.end() :]
    return names.index(swapped) if swapped in names else None


def reflection(pose_m: Array, mirror: Sequence[int]) -> tuple[Array, float]:
    """The reflection (3, 3) that takes markers of a mean pose (M, 3) to their counterparts, and what it misses by.

    It is found as a rotation is (Kabsch 1976; Umeyama 1991), for a determinant of -1: y = x @ R about the centre.

    Returns:
        R, and the root mean square distance of what is left, over that of the markers from their centre.
    """
    own = np.flatnonzero(np.asarray(mirror) != np.arange(len(pose_m)))
    other = np.asarray(mirror)[own]
    centre = pose_m[own].mean(axis=0)
    a, b = pose_m[own] - centre, pose_m[other] - centre
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1.0, 1.0, -np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn, float(np.sqrt(np.mean((a @ turn - b) ** 2) / max(np.mean(a**2), 1e-300)))
