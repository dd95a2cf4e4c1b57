"""Markers that jump: places between which no animal moves in the time, with an undisturbed track on both sides."""

from collections.abc import Sequence

import numpy as np

from eal.arrays import Array
from mocap.audit.finding import Finding

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


def jump_findings(xyz_m: Array, t_s: Array, names: Sequence[str], *, unit: str = "m") -> list[Finding]:
    """Markers that jump from one place to another, in one frame or in a hole of a few.

    A step is a jump where it is faster than ``usual_speed``, and far longer than the motion before and after it
    explains, while that motion itself is of usual speed: a single careless click is not a jump.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        t_s: (T,) times.
        names: The M markers.
        unit: Of the positions, for the text; lengths in metres are told in mm.
    """
    limit = usual_speed(xyz_m, t_s)
    if not np.isfinite(limit):
        return []
    usual = limit / FAST
    scale, small = (1e3, "mm") if unit == "m" else (1.0, unit)
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
            length = float(np.linalg.norm(step[i]))
            found.append(
                Finding(
                    kind="jump",
                    alarm=True,
                    text=f"{name!r} jumps by {scale * length:.4g} {small} between frames {frames[i] + 1} and "
                    f"{frames[i + 1] + 1} ({speed[i]:.3g} {unit}/s; 99.9 % of all steps are slower than {usual:.3g} "
                    f"{unit}/s): it was another marker before or after, or its clicks are wrong there; do not trust a "
                    "gap filled between the two",
                    numbers={"length": length, "speed": float(speed[i]), "usual_speed": usual},
                    markers=(str(name),),
                    frames=(int(frames[i]) + 1, int(frames[i + 1]) + 1),
                )
            )
    return found
