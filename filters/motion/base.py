"""What every motion model answers."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from filters.ensemble import Gaussian, Prediction, SigmaPoints, predict
from mocap.arrays import Array


@dataclass(frozen=True, eq=False)
class Step:
    """One step of time.

    Attributes:
        frame: Frame that it leads to.
        dt_s: Its length.
        noise: (n, n) lower factor of the process noise covariance.
    """

    frame: int
    dt_s: float
    noise: Array


class MotionModel(ABC):
    """A prior on motion: how the state moves, and where the markers are for a given state.

    Attributes:
        name: For reports.
        points: Sigma-point parameters for a state of this size.
        reads: The markers depend only on the first so many components of the state (positions first).
        linear: Whether ``advance`` and ``markers`` are affine in the state, or so nearly that second-order rows are
            left out.
    """

    name: str
    points: SigmaPoints
    reads: int
    linear: bool

    @abstractmethod
    def initial(self) -> Gaussian:
        """State before the first observation."""

    @abstractmethod
    def advance(self, states: Array, dt_s: float) -> Array:
        """(S, n) states to (S, n) states ``dt_s`` seconds later."""

    @abstractmethod
    def noise(self, dt_s: float) -> Array:
        """(n, n) lower factor of the process noise covariance of one step."""

    @abstractmethod
    def markers(self, states: Array, frame: int) -> Array:
        """(S, reads) leading components to (S, M, 3) marker positions in the world, in metres."""

    def predict(self, state: Gaussian, step: Step) -> Prediction:
        """Propagate a state."""
        return predict(state, lambda x: self.advance(x, step.dt_s), step.noise, self.points, linear=self.linear)

    def constrain(self, state: Gaussian, dt_s: float) -> Gaussian:  # noqa: ARG002
        """Apply what is known of the state beside its dynamics, once a frame; here nothing."""
        return state

    def informed(self, state: Gaussian) -> Gaussian:
        """A smoothed state of a frame in which nothing is seen, with what is known of any frame; here nothing."""
        return state
