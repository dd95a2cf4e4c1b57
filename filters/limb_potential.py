"""What the potentials of limbs say of every smoothed frame, kept while a smoother goes back in time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from mocap.filters.gaussian import Smoothed
from mocap.filters.motion.potential import PosePotential
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from eal.arrays import Array

Limb = Mapping[str, NDArray[Any]]
"""What a potential said of a limb (``LimbKeeper.estimates``)."""
GRID = 60  # points along an edge of what is drawn
OF_TIMES = ("state", "covariance", "at_state", "pull")
"""What is of every frame."""


class Held(Protocol):
    """A motion model whose pose potentials hold."""

    @property
    def potentials(self) -> Sequence[PosePotential]:
        """All."""
        ...

    @cached_property
    def chains(self) -> int:
        """Where the chains of markers begin in a state."""
        ...

    def root(self, states: Array, frame: int) -> tuple[Array, Array]:
        """(S, 3, 3) axes of the root, and (S, 3) its place."""
        ...

    def moved(self, means: Array, residual: Array) -> Array:
        """(S, M, 3) how markers move in axes of the root as coordinates do."""
        ...


@dataclass(eq=False)
class LimbKeeper:
    """Takes smoothed frames from the last to the first.

    Attributes:
        model: The motion model.
        names: The M markers, and what else has a velocity.
        limbs: Its potentials of limbs.
    """

    model: Held
    names: Sequence[str]
    limbs: tuple[PosePotential, ...]
    _taken: list[list[tuple[Array, Array]]] = field(default_factory=list)
    _turned: list[Array] = field(default_factory=list)
    _means: list[Array] = field(default_factory=list)

    @staticmethod
    def of(model: Held, names: Sequence[str]) -> "tuple[LimbKeeper, ...]":
        """None where the model holds no limb by V_z."""
        limbs = tuple(p for p in model.potentials if p.children and p.potential is not None)
        return (LimbKeeper(model, names, limbs),) if limbs else ()

    def take(self, frame: int, state: Smoothed) -> None:
        """One frame's smoothed state."""
        self._turned.append(self.model.root(state.mean[None], frame)[0][0])
        self._means.append(state.mean)
        found = []
        for limb in self.limbs:
            rows = limb.rows(self.model.chains)
            found.append((limb.mean + rows @ state.mean[: rows.shape[1]], state.of(limb.plane.T @ rows)))
        self._taken.append(found)

    def values(self) -> dict[str, NDArray[Any]]:
        """``limb``, the names of all limbs, and the ``limb_...`` of ``limb_values``."""
        found = self.estimates()
        return {"limb": np.array(list(found)), **limb_values(found)}

    def estimates(self) -> dict[str, Limb]:
        """All limbs over all frames that were taken, each by the names of its root and its first joint.

        Coordinates are the two leading principal components of what V_z was learned from, the relative joint
        coordinates q of the limb (mostly with their velocities), in units of their deviation:

        - ``x``, ``y`` (G,) of a grid, and ``value`` (G, G) V_z at (y, x), of the pose that samples near there have in
          all other coordinates;
        - ``samples`` (N, 2) what V_z was learned from;
        - ``state`` (T, 2) the limb, its ``covariance`` (T, 2, 2), and ``at_state`` (T,) V_z of all coordinates there;
        - ``marker`` (M,) place of a marker along the limb; -1: it is none of it;
        - ``pull`` (T, M, 3) minus the gradient of the filter's potential by the position of each marker, in the world,
          in 1/(m s), NaN of markers beside it; for V_z of joint angles, how each marker moves when the arc length of
          every angle changes by minus the gradient with respect to it.
        """
        frames, turned, means = self._taken[::-1], np.array(self._turned[::-1]), np.array(self._means[::-1])
        out = {}
        for i, limb in enumerate(self.limbs):
            q, cov = (np.array([frame[i][k] for frame in frames]) for k in range(2))
            gradient = self.model.moved(means, limb.gradient(q) @ limb.on_residual)
            children = list(limb.children)
            pull, place = np.full(gradient.shape, np.nan), np.full(gradient.shape[1], -1)
            pull[:, children] = -gradient[:, children] @ np.swapaxes(turned, 1, 2)
            place[children] = np.arange(len(children))
            samples = (limb.samples - limb.centre) @ limb.plane
            x, y, grid = _grid(limb, samples)
            out[f"{self.names[limb.root]} to {self.names[children[0]]}"] = {
                "x": x,
                "y": y,
                "value": grid,
                "samples": samples,
                "state": (q - limb.centre) @ limb.plane,
                "covariance": cov,
                "at_state": np.zeros(len(q)) if limb.potential is None else np.asarray(limb.potential.value(q)),
                "marker": place,
                "pull": pull,
            }
        return out


def _grid(limb: PosePotential, samples: Array) -> tuple[Array, Array, Array]:
    """V_z over the plane; in all other coordinates each point is the mean of the samples near it, by a Gaussian."""
    low, high = samples.min(axis=0), samples.max(axis=0)
    half = max(float((high - low).max()) * 0.75, 1e-9)
    x, y = ((low + high)[:, None] / 2 + np.linspace(-half, half, GRID)).reshape(2, GRID)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    away = cdist(points, samples, "sqeuclidean")
    near = away / (half / 8.0) ** 2
    weight = np.exp(-(near - near.min(axis=1, keepdims=True)))
    weight /= weight.sum(axis=1, keepdims=True)
    rest = limb.samples - limb.centre - samples @ limb.plane.T
    lifted = limb.centre + points @ limb.plane.T + weight @ rest
    value = np.zeros(len(lifted)) if limb.potential is None else np.asarray(limb.potential.value(lifted))
    return x, y, value.reshape(GRID, GRID)


def limb_values(limbs: Mapping[str, Limb]) -> dict[str, NDArray[Any]]:
    """Limbs together: ``limb_...`` by what is said of each, one after the other, after times where it is of times.

    Samples are padded with NaN to the most; of the map and of pulls in single precision.
    """
    most = max(len(limb["samples"]) for limb in limbs.values())
    values: dict[str, NDArray[Any]] = {}
    for name in next(iter(limbs.values())):
        parts = [limb[name] for limb in limbs.values()]
        if name == "samples":
            parts = [np.pad(part, ((0, most - len(part)), (0, 0)), constant_values=np.nan) for part in parts]
        found = np.stack(parts, axis=1 if name in OF_TIMES else 0)
        values[f"limb_{name}"] = found.astype(np.float32) if name in ("value", "pull") else found
    return values
