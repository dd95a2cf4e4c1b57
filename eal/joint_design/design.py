"""A truss for a potential: several starts of ground structure, selection and refinement, and the best of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from eal.joint_design.ground import candidates, fixed_nodes, sparse, with_members
from eal.joint_design.laws import DesignError, Law, Mask, energy_and_slope
from eal.joint_design.measures import measure, overlap
from eal.joint_design.path import over_grid
from eal.joint_design.refine import refine
from eal.joint_design.target import Limits, Target, broken
from eal.joint_design.truss import Truss
from eal.threads import one_blas_thread


def with_internal_node(truss: Truss, target: Target, rng: np.random.Generator) -> Truss:
    """A member to the moving point in two halves of twice its stiffness, their joint braced to another fixed node.

    Only where the brace pulls sideways does the energy change much: two halves in series are as stiff as the whole.

    Args:
        truss: A truss with at least two members to the moving point.
        target: The region; its deepest point is where the brace is at rest.
        rng: Chooses the member, by stiffness, and the brace.
    """
    direct = [i for i, (a, b) in enumerate(truss.ends) if a < truss.moving and b == truss.moving]
    weight = truss.stiffness_n_m[direct] + 1e-12
    opened = int(rng.choice(direct, p=weight / weight.sum()))
    anchor = int(truss.ends[opened, 0])
    brace = int(rng.choice([a for a in range(truss.moving) if a != anchor]))
    deepest = target.q[np.argmin(target.v)]
    place = 0.5 * (truss.fixed_m[anchor] + deepest)
    node = truss.moving + 1 + len(truss.internal_m)
    ends, rest, stiffness = (np.array(part) for part in (truss.ends, truss.rest_m, truss.stiffness_n_m))
    ends[opened] = (anchor, node)
    rest[opened] *= 0.5
    stiffness[opened] *= 2.0
    law: Law = "linear" if truss.laws[opened] in ("cable", "strut") else truss.laws[opened]
    laws = tuple(law if i == opened else name for i, name in enumerate(truss.laws))
    return replace(
        truss,
        internal_m=np.concatenate([truss.internal_m, place[None]]),
        ends=np.concatenate([ends, [[node, truss.moving], [brace, node]]]),
        rest_m=np.append(rest, [rest[opened], np.linalg.norm(truss.fixed_m[brace] - place)]),
        stiffness_n_m=np.append(stiffness, [stiffness[opened], 0.3 * stiffness[opened]]),
        laws=(*laws, laws[opened], "linear"),
    )


def crossings(truss: Truss, target: Target) -> int:
    """Pairs of members that cross at some point of the region; members of one node, and those in space, do not."""
    if truss.dimension != 2 or not truss.internal_m.size:
        return 0
    states = over_grid(truss, target)
    inside = target.inside
    q, x = states.q_m[inside], states.x_m[inside]
    nodes = np.concatenate([np.broadcast_to(truss.fixed_m, (len(q), *truss.fixed_m.shape)), q[:, None], x], axis=1)
    count = 0
    for i, (a, b) in enumerate(truss.ends):
        for c, d in truss.ends[:i]:
            if len({a, b, c, d}) == 4:
                count += bool(_cross(nodes[:, a], nodes[:, b], nodes[:, c], nodes[:, d]).any())
    return count


def _cross(a: Array, b: Array, c: Array, d: Array) -> Mask:
    """(n,) whether segments a-b and c-d cross: each separates the other's ends."""

    def side(p: Array, q: Array, r: Array) -> Array:
        u, w = q - p, r - p
        return u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]

    return (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)


Progress = Callable[[float], None]

_ALPHAS = (3e-4, 3e-3)
"""Range of the weight of stiffnesses, one drawn a start: few members or many. Chosen; not measured."""

_LINES = {2: 12, 3: 6}
"""Grid lines of fixed nodes within reach each way, in the plane and in space."""


_IDLE = 0.01  # of V = 1; chosen
GOAL = 0.1
"""RMS inside the region that a design should reach, of V = 1. Chosen; not measured."""

_AS_GOOD = 0.1
"""Of two trusses whose RMS differs by this share, the one with fewer members is taken. Chosen; not measured."""

_WORST_OVERLAP = 0.5
"""Overlap at the half level below which a design is refused. Chosen; not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """A truss that was found.

    Attributes:
        truss: In the target's unit of length, V's unit as unit of energy.
        stored: Energy at V = 0.
        rms: Root mean square of U - stored - V inside the region, on the grid that it was fitted on.
    """

    truss: Truss
    stored: float
    rms: float


def design_truss(
    target: Target,
    limits: Limits,
    *,
    rng: np.random.Generator,
    starts: int = 4,
    internal: int = 0,
    mirror: Array | None = None,
    may_cross: bool = True,
    progress: Progress = lambda _share: None,
) -> list[Design]:
    """A truss whose energy U, less a constant, is the potential: U - c = V in the region, U - c >= level outside.

    Args:
        target: The potential.
        limits: What members may be.
        rng: Shifts the ground structures and draws the weights; the same generator gives the same design.
        starts: Ground structures tried.
        internal: Internal nodes in each truss; each costs two members more.
        mirror: (d, d) reflection that the truss shall have as symmetry; not with internal nodes.
        may_cross: False: no two members cross anywhere in the region.
        progress: Told the share done.

    Returns:
        Designs within the limits, up to three a start, in order of preference: those nearly as good as the best by the
        number of their members, then the others by their RMS.

    Raises:
        DesignError: no truss within the limits comes near; the message names the limit that binds.
    """
    if internal and mirror is not None:
        raise DesignError("mirrored pairs of members cannot have internal nodes: give `internal` or `symmetric`")
    if 2 * internal + 2 > limits.members:
        raise DesignError(f"{internal} internal nodes need {2 * internal + 2} members, but members is {limits.members}")
    found: list[tuple[Truss, float]] = []
    crossed, rounds = 0, 1 if internal else 3  # refined members join the candidates
    with one_blas_thread():  # the same on any number of cores
        for start in range(starts):
            nodes = fixed_nodes(target, limits, rng, mirror=mirror, lines=_LINES[target.q.shape[1]])
            offered = candidates(target, limits, nodes, mirror=mirror)
            alpha = float(np.exp(rng.uniform(*np.log(_ALPHAS))))
            for i in range(rounds):
                truss, stored = sparse(target, offered, most=limits.members - 2 * internal, alpha=alpha)
                for _ in range(internal):
                    truss = with_internal_node(truss, target, rng)
                truss, stored = refine(target, truss, stored, limits, mirror=mirror, evaluations=40)
                progress((start + (i + 1) / rounds) / starts)
                if not may_cross and crossings(truss, target):
                    crossed += 1
                    continue
                found.append((_without_idle(truss, target, pairs=mirror is not None), stored))
                if i + 1 < rounds:
                    offered = with_members(target, offered, truss)
        if not found:
            raise DesignError(
                f"members cross in all {crossed} designs: ask for fewer internal nodes, or let them cross"
            )
        fits = [measure(truss, stored, target) for truss, stored in found]
        designs = [
            Design(truss=truss, stored=stored, rms=fit.rms) for (truss, stored), fit in zip(found, fits, strict=True)
        ]
        best = int(np.argmin([fit.rms for fit in fits]))
        if fits[best].iou[1] < _WORST_OVERLAP:
            raise DesignError(_what_binds(target, limits, fits[best].iou[1], mirror))
        broken_by = [_broken_limit(design.truss, target, limits) for design in designs]
        kept = [design for design, why in zip(designs, broken_by, strict=True) if why is None]
        if not kept:
            raise DesignError(str(broken_by[best]))
        least = min(design.rms for design in kept)
        good = max(min((1.0 + _AS_GOOD) * least, GOAL), least)
        return sorted(kept, key=lambda d: (d.rms > good, len(d.truss.rest_m) if d.rms <= good else 0, d.rms))


def _without_idle(truss: Truss, target: Target, *, pairs: bool = False) -> Truss:
    """The truss without members to the moving point that hold less than ``_IDLE`` of V = 1 anywhere in the region.

    Of ``pairs`` (members i and i + m/2 are images of each other) both go or none: a region that is not symmetric may
    never load one of them.
    """
    stretch = over_grid(truss, target).stretch[target.inside]
    most_energy = truss.stiffness_n_m * truss.rest_m**2 * energy_and_slope(stretch, truss.laws)[0].max(axis=0)
    direct = (truss.ends[:, 0] < truss.moving) & (truss.ends[:, 1] == truss.moving)
    kept = (most_energy >= _IDLE) | ~direct
    kept = np.tile(kept.reshape(2, -1).any(axis=0), 2) if pairs else kept
    return truss if kept.all() or truss.internal_m.size else truss.with_members(kept)


def _broken_limit(truss: Truss, target: Target, limits: Limits) -> str | None:
    """A sentence on the first limit that a truss breaks; None where it keeps all."""
    states = over_grid(truss, target)
    stretch = states.stretch[target.inside]
    lengths = np.stack([stretch.min(axis=0), stretch.max(axis=0)], axis=1) * truss.rest_m[:, None]
    ends = np.where(truss.ends < truss.moving, truss.ends, -1)
    away = np.append(np.linalg.norm(truss.fixed_m, axis=1), 0.0)
    for name, excess in broken(limits, lengths, truss.rest_m, truss.laws, away[ends].max(axis=1)).items():
        member = int(np.argmax(excess))
        if excess[member] > 0.0:
            return (
                f"the limit '{name}' ({getattr(limits, name):.3g}) binds: member {member + 1} of the best truss breaks "
                f"it by {100 * excess[member]:.1f} %; widen it, or take more members or a lower level"
            )
    return None


def _what_binds(target: Target, limits: Limits, iou: float, mirror: Array | None) -> str:
    """Which limit, widened alone, helps a sparse truss on a ground structure most."""
    wider = {
        "members": {"members": 2 * limits.members},
        "shortest": {"shortest": 0.5 * limits.shortest},
        "longest": {"longest": 2.0 * limits.longest},
        "reach": {"reach": 2.0 * limits.reach},
        "contraction": {"contraction": 0.5 * (1.0 + limits.contraction)},
        "extension": {"extension": 3.0 * limits.extension},
    }
    reached = {}
    for name, change in wider.items():
        changed = replace(limits, **change)
        rng = np.random.default_rng(0)
        try:
            nodes = fixed_nodes(target, changed, rng, mirror=mirror, lines=_LINES[target.q.shape[1]])
            offered = candidates(target, changed, nodes, mirror=mirror)
            truss, stored = sparse(target, offered, most=changed.members, alpha=1e-3)
        except DesignError:
            continue
        reached[name] = overlap(over_grid(truss, target).energy_j - stored, target.v, 0.5)
    best = max(reached, key=lambda name: reached[name])
    return (
        f"within the limits the best truss overlaps the potential's half level by {iou:.2f}, where {_WORST_OVERLAP:g} "
        f"is asked: '{best}' ({getattr(limits, best):.3g}) binds most, widened alone it allows {reached[best]:.2f}"
    )
