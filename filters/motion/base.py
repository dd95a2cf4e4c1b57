"""What every motion model answers."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np
from mocap.filters.factors import symmetric, triangle_of
from mocap.filters.gaussian import Adjoint, Markers, Moments, Move, Smoothed, Update, View
from mocap.filters.observe import Observed
from numpy.typing import NDArray

from eal.arrays import Array

More = TypeVar("More")


@dataclass(frozen=True)
class Step:
    """One step of time.

    Attributes:
        frame: Frame that it leads to.
        dt_s: Its length.
    """

    frame: int
    dt_s: float


class Steps(dict[float, More]):
    """What steps of the same time have in common, by that time; of few times, as a clock may have ever new ones.

    Attributes:
        FEW: So many are kept.
    """

    FEW = 8

    def __setitem__(self, dt_s: float, step: More) -> None:
        """Keep one more, or begin anew."""
        if len(self) >= self.FEW:
            self.clear()
        super().__setitem__(dt_s, step)


@dataclass(frozen=True, eq=False)
class Frame:
    """What a filter made of a frame, and what going back needs of it.

    Attributes:
        state: Filtered state.
        move: Step that led to it; None to the first of a recording.
        updates: What came after it, in order.
        observed: What was seen.
    """

    state: Moments
    move: Move | None
    updates: Sequence[Update]
    observed: Observed

    def back(self, adjoint: Adjoint) -> Adjoint:
        """What it and all later frames say of the state before it."""
        for update in reversed(self.updates):
            adjoint = update.back(adjoint)
        return adjoint if self.move is None else self.move.back(adjoint)

    def carry(self, rows: Array) -> Array:
        """(..., n) rows of covariances with the state before it: with its filtered state."""
        rows = rows if self.move is None else self.move.forward(rows)
        for update in self.updates:
            rows = update.carry(rows)
        return rows


@dataclass(frozen=True, eq=False)
class Folded:
    """A frame that is kept until a smoother comes back to it: of a covariance of all markers one triangle.

    Attributes:
        frame: The frame; of its state the mean alone, where there is a triangle.
        triangle: (n (n + 1) / 2,) of the covariance; None: it is in the frame, of each marker by itself.
    """

    frame: Frame
    triangle: Array | None

    @classmethod
    def of(cls, frame: Frame) -> "Folded":
        """A frame, folded."""
        mean, cov = frame.state.mean, frame.state.cov
        if cov.ndim > 2:
            return cls(frame, None)
        return cls(replace(frame, state=Moments(mean, np.zeros((0, 0)))), triangle_of(cov))

    @property
    def unfolded(self) -> Frame:
        """As it was."""
        if self.triangle is None:
            return self.frame
        mean = self.frame.state.mean
        return replace(self.frame, state=Moments(mean, symmetric(self.triangle, len(mean))))


class Keeper(Protocol):
    """Takes the smoothed frames of a recording, from the last to the first."""

    def take(self, frame: int, state: Smoothed) -> None:
        """One frame's smoothed state."""
        ...

    def values(self) -> Mapping[str, NDArray[Any]]:
        """What is kept of all frames that were taken, by name; times come first where it is of times."""
        ...


class MotionModel(ABC):
    """A prior on motion: how the state moves, and where the markers are for a given state.

    Its state is a block that all markers share, then chains (``mocap.filters.gaussian``); with a leading axis, one such
    state for each marker by itself.

    Attributes:
        name: For reports.
    """

    name: str

    @property
    @abstractmethod
    def size(self) -> int:
        """Numbers of a state, all parts together."""

    @abstractmethod
    def initial(self) -> Moments:
        """State before the first observation."""

    @abstractmethod
    def move(self, state: Moments, step: Step) -> Move:
        """A step of time from a state; what is not linear in it is linearised under its uncertainty."""

    @abstractmethod
    def view(self, mean: Array, frame: int) -> View:
        """The markers near the mean (..., n) of a state."""

    def further(self, prior: Moments, at: Array, found: Array) -> Array | None:  # noqa: ARG002
        """Where to linearise the markers again; None: they are as good as linear between two means of a state, here.

        Args:
            prior: The state before what is known of the markers.
            at: Mean about which they were linearised.
            found: Mean of the posterior by that.
        """
        return None

    def conditioned(
        self,
        state: Moments,
        frame: int,
        update: Callable[[Markers, Array | None], tuple[Moments, More]],
        *,
        first: Markers | None = None,
    ) -> tuple[Moments, More]:
        """Condition a state on what is known of the markers, by an iterated Kalman filter (Bell & Cathey 1993).

        Gauss-Newton steps to the most probable state: the markers are linearised about the posterior again as long
        as ``further`` says where.

        Args:
            state: Predicted state.
            frame: Which frame it is of.
            update: Called with the markers where they are linearised, and what is added (M, 3) to them to have the
                prediction of that linear model, None: nothing; gives the posterior and what else it finds.
            first: The markers of the state, if they are known.
        """
        at = state.mean
        found, more = update(first or Markers(state, self.view(at, frame)), None)
        for _ in range(10):
            ahead = self.further(state, at, found.mean)
            if ahead is None:
                break
            at = ahead
            markers = Markers(state, self.view(at, frame))
            found, more = update(markers, markers.view.moved(state.mean - at))
        return found, more

    def constrain(self, state: Moments, step: Step) -> tuple[Moments, list[Update]]:  # noqa: ARG002
        """Apply what is known of the state beside its dynamics, once a frame; here nothing.

        Args:
            state: Predicted state.
            step: The step that led to it.

        Returns:
            The state, and how it came about.
        """
        return state, []

    def shown(self, state: Smoothed, view: View, frame: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Mean (M, 3) and covariance (M, 3, 3) of the markers of a smoothed state of a frame; linear by its view."""
        return view.mean, state.markers(view)

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array] | None:  # noqa: ARG002
        """Velocities of the markers, and how positions and velocities depend on the state; None: it has none, here.

        Args:
            mean: (n,) mean of a state.
            frame: Which frame it is of.

        Returns:
            (M, 3) velocities in m/s, and the (..., 6m, n) Jacobian of each marker's position and velocity, in order.
        """
        return None

    def accelerations(self, mean: Array, frame: int) -> tuple[Array, Array] | None:  # noqa: ARG002
        """Accelerations of the markers, and how they depend on the state; None: they are no part of it, here.

        Only of models of each marker by itself.

        Args:
            mean: (M, n) means of the states.
            frame: Which frame they are of.

        Returns:
            (M, 3) accelerations in m/s^2, and their (M, 3, n) Jacobian.
        """
        return None

    def own(self, names: Sequence[str]) -> "Sequence[Keeper]":  # noqa: ARG002
        """Who keeps what the model says of its own state while a smoother goes back; here nobody.

        Args:
            names: The M markers, and what else has a velocity; empty: no velocity is asked for.
        """
        return ()

    def informed(self, state: Smoothed) -> Smoothed:
        """A smoothed state of a frame in which nothing is seen, with what is known of any frame; here nothing."""
        return state
