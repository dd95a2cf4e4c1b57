"""The empirical potential of a joint between two bodies: on its rotation, or on its six coordinates."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from eal.arrays import Array, short_repr
from eal.choice import choose
from eal.plot import COLORS
from eal.potential import EmpiricalPotential, fit_potential, usual_kernel
from eal.rotations import RotationKernel
from mocap.errors import MocapError
from mocap.kinematics.angles import turns
from mocap.kinematics.records import Kinematics, Rests
from mocap.sides import words
from mocap.text import number_of
from mocap.tracking.potentials import FEWEST, MOST


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyPotential:
    """V_z of a joint between bodies: 0 where it was seen, 1 far from there, and one on SO(3).

    Attributes:
        joint: Its name.
        samples: (N, 3) rotation vectors in degrees along the parent's axes; (N, 6): then translations in mm.
        unit: (d,) degrees (and mm) a unit of the potential's coordinates.
        potential: V_z on samples divided by ``unit``; its kernel compares rotations by their chord.
    """

    joint: str
    samples: Array
    unit: Array
    potential: EmpiricalPotential

    __repr__ = short_repr

    def value(self, q: ArrayLike) -> Array:
        """V_z at (..., d) rotation vectors in degrees (and translations in mm): (...) values between 0 and 1."""
        return self.potential.value(np.asarray(q) / self.unit)

    def gradient(self, q: ArrayLike) -> Array:
        """Gradient of V_z, (..., d), by degree (and mm)."""
        return self.potential.gradient(np.asarray(q) / self.unit) / self.unit

    def plot(self, ax: Any = None) -> Any:
        """Map of V_z over the two axes that it turns about most, in degrees, all else at its mean; returns the axes."""
        from matplotlib import pyplot

        ax = pyplot.subplots(figsize=(4.6, 4), layout="constrained")[1] if ax is None else ax
        first, second = sorted(np.argsort(-self.samples[:, :3].var(axis=0))[:2])
        shown = self.samples[:, [first, second]]
        low, high = shown.min(axis=0), shown.max(axis=0)
        grid = [np.linspace(a - 0.3 * (b - a), b + 0.3 * (b - a), 81) for a, b in zip(low, high, strict=True)]
        q = np.tile(self.samples.mean(axis=0), (81, 81, 1))
        q[..., first], q[..., second] = np.meshgrid(*grid)
        filled = ax.contourf(*grid, self.value(q), levels=np.linspace(0.0, 1.0, 21), cmap=COLORS)
        ax.plot(*shown.T, ".", color="black", markersize=1.5, alpha=0.5)
        ax.set(xlabel=f"rotation about {'xyz'[first]} (degrees)", ylabel=f"rotation about {'xyz'[second]} (degrees)")
        ax.set_title(f"{words(self.joint)}: joint potential, low where the joint goes", fontsize=9)
        ax.figure.colorbar(filled, ax=ax, label="V_z")
        return ax


def body_potential(found: Kinematics, joint: str, sequence: str, *, translations: bool = False) -> BodyPotential:
    """Learn V_z of a joint between bodies from the frames in which all their markers were measured.

    The kernel is exp(-w |x - y|^2 / m) of rotation matrices (and translations), each divided by its total standard
    deviation, m the median squared distance of the samples; w and lambda are those under which rotation vectors that
    are left out are likeliest (``eal.choose``).

    Args:
        found: Kinematics with the six coordinates of the joint.
        joint: Its name.
        sequence: In which its rotations are.
        translations: Whether translations are coordinates, too.

    Raises:
        MocapError: fewer than ``FEWEST`` frames were measured.
    """
    columns = [found[f"{joint}_rotation_{one}_deg"] for one in turns(sequence)]
    ok = np.all([one.rests == Rests.MEASURED for one in columns], axis=0)
    if ok.sum() < FEWEST:
        frames = number_of(int(ok.sum()), "frame")
        raise MocapError(f"all markers of {joint!r} were measured in {frames}: a potential needs {FEWEST}")
    frames = np.flatnonzero(ok)
    frames = frames[np.linspace(0, len(frames) - 1, min(len(frames), MOST)).astype(int)]
    rotation = Rotation.from_euler(sequence.upper(), np.stack([one.value[frames] for one in columns], axis=1), True)
    parts = [rotation.as_rotvec(degrees=True)]
    if translations:
        parts.append(np.stack([1e3 * found[f"{joint}_translation_{one}_m"].value[frames] for one in "xyz"], axis=1))
    sizes = [max(float(np.sqrt(part.var(axis=0).sum())), 1e-9) for part in parts]
    scale = float(np.degrees(1)) / sizes[0]
    lines = [part / size for part, size in zip(parts[1:], sizes[1:], strict=True)]
    features = np.concatenate([scale / np.sqrt(2) * rotation.as_matrix().reshape(-1, 9), *lines], axis=1)
    several = 3 * len(lines)
    unit, samples = np.repeat(sizes, 3), np.concatenate(parts, axis=1)
    chosen = choose(samples / unit)
    kernel = RotationKernel(usual_kernel(features, width=chosen.width), (3, *[0] * several), (scale, *[1.0] * several))
    return BodyPotential(
        joint=joint,
        samples=samples,
        unit=unit,
        potential=fit_potential(
            samples / unit,
            kernel=kernel,
            lam=chosen.lam,
            names=("rx", "ry", "rz", "x", "y", "z")[: len(unit)],
            units=[f"{size:.6g} {'deg' if k < 3 else 'mm'}" for k, size in enumerate(unit)],
        ),
    )
