"""What a tracker sees of the markers in each frame: pixels of all cameras, or positions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mocap.arrays import Array

WHOLE = -1
"""Camera number of a group that stands for all rays of a marker."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The scalar observations of one frame, in groups that are believed or not as a whole.

    Attributes:
        h: (S, M, 3) markers to (S, m) predicted observations.
        y: (m,) observations.
        sd: (m,) standard deviations.
        group: (m,) the group of each row, 0 to g - 1.
        where: (g, 2) camera and marker of each group; the camera is ``WHOLE`` for a position.
    """

    h: Callable[[Array], Array]
    y: Array
    sd: Array
    group: NDArray[np.int64]
    where: NDArray[np.int64]


class Observations(Protocol):
    """A source of rows."""

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        ...

    def rows(self, frame: int, spread_m: Array) -> Rows:
        """The rows of one frame for markers predicted with (M,) standard deviations; none where nothing is seen."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class PixelObservations:
    """Ideal pixels of C cameras.

    A marker that is predicted more vaguely than ``wide_m`` would be projected from places where the projection is far
    from linear, or behind a camera. Such a marker is observed through the point in which its rays meet, with that
    point's covariance, which linearises the same pixels where they are; a single ray then says nothing.

    Attributes:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        sd_px: (C, T, M) standard deviation of a pixel coordinate.
        xyz_m: (T, M, 3) points in which the rays meet; NaN where fewer than two are seen.
        cov_m2: (T, M, 3, 3) their covariance.
        wide_m: Standard deviation of a marker coordinate above which pixels are not used directly.
    """

    matrices: Array
    uv_px: Array
    sd_px: Array
    xyz_m: Array
    cov_m2: Array
    wide_m: float

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self.uv_px.shape[1]

    def rows(self, frame: int, spread_m: Array) -> Rows:
        """Two rows (u, v) for each ray, three for the point of a marker that is predicted vaguely."""
        wide = spread_m > self.wide_m
        uv = self.uv_px[:, frame]
        camera, marker = np.nonzero(np.isfinite(uv[..., 0]) & ~wide)
        matrices = self.matrices[camera]
        points = np.flatnonzero(wide & np.isfinite(self.xyz_m[frame, :, 0]))
        whitening = np.linalg.inv(np.linalg.cholesky(self.cov_m2[frame, points]))  # (p, 3, 3)

        def h(markers: Array) -> Array:
            seen = np.transpose(markers[:, marker], (1, 2, 0))  # (g, 3, S)
            homogeneous = matrices[:, :, :3] @ seen + matrices[:, :, 3:]
            pixels = (homogeneous[:, :2] / homogeneous[:, 2:]).reshape(2 * len(marker), len(markers))
            if not len(points):
                return pixels.T
            white = whitening @ np.transpose(markers[:, points], (1, 2, 0))
            return np.concatenate([pixels, white.reshape(3 * len(points), len(markers))]).T

        white_y = (whitening @ self.xyz_m[frame, points, :, None]).ravel()
        sizes = np.repeat([2, 3], [len(camera), len(points)])
        return Rows(
            h,
            np.concatenate([uv[camera, marker].ravel(), white_y]),
            np.concatenate([np.repeat(self.sd_px[camera, frame, marker], 2), np.ones(len(white_y))]),
            np.repeat(np.arange(len(sizes)), sizes),
            np.concatenate(
                [np.stack([camera, marker], axis=1), np.stack([np.full_like(points, WHOLE), points], axis=1)]
            ),
        )


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

    def rows(self, frame: int, spread_m: Array) -> Rows:  # noqa: ARG002
        """Three rows for each marker that is seen."""
        xyz = self.xyz_m[frame]
        marker = np.flatnonzero(np.isfinite(xyz[:, 0]))

        def h(markers: Array) -> Array:
            return markers[:, marker].reshape(len(markers), -1)

        return Rows(
            h,
            xyz[marker].ravel(),
            np.repeat(self.sd_m[frame, marker], 3),
            np.repeat(np.arange(len(marker)), 3),
            np.stack([np.full_like(marker, WHOLE), marker], axis=1),
        )
