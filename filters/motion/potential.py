"""Potentials of a pose: of coordinates of all of it, or of one limb."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eal import EmpiricalPotential
from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Pull:
    """Gradient of -log(1 - V_z) / eps^2 a second: as of V_z near the data, but it pulls at any distance.

    Attributes:
        potential: V_z.
        stiffness: 1/eps^2 a second.
    """

    potential: EmpiricalPotential
    stiffness: float

    def __call__(self, x: Array) -> Array:
        """(S, k) coordinates to (S, k)."""
        return self.potential.barrier_gradient(x) * self.stiffness


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

    def rows(self, chains: int) -> Array:
        """(d, r) how q changes with the components of a state [z, zdot, ..., e] whose chains begin at ``chains``."""
        n, d = self.on_shape.shape[1], self.on_residual.shape[1]
        out = np.zeros((len(self.mean), chains + d))
        out[:, :n], out[:, chains:] = self.on_shape, self.on_residual
        return out
