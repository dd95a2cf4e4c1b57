"""What a tracker sees of the markers in each frame: pixels of all cameras, or positions.

A ray depends on the three coordinates of its marker alone. Its unscented transform is taken over these three (seven
points a ray, whatever the size of the state), which makes each observation a linear function of its marker with an
error of known variance: statistical linearisation (Gelb 1974; Garcia-Fernandez et al. 2015).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array

WHOLE = -1
"""Camera number of a group that stands for all rays of a marker."""
BODY = -2
"""Camera number of a group that stands for the other markers of a rigid body."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sights:
    """The observations of one frame, in groups of up to three rows that are believed or not as a whole.

    Attributes:
        where: (g, 2) camera and marker of each group; the camera is ``WHOLE`` for a position, ``BODY`` for one that
            follows from other markers.
        size: (g,) number of rows; a group's arrays hold zeros (``sd``: ones) in the rows that it lacks.
        innovation: (g, 3) observed minus predicted.
        slope: (g, 3, 3) change of each row with the position of the marker, a metre.
        sd: (g, 3) standard deviations, that of the linearisation included.
        dof: (g,) degrees of freedom of Student's t that the errors follow; infinite where they are normal.
        apart: (g,) rays that do not meet another one of their marker: of such at most one is right.
        by_hand: (g,) what a person states, which is believed wherever it is; False: nothing is.
    """

    where: NDArray[np.int64]
    size: NDArray[np.int64]
    innovation: Array
    slope: Array
    sd: Array
    dof: Array
    apart: NDArray[np.bool_]
    by_hand: NDArray[np.bool_] | bool = False


def seen_from(sights: Sights, shift: Array) -> Sights:
    """Sights that were linearised about other means, as innovations of the predicted ones.

    Args:
        sights: Rows that are linear functions of their markers.
        shift: (M, 3) the means that they are linearised about minus those that are predicted.
    """
    innovation = sights.innovation + np.einsum("gri,gi->gr", sights.slope, shift[sights.where[:, 1]])
    return replace(sights, innovation=innovation)


class Observations(Protocol):
    """A source of sights."""

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        ...

    def sights(self, frame: int, mean: Array, cov: Array) -> Sights:
        """What is seen in a frame of markers predicted at (M, 3) with covariance (M, 3, 3)."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class PixelObservations:
    """Ideal pixels of C cameras.

    A marker that is predicted more vaguely than ``wide_m`` would be projected from places where the projection is far
    from linear, or behind a camera. Such a marker is observed through the point in which its rays meet, with that
    point's covariance, which linearises the same pixels where they are; a single ray then says nothing.

    Rays of a marker without a point that are more than one do not meet (``Sights.apart``).

    Attributes:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        sd_px: (C, T, M) standard deviation (with ``dof``: scale) of a pixel coordinate.
        xyz_m: (T, M, 3) points in which the rays meet; NaN where fewer than two are seen.
        cov_m2: (T, M, 3, 3) their covariance.
        wide_m: Standard deviation of a marker coordinate above which pixels are not used directly.
        dof: (C,) degrees of freedom of Student's t; None: errors are normal.
        by_hand: (C, T, M) rays that a person placed, whose errors are normal; None: none.
    """

    matrices: Array
    uv_px: Array
    sd_px: Array
    xyz_m: Array
    cov_m2: Array
    wide_m: float
    dof: Array | None = None
    by_hand: NDArray[np.bool_] | None = None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.uv_px.shape[1]

    @cached_property
    def _seen(self) -> NDArray[np.bool_]:
        """(C, T, M) rays."""
        return np.isfinite(self.uv_px[..., 0])

    @cached_property
    def _met(self) -> NDArray[np.bool_]:
        """(T, M) markers of which rays meet."""
        return np.isfinite(self.xyz_m[..., 0])

    @cached_property
    def _apart(self) -> NDArray[np.bool_]:
        """(T, M) markers of which two rays or more do not."""
        return (self._seen.sum(axis=0) > 1) & ~self._met

    def sights(self, frame: int, mean: Array, cov: Array) -> Sights:
        """Two rows (u, v) for each ray, three for the point of a marker that is predicted vaguely."""
        wide = np.trace(cov, axis1=-2, axis2=-1) > 3 * self.wide_m**2
        camera, marker = np.nonzero(self._seen[:, frame] & ~wide)
        points = np.flatnonzero(wide & self._met[frame])
        n, total = len(camera), len(camera) + len(points)
        dof, by_hand = np.full(total, np.inf), np.zeros(total, dtype=bool)
        if self.by_hand is not None:
            by_hand[:n] = self.by_hand[camera, frame, marker]
        if self.dof is not None:
            dof[:n] = np.where(by_hand[:n], np.inf, self.dof[camera])
        innovation, slope, sd = np.zeros((total, 3)), np.zeros((total, 3, 3)), np.ones((total, 3))
        predicted, change, error = linearised_pixels(self.matrices, mean, cov, camera, marker)
        innovation[:n, :2] = self.uv_px[camera, frame, marker] - predicted
        slope[:n, :2] = change
        sd[:n, :2] = np.sqrt(self.sd_px[camera, frame, marker, None] ** 2 + error)
        if len(points):
            slope[n:] = np.linalg.inv(np.linalg.cholesky(self.cov_m2[frame, points]))
            innovation[n:] = np.einsum("gij,gj->gi", slope[n:], self.xyz_m[frame, points] - mean[points])
        return Sights(
            where=np.stack([np.append(camera, np.full_like(points, WHOLE)), np.append(marker, points)], axis=1),
            size=np.repeat([2, 3], [n, len(points)]),
            innovation=innovation,
            slope=slope,
            sd=sd,
            dof=dof,
            apart=np.append(self._apart[frame, marker], np.zeros(len(points), dtype=bool)),
            by_hand=by_hand,
        )


def linearised_pixels(
    matrices: Array, mean: Array, cov: Array, camera: NDArray[np.int64], marker: NDArray[np.int64]
) -> tuple[Array, Array, Array]:
    """Statistical linearisation of rays about N(mean, cov) of their markers, by the unscented transform with c = 3.

    Args:
        matrices: (C, 3, 4) projections.
        mean: (M, 3) marker means.
        cov: (M, 3, 3) their covariances.
        camera: (g,) camera of each ray.
        marker: (g,) marker of each ray.

    Returns:
        Mean pixel (g, 2), its change with the marker (g, 2, 3) in px/m, and the variance (g, 2) that is left.
    """
    floor = 1e-9 * np.trace(cov, axis1=-2, axis2=-1)[:, None, None] + 1e-16
    factor = np.linalg.cholesky(cov + floor * np.eye(3))
    steps = np.sqrt(3) * np.swapaxes(factor, 1, 2)
    cloud = np.concatenate([mean[:, None], mean[:, None] + steps, mean[:, None] - steps], axis=1)  # (M, 7, 3)
    homogeneous = cloud.reshape(-1, 3) @ np.swapaxes(matrices[:, :, :3], 1, 2) + matrices[:, None, :, 3]
    pixels = (homogeneous[..., :2] / homogeneous[..., 2:]).reshape(len(matrices), len(mean), 7, 2)[camera, marker]
    centre, plus, minus = pixels[:, 0], pixels[:, 1:4], pixels[:, 4:]
    bend = plus + minus - 2 * centre[:, None]
    inverse = np.linalg.inv(factor)[marker]
    change = np.swapaxes(plus - minus, 1, 2) @ inverse / (2 * np.sqrt(3))
    return centre + bend.sum(axis=1) / 6, change, np.sum(bend**2, axis=1) / 12


@dataclass(frozen=True, eq=False, kw_only=True)
class PositionObservations:
    """Positions with independent errors.

    Attributes:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        sd_m: (T, M) standard deviation of a coordinate.
    """

    xyz_m: Array
    sd_m: Array

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.xyz_m)

    def sights(self, frame: int, mean: Array, cov: Array) -> Sights:  # noqa: ARG002
        """Three rows for each marker that is seen."""
        marker = np.flatnonzero(np.isfinite(self.xyz_m[frame, :, 0]))
        return Sights(
            where=np.stack([np.full_like(marker, WHOLE), marker], axis=1),
            size=np.full(len(marker), 3),
            innovation=self.xyz_m[frame, marker] - mean[marker],
            slope=np.broadcast_to(np.eye(3), (len(marker), 3, 3)),
            sd=np.repeat(self.sd_m[frame, marker, None], 3, axis=1),
            dof=np.full(len(marker), np.inf),
            apart=np.zeros(len(marker), dtype=bool),
            by_hand=np.zeros(len(marker), dtype=bool),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class WithBodies:
    """Observations, and positions of markers that follow from the others of a rigid body.

    Attributes:
        seen: What is seen.
        xyz_m: (T, M, 3) positions that follow; NaN where none does.
        cov_m2: (T, M, 3, 3) their covariance.
    """

    seen: Observations
    xyz_m: Array
    cov_m2: Array

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.seen.n_frames

    def sights(self, frame: int, mean: Array, cov: Array) -> Sights:
        """Those that are seen, and three rows for each marker that follows."""
        own = self.seen.sights(frame, mean, cov)
        marker = np.flatnonzero(np.isfinite(self.xyz_m[frame, :, 0]))
        if not len(marker):
            return own
        slope = np.linalg.inv(np.linalg.cholesky(self.cov_m2[frame, marker]))
        more = Sights(
            where=np.stack([np.full_like(marker, BODY), marker], axis=1),
            size=np.full(len(marker), 3),
            innovation=np.einsum("gij,gj->gi", slope, self.xyz_m[frame, marker] - mean[marker]),
            slope=slope,
            sd=np.ones((len(marker), 3)),
            dof=np.full(len(marker), np.inf),
            apart=np.zeros(len(marker), dtype=bool),
            by_hand=np.zeros(len(marker), dtype=bool),
        )
        return Sights(**{name: np.concatenate([value, vars(more)[name]]) for name, value in vars(own).items()})


def some_markers(observations: Observations, markers: NDArray[np.int64]) -> Observations:
    """What is seen of some of the markers.

    Raises:
        TypeError: observations of a kind whose markers cannot be told apart.
    """
    if isinstance(observations, WithBodies):
        seen = some_markers(observations.seen, markers)
        return WithBodies(seen=seen, xyz_m=observations.xyz_m[:, markers], cov_m2=observations.cov_m2[:, markers])
    if isinstance(observations, PositionObservations):
        return PositionObservations(xyz_m=observations.xyz_m[:, markers], sd_m=observations.sd_m[:, markers])
    if isinstance(observations, PixelObservations):
        return replace(
            observations,
            uv_px=observations.uv_px[:, :, markers],
            sd_px=observations.sd_px[:, :, markers],
            xyz_m=observations.xyz_m[:, markers],
            cov_m2=observations.cov_m2[:, markers],
            by_hand=None if observations.by_hand is None else observations.by_hand[:, :, markers],
        )
    raise TypeError(f"expected pixels or positions, not {type(observations).__name__}")
