"""Potentials of a pose: of coordinates of all of it, or of one limb."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mocap.filters.ensemble import Gaussian, triangular

from eal import EmpiricalPotential
from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Pull:
    """Gradient of -log(1 - V_z) / eps^2 a second.

    Attributes:
        potential: V_z.
        scale: (k,) brings coordinates to the units of its samples.
        stiffness: 1/eps^2 a second.
    """

    potential: EmpiricalPotential
    scale: Array
    stiffness: float

    def __call__(self, x: Array) -> Array:
        """(S, k) coordinates to (S, k)."""
        return self.potential.barrier_gradient(x * self.scale) * (self.stiffness * self.scale)


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePotential:
    """A potential of coordinates q = mean + on_shape [z, zdot] + on_residual e of a pose.

    Attributes:
        mean: (d,) q of the mean pose.
        on_shape: (d, 2r).
        on_residual: (d, 3M).
        samples: (N, d) what it was learned from.
        gradient: (S, d) q to (S, d) gradients of the potential over eps^2, a second.
        potential: V_z of q that the gradient is of; None: it is quadratic.
        root: Marker that a limb hangs on.
        children: Markers of a limb; empty: the potential is of the whole pose.
    """

    mean: Array
    on_shape: Array
    on_residual: Array
    samples: Array
    gradient: Callable[[Array], Array]
    potential: EmpiricalPotential | None = None
    root: int = -1
    children: tuple[int, ...] = ()

    @cached_property
    def centre(self) -> Array:
        """(d,) mean of the samples."""
        return self.samples.mean(axis=0)

    @cached_property
    def plane(self) -> Array:
        """(d, 2) directions of the two leading principal components of the samples."""
        _, _, vt = np.linalg.svd(self.samples - self.centre, full_matrices=False)
        largest = np.abs(vt[:2]).argmax(axis=1)
        return (vt[:2] * np.sign(vt[np.arange(len(vt[:2])), largest])[:, None]).T

    def coordinates(self, state: Gaussian, residual: slice, reads: int) -> tuple[Array, Array]:
        """Mean (d,) of q, and its (reads, d) ensemble rows."""
        n = self.on_shape.shape[1]
        mean = self.mean + self.on_shape @ state.mean[:n] + self.on_residual @ state.mean[residual]
        rows = state.factor[:n, :reads].T @ self.on_shape.T + state.factor[residual, :reads].T @ self.on_residual.T
        return mean, rows

    def marginal(self, state: Gaussian, residual: slice, reads: int) -> Gaussian:
        """Mean and factor of q."""
        mean, rows = self.coordinates(state, residual, reads)
        return Gaussian(mean, triangular(rows))
