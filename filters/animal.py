"""The Lagrangian of a whole animal of segments and joints, and its step in time."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from mocap.filters.bodies import Bodies
from mocap.filters.tree import left_jacobian
from scipy.linalg import lu_factor, lu_solve
from scipy.spatial.transform import Rotation

from eal import bounds
from eal.arrays import Array, skew
from eal.integrators import IntegrationError
from eal.potential import EmpiricalPotential


@dataclass(frozen=True, eq=False, kw_only=True)
class Valley:
    """V_z of some joint angles, as a function of all of them: V_z(scale (angles)), scale (d, F)."""

    potential: EmpiricalPotential
    scale: Array

    def value(self, angles: Array) -> Array:
        """(S, F) to (S,)."""
        return self.potential.value(angles @ self.scale.T)

    def gradient(self, angles: Array) -> Array:
        """(S, F) to (S, F)."""
        return self.potential.gradient(angles @ self.scale.T) @ self.scale

    def hessian(self, angles: Array) -> Array:
        """(F,) to (F, F)."""
        return self.scale.T @ self.potential.hessian(self.scale @ angles) @ self.scale


class Moving(NamedTuple):
    """One state of an animal.

    Attributes:
        position_m: (3,) origin of the root in the world.
        turn: (3, 3) its axes.
        angles: (F,) joint angles.
        velocity: (6 + F,) of the origin in the world, angular velocity in the root's axes, rates of the angles.
    """

    position_m: Array
    turn: Array
    angles: Array
    velocity: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Animal:
    """L = v^T M(q) v / 2 - U(q) - sum of V_z(q) / eps^2, with Rayleigh's function r^T D r / 2 of the joints' rates r.

    EAL paper, equation 7. U = (q - rest)^T K (q - rest) / 2 of elastic joints. The root is free; gravity moves all of a
    free animal alike and no joint, so that it adds g to the root's acceleration and nothing else.

    Attributes:
        bodies: Segments with their masses.
        rest_rad: (F,) where elastic joints are at rest.
        stiffness: (F, F) K in N m, symmetric, not negative.
        damping: (F, F) D in N m s, symmetric, not negative.
        valleys: V_z of limbs.
        strength_j: 1/eps^2.
        gravity_m_s2: (3,) in the world; zeros where lift or legs bear the weight.
    """

    bodies: Bodies
    rest_rad: Array
    stiffness: Array
    damping: Array
    valleys: tuple[Valley, ...] = ()
    strength_j: float = 0.0
    gravity_m_s2: Array | tuple[float, float, float] = (0.0, 0.0, 0.0)

    def value(self, angles: Array) -> Array:
        """Sum of V_z over the limbs: (S, F) to (S,)."""
        return np.sum([np.zeros(len(angles)), *(valley.value(angles) for valley in self.valleys)], axis=0)

    def elastic_j(self, angles: Array) -> Array:
        """U: (S, F) to (S,)."""
        away = angles - self.rest_rad
        return 0.5 * np.sum(away * (away @ self.stiffness), axis=-1)

    def energy_j(self, angles: Array, velocity: Array) -> Array:
        """T + U + V_z/eps^2 without the energy of the centre of mass: (S, F) and (S, 6 + F) to (S,).

        Args:
            angles: Joint angles.
            velocity: As ``Bodies`` has it: the first three along the root's axes.
        """
        kinetic = self.bodies.inner_kinetic(angles, velocity)
        return kinetic + self.elastic_j(angles) + self.strength_j * self.value(angles)

    def bound(self, angles: Array, velocity: Array) -> Array:
        """V_z that no motion released in each of these states exceeds: V_z(q0) + eps^2 (T0 + U0), (S,).

        Theorem 3 with errata 13. The least U is 0, and the energy of the centre of mass, which nothing inside the
        animal changes, is left out of T0.
        """
        if not self.strength_j:
            return np.full(len(angles), np.inf)
        kinetic = self.bodies.inner_kinetic(angles, velocity)
        parts = zip(self.value(angles), kinetic, self.elastic_j(angles), strict=True)
        return np.array(
            [
                float(bounds.theorem3(self.strength_j, value0=v, kinetic0=t, potential0=u, potential_min=0.0))
                for v, t, u in parts
            ]
        )

    def _pull(self, angles: Array, rates: Array) -> Array:
        """Forces of the joints: (F,)."""
        force = -self.stiffness @ (angles - self.rest_rad) - self.damping @ rates
        for valley in self.valleys if self.strength_j else ():
            force -= self.strength_j * valley.gradient(angles[None])[0]
        return force

    def _stiff(self, angles: Array) -> Array:
        """(F, F) K and the curvature of V_z / eps^2 where it is positive."""
        if not (self.strength_j and self.valleys):
            return self.stiffness
        values, vectors = np.linalg.eigh(np.sum([valley.hessian(angles) for valley in self.valleys], axis=0))
        return self.stiffness + self.strength_j * (vectors * np.maximum(values, 0.0)) @ vectors.T

    def step(self, start: Moving, h_s: float, *, halvings: int = 6) -> tuple[Moving, Array]:
        """One implicit midpoint step, and how the state at its end follows one near its start.

        With the mean velocity w = (v0 + v1) / 2, q1 = q0 + h w for angles and R1 = R0 exp(h omega) for the root, the
        forces of the middle, q0 + h w / 2 at velocity w, are those of the acceleration (v1 - v0) / h. It is of second
        order, its own inverse backwards in time, and its energy oscillates and does not drift (Hairer, Lubich & Wanner
        2006, XI; on rotations: Lewis & Simo 1994).

        The transition is that of M(q), K, D and the curvature of V_z (where it is positive): the exact one
        without derivatives of M(q) and of forces that are quadratic in velocities. With these, or with sigma points, a
        state as vague as those in gaps spreads beyond all bounds (docs/explanation/joints.md). The same matrix solves
        the step, by chords.

        Args:
            start: State.
            h_s: Step.
            halvings: How often it may be halved.

        Returns:
            The state at the end, and (12 + 2F, 12 + 2F) the transition of [position, turn, angles, velocity], turns
            being rotation vectors in the root's axes, on the right.

        Raises:
            IntegrationError: no step converges, or the state is not finite.
        """
        if not (np.isfinite(start.angles).all() and np.isfinite(start.velocity).all()):
            raise IntegrationError("the state of the animal is not finite")
        half, count = 0.5 * h_s, len(start.angles)
        before = start.velocity[3:]
        middle = start.angles + half * before[3:]
        stiff = self._stiff(middle)
        mass = self.bodies.mass(middle[None])[0]
        solved = np.hstack([mass[:, :3], mass[:, 3:] / half])
        solved[6:, 6:] += self.damping + half * stiff
        factors = lu_factor(solved)
        unknown, size = np.concatenate([np.zeros(3), before]), np.inf
        for _ in range(20):
            push, mean = unknown[:3], unknown[3:]
            middle = start.angles + half * mean[3:]
            velocity, acceleration = np.concatenate([np.zeros(3), mean]), np.concatenate([push, (mean - before) / half])
            with np.errstate(over="ignore", invalid="ignore"):
                left = self.bodies.force(middle[None], velocity[None], acceleration[None])[0]
                left[6:] -= self._pull(middle, mean[3:])
            if not np.isfinite(left).all():
                break
            change = lu_solve(factors, left)
            unknown = unknown - change
            size = float(np.abs(change[3:]).max()) / (1.0 + float(np.abs(unknown[3:]).max()))
            if size <= 1e-10:
                break
        if not size <= 1e-7:  # converged below 1e-10; nearly so is good enough
            return self._halves(start, h_s, halvings)
        push, mean = unknown[:3], unknown[3:]
        turn_half, turn = (Rotation.from_rotvec(s * mean[:3]).as_matrix() for s in (half, h_s))
        there = start.turn @ turn_half
        speed = start.velocity[:3] + h_s * (there @ push + np.asarray(self.gravity_m_s2))
        end = Moving(
            position_m=start.position_m + half * (start.velocity[:3] + speed),
            turn=start.turn @ turn,
            angles=start.angles + h_s * mean[3:],
            velocity=np.concatenate([speed, 2 * mean - before]),
        )
        n = 6 + count
        by = lu_solve(factors, np.hstack([np.vstack([np.zeros((6, count)), -stiff]), mass[:, 3:] / half]))
        out = np.eye(2 * n)
        place, tilt, bent = slice(0, 3), slice(3, 6), slice(6, n)
        fast, quick = slice(n, n + 3), slice(n + 3, 2 * n)
        inputs = np.r_[bent, quick]  # of ``by``: the derivative of [push, mean] by these
        out[bent, inputs] += h_s * by[6:]
        out[quick, quick] -= 2 * np.eye(n - 3)
        out[quick, inputs] += 2 * by[3:]
        out[tilt, tilt] = turn.T
        out[tilt, inputs] = h_s * left_jacobian(-h_s * mean[:3]) @ by[3:6]
        tilted = -there @ skew(push)  # of the push, by a turn of the root at the middle
        out[fast, inputs] = h_s * (there @ by[:3] + half * tilted @ left_jacobian(-half * mean[:3]) @ by[3:6])
        out[fast, tilt] = h_s * tilted @ turn_half.T
        out[place] += half * out[fast]
        out[place, fast] += half * np.eye(3)
        return end, out

    def _halves(self, start: Moving, h_s: float, halvings: int) -> tuple[Moving, Array]:
        if not halvings:
            raise IntegrationError(
                f"the implicit midpoint rule did not converge with a step of {h_s:g} s: the motion is too "
                "fast, or the potential too strong for it"
            )
        middle, first = self.step(start, 0.5 * h_s, halvings=halvings - 1)
        end, second = self.step(middle, 0.5 * h_s, halvings=halvings - 1)
        return end, second @ first

    def released(self) -> "Animal":
        """Without damping and gravity: what energy and bound are statements on."""
        return replace(self, damping=np.zeros_like(self.damping), gravity_m_s2=(0.0, 0.0, 0.0))
