"""What every motion model answers."""

from abc import ABC, abstractmethod

from filters.ensemble import Gaussian, SigmaPoints
from mocap.arrays import Array


class MotionModel(ABC):
    """A prior on motion: how the state moves, and where the markers are for a given state.

    Attributes:
        name: For reports.
        points: Sigma-point parameters for a state of this size.
        reads: The markers depend only on the first so many components of the state (positions first).
        linear: Whether ``step`` and ``markers`` are affine in the state.
    """

    name: str
    points: SigmaPoints
    reads: int
    linear: bool

    @abstractmethod
    def initial(self) -> Gaussian:
        """State before the first observation."""

    @abstractmethod
    def step(self, states: Array, dt_s: float) -> Array:
        """(S, n) states to (S, n) states ``dt_s`` seconds later."""

    @abstractmethod
    def noise(self, dt_s: float) -> Array:
        """(n, n) lower factor of the process noise covariance of one step."""

    @abstractmethod
    def markers(self, states: Array, frame: int) -> Array:
        """(S, reads) leading components to (S, M, 3) marker positions in the world, in metres."""

    def constrain(self, state: Gaussian, dt_s: float) -> Gaussian:  # noqa: ARG002
        """Apply what is known of the state beside its dynamics, once a frame; here nothing."""
        return state
