"""Checks of tracks alone: quantised pixels, copied frames and cameras, wrong units, markers that jump."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.audit.columns import column_findings
from mocap.audit.frames import exchanged_frames, path_findings
from mocap.audit.names import exchange_rates
from mocap.audit.units import unit_findings
from mocap.findings import MOST, Finding, Kind, alarm
from mocap.io.rounding import rounding
from mocap.records import MarkerTracks, PixelTracks
from mocap.text import number_of

BESIDE = 2
"""Steps on each side of repeated frames of which one has at least half of the usual length. Chosen, not measured."""
BODY_M = (5e-4, 40.0)
"""Sizes of animals and parts of them, from an insect of 1 mm, whose markers are half of that from their centre, to a
whale of 30 m."""


def pixel_findings(pixels: PixelTracks) -> list[Finding]:
    """Quantisation, repeated frames and copied cameras of pixel tracks."""
    found = []
    for c, camera in enumerate(pixels.cameras):
        uv = pixels.uv_px[c]
        found += [*_steps(uv, camera), *_repeats(uv, camera), *exchange_rates(uv, pixels.names, camera=camera)]
        found += [*column_findings(uv, pixels.names, camera=camera), *path_findings(uv, pixels.names, camera=camera)]
    found += exchanged_frames(np.moveaxis(pixels.uv_px, 1, 0).reshape(len(pixels.t_s), -1), axes=2)
    return found + _copied_tracks(pixels)


def point_findings(points: MarkerTracks, *, first: int = 0, sized: bool = True) -> list[Finding]:
    """Of positions: repeated frames, names that are exchanged, lengths in two units, or that no animal has.

    Args:
        points: The positions.
        first: Frames of the recording before these.
        sized: Whether they are lengths whose unit is known.
    """
    found = [*_repeats(points.xyz_m, None, first), *exchange_rates(points.xyz_m, points.names)]
    found += unit_findings(points.xyz_m, points.names, first=first)
    found += path_findings(points.xyz_m, points.names, first=first)
    found += exchanged_frames(points.xyz_m.reshape(len(points.t_s), -1), axes=3, first=first)
    return found + (sizes(points.xyz_m) if sized else [])


def _steps(uv: Array, camera: str) -> list[Finding]:
    """Pixels on a grid: whole numbers, halves, or the numbers that float16 holds.

    Whole numbers to 2048 are float16 numbers too, and so are those of any grid to 2048 of its steps. Half precision
    shows beyond: there its numbers lie on every second, fourth, ... step of the grid that the smaller ones need.
    """
    values = np.abs(uv[np.isfinite(uv)])
    values = values[:: max(1, len(values) // 100_000)]
    if len(values) < 20 or len(np.unique(values)) < 10:
        return []

    def on(step: float) -> float:
        return float(np.mean(np.abs(values / step - np.round(values / step)) * step < 1e-6))

    step = next((s for s in 2.0 ** np.arange(4, -4, -1) if on(s) > 0.995), None)
    half_precision = values.max() < 6e4 and (np.abs(values.astype(np.float16).astype(float) - values) < 1e-6).all()
    finest = next((s for s in 2.0 ** np.arange(4, -14, -1) if on(s) == 1), None) if half_precision else None
    if finest is not None and np.count_nonzero(values >= 2048 * finest) >= 20:  # by chance once in a million
        coarsest = float(2.0 ** np.floor(np.log2(values.max() / 1024)))
        text = (
            f"were stored in half precision (float16): the smallest need steps of {finest:g} px, the largest are "
            f"rounded to {coarsest:g} px"
        )
        numbers = {"step_px": coarsest, "sd_px": coarsest / np.sqrt(12)}
    elif step is not None:
        text = (
            f"are multiples of {step:g} px{' (whole pixels)' if step == 1 else ''}: rounding alone gives errors of "
            f"{step / np.sqrt(12):.2f} px (standard deviation)"
        )
        numbers = {"step_px": step, "sd_px": step / np.sqrt(12)}
    else:
        return []
    return [
        alarm(
            kind=Kind.QUANTISED_PIXELS,
            text=f"pixels of camera {camera!r} {text}",
            numbers=numbers,
            cameras=(camera,),
        )
    ]


def _repeats(values: Array, camera: str | None, first: int = 0) -> list[Finding]:
    """Frames of (T, M, d) tracks that repeat the one before in every digit, though markers move otherwise."""
    seen = np.asarray(~np.isnan(values).any(axis=-1))
    both = np.logical_and(seen[1:], seen[:-1])
    same = ((values[1:] == values[:-1]).all(axis=-1)) & both
    judged = (np.count_nonzero(both, axis=1) >= 1) & (seen[1:] == seen[:-1]).all(axis=1)
    repeats = judged & (np.count_nonzero(same, axis=1) == np.count_nonzero(both, axis=1))
    if not repeats.any():
        return []
    alone = np.count_nonzero(same[~repeats]) / max(np.count_nonzero(both[~repeats]), 1)
    markers = float(np.count_nonzero(both, axis=1)[repeats].mean())
    # by chance all stand still in one frame of a hundred
    apart = np.diff(np.flatnonzero(judged & ~repeats))
    # as often by chance, of ten steps, is none of 60 frames a second exported at 120, 180 or 240
    times = int(apart[0]) if len(apart) >= 10 and apart[0] > 1 and np.mean(apart == apart[0]) > 0.95 else 1
    if times == 1 and (alone**markers > 0.01 or (markers < 2 and np.mean(repeats[judged]) > 0.5)):
        return []  # markers stand still one by one, so that all of them may by chance
    length = np.linalg.norm(np.diff(values, axis=0), axis=-1)
    finite = np.isfinite(length)
    step = np.where(finite.any(axis=1), np.nansum(length, axis=1) / np.maximum(finite.sum(axis=1), 1), np.nan)
    usual = np.nanmedian(step[~repeats]) if np.isfinite(step[~repeats]).any() else np.inf
    # what turns, slower or faster by one step of rounding from frame to frame, is no faster beside a frame of rest
    moves = ~repeats & (step >= usual / 2) & (step > (BESIDE + 1) * rounding(values))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], repeats, [False]])))
    out = np.zeros(len(repeats), dtype=bool)
    for start, stop in edges.reshape(-1, 2):
        out[start:stop] = moves[max(0, start - BESIDE) : start].any() and moves[stop : stop + BESIDE].any()
    at = np.flatnonzero(repeats & out) + 1
    if not len(at):
        return []
    whose = "" if camera is None else f" of camera {camera!r}"
    cause = "the recording stalled, or frames were stored twice"
    if times > 1:
        cause = f"each frame is stored {times} times, so that the frame rate is {times} times that of the cameras"
    return [
        alarm(
            kind=Kind.REPEATED_FRAMES,
            text=f"{number_of(len(at), f'frame{whose} is', f'frames{whose} are')} identical to the previous frame in "
            f"every digit, while what is recorded moves before and after: {cause}",
            numbers={"frames": len(at), "share": len(at) / len(values), "times": times},
            cameras=() if camera is None else (camera,),
            frames=tuple(int(f) + 1 + first for f in sorted(set(map(int, at)))[:MOST]),
        )
    ]


def _copied_tracks(pixels: PixelTracks) -> list[Finding]:
    """Pairs of cameras, or of markers in one camera, whose pixels are the same numbers."""
    found = []
    for a in range(len(pixels.cameras)):
        for b in range(a):
            both = pixels.seen[a] & pixels.seen[b]
            same = (pixels.uv_px[a] == pixels.uv_px[b]).all(axis=-1) & both
            places = len(np.unique(pixels.uv_px[a][same], axis=0))  # one: where hidden points were left
            if places >= 5 and same.sum() > 0.05 * both.sum():  # by chance not one is the same in every digit
                names = (pixels.cameras[b], pixels.cameras[a])
                found.append(
                    alarm(
                        kind=Kind.COPIED_PIXELS,
                        text=f"{same.sum()} of {both.sum()} pixels of cameras {names[0]!r} and {names[1]!r} are "
                        "identical: one was copied from the other",
                        numbers={"samples": float(same.sum())},
                        cameras=names,
                    )
                )
    return found


def sizes(xyz_m: Array) -> list[Finding]:
    """Whether positions in metres have the size of an animal; reported, never changed."""
    ok = np.isfinite(xyz_m).all(axis=-1)
    if not ok.any():
        return []
    several = xyz_m[ok.sum(axis=1) >= 2]
    if len(several):
        spread = np.linalg.norm(several - np.nanmedian(several, axis=1, keepdims=True), axis=-1)
        size, what = 2 * float(np.nanmedian(spread)), "apart (median body size: twice the distance from the centre)"
        low, high = BODY_M
    else:
        places = xyz_m[ok]
        size, what = (
            float(np.linalg.norm(np.percentile(places, 95, axis=0) - np.percentile(places, 5, axis=0))),
            "from one end of the track to the other",
        )
        low, high = 1e-3, 300.0
    if size == 0 or low <= size <= high:
        return []
    better = next(
        (u for u, f in (("mm", 1e-3), ("cm", 1e-2), ("km", 1e3), ("m", 1.0)) if low <= size * f <= high), None
    )
    return [
        alarm(
            kind=Kind.UNITS,
            text=f"markers are {size:.3g} m {what}, which fits no animal: lengths may be in "
            f"{better or 'another unit'}; nothing was changed",
            numbers={"size_m": size},
        )
    ]


FAST = 1.5
"""A jump is faster by that factor than this quantile of all steps between neighbouring frames. Chosen: none of 200
clean recordings is accused (docs/experiments/audit_measured.md)."""
AROUND = 3
"""Samples before and after a jump, with no more than one frame missing between them, that move as usual: none of 200
clean recordings is accused (docs/experiments/audit_measured.md)."""
APART = 0.1
"""No jump is shorter than that share of the way to the nearest other marker: soft tissue and noise move one as far.
Chosen. It goes to another marker's place where it ends within that share of its own length from there."""


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
    return FAST * float(np.quantile(speed, 0.999)) if len(speed) >= 1000 else np.inf


@dataclass(frozen=True, kw_only=True)
class Jump:
    """A marker that goes from one place to another faster than it moves before and after.

    Attributes:
        marker: Its index.
        frames: From which frame to which, from 0.
        far_m: How far.
        speed_m_s: How fast.
        usual_m_s: Speed that 99.9 % of all steps stay below.
        other: Index of the marker that it is probably exchanged with; None: of none.
        near_m: How far that one is from where it goes, or was.
    """

    marker: int
    frames: tuple[int, int]
    far_m: float
    speed_m_s: float
    usual_m_s: float
    other: int | None = None
    near_m: float = 0.0


def jumps(xyz_m: Array, t_s: Array) -> tuple[Jump, ...]:
    """Markers that jump from one place to another, in one frame or in a hole of a few.

    A step is a jump where it is faster than ``usual_speed``, and far longer than the motion before and after it
    explains, while that motion itself is of usual speed: a single careless click is not a jump.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        t_s: (T,) times.
    """
    limit = usual_speed(xyz_m, t_s)
    if not np.isfinite(limit):
        return ()
    usual = limit / FAST
    found = []
    for m in range(xyz_m.shape[1]):
        frames = np.flatnonzero(np.isfinite(xyz_m[:, m, 0]))
        if len(frames) < 2 * AROUND:
            continue
        x, t = xyz_m[frames, m], t_s[frames]
        step, dt = np.diff(x, axis=0), np.diff(t)
        velocity = step / dt[:, None]
        speed, hole = np.linalg.norm(velocity, axis=-1), np.diff(frames)
        for i in np.flatnonzero((speed > limit) & (hole <= 6)):  # frames over which a jump may be hidden
            around = [*range(i - AROUND + 1, i), *range(i + 1, i + AROUND)]
            if around[0] < 0 or around[-1] >= len(step) or (speed[around] > usual).any() or (hole[around] > 2).any():
                continue
            drift = (velocity[around[: AROUND - 1]].mean(axis=0) + velocity[around[AROUND - 1 :]].mean(axis=0)) / 2
            left = float(np.linalg.norm(step[i] - drift * dt[i]))
            explained = float(np.max(speed[around])) * dt[i]
            # longer than speeds explain; between neighbouring frames a careless click looks like a jump
            if left < (4.0 if hole[i] == 1 else 2.5) * explained or left < 0.5 * np.linalg.norm(step[i]):
                continue
            far, ends = float(np.linalg.norm(step[i])), (int(frames[i]), int(frames[i + 1]))
            other, near = _nearest(xyz_m, m, ends)
            if far < APART * near:
                continue
            found.append(
                Jump(
                    marker=m,
                    frames=ends,
                    far_m=far,
                    speed_m_s=float(speed[i]),
                    usual_m_s=usual,
                    other=other if near < APART * far else None,
                    near_m=near,
                )
            )
    return tuple(found)


def jump_findings(
    xyz_m: Array, t_s: Array, names: Sequence[str], *, timed: bool = True, first: int = 0, length: str = "mm"
) -> list[Finding]:
    """One for each of the ``jumps`` of (T, M, 3) positions; see ``of_jumps``."""
    return of_jumps(jumps(xyz_m, t_s), names, timed=timed, first=first, length=length)


def of_jumps(
    found: Sequence[Jump], names: Sequence[str], *, timed: bool = True, first: int = 0, length: str = "mm"
) -> list[Finding]:
    """One for each jump.

    Args:
        found: The jumps.
        names: The M markers.
        timed: Whether the frame rate is known; else times are in frames, and so speeds are told.
        first: Frames of the recording before these.
        length: What a thousandth of the unit of positions is called: ``mm``, or ``px`` where they are pixels.
    """
    per = "/s" if timed else " per frame"
    with_unit = "{:.3g} m/s".format if timed and length == "mm" else (lambda speed: f"{1e3 * speed:.4g} {length}{per}")
    out = []
    for jump in found:
        name, (one, next_one) = str(names[jump.marker]), (frame + first + 1 for frame in jump.frames)
        cause = "probably a digitising error before or after"
        if jump.other is not None:
            cause = (
                f"probably swapped with {str(names[jump.other])!r}, {1e3 * jump.near_m:.4g} {length} away, before or "
                "after"
            )
        out.append(
            alarm(
                kind=Kind.JUMP,
                text=f"{name!r} jumps by {1e3 * jump.far_m:.4g} {length} between frames {one} and {next_one} "
                f"({with_unit(jump.speed_m_s)}; 99.9 % of all steps are slower than {with_unit(jump.usual_m_s)}): "
                f"{cause}: check these frames before filling",
                numbers={"length": jump.far_m, "speed": jump.speed_m_s, "usual_speed": jump.usual_m_s},
                markers=(name,),
                frames=(one, next_one),
            )
        )
    return out


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
