"""How markers move: velocities and accelerations with the joint covariance that a smoother has of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from mocap.filters.errors import FilterError
from numpy.typing import NDArray

from eal.arrays import Array, frozen, short_repr, unique
from eal.over_time import OverTime


@dataclass(frozen=True, kw_only=True)
class RatePoints:
    """Of which points and pairs of points a smoother is to keep the joint covariance.

    Attributes:
        names: The M markers, then the K weighted means of markers (the body, the centre of mass).
        weights: A row of M weights for each of the K means, which sum to 1.
        pairs: Indices of two different points; their covariance with each other is kept.
    """

    names: tuple[str, ...]
    weights: tuple[tuple[float, ...], ...] = ()
    pairs: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        """Check names."""
        unique("point", self.names)

    @property
    def all_weights(self) -> Array:
        """(M + K, M) weights of all points: those of the markers are 1 and 0."""
        count = len(self.names) - len(self.weights)
        return np.concatenate([np.eye(count), np.array(self.weights).reshape(-1, count)])


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """Positions and velocities of points over time, with their joint covariance.

    Covariances are those of a smoother given all frames: of the six numbers [position, velocity] of each point, and of
    the six of one point with the six of another. They are kept as float32.

    Attributes:
        names: The N points: markers, and means of markers.
        t_s: (T,) times in seconds.
        xyz_m: (T, N, 3) positions; NaN where there is none.
        velocity_m_s: (T, N, 3) velocities.
        own: (T, N, 6, 6) covariance of position and velocity of each point.
        pairs: (P, 2) points whose covariance with each other is kept.
        cross: (T, P, 6, 6) covariance of the first's position and velocity with the second's.
        kept: (T, N, 3) variance of v(t+1) - v(t-1) over the sum of the variances of both: what neighbouring velocities
            do not share. It is computed from the covariances of frames with those before them (lag one, applied
            twice) in every eighth frame and interpolated between.
        measured: (T, N) True where all that a point rests on was measured in that frame.
        acceleration_m_s2: (T, N, 3) accelerations; None: they are no part of the model's state.
        acceleration_cov: (T, N, 3, 3) covariance of each; None: so.
    """

    names: tuple[str, ...]
    pairs: NDArray[np.int64]
    t_s: OverTime[Array]
    xyz_m: OverTime[Array]
    velocity_m_s: OverTime[Array]
    own: OverTime[NDArray[np.float32]]
    cross: OverTime[NDArray[np.float32]]
    kept: OverTime[Array]
    measured: OverTime[NDArray[np.bool_]]
    acceleration_m_s2: OverTime[Array | None] = None
    acceleration_cov: OverTime[NDArray[np.float32] | None] = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Freeze and check."""
        count, steps = len(self.names), len(self.t_s)
        own = np.asarray(self.own)  # where two cameras hardly see depth, a smoother's products round at 1e-6 of it
        object.__setattr__(self, "own", 0.5 * (own + np.swapaxes(own, -1, -2)))
        known = self.acceleration_m_s2 is not None
        for name, shape, kind in (
            ("t_s", (steps,), np.float64),
            ("xyz_m", (steps, count, 3), np.float64),
            ("velocity_m_s", (steps, count, 3), np.float64),
            ("own", (steps, count, 6, 6), np.float32),
            ("pairs", (None, 2), np.int64),
            ("cross", (steps, len(self.pairs), 6, 6), np.float32),
            ("kept", (steps, count, 3), np.float64),
            ("measured", (steps, count), np.bool_),
            *((("acceleration_m_s2", (steps, count, 3), np.float64),) if known else ()),
            *((("acceleration_cov", (steps, count, 3, 3), np.float32),) if known else ()),
        ):
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape, dtype=kind))

    def index(self, name: str) -> int:
        """Where a point is.

        Raises:
            FilterError: there is none of that name.
        """
        if name not in self.names:
            raise FilterError(f"there is no marker {name!r}: the markers are {', '.join(self.names)}")
        return self.names.index(name)

    @cached_property
    def _where(self) -> dict[tuple[int, int], int]:
        return {(a, b): i for i, (a, b) in enumerate(self.pairs.tolist())}

    def knows(self, points: Sequence[int]) -> bool:
        """Whether the covariance of each pair of points is known."""
        return all(a == b or (a, b) in self._where or (b, a) in self._where for a, b in combinations(points, 2))

    def joint(self, points: Sequence[int]) -> tuple[Array, bool]:
        """Covariance of [position, velocity] of k points together.

        Returns:
            (T, 6k, 6k), and whether the covariance of each pair is known; where it is not, it is taken for zero.
        """
        k, where = len(points), self._where
        out = np.zeros((len(self.t_s), k, 6, k, 6))
        for i, a in enumerate(points):
            out[:, i, :, i] = self.own[:, a]
            for j, b in enumerate(points[:i]):
                if a == b:
                    block = self.own[:, a].astype(float)
                elif (a, b) in where:
                    block = self.cross[:, where[a, b]].astype(float)
                elif (b, a) in where:
                    block = np.swapaxes(self.cross[:, where[b, a]], 1, 2).astype(float)
                else:
                    continue
                out[:, i, :, j], out[:, j, :, i] = block, np.swapaxes(block, 1, 2)
        return out.reshape(len(self.t_s), 6 * k, 6 * k), self.knows(points)


def without_rates(names: Sequence[str], t_s: Array, xyz_m: Array, cov_m2: Array, measured: NDArray[np.bool_]) -> Motion:
    """Positions of which no velocity is known, (T, M, 3) with covariances (T, M, 3, 3)."""
    own = np.full((*xyz_m.shape[:2], 6, 6), np.nan, dtype=np.float32)
    own[..., :3, :3] = cov_m2
    return Motion(
        names=tuple(names),
        t_s=t_s,
        xyz_m=xyz_m,
        velocity_m_s=np.full(xyz_m.shape, np.nan),
        own=own,
        pairs=np.empty((0, 2), dtype=np.int64),
        cross=np.empty((len(t_s), 0, 6, 6), dtype=np.float32),
        kept=np.ones(xyz_m.shape),
        measured=measured,
    )


def with_means(motion: Motion, rate_points: RatePoints) -> Motion:
    """A motion with the means that are asked for, of markers that it has.

    Means that it has by the same name and weights are not told from others of that name: all are made anew, with the
    covariances that it has between markers; where these are not known, the markers are taken for independent.
    """
    weights = rate_points.all_weights
    count = weights.shape[1]
    index = [motion.index(name) for name in rate_points.names[:count]]
    x, v = motion.xyz_m[:, index], motion.velocity_m_s[:, index]
    own = [motion.own[:, index]]
    measured = [motion.measured[:, index]]
    means_x, means_v, kept = [x], [v], [motion.kept[:, index]]
    accelerated: dict[str, Array | NDArray[np.float32]] = {}
    if motion.acceleration_m_s2 is not None and motion.acceleration_cov is not None:  # of markers by themselves
        accelerated["acceleration_m_s2"] = np.einsum("nm,tmi->tni", weights, motion.acceleration_m_s2[:, index])
        spread = np.einsum("nm,tmij->tnij", weights**2, motion.acceleration_cov[:, index])
        accelerated["acceleration_cov"] = spread.astype(np.float32)
    for row in weights[count:]:
        used = np.flatnonzero(row)
        joint, _ = motion.joint([index[int(i)] for i in used])
        block = joint.reshape(len(x), len(used), 6, len(used), 6)
        own.append(np.einsum("i,tiajb,j->tab", row[used], block, row[used])[:, None].astype(np.float32))
        means_x.append(np.einsum("i,tik->tk", row[used], x[:, used])[:, None])
        means_v.append(np.einsum("i,tik->tk", row[used], v[:, used])[:, None])
        kept.append(motion.kept[:, [index[int(i)] for i in used]].mean(axis=1, keepdims=True))
        measured.append(np.asarray(measured[0][:, used].all(axis=1, keepdims=True)))
    new = {old: i for i, old in enumerate(index)}
    inside = [i for i, (a, b) in enumerate(motion.pairs.tolist()) if a in new and b in new]
    return Motion(
        names=rate_points.names,
        t_s=motion.t_s,
        xyz_m=np.concatenate(means_x, axis=1),
        velocity_m_s=np.concatenate(means_v, axis=1),
        own=np.concatenate(own, axis=1),
        pairs=np.array([[new[a], new[b]] for a, b in motion.pairs[inside].tolist()], dtype=np.int64).reshape(-1, 2),
        cross=motion.cross[:, inside],
        kept=np.concatenate(kept, axis=1),
        measured=np.concatenate(measured, axis=1),
        **accelerated,
    )
