"""Splits of units into two groups, and statistics of them that are divided by their own spread in each split.

Units that are known unequally well (short and long trials, animals with one trial and with six) are not exchangeable:
how far apart two means lie says nothing without the spread of either group. Divided by it, anew in each split, a
permutation test is exact where units are exchangeable and asymptotically right where only the means are equal (Janssen
1997, Chung & Romano 2013). With a few units whose spread hangs on the smaller group that limit is far: there the F
distribution with the degrees of freedom of Welch (1947), as Box (1954) and Brunner, Dette & Munk (1997) have it for
several dimensions, takes over by as much as those degrees of freedom are fewer than of equal spreads.
"""

from dataclasses import dataclass, replace
from itertools import combinations, product
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, fdtri

from eal.arrays import Array

PERMUTATIONS = 9999
"""Random splits where there are more than so many: p = 0.05 is then known to 0.002."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Splits:
    """P ways to split u units, the observed one first, as coefficients of means and variances of each part.

    Two groups are two parts. Animals that are in both groups are one part, of their differences with a sign each.

    Attributes:
        mean: Of each part (P, u) shares of the units in its mean; with signs where there is one part.
        spread: Of each part (P, u) shares of the units' squares in the variance of that mean, w^2 / (1 - w).
        shifted: (u,) 1 for units that a shift of b against a moves.
        paired: Whether units are differences.
        least_p: The smallest p that so many splits allow.
        alike: Of what is known of units (1 over their variance), as stated before any split, the mean in the group of
            less over that in the other: 1 for groups whose units are known equally.
    """

    mean: tuple[Array, ...]
    spread: tuple[Array, ...]
    shifted: Array
    paired: bool
    least_p: float
    alike: float = 1.0

    def __len__(self) -> int:
        """P."""
        return len(self.mean[0])

    @property
    def contrast(self) -> Array:
        """(P, u) coefficients of the mean of a minus that of b."""
        return self.mean[0] if self.paired else self.mean[0] - self.mean[1]

    def some(self, start: int, stop: int) -> "Splits":
        """Some of the splits."""
        return replace(
            self,
            mean=tuple(part[start:stop] for part in self.mean),
            spread=tuple(part[start:stop] for part in self.spread),
        )

    def _crossed(self, part: int) -> Array:
        return self.spread[part] * np.sign(self.mean[part]) if self.paired else self.spread[part]

    def variance(self, x: Array, y: Array | None = None) -> Array:
        """Variance of the contrast of values (u, ...) in each split, (P, ...); with y the covariance with that of y."""
        y = x if y is None else y
        total = np.zeros((len(self), *np.broadcast_shapes(x.shape[1:], y.shape[1:])))
        for part, (mean, spread) in enumerate(zip(self.mean, self.spread, strict=True)):
            crossed, of_x = self._crossed(part), mean @ x
            whole = spread.sum(axis=1).reshape(-1, *[1] * (total.ndim - 1))
            if x is y:  # a third of the work
                total += spread @ (x * x) + of_x * (whole * of_x - 2.0 * (crossed @ x))
            else:
                of_y = mean @ y
                total += spread @ (x * y) - (crossed @ x) * of_y - (crossed @ y) * of_x + whole * of_x * of_y
        return total

    def distances(self, gram: Array) -> tuple[Array, Array]:
        """Squared distance of the means in each split, and the trace of its covariance, from inner products (u, u)."""
        contrast = self.contrast
        apart = np.einsum("pi,pi->p", contrast @ gram, contrast)
        total, own = np.zeros(len(self)), np.diagonal(gram)
        for part, (mean, spread) in enumerate(zip(self.mean, self.spread, strict=True)):
            to_mean = mean @ gram
            total += spread @ own - 2.0 * np.einsum("pi,pi->p", self._crossed(part), to_mean)
            total += spread.sum(axis=1) * np.einsum("pi,pi->p", mean, to_mean)
        return apart, np.maximum(total, 0.0)

    def traces(self, gram: Array) -> tuple[float, float]:
        """Trace of the variance of the mean of a, and of b, in the observed split."""
        found = []
        for mean, spread in zip(self.mean, self.spread, strict=True):
            to_mean = mean[0] @ gram
            own = spread[0] @ np.diagonal(gram) - 2.0 * spread[0] @ to_mean + spread[0].sum() * (mean[0] @ to_mean)
            found.append(max(float(own), 0.0))
        return found[0], found[1]

    def freedom(self, gram: Array) -> tuple[Array, Array]:
        """Degrees of freedom f1 and f2 of F in each split of two groups, from inner products (u, u).

        f1 = (tr V)^2 / tr V^2 and f2 = (tr V)^2 / sum of tr V_i^2 / (n_i - 1), V = V_a + V_b the covariance of the
        difference of means, from the units as they are.
        """
        squared = gram * gram
        to_mean = [mean @ gram for mean in self.mean]
        by_gram, by_square = ([spread @ matrix for spread in self.spread] for matrix in (gram, squared))

        def product(i: int, j: int) -> Array:
            """Tr V_i V_j: inner products of residuals are G_kl - m_i.x_l - x_k.m_j + m_i.m_j; squared and summed."""
            h, k, of_j, of_i = self.spread[i], self.spread[j], to_mean[j], to_mean[i]
            middle = _dot(self.mean[i], of_j)
            whole_h, whole_k, h_j, k_i = h.sum(axis=1), k.sum(axis=1), _dot(h, of_j), _dot(k, of_i)
            found = _dot(by_square[i], k) + whole_h * _dot(k, of_i**2) + whole_k * _dot(h, of_j**2)
            found += whole_h * whole_k * middle**2 - 2.0 * _dot(k * of_i, by_gram[i])
            found += 2.0 * middle * _dot(by_gram[i], k) - 2.0 * _dot(h * of_j, by_gram[j])
            return found + 2.0 * h_j * k_i - 2.0 * middle * (whole_h * k_i + whole_k * h_j)

        own = [np.maximum(product(i, i), 0.0) for i in range(2)]
        whole = self.distances(gram)[1] ** 2
        tiny = np.finfo(np.float64).tiny
        f1 = whole / np.maximum(own[0] + own[1] + 2.0 * np.maximum(product(0, 1), 0.0), tiny)
        counts = [np.maximum(1.0 / _dot(mean, mean) - 1.0, 1.0) for mean in self.mean]
        f2 = whole / np.maximum(own[0] / counts[0] + own[1] / counts[1], tiny)
        return np.clip(f1, 1.0, 1e6), np.clip(f2, 1.0, 1e6)

    def doubt(self, traces: tuple[float, float]) -> float:
        """How little the observed split is like the others: 0 for equal groups of equal spread, 1 if one decides alone.

        1 - (share of Welch's degrees of freedom between those of the smaller group and those of both) (n / m)^2
        ``alike``, n the units of the smaller group and m those of the larger.

        Args:
            traces: Of the variance of the mean of a, and of b.
        """
        n = [1.0 / float(np.sum(mean[0] ** 2)) for mean in self.mean]
        low, high = max(min(n) - 1.0, 1.0), max(sum(n) - 2.0, 2.0)
        below = sum(v**2 / max(k - 1.0, 1.0) for v, k in zip(traces, n, strict=True))
        welch = sum(traces) ** 2 / below if below > 0.0 else high
        share = np.clip((welch - low) / (high - low), 0.0, 1.0) * (min(n) / max(n)) ** 2
        return float(1.0 - self.alike * share)


def _dot(x: Array, y: Array) -> Array:
    return np.einsum("pi,pi->p", x, y)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What splits say of a statistic.

    Attributes:
        p_value: Share of the splits whose statistic is as large, or more where few units decide.
        wider: By how much limits of the splits must grow, so that they agree with that; 1: not at all.
        statistic: (P,) of all splits.
    """

    p_value: float
    wider: float
    statistic: Array


def judge(splits: Splits, gram: Array, level: float) -> Judged:
    """Squared distance of the means over the trace of its covariance, in all splits.

    Args:
        splits: The splits.
        gram: (u, u) inner products of the units.
        level: At which ``wider`` is taken.
    """
    apart, trace = splits.distances(gram)
    floor = 1e-12 * max(float(np.abs(np.diagonal(gram)).max()), np.finfo(np.float64).tiny)
    statistic = apart / np.maximum(trace, floor)
    p = _share(statistic)
    if splits.paired:
        return Judged(p_value=p, wider=1.0, statistic=statistic)
    f1, f2 = splits.freedom(gram)
    tail = fdtrc(f1, f2, statistic)
    weight = splits.doubt(splits.traces(gram))
    limit, wanted = float(np.quantile(statistic, level, method="higher")), float(fdtri(f1[0], f2[0], level))
    careful = max(p, float(tail[0]), _share(-tail))  # Beran (1988): splits compared by what F says of each
    return Judged(
        p_value=min(1.0, p ** (1.0 - weight) * careful**weight),
        wider=max(1.0, wanted / limit) ** (0.5 * weight) if limit > 1e-12 else 1.0,  # equal units: all is known
        statistic=statistic,
    )


def _share(statistic: Array) -> float:
    """Of splits whose statistic is at least that of the first; equal ones differ by rounding."""
    return float(np.mean(statistic >= statistic[0] - 1e-9 * abs(statistic[0])))


def two_groups(in_a: NDArray[np.bool_], weights: Array, rng: np.random.Generator, *, alike: float = 1.0) -> Splits:
    """Splits of units into groups as large as the observed; all of them where they are few.

    Args:
        in_a: (u,) whether each unit is in a.
        weights: (u,) what each counts in the mean of its group, 1 over its variance; goes with it into any group.
        rng: For splits where there are too many for all of them.
        alike: See ``Splits``.
    """
    first = np.asarray(in_a, dtype=bool)
    u, n_a = len(first), int(first.sum())
    total, mirrored = comb(u, n_a), 2 if 2 * n_a == u else 1  # halves exchanged are as far apart
    if total <= PERMUTATIONS:
        order = np.concatenate([np.flatnonzero(first), np.flatnonzero(~first)])
        chosen = np.zeros((total, u), dtype=bool)  # in lexical order: the observed, the first n_a, comes first
        rows = order[np.array(list(combinations(range(u), n_a)), dtype=np.int64).reshape(-1)]
        chosen[np.repeat(np.arange(total), n_a), rows] = True
    else:
        chosen = np.vstack([first, rng.permuted(np.tile(first, (PERMUTATIONS, 1)), axis=1)])
        mirrored = 1
    means = []
    for members in (chosen, ~chosen):
        share = members * weights
        means.append(share / np.maximum(share.sum(axis=1, keepdims=True), np.finfo(np.float64).tiny))
    return Splits(
        mean=tuple(means),
        spread=tuple(_spread(mean) for mean in means),
        shifted=(~first).astype(np.float64),
        paired=False,
        least_p=mirrored / len(chosen),
        alike=alike,
    )


def pairs(weights: Array, rng: np.random.Generator) -> Splits:
    """Signs of the differences of u animals that are in both groups; all of them where they are few."""
    u = len(weights)
    if 2**u <= PERMUTATIONS:
        signs, alike = np.array(list(product((1.0, -1.0), repeat=u))), 2
    else:
        signs, alike = np.vstack([np.ones(u), rng.choice([1.0, -1.0], (PERMUTATIONS, u))]), 1
    share = weights / weights.sum()
    return Splits(
        mean=(signs * share,),
        spread=(np.tile(_spread(share[None]), (len(signs), 1)),),
        shifted=-np.ones(u),
        paired=True,
        least_p=alike / len(signs),
    )


def _spread(mean: Array) -> Array:
    """Shares of squares about the mean whose sum is its variance, without bias where units count alike."""
    return mean**2 / np.maximum(1.0 - mean, 1e-9)


def judged_everywhere(splits: Splits, values: Array) -> tuple[Array, Array]:
    """The largest difference over n places in each split, over one number for its spread: max |difference| / sd.

    The number is the largest standard deviation of the difference at any place in that split. At each place's own
    spread those would decide where few units go, whose spread is not known (all of four trials may miss a place).

    Args:
        splits: The splits.
        values: (u, n) of each unit.

    Returns:
        (P,) statistics, and (P,) that standard deviation: a difference is seen that exceeds their product.
    """
    centred = values if splits.paired else values - values.mean(axis=0)
    largest, sd = np.zeros(len(splits)), np.zeros(len(splits))
    step = max(1, (1 << 20) // max(values.shape[1], 1))
    for start in range(0, len(splits), step):
        part = splits.some(start, start + step)
        sd[start : start + step] = np.sqrt(np.maximum(part.variance(centred), 0.0).max(axis=1))
        largest[start : start + step] = np.abs(part.contrast @ centred).max(axis=1)
    sd = np.maximum(sd, 1e-9 * max(float(np.abs(centred).max()), np.finfo(np.float64).tiny))
    return largest / sd, sd


def shift_interval(splits: Splits, values: Array, level: float) -> tuple[float, float, float]:
    """Mean of b minus that of a, and all shifts that the splits do not reject: the test of ``judge``, turned round.

    Args:
        splits: The splits.
        values: (u,) of each unit.
        level: Of the interval.

    Returns:
        The shift, and the ends of its interval.
    """
    x, e = (values if splits.paired else values - values.mean())[:, None], splits.shifted[:, None]
    at, by = (-(splits.contrast @ one)[:, 0] for one in (x, e))
    xx, xe, ee = (splits.variance(*pair)[:, 0] for pair in ((x,), (x, e), (e,)))
    middle, se = float(at[0]), float(np.sqrt(max(xx[0], 0.0)))
    if se <= 1e-9 * max(float(np.abs(x).max()), abs(middle), np.finfo(np.float64).tiny):
        return middle, middle, middle
    wider = judge(splits, (x @ x.T), level).wider

    def kept(delta: float) -> bool:
        statistic = (at - delta * by) ** 2 / np.maximum(xx - 2.0 * delta * xe + delta**2 * ee, 1e-12 * xx[0])
        return _share(statistic) > 1.0 - level

    ends = []
    for side in (-1.0, 1.0):
        inside, outside = 0.0, 1.0
        while kept(middle + side * outside * se) and outside < 1e4:
            inside, outside = outside, 1.5 * outside
        for _ in range(30):
            half = 0.5 * (inside + outside)
            inside, outside = (half, outside) if kept(middle + side * half * se) else (inside, half)
        ends.append(middle + side * outside * se * wider)
    return middle, ends[0], ends[1]
