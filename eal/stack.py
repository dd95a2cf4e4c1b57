"""Several potentials at once: one trajectory batch over lambda, samples or seeds."""

from collections.abc import Sequence
from typing import final

import numpy as np

from eal.arrays import Array, points
from eal.kernels import GaussianKernel
from eal.potential import EmpiricalPotential


@final
class PotentialStack:
    """L potentials of one dimension and Gaussian kernel; the l-th answers for row l of the first axis.

    They are evaluated together, in stacked matrix products over centres padded to the longest (a padded centre has a
    zero row in B).

    Attributes:
        members: The L potentials.
        dimension: Number of coordinates.
        curvature_limit: The largest of the members', see EmpiricalPotential.
    """

    def __init__(self, members: Sequence[EmpiricalPotential]) -> None:
        """Pad and stack: centres (L, m, d) about their common mean, roots (L, m, r).

        Raises:
            ValueError: no member, or members of different dimensions or kernels.
        """
        self.members = tuple(members)
        kinds = {(p.dimension, p.kernel) for p in self.members}
        self.dimension, kernel = next(iter(kinds), (0, None))
        if len(kinds) != 1 or not isinstance(kernel, GaussianKernel):
            raise ValueError(f"a stack needs potentials of one dimension and Gaussian kernel, but has {[*kinds]}")
        self.curvature_limit = max(p.curvature_limit for p in self.members)
        self._beta = kernel.beta
        self._middle = np.mean([p.centres.mean(axis=0) for p in self.members], axis=0)
        m, r = (max(p.root.shape[axis] for p in self.members) for axis in (0, 1))
        self._centres, self._root = (np.zeros((len(self.members), m, width)) for width in (self.dimension, r))
        for i, p in enumerate(self.members):
            self._centres[i, : len(p.centres)] = p.centres - self._middle
            self._root[i, : len(p.root), : p.root.shape[1]] = p.root
        self._across = np.ascontiguousarray((2.0 * self._beta) * self._centres.transpose(0, 2, 1))
        self._own = -self._beta * np.einsum("lmd,lmd->lm", self._centres, self._centres)[:, None, :]
        self._back = np.ascontiguousarray(self._root.transpose(0, 2, 1))

    def value(self, q: Array) -> Array:
        """V_l = 1 - |B^T k|^2 at (L, ..., d) configurations: (L, ...)."""
        _, k = self._kernels(q)
        a = k @ self._root
        return np.maximum(1.0 - np.einsum("lnr,lnr->ln", a, a), 0.0).reshape(np.shape(q)[:-1])

    def gradient(self, q: Array) -> Array:
        """Gradients 4 beta sum_i (B B^T k)_i k_i (q - z_i) of V_l: (L, ..., d) to (L, ..., d)."""
        away, k = self._kernels(q)
        w = (k @ self._root) @ self._back
        w *= k
        return ((4.0 * self._beta) * (w.sum(axis=2)[:, :, None] * away - w @ self._centres)).reshape(np.shape(q))

    def _kernels(self, q: Array) -> tuple[Array, Array]:
        """Q less the middle (L, n, d), and K(q, z) (L, n, m)."""
        q = points("q", q, self.dimension)
        if q.ndim < 2 or len(q) != len(self.members):
            raise ValueError(f"q must have {len(self.members)} rows, one a potential of the stack, but has {q.shape}")
        q = q.reshape(len(q), -1, self.dimension) - self._middle
        logs = q @ self._across
        logs += self._own
        logs -= self._beta * np.einsum("lnd,lnd->ln", q, q)[:, :, None]
        np.minimum(logs, 0.0, out=logs)
        np.exp(logs, out=logs)
        return q, logs
