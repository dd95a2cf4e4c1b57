"""Strokes of limbs that beat: the plane, the angle in it, the deviation from it, the phase."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, cross
from mocap.filters.velocities import Motion
from mocap.kinematics import angles
from mocap.kinematics.delta import Naming, Points, called, with_rates
from mocap.kinematics.records import Quantity
from mocap.skeleton import Skeleton


@dataclass(frozen=True, eq=False, kw_only=True)
class StrokePlane:
    """The plane in which a limb beats, in axes of the trunk.

    Attributes:
        out: (3,) its first axis: the middle of the stroke.
        up: (3,) its second axis, towards the upper end of the stroke.
        normal: (3,) its normal, ahead.
        inclination_rad: Angle between the stroke plane and the trunk's transverse plane (normal to its long axis).
    """

    out: Array
    up: Array
    normal: Array
    inclination_rad: float


def stroke_plane(direction: Array) -> StrokePlane | None:
    """The plane through the root in which unit directions (T, 3) in trunk axes (ahead, left, up) lie best.

    It contains the two axes of largest second moment of the directions about the root; ``out`` is the mean direction
    in it. None: fewer than four directions, or all alike.
    """
    there = direction[np.isfinite(direction).all(axis=1)]
    if len(there) < 4:
        return None
    value, vectors = np.linalg.eigh(there.T @ there / len(there))
    if value[1] < 1e-6:
        return None
    normal = vectors[:, 0]
    mean = there.mean(axis=0)
    out = angles.unit(mean - (mean @ normal) * normal)
    up = cross(normal, out)
    up, normal = (vector if vector[axis] >= 0 else -vector for vector, axis in ((up, 2), (normal, 0)))
    return StrokePlane(out=out, up=up, normal=normal, inclination_rad=float(np.arccos(min(1.0, abs(normal[0])))))


def stroke_function(plane: StrokePlane, *, deviation: bool) -> Callable[[Array], Array]:
    """Stroke angle of six points (trunk's forward and left lines, root, tip), or its deviation from the plane, rad."""

    def angle(x: Array) -> Array:
        frame = angles.frames_of_four(x[:, :4])
        along = np.einsum("tji,tj->ti", frame, x[:, 5] - x[:, 4])
        first, second, third = along @ plane.out, along @ plane.up, along @ plane.normal
        return np.arctan2(third, np.hypot(first, second)) if deviation else np.arctan2(second, first)

    return angle


def stroke_quantities(motion: Motion, skeleton: Skeleton) -> list[Quantity]:
    """Stroke angle, deviation and phase of every stated stroke; none where the trunk's axes are not stated."""
    measures = skeleton.measures
    if measures.forward is None or measures.left is None:
        return []
    out: list[Quantity] = []
    four = [motion.xyz_m[:, motion.index(marker)] for marker in (*measures.forward, *measures.left)]
    frame = angles.frames_of_four(np.stack(four, axis=1))  # columns: ahead, left, up
    for name, (root, tip) in measures.strokes.items():
        away = motion.xyz_m[:, motion.index(tip)] - motion.xyz_m[:, motion.index(root)]
        plane = stroke_plane(angles.unit(np.einsum("tji,tj->ti", frame, away)))
        if plane is None:
            continue
        points = Points.of(motion, (*measures.forward, *measures.left, root, tip))
        inclined = f"stroke plane {np.degrees(plane.inclination_rad):.1f} degrees from the trunk's transverse plane"
        stroke = Naming(
            f"{name}_stroke",
            "deg",
            f"angle of the line from {root} to {tip} in its stroke plane, up is positive; {inclined}",
            "stroke",
        )
        found = with_rates(points, stroke_function(plane, deviation=False), stroke)
        aside = Naming(
            f"{name}_deviation", "deg", f"angle of that line out of its plane, ahead is positive; {inclined}", "stroke"
        )
        found += with_rates(points, stroke_function(plane, deviation=True), aside, rates=False)
        out += [*found, phase_of(found[0], name)]
    return out


def phase_of(stroke: Quantity, name: str) -> Quantity:
    """Phase of an oscillation, of its analytic signal (Gabor 1946): 0 and 360 at the upper end, 180 at the lower, deg.

    The standard deviation is that of the stroke over the amplitude of the analytic signal, to first order.
    """
    there = np.isfinite(stroke.value)
    value, sd = np.full(len(there), np.nan), np.full(len(there), np.nan)
    if there.sum() >= 8:
        index = np.arange(len(there))
        whole = np.interp(index, index[there], stroke.value[there])
        signal = analytic(whole - whole.mean())
        value = np.where(there, np.degrees(np.angle(signal)) % 360, np.nan)
        sd = np.where(there, np.degrees(stroke.sd / np.maximum(np.abs(signal), 1e-9)), np.nan)
    what = f"phase of {stroke.name}: 0 at its upper end, 180 at its lower end"
    naming = Naming(f"{name}_phase", "deg", what, "stroke")
    return called(naming, stroke.markers, value, sd, stroke.rests)


def analytic(series: Array) -> NDArray[np.complex128]:
    """(T, ...) series without their negative frequencies, times two, along the first axis (Gabor 1946).

    It is ``scipy.signal.hilbert``, which loads all of ``scipy.stats``: a quarter of what `mocap track` imports.
    """
    n = len(series)
    weight = np.zeros(n)
    weight[0], weight[1 : (n + 1) // 2], weight[n // 2 : n // 2 + 1 - n % 2] = 1, 2, 1
    return np.fft.ifft(np.fft.fft(series, axis=0) * weight.reshape(-1, *[1] * (series.ndim - 1)), axis=0)
