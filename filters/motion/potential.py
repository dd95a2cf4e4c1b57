"""Potentials of a pose: of coordinates of all of it, or of one limb."""

from collections.abc import Callable
from dataclasses import dataclass

from filters.ensemble import Gaussian, triangular
from mocap.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePotential:
    """A potential of coordinates q = mean + on_shape [z, zdot] + on_residual e of a pose.

    Attributes:
        mean: (d,) q of the mean pose.
        on_shape: (d, 2r).
        on_residual: (d, 3M).
        samples: (N, d) what it was learned from.
        gradient: (S, d) q to (S, d) gradients of the potential over eps^2, a second.
    """

    mean: Array
    on_shape: Array
    on_residual: Array
    samples: Array
    gradient: Callable[[Array], Array]

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
