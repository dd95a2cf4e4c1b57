"""Rigid bodies: markers that all keep their distances, and what those that are seen say of those that are not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.body_axes import aligned, nearest_rotation, trunk_shape
from mocap.filters.conditional import expected, patterns
from mocap.filters.independent import FEWEST_FRAMES
from mocap.filters.observations import Observations
from mocap.filters.poses import MarkerTrial
from mocap.filters.slips import Slip, bridged, learn_slip, longest_run
from numpy.typing import NDArray
from scipy.spatial.distance import squareform
from scipy.special import fdtri

from eal.arrays import Array

FEWEST_OF_BODY = 3
"""Markers of a body: two have no axes."""
WOBBLES_DEG = 5.0
"""How far the frame of a body turns at most by what its markers move in it."""
NOT_BY_CHANCE = 0.999
"""Level of the F test for a body's distances to vary less than others: of a hundred markers' few hundred sets one is
by chance above it."""


def independent_samples(away: Array) -> Array:
    """(n,) how many independent samples some centred series (T, n) show, with zeros where they are not known.

    The variance of T samples of a process with autocorrelations rho is that of T / sum rho^2 independent ones (Bayley &
    Hammersley 1946); by its power spectrum P that is (sum P)^2 / sum P^2, twice that of a periodogram, whose lines are
    exponentially distributed.
    """
    power = np.abs(np.fft.rfft(away, n=2 * len(away), axis=0)) ** 2
    number = np.maximum(np.count_nonzero(away, axis=0), 1)
    shown = 2 * power.sum(axis=0) ** 2 / np.maximum(np.sum(power**2, axis=0), 1e-300) * number / len(away)
    return np.clip(shown, 1, number)


def distance_spread(trial: MarkerTrial) -> tuple[Array, Array]:
    """(M, M) by how many metres the markers' distances vary, and how many independent samples show it.

    Pairs that are seen together in fewer than three frames vary without bound.
    """
    count = trial.xyz_m.shape[1]
    spread, samples = np.full((count, count), np.inf), np.ones((count, count))
    for a in range(count):
        apart = np.linalg.norm(trial.xyz_m - trial.xyz_m[:, a : a + 1], axis=-1)
        seen = np.isfinite(apart)
        number = seen.sum(axis=0)
        away = np.where(seen, apart - np.where(seen, apart, 0.0).sum(axis=0) / np.maximum(number, 1), 0.0)
        squares = (away**2).sum(axis=0)
        enough = (number >= FEWEST_OF_BODY) & (squares > 0)
        spread[a, enough] = np.sqrt(squares / np.maximum(number - 1, 1))[enough]
        samples[a] = independent_samples(away)
    return spread, samples


def find_bodies(trial: MarkerTrial) -> list[list[int]]:
    """Sets of three markers and more that keep all their distances, where these vary less than those to any other.

    Markers are joined by complete linkage (Sorensen 1948) of how much their distances vary: a set's height is its
    worst distance. It is a body where that varies by less than the worst distance to it of any other marker, by an F
    test with the samples that are independent, and where it is as broad as to define axes (``wobble_deg``). All markers
    of a recording are one body where their distances vary by no more than the noise of both ends. Of sets in each other
    the one that stands out most is taken.
    """
    from scipy.cluster.hierarchy import linkage  # 0.1 s, for those who look for bodies

    spread, samples = distance_spread(trial)
    count = len(spread)
    if count < FEWEST_OF_BODY:
        return []
    finite = spread[np.isfinite(spread)]
    widest = 10 * float(finite.max(initial=0.0)) + 1.0
    heights = np.maximum(np.where(np.isfinite(spread), spread, widest), 1e-9 * widest)
    np.fill_diagonal(heights, 0.0)
    sets: list[list[int]] = [[m] for m in range(count)]
    found: list[tuple[float, list[int]]] = []
    for a, b, height, _ in linkage(squareform(heights, checks=False), "complete"):
        members = sorted(sets[int(a)] + sets[int(b)])
        sets.append(members)
        if len(members) < FEWEST_OF_BODY or height >= widest:
            continue
        pairs = np.array(np.triu_indices(len(members), 1))
        shown = float(np.median(samples[members][:, members][pairs[0], pairs[1]]))
        least = float(fdtri(shown, shown, NOT_BY_CHANCE))
        others = np.setdiff1d(np.arange(count), members)
        if len(others):
            ratio = (float(heights[others][:, members].max(axis=1).min()) / height) ** 2
        else:
            ratio = 2 * least**2 * float(np.nan_to_num(np.nanmedian(trial.sd_m, axis=0)).max() / height) ** 2
        if ratio > least and wobble_deg(trial.xyz_m[:, members]) <= WOBBLES_DEG:
            found.append((ratio / least, members))
    chosen: list[list[int]] = []
    for _, members in sorted(found, key=lambda one: -one[0]):
        if not any(set(members) & set(other) for other in chosen):
            chosen.append(members)
    return sorted(chosen)


def residual_m(xyz: Array) -> tuple[float, float]:
    """Root mean square of what rigid motions of the mean shape (Kabsch 1976) leave of a body, and its second extent.

    Args:
        xyz: (T, n, 3) positions, of which 200 frames to 399 are looked at.

    Returns:
        Both in metres; infinite and 0 where the markers are seen together in fewer than ``FEWEST_FRAMES``.
    """
    whole = xyz[np.isfinite(xyz).all(axis=(1, 2))]
    if len(whole) < FEWEST_FRAMES:
        return np.inf, 0.0
    whole = whole[:: max(1, len(whole) // 200)]
    whole = whole - whole.mean(axis=1, keepdims=True)
    shape = whole[0]
    for _ in range(2):
        turned = whole @ nearest_rotation(np.einsum("tni,nj->tij", whole, shape))
        shape = turned.mean(axis=0)
    extent = np.linalg.svd(shape, compute_uv=False)[1] / np.sqrt(len(shape))
    return float(np.sqrt(np.mean((turned - shape) ** 2))), float(extent)


def wobble_deg(xyz: Array) -> float:
    """How far a body of n markers (T, n, 3) turns by what its markers move in it, in degrees; infinite: unknown."""
    left, extent = residual_m(xyz)
    return float(np.degrees(np.arctan2(left, extent))) if np.isfinite(left) else np.inf


VAGUE = 1e4
"""Variance of a body's rigid motion over that of its markers' places: nothing is known of it, to eight digits."""


@dataclass(frozen=True, eq=False)
class BodyShape:
    """A body of K markers: their places in its axes, and how they move there, jointly Gaussian.

    Attributes:
        members: (K,) markers.
        place_m: (K, 3) mean places.
        spread: (3K, 3K) covariance of what is measured there, of which rigid motions have no part.
        motions: (3K, 6) orthonormal small rigid motions.
    """

    members: NDArray[np.int64]
    place_m: Array
    spread: Array
    motions: Array


def body_shape(trial: MarkerTrial, members: Sequence[int], others: Sequence[MarkerTrial] = ()) -> BodyShape | None:
    """Learn a body from a trial with gaps; None: it hardly shows four of its markers together.

    Each frame is brought to the mean shape (Gower 1975). What is left there, of frames in which some are missing by
    expectation maximisation, is jointly Gaussian but for rigid motions, of which a frame says nothing. Its covariance
    is drawn to equal, independent errors of all markers as far as the independent samples are few (the oracle
    approximating shrinkage of Chen, Wiesel, Eldar & Hero 2010).

    Args:
        trial: The trial; places are its own.
        members: Markers of the body.
        others: Trials that show, too, how far it bends, each about its own mean shape.
    """
    index = np.array(members)
    found = left_in_axes(trial, index)
    if found is None:
        return None
    left, place = found
    more = [one for other in others if (one := left_in_axes(other, index)) is not None]
    weight = float(sum(_median_samples(one) for one in (left, *(one for one, _ in more))))
    left = np.concatenate([left, *(one for one, _ in more)])
    motions = rigid_motions(place)
    size = left.shape[1]
    inner = np.eye(size) - motions @ motions.T
    free = max(float(np.nanmean(left**2)), 1e-18)
    mean, spread = np.zeros(size), free * inner
    for _ in range(8):  # places are known after two or three rounds
        found, extra = expected(left, mean, spread + VAGUE * free * motions @ motions.T + 1e-6 * free * np.eye(size))
        second = inner @ (found.T @ found + extra) @ inner / len(found)
        total, squares, p = float(np.trace(second)), float(np.sum(second**2)), size - 6
        equal = ((1 - 2 / p) * squares + total**2) / (
            (weight + 1 - 2 / p) * max(squares - total**2 / p, 1e-12 * squares)
        )
        spread = second + min(1.0, equal) * (total / p * inner - second)
    return BodyShape(index, place, spread, motions)


def left_in_axes(trial: MarkerTrial, index: NDArray[np.int64]) -> tuple[Array, Array] | None:
    """What a trial's mean shape of some markers leaves of its frames; None: it hardly shows four of them together.

    Returns:
        (N, 3K) what is left of frames that show four, NaN where not seen; (K, 3) the shape.
    """
    xyz = trial.xyz_m[:, index]
    frames = np.flatnonzero(np.isfinite(xyz[..., 0]).sum(axis=1) > FEWEST_OF_BODY)
    if len(frames) < FEWEST_FRAMES:
        return None
    place = trunk_shape(xyz[frames])
    if not np.isfinite(place).all():
        return None
    return (_in_axes(xyz[frames], place)[0] - place).reshape(len(frames), -1), place


def _median_samples(left: Array) -> float:
    return float(np.median(independent_samples(np.where(np.isfinite(left), left, 0.0))))


def rigid_motions(place_m: Array) -> Array:
    """(3K, 6) orthonormal basis of small rigid motions of places (K, 3)."""
    away = place_m - place_m.mean(axis=0)
    turns = np.cross(np.eye(3)[:, None], away[None]).reshape(3, -1)
    shifts = np.tile(np.eye(3), (1, len(place_m)))
    return np.linalg.qr(np.concatenate([shifts, turns]).T)[0]


def _in_axes(xyz: Array, place: Array) -> tuple[Array, Array, Array]:
    """(T, K, 3) markers in the axes of a body, NaN where not seen; (T, 3, 3) and (T, 3) where these are."""
    seen = np.isfinite(xyz[..., 0])
    rotation, position, _ = aligned(np.where(seen[..., None], xyz, 0.0), seen, place)
    return np.einsum("tji,tkj->tki", rotation, xyz - position[:, None]), rotation, position


@dataclass(frozen=True, eq=False)
class Completed:
    """What rigid bodies say of markers that are not seen while three others of their body are.

    Attributes:
        xyz_m: (T, M, 3) positions; NaN where they say nothing.
        cov_m2: (T, M, 3, 3) their covariance.
        lasting_m2: (T, M, 3, 3) the part of it that lasts from frame to frame, which no filter averages out.
    """

    xyz_m: Array
    cov_m2: Array
    lasting_m2: Array

    @property
    def filled(self) -> NDArray[np.bool_]:
        """(T, M) where they say something."""
        return np.isfinite(self.xyz_m[..., 0])

    def whole(self, trial: MarkerTrial) -> MarkerTrial:
        """The trial with them, as measurements of their deviation."""
        found = self.filled
        if not found.any():
            return trial
        sd = np.sqrt(np.trace(self.cov_m2, axis1=-2, axis2=-1) / 3)
        return replace(
            trial, xyz_m=np.where(found[..., None], self.xyz_m, trial.xyz_m), sd_m=np.where(found, sd, trial.sd_m)
        )

    def with_lasting(self, xyz_m: Array, cov_m2: Array, seen: Observations) -> Array:
        """(T, M, 3, 3) covariances of a smoother that took each frame's error for a new one, with what lasts.

        What lasts enters an estimate by the weight that it has beside the rays of its frame, and is not averaged out.

        Args:
            xyz_m: (T, M, 3) smoothed positions.
            cov_m2: (T, M, 3, 3) their covariance.
            seen: What else is seen of the markers.
        """
        out = np.array(cov_m2)
        for frame in np.flatnonzero(self.filled.any(axis=1)):
            sights = seen.sights(int(frame), xyz_m[frame], cov_m2[frame])
            white = sights.slope / sights.sd[..., None]
            for marker in np.flatnonzero(self.filled[frame]):
                mine = white[sights.where[:, 1] == marker].reshape(-1, 3)
                weight = np.linalg.inv(np.eye(3) + self.cov_m2[frame, marker] @ mine.T @ mine)
                out[frame, marker] += weight @ self.lasting_m2[frame, marker] @ weight.T
        return out


def completed(trial: MarkerTrial, bodies: Sequence[Sequence[int]], others: Sequence[MarkerTrial] = ()) -> Completed:
    """Markers of bodies that are not seen, from those that are: the best linear unbiased estimate.

    Given the markers that are seen, and nothing of the body's motion, a hidden one has the mean and covariance of
    universal kriging (Matheron 1969): the rigid fit with weights, and what its markers' slips have in common. What that
    misses the marker by where it is seen is bridged (``slips``), as a shoe bends and skin slides for some time, and all
    trials say how far and for how long. Its own place is that without the noise of a measurement.

    Args:
        trial: The trial.
        bodies: Markers of each body.
        others: Trials of the same markers, of the size of its animal.
    """
    xyz = np.full(trial.xyz_m.shape, np.nan)
    cov, lasting = np.full((2, *xyz.shape, 3), np.nan)
    for members in bodies:
        hidden = ~trial.seen[:, list(members)]
        if not hidden.any() or len(members) <= FEWEST_OF_BODY:
            continue
        shape = body_shape(trial, members, others)
        if shape is None:
            continue
        local, rotation, position = _in_axes(trial.xyz_m[:, shape.members], shape.place_m)
        left = [_in_axes(other.xyz_m[:, shape.members], shape.place_m)[0] - shape.place_m for other in others]
        left = [one.reshape(len(one), -1) for one in (*left, local - shape.place_m)]
        ever, known = trial.seen[:, shape.members].any(axis=0), dict[int, Slip]()
        for seen, frames in sorted(patterns(~hidden), key=lambda one: -len(one[1])):
            if seen.sum() < FEWEST_OF_BODY:
                continue
            for m in np.flatnonzero(~seen & ever):
                found = _placed(shape, left, seen, int(m), frames, known)
                if found is None:
                    continue
                marker, turn, (place, whole, lasts) = shape.members[m], rotation[frames], found
                xyz[frames, marker] = np.einsum("tij,tj->ti", turn, shape.place_m[m] + place) + position[frames]
                cov[frames, marker] = turn @ whole @ turn.swapaxes(1, 2)
                lasting[frames, marker] = turn @ lasts @ turn.swapaxes(1, 2)
    return Completed(xyz, cov, lasting)


def _placed(
    shape: BodyShape,
    left: Sequence[Array],
    seen: NDArray[np.bool_],
    lost: int,
    frames: NDArray[np.int64],
    known: dict[int, Slip],
) -> tuple[Array, Array, Array] | None:
    """Where a body has a marker, from its place, in its axes; None: by more than its frame may turn, it does not know.

    Args:
        shape: The body.
        left: (T, 3K) what its mean shape leaves of each trial; the last is the one to fill.
        seen: (K,) markers that are seen.
        lost: The one that is not.
        frames: (n,) in which.
        known: How markers slip that were lost before, while others were seen; this one is added.

    Returns:
        (n, 3) places, (n, 3, 3) their covariances, (n, 3, 3) the part of these that lasts.
    """
    vague = VAGUE * np.trace(shape.spread) / len(shape.spread)
    whole = shape.spread + vague * shape.motions @ shape.motions.T
    rows, column = np.repeat(seen, 3), np.repeat(np.arange(len(seen)) == lost, 3)
    by = np.linalg.lstsq(whole[np.ix_(rows, rows)], whole[np.ix_(rows, column)], rcond=1e-12)[0]
    error = np.zeros((3, len(whole)))
    error[:, rows], error[:, column] = -by.T, np.eye(3)
    extent = np.linalg.svd(shape.place_m - shape.place_m.mean(axis=0), compute_uv=False)[1]
    limit = (np.tan(np.radians(WOBBLES_DEG)) * extent) ** 2 / len(shape.members)
    bends = error @ shape.spread @ error.T
    if float(np.trace(bends)) / 3 + vague * float(np.sum((error @ shape.motions) ** 2)) > limit:
        return None
    used = rows | column
    series = [one[:, used] @ error[:, used].T for one in left]
    if lost not in known:
        known[lost] = learn_slip(series, longest_run(frames), bends)
    slip = known[lost].of(series, bends)
    white = slip.white_m2 / (1 + np.sum(by**2) / 3) * by.T @ by  # all markers' noise is equal
    place, lasts = bridged(slip, series[-1], frames)
    return left[-1][frames][:, rows] @ by + place, lasts + white, lasts
