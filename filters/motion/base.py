"""What every motion model answers."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from mocap.filters.ensemble import Gaussian, Prediction, SigmaPoints, ensemble, predict, scale, spread

from eal.arrays import Array

ROUNDS = 10
"""An iterated update ends after so many at the latest."""
More = TypeVar("More")


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

    def further(self, at: Array, found: Array) -> Array | None:  # noqa: ARG002
        """Where to linearise the markers again; None: they are as good as linear between two means of a state, here."""
        return None

    def conditioned(
        self,
        state: Gaussian,
        frame: int,
        update: Callable[[Array, Array, Array | None], tuple[Gaussian, More]],
        *,
        first: tuple[Array, Array] | None = None,
    ) -> tuple[Gaussian, More]:
        """Condition a state on what is known of the markers, by an iterated Kalman filter (Bell & Cathey 1993).

        Gauss-Newton steps to the most probable state: the markers are linearised about the posterior again as long
        as ``further`` says where.

        Args:
            state: Predicted state.
            frame: Which frame it is of.
            update: Called with the markers (M, 3) where they are linearised, ensemble rows (k, M, 3), and what is
                added (M, 3) to the markers to have the prediction of that linear model, None: nothing; gives the
                posterior and what else it finds.
            first: ``deviations`` of the state, if they are known.
        """
        at = state.mean
        found, more = update(*(first or self.deviations(state, frame)), None)
        for _ in range(ROUNDS):
            ahead = self.further(at, found.mean)
            if ahead is None:
                break
            at = ahead
            mean, rows = self.deviations(Gaussian(at, state.factor), frame)
            _, back = self.deviations(Gaussian(at, (state.mean - at)[:, None]), frame)
            found, more = update(mean, rows, back[0])
        return found, more

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
