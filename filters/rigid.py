"""Rigid bodies: markers that all keep their distances, found in a recording."""

import numpy as np
from mocap.filters.body_axes import nearest_rotation
from mocap.filters.poses import MarkerTrial
from scipy.cluster.hierarchy import linkage
from scipy.spatial.distance import squareform
from scipy.stats import f as f_distribution

from eal.arrays import Array

CERTAIN = 0.999
"""Probability with which what varies less must vary less: of a hundred markers' few hundred sets one is by chance."""
LEAST = 3
"""Markers of a body: two have no axes."""
WOBBLES_DEG = 5.0
"""How far the frame of a body turns at most by what its markers move in it."""


def distance_spread(trial: MarkerTrial) -> tuple[Array, Array]:
    """(M, M) by how many metres the markers' distances vary, and how many independent samples show it.

    The variance of n samples of a process with autocorrelations rho is that of n / sum rho^2 independent ones (Bayley &
    Hammersley 1946); by its power spectrum P that is (sum P)^2 / sum P^2, twice that of a periodogram, whose lines are
    exponentially distributed. Pairs that are seen together in fewer than
    three frames vary without bound.
    """
    count = trial.xyz_m.shape[1]
    spread, samples = np.full((count, count), np.inf), np.ones((count, count))
    for a in range(count):
        apart = np.linalg.norm(trial.xyz_m - trial.xyz_m[:, a : a + 1], axis=-1)
        seen = np.isfinite(apart)
        number = seen.sum(axis=0)
        away = np.where(seen, apart - np.where(seen, apart, 0.0).sum(axis=0) / np.maximum(number, 1), 0.0)
        power = np.abs(np.fft.rfft(away, n=2 * len(away), axis=0)) ** 2
        squares = np.maximum(np.sum(power**2, axis=0), 1e-300)
        known = (number >= LEAST) & (power.sum(axis=0) > 0)
        spread[a, known] = np.sqrt((away**2).sum(axis=0) / np.maximum(number - 1, 1))[known]
        shown = 2 * power.sum(axis=0) ** 2 / squares * number / len(away)
        samples[a] = np.clip(shown, 1, np.maximum(number, 1))
    return spread, samples


def find_bodies(trial: MarkerTrial) -> list[list[int]]:
    """Sets of three markers and more that keep all their distances, where these vary less than those to any other.

    Markers are joined by complete linkage (Sorensen 1948) of how much their distances vary: a set's height is its
    worst distance. It is a body where that varies by less than the worst distance to it of any other marker, by an F
    test with the samples that are independent, and where it is as broad as to define axes (``wobble_deg``). All markers
    of a recording are one body where their distances vary by no more than the noise of both ends. Of sets in each other
    the one that stands out most is taken.
    """
    spread, samples = distance_spread(trial)
    count = len(spread)
    if count < LEAST:
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
        if len(members) < LEAST or height >= widest:
            continue
        pairs = np.array(np.triu_indices(len(members), 1))
        shown = float(np.median(samples[members][:, members][pairs[0], pairs[1]]))
        least = float(f_distribution.ppf(CERTAIN, shown, shown))
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


def residual_m(xyz: Array, *, most: int = 200) -> tuple[float, float]:
    """Root mean square of what rigid motions of the mean shape (Kabsch 1976) leave of a body, and its second extent.

    Args:
        xyz: (T, n, 3) positions.
        most: Frames that are looked at, at most.

    Returns:
        Both in metres; infinite and 0 where the markers are seen together in fewer than 20 frames.
    """
    whole = xyz[np.isfinite(xyz).all(axis=(1, 2))]
    if len(whole) < 20:
        return np.inf, 0.0
    whole = whole[:: max(1, len(whole) // most)]
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
