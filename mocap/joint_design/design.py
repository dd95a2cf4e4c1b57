"""The whole design of a joint: truss, checks and parts, as the report and the images show them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from eal.joint_design import (
    Design,
    DesignError,
    Fit,
    Followed,
    Limits,
    Release,
    Target,
    Tolerance,
    Truss,
    design_truss,
    follow,
    make_target,
    measure,
    over_grid,
    potential_doubt,
    recorded_velocities,
    release,
    tolerance_study,
    truss_penalty,
)
from eal.radius import effective_sample_size
from mocap.joint_design.flexure import MM, MakeError, Printing, all_forms, energy_range, shaped
from mocap.joint_design.solid import Kit, make_kit, stacked
from mocap.joint_design.source import JointSource

FINE = 10_000
"""Points of the grid on which a design is judged."""

ENERGY = 0.25
"""Kinetic energy of the fastest released mass, V = 1 being the unit."""


@dataclass(frozen=True, kw_only=True)
class Wish:
    """Requirements of a design; lengths at printed size.

    Attributes:
        size_m: Printed distance from the joint to its farthest sample.
        level: Edge of the region.
        limits: Limits in metres at printed size.
        starts: Ground structures tried.
        internal: Internal nodes.
        symmetric: Whether members come in pairs mirrored at the line from the joint to the mean of the samples.
        may_cross: Whether members may cross.
        seed: Seed.
        printing: What the parts are made for; None: no parts.
        energy_j: Energy at V = 1; None: the middle of what the parts allow, or 10 mJ without parts.
        tolerance: Errors of manufacture, metres.
    """

    size_m: float
    level: float
    limits: Limits
    starts: int
    internal: int
    symmetric: bool
    may_cross: bool
    seed: int
    printing: Printing | None
    energy_j: float | None
    tolerance: Tolerance


@dataclass(frozen=True, eq=False, kw_only=True)
class JointDesign:
    """A designed joint.

    Attributes:
        source: Where the potential is from.
        wish: What was asked.
        metre_per_unit: Printed metres a unit of the potential's coordinates.
        target: The potential on the fine grid.
        design: The truss in the potential's units.
        truss: The truss at printed size, in J.
        energy_j: Energy at V = 1.
        fit: How well it fits on the fine grid.
        tries: RMS and members of each start that kept the limits, in order of preference; which was taken.
        doubt: RMS and half-level overlap of V_z with itself, learned again from resampled blocks.
        built_rms: (draws,) RMS of trusses built with errors.
        built_iou: (draws,) their half-level overlap.
        release: Masses released on the truss.
        release_in_v: Masses released in V_z itself: the EAL model.
        way: The truss led along the recorded path, in the potential's units.
        kit: Parts; None where none were asked for.
    """

    source: JointSource
    wish: Wish
    metre_per_unit: float
    target: Target
    design: Design
    truss: Truss
    energy_j: float
    fit: Fit
    tries: list[tuple[float, int, bool]]
    doubt: tuple[float, float]
    built_rms: Array
    built_iou: Array
    release: Release
    release_in_v: Release
    way: Followed
    kit: Kit | None


def design_joint(source: JointSource, wish: Wish, *, stage: Callable[[str], Callable[[float], None]]) -> JointDesign:
    """Design, check, and shape the parts.

    Args:
        source: The potential.
        wish: What is asked.
        stage: Called with the name of each stage; gives what is told the share done of it.

    Raises:
        MakeError: no truss within the limits, or none that can be printed; the message names the limit that binds.
    """
    potential, unit = source.potential, source.unit_m
    samples = potential.samples
    per_unit = wish.size_m / float(np.linalg.norm(samples, axis=1).max())
    rng = np.random.default_rng(wish.seed)
    lengths = ("shortest", "longest", "reach", "spacing")
    limits = replace(wish.limits, **{name: getattr(wish.limits, name) / per_unit for name in lengths})
    mirror = _mirror(samples) if wish.symmetric else None
    try:
        coarse = make_target(potential.value, samples, level=wish.level)
        designs = design_truss(
            coarse,
            limits,
            rng=rng,
            starts=wish.starts,
            internal=wish.internal,
            mirror=mirror,
            may_cross=wish.may_cross,
            progress=stage("shape the truss"),
        )
    except DesignError as error:
        millimetres = per_unit / MM
        raise MakeError(f"{error} (lengths in units of {millimetres:.3g} mm at printed size)") from None
    report = stage("shape the parts")
    target = make_target(potential.value, samples, level=wish.level, points=FINE)
    taken, kit, energy = _first_that_can_be_made(designs, target, per_unit, wish)
    report(1.0)
    report = stage("check")
    design = designs[taken]
    fit = measure(design.truss, design.stored, target, curvature=potential.hessian)
    report(0.01)
    tolerance = Tolerance(
        position=wish.tolerance.position / per_unit,
        length=wish.tolerance.length / per_unit,
        stiffness=wish.tolerance.stiffness,
    )
    built = tolerance_study(design.truss, coarse, tolerance, rng=rng, draws=10 if wish.internal else 100)
    block = max(1, round(len(samples) / effective_sample_size(samples, potential.kernel)))
    doubt = potential_doubt(potential, coarse, rng=rng, block=block)
    report(0.1)
    release, release_in_v = _released(design, coarse, source, wish.level)
    report(0.88)
    deepest = over_grid(design.truss, coarse).x_m[np.argmin(coarse.v)]
    way = follow(design.truss, np.asarray(source.path_m / unit, dtype=np.float64), deepest)
    report(1.0)
    return JointDesign(
        source=source,
        wish=wish,
        metre_per_unit=per_unit,
        target=target,
        design=design,
        truss=design.truss.scaled(metres=per_unit, joules=energy),
        energy_j=energy,
        fit=fit,
        tries=[(d.rms, len(d.truss.rest_m), i == taken) for i, d in enumerate(designs)],
        doubt=doubt,
        built_rms=built[0],
        built_iou=built[1],
        release=release,
        release_in_v=release_in_v,
        way=way,
        kit=kit,
    )


def _mirror(samples: Array) -> Array:
    """(d, d) reflection that keeps the line from the joint to the mean of the samples."""
    axis = samples.mean(axis=0)
    axis = axis / np.linalg.norm(axis)
    return 2.0 * np.outer(axis, axis) - np.eye(len(axis))


def _first_that_can_be_made(
    designs: list[Design], target: Target, per_unit: float, wish: Wish
) -> tuple[int, Kit | None, float]:
    if wish.printing is None:
        return 0, None, wish.energy_j or 10e-3
    if designs[0].truss.dimension != 2 or designs[0].truss.internal_m.size:
        raise MakeError("parts can only be made of planar trusses without internal nodes: give `no_solid` for this one")
    reasons = []
    for i, design in enumerate(designs):
        try:
            kit, energy = _kit(design, target, per_unit, wish.printing, wish.energy_j)
        except MakeError as error:
            reasons.append(f"{len(design.truss.rest_m)} members: {error}")
        else:
            return i, kit, energy
    raise MakeError("none of the trusses can be printed. " + "\n".join(dict.fromkeys(reasons)))


def _kit(
    design: Design, target: Target, per_unit: float, printing: Printing, energy_j: float | None
) -> tuple[Kit, float]:
    truss = design.truss.scaled(metres=per_unit, joules=1.0)
    stretch = over_grid(design.truss, target).stretch[target.inside]
    lengths = np.stack([stretch.min(axis=0), stretch.max(axis=0)], axis=1) * truss.rest_m[:, None]
    found = all_forms(truss, lengths, printing)
    low, high = energy_range(found, truss.stiffness_n_m)
    energy = float(np.sqrt(low * high)) if energy_j is None else energy_j
    if not low <= energy <= high:
        raise MakeError(
            f"`energy_mj` {energy / MM:.3g}: the parts allow {low / MM:.3g} to {high / MM:.3g}; the lower limit is "
            "set by wall and width, the upper by strain"
        )
    truss = design.truss.scaled(metres=per_unit, joules=energy)
    flexures = shaped(found, truss.stiffness_n_m, printing)
    region = target.q[target.inside] * per_unit
    return make_kit(truss, flexures, stacked(truss, flexures, region, printing), region, printing), energy


def _released(design: Design, target: Target, source: JointSource, level: float) -> tuple[Release, Release]:
    samples = source.potential.samples
    starts = np.linspace(0, len(samples) - 1, min(20, len(samples))).astype(np.int64)
    velocities = recorded_velocities(samples, starts, energy=ENERGY)
    duration = 8.0 * float(np.ptp(samples, axis=0).max()) / np.sqrt(2.0 * ENERGY)
    of_truss = truss_penalty(design.truss, design.stored, over_grid(design.truss, target))
    both = [
        release(penalty, source.potential, samples[starts], velocities, level=level, duration=duration, step=0.02)
        for penalty in (of_truss, source.potential)
    ]
    return both[0], both[1]
