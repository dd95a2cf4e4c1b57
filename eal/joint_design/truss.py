"""A pin-jointed truss between a fixed segment and a moving point, and its energy."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eal.arrays import Array, read_only
from eal.joint_design.laws import DesignError, Indices, Law, Mask, energy_and_slope, law_codes, member_energy
from eal.optional_jax import jnp


@dataclass(frozen=True, eq=False, kw_only=True)
class Truss:
    """Members between fixed nodes, one moving point and internal nodes, in the plane (d = 2) or in space (d = 3).

    Nodes are numbered: the F fixed ones, the moving point F, the I internal ones F + 1, ...

    Attributes:
        fixed_m: (F, d) fixed nodes, in the axes of the parent segment with the joint at the origin.
        internal_m: (I, d) where the search for the internal nodes' equilibrium starts.
        ends: (m, 2) nodes that each member joins.
        rest_m: (m,) rest lengths.
        stiffness_n_m: (m,) axial stiffnesses at rest, E A / L.
        laws: m names of ``eal.joint_design.laws``.
    """

    fixed_m: Array
    internal_m: Array
    ends: Indices
    rest_m: Array
    stiffness_n_m: Array
    laws: tuple[Law, ...]

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        for name in ("fixed_m", "internal_m", "rest_m", "stiffness_n_m"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "internal_m", read_only(self.internal_m.reshape(-1, self.fixed_m.shape[1])))
        ends = np.array(self.ends, dtype=np.int64).reshape(-1, 2)
        ends.flags.writeable = False
        object.__setattr__(self, "ends", ends)
        codes = law_codes(self.laws)
        m, last = len(ends), self.moving + len(self.internal_m)
        if not len(codes) == len(self.rest_m) == len(self.stiffness_n_m) == m:
            raise DesignError(
                f"a truss of {m} members has {len(self.rest_m)} rest lengths, {len(self.stiffness_n_m)} stiffnesses "
                f"and {len(codes)} laws: give one of each a member"
            )
        if m and (ends.min() < 0 or ends.max() > last or (ends[:, 0] == ends[:, 1]).any()):
            raise DesignError(f"every member joins two different nodes between 0 and {last}, but ends are {ends}")
        if not ((self.rest_m > 0).all() and (self.stiffness_n_m >= 0).all()):
            raise DesignError("rest lengths must be above 0 and stiffnesses not below 0")

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.fixed_m.shape[1]

    @property
    def moving(self) -> int:
        """Number of the moving point."""
        return len(self.fixed_m)

    def scaled(self, *, metres: float, joules: float) -> "Truss":
        """The truss with every length times ``metres`` and every energy times ``joules``."""
        return replace(
            self,
            fixed_m=self.fixed_m * metres,
            internal_m=self.internal_m * metres,
            rest_m=self.rest_m * metres,
            stiffness_n_m=self.stiffness_n_m * joules / metres**2,
        )

    def padded(self, members: int, nodes: int) -> "Truss":
        """The same truss with idle members and fixed nodes at the end of each kind, so that few shapes are compiled."""
        lines: tuple[Law, ...] = ("linear",)
        more, idle = max(nodes - self.moving, 0), max(members - len(self.rest_m), 0)
        ends = self.ends + np.where(self.ends >= self.moving, more, 0)
        return Truss(
            fixed_m=np.concatenate([self.fixed_m, np.zeros((more, self.dimension))]),
            internal_m=self.internal_m,
            ends=np.concatenate([ends, np.tile([[0, self.moving + more]], (idle, 1))]),
            rest_m=np.append(self.rest_m, np.ones(idle)),
            stiffness_n_m=np.append(self.stiffness_n_m, np.zeros(idle)),
            laws=(*self.laws, *lines * idle),
        )

    def with_members(self, kept: Mask) -> "Truss":
        """The truss of some members to the moving point, each from a fixed node of its own; no internal nodes."""
        count = int(kept.sum())
        return Truss(
            fixed_m=self.fixed_m[self.ends[kept, 0]],
            internal_m=self.internal_m,
            ends=np.column_stack([np.arange(count), np.full(count, count)]),
            rest_m=self.rest_m[kept],
            stiffness_n_m=self.stiffness_n_m[kept],
            laws=tuple(law for law, keep in zip(self.laws, kept, strict=True) if keep),
        )

    def parameters(self) -> dict[str, Array | Indices]:
        """Everything that ``truss_energy`` reads, as arrays."""
        return {
            "fixed": self.fixed_m,
            "rest": self.rest_m,
            "stiffness": self.stiffness_n_m,
            "start": self.ends[:, 0],
            "end": self.ends[:, 1],
            "law": law_codes(self.laws),
        }


def member_forces(truss: Truss, stretch: Array) -> Array:
    """(..., m) k L w'(s), positive where a member pulls, from (..., m) stretches."""
    return truss.stiffness_n_m * truss.rest_m * energy_and_slope(stretch, truss.laws)[1]


def member_lengths(q: Any, x: Any, p: dict[str, Any]) -> Any:
    """(m,) lengths at one position.

    Args:
        q: (d,) moving point.
        x: (I, d) internal nodes.
        p: As ``Truss.parameters`` gives.
    """
    nodes = jnp.concatenate([p["fixed"], q[None], x])
    away = nodes[p["end"]] - nodes[p["start"]]
    return jnp.sqrt(jnp.sum(away * away, axis=-1) + 1e-24)


def truss_energy(q: Any, x: Any, p: dict[str, Any]) -> Any:
    """Sum over members of k L^2 w(l / L), in J; arguments as in ``member_lengths``."""
    rest = p["rest"]
    return jnp.sum(p["stiffness"] * rest**2 * member_energy(member_lengths(q, x, p) / rest, p["law"]))
