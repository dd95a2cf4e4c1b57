"""What every motion model answers."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from filters.ensemble import Gaussian, Prediction, SigmaPoints, ensemble, predict, scale, spread
from mocap.arrays import Array


@dataclass(frozen=True, eq=False)
class Step:
    """One step of time.

    Attributes:
        frame: Frame that it leads to.
        dt_s: Its length.
        noise: (n, n) lower factor of the process noise covariance.
        noise_cov: (n, n) lower triangle of that covariance, which many steps share; None: made from the factor.
    """

    frame: int
    dt_s: float
    noise: Array
    noise_cov: Array | None = None


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

    def deviations(self, state: Gaussian, frame: int) -> tuple[Array, Array]:
        """Mean (M, 3) and ensemble rows (k, M, 3) of the markers of a state: their sum of squares is the covariance."""
        c, gamma = scale(self.points)
        markers = self.markers(spread(state, c, columns=self.reads, rows=self.reads), frame)
        mean, rows = ensemble(markers.reshape(len(markers), -1), c, gamma, linear=self.linear)
        return mean.reshape(-1, 3), rows.reshape(len(rows), -1, 3)

    def predict(self, state: Gaussian, step: Step) -> Prediction:
        """Propagate a state."""
        return predict(
            state,
            lambda x: self.advance(x, step.dt_s),
            step.noise,
            self.points,
            linear=self.linear,
            noise_cov=step.noise_cov,
        )

    def constrain(self, state: Gaussian, step: Step, about: Any = None) -> Gaussian:  # noqa: ARG002
        """Apply what is known of the state beside its dynamics, once a frame; here nothing.

        Args:
            state: Predicted state.
            step: The step that led to it.
            about: Where to linearise it (``reference``); None: at the prediction.
        """
        return state

    def reference(self, state: Gaussian) -> Any:  # noqa: ARG002
        """What ``constrain`` needs of a smoothed state to linearise about it; None: it is linear, here nothing."""
        return None

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array] | None:  # noqa: ARG002
        """Velocities of the markers, and how positions and velocities depend on the state; None: it has none, here.

        Args:
            mean: (n,) mean of a state.
            frame: Which frame it is of.

        Returns:
            (M, 3) velocities in m/s, and the (M, 6, n) Jacobian of each marker's position and velocity.
        """
        return None

    def angles_of(self, state: Gaussian) -> tuple[Array, Array] | None:  # noqa: ARG002
        """Mean and standard deviation of the joint angles of a state; None: it has none, here."""
        return None

    def energy_of(self, state: Gaussian, frame: int) -> tuple[float, float, float] | None:  # noqa: ARG002
        """Energy in J of a state, its V_z, and Theorem 3's bound of that; None: it is no Lagrangian, here."""
        return None

    def informed(self, state: Gaussian) -> Gaussian:
        """A smoothed state of a frame in which nothing is seen, with what is known of any frame; here nothing."""
        return state
