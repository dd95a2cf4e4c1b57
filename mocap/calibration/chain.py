"""Relative poses of cameras from boards that pairs of them saw; the pairs only need to form a chain."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.calibration.rig import turned_rad
from mocap.errors import CalibrationError

_TELLING = 4
_AGREEING = 0.5
"""Of this many common instants or more, so many agree where their pictures were taken at one time."""

Seen = Mapping[tuple[int, str], Array]
"""By camera and instant: (4, 4) board axes to camera axes."""


@dataclass(frozen=True, eq=False)
class Pair:
    """The relative pose of two cameras.

    Attributes:
        T_second_from_first: (4, 4).
        stems: Instants that agree with it.
        common: Number of instants that both saw.
    """

    T_second_from_first: Array
    stems: tuple[str, ...]
    common: int


def rigid(rotation: Array, translation: Array) -> Array:
    """(4, 4) transform."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def pair_of(seen: Seen, first: int, second: int, turn: Array | None) -> Pair | None:
    """The relative pose of two cameras on which most of their common frames agree; None where they share none.

    Two stands agree where they differ by less than a tenth of a radian, and in place by less than a tenth of the
    board's distance.

    Args:
        seen: Placements.
        first: A camera.
        second: Another.
        turn: (4, 4) board axes turned by 180 degrees, for boards that look the same so; None for others.
    """
    stems = [s for c, s in seen if c == first and (second, s) in seen]
    turns = [np.eye(4)] if turn is None else [np.eye(4), turn]
    if not stems:
        return None
    stands = np.stack(
        [np.stack([seen[second, s] @ t @ np.linalg.inv(seen[first, s]) for t in turns]) for s in stems]
    )  # (S, turns, 4, 4)
    distance = np.array([np.linalg.norm(seen[second, s][:3, 3]) for s in stems])
    best, fewest = None, (-1, np.inf)
    for candidate in stands.reshape(-1, 4, 4):
        off = np.maximum(
            turned_rad(stands[..., :3, :3] @ candidate[:3, :3].T),
            np.linalg.norm(stands[..., :3, 3] - candidate[:3, 3], axis=-1) / distance[:, None],
        )
        agree = off.min(axis=1) < 0.1
        score = (int(agree.sum()), -float(off.min(axis=1)[agree].sum()))
        if best is None or score > fewest:
            best, fewest = (candidate, agree), score
    assert best is not None
    return Pair(best[0], tuple(s for s, a in zip(stems, best[1], strict=True) if a), len(stems))


def chained(seen: Seen, names: Sequence[str], turn: Array | None) -> list[Array]:
    """(C) transforms of the first camera's axes to each camera's, along the pairs with most instants in common.

    Raises:
        CalibrationError: the cameras fall into groups that share no instant, or pictures of one name are not of one.
    """
    n = len(names)
    pairs = {(i, j): p for i in range(n) for j in range(n) if i != j and (p := pair_of(seen, i, j, turn)) is not None}
    found: dict[int, Array] = {0: np.eye(4)}
    while len(found) < n:
        edges = [(len(p.stems), -i, -j) for (i, j), p in pairs.items() if i in found and j not in found]
        if not edges:
            lost = ", ".join(repr(names[i]) for i in range(n) if i not in found)
            rest = ", ".join(repr(names[i]) for i in sorted(found))
            raise CalibrationError(
                f"cameras {lost} never see the board at the same time as any of {rest}: film the board where both "
                "see it, or give pictures taken at the same time the same name"
            )
        _, i, j = max(edges)
        best = pairs[-i, -j]
        if best.common >= _TELLING and len(best.stems) < _AGREEING * best.common:
            raise CalibrationError(
                f"the boards of one name do not fit one scene: not of one instant? {names[-i]!r} and {names[-j]!r} "
                f"share {best.common} names, and at most {len(best.stems)} of them agree on how the cameras stand: if "
                "each camera's pictures were taken by themselves, use mocap calibrate lenses, then mocap calibrate "
                "places; else give pictures taken at the same time the same name"
            )
        found[-j] = pairs[-i, -j].T_second_from_first @ found[-i]
    return [found[i] for i in range(n)]
