"""Motion of an animal of rigid segments: joint angles in place of marker positions are the state."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from mocap.filters.gaussian import Moments, Move, Smoothed, View
from mocap.filters.motion.base import Keeper
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.tree import STEP_RAD, Posed, Tree, left_jacobian
from numpy.typing import NDArray

from eal.arrays import Array, skew

BENT_RAD = 0.1
"""Rotations by less than so many radians move markers along nearly straight lines: off them by
1 - cos 0.1 = 0.5 % of the segment."""


@dataclass(eq=False)
class AngleKeeper:
    """Joint angles of every smoothed frame (``filters.motion.base.Keeper``), and the segments between the joints.

    Attributes:
        model: The motion model.
    """

    model: "ArticulatedMotion"
    _taken: list[tuple[Array, Array]] = field(default_factory=list)

    def take(self, frame: int, state: Smoothed) -> None:  # noqa: ARG002
        """One frame's angles."""
        self._taken.append(self.model.angles_of(state))

    def values(self) -> dict[str, NDArray[Any]]:
        """``angle_rad`` and ``angle_sd_rad`` (T, F).

        Of the J segments ``segment_length`` and ``segment_length_sd`` (J,), ``segment_ends`` (J, 2), their markers, and
        ``freedoms`` (J,), how many angles each has.
        """
        model = self.model
        mean, sd = (np.array(one[::-1]) for one in zip(*self._taken, strict=True))
        return {
            "angle_rad": mean,
            "angle_sd_rad": sd,
            "segment_length": model.length_m,
            "segment_length_sd": model.length_sd_m,
            "segment_ends": model.ends,
            "freedoms": np.bincount(model.tree.joint, minlength=len(model.ends)),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class ArticulatedMotion(PoseMotion):
    """State [z (r), zdot (r), u, g (6), gdot (6), b (6), s (3M) | e (F), e1 (F), e2 (F)]: joints' chains of e.

    What ``PoseMotion`` says of marker coordinates holds of the F joint angles, each in arc length: angle * arm =
    mean + basis z + e. So z is what joints do together, with mechanics that were learned, and e what each does by
    itself, a Matern-5/2 process of its own variance. The root moves near its path as the body does. Segments keep their
    length; each marker slips on its own by s, a stationary process of the first order (Ornstein & Uhlenbeck 1930).
    V_z is of angles and their velocities. It is kinematic: no masses, no energy.

    Attributes:
        tree: Segments and joints.
        arm_m: (F,) what brings angles to arc length.
        slip_sd: (M,) standard deviation of a marker's place on its segment.
        slip_rate_hz: Rate at which it forgets, 1/s.
        ends: (J, 2) markers at the joint and at the outer end of each segment.
        length_m: (J,) lengths of the segments.
        length_sd_m: (J,) their standard errors; NaN where a segment was hardly seen.
    """

    tree: Tree
    arm_m: Array
    slip_sd: Array
    slip_rate_hz: float
    ends: NDArray[np.int64]
    length_m: Array
    length_sd_m: Array
    name: str = "articulated"
    farthest: float = 3.0

    @cached_property
    def chains(self) -> int:
        """Where the chains begin."""
        return self.slip.stop

    @property
    def slip(self) -> slice:
        """Where s is."""
        start = self.shape_states + self.body_states
        return slice(start, start + 3 * len(self.slip_sd))

    def initial(self) -> Moments:
        """The mean pose at rest, with the deviations of the samples."""
        start = super().initial()
        start.cov[self.slip, self.slip] = np.diag(np.repeat(self.slip_sd, 3) ** 2)
        return start

    def _usual_move(self, dt_s: float) -> Move:
        """As a pose; slip is forgotten, and noise keeps its variance."""
        if dt_s not in self._usual_moves:
            move, slip = super()._usual_move(dt_s), self.slip
            kept = np.exp(-self.slip_rate_hz * dt_s)
            move.shared[slip, slip] = kept * np.eye(slip.stop - slip.start)
            move.noise[slip, slip] = (1 - kept**2) * np.diag(np.repeat(self.slip_sd, 3) ** 2)
        return self._usual_moves[dt_s]

    def further(self, prior: Moments, at: Array, found: Array) -> Array | None:
        """Also where a joint turned by more than ``BENT_RAD``, so far that none turns by more than ``STEP_RAD``."""
        body = super().further(prior, at, found)
        found = found if body is None else body
        before, after = self.angles(np.stack([at, found]))
        turned = float(np.abs(after - before).max())
        return at + min(1.0, STEP_RAD / turned) * (found - at) if turned > BENT_RAD else body

    def angles(self, states: Array) -> Array:
        """(S, F) joint angles in radians."""
        bent = self.subspace.mean + states[:, : self.rank] @ self.subspace.basis.T
        e = self.parts[2]
        return (bent + states[:, e] if e.stop > e.start else bent) / self.arm_m

    def own(self, names: Sequence[str]) -> tuple[Keeper, ...]:
        """Also its joint angles."""
        return (*super().own(names), AngleKeeper(self))

    def angles_of(self, state: Smoothed) -> tuple[Array, Array]:
        """Mean (F,) and standard deviation (F,) of the joint angles of a state, without whole turns of a joint."""
        rows = np.zeros((len(self.arm_m), self.parts[2].stop))
        rows[:, : self.rank] = self.subspace.basis
        if self.parts[2].stop > self.parts[2].start:
            rows[:, self.parts[2]] = np.eye(len(rows))
        angles, rows = self.tree.without_turns(self.angles(state.mean[None])[0], rows / self.arm_m[:, None])
        return angles, np.sqrt(np.maximum(np.diag(state.of(rows)), 0.0))

    def moved(self, means: Array, residual: Array) -> Array:
        """As the angles turn what they carry."""
        posed, inside = self._posed(means)
        by_arc = self.tree.jacobian(self.angles(means), posed, inside) / self.arm_m
        return (by_arc @ residual[:, None, :, None])[..., 0]

    def _inside(self, states: Array) -> Array:
        """(S, M, 3) markers in axes of the root."""
        return self._posed(states)[1]

    def _posed(self, states: Array) -> tuple[Posed, Array]:
        """Segments, and (S, M, 3) markers, in axes of the root."""
        posed = self.tree.pose(self.angles(states))
        return posed, self.tree.markers(posed, states[:, self.slip].reshape(len(states), -1, 3))

    def view(self, mean: Array, frame: int) -> View:
        """As ``markers`` has them, linearised in closed form."""
        g = self.parts[1]
        inside, slopes = self._slopes(mean[None])
        turn, position = self.root(mean[None], frame)
        about = inside[0] @ turn[0].T
        rows = turn[0] @ slopes[0][..., : self.parts[2].stop]
        rows[:, :, g.start : g.start + 3] = np.eye(3)
        tilt = self.path.frames.rotation[frame] @ left_jacobian(mean[g][3:])
        rows[:, :, g.start + 3 : g.stop] = -skew(about) @ tilt
        return View(about + position[0], rows.reshape(-1, rows.shape[-1]))

    def _bent(self, mean: Array, moving: Array) -> tuple[Array, Array, Array]:
        """Du'/dq is the derivative of du/dq in the direction of q', here by central differences."""
        step = 1e-6 / max(float(np.abs(moving).max()), 1e-12)
        pose, slopes = self._slopes(mean + step * np.array([[0.0], [1.0], [-1.0]]) * moving)
        return pose[0], slopes[0], (slopes[1] - slopes[2]) / (2 * step)

    @property
    def _decay_hz(self) -> Array:
        decay = super()._decay_hz
        decay[self.slip] = self.slip_rate_hz
        return decay

    def _slopes(self, states: Array) -> tuple[Array, Array]:
        """(S, M, 3) markers in axes of the root, and (S, M, 3, n) their derivative by z, e and s."""
        posed, inside = self._posed(states)
        out = np.zeros((*inside.shape, states.shape[1]))
        by_arc = self.tree.jacobian(self.angles(states), posed, inside) / self.arm_m
        out[..., : self.rank] = by_arc @ self.subspace.basis
        if self.parts[2].stop > self.parts[2].start:
            out[..., self.parts[2]] = by_arc
        each = np.arange(inside.shape[1])
        for column in range(3):
            out[:, each, :, self.slip.start + 3 * each + column] = posed.rotation[:, self.tree.segment, :, column]
        return inside, out
