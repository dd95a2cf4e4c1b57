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

    @property
    def shown(self) -> NDArray[np.bool_]:
        """(T,) frames in which anything is seen."""
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

    @property
    def shown(self) -> NDArray[np.bool_]:
        """(T,) frames in which anything is seen."""
        return np.logical_or(self._seen.any(axis=(0, 2)), self._met.any(axis=1))

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
        wide = np.einsum("mii->m", cov) > 3 * self.wide_m**2
        camera, marker = np.nonzero(self._seen[:, frame] & ~wide)
        n = len(camera)
        by_hand = np.zeros(n, dtype=bool) if self.by_hand is None else self.by_hand[camera, frame, marker]
        innovation, slope, sd = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.ones((n, 3))
        predicted, slope[:, :2], error = linearised_pixels(self.matrices, mean, cov, camera, marker)
        innovation[:, :2] = self.uv_px[camera, frame, marker] - predicted
        sd[:, :2] = np.sqrt(self.sd_px[camera, frame, marker, None] ** 2 + error)
        rays = Sights(
            where=np.array([camera, marker]).T,
            size=np.full(n, 2),
            innovation=innovation,
            slope=slope,
            sd=sd,
            dof=np.full(n, np.inf) if self.dof is None else np.where(by_hand, np.inf, self.dof[camera]),
            apart=self._apart[frame, marker],
            by_hand=by_hand,
        )
        points = np.flatnonzero(wide & self._met[frame])
        return _with_points(rays, WHOLE, points, self.xyz_m[frame], self.cov_m2[frame], mean)


def _with_points(
    sights: Sights, camera: int, marker: NDArray[np.int64], xyz_m: Array, cov_m2: Array, mean: Array
) -> Sights:
    """Sights, and three rows for each of some markers whose positions (M, 3) and covariances are known."""
    if not len(marker):
        return sights
    slope = np.linalg.inv(np.linalg.cholesky(cov_m2[marker]))
    more = Sights(
        where=np.stack([np.full_like(marker, camera), marker], axis=1),
        size=np.full(len(marker), 3),
        innovation=np.einsum("gij,gj->gi", slope, xyz_m[marker] - mean[marker]),
        slope=slope,
        sd=np.ones((len(marker), 3)),
        dof=np.full(len(marker), np.inf),
        apart=np.zeros(len(marker), dtype=bool),
        by_hand=np.zeros(len(marker), dtype=bool),
    )
    return Sights(**{name: np.concatenate([value, vars(more)[name]]) for name, value in vars(sights).items()})


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
    floor = 1e-9 * np.einsum("mii->m", cov)[:, None, None] + 1e-16
    factor = np.linalg.cholesky(cov + floor * np.eye(3))
    seen, spread = matrices[camera], factor[marker]
    here = (seen[:, :, :3] @ mean[marker, :, None])[..., 0] + seen[:, :, 3]
    centre, depth = here[:, :2] / here[:, 2:], here[:, 2, None, None]
    slope = (seen[:, :2, :3] - centre[:, :, None] * seen[:, 2:, :3]) / depth
    # of a sigma point at depth w (1 + d) the pixel is (slope step) / (1 + d) from the centre, opposite it 1 - d
    deeper = np.sqrt(3) / depth * (seen[:, 2:, :3] @ spread)
    curved = slope @ spread * (deeper / (1 - deeper**2))
    change = slope + (curved * deeper) @ np.linalg.inv(factor)[marker]
    return centre - curved.sum(axis=2) / np.sqrt(3), change, (curved**2).sum(axis=2)


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

    @property
    def shown(self) -> NDArray[np.bool_]:
        """(T,) frames in which anything is seen."""
        return np.any(np.isfinite(self.xyz_m[..., 0]), axis=1)

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

    @property
    def shown(self) -> NDArray[np.bool_]:
        """(T,) frames in which anything is seen."""
        return self.seen.shown

    def sights(self, frame: int, mean: Array, cov: Array) -> Sights:
        """Those that are seen, and three rows for each marker that follows."""
        own = self.seen.sights(frame, mean, cov)
        marker = np.flatnonzero(np.isfinite(self.xyz_m[frame, :, 0]))
        return _with_points(own, BODY, marker, self.xyz_m[frame], self.cov_m2[frame], mean)


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


def noisier(observations: Observations, factor: float) -> Observations:
    """What is seen, with all standard deviations of its noise so many times as large.

    Raises:
        TypeError: observations of a kind whose noise is not known.
    """
    if isinstance(observations, WithBodies):
        return replace(observations, seen=noisier(observations.seen, factor))
    if isinstance(observations, PositionObservations):
        return replace(observations, sd_m=factor * observations.sd_m)
    if isinstance(observations, PixelObservations):
        return replace(observations, sd_px=factor * observations.sd_px, cov_m2=factor**2 * observations.cov_m2)
    raise TypeError(f"expected pixels or positions, not {type(observations).__name__}")
