"""Motion of the whole pose: a subspace of shapes, a trunk that moves, a potential that holds the shape."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from filters.ensemble import Gaussian, SigmaPoints, default_points
from filters.motion.base import MotionModel
from filters.motion.constant_velocity import white_acceleration
from filters.motion.enforce import enforce
from filters.subspace import PoseSubspace
from mocap.arrays import Array
from mocap.body import BodyFrames


def rigid_modes(mean: Array) -> Array:
    """(D, 6) unit directions of the pose under small translations and rotations of the whole body."""
    points = mean.reshape(-1, 3) - mean.reshape(-1, 3).mean(axis=0)
    modes = [np.broadcast_to(axis, points.shape) for axis in np.eye(3)] + [np.cross(axis, points) for axis in np.eye(3)]
    columns = np.stack([m.ravel() for m in modes], axis=1)
    return columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseMotion(MotionModel):
    """State [z (r), g (6), e (3M)] and its velocities, about a frame that travels with the body.

    Markers are R (mean + basis z + rigid g + e) + position. The shape z and the rigid correction g of the body frame
    are driven by white acceleration; the residual e of each coordinate is a Matern-3/2 process, e'' + 2 a e' + a^2 e =
    noise, with its own variance. With an empirical potential the shape is held by that (``enforce``), in place of the
    constraints that nobody knows: the empirical-analytical Lagrangian of the paper with T = |zdot|^2 / 2 and no other
    known force.

    Attributes:
        frames: Body frame of every frame of the recording.
        subspace: Subspace of poses.
        density: (r + 6,) spectral density of the accelerations of z and g.
        start_sd: (2 (r + 6),) standard deviations of z, g and of their velocities before anything is seen.
        residual_rate_hz: The rate a of the residual, 1/s.
        gradient: (S, r) shapes to (S, r) gradients of the potential over eps^2, a second; None: no potential.
        name: For reports.
    """

    frames: BodyFrames
    subspace: PoseSubspace
    density: Array
    start_sd: Array
    residual_rate_hz: float
    gradient: Callable[[Array], Array] | None = None
    name: str = "eal"
    linear: bool = True
    reads: int = field(init=False)
    points: SigmaPoints = field(init=False)
    rank: int = field(init=False)
    modes: Array = field(init=False)

    def __post_init__(self) -> None:
        """Sizes and modes."""
        rank = self.subspace.basis.shape[1]
        reads = rank + 6 + len(self.subspace.mean)
        object.__setattr__(self, "rank", rank)
        object.__setattr__(self, "reads", reads)
        object.__setattr__(self, "points", default_points(2 * reads))
        modes = np.column_stack([self.subspace.basis, rigid_modes(self.subspace.mean)])
        object.__setattr__(self, "modes", modes)

    def initial(self) -> Gaussian:
        """The mean pose at rest, with the deviations of the samples."""
        k, sd = self.rank + 6, self.subspace.residual_sd
        start = np.concatenate([self.start_sd[:k], sd, self.start_sd[k:], self.residual_rate_hz * sd])
        return Gaussian(np.zeros(len(start)), np.diag(start))

    def step(self, states: Array, dt_s: float) -> Array:
        """Shape and frame move on with their velocities, the residual relaxes."""
        k, reads = self.rank + 6, self.reads
        out = states.copy()
        out[:, :k] += dt_s * states[:, reads : reads + k]
        keep, a = np.exp(-self.residual_rate_hz * dt_s), self.residual_rate_hz
        e, velocity = states[:, k:reads], states[:, reads + k :]
        out[:, k:reads] = keep * ((1 + a * dt_s) * e + dt_s * velocity)
        out[:, reads + k :] = keep * ((1 - a * dt_s) * velocity - a**2 * dt_s * e)
        return out

    def noise(self, dt_s: float) -> Array:
        """White acceleration of shape and frame; for the residual what keeps its variance."""
        reads, a = self.reads, self.residual_rate_hz
        factor = np.zeros((2 * reads, 2 * reads))
        i = np.arange(reads)
        keep = np.exp(-a * dt_s)
        transition = keep * np.array([[1 + a * dt_s, dt_s], [-(a**2) * dt_s, 1 - a * dt_s]])
        stationary = np.diag([1.0, a**2])
        matern = np.linalg.cholesky(stationary - transition @ stationary @ transition.T)
        white, sd = white_acceleration(self.density, dt_s), self.subspace.residual_sd
        factor[i, i] = np.concatenate([white[0], matern[0, 0] * sd])
        factor[reads + i, i] = np.concatenate([white[1], matern[1, 0] * sd])
        factor[reads + i, reads + i] = np.concatenate([white[2], matern[1, 1] * sd])
        return factor

    def markers(self, states: Array, frame: int) -> Array:
        """Shape, rigid correction and residual in the body, then to the world."""
        k = self.rank + 6
        body = self.subspace.mean + states[:, :k] @ self.modes.T + states[:, k : self.reads]
        return body.reshape(len(states), -1, 3) @ self.frames.rotation[frame].T + self.frames.position_m[frame]

    def constrain(self, state: Gaussian, dt_s: float) -> Gaussian:
        """Hold the shape by the potential, for the time of the step."""
        pull = self.gradient
        return state if pull is None else enforce(state, lambda z: dt_s * pull(z), self.rank)
