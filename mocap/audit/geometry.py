"""Calibration against pixels: mirrored worlds, copied or wrong cameras, flips, lens corrections not applied."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from mocap.audit.offsets import CLEAR_SD
from mocap.cameras.arrangement import FEWEST_SHARED, by_camera
from mocap.cameras.camera import Camera, decompose, flipped, may_be_cropped, pinhole_lens, stacked, undistorted
from mocap.cameras.origin import CLEARLY, PixelOrigin
from mocap.cameras.triangulate import linear, median_miss, residual_px, spread_points
from mocap.findings import Finding, Kind, alarm

LARGE_PX = 8.0
"""A median residual above this, and above ``CLEAR_SD`` deviations of the clicks' jitter, is warned of. Chosen, not
measured."""
OF_EXTENT = 0.02
"""A median residual above this share of what the pixels span is another calibration's: 20 px of 1000. Chosen."""
UNEVEN, LEAST_UNEVEN_PX = 3.0, 1.0
"""One camera's median residual is so many times another's, and so large, where that is a finding. Chosen: none of 200
clean recordings was accused (docs/experiments/audit_measured.md)."""


_MEANS = "names are correct, but positions and turns are mirrored"
"""Of a mirrored world: names come from the videos."""


def camera_findings(cameras: Sequence[Camera], *, y_up: bool | None) -> list[Finding]:
    """Cameras with identical calibrations, and mirrored worlds.

    Args:
        cameras: The C cameras.
        y_up: Whether the coefficients count pixel rows from the lower left; None: not known.
    """
    found = []
    parts = [decompose(c) for c in cameras]
    matrices = stacked(cameras)
    for i, b in enumerate(cameras):
        for j, a in enumerate(cameras[:i]):
            size = np.abs(matrices[j]).max(axis=1, keepdims=True)
            if (np.abs(matrices[i] - matrices[j]) < 1e-6 * size).all():
                found.append(
                    alarm(
                        kind=Kind.COPIED_CAMERAS,
                        text=f"cameras {a.name!r} and {b.name!r} have identical calibrations: one was copied from "
                        "the other, and points reconstructed with it are wrong, or both are tracks of one camera",
                        cameras=(a.name, b.name),
                    )
                )
    mirrored = [p.mirrored for p in parts]
    if any(mirrored) != all(mirrored):
        halves = 2 * sum(mirrored) == len(mirrored)  # either may be the mirrored one
        odd = 2 * sum(mirrored) < len(mirrored)
        fewer = [c.name for c, m in zip(cameras, mirrored, strict=True) if m == odd or halves]
        found.append(
            alarm(
                kind=Kind.MIRRORED_CAMERA,
                text=(
                    f"the calibrations of {_sides(cameras, mirrored)} are mirrored relative to each other: "
                    if halves
                    else f"the calibration of {', '.join(map(repr, fewer))} is mirrored relative to the other cameras: "
                )
                + "right if one films in a mirror, else its pixel rows were counted from another corner",
                cameras=tuple(fewer),
            )
        )
    elif mirrored[0] and y_up is not True:
        text = (
            f"the world is mirrored (left-handed): {_MEANS}: give a `calibration` with right-handed axes"
            if y_up is False
            else "the world is mirrored (left-handed), unless pixel rows are counted from the lower left: state "
            "`origin`"
        )
        mends = ("origin",) if y_up is None else None
        found.append(Finding(kind=Kind.MIRRORED_WORLD, alarm=y_up is False, text=text, mends=mends))
    elif y_up and not mirrored[0]:
        text = (
            f"the world is mirrored (left-handed), because pixel rows are counted from the lower left: {_MEANS}: state "
            "`origin` if rows are not counted so, or give a `calibration` with right-handed axes"
        )
        found.append(alarm(kind=Kind.MIRRORED_WORLD, text=text, mends=("origin", "calibration")))
    return found


def _sides(cameras: Sequence[Camera], mirrored: Sequence[bool]) -> str:
    """Half of the cameras, and the other half."""
    sides = [[repr(c.name) for c, m in zip(cameras, mirrored, strict=True) if m == side] for side in (True, False)]
    return " and of ".join(", ".join(side) for side in sides)


def handedness(cameras: Sequence[Camera], *, y_up: bool) -> bool | None:
    """Whether the cameras' world is left-handed; None: some are mirrored relative to the others.

    Args:
        cameras: The C cameras.
        y_up: Whether the coefficients count pixel rows from the lower left.
    """
    mirrored = [decompose(camera).mirrored for camera in cameras]
    return mirrored[0] != y_up if all(mirrored) or not any(mirrored) else None


def fit_findings(cameras: Sequence[Camera], ideal_px: Array) -> list[Finding]:
    """Cameras that do not belong to the pixels (``foreign``), or else rays that miss by much (``far_apart``)."""
    return foreign(cameras, ideal_px) or far_apart(cameras, ideal_px)


def foreign(cameras: Sequence[Camera], ideal_px: Array) -> list[Finding]:
    """Cameras that do not belong to the pixels.

    With three cameras or more, each is left out: where the rays of the others then meet four times as near, and clearly
    nearer than without any other, it is that camera.

    Args:
        cameras: The C cameras.
        ideal_px: (C, T, M, 2) ideal pixels, in their convention.
    """
    matrices, uv = stacked(cameras), spread_points(ideal_px, 3000)  # so many points judge
    if len(cameras) < 2 or uv.shape[1] < 5:
        return []
    whole = median_miss(matrices, uv)
    extent = float(np.nanmax(uv) - np.nanmin(uv))
    left = [
        median_miss(np.delete(matrices, c, axis=0), np.delete(uv, c, axis=0)) if len(cameras) > 2 else np.inf
        for c in range(len(cameras))
    ]
    order = np.argsort(left)
    worst = int(order[0])
    scatter = jitter_px(ideal_px[worst : worst + 1])
    clicked = CLEAR_SD * scatter if scatter else LARGE_PX  # careless clicks miss by no more
    # four times as near, and twice as near as without another: all planted ones of 20 px are found
    # (docs/experiments/audit_measured.md)
    if left[worst] * 4 < whole and left[worst] * 2 < left[int(order[1])] and whole > max(1.0, clicked):
        camera = cameras[worst]
        return [
            alarm(
                kind=Kind.FOREIGN_CAMERA,
                text=f"the calibration of camera {camera.name!r} does not fit its pixels: median triangulation "
                f"residual {whole:.1f} px with this camera, {left[worst]:.2f} px without it",
                numbers={"with_px": whole, "without_px": left[worst]},
                cameras=(camera.name,),
            )
        ]
    if (uneven := _uneven(cameras, ideal_px, uv)) is not None:
        return [uneven]
    if whole > max(_near_enough(ideal_px), OF_EXTENT * extent):
        cropped = may_be_cropped(cameras, ideal_px)
        return [
            alarm(
                kind=Kind.FOREIGN_CALIBRATION,
                text=f"median triangulation residual {whole:.0f} px, while the pixels themselves span only "
                f"{extent:.0f} px: " + (cropped or "the calibration does not belong to these pixels"),
                numbers={"residual_px": whole, "extent_px": extent},
                cameras=tuple(c.name for c in cameras),
            )
        ]
    return []


def _near_enough(ideal_px: Array) -> float:
    """A median residual that nobody is warned of: careless clicks let rays meet no nearer."""
    return max(LARGE_PX, CLEAR_SD * jitter_px(ideal_px))


def far_apart(cameras: Sequence[Camera], ideal_px: Array) -> list[Finding]:
    """Rays that miss each other by more than their clicks explain; see ``fit_findings``."""
    matrices, uv = stacked(cameras), spread_points(ideal_px, 3000)  # as ``foreign``
    if len(cameras) < 2 or uv.shape[1] < 5:
        return []
    whole, jitter = median_miss(matrices, uv), jitter_px(ideal_px)
    if whole <= _near_enough(ideal_px):
        return []
    against = f", {whole / jitter:.0f} times the jitter of the clicks ({jitter:.2f} px)" if jitter else ""
    return [
        alarm(
            kind=Kind.LARGE_RESIDUAL,
            text=f"WARNING: the median triangulation residual is {whole:.1f} px{against}: "
            "3D points are wrong by about as much: check cameras, lenses and the order of the files",
            numbers={"residual_px": whole, "jitter_px": jitter},
            cameras=tuple(c.name for c in cameras),
        )
    ]


def _uneven(cameras: Sequence[Camera], ideal_px: Array, uv: Array) -> Finding | None:
    """Cameras whose points miss by ``UNEVEN`` times as much as another's, and by more than their clicks scatter.

    Args:
        cameras: The C cameras.
        ideal_px: (C, T, M, 2) ideal pixels.
        uv: (C, K, 2) those of points to judge by.
    """
    matrices = stacked(cameras)
    own = by_camera(residual_px(matrices, uv, linear(matrices, uv)), np.isfinite(uv[..., 0]))
    own[np.isfinite(uv[..., 0]).sum(axis=1) < FEWEST_SHARED] = np.nan
    if not np.isfinite(own).any():
        return None
    scatter = np.array([jitter_px(one[None]) or np.inf for one in ideal_px])  # where it is not known, clicks may be it
    best = int(np.nanargmin(own))
    bad = (own > UNEVEN * own[best]) & (own > np.maximum(CLEAR_SD * scatter, LEAST_UNEVEN_PX))
    if not bad.any():
        return None
    names = [c.name for c in cameras]
    each = ", ".join(f"{names[c]!r} {own[c]:.1f} px" for c in np.flatnonzero(bad))
    return alarm(
        kind=Kind.UNEVEN_CAMERAS,
        text=f"WARNING: some cameras have far larger reprojection errors: {each} (median), {names[best]!r} "
        f"{own[best]:.2f} px, and their points scatter less: their calibration, lens or pixels are wrong",
        numbers={"worst_px": float(np.nanmax(own)), "best_px": float(own[best])},
        cameras=tuple(names[c] for c in np.flatnonzero(bad)),
    )


def jitter_px(ideal_px: Array) -> float:
    """Standard deviation of clicks from frame to frame, by third differences (variance 20 times theirs); 0: unknown."""
    uv = ideal_px.reshape(len(ideal_px), ideal_px.shape[1], -1)
    third = np.abs(np.diff(uv, n=3, axis=1))
    third = third[np.isfinite(third)]
    return float(np.median(third)) / (0.6745 * np.sqrt(20.0)) if len(third) >= 30 else 0.0


@dataclass(frozen=True, kw_only=True)
class HiddenLens:
    """Distortion that the pixels show and no file states.

    Attributes:
        k1: Radial coefficient that all cameras have alike.
        plain_px: Median residual without it.
        with_px: Median residual with it.
    """

    k1: float
    plain_px: float
    with_px: float

    def finding(self) -> Finding:
        """What to do about it."""
        return alarm(
            kind=Kind.DISTORTION,
            text=f"the pixels look distorted{' (or focal lengths are wrong)' if self.k1 > 0 else ''}, and no lens is "
            f"given: with k1 = {self.k1:.2f} in all cameras the "
            f"median triangulation residual falls from {self.plain_px:.2f} px to {self.with_px:.2f} px: give the "
            "camera profile (`profile`), or have it estimated with `fit_lens`",
            numbers={"k1": self.k1, "plain_px": self.plain_px, "with_k1_px": self.with_px},
        )


def lens_findings(cameras: Sequence[Camera], uv_px: Array, decision: PixelOrigin) -> list[Finding]:
    """What is found of lenses: ``hidden_lens`` where none is given, else ``applied_lens``."""
    if any(c.lens is not None for c in cameras):
        return applied_lens(cameras, uv_px, decision)
    hidden = hidden_lens(cameras, uv_px, decision)
    return [] if hidden is None else [hidden.finding()]


def applied_lens(cameras: Sequence[Camera], uv_px: Array, decision: PixelOrigin) -> list[Finding]:
    """Whether the lens correction belongs applied once, not at all or twice.

    Args:
        cameras: The C cameras.
        uv_px: (C, T, M, 2) pixels as in the file.
        decision: Where rows are counted from.
    """
    matrices, uv = stacked(cameras), spread_points(uv_px, 2000)  # so many points judge
    if len(cameras) < 2 or uv.shape[1] < 20:
        return []
    once = decision.ideal(cameras, uv)
    back = flipped(once, decision.height_px) if decision.coefficients == "lower-left" else once
    twice = undistorted(cameras, back)
    twice = flipped(twice, decision.height_px) if decision.coefficients == "lower-left" else twice
    bare = [replace(c, lens=None) for c in cameras]
    tried = {
        "not at all": median_miss(matrices, decision.ideal(bare, uv)),
        "once": median_miss(matrices, once),
        "twice": median_miss(matrices, twice),
    }
    best = min(tried, key=lambda k: tried[k])
    rest = min(v for k, v in tried.items() if k != best)
    clear = tried[best] * CLEARLY < rest
    numbers = {f"{k.replace(' ', '_')}_px": v for k, v in tried.items()}
    if best == "once" or not clear:
        text = (
            f"lens correction applied once: median triangulation residual {tried['once']:.3f} px with it, "
            f"{tried['not at all']:.3f} px without it"
        )
        return [Finding(kind=Kind.DISTORTION, alarm=False, text=text, numbers=numbers)]
    why = (
        "the pixels are already undistorted (leave the camera profile out), or the lens is another camera's"
        if best == "not at all"
        else "the lenses bend more than the profile states, or the coefficients are of pixels undistorted twice"
    )
    return [
        alarm(
            kind=Kind.DISTORTION,
            mends=("profile",),
            text=f"the triangulation residual is smallest with the lens correction applied {best} "
            f"({tried[best]:.3f} px; applied once: {tried['once']:.3f} px): {why}",
            numbers=numbers,
        )
    ]


def hidden_lens(cameras: Sequence[Camera], uv_px: Array, decision: PixelOrigin) -> HiddenLens | None:
    """One radial coefficient k1 for all cameras, about their principal points, that lowers the residual.

    Args:
        cameras: The C cameras, without lenses.
        uv_px: (C, T, M, 2) pixels as in the file.
        decision: Where rows are counted from.
    """
    from scipy.optimize import minimize_scalar

    pixels = spread_points(uv_px, 2000)  # so many points judge
    if len(cameras) < 2 or pixels.shape[1] < 20:
        return None
    uv = decision.ideal(cameras, pixels)
    lenses, matrices = [*map(pinhole_lens, cameras)], stacked(cameras)

    def miss(k1: float) -> float:
        bent = [replace(u, k=(k1, 0.0, 0.0)).undistort(p) for u, p in zip(lenses, uv, strict=True)]
        return median_miss(matrices, np.stack(bent))

    plain = miss(0.0)
    grid = np.linspace(-0.45, 0.45, 19)
    values = [miss(k) for k in grid]
    at = int(np.argmin(values))
    if not 0 < at < len(grid) - 1:
        return None
    best = minimize_scalar(miss, bounds=(grid[at - 1], grid[at + 1]), method="bounded", options={"xatol": 1e-3})
    # by chance it falls by 1.1 % (200 recordings); errors of focal lengths of 0.5 % look like pincushion distortion,
    # and lower it by as much (docs/experiments/audit_measured.md)
    if best.fun * (1.1 if best.x < 0 else CLEARLY) > plain or abs(best.x) < 0.02:
        return None
    return HiddenLens(k1=float(best.x), plain_px=plain, with_px=float(best.fun))
