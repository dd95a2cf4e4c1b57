"""A pose whose body's path is laid while it moves: for recordings that are still growing."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from filters.ensemble import Gaussian, Prediction, SigmaPoints
from filters.motion.base import MotionModel, Step
from filters.motion.pose import BodyPath, PoseMotion
from mocap.arrays import Array
from mocap.body import BodyFrames

Place = tuple[Array, Array, Array, Array]
"""Rotation (3, 3), position, velocity and angular velocity (3,) of the path in one frame."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LaidPath(MotionModel):
    """``PoseMotion`` about a path that nobody knows beforehand.

    Each frame of the path lies where the state of the frame before leads, so that the body is predicted to be on it,
    and is linearised where it is believed to be. Only the last ``kept`` frames of the path are kept.

    Attributes:
        pose: The model; the first frame of its path is where this one begins.
        kept: Frames that can be smoothed back over: more than lag + every of ``filters.live.live``.
    """

    pose: PoseMotion
    kept: int = 200
    name: str = field(init=False)
    points: SigmaPoints = field(init=False)
    reads: int = field(init=False)
    linear: bool = field(init=False)
    places: dict[int, Place] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Take over what the model is, and where it begins."""
        for name in ("name", "points", "reads", "linear"):
            object.__setattr__(self, name, getattr(self.pose, name))
        path = self.pose.path
        self.places[0] = path.frames.rotation[0], path.frames.position_m[0], path.velocity_m_s[0], path.rate_rad_s[0]

    def initial(self) -> Gaussian:
        """That of the model."""
        return self.pose.initial()

    def advance(self, states: Array, dt_s: float) -> Array:
        """That of the model."""
        return self.pose.advance(states, dt_s)

    def noise(self, dt_s: float) -> Array:
        """That of the model."""
        return self.pose.noise(dt_s)

    def constrain(self, state: Gaussian, dt_s: float) -> Gaussian:
        """That of the model."""
        return self.pose.constrain(state, dt_s)

    def informed(self, state: Gaussian) -> Gaussian:
        """That of the model."""
        return self.pose.informed(state)

    def predict(self, state: Gaussian, step: Step) -> Prediction:
        """Lay the path to this frame, from the frame before, and predict along it."""
        place = self.places[step.frame - 1]
        self.places[step.frame] = self._next(place, state.mean, step.dt_s)
        self.places.pop(step.frame - self.kept, None)
        return self._about(step.frame - 1, step.frame).predict(state, replace(step, frame=1))

    def markers(self, states: Array, frame: int) -> Array:
        """Those of the model about the path as it was laid."""
        return self._about(frame).markers(states, 0)

    def _next(self, place: Place, mean: Array, dt_s: float) -> Place:
        rotation, position, velocity, rate = place
        _, g, _, g_rate, _ = self.pose.parts
        velocity, rate = velocity + mean[g_rate][:3], rate + mean[g_rate][3:]
        turn = Rotation.from_rotvec(mean[g][3:]) * Rotation.from_rotvec(dt_s * rate)
        return rotation @ turn.as_matrix(), position + mean[g][:3] + dt_s * velocity, velocity, rate

    def _about(self, *frames: int) -> PoseMotion:
        rotation, position, velocity, rate = (
            np.array(part) for part in zip(*(self.places[f] for f in frames), strict=True)
        )
        there = BodyPath(
            frames=BodyFrames(rotation=rotation, position_m=position), velocity_m_s=velocity, rate_rad_s=rate
        )
        return replace(self.pose, path=there)
