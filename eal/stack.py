"""Several potentials at once: one trajectory batch over lambda, samples or seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array, points
from eal.potential import EmpiricalPotential


@dataclass(frozen=True, eq=False)
class PotentialStack:
    """L potentials of the same dimension; the l-th answers for row l of the first axis.

    Potentials that share kernel and centres (``with_lambda``) share one evaluation of the kernels.

    Attributes:
        members: The L potentials.
    """

    members: tuple[EmpiricalPotential, ...]

    def __init__(self, members: Sequence[EmpiricalPotential]) -> None:
        """Group the members by kernel and centres.

        Raises:
            ValueError: no member, or members of different dimensions.
        """
        object.__setattr__(self, "members", tuple(members))
        if len({p.dimension for p in self.members}) != 1:
            raise ValueError(f"a stack needs potentials of one dimension, but has {[p.dimension for p in members]}")
        groups: list[list[int]] = []
        for index, member in enumerate(self.members):
            for group in groups:
                first = self.members[group[0]]
                if (
                    first.kernel == member.kernel
                    and first.root.shape == member.root.shape
                    and np.array_equal(first.centres, member.centres)
                ):
                    group.append(index)
                    break
            else:
                groups.append([index])
        stacked = [(np.array(g), self.members[g[0]], np.stack([self.members[i].root for i in g])) for g in groups]
        object.__setattr__(self, "_groups", stacked)

    @property
    def dimension(self) -> int:
        """D."""
        return self.members[0].dimension

    @property
    def curvature_limit(self) -> float:
        """The largest of the members', see EmpiricalPotential."""
        return max(p.curvature_limit for p in self.members)

    def value(self, q: Array) -> Array:
        """V_l at (L, ..., d) configurations: (L, ...)."""
        q = self._checked(q)
        result = np.empty(q.shape[:-1])
        for rows, first, roots in self._groups:  # type: ignore[attr-defined]
            flat = q[rows].reshape(-1, q.shape[-1])
            a = first.kernel.gram(flat, first.centres).reshape(len(rows), -1, len(first.centres)) @ roots
            result[rows] = (1.0 - np.einsum("lnr,lnr->ln", a, a)).reshape(result[rows].shape)
        return np.maximum(result, 0.0)

    def gradient(self, q: Array) -> Array:
        """Gradients of V_l: (L, ..., d) to (L, ..., d)."""
        q = self._checked(q)
        result = np.empty(q.shape)
        for rows, first, roots in self._groups:  # type: ignore[attr-defined]
            flat = q[rows].reshape(-1, q.shape[-1])
            k = first.kernel.gram(flat, first.centres)
            stacked = k.reshape(len(rows), -1, k.shape[1])
            w = ((stacked @ roots) @ roots.transpose(0, 2, 1)).reshape(k.shape)
            w *= -2.0 * k
            result[rows] = first.kernel.weighted_gradient(flat, first.centres, w).reshape(result[rows].shape)
        return result

    def _checked(self, q: Array) -> Array:
        q = points("q", q, self.dimension)
        if q.ndim < 2 or len(q) != len(self.members):
            raise ValueError(f"q must have {len(self.members)} rows, one a potential of the stack, but has {q.shape}")
        return q
