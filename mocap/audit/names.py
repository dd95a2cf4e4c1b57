"""Names that two markers exchange more often than any animal moves so."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.triangulate import linear, project
from mocap.findings import Finding, Kind, alarm

OFTEN = 0.1
"""Share of the steps between frames in which two names go to each other's place, from which on it is told. Noise of two
markers in one place makes 0.4 % (in space) to 3 % (in a line); identity switches of networks are rarer. Chosen."""
THROUGHOUT = 0.5
"""Share of the frames in which one camera contradicts the others about two names: fewer are identity switches, which
cleaning finds one by one."""
CLEAR = 4.0
"""The other's place is nearer by that factor."""
FEWEST = 5
"""Such frames, at least."""


def exchange_rates(values: Array, names: Sequence[str], *, camera: str | None = None) -> list[Finding]:
    """Two names that go to each other's place between frames, again and again.

    Args:
        values: (T, M, d) positions or pixels; NaN where not seen.
        names: The M markers.
        camera: Whose pixels they are; None: positions.
    """
    count = values.shape[1]
    if count < 2 or len(values) < FEWEST + 1:
        return []
    # a share is known well enough of so many steps, and distances of all pairs take their square in memory
    most = max(200, min(2000, 4_000_000 // count**2))
    at = np.unique(np.linspace(0, len(values) - 2, min(most, len(values) - 1)).astype(int))
    where = "" if camera is None else f" in camera {camera!r}"
    return [
        alarm(
            kind=Kind.EXCHANGED_NAMES,
            text=f"{names[a]!r} and {names[b]!r} go to each other's place{where} in {share:.0%} of the steps between "
            "frames, as no animal moves: their names are exchanged in some frames: correct the columns of these frames",
            numbers={"share": share, "steps": steps},
            cameras=() if camera is None else (camera,),
            markers=(str(names[a]), str(names[b])),
        )
        for a, b, share, steps in _pairs(values[at], values[at + 1], OFTEN)
    ]


def exchanged_in_a_camera(
    matrices: Array, ideal_px: Array, names: Sequence[str], cameras: Sequence[str]
) -> list[Finding]:
    """Two names that one camera has exchanged against all others, most of the time; of three cameras or more.

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, T, M, 2) ideal pixels.
        names: The M markers.
        cameras: The C cameras.
    """
    if len(matrices) < 3 or len(names) < 2:
        return []
    some = ideal_px[:, :: max(1, ideal_px.shape[1] // 1000)]  # a share needs no more
    found = []
    for c, camera in enumerate(cameras):
        others = np.arange(len(matrices)) != c
        there = project(matrices[c : c + 1], linear(matrices[others], some[others]))[0]
        found += [
            alarm(
                kind=Kind.EXCHANGED_NAMES,
                text=f"in camera {camera!r} {names[a]!r} is where the other cameras see {names[b]!r}, and the reverse, "
                f"in {share:.0%} of the frames: their names are exchanged there: correct its columns",
                numbers={"share": share, "frames": frames},
                cameras=(camera,),
                markers=(str(names[a]), str(names[b])),
            )
            for a, b, share, frames in _pairs(some[c], there, THROUGHOUT)
        ]
    return found


def _pairs(one: Array, other: Array, least: float) -> list[tuple[int, int, float, int]]:
    """Pairs of markers of which each is at the other's place: their numbers, in which share of how many frames.

    Args:
        one: (n, M, d) places by name.
        other: (n, M, d) places by name, of the same or the next moment.
        least: Share from which on a pair is told.
    """
    count = one.shape[1]
    own = np.linalg.norm(one - other, axis=-1)
    nearest, across = np.full(own.shape, -1), np.full(own.shape, np.nan)
    axes = np.moveaxis(other, -1, 0).copy()
    for m in range(count):
        far = np.sqrt(sum((one[:, m, k, None] - there) ** 2 for k, there in enumerate(axes)))
        far[~np.isfinite(far)] = np.inf
        gap = far.min(axis=1)
        known = np.isfinite(gap)
        nearest[known, m] = far.argmin(axis=1)[known]
        across[known, m] = gap[known]
    found = []
    for a, b in sorted({(m, int(n)) for m in range(count) for n in np.unique(nearest[:, m]) if m < n}):
        both = np.isfinite(own[:, a]) & np.isfinite(own[:, b])
        swapped: NDArray[np.bool_] = both & (nearest[:, a] == b) & (nearest[:, b] == a)
        swapped &= CLEAR * (across[:, a] + across[:, b]) < own[:, a] + own[:, b]
        times, frames = int(swapped.sum()), int(both.sum())
        if times >= FEWEST and times > least * frames:
            found.append((a, b, times / frames, frames))
    return found
