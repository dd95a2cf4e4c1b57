"""Stored 3D points against the triangulation of the stored pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.triangulate import linear, residual_px
from mocap.findings import MOST, Finding, Kind, alarm
from mocap.io.rounding import rounding
from mocap.records import MarkerTracks
from mocap.text import number_of

PRINTED_M = 2e-6
"""Stored points and their triangulation differ by less: the print precision of the files leaves 1e-6."""


@dataclass(frozen=True, kw_only=True)
class StalePoint:
    """A stored point that differs from the triangulation of its pixels.

    Attributes:
        frame: Row of the file, from 1.
        marker: Its name.
        off_m: Distance from the triangulated point; None where the pixels give no point.
    """

    frame: int
    marker: str
    off_m: float | None


def stale_points(xyz_m: Array, stored: MarkerTracks) -> list[StalePoint]:
    """Stored points further than ``PRINTED_M`` from those that the pixels give, or that the pixels do not give.

    Args:
        xyz_m: (T, M, 3) linear triangulation of the pixels.
        stored: The stored points of the same frames and markers.

    Raises:
        ValueError: the stored points have another number of frames or markers.
    """
    if stored.xyz_m.shape != xyz_m.shape:
        raise ValueError(
            f"stored points are {stored.xyz_m.shape[:2]} (frames, markers), the pixels give {xyz_m.shape[:2]}: "
            "the files do not belong together"
        )
    off = np.linalg.norm(xyz_m - stored.xyz_m, axis=-1)
    stale = stored.seen & ~(off <= PRINTED_M)
    return [
        StalePoint(frame=int(t) + 1, marker=stored.names[m], off_m=float(off[t, m]) if np.isfinite(off[t, m]) else None)
        for t, m in np.argwhere(stale)
    ]


def stored_findings(matrices: Array, ideal_px: Array, stored: MarkerTracks, *, cameras: Sequence[str]) -> list[Finding]:
    """Why most stored points differ from the triangulation of their pixels, where they do.

    Tried are: another marker's columns, another time, and a linear solve that took one camera's v row only, as Argus's
    does. A few points off are stale (``stale_points``): their pixels were edited later.

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, T, M, 2) ideal pixels.
        stored: The stored points of the same frames and markers.
        cameras: Names.
    """
    xyz = linear(matrices, ideal_px)
    both = stored.seen & np.isfinite(xyz[..., 0])
    if not both.any():
        return []
    off = np.linalg.norm(xyz - stored.xyz_m, axis=-1)
    share = float(np.mean(off[both] <= PRINTED_M))
    found = _columns(xyz, stored, both)
    named = {m for f in found for m in f.markers}
    rest = both & ~np.isin(stored.names, list(named))
    if rest.any() and np.mean(off[rest] <= PRINTED_M) < 0.5:  # edits are of fewer than half of the points
        found += _shifted(xyz, stored) or _half_solve(matrices, ideal_px, stored, cameras)
    if found or share == 1.0:
        return found
    if (elsewhere := other_world(xyz, stored)) is not None:
        return [elsewhere]
    wrong = both & ~(off <= max(PRINTED_M, rounding(stored.xyz_m)))  # sqrt(3) / 2 of a step at most
    if not wrong.any():
        return []
    text = (
        f"{wrong.sum()} of {both.sum()} stored points differ from the triangulation of their pixels (median "
        f"{np.median(off[wrong]):.2g} m, up to {off[wrong].max():.2g} m)"
    )
    ours, theirs = (float(np.median(residual_px(matrices, ideal_px, points)[wrong])) for points in (xyz, stored.xyz_m))
    # a tenth more, as of distortion (``mocap.audit.geometry``); chosen
    as_good = share <= 0.5 and theirs < 1.1 * ours  # linear least squares: they fit as well
    cause = (
        f"they fit the pixels as well ({theirs:.2f} px, {ours:.2f} px by linear least squares): another method"
        if as_good
        else "the pixels were edited after the points had been computed, or the points themselves were"
        if share > 0.5
        else "they were computed with another calibration or from other pixels, or smoothed"
    )
    return [
        Finding(
            kind=Kind.STALE_POINTS,
            alarm=not as_good,
            text=f"{text}: {cause}",
            numbers={
                "points": int(wrong.sum()),
                "share": float(wrong.sum() / both.sum()),
                "most_m": float(off[wrong].max()),
            },
            markers=tuple(n for n, w in zip(stored.names, wrong.any(axis=0), strict=True) if w),
            frames=tuple(int(t) + 1 for t in np.flatnonzero(wrong.any(axis=1))[:MOST]),
        )
    ]


def other_world(xyz_m: Array, stored_points: MarkerTracks) -> Finding | None:
    """Whether stored points are those of the pixels in another world: turned, shifted, scaled, mirrored or sheared.

    Two calibrations of the same cameras, or of cameras near the same places, give worlds that an affine map takes into
    each other. It is fitted to the nearer half of the points, again and again.

    Args:
        xyz_m: (T, M, 3) linear triangulation of the pixels.
        stored_points: The stored points of the same frames and markers.
    """
    both = stored_points.seen & np.isfinite(xyz_m[..., 0])
    xyz, stored = xyz_m[both], stored_points.xyz_m[both]
    # an affine map has 12 numbers: 4 points fit any, 12 tell three times over
    if len(xyz) < 12 or np.mean(np.linalg.norm(xyz - stored, axis=-1) <= PRINTED_M) > 0.5:
        return None
    ones = np.concatenate([xyz, np.ones((len(xyz), 1))], axis=1)
    keep = np.ones(len(xyz), dtype=bool)
    for _ in range(10):
        affine = np.linalg.lstsq(ones[keep], stored[keep], rcond=None)[0]
        off = np.linalg.norm(ones @ affine - stored, axis=-1)
        keep = off <= np.median(off)
    apart = float(np.median(np.linalg.norm(xyz - stored, axis=-1)))
    left = float(np.median(off))
    spread = float(np.median(np.linalg.norm(stored - np.median(stored, axis=0), axis=-1)))
    scale = float(np.cbrt(np.abs(np.linalg.det(affine[:3]))))
    # of worlds that differ by a twentieth of the scene, the map leaves a tenth, and 2 % of the scene; chosen
    if left > 0.1 * apart or left > 0.02 * spread or apart < 0.05 * spread:
        return None
    return alarm(
        kind=Kind.ANOTHER_WORLD,
        text=f"the stored points are in another world than this calibration's: they differ by {apart:.3g} m (median), "
        f"by {left:.2g} m after turning, shifting and scaling by {scale:.4g}: they were computed with another "
        "calibration, or turned or scaled afterwards, and are not compared",
        numbers={"apart_m": apart, "left_m": left, "scale": scale},
    )


def _agree(a: Array, b: Array) -> tuple[float, int]:
    """Share of the points that agree, of those that both have, and how many these are."""
    off = np.linalg.norm(a - b, axis=-1)
    ok = np.isfinite(off)
    return (float(np.mean(off[ok] <= PRINTED_M)), int(ok.sum())) if ok.any() else (0.0, 0)


def _columns(xyz: Array, stored: MarkerTracks, both: NDArray[np.bool_]) -> list[Finding]:
    found = []
    for m, name in enumerate(stored.names):
        if (
            not both[:, m].any() or _agree(xyz[:, m], stored.xyz_m[:, m])[0] > 0.2
        ):  # between none, of other columns, and all
            continue
        shares = [_agree(xyz[:, k], stored.xyz_m[:, m]) for k in range(len(stored.names))]
        k = max(range(len(shares)), key=lambda k: shares[k])
        if shares[k][0] > 0.8 and shares[k][1] >= 3:  # by chance none agrees to micrometres
            found.append(
                alarm(
                    kind=Kind.WRONG_COLUMNS,
                    text=f"stored points of {name!r} are those of {stored.names[k]!r}: their columns are swapped",
                    numbers={"share": shares[k][0], "points": shares[k][1]},
                    markers=(name, stored.names[k]),
                )
            )
    return found


def _shifted(xyz: Array, stored: MarkerTracks) -> list[Finding]:
    n = len(xyz)
    most = min(50, n - 1)  # frames that are tried: what a digitiser's offset may be; chosen
    shares = {
        s: _agree(xyz[max(0, -s) : n - max(0, s)], stored.xyz_m[max(0, s) : n - max(0, -s)])
        for s in range(-most, most + 1)
        if s
    }
    s = max(shares, key=lambda s: shares[s][0], default=0)
    if not s or shares[s][0] < 0.5 or shares[s][1] < 5:  # by chance none agrees to micrometres
        return []
    return [
        alarm(
            kind=Kind.TIME_SHIFT,
            text=f"stored points are {number_of(abs(s), 'frame')} {'later' if s > 0 else 'earlier'} than their pixels "
            f"({shares[s][0] * 100:.0f} % agree when shifted by that)",
            numbers={"frames": s, "share": shares[s][0]},
        )
    ]


def _half_solve(matrices: Array, ideal_px: Array, stored: MarkerTracks, cameras: Sequence[str]) -> list[Finding]:
    """Whether stored points are linear least squares with all u rows and the v row of one camera."""
    for c, name in enumerate(cameras):
        points = _one_v_row(matrices, ideal_px, c)
        share, count = _agree(points, stored.xyz_m)
        if share > 0.5 and count >= 5:
            return [
                alarm(
                    kind=Kind.ONE_V_ROW,
                    text=f"stored points were computed from the x pixels of all cameras but the y pixels of camera "
                    f"{name!r} only, as Argus does ({share * 100:.0f} % agree with that): triangulate them again",
                    numbers={"share": share, "points": count},
                    cameras=(name,),
                )
            ]
    return []


def _one_v_row(matrices: Array, ideal_px: Array, camera: int) -> Array:
    """(T, M, 3) linear solutions from all u and one camera's v; NaN where these are too few."""
    scaled = matrices / matrices[:, 2:, 3:]
    uv = ideal_px.reshape(len(matrices), -1, 2)
    rows_u = scaled[:, None, 0] - uv[..., :1] * scaled[:, None, 2]
    row_v = scaled[camera, None, 1] - uv[camera, :, 1:] * scaled[camera, None, 2]
    rows = np.concatenate([np.moveaxis(rows_u, 0, 1), row_v[:, None]], axis=1)
    enough = np.isfinite(rows[..., 0]).sum(axis=1) >= 3
    enough &= np.isfinite(row_v[:, 0])
    rows = np.nan_to_num(rows)
    out = np.full((len(rows), 3), np.nan)
    for i in np.flatnonzero(enough):
        out[i] = np.linalg.lstsq(rows[i, :, :3], -rows[i, :, 3], rcond=None)[0]
    return out.reshape(*ideal_px.shape[1:3], 3)
