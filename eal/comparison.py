"""Whether two groups of trials move differently: the distance of their empirical operators, judged by permutation.

A trial is one operator T_z, the mean of K_z (x) K_z over its samples, so that frames are never taken for independent
samples. In the basis of a few pivots' kernels it is a small matrix, made once; a permutation is index work.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from eal.arrays import Array, points, read_only
from eal.checks import checked_labels, checked_samples
from eal.fitting import pivoted_cholesky
from eal.kernels import Kernel
from eal.plot import POINTS, axis_labels, grid_of
from eal.potential import usual_kernel

PERMUTATIONS = 9999
"""Random splits where there are more than so many: p = 0.05 is then known to 0.002."""
RANGE = (0.025, 0.975)
"""Quantiles of a trial's samples that are the ends of its range: 95 % of them. Chosen."""

Labels = tuple[Sequence[str], Sequence[str]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """How two groups of trials differ, and whether trials of one kind would differ as much.

    Attributes:
        distance: |T_a - T_b|, Hilbert-Schmidt norm; each trial counts alike.
        p_value: Share of the splits in which the groups lie as far apart.
        least_p: The smallest p that so many trials can have.
        splits: Number of splits looked at.
        unit: What was permuted: ``trials``, ``animals``, or ``sides of animals`` where each animal is in both groups.
        counts: Units in a and b.
        level: Of intervals and band.
        names: d coordinate names.
        units: d units.
        range_a: (d, 2) mean ends of the ranges of the trials in a.
        range_b: (d, 2) the same in b.
        overlap: (d,) length that the ranges share over the length that they cover together.
        shift: (d,) preferred posture of b minus that of a: means of the trials' medians.
        shift_interval: (d, 2) interval of it, from the spread of the units (Welch 1947; paired: Student).
        stiffness: (d,) variance in a over that in b, means of logarithms: how many times as stiff the joint would be,
            were it moved by the same agitation (equipartition of energy).
        stiffness_interval: (d, 2) interval of it.
        q: (n, d) points of the map.
        time_a: (n,) <T_a K_q, K_q>: the share of the time that a spends at q, within the width of the kernel.
        time_b: (n,) that of b.
        band: (n,) |time_a - time_b| exceeds this anywhere in 1 - ``level`` of the splits of trials of one kind.
    """

    distance: float
    p_value: float
    least_p: float
    splits: int
    unit: str
    counts: tuple[int, int]
    level: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    range_a: Array
    range_b: Array
    overlap: Array
    shift: Array
    shift_interval: Array
    stiffness: Array
    stiffness_interval: Array
    q: Array
    time_a: Array
    time_b: Array
    band: Array

    def __post_init__(self) -> None:
        """Copy and freeze the arrays."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value))

    @property
    def differs(self) -> NDArray[np.bool_]:
        """(n,) points at which the groups differ, all of them at once at ``level``."""
        return np.abs(self.time_a - self.time_b) > self.band

    def lines(self) -> list[str]:
        """What a person reads: the verdict, then the effect in each coordinate."""
        real = self.p_value <= 1.0 - self.level
        found = [
            f"{'different' if real else 'no difference shown'}: p = {self.p_value:.2g} ({self.splits} splits of "
            f"{self.counts[0]} and {self.counts[1]} {self.unit}; least possible {self.least_p:.2g}), "
            f"distance of the operators {self.distance:.3g}"
        ]
        for j, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            measure = "" if unit == "1" else f" {unit}"
            (a0, a1), (b0, b1) = self.range_a[j], self.range_b[j]
            low, high = self.shift_interval[j]
            soft, stiff = self.stiffness_interval[j]
            found.append(
                f"{name}: range {a0:.3g} to {a1:.3g}{measure} and {b0:.3g} to {b1:.3g}{measure}, overlap "
                f"{100 * self.overlap[j]:.0f} %; preferred posture {self.shift[j]:+.3g}{measure} ({low:+.3g} to "
                f"{high:+.3g}); stiffness {self.stiffness[j]:.3g} times ({soft:.3g} to {stiff:.3g})"
            )
        return found

    def plot(self, axes: Any = None) -> Any:
        """Time at each posture in a and in b, and the difference with its band; of two coordinates a map of each.

        Args:
            axes: Two matplotlib axes, for the groups and for the difference; None: new ones.

        Returns:
            The axes.

        Raises:
            ValueError: it has more than two coordinates.
        """
        if len(self.names) > 2:
            raise ValueError(f"a comparison of {len(self.names)} coordinates has no map: compare one or two of them")
        from matplotlib import pyplot

        if axes is None and len(self.names) == 1:
            axes = pyplot.subplots(2, 1, figsize=(6.4, 6.4), sharex=True, layout="constrained")[1]
        elif axes is None:
            axes = pyplot.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")[1]
        above, below = axes
        labels, percent = axis_labels(self.names, self.units), f"{100 * self.level:.0f} %"
        difference = self.time_a - self.time_b
        title = f"a minus b; {'grey' if len(labels) == 1 else 'black'}: {percent} band everywhere at once"
        if len(labels) == 1:
            q = self.q[:, 0]
            for values, name, colour in ((self.time_a, "a", "#0072B2"), (self.time_b, "b", "#D55E00")):
                above.plot(q, values, color=colour, label=name)
            above.legend(frameon=False)
            above.set_ylabel("share of the time near there")
            below.fill_between(q, -self.band, self.band, color="0.8", linewidth=0)
            below.plot(q, difference, color="0.2")
            below.plot(q, np.where(self.differs, difference, np.nan), color="#D55E00", linewidth=3)
            below.set_ylabel("difference")
        else:
            x, y = (self.q[:, j].reshape(len(np.unique(self.q[:, 0])), -1) for j in range(2))
            shape, most = x.shape, max(float(np.abs(difference).max()), 1e-12)
            for values, colour in ((self.time_a, "#0072B2"), (self.time_b, "#D55E00")):
                above.contour(x, y, values.reshape(shape), colors=colour, levels=5)
            above.set_title("share of the time near there: a blue, b vermillion", fontsize=9)
            filled = below.contourf(x, y, difference.reshape(shape), levels=np.linspace(-most, most, 21), cmap="RdBu")
            if self.differs.any():
                below.contour(x, y, (np.abs(difference) - self.band).reshape(shape), levels=[0.0], colors="black")
            below.figure.colorbar(filled, ax=below)
            for one in (above, below):
                one.set_xlabel(labels[0])
                one.set_ylabel(labels[1])
                one.set_aspect("equal")
        below.set_xlabel(labels[0])
        below.set_title(title, fontsize=9)
        return axes


def compare(
    a: Sequence[ArrayLike],
    b: Sequence[ArrayLike],
    *,
    animals: Labels | None = None,
    kernel: Kernel | None = None,
    q: ArrayLike | None = None,
    level: float = 0.95,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    rng: np.random.Generator | None = None,
) -> Comparison:
    """Whether two groups of trials differ: distance of operators, p value, effect, map with a simultaneous band.

    p is by permutation of trials (exact where all splits are looked at), of |T_a - T_b| with each direction divided by
    1 + s / s_1, s the variance of the units' operators along it and s_1 the largest: where trials differ anyway a
    difference counts half (``docs/experiments/comparison.md``).

    Args:
        a: Trials, each (N_i, d) samples: two recordings of one animal are two trials.
        b: Trials of the other group.
        animals: Whose each trial is, in a and in b. None: trials are permuted. Else an animal is one unit; animals
            that are in both groups change their sides (the same animals before and after), else animals are permuted.
        kernel: Kernel on the coordinates; None: ``usual_kernel`` of all samples.
        q: (n, d) points of the map. None: a grid in one or two coordinates, and a few samples in more.
        level: Of intervals and band; a difference is real where p is at most 1 - level.
        names: d coordinate names; None: q0, q1, ...
        units: d units; None: 1.
        rng: For the splits, where there are too many for all of them; None: always the same.

    Returns:
        The comparison.

    Raises:
        ValueError: no trials, or samples of another kind; animals of which only some are in both groups; or too few
            trials for any p at most 1 - level.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must be a probability between 0 and 1, but is {level!r}")
    groups = [_trials("a", a), _trials("b", b)]
    trials = [*groups[0], *groups[1]]
    d = trials[0].shape[1]
    if any(trial.shape[1] != d for trial in trials):
        raise ValueError(f"trials must have equal coordinates, but have {sorted({t.shape[1] for t in trials})} of them")
    labels, measures = checked_labels(names, units, d)
    unit, merge, sides = _units((len(groups[0]), len(groups[1])), animals)
    coefficients, least = _splits(sides, unit, np.random.default_rng(0) if rng is None else rng)
    if least > 1.0 - level:
        n_a, n_b = (sides > 0).sum(), (sides < 0).sum()
        raise ValueError(
            f"{n_a} and {n_b} {unit} are too few to judge: the least p that their {len(coefficients)} splits allow is "
            f"{least:.2g}, above {1.0 - level:.2g}; record more (4 and 4 trials, or 6 animals that are in both groups, "
            "are the fewest at 0.05)"
        )
    z = np.concatenate(trials)
    kernel = usual_kernel(z) if kernel is None else kernel
    factor = pivoted_cholesky(kernel, z, tolerance=1e-6, max_rank=300)  # 1e-6 of |T|: below any p's rounding
    rows = np.split(factor.rows, np.cumsum([len(trial) for trial in trials])[:-1])
    operators = merge @ np.stack([(one.T @ one / len(one)).reshape(-1) for one in rows])
    separation = np.einsum("pi,ij,pj->p", coefficients, _shrunk(operators, unit), coefficients, optimize=True)
    p_value = float(np.mean(separation >= separation[0] * (1.0 - 1e-9)))  # equal splits differ by rounding

    at = _places(z, factor.pivots) if q is None else points("q", q, d).reshape(-1, d)
    near = merge @ np.stack([(kernel.gram(at, trial) ** 2).mean(axis=1) for trial in trials])
    own = [np.abs(sides * (sides > 0)), np.abs(sides * (sides < 0))]
    ends = merge @ np.stack([np.quantile(trial, RANGE, axis=0).T.reshape(-1) for trial in trials])
    range_a, range_b = ((side @ ends).reshape(d, 2) for side in own)
    shared = np.minimum(range_a[:, 1], range_b[:, 1]) - np.maximum(range_a[:, 0], range_b[:, 0])
    covered = np.maximum(range_a[:, 1], range_b[:, 1]) - np.minimum(range_a[:, 0], range_b[:, 0])
    shift = _difference(merge @ np.stack([np.median(trial, axis=0) for trial in trials]), sides, unit, level)
    spread = np.stack([np.var(trial, axis=0) for trial in trials])
    softer = _difference(merge @ np.log(np.maximum(spread, np.finfo(np.float64).tiny)), sides, unit, level)
    return Comparison(
        distance=float(np.linalg.norm(sides @ operators)),
        p_value=p_value,
        least_p=least,
        splits=len(coefficients),
        unit=unit,
        counts=(int((sides > 0).sum()), int((sides < 0).sum())),
        level=level,
        names=labels,
        units=measures,
        range_a=range_a,
        range_b=range_b,
        overlap=np.divide(np.maximum(shared, 0.0), covered, out=np.ones(d), where=covered > 0),
        shift=shift[0],
        shift_interval=np.stack(shift[1:], axis=1),
        stiffness=np.exp(-softer[0]),
        stiffness_interval=np.exp(-np.stack(softer[:0:-1], axis=1)),
        q=at,
        time_a=own[0] @ near,
        time_b=own[1] @ near,
        band=_band(coefficients, near, level),
    )


PAIRED = "sides of animals"


def _trials(name: str, trials: Sequence[ArrayLike]) -> list[Array]:
    if isinstance(trials, np.ndarray) and trials.ndim < 3:
        raise ValueError(f"{name} must be trials, each (N, d) samples, but is one array of shape {trials.shape}")
    if not len(trials):
        raise ValueError(f"{name} has no trials")
    return [checked_samples(trial) for trial in trials]


def _units(counts: tuple[int, int], animals: Labels | None) -> tuple[str, Array, Array]:
    """What is permuted, (u, n) means that merge trials to units, and (u,) shares: 1/n_a in a, -1/n_b in b."""
    if animals is None:
        keys, unit = [(i < counts[0], str(i)) for i in range(sum(counts))], "trials"
    else:
        if (len(animals[0]), len(animals[1])) != counts:
            raise ValueError(f"animals must name {counts[0]} and {counts[1]} trials, but name {[*map(len, animals)]}")
        both = set(animals[0]) & set(animals[1])
        alone = set(animals[0]) ^ set(animals[1])
        if both and alone:
            raise ValueError(
                f"animals must all be in both groups, or none, but {sorted(both)[0]!r} is in both and "
                f"{sorted(alone)[0]!r} in one"
            )
        keys = [(True, name) for name in animals[0]] + [(False, name) for name in animals[1]]
        unit = PAIRED if both else "animals"
    order = sorted(set(keys), key=lambda key: (not key[0], key[1]))
    merge = np.array([[key == one for key in keys] for one in order], dtype=np.float64)
    first = np.array([in_a for in_a, _ in order])
    sides = np.where(first, 1.0 / max(first.sum(), 1), -1.0 / max((~first).sum(), 1))
    return unit, merge / merge.sum(axis=1, keepdims=True), sides


def _splits(sides: Array, unit: str, rng: np.random.Generator) -> tuple[Array, float]:
    """(P, u) shares of each split, the observed first, and the least p that they allow."""
    u, n_a = len(sides), int((sides > 0).sum())
    if unit == PAIRED:
        total, alike = 2**n_a, 2
        if total <= PERMUTATIONS:
            signs = np.array(list(product((1.0, -1.0), repeat=n_a)))
        else:
            signs = np.vstack([np.ones(n_a), rng.choice([1.0, -1.0], (PERMUTATIONS, n_a))])
        return np.hstack([signs, signs]) * sides, alike / min(total, len(signs))
    total, alike = comb(u, n_a), 2 if 2 * n_a == u else 1  # halves exchanged are as far apart
    if total <= PERMUTATIONS:
        chosen = np.zeros((total, u), dtype=bool)  # in lexical order: the observed, the first n_a, comes first
        chosen[np.repeat(np.arange(total), n_a), np.array(list(combinations(range(u), n_a))).reshape(-1)] = True
    else:
        drawn = rng.permuted(np.tile(sides > 0, (PERMUTATIONS, 1)), axis=1)
        chosen = np.vstack([sides > 0, drawn])
    return np.where(chosen, sides.max(), sides.min()), alike / len(chosen) if total <= PERMUTATIONS else 1 / len(chosen)


def _shrunk(operators: Array, unit: str) -> Array:
    """(u, u) inner products of the units' operators, each direction of their spread divided by 1 + s / s_1.

    No split changes the spread: of trials about their mean; of animals in both groups that of the sides' differences.
    """
    u = len(operators)
    if unit == PAIRED:
        centring = 0.5 * np.block([[np.eye(u // 2), -np.eye(u // 2)], [-np.eye(u // 2), np.eye(u // 2)]])
    else:
        centring = np.eye(u) - 1.0 / u
    s, vectors = np.linalg.eigh(centring @ (operators @ operators.T) @ centring)
    s = np.maximum(s, 0.0)
    return (vectors * (s / (1.0 + s / max(float(s[-1]), np.finfo(np.float64).tiny)))) @ vectors.T


def _difference(values: Array, sides: Array, unit: str, level: float) -> tuple[Array, Array, Array]:
    """Mean of (u, d) values in b minus that in a, and its interval from the spread of the units."""
    a, b = values[sides > 0], values[sides < 0]
    middle = b.mean(axis=0) - a.mean(axis=0)
    if unit == PAIRED:
        error2, freedom = (b - a).var(axis=0, ddof=1) / len(a), np.full(len(middle), len(a) - 1.0)
    else:
        parts = np.stack([x.var(axis=0, ddof=1) / len(x) if len(x) > 1 else np.zeros(len(middle)) for x in (a, b)])
        error2 = parts.sum(axis=0)
        per = np.array([max(len(a) - 1, 1), max(len(b) - 1, 1)])[:, None]
        below = (parts**2 / per).sum(axis=0)
        freedom = np.divide(error2**2, below, out=np.ones(len(middle)), where=below > 0)
    half = stdtrit(freedom, 0.5 + 0.5 * level) * np.sqrt(error2)
    return middle, middle - half, middle + half


def _places(z: Array, pivots: NDArray[np.intp]) -> Array:
    """Points of the map: a grid over the samples in one or two coordinates, and the pivots in more."""
    if z.shape[1] > 2:
        return z[pivots]
    grid = grid_of(z, points=POINTS if z.shape[1] == 1 else 60)  # as the maps of mocap reproduce --quick
    return np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, z.shape[1])


def _band(coefficients: Array, near: Array, level: float) -> Array:
    """(n,) limits that a split's difference of time passes anywhere in 1 - level of the splits (single threshold).

    The largest difference over the map in units of its standard deviation over the splits (Nichols & Holmes 2002).
    """
    second = coefficients.T @ coefficients / len(coefficients)
    sd = np.sqrt(np.maximum(np.einsum("in,ij,jn->n", near, second, near, optimize=True), 0.0))
    sd = np.maximum(sd, 0.01 * sd.max())  # where no trial goes rounding would decide
    scaled = np.divide(near, sd, out=np.zeros_like(near), where=sd > 0.0)
    largest = np.concatenate([np.abs(part @ scaled).max(axis=1) for part in np.array_split(coefficients, 40)])
    return sd * np.quantile(largest, level, method="higher")
