"""The corner that pixel rows are counted from: stated by the user, or chosen by the smaller triangulation residual.

DLTdv 5 to 7 count from the lower left, version 8 from the upper left, and nothing in a file records it. Lenses are
always described from the upper left. A file whose pixels and coefficients disagree triangulates to rays that miss by
tens of pixels; one whose lens is applied upside down by a few.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from eal.arrays import Array
from mocap.bounds import check_stated
from mocap.cameras.arrangement import (
    BETTER,
    LOOKED_AT_PX,
    ArrangementError,
    by_camera,
    find_arrangement,
    guessed_heights,
)
from mocap.cameras.camera import Camera, flipped, may_be_cropped, stacked, undistorted
from mocap.cameras.triangulate import linear, median_miss, residual_px, spread_points
from mocap.errors import CalibrationError, MocapError
from mocap.records import BOTH, PixelCorner

CLEARLY = 1.2
"""A choice is clear where the next best leaves a residual so many times as large. Chosen: errors of
focal lengths of 0.5 % look like distortion, and lower it by as much (docs/experiments/audit_measured.md)."""

AS_PROGRAMS_DO = 1.5
"""Pixels and coefficients count from one corner, as programs write them, unless another choice fits so many times as
well. Chosen: above ``CLEARLY``, as a file of two corners is rare."""
MISFIT, MISFIT_PX = 0.03, 10.0
"""Pixels and a calibration belong to each other where the median residual is up to so large a share of what the points
span, and in any case up to so many pixels. Chosen: a calibration of another session misses by a tenth of the image and
more, careless digitising and a lens that is not corrected by a hundredth."""


class OriginError(CalibrationError):
    """The corner cannot be told from one file; other files of its session may tell."""

    page = "conventions"
    mends = ("origin",)


@dataclass(frozen=True, kw_only=True)
class PixelOptions:
    """What is stated of pixels, from which the rest is decided.

    Attributes:
        origin: Corner of the pixels.
        calibration_origin: Corner of the coefficients.
        image_height_px: Image height, for flips.
        usual: Corner from which the program that wrote the pixels counts.
        correct_lag: Whether cameras that run late by the audit are read between their frames.
        fit_lens: Whether radial distortion is estimated from the recording and corrected.
    """

    origin: PixelCorner | None = None
    calibration_origin: PixelCorner | None = None
    image_height_px: float | None = None
    usual: PixelCorner | None = None
    correct_lag: bool = False
    fit_lens: bool = False

    def __post_init__(self) -> None:
        """Check what the user states."""
        check_stated("image_height_px", self.image_height_px)
        for name in ("origin", "calibration_origin"):
            corner = getattr(self, name)
            if corner not in (None, *BOTH):
                raise MocapError(f"`{name}` is {corner!r}, expected {' or '.join(BOTH)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class PixelOrigin:
    """The decision on where pixels are counted from, and what it rests on.

    Attributes:
        pixels: Corner of the pixel file.
        coefficients: PixelCorner that the coefficients were calibrated with.
        stated: Whether the user stated the origin of the pixels.
        matters: Whether the points depend on the decision at all.
        height_px: Image height that flips use; None where nothing is flipped.
        residual_px: Median triangulation residual of the decision.
        next_px: That of the best choice that would have given other points; inf where there is none.
        usual: Whether it is how the program that wrote the pixels counts.
        guessed: Whether pixels and coefficients were found to count from different corners, and nobody stated it.
    """

    pixels: PixelCorner
    coefficients: PixelCorner
    stated: bool
    matters: bool
    height_px: float | None
    residual_px: float
    next_px: float
    guessed: bool = False
    usual: bool = False

    @property
    def y_up(self) -> bool | None:
        """Whether the coefficients count rows from the lower left; None: nobody states it, and nothing depends on it.

        It is known where the user states the corner, where the program that wrote the pixels has one, and where another
        would give other points.
        """
        known = self.stated or self.matters or self.usual
        return self.coefficients == "lower-left" if known else None

    def describe(self) -> str:
        """One sentence for reports."""
        if not self.matters:
            source = "as stated" if self.stated else "not stated; the other corner would give the same points"
            return f"pixel origin {self.pixels} ({source}); residual {self.residual_px:.2f} px"
        margin = "" if np.isinf(self.next_px) else f", {self.next_px:.2f} px otherwise"
        flip = "" if self.pixels == self.coefficients else f"; coefficients from the {self.coefficients}"
        if self.guessed:
            flip += " (not stated, found by the residual: state `origin` and `calibration_origin`)"
        chosen = "as its program counts" if self.usual else "chosen by the smaller residual"
        how = "as stated" if self.stated else chosen
        return f"pixel origin {self.pixels} {how}{flip}; residual {self.residual_px:.2f} px{margin}"

    def ideal(self, cameras: Sequence[Camera], uv_px: Array, *, iterations: int | None = None) -> Array:
        """Undistorted pixels in the convention of the coefficients.

        Args:
            cameras: The C cameras.
            uv_px: (C, ..., 2) pixels as recorded.
            iterations: As in ``BrownLens.undistort``.
        """
        if all(c.lens is None for c in cameras) and self.pixels == self.coefficients:
            return uv_px
        uv = flipped(uv_px, self.height_px) if self.pixels == "lower-left" else uv_px
        uv = undistorted(cameras, uv, iterations=iterations)
        return flipped(uv, self.height_px) if self.coefficients == "lower-left" else uv


def decide_origin(
    cameras: Sequence[Camera],
    uv_px: Array,
    options: PixelOptions = PixelOptions(),
) -> PixelOrigin:
    """Decide where pixels are counted from.

    Every choice that the user's statements allow is triangulated; the one with the smallest median residual is taken if
    it is clear or if the others give the same points. Programs count pixels and coefficients from the same corner, and
    each from a corner of its own: such a choice is taken unless another fits ``AS_PROGRAMS_DO`` times as well.

    Args:
        cameras: The C cameras, lenses from the upper left.
        uv_px: (C, T, M, 2) pixels as recorded.
        options: What is stated; an image height that is not is the profile's or twice its principal point.

    Raises:
        ArrangementError: the pixels fit only with mirrored axes, shifted, or with the cameras in another order.
        OriginError: choices that give different points fit alike.
        CalibrationError: the pixels fit no choice, or what was stated fits clearly worse than what
            was not.
    """
    uv = spread_points(uv_px, 4000)  # so many points judge
    corner, coefficients, height_px = options.origin, options.calibration_origin, options.image_height_px
    lens = any(c.lens is not None for c in cameras)
    heights = [height_px] if height_px is not None else image_heights(cameras)
    tried: list[tuple[float, PixelCorner, PixelCorner, float | None, Array]] = []
    matrices = stacked(cameras)

    @cache
    def straight(pixels: PixelCorner, height: float | None) -> Array:
        return undistorted(cameras, flipped(uv, height) if pixels == "lower-left" else uv)

    for pixels in BOTH:
        for calibrated in BOTH:
            flips = pixels != calibrated or (lens and pixels == "lower-left")
            for height in heights if flips else [None]:
                if flips and height is None:
                    continue
                ideal = uv
                if flips or lens:
                    ideal = straight(pixels, height if pixels == "lower-left" else None)
                    ideal = flipped(ideal, height) if calibrated == "lower-left" else ideal
                tried.append((median_miss(matrices, ideal), pixels, calibrated, height, ideal))
    tried.sort(key=lambda t: t[0])
    allowed = [t for t in tried if corner in (None, t[1]) and coefficients in (None, t[2])]
    if not allowed:
        raise CalibrationError(
            "the stated pixel origins differ, but the image height is not known: give `image_height_px`"
        )
    as_programs_do = [
        t for t in allowed if t[1] == t[2] == (options.usual or t[1]) and t[0] <= AS_PROGRAMS_DO * allowed[0][0]
    ]
    allowed = as_programs_do or allowed
    alike = [t for t in allowed if _same(t, allowed[0])]
    best = min(alike, key=lambda t: (t[1] != t[2], BOTH.index(t[1])))
    own = by_camera(residual_px(matrices, best[4], linear(matrices, best[4])), np.isfinite(best[4][..., 0]))
    worst = float(np.nanmax(own, initial=0.0))  # of the camera whose points fit worst: a good half does not hide it
    found = find_arrangement(cameras, uv_px, height_px=height_px) if worst > LOOKED_AT_PX else None
    if found is not None and BETTER * found.undone_px < worst:
        raise ArrangementError(replace(found, residual_px=worst))
    size = float(np.nanmax(uv_px, initial=1.0) - np.nanmin(uv_px, initial=0.0))
    if best[0] > max(MISFIT * size, MISFIT_PX):
        cropped = may_be_cropped(cameras, uv_px)
        if cropped is not None:
            raise CalibrationError(
                f"the median triangulation residual is {best[0]:.0f} px: {cropped} (or the calibration does not "
                "belong to these pixels)"
            )
        guessed = None if height_px is not None else guessed_heights(cameras)
        why = f": principal points put it at {guessed[0]:.0f} to {guessed[1]:.0f}" if guessed is not None else ""
        raise CalibrationError(
            f"the median triangulation residual is {best[0]:.0f} px: these pixels and this calibration do not fit "
            "together: check that they are of one session, that their cameras are in one order and count rows from one "
            f"corner (give `image_height_px` so that vertical flips are tried{why}), and that a lens is not missing"
        )
    others = [t for t in allowed if not _same(t, best)]
    if others and others[0][0] < CLEARLY * best[0]:
        raise OriginError(
            f"the pixel origin cannot be determined: residual {best[0]:.2f} px for {_name(best)}, "
            f"{others[0][0]:.2f} px for {_name(others[0])}: state `origin`"
        )
    better = [t for t in tried if t[0] * CLEARLY < best[0] and best[0] - t[0] > 0.5]
    if better and (corner or coefficients):
        raise CalibrationError(
            f"the stated pixel origin does not fit: residual {best[0]:.2f} px for {_name(best)}, "
            f"{better[0][0]:.2f} px for {_name(better[0])}: state that, or check the calibration"
        )
    rest = [t[0] for t in tried if not _same(t, best)]
    return PixelOrigin(
        pixels=best[1],
        coefficients=best[2],
        stated=corner is not None,
        matters=all(t[1] == best[1] for t in tried if _same(t, best)),
        height_px=best[3],
        residual_px=best[0],
        next_px=min(rest, default=np.inf),
        usual=best[1] == best[2] == options.usual,
        guessed=best[1] != best[2] and (corner is None or coefficients is None),
    )


def origin_alone(cameras: Sequence[Camera], options: PixelOptions) -> PixelOrigin:
    """The same of pixels whose rays never meet, so that nothing tells: as stated, or as programs count."""
    corner = options.origin or options.usual or options.calibration_origin or "upper-left"
    return PixelOrigin(
        pixels=corner,
        coefficients=options.calibration_origin or corner,
        stated=options.origin is not None,
        matters=False,
        height_px=options.image_height_px or image_heights(cameras)[0],
        residual_px=np.nan,
        next_px=np.inf,
    )


def image_heights(cameras: Sequence[Camera]) -> list[float | None]:
    """Image heights that a profile suggests: its own, and twice the principal point where all cameras share that.

    A real profile states 320 rows with every principal point at 256: a typo that flips must not fall for.
    """
    heights = {float(c.size_px[1]) for c in cameras if c.size_px is not None}
    centres = {2 * c.lens.centre_px[1] for c in cameras if c.lens is not None}
    found: list[float | None] = [*sorted(heights | (centres if len(centres) == 1 else set()))]
    return found or [None]


def _same(a: tuple, b: tuple) -> bool:
    """Whether two choices give the same ideal pixels, to a twentieth of the residual (then so are the points)."""
    apart = np.linalg.norm(a[4] - b[4], axis=-1)
    return not apart.size or bool(np.nanmedian(apart) <= 0.05 * b[0] + 1e-6)


def _name(choice: tuple) -> str:
    text = f"{choice[1]} pixels" if choice[1] == choice[2] else f"{choice[1]} pixels with {choice[2]} coefficients"
    return text + (f" (image height {choice[3]:g})" if choice[3] is not None else "")
