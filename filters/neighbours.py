"""A marker seen from its neighbours: a frame that moves with the markers near it.

On a rigid segment a marker rests in the frame of those beside it, however the segment turns in the body (Tits, Tilmanne
& Dutoit 2018 take three of them). Here all others are aligned with their mean shape by Procrustes analysis (Gower 1975;
Kabsch 1976), and those that keep their distance to the marker weigh most: rigid or not, the frame turns as they do.
"""

from dataclasses import dataclass

import numpy as np
from mocap.filters.body_axes import BodyFrames, nearest_rotation
from numpy.typing import NDArray

from eal.arrays import Array

FIRM = 0.03
"""Share of the mean shape's extent that holds the frame where neighbours do not tell how they turn: on a line. Chosen,
not measured."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """What a marker is seen from.

    Attributes:
        which: (M,) True for the k markers that are looked at.
        weight: (k,) of each of them; their sum is one.
        shape: (k, 3) their mean shape about its centre.
    """

    which: NDArray[np.bool_]
    weight: Array
    shape: Array

    @classmethod
    def of(cls, which: NDArray[np.bool_], poses: Array, apart: Array) -> "Neighbours":
        """Of poses (n, M, 3) without gaps, and what each of the k markers moves apart from the one that is asked for.

        Poses are aligned once, with their mean: they are seen from the body already.

        Args:
            which: (M,) the k markers.
            poses: See above.
            apart: (k,) see above.
        """
        # in units of the median, and a twentieth of it: what keeps its distance weighs most
        weight = (apart / max(float(np.median(apart)), 1e-12) + 0.05) ** -4.0
        points = poses[:, which]
        weight /= weight.sum()
        mean = points.mean(axis=0)
        mean = cls(which, weight, mean - weight @ mean)._frames(points).to_body(points).mean(axis=0)
        return cls(which, weight, mean - weight @ mean)

    def frames(self, poses: Array) -> BodyFrames:
        """Frames of poses (n, M, 3): the origin is the weighted mean, the axes are those of the mean shape."""
        return self._frames(poses[:, self.which])

    def _frames(self, points: Array) -> BodyFrames:
        centre = self.weight @ points
        covariance = np.swapaxes(points - centre[:, None], 1, 2) @ (self.weight[:, None] * self.shape)
        extent = self.weight @ np.sum(self.shape**2, axis=1)
        return BodyFrames(rotation=nearest_rotation(covariance + FIRM / 3 * extent * np.eye(3)), position_m=centre)


def body_itself(count: int) -> BodyFrames:
    """The frame that poses are given in, so many times."""
    return BodyFrames(rotation=np.tile(np.eye(3), (count, 1, 1)), position_m=np.zeros((count, 3)))
