"""Motion of the whole pose: a subspace of shapes, a body that moves, a potential that holds the shape."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np
from mocap.filters.body_axes import BodyFrames
from mocap.filters.gaussian import Markers, Moments, Move, Smoothed, Update, View
from mocap.filters.limb_potential import LimbKeeper
from mocap.filters.motion.base import Keeper, MotionModel, Step, Steps
from mocap.filters.motion.potential import (
    Bones,
    Coordinates,
    PosePotential,
    bones_term,
    enforce,
    informed,
    potential_term,
)
from mocap.filters.motion.shape import LinearShape
from mocap.filters.subspace import PoseSubspace
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array, skew

VAGUE_RAD = 0.1
"""Standard deviation of the body's turn above which it is not taken as linear: half of its square times a marker's arm,
half a per cent of that, is what the first linear model is off by. On made poses whose markers are known to 2 % of their
arm, errors over stated deviations are then 1.2 to 1.6 at 0.15 rad, and 3 to 5 at 0.3 rad."""
TURNED_RAD = 0.01
"""Turn of the body of which the same is 5e-5 of the arm: as good as linear."""
STEP_RAD = 0.5
"""Turn at once: a Gauss-Newton step as far as a sine is its angle to 4 %."""


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
        finite = np.isfinite(self.xyz_m[..., 0])
        out = np.full_like(self.cov_m2, np.nan)
        out[finite] = np.linalg.inv(np.linalg.cholesky(self.cov_m2[finite]))
        return out


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseMotion(MotionModel):
    """State [z (r), zdot (r), u, g (6), gdot (6), b (6) | e (3M), e1 (3M), e2 (3M)]: a shared block, and chains of e.

    Markers are R exp(w) (mean + basis z + e) + c + p, where R, c is the body's path and g = [p, w] the body's own
    deviation from it, gdot its velocity less the path's (angular: in body axes). The body has accelerations b that
    last: the path is where it is linearised, and drops out of what is predicted.
    The shape z has ``mechanics``, u being forces of it that last; the residual e of each coordinate is a Matern-5/2
    process, (d/dt + a)^3 e = noise, with its own variance and rate: motion of animals has accelerations, and a
    rougher process states velocities twice as uncertain as they are. Its states are e1 = (d/dt + a) e and e2 =
    (d/dt + a) e1: of these a step is the same for all coordinates, but for a factor exp(-a dt). With an empirical
    potential the shape is held by that (``enforce``), in place of the constraints that nobody knows, as in the
    paper's empirical-analytical models. Constraints that are known, the lengths of rigid bones, hold shape and
    residual (``hold_bones``).

    Attributes:
        path: Path of the body.
        subspace: Subspace of poses.
        mechanics: Equation of motion of the shape.
        body: Mechanics of the body, three coordinates in m, three in rad: free, under forces (a mass of 1) that last.
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
    mechanics: LinearShape
    body: LinearShape
    shape_sd: Array
    body_sd: Array
    residual_rate_hz: Array
    usual: Moments | None = None
    regression: Regression | None = None
    bones: Bones | None = None
    bone_stiffness: float = 0.0
    potentials: tuple[PosePotential, ...] = ()
    name: str = "eal"
    farthest: float = np.inf

    def __post_init__(self) -> None:
        """One rate may stand for all coordinates."""
        if np.shape(self.residual_rate_hz) != self.subspace.mean.shape:
            rates = np.broadcast_to(self.residual_rate_hz, self.subspace.mean.shape)
            object.__setattr__(self, "residual_rate_hz", rates)

    @property
    def rank(self) -> int:
        """Number r of shapes."""
        return self.subspace.basis.shape[1]

    @cached_property
    def chains(self) -> int:
        """Where the chains begin."""
        return self.shape_states + self.body_states

    @cached_property
    def shape_states(self) -> int:
        """Numbers that belong to the shape: z, zdot, and forces that last."""
        return 2 * self.rank + len(self.mechanics.force)

    @property
    def body_states(self) -> int:
        """Numbers that belong to the body: g, gdot, and accelerations that last."""
        return 18

    @cached_property
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where [z, zdot, u], g, e, gdot and e1 are."""
        r, start, d = self.shape_states, self.chains, len(self.subspace.mean)
        e, e_rate = slice(start, start + d), slice(start + d, start + 2 * d)
        return slice(0, r), slice(r, r + 6), e, slice(r + 6, r + 12), e_rate

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return self.chains + 3 * len(self.subspace.mean)

    def initial(self) -> Moments:
        """The mean pose at rest, with the deviations of the samples."""
        sd = np.zeros(self.size)
        shape, g, _, g_rate, _ = self.parts
        sd[shape] = np.concatenate([self.shape_sd, self.mechanics.lasting_sd])
        sd[g], sd[g_rate] = self.body_sd[:6], self.body_sd[6:]
        sd[g_rate.stop : g_rate.stop + 6] = self.body.lasting_sd
        cov, e = np.diag(sd**2), slice(self.chains, None)
        cov[e, e] = self._chains(STATIONARY[..., None])
        return Moments(np.zeros(len(sd)), cov)

    def _chains(self, cov: Array) -> Array:
        """(3D, 3D) covariance of chains from that of processes of unit variance and rate, (3, 3, 1 or D)."""
        size = self.residual_rate_hz ** np.arange(3)[:, None] * self.subspace.residual_sd  # (3, D)
        blocks, d = size[:, None] * size * cov, size.shape[1]
        out = np.zeros((3, d, 3, d))
        out[:, np.arange(d), :, np.arange(d)] = np.moveaxis(blocks, -1, 0)
        return out.reshape(3 * d, 3 * d)

    def move(self, state: Moments, step: Step) -> Move:  # noqa: ARG002
        """The usual move, and what the path's own motion adds."""
        usual = self._usual_move(step.dt_s)
        _, g, _, g_rate, _ = self.parts
        shared, shift = usual.shared.copy(), np.array(usual.shift)
        along, speed, half = self._along(step.frame, step.dt_s)
        turn, spin = slice(g.start + 3, g.stop), slice(g_rate.start + 3, g_rate.stop)
        shared[turn, turn] = (half @ half).T  # in axes that turn with the path
        after = slice(spin.start, g_rate.stop + 6)
        shared[turn, after] = half.T @ shared[turn, after]
        shift[g], shift[g_rate] = along, speed
        return Move(shared, usual.chain, usual.noise, shift, usual.decay)

    @cached_property
    def _usual_moves(self) -> Steps[Move]:
        return Steps()

    def _usual_move(self, dt_s: float) -> Move:
        """A step whose path stands still; its shift is that of the shape's mechanics."""
        if dt_s not in self._usual_moves:
            shape, g, e, g_rate, _ = self.parts
            shared, noise = np.eye(self.chains), np.zeros((self.size,) * 2)
            shift, body = np.zeros(self.size), slice(g.start, g_rate.stop + 6)
            for part, mechanics in ((shape, self.mechanics), (body, self.body)):
                root = mechanics.noise(dt_s)
                noise[part, part] = root @ root.T
                shared[part, part], shift[part] = mechanics.flow(dt_s)
            steps = self.residual_rate_hz * dt_s
            noise[e.start :, e.start :] = self._chains(matern_noise(steps))
            chain = np.array([[1.0, dt_s, 0.5 * dt_s**2], [0.0, 1.0, dt_s], [0.0, 0.0, 1.0]])
            self._usual_moves[dt_s] = Move(shared, chain, noise, shift, np.exp(-steps))
        return self._usual_moves[dt_s]

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

    def markers(self, states: Array, frame: int) -> Array:
        """(S, M, 3) markers of states (S, n): in the body, then to the world."""
        turn, position = self.root(states, frame)
        return self._inside(states) @ np.swapaxes(turn, 1, 2) + position[:, None]

    def root(self, states: Array, frame: int) -> tuple[Array, Array]:
        """(S, 3, 3) axes of the body in the world, and (S, 3) its position."""
        g, frames = states[:, self.parts[1]], self.path.frames
        return frames.rotation[frame] @ Rotation.from_rotvec(g[:, 3:]).as_matrix(), frames.position_m[frame] + g[:, :3]

    def _inside(self, states: Array) -> Array:
        """(S, M, 3) markers in the body: shape and residual."""
        body = self.subspace.mean + states[:, : self.rank] @ self.subspace.basis.T + states[:, self.parts[2]]
        return body.reshape(len(states), -1, 3)

    def view(self, mean: Array, frame: int) -> View:
        """In axes of the body, u = mean + basis z + e moves by du + exp(-w) R^T dp + (exp(-w) J(w) dw) x u.

        J is the left Jacobian: exp(w + dw) = exp(J dw) exp(w) to first order; exp(-w) J(w) = J(w)^T.
        """
        g, r = self.parts[1], self.rank
        pose, (w, rotation) = self._inside(mean[None])[0], (mean[g][3:], self.path.frames.rotation[frame])
        own, jacobian = _exponential(w)
        turn = rotation @ own
        rows = np.zeros((len(pose), 3, g.stop))
        rows[:, :, :r] = self.subspace.basis.reshape(-1, 3, r)
        rows[:, :, g.start : g.start + 3] = turn.T
        rows[:, :, g.start + 3 :] = (skew(pose).reshape(-1, 3) @ -jacobian.T).reshape(-1, 3, 3)
        place = pose @ turn.T + self.path.frames.position_m[frame] + mean[g][:3]
        return View(place, rows.reshape(-1, g.stop), self.chains, turn)

    def further(self, prior: Moments, at: Array, found: Array) -> Array | None:
        """Where the body, whose turn was known to no more than ``VAGUE_RAD``, turned by more than ``TURNED_RAD``.

        So far that it turns by no more than ``STEP_RAD`` at once.
        """
        turn = slice(self.parts[1].start + 3, self.parts[1].stop)
        if np.linalg.eigvalsh(prior.cov[turn, turn])[-1] <= VAGUE_RAD**2:
            return None
        turned = float(np.linalg.norm(found[turn] - at[turn]))
        return at + min(1.0, STEP_RAD / turned) * (found - at) if turned > TURNED_RAD else None

    def shown(self, state: Smoothed, view: View, frame: int) -> tuple[Array, Array]:
        """Also where the turn is known to no more than ``VAGUE_RAD``: by sigma points over its three directions.

        Six points at sqrt(3) deviations of the turn, the rest of the state with its mean given that, and equal weights
        (Julier & Uhlmann 2004 with kappa = 0); what is left of the state's covariance moves markers linearly.
        """
        turn = slice(self.parts[1].start + 3, self.parts[1].stop)
        xyz, cov = super().shown(state, view, frame)
        if np.linalg.eigvalsh(state.filtered[turn, turn])[-1] <= VAGUE_RAD**2:  # smoothed, it is known no worse
            return xyz, cov
        values, axes = np.linalg.eigh(state.of(np.eye(turn.stop)[turn]))
        if values[-1] <= VAGUE_RAD**2:
            return xyz, cov
        known = values > 1e-12 * values[-1]
        steps = state.cov[:, turn] @ axes[:, known] / np.sqrt(values[known])  # (n, d): P_s w / sd
        far = np.sqrt(len(steps.T))
        points = self.markers(np.concatenate([state.mean + far * steps.T, state.mean - far * steps.T]), frame)
        mean = points.mean(axis=0)
        apart = points - mean
        linear = np.array([view.moved(step) for step in steps.T])
        cov = cov - np.einsum("kmi,kmj->mij", linear, linear)
        return mean, cov + np.einsum("kmi,kmj->mij", apart, apart) / len(points)

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:
        """Velocities of the markers.

        With u(q) the markers in the body, u' = du/dq q' and A = R exp(w), marker and velocity are x = A u + c + p and
        v = A u' + R (Omega x exp(w) u) + c' + p', where Omega = path rate + g' (rotation) is the angular velocity in
        body axes, to first order in w, the body's deviation from its path.
        """
        _, g, e, g_rate, e_rate = self.parts
        r, path, n, decay = self.rank, self.path, len(mean), self._decay_hz
        moving = -decay * mean
        moving[:r] += mean[r : 2 * r]
        moving[e] += mean[e_rate]
        pose, slope, bent = self._bent(mean, moving)
        turned, rotation = Rotation.from_rotvec(mean[g][3:]).as_matrix(), path.frames.rotation[frame]
        whole, omega = rotation @ turned, path.rate_rad_s[frame] + mean[g_rate][3:]
        pose, pose_rate = pose @ turned.T, slope @ moving @ turned.T
        velocity = (pose_rate + np.cross(omega, pose)) @ rotation.T + path.velocity_m_s[frame] + mean[g_rate][:3]
        out = np.zeros((len(pose), 6, n))
        position, speed = out[:, :3], out[:, 3:]
        position[:], speed[:] = whole @ slope, rotation @ skew(omega) @ turned @ slope + whole @ bent
        speed -= decay * position
        speed[:, :, r : 2 * r] = position[:, :, :r]
        speed[:, :, e_rate] = position[:, :, e]
        here, there = slice(g.start, g.start + 3), slice(g.start + 3, g.stop)
        lever = skew(pose)
        position[:, :, here] = speed[:, :, g_rate.start : g_rate.start + 3] = np.eye(3)
        position[:, :, there] = speed[:, :, g_rate.start + 3 : g_rate.stop] = -rotation @ lever
        speed[:, :, there] = -rotation @ (skew(pose_rate) + skew(omega) @ lever)
        return velocity, out.reshape(-1, n)

    def _bent(self, mean: Array, moving: Array) -> tuple[Array, Array, Array]:  # noqa: ARG002
        """U (M, 3), du/dq (M, 3, n) and du'/dq (M, 3, n), where q moves by ``moving`` a second."""
        slope = np.zeros((len(self.subspace.mean), len(mean)))
        slope[:, : self.rank], slope[:, self.parts[2]] = self.subspace.basis, np.eye(len(slope))
        slope = slope.reshape(-1, 3, len(mean))
        return self._inside(mean[None])[0], slope, np.zeros_like(slope)

    @property
    def _decay_hz(self) -> Array:
        """(n,) rates at which parts of the state are forgotten; of e, as e' = e1 - a e."""
        decay, e = np.zeros(self.size), self.parts[2]
        decay[e] = self.residual_rate_hz[: e.stop - e.start]
        return decay

    def constrain(self, state: Moments, step: Step) -> tuple[Moments, list[Update]]:
        """Condition on the regression; hold the shape by the potential and the bones, for the time of the step."""
        updates = []
        if self.regression is not None:
            which, xyz, whitening = self.regression.at(step.frame)
            if len(which):
                every = np.ones((len(which), 3), dtype=bool)

                def update(markers: Markers, shift: Array | None) -> tuple[Moments, Update]:
                    view = markers.view
                    here = (view.mean if shift is None else view.mean + shift)[which]
                    away = np.einsum("mji,mi->mj", whitening, xyz - here)
                    along = whitening if view.turn is None else whitening @ view.turn
                    return markers.condition(along, away, every, which)

                state, done = self.conditioned(state, step.frame, update)
                updates.append(done)
        terms = []
        for limb, (rows, reads) in zip(self.potentials, self._rows, strict=True):
            some = rows[:, reads]
            coordinates = Coordinates(limb.mean + some @ state.mean[reads], rows, some @ state.cov[reads])
            pull = partial(_scaled, limb.gradient, step.dt_s)
            terms.append(potential_term(pull, coordinates, least_sd=0.05))  # not along what is known to 5 %
        if self.bones is not None:
            inside = View(self._inside(state.mean[None])[0], self.subspace.basis, self.chains)
            terms.append(bones_term(self.bones, Markers(state, inside), step.dt_s * self.bone_stiffness))
        state, done = enforce(state, terms, farthest=self.farthest)
        return state, updates + done

    @cached_property
    def _rows(self) -> tuple[tuple[Array, NDArray[np.int64]], ...]:
        """How the coordinates of each potential change with the state, and with which components of it."""
        every = (limb.rows(self.chains) for limb in self.potentials)
        return tuple((rows, np.flatnonzero(rows.any(axis=0))) for rows in every)

    def moved(self, means: Array, residual: Array) -> Array:  # noqa: ARG002
        """(S, M, 3) by how much markers move in the axes of the root, of states (S, n), for changes (S, D) of e."""
        return residual.reshape(len(residual), -1, 3)

    def own(self, names: Sequence[str]) -> tuple[Keeper, ...]:
        """What potentials say of limbs that they hold, where velocities are asked for."""
        return LimbKeeper.of(self, names) if names else ()

    def informed(self, state: Smoothed) -> Smoothed:
        """The shape and its velocity are some that were recorded."""
        return state if self.usual is None else informed(state, self.usual)


STATIONARY = np.array([[1.0, 1.0, 2 / 3], [1.0, 4 / 3, 4 / 3], [2 / 3, 4 / 3, 8 / 3]])
"""Covariance of a Matern-5/2 process e of unit variance and rate with e1 = e' + e and e2 = e1' + e1: 16/3 times the
integral of g g^T over all times, g(s) = exp(-s) [s^2 / 2, s, 1] (Hartikainen & Sarkka 2010, in other coordinates)."""


def matern_flow(step: Array) -> Array:
    """(3, 3, D) transition of [e, e1, e2] of a Matern-5/2 process of unit rate, over steps (D,) times the rate."""
    one, zero = np.ones_like(step), np.zeros_like(step)
    return np.exp(-step) * np.array([[one, step, 0.5 * step**2], [zero, one, step], [zero, zero, one]])


def matern_noise(step: Array) -> Array:
    """(3, 3, D) covariance of what noise adds to [e, e1, e2] of a Matern-5/2 process of unit variance and rate.

    It is 16/3 times the integral of g g^T, g the last column of ``matern_flow``. By Gauss-Legendre quadrature it stays
    positive at any step, where P - F P F^T of short steps is a difference of nearly equal numbers.
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    end = np.minimum(step, 20.0)  # exp(-40) of it is left beyond
    times = 0.5 * end * (nodes[:, None] + 1)  # (24, D)
    last = matern_flow(times.ravel())[:, 2].reshape(3, *times.shape)  # (3, 24, D)
    return 16 / 3 * np.einsum("iqd,jqd,qd->ijd", last, last, 0.5 * end * weights[:, None])


def _scaled(gradient: Callable[[Array], Array], factor: float, q: Array) -> Array:
    return factor * gradient(q)


def _exponential(w: Array) -> tuple[Array, Array]:
    """exp(w) (3, 3) of a rotation vector, and its left Jacobian J: exp(w + dw) = exp(J dw) exp(w) to first order.

    In numbers of Python: of so few, NumPy's calls take ten times as long.
    """
    x, y, z = w.tolist()
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        sine, versine, rest = 1 - angle2 / 6, 0.5, 1 / 6
    else:
        angle = sqrt(angle2)
        sine, versine = sin(angle) / angle, (1 - cos(angle)) / angle2
        rest = (1 - sine) / angle2

    def matrix(a: float, b: float) -> Array:  # 1 + a K + b K^2, K the cross product with w
        return np.array(
            [
                [1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y],
                [b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x],
                [b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)],
            ]
        )

    return matrix(sine, versine), matrix(versine, rest)
