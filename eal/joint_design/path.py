"""Following an equilibrium while the moving point travels: where a branch ends, the truss snaps, and that is found."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra

from eal.arrays import Array
from eal.joint_design.equilibrium import Equilibria, equilibria
from eal.joint_design.target import Target
from eal.joint_design.truss import Truss, truss_energy
from eal.optional_jax import jax, jnp

FINEST = 1e-7
"""Share of a segment of the path down to which the end of a branch is bracketed. Chosen; not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Snap:
    """A jump from an equilibrium that ceased to be stable to another.

    Attributes:
        at: Segment of the path, and share of it: 3.25 is a quarter of the way from point 3 to point 4.
        q_m: (d,) where the moving point was.
        before_m: (I, d) internal nodes just before.
        after_m: (I, d) where they came to rest.
        released_j: Energy lost.
    """

    at: float
    q_m: Array
    before_m: Array
    after_m: Array
    released_j: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Followed:
    """A truss whose point was led along a path.

    Attributes:
        states: The truss at the T points of the path, each on the branch that it had reached.
        snaps: All jumps, in order.
    """

    states: Equilibria
    snaps: tuple[Snap, ...]


def follow(truss: Truss, path_m: Array, x_m: Array | None = None) -> Followed:
    """Lead the moving point along a path, slowly.

    A tangent predictor and Newton's method, with steps halved until each lands beside its prediction on a stable
    equilibrium; where no step is short enough the branch has ended (a fold or a bifurcation), the nodes are pushed
    along the softest direction and fall to the next minimum.

    Args:
        truss: The truss.
        path_m: (T, d) points that straight segments join.
        x_m: (I, d) start of the internal nodes at the first; None: ``truss.internal_m``.
    """
    path = np.asarray(path_m, dtype=np.float64)
    first = equilibria(truss, path[:1], None if x_m is None else x_m[None])
    x, xs, snaps = first.x_m[0], [first.x_m[0]], []
    if truss.internal_m.size:
        with jax.enable_x64(True):
            for i in range(len(path) - 1):
                x, found = _segment(truss, path[i], path[i + 1], x, i)
                xs.append(x)
                snaps += found
    else:
        xs = [x] * len(path)
    return Followed(states=equilibria(truss, path, np.array(xs)), snaps=tuple(snaps))


def _segment(truss: Truss, q0: Array, q1: Array, x: Array, number: int) -> tuple[Array, list[Snap]]:
    p, size = truss.parameters(), float(truss.rest_m.max())
    share, step, snaps = 0.0, 1.0, []
    while share < 1.0:
        step = min(step, 1.0 - share)
        q, way = q0 + share * (q1 - q0), step * (q1 - q0)
        guess, new, error, softest = (np.asarray(part) for part in _predicted(q, way, x, p))
        close = np.abs(new - guess).max() <= 0.2 * np.abs(guess - x).max() + 1e-6 * size
        if error <= 1e-9 * size and softest > 0.0 and close:
            x, share, step = new, share + step, 2.0 * step
            continue
        step *= 0.5
        if step < FINEST:
            share = min(share + 10.0 * FINEST, 1.0)
            q = q0 + share * (q1 - q0)
            after, released = _fall(truss, q, x, p, size)
            snaps.append(Snap(at=number + share, q_m=q, before_m=x, after_m=after, released_j=released))
            x, step = after, 1e-3
    return x, snaps


def _fall(truss: Truss, q: Array, x: Array, p: dict[str, Any], size: float) -> tuple[Array, float]:
    softest = np.asarray(_softest(q, x, p)).reshape(x.shape)
    pushed = np.stack([x + 1e-4 * size * softest, x - 1e-4 * size * softest])
    ends = equilibria(truss, np.stack([q, q]), pushed)
    best = int(np.argmin(ends.energy_j))
    before = float(truss_energy(jnp.asarray(q), jnp.asarray(x), {k: jnp.asarray(v) for k, v in p.items()}))
    return ends.x_m[best], before - float(ends.energy_j[best])


def over_grid(truss: Truss, target: Target, scale_m: float = 1.0) -> Equilibria:
    """The truss over a grid, reached from the point of lowest V along the valleys of V, neighbour by neighbour.

    Without internal nodes there is nothing to follow.

    Args:
        truss: The truss.
        target: Grid and potential.
        scale_m: The target's unit of length.
    """
    q = target.q * scale_m
    if not truss.internal_m.size:
        return equilibria(truss, q)
    # points in the order of a tree of cheapest ways from the lowest, and the parent of each
    index = np.arange(len(target.q)).reshape(target.shape)
    pairs = [
        np.stack([np.moveaxis(index, k, 0)[:-1].ravel(), np.moveaxis(index, k, 0)[1:].ravel()])
        for k in range(index.ndim)
    ]
    a, b = np.concatenate(pairs, axis=1)
    cost = np.maximum(target.v[a], target.v[b]) + 0.02
    graph = coo_array((cost, (a, b)), shape=(len(target.q),) * 2).tocsr()
    root = int(np.argmin(target.v))
    _, before = dijkstra(graph, directed=False, indices=root, return_predecessors=True)
    child = np.flatnonzero(before >= 0)
    tree = coo_array((np.ones(len(child)), (before[child], child)), shape=graph.shape).tocsr()
    order, parent = breadth_first_order(tree, root)
    depth = np.zeros(len(q), dtype=np.int64)
    for node in order[1:]:
        depth[node] = depth[parent[node]] + 1
    x = np.broadcast_to(truss.internal_m, (len(q), *truss.internal_m.shape)).copy()
    x[order[0]] = equilibria(truss, q[order[:1]]).x_m[0]
    for level in range(1, int(depth.max()) + 1):
        rows = np.flatnonzero(depth == level)
        for share in (0.25, 0.5, 0.75, 1.0):
            way = q[parent[rows]] + share * (q[rows] - q[parent[rows]])
            x[rows] = equilibria(truss, way, x[parent[rows] if share == 0.25 else rows]).x_m
    return equilibria(truss, q, x)


@jax.jit
def _predicted(q: Any, way: Any, x: Any, p: dict[str, Any]) -> tuple[Any, ...]:
    """Tangent prediction from (q, x) to q + way, corrected; with the last step and the smallest eigenvalue."""

    def energy(position: Any, flat: Any) -> Any:
        return truss_energy(position, flat.reshape(x.shape), p)

    slope, curvature = jax.grad(energy, argnums=1), jax.hessian(energy, argnums=1)
    flat = x.reshape(-1)
    mixed = jax.jacfwd(slope)(q, flat)
    guess = flat - jnp.linalg.solve(curvature(q, flat), mixed @ way)

    def newton(_: Any, state: tuple[Any, Any]) -> tuple[Any, Any]:
        step = jnp.linalg.solve(curvature(q + way, state[0]), slope(q + way, state[0]))
        return state[0] - step, step

    new, step = jax.lax.fori_loop(0, 6, newton, (guess, jnp.zeros_like(guess)))
    softest = jnp.linalg.eigvalsh(curvature(q + way, new))[0]
    error = jnp.where(jnp.isfinite(new).all(), jnp.abs(step).max(), jnp.inf)
    return guess.reshape(x.shape), new.reshape(x.shape), error, softest


@jax.jit
def _softest(q: Any, x: Any, p: dict[str, Any]) -> Any:
    hessian = jax.hessian(lambda flat: truss_energy(q, flat.reshape(x.shape), p))(x.reshape(-1))
    return jnp.linalg.eigh(hessian)[1][:, 0]
