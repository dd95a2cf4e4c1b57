"""Motion of the whole pose: a subspace of shapes, a body that moves, a potential that holds the shape."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from mocap.filters.body_axes import BodyFrames
from mocap.filters.ensemble import Gaussian, Prediction, SigmaPoints, condition, default_points, each_marker, predicted
from mocap.filters.motion.base import MotionModel, Step
from mocap.filters.motion.bones import Bones, Differences, bones_term, differences
from mocap.filters.motion.constant_velocity import white_acceleration
from mocap.filters.motion.enforce import enforce, informed, potential_term
from mocap.filters.motion.potential import PosePotential
from mocap.filters.motion.shape import ShapeMechanics
from mocap.filters.subspace import PoseSubspace
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array

LEAST_SD = 0.05
"""Potentials do not look along directions of a pose that are known better than to this share of what was recorded."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyPath:
    """A path near which the body moves: the point about which its position and orientation are linearised.

    Attributes:
        frames: Body frame of every frame of the recording.
        velocity_m_s: (T, 3) velocity of the origin.
        rate_rad_s: (T, 3) angular velocity in body axes.
    """

    frames: BodyFrames
    velocity_m_s: Array
    rate_rad_s: Array


def body_path(frames: BodyFrames, t_s: Array) -> BodyPath:
    """The path through body frames, with central differences for its velocities."""
    if len(t_s) < 2:
        still = np.zeros((len(t_s), 3))
        return BodyPath(frames=frames, velocity_m_s=still, rate_rad_s=still)
    turn = Rotation.from_matrix(np.swapaxes(frames.rotation[:-1], 1, 2) @ frames.rotation[1:]).as_rotvec()
    rate = turn / np.diff(t_s)[:, None]
    rate = 0.5 * (np.concatenate([rate[:1], rate]) + np.concatenate([rate, rate[-1:]]))
    return BodyPath(frames=frames, velocity_m_s=np.gradient(frames.position_m, t_s, axis=0), rate_rad_s=rate)


class PathStep(NamedTuple):
    """What a path's own motion does in steps of time, (n, ...) each.

    Attributes:
        shift: (n, 6) what it adds to the body's deviation from the path.
        speed: (n, 6) and to the rate of that.
        half: (n, 3, 3) half of its turn.
    """

    shift: Array
    speed: Array
    half: Array


def path_steps(path: BodyPath, dt_s: float, part: slice = slice(None)) -> PathStep:
    """The steps from frame to frame of a part of a path, each of the same time."""
    position, rotation = path.frames.position_m[part], path.frames.rotation[part]
    velocity, rate = path.velocity_m_s[part], path.rate_rad_s[part]
    half = Rotation.from_rotvec(0.5 * dt_s * rate[:-1]).as_matrix()
    moved = position[:-1] + dt_s * velocity[:-1] - position[1:]
    turned = Rotation.from_matrix(np.swapaxes(rotation[1:], 1, 2) @ rotation[:-1] @ half @ half).as_rotvec()
    return PathStep(
        np.concatenate([moved, turned], axis=1),
        np.concatenate([velocity[:-1] - velocity[1:], rate[:-1] - rate[1:]], axis=1),
        half,
    )


@dataclass(frozen=True, eq=False)
class Regression:
    """Markers of a recording where they are not seen, as a regression on those that are seen has them.

    Attributes:
        xyz_m: (T, M, 3) positions in the world; NaN where it has none.
        cov_m2: (T, M, 3, 3) covariance with which each frame is one observation more: of errors that last for many
            frames it is so many times that of one.
    """

    xyz_m: Array
    cov_m2: Array

    def at(self, frame: int) -> tuple[NDArray[np.int64], Array, Array]:
        """The m markers that it has in a frame, (m, 3) where, and (m, 3, 3) what whitens their errors."""
        which = np.flatnonzero(np.isfinite(self.xyz_m[frame, :, 0]))
        return which, self.xyz_m[frame, which], self._whitening[frame, which]

    @cached_property
    def _whitening(self) -> Array:
        """(T, M, 3, 3)."""
        known = np.isfinite(self.xyz_m[..., 0])
        out = np.full_like(self.cov_m2, np.nan)
        out[known] = np.linalg.inv(np.linalg.cholesky(self.cov_m2[known]))
        return out


class Reference(NamedTuple):
    """Where potentials of a pose are linearised.

    Attributes:
        held: Mean and factor of the coordinates of each potential.
        bones: Differences of the ends of bones; None: it has none.
    """

    held: tuple[Gaussian, ...]
    bones: Differences | None


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseMotion(MotionModel):
    """State [z (r), zdot (r), u, g (6), e (3M), gdot (6), edot (3M), eddot (3M)], u forces of the shape that last.

    Markers are R exp(w) (mean + basis z + e) + c + p, where R, c is the body's path and g = [p, w] the body's own
    deviation from it, gdot its velocity less the path's (angular: in body axes). The body moves with white acceleration
    and angular acceleration: the path is where it is linearised, and drops out of what is predicted. The shape z has
    ``mechanics``; the residual e of each coordinate is a Matern-5/2 process, (d/dt + a)^3 e = noise, with its own
    variance and rate: positions of animals have accelerations, and a rougher process states velocities twice as
    uncertain as they are. With an empirical potential the shape is held by that (``enforce``), in place of the
    constraints that nobody knows, as in the paper's empirical-analytical models. Constraints that are known, the
    lengths of rigid bones, hold shape and residual (``hold_bones``).

    Attributes:
        path: Path of the body.
        subspace: Subspace of poses.
        mechanics: Equation of motion of the shape.
        body_density: (6,) spectral density of the accelerations of the body: m^2/s^3, rad^2/s^3.
        shape_sd: (2r,) standard deviations of z and zdot before anything is seen.
        body_sd: (12,) the same of g and gdot.
        residual_rate_hz: (3M,) the rate a of the residual of each coordinate, 1/s; or one of all.
        usual: Recorded z and zdot: what they are when nothing is seen.
        potentials: What holds the pose.
        regression: Where a regression has markers that are not seen; None: there is none.
        bones: Distances that markers keep; None: none are known.
        bone_stiffness: Factor on their potential V_b, a second.
        name: For reports.
        farthest: Potentials move a state by at most so many of its deviations.
    """

    path: BodyPath
    subspace: PoseSubspace
    mechanics: ShapeMechanics
    body_density: Array
    shape_sd: Array
    body_sd: Array
    residual_rate_hz: Array
    usual: Gaussian | None = None
    regression: Regression | None = None
    bones: Bones | None = None
    bone_stiffness: float = 0.0
    potentials: tuple[PosePotential, ...] = ()
    name: str = "eal"
    linear: bool = True
    farthest: float = np.inf
    reads: int = field(init=False)
    points: SigmaPoints = field(init=False)
    rank: int = field(init=False)

    def __post_init__(self) -> None:
        """Sizes."""
        rank, size = self.subspace.basis.shape[1], len(self.subspace.mean)
        object.__setattr__(self, "rank", rank)
        object.__setattr__(self, "residual_rate_hz", np.broadcast_to(self.residual_rate_hz, size))
        object.__setattr__(self, "reads", self.shape_states + 6 + size)
        object.__setattr__(self, "points", default_points(self.shape_states + 12 + 3 * size))

    @cached_property
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where [z, zdot], g, e, gdot and edot are."""
        r, d = self.shape_states, len(self.subspace.mean)
        ends = np.cumsum([0, r, 6, d, 6, d])
        shape, g, e, g_rate, e_rate = (slice(a, b) for a, b in itertools.pairwise(ends.tolist()))
        return shape, g, e, g_rate, e_rate

    @property
    def shape_states(self) -> int:
        """Components of the state that belong to the shape: z, zdot, and forces that last."""
        return 2 * self.rank + len(self.mechanics.lasting_sd)

    @property
    def residual(self) -> Array:
        """(3, D) components of the state that e, edot and eddot of each coordinate are."""
        _, _, e, _, e_rate = self.parts
        return np.array([e.start, e_rate.start, e_rate.stop])[:, None] + np.arange(len(self.residual_rate_hz))

    def initial(self) -> Gaussian:
        """The mean pose at rest, with the deviations of the samples."""
        shape, g, _, g_rate, _ = self.parts
        factor = np.zeros((self.points.n, self.points.n))
        shape_sd = np.concatenate([self.shape_sd, self.mechanics.lasting_sd])
        for part, sd in ((shape, shape_sd), (g, self.body_sd[:6]), (g_rate, self.body_sd[6:])):
            factor[part, part] = np.diag(sd)
        factor[self.residual[:, None], self.residual] = self._scaled(np.linalg.cholesky(STATIONARY))
        return Gaussian(np.zeros(len(factor)), factor)

    def advance(self, states: Array, dt_s: float) -> Array:
        """Body deviation and residual move on; the shape is left as it is (``predict`` moves it)."""
        _, g, _, g_rate, _ = self.parts
        out = states.copy()
        out[:, g] += dt_s * states[:, g_rate]
        out[:, self.residual] = np.einsum("ijd,sjd->sid", self._flow(dt_s), states[:, self.residual])
        return out

    def predict(self, state: Gaussian, step: Step) -> Prediction:
        """The shape by its mechanics, linearised under the state's uncertainty; everything else is linear."""
        shape, g, _, g_rate, _ = self.parts
        r = self.shape_states
        mean, transition, bent = self.mechanics.linearised(Gaussian(state.mean[:r], state.factor[:r, :r]), step.dt_s)
        states = np.concatenate([state.mean[None], state.factor.T])
        both = self.advance(states, step.dt_s)
        turn, spin = slice(g.start + 3, g.stop), slice(g_rate.start + 3, g_rate.stop)
        shift, speed, half = self._along(step.frame, step.dt_s)
        both[:, turn] = (states[:, turn] @ half + step.dt_s * states[:, spin]) @ half  # in axes that turn with the path
        ahead, rows = both[0], both[1:]
        ahead[shape], rows[:, shape] = mean, state.factor[shape].T @ transition.T
        ahead[g] += shift
        ahead[g_rate] += speed
        if bent.shape[1]:
            extra = np.zeros((bent.shape[1], len(ahead)))
            extra[:, shape] = bent.T
            rows = np.concatenate([rows, extra])
        return predicted(ahead, rows, step.noise, step.noise_cov)

    @cached_property
    def _steps(self) -> list[tuple[float, PathStep]]:
        """The time of the first step, and all steps of the path in that time; empty until ``_along`` makes them."""
        return []

    def _along(self, frame: int, dt_s: float) -> PathStep:
        """What the path's own motion adds in the step to a frame; known beforehand for steps of the first's time."""
        if not self._steps:
            self._steps.append((dt_s, path_steps(self.path, dt_s)))
        usual_s, steps = self._steps[0]
        if abs(dt_s - usual_s) <= 1e-9 * usual_s:
            return PathStep(*(part[frame - 1] for part in steps))
        return PathStep(*(part[0] for part in path_steps(self.path, dt_s, slice(frame - 1, frame + 1))))

    def _flow(self, dt_s: float) -> Array:
        """(3, 3, D) transition of e, edot and eddot of each coordinate."""
        a = self.residual_rate_hz
        power = np.arange(3)[:, None]
        return matern_flow(a * dt_s) * a ** (power[:, None] - power)

    def _scaled(self, factor: Array) -> Array:
        """(3, 3, D) factor of e, edot and eddot from that of a process of unit rate and variance."""
        whole = factor if factor.ndim == 3 else factor[..., None]
        return whole * self.residual_rate_hz ** np.arange(3)[:, None, None] * self.subspace.residual_sd

    def noise(self, dt_s: float) -> Array:
        """That of the mechanics; white acceleration of the body; for the residual what keeps its variance."""
        shape, g, _, g_rate, _ = self.parts
        factor = np.zeros((self.points.n, self.points.n))
        factor[shape, shape] = self.mechanics.noise(dt_s)
        l11, l21, l22 = white_acceleration(self.body_density, dt_s)
        index = np.arange(self.points.n)
        factor[index[g], index[g]] = l11
        factor[index[g_rate], index[g]] = l21
        factor[index[g_rate], index[g_rate]] = l22
        factor[self.residual[:, None], self.residual] = self._scaled(matern_noise(self.residual_rate_hz * dt_s))
        return factor

    def markers(self, states: Array, frame: int) -> Array:
        """Shape and residual in the body, then to the world."""
        _, g, e, _, _ = self.parts
        frames = self.path.frames
        body = self.subspace.mean + states[:, : self.rank] @ self.subspace.basis.T + states[:, e]
        turn = frames.rotation[frame] @ Rotation.from_rotvec(states[:, g][:, 3:]).as_matrix()
        position = frames.position_m[frame] + states[:, g][:, :3]
        return body.reshape(len(states), -1, 3) @ np.swapaxes(turn, 1, 2) + position[:, None]

    def deviations(self, state: Gaussian, frame: int) -> tuple[Array, Array]:
        """As ``markers`` has them, linearised in closed form: d exp(w) u = (J(w) dw) x exp(w) u."""
        _, g, _, _, _ = self.parts
        pose, rows = self._pose(state)
        w = state.mean[g][3:]
        rotation = self.path.frames.rotation[frame]
        own, jacobian = _exponential(w)
        turn = rotation @ own
        body = pose @ turn.T
        moved = state.factor[g, : self.reads]
        turned = rotation @ jacobian @ moved[3:]
        lever = _skew(body).reshape(-1, 3)  # x cross u = -skew(u) x
        out = (rows.reshape(-1, 3) @ turn.T).reshape(rows.shape)
        out -= (turned.T @ lever.T).reshape(out.shape)
        out += moved[:3].T[:, None]
        return body + self.path.frames.position_m[frame] + state.mean[g][:3], out

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:
        """Velocities of the markers, in closed form.

        With u = mean + basis z + e and A = R exp(w), marker and velocity are x = A u + c + p and
        v = A u' + R (Omega x exp(w) u) + c' + p', where Omega = path rate + g' (rotation) is the angular velocity in
        body axes, to first order in w, the body's deviation from its path.
        """
        _, g, e, g_rate, e_rate = self.parts
        r, path, basis = self.rank, self.path, self.subspace.basis
        rotation, n = path.frames.rotation[frame], len(mean)
        w, (drift, spin) = mean[g][3:], np.split(mean[g_rate], 2)
        turned = Rotation.from_rotvec(w).as_matrix()
        whole = rotation @ turned
        pose = (self.subspace.mean + basis @ mean[:r] + mean[e]).reshape(-1, 3) @ turned.T
        pose_rate = (basis @ mean[r : 2 * r] + mean[e_rate]).reshape(-1, 3) @ turned.T
        omega = path.rate_rad_s[frame] + spin
        relative = pose_rate + np.cross(omega, pose)
        velocity = relative @ rotation.T + path.velocity_m_s[frame] + drift
        count = len(pose)
        out = np.zeros((count, 6, n))
        position, speed = out[:, :3], out[:, 3:]
        carried = rotation @ _skew(omega) @ turned  # d v / d u
        each = np.arange(count)
        shapes = basis.reshape(count, 3, r)
        position[:, :, :r] = whole @ shapes
        speed[:, :, :r], speed[:, :, r : 2 * r] = carried @ shapes, whole @ shapes
        for column in range(3):
            position[each, :, e.start + 3 * each + column] = whole[:, column]
            speed[each, :, e.start + 3 * each + column] = carried[:, column]
            speed[each, :, e_rate.start + 3 * each + column] = whole[:, column]
        here, there = slice(g.start, g.start + 3), slice(g.start + 3, g.stop)
        position[:, :, here] = np.eye(3)
        lever = _skew(pose)
        position[:, :, there] = -rotation @ lever
        speed[:, :, there] = -rotation @ (_skew(pose_rate) + _skew(omega) @ lever)
        speed[:, :, g_rate.start : g_rate.start + 3] = np.eye(3)
        speed[:, :, g_rate.start + 3 : g_rate.stop] = -rotation @ lever
        return velocity, out

    def constrain(self, state: Gaussian, step: Step, about: "Reference | None" = None) -> Gaussian:
        """Condition on the regression; hold the shape by the potential and the bones, for the time of the step."""
        dt_s = step.dt_s
        if self.regression is not None:
            which, xyz, whitening = self.regression.at(step.frame)
            if len(which):
                before = state

                def update(mean: Array, rows: Array, shift: Array | None) -> tuple[Gaussian, Array]:
                    predicted = (mean if shift is None else mean + shift)[which]
                    rows = each_marker(rows[:, which], np.swapaxes(whitening, 1, 2)).reshape(len(rows), -1)
                    away = np.einsum("mji,mi->mj", whitening, xyz - predicted).ravel()
                    return condition(before, np.ascontiguousarray(rows), away, self.reads)[:2]

                state, _ = self.conditioned(before, step.frame, update)
        terms = []
        for i, held in enumerate(self.potentials):
            at = None if about is None else about.held[i]
            coordinates = held.coordinates(state, self.parts[2], self.reads)
            pull = partial(_scaled, held.gradient, dt_s)
            terms.append(potential_term(pull, coordinates, about=at, least_sd=LEAST_SD))
        if self.bones is not None:
            ends = None if about is None else about.bones
            terms.append(bones_term(self.bones, *self._pose(state), dt_s * self.bone_stiffness, about=ends))
        return enforce(state, terms, farthest=self.farthest)

    def moved(self, means: Array, residual: Array) -> Array:  # noqa: ARG002
        """(S, M, 3) by how much markers move in the axes of the root, of states (S, n), for changes (S, D) of e."""
        return residual.reshape(len(residual), -1, 3)

    def reference(self, state: Gaussian) -> "Reference | None":
        """What the potentials read, and the differences of the ends of bones."""
        if not self.potentials and self.bones is None:
            return None
        return Reference(
            tuple(held.marginal(state, self.parts[2], self.reads) for held in self.potentials),
            None if self.bones is None else differences(self.bones, *self._pose(state)),
        )

    def _pose(self, state: Gaussian) -> tuple[Array, Array]:
        """(M, 3) markers in the body, and their (k, M, 3) ensemble rows."""
        r, k, (_, _, e, _, _), basis = self.rank, self.reads, self.parts, self.subspace.basis
        pose = self.subspace.mean + basis @ state.mean[:r] + state.mean[e]
        deviations = state.factor[:r, :k].T @ basis.T + state.factor[e, :k].T
        return pose.reshape(-1, 3), deviations.reshape(k, -1, 3)

    def informed(self, state: Gaussian) -> Gaussian:
        """The shape and its velocity are some that were recorded."""
        return state if self.usual is None else informed(state, self.usual)


STATIONARY = np.array([[1.0, 0.0, -1 / 3], [0.0, 1 / 3, 0.0], [-1 / 3, 0.0, 1.0]])
"""Covariance of a Matern-5/2 process e of unit variance and rate with e' and e'' (Hartikainen & Sarkka 2010)."""


def matern_flow(step: Array) -> Array:
    """(3, 3, D) transition of [e, e', e''] of a Matern-5/2 process of unit rate, over steps (D,) times the rate.

    exp(A s) = exp(-s) (I + N s + N^2 s^2 / 2): A, the companion of (d/dt + 1)^3, is -I + N with N^3 = 0.
    """
    nilpotent = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [-1.0, -3.0, -2.0]])
    powers = np.stack([np.eye(3), nilpotent, nilpotent @ nilpotent / 2], axis=-1)
    return np.exp(-step) * (powers @ np.stack([np.ones_like(step), step, step**2]))


def matern_noise(step: Array) -> Array:
    """(3, 3, D) lower factor of what noise adds to [e, e', e''] of a Matern-5/2 process of unit variance and rate.

    The covariance is 16/3 times the integral of g g^T, g the last column of ``matern_flow``. By Gauss-Legendre
    quadrature it stays positive at any step, where 1 - F F^T of short steps is a difference of nearly equal numbers.
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    end = np.minimum(step, 20.0)  # exp(-40) of it is left beyond
    times = 0.5 * end * (nodes[:, None] + 1)  # (24, D)
    last = np.moveaxis(matern_flow(times.ravel())[:, 2].reshape(3, *times.shape), 1, -1)  # (3, D, 24)
    cov = 16 / 3 * np.einsum("idq,jdq,dq->dij", last, last, 0.5 * end[:, None] * weights)
    return np.moveaxis(np.linalg.cholesky(cov), 0, -1)


def _scaled(gradient: Callable[[Array], Array], factor: float, q: Array) -> Array:
    return factor * gradient(q)


def _exponential(w: Array) -> tuple[Array, Array]:
    """exp(w) (3, 3) of a rotation vector, and its left Jacobian J: exp(w + dw) = exp(J dw) exp(w) to first order."""
    angle2 = float(w @ w)
    if angle2 < 1e-8:
        sine, versine, rest = 1 - angle2 / 6, 0.5, 1 / 6
    else:
        angle = np.sqrt(angle2)
        sine, versine = np.sin(angle) / angle, (1 - np.cos(angle)) / angle2
        rest = (1 - sine) / angle2
    k = _skew(w)
    square = k @ k
    return np.eye(3) + sine * k + versine * square, np.eye(3) + versine * k + rest * square


def _skew(v: Array) -> Array:
    """(..., 3, 3) matrices of the cross product with (..., 3) vectors."""
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return out
