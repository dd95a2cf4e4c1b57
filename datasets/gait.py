"""A walk along a rod: where feet stand and how they swing."""

from dataclasses import dataclass

import numpy as np
from mocap.datasets.linkage import ramp
from numpy.typing import NDArray

from eal.arrays import Array

# footholds are drawn for so many strides and then repeat: far more than a recording holds
_STRIDES = 512


@dataclass(frozen=True, kw_only=True)
class Gait:
    """A symmetrical gait at a steady stride length.

    Attributes:
        stride_m: Way of the body in one cycle.
        duty: Share of the cycle that a foot stands; 0.65 is a walking trot, 0.63 that of Dipsosaurus at its slowest
            (Fieler & Jayne 1998, J. Exp. Biol. 201, 609).
        lift_m: How far a foot rises from the rod in its swing.
        scatter_m: Standard deviation of footholds along the rod.
        scatter_rad: Standard deviation of footholds around it.
    """

    stride_m: float = 0.044
    duty: float = 0.65
    lift_m: float = 0.005
    scatter_m: float = 0.001
    scatter_rad: float = 0.06


@dataclass(frozen=True, eq=False, kw_only=True)
class Steps:
    """One foot over time, in cylindrical coordinates of the rod.

    Attributes:
        along_m: (T,) position along the rod.
        around_rad: (T,) angle from the top of the rod, to the left.
        lift_m: (T,) height above the rod's surface.
        cycle: (T,) share of the cycle that has passed since touch-down, 0 to 1.
        stance: (T,) True where the foot stands.
    """

    along_m: Array
    around_rad: Array
    lift_m: Array
    cycle: Array
    stance: NDArray[np.bool_]


def steps(
    rng: np.random.Generator, progress_m: Array, gait: Gait, *, offset: float, ahead_m: float, around_rad: float
) -> Steps:
    """The steps of one foot of a body that has come ``progress_m`` along the rod.

    Step k stands while the body goes from (k + offset) to (k + offset + duty) strides, so that in mid-stance the foot
    is ``ahead_m`` before the body; between steps it swings along a smooth step, without a jump in acceleration.

    Args:
        rng: Source of the scatter of footholds.
        progress_m: (T,) position of the body, increasing.
        gait: Stride and duty.
        offset: Phase of the limb in cycles.
        ahead_m: Mid-stance position of the foot relative to the body.
        around_rad: Mean angle of the foothold from the top of the rod; to the left is positive.

    Returns:
        The foot over time.
    """
    cycles = progress_m / gait.stride_m - offset
    k = np.floor(cycles).astype(int)
    u = cycles - k
    # within two standard deviations, so that no seed asks for a step out of reach
    scatter = np.clip(rng.standard_normal((_STRIDES, 2)), -2, 2) * [gait.scatter_m, gait.scatter_rad]

    def foothold(step: NDArray[np.intp]) -> Array:
        middle = gait.stride_m * (step + offset + gait.duty / 2) + ahead_m
        mean = np.stack([middle, np.full(len(step), around_rad)], axis=-1)
        return mean + scatter[step % _STRIDES]

    swing = np.maximum(u - gait.duty, 0) / (1 - gait.duty)
    here, there = foothold(k), foothold(k + 1)
    place = here + ramp(swing)[:, None] * (there - here)
    return Steps(
        along_m=place[:, 0],
        around_rad=place[:, 1],
        lift_m=gait.lift_m * (4 * swing * (1 - swing)) ** 3,
        cycle=u,
        stance=u < gait.duty,
    )
