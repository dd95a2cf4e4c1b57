"""Several potentials at once: one trajectory batch over lambda, samples or seeds."""

from collections.abc import Sequence
from typing import final

import numpy as np

from eal.arrays import Array, points
from eal.kernels import GaussianKernel
from eal.potential import EmpiricalPotential


@final
class PotentialStack:
    """L potentials of the same dimension; the l-th answers for row l of the first axis.

    Gaussian kernels of one beta are evaluated together, in stacked matrix products over centres padded to the longest
    (a padded centre has a zero row in B); other kernels one after the other.

    Attributes:
        members: The L potentials.
    """

    def __init__(self, members: Sequence[EmpiricalPotential]) -> None:
        """Pad and stack.

        Raises:
            ValueError: no member, or members of different dimensions.
        """
        self.members = tuple(members)
        if len({p.dimension for p in self.members}) != 1:
            raise ValueError(f"a stack needs potentials of one dimension, but has {[p.dimension for p in members]}")
        kernels = {p.kernel for p in self.members}
        kernel = next(iter(kernels))
        self._gaussian = None
        if len(kernels) == 1 and isinstance(kernel, GaussianKernel):
            self._gaussian = _Gaussians(self.members, kernel.beta)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return self.members[0].dimension

    @property
    def curvature_limit(self) -> float:
        """The largest of the members', see EmpiricalPotential."""
        return max(p.curvature_limit for p in self.members)

    def value(self, q: Array) -> Array:
        """V_l at (L, ..., d) configurations: (L, ...)."""
        q = self._checked(q)
        if self._gaussian is None:
            return np.stack([p.value(x) for p, x in zip(self.members, q, strict=True)])
        return self._gaussian.value(q.reshape(len(q), -1, q.shape[-1])).reshape(q.shape[:-1])

    def gradient(self, q: Array) -> Array:
        """Gradients of V_l: (L, ..., d) to (L, ..., d)."""
        q = self._checked(q)
        if self._gaussian is None:
            return np.stack([p.gradient(x) for p, x in zip(self.members, q, strict=True)])
        return self._gaussian.gradient(q.reshape(len(q), -1, q.shape[-1])).reshape(q.shape)

    def _checked(self, q: Array) -> Array:
        q = points("q", q, self.dimension)
        if q.ndim < 2 or len(q) != len(self.members):
            raise ValueError(f"q must have {len(self.members)} rows, one a potential of the stack, but has {q.shape}")
        return q


class _Gaussians:
    """Padded centres (L, m, d) about their common mean, roots (L, m, r)."""

    def __init__(self, members: tuple[EmpiricalPotential, ...], beta: float) -> None:
        m = max(len(p.centres) for p in members)
        r = max(p.root.shape[1] for p in members)
        self.beta = beta
        self.middle = np.mean([p.centres.mean(axis=0) for p in members], axis=0)
        self.centres = np.zeros((len(members), m, members[0].dimension))
        self.root = np.zeros((len(members), m, r))
        for i, p in enumerate(members):
            self.centres[i, : len(p.centres)] = p.centres - self.middle
            self.root[i, : len(p.centres), : p.root.shape[1]] = p.root
        self.across = np.ascontiguousarray((2.0 * beta) * self.centres.transpose(0, 2, 1))
        self.own = -beta * np.einsum("lmd,lmd->lm", self.centres, self.centres)[:, None, :]
        self.back = np.ascontiguousarray(self.root.transpose(0, 2, 1))

    def kernels(self, q: Array) -> Array:
        """K(q, z): (L, n, d) about the middle to (L, n, m)."""
        logs = q @ self.across
        logs += self.own
        logs -= self.beta * np.einsum("lnd,lnd->ln", q, q)[:, :, None]
        np.minimum(logs, 0.0, out=logs)
        np.exp(logs, out=logs)
        return logs

    def value(self, q: Array) -> Array:
        """1 - |B^T k|^2: (L, n)."""
        a = self.kernels(q - self.middle) @ self.root
        return np.maximum(1.0 - np.einsum("lnr,lnr->ln", a, a), 0.0)

    def gradient(self, q: Array) -> Array:
        """4 beta sum_i (B B^T k)_i k_i (q - z_i): (L, n, d)."""
        q = q - self.middle
        k = self.kernels(q)
        w = (k @ self.root) @ self.back
        w *= k
        return (4.0 * self.beta) * (w.sum(axis=2)[:, :, None] * q - w @ self.centres)
