"""Motion of an animal of rigid segments by its own Lagrangian."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from mocap.filters.animal import Animal, Moving
from mocap.filters.errors import FilterError
from mocap.filters.gaussian import Moments, Move, Smoothed
from mocap.filters.motion.articulated import ArticulatedMotion
from mocap.filters.motion.base import Keeper, Step, Steps
from mocap.filters.motion.constant_velocity import white_acceleration
from mocap.filters.tree import left_jacobian
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array, skew
from eal.integrators import IntegrationError


@dataclass(eq=False)
class EnergyKeeper:
    """The energies of every smoothed frame (``filters.motion.base.Keeper``).

    Attributes:
        model: The motion model.
    """

    model: "LagrangianMotion"
    _taken: list[tuple[float, float, float]] = field(default_factory=list)

    def take(self, frame: int, state: Smoothed) -> None:
        """One frame's energies."""
        self._taken.append(self.model.energy_of(state.mean, frame))

    def values(self) -> dict[str, NDArray[Any]]:
        """``energies`` (T, 3), as of ``LagrangianMotion.energy_of``."""
        return {"energies": np.array(self._taken[::-1])}


@dataclass(frozen=True, eq=False, kw_only=True)
class LagrangianMotion(ArticulatedMotion):
    """State [z (F), zdot (F), g (6), gdot (6), s (3M)]: z are all joint angles in arc length, less their mean.

    ``ArticulatedMotion`` with the mechanics of the whole animal, its true M(q) and all, in place of learned ones in a
    subspace. A frame is one implicit midpoint step of the Lagrangian from the mean, linearised by its derivative; what
    the Lagrangian lacks (muscles, air) is white noise of the accelerations of each joint, learned, and of the root.
    Without noise and damping the mean keeps its energy to the order of the step, and stays inside Theorem 3's bound.

    Attributes:
        animal: The Lagrangian.
        white: (F, F) lower factor of the spectral density of the joints' accelerations in arc length, m^2/s^3.
    """

    animal: Animal
    white: Array
    name: str = "lagrangian"

    @cached_property
    def shape_states(self) -> int:
        """Numbers that belong to the joints: z and zdot."""
        return 2 * self.rank

    @property
    def body_states(self) -> int:
        """Numbers that belong to the root: g and gdot."""
        return 12

    @cached_property
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where [z, zdot], g, nothing, gdot and nothing are."""
        r, none = 2 * self.rank, slice(self.chains, self.chains)
        return slice(0, r), slice(r, r + 6), none, slice(r + 6, r + 12), none

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return self.chains

    def moving(self, mean: Array, frame: int) -> Moving:
        """The state of the animal of a mean."""
        _, g, _, g_rate, _ = self.parts
        r, path = self.rank, self.path
        turned = Rotation.from_rotvec(mean[g][3:]).as_matrix()
        return Moving(
            position_m=path.frames.position_m[frame] + mean[g][:3],
            turn=path.frames.rotation[frame] @ turned,
            angles=self.angles(mean[None])[0],
            velocity=np.concatenate(
                [
                    path.velocity_m_s[frame] + mean[g_rate][:3],
                    (path.rate_rad_s[frame] + mean[g_rate][3:]) @ turned,
                    mean[r : 2 * r] / self.arm_m,
                ]
            ),
        )

    def mean_of(self, moving: Moving, frame: int, slip: Array) -> Array:
        """The mean of a state of the animal: the inverse of ``moving``."""
        _, g, _, g_rate, _ = self.parts
        r, path = self.rank, self.path
        out = np.zeros(self.size)
        out[:r] = moving.angles * self.arm_m - self.subspace.mean
        out[r : 2 * r] = moving.velocity[6:] * self.arm_m
        turned = path.frames.rotation[frame].T @ moving.turn
        out[g] = np.concatenate(
            [moving.position_m - path.frames.position_m[frame], Rotation.from_matrix(turned).as_rotvec()]
        )
        out[g_rate][:3] = moving.velocity[:3] - path.velocity_m_s[frame]
        out[g_rate][3:] = turned @ moving.velocity[3:6] - path.rate_rad_s[frame]
        out[self.slip] = slip
        return out

    def move(self, state: Moments, step: Step) -> Move:
        """The animal by its Lagrangian, linearised about the mean; slip is forgotten."""
        start = self.moving(state.mean, step.frame - 1)
        try:
            end, slope = self.animal.step(start, step.dt_s)
        except IntegrationError as error:
            raise FilterError(
                f"the animal's Lagrangian cannot be followed beyond frame {step.frame} of the part that is tracked "
                f"({error}): use the articulated model, or state masses and bones that fit"
            ) from error
        kept = np.exp(-self.slip_rate_hz * step.dt_s)
        mean = self.mean_of(end, step.frame, kept * state.mean[self.slip])
        w0, w1 = state.mean[self.parts[1]][3:], mean[self.parts[1]][3:]
        shared, moves = kept * np.eye(self.size), self._moves
        shared[np.ix_(moves, moves)] = self._from_animal(end, w1) @ slope @ self._to_animal(start, w0)
        if step.dt_s not in self._noises:
            self._noises[step.dt_s] = self.noise(step.dt_s)
        return Move(shared, np.zeros((0, 0)), self._noises[step.dt_s], mean - shared @ state.mean)

    @cached_property
    def _noises(self) -> Steps[Array]:
        return Steps()

    @cached_property
    def _moves(self) -> NDArray[np.int64]:
        """(12 + 2F,) components of the state that the animal is: g and z, then their rates."""
        shape, g, _, g_rate, _ = self.parts
        index = np.arange(self.size)
        z, rate = np.split(index[shape], 2)
        return np.concatenate([index[g], z, index[g_rate], rate])

    def _to_animal(self, start: Moving, w: Array) -> Array:
        """Derivative of the animal's [position, turn, angles, velocity] by these components."""
        n = 6 + self.rank
        turned = Rotation.from_rotvec(w).as_matrix()
        tilt = left_jacobian(-w)
        out = np.eye(2 * n)
        out[3:6, 3:6] = tilt
        out[6:n, 6:n] = out[n + 6 :, n + 6 :] = np.diag(1 / self.arm_m)
        out[n + 3 : n + 6, n + 3 : n + 6] = turned.T
        out[n + 3 : n + 6, 3:6] = skew(start.velocity[3:6]) @ tilt
        return out

    def _from_animal(self, end: Moving, w: Array) -> Array:
        """The inverse derivative, at the end of a step."""
        n = 6 + self.rank
        turned = Rotation.from_rotvec(w).as_matrix()
        out = np.eye(2 * n)
        out[3:6, 3:6] = np.linalg.inv(left_jacobian(-w))
        out[6:n, 6:n] = out[n + 6 :, n + 6 :] = np.diag(self.arm_m)
        out[n + 3 : n + 6, n + 3 : n + 6] = turned
        out[n + 3 : n + 6, 3:6] = -turned @ skew(end.velocity[3:6])
        return out

    def noise(self, dt_s: float) -> Array:
        """(n, n) covariance: white accelerations of joints and root; of slip what keeps its variance."""
        factor, index = np.zeros((self.size,) * 2), np.arange(self.size)
        shape, g, _, g_rate, _ = self.parts
        l11, l21, l22 = white_acceleration(np.ones(1), dt_s)
        zero = np.zeros_like(self.white)
        factor[shape, shape] = np.block([[l11 * self.white, zero], [l21 * self.white, l22 * self.white]])
        l11, l21, l22 = white_acceleration(np.diag(self.body.density) ** 2, dt_s)
        factor[index[g], index[g]], factor[index[g_rate], index[g_rate]] = l11, l22
        factor[index[g_rate], index[g]] = l21
        slip = index[self.slip]
        factor[slip, slip] = np.sqrt(-np.expm1(-2 * self.slip_rate_hz * dt_s)) * np.repeat(self.slip_sd, 3)
        return factor @ factor.T

    def initial(self) -> Moments:
        """The mean pose at rest, with the deviations of the samples."""
        sd = np.zeros(self.size)
        shape, g, _, g_rate, _ = self.parts
        sd[shape], sd[g], sd[g_rate] = self.shape_sd, self.body_sd[:6], self.body_sd[6:]
        sd[self.slip] = np.repeat(self.slip_sd, 3)
        return Moments(np.zeros(len(sd)), np.diag(sd**2))

    def own(self, names: Sequence[str]) -> tuple[Keeper, ...]:
        """Also its energies."""
        return (*super().own(names), EnergyKeeper(self))

    def energy_of(self, mean: Array, frame: int) -> tuple[float, float, float]:
        """Of a state's mean: energy in J (``Animal.energy_j``), V_z, and what V_z stays below if released there."""
        at = self.moving(mean, frame)
        velocity = np.concatenate([at.velocity[:3] @ at.turn, at.velocity[3:]])[None]
        angles, animal = at.angles[None], self.animal
        found = animal.energy_j(angles, velocity), animal.value(angles), animal.bound(angles, velocity)
        energy, value, bound = (float(one[0]) for one in found)
        return energy, value, bound
