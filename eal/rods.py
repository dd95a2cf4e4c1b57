"""A limb of thin rods: its true mass matrix M(q) in the directions of its bones, and a penalty of these directions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.lagrangian import LagrangianSystem, Penalty

Array = NDArray[Any]
"""Numbers, indices or masks."""

GYRATION = 1.0 / 12.0
"""Squared radius of gyration of a uniform rod about its centre, over its squared length."""
_SMALL = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class RodLimb:
    """Bones of constant length that hang on each other, from a root outward.

    The coordinates are two for each bone: the rotation, about an axis across the bone's mean direction, that takes
    that to its direction (the exponential map of the sphere; one chart for all directions but the opposite one). With
    the vectors u = (u_1, ..., u_J) along the bones, the kinetic energy of thin rods about a root at rest is T = u'^T
    (A x I_3) u' / 2 with a constant A, so that M(q) = (du/dq)^T (A x I_3) (du/dq). A turn of a thin rod about its own
    axis has no energy, and markers on that axis do not show it: it is no coordinate.

    Attributes:
        parents: (J,) bone at whose outer end each bone begins; -1: at the root. Parents come first.
        length_m: (J,) lengths.
        mass_kg: (J,) masses.
        centre: (J,) centre of mass of each bone, as a share of the way to its outer end.
        mean: (J, 3) mean directions, of length 1.
    """

    parents: tuple[int, ...]
    length_m: Array
    mass_kg: Array
    centre: Array
    mean: Array

    def __post_init__(self) -> None:
        """Check."""
        count = len(self.parents)
        for name, shape in (("length_m", (count,)), ("mass_kg", (count,)), ("centre", (count,)), ("mean", (count, 3))):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape:
                raise ValueError(f"{name} of {count} bones must have shape {shape}, but has {value.shape}")
            object.__setattr__(self, name, value)
        if any(not -1 <= parent < i for i, parent in enumerate(self.parents)):
            raise ValueError(f"parents must come before their children, -1 for the root, but are {self.parents}")
        if not ((self.length_m > 0).all() and (self.mass_kg > 0).all()):
            raise ValueError("length_m and mass_kg must be above 0")
        if not np.allclose(np.linalg.norm(self.mean, axis=1), 1.0, atol=1e-6):
            raise ValueError("mean must hold directions of length 1")

    @property
    def dimension(self) -> int:
        """Two for each bone."""
        return 2 * len(self.parents)

    @cached_property
    def paths(self) -> Array:
        """(J, J) 1 where bone j lies on the way from the root to the outer end of bone i."""
        out = np.eye(len(self.parents))
        for i, parent in enumerate(self.parents):
            if parent >= 0:
                out[i] += out[parent]
        return out

    @cached_property
    def inertia(self) -> Array:
        """(J, J) A in kg: T = u'^T (A x I_3) u' / 2, by each rod's centre and its turning about that."""
        own = np.eye(len(self.parents))
        at = self.paths - own + self.centre[:, None] * own  # of each centre of mass, how much of each bone
        return np.einsum("k,ki,kj->ij", self.mass_kg, at, at) + np.diag(GYRATION * self.mass_kg)

    @cached_property
    def moments_kg(self) -> Array:
        """(J,) U = -sum_i moment_i g . u_i of a uniform field g."""
        own = np.eye(len(self.parents))
        return self.mass_kg @ (self.paths - own + self.centre[:, None] * own)

    @cached_property
    def across(self) -> Array:
        """(J, 3, 2) two unit directions across each mean direction."""
        helper = np.eye(3)[np.argmin(np.abs(self.mean), axis=1)]
        first = np.cross(self.mean, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, np.cross(self.mean, first)], axis=-1)

    def directions(self, q: Array) -> Array:
        """(..., J, 3) unit vectors along the bones of coordinates (..., 2J)."""
        phi = q.reshape(*q.shape[:-1], -1, 2)
        cosine, sinc, _, _ = _series(np.sum(phi**2, axis=-1))
        return cosine[..., None] * self.mean + sinc[..., None] * _mixed(self.across, phi)

    def coordinates(self, directions: Array) -> Array:
        """(..., 2J) coordinates of directions (..., J, 3) of any length: the inverse of ``directions``."""
        unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        along = np.einsum("...jx,jx->...j", unit, self.mean)
        aside = np.einsum("...jx,jxa->...ja", unit, self.across)
        sine = np.linalg.norm(aside, axis=-1)
        angle = np.arctan2(sine, along)
        scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)
        return (aside * scale[..., None]).reshape(*directions.shape[:-2], -1)

    def joints_m(self, q: Array) -> Array:
        """(..., J, 3) outer ends of the bones from the root, along the axes of ``mean``."""
        return self.paths @ (self.directions(q) * self.length_m[:, None])

    def slopes(self, q: Array) -> Array:
        """(..., J, 3, 2) derivatives of each direction by its two coordinates."""
        phi = q.reshape(*q.shape[:-1], -1, 2)
        _, sinc, first, _ = _series(np.sum(phi**2, axis=-1))
        aside = _mixed(self.across, phi)
        bend = -sinc[..., None] * self.mean + 2.0 * first[..., None] * aside
        return bend[..., None] * phi[..., None, :] + sinc[..., None, None] * self.across

    def curving(self, q: Array, v: Array) -> Array:
        """(..., J, 3) second derivative of the directions in time where the coordinates move at constant rates v."""
        phi, rate = (x.reshape(*x.shape[:-1], -1, 2) for x in (q, v))
        _, sinc, first, second = _series(np.sum(phi**2, axis=-1))
        slope, bend = 2.0 * np.sum(phi * rate, axis=-1), 2.0 * np.sum(rate**2, axis=-1)
        aside = _mixed(self.across, phi)
        moving = _mixed(self.across, rate)
        along = -0.5 * (first * slope**2 + sinc * bend)
        return (
            along[..., None] * self.mean
            + (second * slope**2 + first * bend)[..., None] * aside
            + 2.0 * (first * slope)[..., None] * moving
        )

    def system(self, *, gravity_m_s2: Sequence[float] = (0.0, 0.0, 0.0)) -> LagrangianSystem:
        """L = v^T M(q) v / 2 - U(q), the root at rest in axes that do not turn.

        Args:
            gravity_m_s2: (3,) uniform field along the axes of ``mean``; 0: none.
        """
        count, scale = len(self.parents), self.length_m
        inertia = self.inertia * np.outer(scale, scale)
        field: NDArray = np.outer(self.moments_kg * scale, np.asarray(gravity_m_s2, dtype=np.float64))  # (J, 3)

        pairs = np.repeat(np.repeat(inertia, 2, axis=0), 2, axis=1)

        def mass(q: Array) -> Array:
            d = np.swapaxes(self.slopes(q), -1, -2).reshape(*q.shape[:-1], 2 * count, 3)
            return pairs * (d @ np.swapaxes(d, -1, -2))

        def kinetic(q: Array, v: Array) -> Array:
            moving = _mixed(self.slopes(q), v.reshape(*v.shape[:-1], -1, 2))
            return 0.5 * np.sum(moving * (inertia @ moving), axis=(-2, -1))

        def force(q: Array, v: Array) -> Array:
            pulled = field - inertia @ self.curving(q, v)
            return np.sum(self.slopes(q) * pulled[..., None], axis=-2).reshape(*q.shape[:-1], 2 * count)

        ridge = 1e-13 * float(np.trace(inertia)) * np.eye(2 * count)  # opposite its mean a bone has no coordinates

        def solve(q: Array, f: Array) -> Array:
            return np.linalg.solve(mass(q) + ridge, f[..., None])[..., 0]

        return LagrangianSystem(
            name=f"limb of {count} rods",
            names=tuple(f"q{i + 1}{axis}" for i in range(count) for axis in "ab"),
            units=("rad",) * (2 * count),
            kinetic=kinetic,
            potential=lambda q: -np.einsum("jx,...jx->...", field, self.directions(q)),
            mass=mass,
            force=force,
            solve=solve,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class DirectionPenalty:
    """V of the directions of a limb's bones, as a function of its coordinates: V(q) = V_z(directions(q)).

    A Gaussian kernel of unit vectors is one on directions, and the same in whatever chart they have coordinates.

    Attributes:
        limb: The bones.
        potential: V_z of the (3J,) directions of all bones together.
    """

    limb: RodLimb
    potential: Penalty

    @property
    def curvature_limit(self) -> float:
        """That of V_z: a coordinate of a direction moves it by at most one."""
        return self.potential.curvature_limit

    def value(self, q: Array, /) -> Array:
        """V: (..., 2J) to (...)."""
        return self.potential.value(self._flat(q))

    def gradient(self, q: Array, /) -> Array:
        """Its gradient: (..., 2J)."""
        pull = self.potential.gradient(self._flat(q)).reshape(*q.shape[:-1], -1, 3)
        return np.sum(self.limb.slopes(q) * pull[..., None], axis=-2).reshape(q.shape)

    def _flat(self, q: Array) -> Array:
        return self.limb.directions(q).reshape(*q.shape[:-1], -1)


def _mixed(columns: Array, shares: Array) -> Array:
    """(..., J, 3) sums of two columns (..., J, 3, 2), each times its share (..., J, 2)."""
    return columns[..., 0] * shares[..., :1] + columns[..., 1] * shares[..., 1:]


def _series(rho: Array) -> tuple[Array, Array, Array, Array]:
    """Cosine of r, s = sin r / r, ds/d(r^2), d2s/d(r^2)^2 at rho = r^2."""
    near = rho < _SMALL
    far = np.maximum(rho, _SMALL)
    r = np.sqrt(far)
    cosine = np.cos(r)
    sinc = np.sin(r) / r
    first = (cosine - sinc) / (2.0 * far)
    second = (-0.5 * sinc - 3.0 * first) / (2.0 * far)
    if near.any():
        x = rho[near]
        cosine[near] = np.cos(np.sqrt(x))
        sinc[near] = 1.0 - x / 6.0 + x**2 / 120.0
        first[near] = -1.0 / 6.0 + x / 60.0 - x**2 / 1680.0
        second[near] = 1.0 / 60.0 - x / 840.0 + x**2 / 60480.0
    return cosine, sinc, first, second
