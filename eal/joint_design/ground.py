"""A ground structure of candidate members, and the few of them whose energies add up to the potential.

The energy of a pin-jointed truss without internal nodes is linear in its stiffnesses, so that the best one on given
nodes is a convex problem (Dorn, Gomory and Greenberg 1964 for plates and bars under loads; here for an energy):
minimise over k >= 0 and c the mean of (sum_j k_j W_j - c - V)^2 inside the region, plus that of
max(level - sum_j k_j W_j + c, 0)^2 outside, plus alpha sum_j k_j / (k_j' + e), reweighted by the k' before
(Candes, Wakin and Boyd 2008), until few members are left.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from eal.arrays import Array
from eal.joint_design.laws import DesignError, Law, energy_and_slope
from eal.joint_design.target import Limits, Target, broken
from eal.joint_design.truss import Truss

REST_LENGTHS = 7
"""Rest lengths tried for each pair of a node and a law, over the range of lengths in the region."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidates:
    """Members from fixed nodes to the moving point; of a symmetric design each stands for a pair.

    Attributes:
        node: (C, d) fixed node of each.
        rest: (C,) rest lengths.
        laws: C laws.
        energy: (n, C) W at the grid's points, scaled to a mean of 1 inside the region.
        scale: (C,) what they were divided by.
        mirror: (d, d) reflection that makes the pairs; None: no pairs.
    """

    node: Array
    rest: Array
    laws: tuple[Law, ...]
    energy: Array
    scale: Array
    mirror: Array | None


def fixed_nodes(target: Target, limits: Limits, rng: np.random.Generator, *, mirror: Array | None, lines: int) -> Array:
    """The joint, and a randomly shifted grid of nodes within reach, far enough from the region.

    Args:
        target: The region.
        limits: ``reach`` and ``shortest``.
        rng: For the shift.
        mirror: (d, d) reflection under which the grid is its own image; None: any.
        lines: Grid lines within reach in each direction.

    Returns:
        (A, d) nodes.

    Raises:
        DesignError: none keeps the least length.
    """
    d = target.q.shape[1]
    line = np.linspace(-limits.reach, limits.reach, lines)
    grid = np.stack(np.meshgrid(*[line] * d), axis=-1).reshape(-1, d)
    spacing = line[1] - line[0]
    nodes = np.concatenate([np.zeros((1, d)), grid + rng.uniform(-0.5, 0.5, d) * spacing])
    if mirror is not None:
        nodes = np.concatenate([nodes, 0.5 * (nodes + nodes @ mirror)])
    region = target.q[target.inside]
    kept = nodes[np.linalg.norm(nodes, axis=1) <= limits.reach]
    far = np.array([np.linalg.norm(region - node, axis=1).min() for node in kept]) >= limits.shortest
    if not far.any():
        raise DesignError(
            f"the limits 'reach' ({limits.reach:.3g}) and 'shortest' ({limits.shortest:.3g}) leave no place for a "
            "fixed node outside the region where the joint goes: allow a greater reach or a shorter member"
        )
    return kept[far]


def candidates(target: Target, limits: Limits, nodes: Array, *, mirror: Array | None) -> Candidates:
    """All members from nodes to the moving point that keep the limits.

    Raises:
        DesignError: no member does; the message names the limit that excludes most.
    """
    region = target.inside
    rows: list[tuple[Array, float, Law]] = []
    counts: dict[str, int] = {}
    for node in nodes:
        lengths = np.linalg.norm(target.q[region] - node, axis=1)
        low, high = float(lengths.min()), float(lengths.max())
        rest = np.tile(np.linspace(low, high, REST_LENGTHS), len(limits.laws))
        laws = np.repeat(np.array(limits.laws, dtype=object), REST_LENGTHS)
        excess = broken(
            limits,
            np.broadcast_to([low, high], (len(rest), 2)),
            rest,
            list(laws),
            np.full(len(rest), float(np.linalg.norm(node))),
        )
        kept = (
            np.all([part <= 0.0 for part in excess.values()], axis=0)
            & ((laws != "cable") | (rest < high))
            & ((laws != "strut") | (rest > low))
        )
        rows += [(node, float(r), law) for r, law in zip(rest[kept], laws[kept], strict=True)]
        for name, part in excess.items():
            counts[name] = counts.get(name, 0) + int((part > 0.0).sum())
    if not rows:
        name = max(counts, key=lambda key: counts[key])
        raise DesignError(
            f"no member reaches the whole region within the limits: '{name}' ({getattr(limits, name):.3g}) excludes "
            f"{counts[name]} of {len(nodes) * REST_LENGTHS * len(limits.laws)} candidates: widen it"
        )
    node, rest, laws = (list(part) for part in zip(*rows, strict=True))
    energy = _energies(target.q, np.array(node), np.array(rest), tuple(laws), mirror)
    scale = energy[region].mean(axis=0)
    some = scale > 1e-6 * scale.max()
    return Candidates(
        node=np.array(node)[some],
        rest=np.array(rest)[some],
        laws=tuple(law for law, kept in zip(laws, some, strict=True) if kept),
        energy=energy[:, some] / scale[some],
        scale=scale[some],
        mirror=mirror,
    )


def with_members(target: Target, found: Candidates, truss: Truss) -> Candidates:
    """The candidates and the members of a refined truss: of a symmetric one the first of each pair."""
    m = len(truss.rest_m) if found.mirror is None else len(truss.rest_m) // 2
    node, rest, laws = truss.fixed_m[truss.ends[:m, 0]], truss.rest_m[:m], truss.laws[:m]
    energy = _energies(target.q, node, rest, laws, found.mirror)
    scale = np.maximum(energy[target.inside].mean(axis=0), 1e-9)
    return Candidates(
        node=np.concatenate([found.node, node]),
        rest=np.append(found.rest, rest),
        laws=found.laws + laws,
        energy=np.concatenate([found.energy, energy / scale], axis=1),
        scale=np.append(found.scale, scale),
        mirror=found.mirror,
    )


def _energies(q: Array, node: Array, rest: Array, laws: Sequence[Law], mirror: Array | None) -> Array:
    """(n, C) L^2 w(l / L) of unit stiffness, with those of the mirrored nodes."""
    nodes = [node] if mirror is None else [node, node @ mirror]
    lengths = (np.linalg.norm(q[:, None] - one, axis=-1) for one in nodes)
    return sum((energy_and_slope(one / rest, laws)[0] * rest**2 for one in lengths), np.zeros(1))


def sparse(target: Target, found: Candidates, *, most: int, alpha: float) -> tuple[Truss, float]:
    """At most ``most`` candidates with stiffnesses that approximate the target; formula at the head of the file.

    Args:
        target: The potential.
        found: Candidates.
        most: Most members.
        alpha: Weight of the stiffnesses; doubled in the last rounds as long as more members are left.

    Returns:
        The truss, V's unit as its unit of energy, and the energy c that it stores at V = 0.
    """
    chosen = np.arange(len(found.rest))
    penalty = np.full(len(chosen), alpha)
    pairs = 1 if found.mirror is None else 2
    k, c = np.zeros(len(chosen)), 0.0
    for i in range(48):
        k, c = _nonnegative(target, found.energy[:, chosen], penalty)
        left = k > 1e-5 * k.max()
        chosen, k = chosen[left], k[left]
        if i >= 11 and pairs * len(chosen) <= most:
            break
        if i >= 12:
            alpha *= 2.0
        penalty = alpha * k.max() / (k + 0.02 * k.max())
    if pairs * len(chosen) > most:
        chosen, k = chosen[np.argsort(-k)[: most // pairs]], np.sort(k)[::-1][: most // pairs]
    node, rest, stiffness = found.node[chosen], found.rest[chosen], k / found.scale[chosen]
    laws: tuple[Law, ...] = tuple(found.laws[i] for i in chosen)
    if found.mirror is not None:
        node, rest = np.concatenate([node, node @ found.mirror]), np.tile(rest, 2)
        stiffness, laws = np.tile(stiffness, 2), laws * 2
    truss = Truss(
        fixed_m=node,
        internal_m=np.empty((0, node.shape[1])),
        ends=np.column_stack([np.arange(len(node)), np.full(len(node), len(node))]),
        rest_m=rest,
        stiffness_n_m=stiffness,
        laws=laws,
    )
    return truss, c


def _nonnegative(target: Target, energy: Array, penalty: Array) -> tuple[Array, float]:
    inside = target.inside
    within, without = energy[inside], energy[~inside]
    v, level, n = target.v[inside], target.level, inside.sum()

    def cost(kc: Array) -> tuple[float, Array]:
        k, c = kc[:-1], kc[-1]
        off = within @ k - c - v
        low = np.minimum(without @ k - c - level, 0.0)
        gradient = 2.0 / n * (within.T @ off + without.T @ low) + penalty
        slope = -2.0 / n * (off.sum() + low.sum())
        return float((off @ off + low @ low) / n + penalty @ k), np.append(gradient, slope)

    m = energy.shape[1]
    bounds = [(0.0, None)] * m + [(0.0, None)]
    found = minimize(
        cost, np.full(m + 1, 0.1 / m), jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 1500}
    )
    return found.x[:-1], float(found.x[-1])
