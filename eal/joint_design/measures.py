"""How well a truss's energy does what the potential asks, how much of that manufacturing leaves, and what V_z knows."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from eal.joint_design.path import over_grid
from eal.joint_design.target import Target
from eal.joint_design.truss import Truss
from eal.potential import EmpiricalPotential
from eal.radius import resampled_values

LEVELS = (0.25, 0.5, 0.75)
"""Levels whose sets are compared; the second is the half level."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """A truss beside the potential that it should have; normalised, so that V = 1 is the unit of energy.

    Attributes:
        u: (n,) U less what is stored at V = 0, at the target's points.
        rms: Root mean square of u - V inside the region.
        r2: Share of V's variance inside the region that u explains.
        iou: Intersection over union of the sets below each of ``LEVELS``, all over the grid.
        lowest_outside: Least u outside the region over the region's level: 1 or more is a barrier without a gap.
        stiffness_worst: Greatest |d2u - d2V| (spectral norm) where V < 1/2, over the greatest |d2V| there.
        stiffness_median: The median of the same.
        stretch: (m, 2) least and greatest stretch of every member inside the region.
        unstable: Points inside the region at which the internal nodes found no stable equilibrium.
    """

    u: Array
    rms: float
    r2: float
    iou: tuple[float, float, float]
    lowest_outside: float
    stiffness_worst: float
    stiffness_median: float
    stretch: Array
    unstable: int


def overlap(u: Array, v: Array, level: float) -> float:
    """Intersection over union of {u < level} and {v < level}; 1 where both are empty."""
    a, b = u < level, v < level
    return float((a & b).sum() / max((a | b).sum(), 1)) if (a | b).any() else 1.0


def measure(truss: Truss, stored: float, target: Target, *, curvature: Callable[[Array], Array] | None = None) -> Fit:
    """Compare a truss in the target's units with the target.

    Args:
        truss: The truss.
        stored: Its energy at V = 0.
        target: The potential, on a grid that the fit did not see.
        curvature: d2V/dq2: (n, d) to (n, d, d); None: stiffness is not compared (NaN).
    """
    states = over_grid(truss, target)
    u, inside = states.energy_j - stored, target.inside
    off, v = (u - target.v)[inside], target.v[inside]
    worst = median = float("nan")
    low = target.v < 0.5
    if curvature is not None:
        wanted = np.asarray(curvature(target.q[low]))
        error = np.linalg.norm(states.stiffness_n_m[low] - wanted, ord=2, axis=(1, 2))
        greatest = float(np.linalg.norm(wanted, ord=2, axis=(1, 2)).max())
        worst, median = float(error.max() / greatest), float(np.median(error) / greatest)
    iou = [overlap(u, target.v, level) for level in LEVELS]
    stretch = states.stretch[inside]
    return Fit(
        u=u,
        rms=float(np.sqrt(np.mean(off**2))),
        r2=float(1.0 - np.mean(off**2) / v.var()),
        iou=(iou[0], iou[1], iou[2]),
        lowest_outside=float(u[~inside].min() / target.level),
        stiffness_worst=worst,
        stiffness_median=median,
        stretch=np.stack([stretch.min(axis=0), stretch.max(axis=0)], axis=1),
        unstable=int((~(states.found & (states.stable > 0.0)))[inside].sum()),
    )


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Errors of manufacture, standard deviations.

    Attributes:
        position: Of a coordinate of a fixed node, in the design's unit of length.
        length: Of a rest length, likewise.
        stiffness: Of a stiffness, relative.
    """

    position: float
    length: float
    stiffness: float


def tolerance_study(
    truss: Truss, target: Target, tolerance: Tolerance, *, rng: np.random.Generator, draws: int = 100
) -> tuple[Array, Array]:
    """Trusses built with errors: each is compared with its own least energy set to what the design has there.

    Args:
        truss: The design, in the target's units.
        target: The potential.
        tolerance: Errors.
        rng: For the errors.
        draws: Trusses.

    Returns:
        (draws,) RMS inside the region and (draws,) overlap at the half level.
    """
    inside = target.inside
    rms, iou = np.empty(draws), np.empty(draws)
    for i in range(draws):
        built = replace(
            truss,
            fixed_m=truss.fixed_m + tolerance.position * rng.standard_normal(truss.fixed_m.shape),
            rest_m=truss.rest_m + tolerance.length * rng.standard_normal(truss.rest_m.shape),
            stiffness_n_m=truss.stiffness_n_m * np.exp(tolerance.stiffness * rng.standard_normal(truss.rest_m.shape)),
        )
        energy = over_grid(built, target).energy_j
        u = energy - float(np.mean((energy - target.v)[inside]))
        rms[i] = np.sqrt(np.mean((u - target.v)[inside] ** 2))
        iou[i] = overlap(u, target.v, LEVELS[1])
    return rms, iou


def potential_doubt(
    potential: EmpiricalPotential, target: Target, *, rng: np.random.Generator, block: int, resamples: int = 40
) -> tuple[float, float]:
    """What V_z itself is unsure of: V_z of resampled blocks of its samples.

    Args:
        potential: V_z.
        target: Its values on a grid.
        rng: For the blocks.
        block: Consecutive samples drawn together.
        resamples: Number of resamples.

    Returns:
        Root mean square of V* - V inside the region, and the mean overlap of their sets at the half level.
    """
    middle, values = resampled_values(potential, target.q, rng=rng, block=block, resamples=resamples)
    squares = (values - middle)[:, target.inside] ** 2
    return float(np.sqrt(squares.mean())), float(np.mean([overlap(v, middle, LEVELS[1]) for v in values]))
