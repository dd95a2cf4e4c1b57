"""The masses of an articulated animal: its true mass matrix M(q), and the forces that a motion asks for."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mocap.filters.anatomy import Mass
from mocap.filters.tree import Posed, Tree, turning_on

from eal.arrays import Array, cross, skew

UNKNOWN_KG = 1.0
"""Mass of a limb of which no mass is stated: energies are then those of a kilogram of it."""
THICK = 0.1
"""Radius of a rod over its length. Chosen, not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Bodies:
    """A rigid body for every segment of a tree, whose root moves freely.

    Velocities v (S, 6 + F) are the velocity of the root's origin, its angular velocity, both along the root's own axes,
    and the rates of the joint angles; accelerations likewise, the first three being those of the origin in the world,
    seen along these axes. Kinetic energy is v^T M(q) v / 2 with q the joint angles alone: where the root is and how it
    is turned has no part in it.

    Attributes:
        tree: Segments and joints.
        mass_kg: (J + 1,) of the root, and of the segment behind each joint.
        centre_m: (J + 1, 3) centre of mass, from the segment's joint (the root's: from its origin), in its own axes.
        inertia_kg_m2: (J + 1, 3, 3) about the centre.
        armature_kg_m2: (F,) what turns with a joint besides segments: flesh, membrane, air. A constant part of M(q).
    """

    tree: Tree
    mass_kg: Array
    centre_m: Array
    inertia_kg_m2: Array
    armature_kg_m2: Array | float = 0.0

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: another number of bodies than segments, or a mass that is not above 0.
        """
        count = len(self.tree.parent) + 1
        for name, shape in (("mass_kg", (count,)), ("centre_m", (count, 3)), ("inertia_kg_m2", (count, 3, 3))):
            if np.shape(getattr(self, name)) != shape:
                got = np.shape(getattr(self, name))
                raise ValueError(f"{name} of a root and {count - 1} segments must have shape {shape}, but has {got}")
        if not (self.mass_kg > 0).all():
            raise ValueError("mass_kg must be above 0")

    @cached_property
    def _hung(self) -> Array:
        """(J + 1, J) whether a segment is moved by a joint."""
        return self.tree.above[:, 1:].astype(float)

    @property
    def freedoms(self) -> int:
        """6 + F."""
        return 6 + len(self.tree.axes)

    def _placed(self, angles: Array) -> tuple[Posed, Array, Array]:
        """Segments, (S, J + 1, 3) their centres of mass, (S, J + 1, 3, 3) inertias, in axes of the root."""
        posed = self.tree.pose(angles)
        centre = posed.origin + (posed.rotation @ self.centre_m[..., None])[..., 0]
        return posed, centre, posed.rotation @ self.inertia_kg_m2 @ np.swapaxes(posed.rotation, -1, -2)

    def mass(self, angles: Array) -> Array:
        """M(q) = sum over segments of m J^T J + W^T I W: (S, F) to (S, 6 + F, 6 + F).

        J and W are the derivatives of the velocity of a segment's centre of mass and of its angular velocity by v
        (Featherstone 2008, section 2.15).
        """
        posed, centre, inertia = self._placed(angles)
        axis = self.tree.turning(angles, posed)
        moved = self.tree.above[:, self.tree.joint + 1][..., None]  # (J + 1, F, 1)
        arm = centre[:, :, None] - posed.origin[:, None, self.tree.joint + 1]
        shape = (*centre.shape[:2], 3, self.freedoms)
        slide, turn = np.zeros(shape), np.zeros(shape)
        slide[..., :3] = turn[..., 3:6] = np.eye(3)
        slide[..., 3:6] = -skew(centre)
        slide[..., 6:] = np.swapaxes(np.where(moved, cross(axis[:, None], arm), 0.0), -1, -2)
        turn[..., 6:] = np.swapaxes(np.where(moved, axis[:, None], 0.0), -1, -2)
        both = np.concatenate([slide, turn], axis=2).reshape(len(angles), -1, self.freedoms)
        weighed = np.concatenate([self.mass_kg[:, None, None] * slide, inertia @ turn], axis=2).reshape(both.shape)
        out = np.swapaxes(both, 1, 2) @ weighed
        joints = np.arange(6, self.freedoms)
        out[:, joints, joints] += self.armature_kg_m2
        return out

    def force(self, angles: Array, velocity: Array, acceleration: Array) -> Array:
        """M(q) a + C(q, v) v, the generalised forces of a motion: (S, F) and twice (S, 6 + F) to (S, 6 + F).

        Newton and Euler for each segment, summed over all that a joint carries (Luh, Walker & Paul 1980). This is
        d/dt dT/dv - dT/dq, written for a root whose velocities are no derivatives of coordinates.
        """
        tree, hung = self.tree, self._hung
        posed, centre, inertia = self._placed(angles)
        on, origin = posed.rotation[:, tree.parent], posed.origin
        own = tree.turning(angles, posed)
        spin, rate = velocity[:, None, 3:6], velocity[:, 6:]
        turned = self._of_joint @ (own * rate[..., None])  # (S, J, 3) of each segment against the one before it
        omega = spin + hung @ turned
        grown = (on @ turning_on(tree.turns(angles), tree.turns(rate))[..., None])[..., 0]
        grown += self._of_joint @ (own * acceleration[:, 6:, None]) + cross(omega[:, tree.parent], turned)
        alpha = acceleration[:, None, 3:6] + hung @ grown
        way = origin[:, 1:] - origin[:, tree.parent]
        carried = _carried(omega[:, tree.parent], alpha[:, tree.parent], way)
        at_centre = acceleration[:, None, :3] + hung @ carried + _carried(omega, alpha, centre - origin)
        push = self.mass_kg[:, None] * at_centre
        spun = (inertia @ omega[..., None])[..., 0]
        twist = (inertia @ alpha[..., None])[..., 0] + cross(omega, spun) + cross(centre, push)  # about the root
        pushed, twisted = hung.T @ push, hung.T @ twist
        about = twisted - cross(origin[:, 1:], pushed)
        joints = np.sum(own * about[:, tree.joint], axis=-1) + self.armature_kg_m2 * acceleration[:, 6:]
        return np.concatenate([push.sum(axis=1), twist.sum(axis=1), joints], axis=1)

    @cached_property
    def _of_joint(self) -> Array:
        """(J, F) which coordinates a joint has."""
        return (self.tree.joint == np.arange(len(self.tree.parent))[:, None]).astype(float)

    def kinetic(self, angles: Array, velocity: Array) -> Array:
        """T = v^T M(q) v / 2 in J: (S, F) and (S, 6 + F) to (S,)."""
        return 0.5 * np.einsum("si,sij,sj->s", velocity, self.mass(angles), velocity)

    def inner_kinetic(self, angles: Array, velocity: Array) -> Array:
        """T less the energy of the centre of mass, which nothing inside the animal changes: (S,) in J."""
        mass = self.mass(angles)
        push = np.einsum("sij,sj->si", mass[:, :3], velocity)
        return 0.5 * (
            np.einsum("si,sij,sj->s", velocity, mass, velocity) - np.sum(push**2, axis=1) / self.mass_kg.sum()
        )


def _carried(omega: Array, alpha: Array, arm: Array) -> Array:
    """Acceleration of a point against another of the same body: alpha x r + omega x (omega x r)."""
    return cross(alpha, arm) + cross(omega, cross(omega, arm))


def rod_masses(bones: Sequence[tuple[int, int]], length_m: Array, masses: Sequence[Mass]) -> tuple[Array, Array, bool]:
    """Masses (J,) in kg and centres (J,) of bones, and whether any is stated.

    A stated part whose ends are joined by some of the bones is spread over these by length (one bone keeps its
    centre). Other bones have the least mass a length of the stated ones; where none is stated all are uniform rods of
    one density that weigh ``UNKNOWN_KG`` together.

    Args:
        bones: Inner and outer end of each, from the root outward.
        length_m: (J,) lengths.
        masses: What is stated.
    """
    inner = {child: parent for parent, child in bones}
    index = {child: i for i, (_, child) in enumerate(bones)}
    density, centre = np.full(len(bones), np.nan), np.full(len(bones), 0.5)
    for part in masses:
        for start, end, share in ((part.start, part.end, part.centre), (part.end, part.start, 1.0 - part.centre)):
            way, at = [], end
            while at in inner and at != start:
                way.append(index[at])
                at = inner[at]
            if way and at == start:
                density[way] = part.kg / float(length_m[way].sum())
                if len(way) == 1:
                    centre[way] = share
                break
    any_mass = bool(np.isfinite(density).any())
    if not any_mass:
        return UNKNOWN_KG * length_m / float(length_m.sum()), centre, False
    return np.where(np.isfinite(density), density, np.nanmin(density)) * length_m, centre, True


def rod(mass_kg: float, way_m: Array, *, centre: float = 0.5) -> tuple[Array, Array]:
    """Centre of mass (3,) and inertia (3, 3) about it of a uniform cylinder along a vector (3,) from its beginning.

    Its radius is ``THICK`` times its length, so that a turn about its own axis has energy, too.
    """
    square = float(way_m @ way_m)
    along = np.outer(way_m, way_m) / square
    across = square * (1 / 12 + THICK**2 / 4)
    return centre * way_m, mass_kg * (across * (np.eye(3) - along) + square * THICK**2 / 2 * along)


def cloud(mass_kg: float, places_m: Array, thick_m: float) -> tuple[Array, Array]:
    """Centre of mass (3,) and inertia (3, 3) of balls of equal mass and radius at some places (n, 3)."""
    centre = places_m.mean(axis=0)
    away = places_m - centre
    spread = away.T @ away / len(away)
    return centre, mass_kg * ((np.trace(spread) + 0.4 * thick_m**2) * np.eye(3) - spread)
