"""Markers that jump: places between which no animal moves in the time, with an undisturbed track on both sides."""

from collections.abc import Sequence

import numpy as np

from eal.arrays import Array
from mocap.findings import Finding

FAST, QUANTILE = 1.5, 0.999
"""A jump is faster by that factor than this quantile of all steps between neighbouring frames."""
FEWEST_STEPS = 1000
LONGEST_HOLE = 6
"""Frames over which a jump may be hidden."""
BESIDE = 3
"""Samples before and after a jump, with no more than one frame missing between them, that move as usual."""
FAR, ACROSS = 4.0, 2.5
"""A jump is longer by that factor than what speeds before and after it explain: between neighbouring frames, where a
careless click looks like one, and across a hole."""
APART = 0.1
"""No jump is shorter than that share of the way to the nearest other marker: soft tissue and noise move one as far.
It goes to another marker's place where it ends within that share of its own length from there."""


def usual_speed(xyz_m: Array, t_s: Array) -> float:
    """``FAST`` times the 99.9 % quantile of speeds between neighbouring frames, of all markers; inf: too few steps.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        t_s: (T,) times.
    """
    if len(t_s) < 2:
        return np.inf
    speed = np.linalg.norm(np.diff(xyz_m, axis=0), axis=-1) / np.diff(t_s)[:, None]
    speed = speed[np.isfinite(speed)]
    return FAST * float(np.quantile(speed, QUANTILE)) if len(speed) >= FEWEST_STEPS else np.inf


def jump_findings(
    xyz_m: Array, t_s: Array, names: Sequence[str], *, timed: bool = True, first: int = 0, length: str = "mm"
) -> list[Finding]:
    """Markers that jump from one place to another, in one frame or in a hole of a few.

    A step is a jump where it is faster than ``usual_speed``, and far longer than the motion before and after it
    explains, while that motion itself is of usual speed: a single careless click is not a jump.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        t_s: (T,) times.
        names: The M markers.
        timed: Whether the frame rate is known; else times are in frames, and so speeds are told.
        first: Frames of the recording before these.
        length: What a thousandth of the unit of positions is called: ``mm``, or ``px`` where they are pixels.
    """
    limit = usual_speed(xyz_m, t_s)
    if not np.isfinite(limit):
        return []
    usual = limit / FAST
    per = "/s" if timed else " per frame"
    told = "{:.3g} m/s".format if timed and length == "mm" else (lambda speed: f"{1e3 * speed:.4g} {length}{per}")
    found = []
    for m, name in enumerate(names):
        frames = np.flatnonzero(np.isfinite(xyz_m[:, m, 0]))
        if len(frames) < 2 * BESIDE:
            continue
        x, t = xyz_m[frames, m], t_s[frames]
        step, dt = np.diff(x, axis=0), np.diff(t)
        velocity = step / dt[:, None]
        speed, hole = np.linalg.norm(velocity, axis=-1), np.diff(frames)
        for i in np.flatnonzero((speed > limit) & (hole <= LONGEST_HOLE)):
            around = [*range(i - BESIDE + 1, i), *range(i + 1, i + BESIDE)]
            if around[0] < 0 or around[-1] >= len(step) or (speed[around] > usual).any() or (hole[around] > 2).any():
                continue
            drift = (velocity[around[: BESIDE - 1]].mean(axis=0) + velocity[around[BESIDE - 1 :]].mean(axis=0)) / 2
            left = float(np.linalg.norm(step[i] - drift * dt[i]))
            explained = float(np.max(speed[around])) * dt[i]
            if left < (FAR if hole[i] == 1 else ACROSS) * explained or left < 0.5 * np.linalg.norm(step[i]):
                continue
            far = float(np.linalg.norm(step[i]))
            one, next_one = (int(frame) + first + 1 for frame in frames[i : i + 2])
            other, near = _nearest(xyz_m, m, (frames[i], frames[i + 1]))
            if far < APART * near:
                continue
            cause = "probably a digitising error before or after"
            if other is not None and near < APART * far:
                cause = f"probably swapped with {str(names[other])!r}, {1e3 * near:.4g} {length} away, before or after"
            found.append(
                Finding(
                    kind="jump",
                    alarm=True,
                    text=f"{name!r} jumps by {1e3 * far:.4g} {length} between frames {one} and "
                    f"{next_one} ({told(speed[i])}; 99.9 % of all steps are slower than {told(usual)}): "
                    f"{cause}: check these frames before filling",
                    numbers={"length": far, "speed": float(speed[i]), "usual_speed": usual},
                    markers=(str(name),),
                    frames=(one, next_one),
                )
            )
    return found


def _nearest(xyz_m: Array, marker: int, frames: tuple[int, int]) -> tuple[int | None, float]:
    """The other marker nearest to where one goes, in the frame before, or to where it was, in the frame after.

    Args:
        xyz_m: (T, M, 3) positions.
        marker: Which jumps.
        frames: From where and to where.

    Returns:
        Its number and distance; None and 0 where no other marker is seen.
    """
    before, after = frames
    ways = np.stack([xyz_m[before] - xyz_m[after, marker], xyz_m[after] - xyz_m[before, marker]])
    far = np.linalg.norm(ways, axis=-1).min(axis=0, initial=np.inf, where=np.isfinite(ways).all(axis=-1))
    far[marker] = np.inf
    nearest = int(np.argmin(far))
    return (nearest, float(far[nearest])) if np.isfinite(far[nearest]) else (None, 0.0)
