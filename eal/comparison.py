"""Whether two groups of trials move differently: the distance of their empirical operators, judged by permutation.

A trial is one operator T_z, the mean of K_z (x) K_z over its samples, so that frames are never taken for independent
samples. In the basis of a few pivots' kernels it is a small matrix, made once; a permutation is index work.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eal.arrays import Array, points, read_only
from eal.checks import checked_labels
from eal.fitting import pivoted_cholesky
from eal.kernels import Kernel
from eal.plot import POINTS, axis_labels, grid_of
from eal.potential import usual_kernel
from eal.splits import Judged, Splits, judge, judged_everywhere, pairs, shift_interval, two_groups
from eal.unseen import Trial, known_phases, trial_of

RANGE = (0.025, 0.975)
"""Quantiles of a trial's samples that are the ends of its range: 95 % of them. Chosen."""

Labels = tuple[Sequence[str], Sequence[str]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """How two groups of trials differ, and whether trials of one kind would differ as much.

    Attributes:
        distance: |T_a - T_b|, Hilbert-Schmidt norm; each unit counts by what is known of it.
        p_value: Share of the splits in which the groups lie as far apart, in units of their own spread.
        least_p: The smallest p that so many units can have.
        splits: Number of splits looked at.
        unit: What was permuted: ``trials``, ``animals``, or ``sides of animals`` where each animal is in both groups.
        counts: Units in a and b.
        trials: Trials in a and b.
        level: Of intervals and band.
        names: d coordinate names.
        units: d units.
        range_a: (d, 2) ends of 95 % of the time in a, each unit alike.
        range_b: (d, 2) the same in b.
        overlap: (d,) length that the ranges share over the length that they cover together.
        shift: (d,) mean of b minus that of a. Means, since they alone do not hang on how long a trial is.
        shift_interval: (d, 2) all shifts that the same splits do not reject.
        variance_ratio: (d,) variance in b over that in a.
        variance_of: Of what: ``within trials``, or, where trials are so short that their means differ by where in the
            cycle they are, ``all trials together``: a short trial, which sees a part of a cycle, makes neither small.
        variance_ratio_interval: (d, 2) interval of it, by the same splits.
        variance_p: (d,) p that the variances are equal.
        p_of_all: p where this is one of several joints: of the largest difference of any of them (``compare_all``).
        variance_p_of_all: (d,) the same for variances.
        left_out: Share of the frames of a and of b in phases of the cycle that the other side never saw.
        unseen: Share of the frames of a and b that were not measured.
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
    trials: tuple[int, int]
    level: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    range_a: Array
    range_b: Array
    overlap: Array
    shift: Array
    shift_interval: Array
    variance_ratio: Array
    variance_of: str
    variance_ratio_interval: Array
    variance_p: Array
    p_of_all: float
    variance_p_of_all: Array
    left_out: tuple[float, float]
    unseen: tuple[float, float]
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

    @property
    def stiffness(self) -> Array:
        """1 / ``variance_ratio``, under its former name: the name goes with the next release."""
        return 1.0 / self.variance_ratio

    @property
    def stiffness_interval(self) -> Array:
        """Interval of ``stiffness``."""
        return 1.0 / self.variance_ratio_interval[:, ::-1]

    def lines(self) -> list[str]:
        """What a person reads: the verdict, then the effect in each coordinate."""
        real = self.p_of_all <= 1.0 - self.level
        within = "within these animals, whose trials were permuted: " if self.unit == "trials" else ""
        several = "" if self.p_of_all == self.p_value else f", {self.p_of_all:.2g} for all joints at once"
        found = [
            f"{within}{'different' if real else 'no difference shown'}: p = {self.p_value:.2g}{several} ({self.splits} "
            f"splits of {self.counts[0]} and {self.counts[1]} {self.unit}; least possible {self.least_p:.2g}), "
            f"distance of the operators {self.distance:.3g}"
        ]
        for j, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            measure = "" if unit == "1" else f" {unit}"
            (a0, a1), (b0, b1) = self.range_a[j], self.range_b[j]
            low, high = self.shift_interval[j]
            less, more = self.variance_ratio_interval[j]
            found.append(
                f"{name}: range {a0:.3g} to {a1:.3g}{measure} and {b0:.3g} to {b1:.3g}{measure}, overlap "
                f"{100 * self.overlap[j]:.0f} %; mean {self.shift[j]:+.3g}{measure} ({low:+.3g} to {high:+.3g}); "
                f"variance {self.variance_ratio[j]:.3g} times ({less:.3g} to {more:.3g}, p = {self.variance_p[j]:.2g})"
            )
        if max(self.left_out) > 0.0:
            found.append(
                f"left out: {100 * self.left_out[0]:.0f} % of the frames of a and {100 * self.left_out[1]:.0f} % of b, "
                "in phases of the cycle that one side never saw"
            )
        return found

    def methods(self) -> str:
        """The sentence for the methods section of a paper."""
        what = {"trials": "trials", "animals": "animals (all trials of one are one unit)"}.get(
            self.unit, "the two sides of each animal"
        )
        return (
            f"Groups of {self.trials[0]} and {self.trials[1]} trials ({self.counts[0]} and {self.counts[1]} "
            f"{self.unit}) were compared by a permutation test of {what} ({self.splits} splits). The statistic is the "
            "squared distance of the groups' mean empirical operators over its variance in each split (Janssen 1997; "
            f"Chung & Romano 2013): p = {self.p_value:.2g}. Bands are simultaneous; they and the intervals of means "
            f"and of the ratio of variances are of the same splits, at {100 * self.level:.0f} %."
        )

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
    covariances: tuple[Sequence[ArrayLike | None], Sequence[ArrayLike | None]] | None = None,
    measured: tuple[Sequence[ArrayLike | None], Sequence[ArrayLike | None]] | None = None,
    kernel: Kernel | None = None,
    q: ArrayLike | None = None,
    level: float = 0.95,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    rng: np.random.Generator | None = None,
) -> Comparison:
    """Whether two groups of trials differ: distance of operators, p value, effect, map with a simultaneous band.

    p is by permutation of units, of |T_a - T_b|^2 over the trace of its covariance, both anew in each split
    (``eal.splits``), with each direction divided by 1 + s / s_1, s the variance of the units' operators along it and
    s_1 the largest: where trials differ anyway a difference counts half (``docs/experiments/comparison.md``). It is
    exact for exchangeable units.

    Args:
        a: Trials, each (N_i, d) samples: two recordings of one animal are two trials. NaN: that frame was not seen; it
            is estimated from those around it, with its uncertainty (``eal.unseen``).
        b: Trials of the other group.
        animals: Whose each trial is, in a and in b. None: trials are permuted. Else an animal is one unit; animals
            that are in both groups change their sides (the same animals before and after), else animals are permuted.
        covariances: Of each trial (N_i, d, d) of its samples, as a smoother gives them for frames that were not
            measured; None: none.
        measured: Of each trial (N_i,) whether a frame was measured; None: where it is not NaN. Frames in phases of
            the cycle that one side never measured are left out of both.
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
            units to judge.
    """
    return _compared(
        a,
        b,
        animals=animals,
        covariances=covariances,
        measured=measured,
        kernel=kernel,
        q=q,
        level=level,
        names=names,
        units=units,
        rng=rng,
    )[0]


def compare_all(
    groups: Mapping[str, tuple[Sequence[ArrayLike], Sequence[ArrayLike]]],
    *,
    animals: Labels | None = None,
    rng: np.random.Generator | None = None,
    options: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Comparison]:
    """Several joints of the same trials at once: each as by ``compare``, with p of the largest difference of any.

    In each split the statistics of all joints, and of their variances, are brought to one scale (mean and standard
    deviation of their cube roots over all splits: Wilson & Hilferty 1931) and the largest is kept (max-T: Westfall &
    Young 1993).

    Args:
        groups: Of each joint the trials in a and in b; the i-th trial is the same one for all joints.
        animals: As in ``compare``.
        rng: For the splits.
        options: Of a joint further arguments of ``compare``.

    Returns:
        The comparison of each joint, with ``p_of_all`` and ``variance_p_of_all``.

    Raises:
        ValueError: as ``compare``; or joints of different numbers of trials.
    """
    counts = {name: (len(a), len(b)) for name, (a, b) in groups.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"joints must be of the same trials, but have {counts}")
    seed = np.random.default_rng(0) if rng is None else rng
    state = seed.bit_generator.state
    found, places, spreads = {}, [], []
    for name, (a, b) in groups.items():
        seed.bit_generator.state = state  # the same splits for all
        further = {} if options is None else dict(options.get(name, {}))
        found[name], place, spread = _compared(a, b, animals=animals, rng=seed, alike=True, **further)
        places.append(place)
        spreads.append(spread)
    largest = _scaled(np.stack([one.statistic for one in places])).max(axis=0)
    widest = _scaled(np.stack([one.statistic for each in spreads for one in each])).max(axis=0)
    out = {}
    for (name, one), place, spread in zip(found.items(), places, spreads, strict=True):
        out[name] = replace(
            one,
            p_of_all=_p_of_all(place, largest),
            variance_p_of_all=np.array([_p_of_all(each, widest) for each in spread]),
        )
    return out


def _scaled(statistics: Array) -> Array:
    """(J, P) cube roots of statistics, each over its mean and standard deviation in all splits."""
    roots = np.cbrt(statistics)
    sd = roots.std(axis=-1, keepdims=True)
    return (roots - roots.mean(axis=-1, keepdims=True)) / np.where(sd > 0.0, sd, 1.0)


def _p_of_all(one: Judged, largest: Array) -> float:
    """As much above the share of splits as the p of the joint alone is."""
    scaled = _scaled(one.statistic[None])[0]
    share, alone = (float(np.mean(x >= scaled[0] - 1e-9 * abs(scaled[0]))) for x in (largest, scaled))
    return min(1.0, share * max(1.0, one.p_value / alone))


def _compared(
    a: Sequence[ArrayLike],
    b: Sequence[ArrayLike],
    *,
    animals: Labels | None = None,
    covariances: tuple[Sequence[ArrayLike | None], Sequence[ArrayLike | None]] | None = None,
    measured: tuple[Sequence[ArrayLike | None], Sequence[ArrayLike | None]] | None = None,
    kernel: Kernel | None = None,
    q: ArrayLike | None = None,
    level: float = 0.95,
    names: Sequence[str] | None = None,
    units: Sequence[str] | None = None,
    rng: np.random.Generator | None = None,
    alike: bool = False,
) -> tuple[Comparison, Judged, list[Judged]]:
    """A comparison, and the statistics of its place and of the variance of each coordinate in all splits."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must be a probability between 0 and 1, but is {level!r}")
    groups = [
        _trials(name, trials, covariances and covariances[i], measured and measured[i])
        for i, (name, trials) in enumerate((("a", a), ("b", b)))
    ]
    counts = (len(groups[0]), len(groups[1]))
    d = groups[0][0].mean.shape[1]
    if any(trial.mean.shape[1] != d for group in groups for trial in group):
        widths = sorted({t.mean.shape[1] for group in groups for t in group})
        raise ValueError(f"trials must have equal coordinates, but have {widths} of them")
    labels, measures = checked_labels(names, units, d)
    design = _units(counts, animals)
    _enough(design, level)
    trials, left_out = known_phases(groups[0], groups[1])
    samples, shares = zip(*(trial.weighted() for trial in trials), strict=True)
    z = np.concatenate(samples)
    kernel = usual_kernel(z) if kernel is None else kernel
    factor = pivoted_cholesky(kernel, z, tolerance=1e-6, max_rank=300)  # 1e-6 of |T|: below any p's rounding
    rows = np.split(factor.rows, np.cumsum([len(one) for one in samples])[:-1])
    operators = np.stack([(r.T @ (r * w[:, None])).reshape(-1) for r, w in zip(rows, shares, strict=True)])
    merged = design.merge @ operators
    weights, known = _weights(design, operators, trials, rows, shares)
    weights = np.ones(len(merged)) if alike else weights
    splits = design.splits(weights, known, np.random.default_rng(0) if rng is None else rng)
    place = judge(splits, _shrunk(design.contrasts(merged), design.paired), level)

    at = _places(z, factor.pivots) if q is None else points("q", q, d).reshape(-1, d)
    parts = [(kernel.gram(at, one) ** 2) @ w for one, w in zip(samples, shares, strict=True)]
    near = design.merge @ np.stack(parts)
    largest, sd = judged_everywhere(splits, design.contrasts(near))
    limit = float(np.quantile(largest, level, method="higher")) * place.wider * float(sd[0])

    own = [design.own(side, weights) for side in (True, False)]
    per_trial = [share @ design.merge for share in own]
    ranges = [_quantiles(samples, shares, share, RANGE) for share in per_trial]
    range_a, range_b = ranges
    shared = np.minimum(range_a[:, 1], range_b[:, 1]) - np.maximum(range_a[:, 0], range_b[:, 0])
    covered = np.maximum(range_a[:, 1], range_b[:, 1]) - np.minimum(range_a[:, 0], range_b[:, 0])
    first = design.merge @ np.stack([w @ one for one, w in zip(samples, shares, strict=True)])
    second = design.merge @ np.stack([w @ one**2 for one, w in zip(samples, shares, strict=True)])
    shift = np.array([shift_interval(splits, x, level) for x in design.contrasts(first).T])
    whole, pseudo, variance_of = _log_variances(samples, shares, first, second, design)
    change = [shift_interval(splits, x, level) for x in design.contrasts(pseudo).T]
    ratio = np.exp(
        [(whole[j], whole[j] + low - mid, whole[j] + high - mid) for j, (mid, low, high) in enumerate(change)]
    )
    spread = [judge(splits, np.outer(x, x), level) for x in design.contrasts(pseudo).T]
    found = Comparison(
        distance=float(np.linalg.norm((own[0] - own[1]) @ merged)),
        p_value=place.p_value,
        least_p=splits.least_p,
        splits=len(splits),
        unit=design.unit,
        counts=design.counts,
        trials=counts,
        level=level,
        names=labels,
        units=measures,
        range_a=range_a,
        range_b=range_b,
        overlap=np.divide(np.maximum(shared, 0.0), covered, out=np.ones(d), where=covered > 0),
        shift=shift[:, 0],
        shift_interval=shift[:, 1:],
        variance_ratio=ratio[:, 0],
        variance_of=variance_of,
        variance_ratio_interval=ratio[:, 1:],
        variance_p=np.array([one.p_value for one in spread]),
        p_of_all=place.p_value,
        variance_p_of_all=np.array([one.p_value for one in spread]),
        left_out=left_out,
        unseen=(_unseen(groups[0]), _unseen(groups[1])),
        q=at,
        time_a=own[0] @ near,
        time_b=own[1] @ near,
        band=np.full(len(at), limit),
    )
    return found, place, spread


PAIRED = "sides of animals"
FEWEST, FEWEST_PAIRS = 4, 6
"""Units a side: of fewer the spread is not known, and of 3 and 3 the least p is 0.1; 2 of 2^6 signs are 0.03."""


def _trials(
    name: str,
    trials: Sequence[ArrayLike],
    covariances: Sequence[ArrayLike | None] | None,
    measured: Sequence[ArrayLike | None] | None,
) -> list[Trial]:
    if isinstance(trials, np.ndarray) and trials.ndim < 3:
        raise ValueError(f"{name} must be trials, each (N, d) samples, but is one array of shape {trials.shape}")
    if not len(trials):
        raise ValueError(f"{name} has no trials")
    for what, given in (("covariances", covariances), ("measured", measured)):
        if given is not None and len(given) != len(trials):
            raise ValueError(f"{what} must be of the {len(trials)} trials of {name}, but are of {len(given)}")
    return [
        trial_of(
            trial,
            covariances=None if covariances is None else covariances[i],
            measured=None if measured is None else measured[i],
            where=f"{name}[{i}]",
        )
        for i, trial in enumerate(trials)
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Design:
    """How trials are units.

    Attributes:
        unit: What is permuted.
        merge: (u, n) means that merge trials to units; animals in both groups are two rows each, those in a first.
        in_a: (u,) whether a unit is in a.
    """

    unit: str
    merge: Array
    in_a: NDArray[np.bool_]

    @property
    def paired(self) -> bool:
        """Whether animals are in both groups."""
        return self.unit == PAIRED

    @property
    def counts(self) -> tuple[int, int]:
        """Units in a and b."""
        return int(self.in_a.sum()), int((~self.in_a).sum())

    def contrasts(self, values: Array) -> Array:
        """(u, ...) values as they are permuted: of animals in both groups their differences, a minus b."""
        return values[self.in_a] - values[~self.in_a] if self.paired else values

    def splits(self, weights: Array, alike: float, rng: np.random.Generator) -> Splits:
        """All splits, or random ones where they are many."""
        if not self.paired:
            return two_groups(self.in_a, weights, rng, alike=alike)
        return pairs(1.0 / (1.0 / weights[self.in_a] + 1.0 / weights[~self.in_a]), rng)

    def own(self, side: bool, weights: Array) -> Array:
        """(u,) share of each unit in the mean of its group."""
        if self.paired:
            weights = np.tile(1.0 / (1.0 / weights[self.in_a] + 1.0 / weights[~self.in_a]), 2)
        share = np.where(self.in_a == side, weights, 0.0)
        return share / share.sum()


def _units(counts: tuple[int, int], animals: Labels | None) -> _Design:
    if animals is None:
        keys, unit = [(i < counts[0], str(i)) for i in range(sum(counts))], "trials"
        order = keys
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
    return _Design(unit=unit, merge=merge / merge.sum(axis=1, keepdims=True), in_a=np.array([one[0] for one in order]))


def _enough(design: _Design, level: float) -> None:
    """Raises ValueError: too few units a side to know their spread, or too few splits for any p at most 1 - level."""
    n_a, n_b = design.counts
    fewest = FEWEST_PAIRS if design.paired else FEWEST
    total = 2**n_a if design.paired else comb(n_a + n_b, n_a)
    least = (2 if design.paired or n_a == n_b else 1) / total
    if min(n_a, n_b) >= fewest and least <= 1.0 - level:
        return
    why = f"above {1.0 - level:.2g}" if least > 1.0 - level else f"and the spread of fewer than {fewest} is not known"
    raise ValueError(
        f"{n_a} and {n_b} {design.unit} are too few to judge: the least p that their {total} splits allow is "
        f"{least:.2g}, {why}; record more (4 and 4 trials or animals, or 6 animals that are in both groups, are the "
        "fewest at 0.05)"
    )


def _weights(
    design: _Design, operators: Array, trials: Sequence[Trial], rows: Sequence[Array], shares: Sequence[Array]
) -> tuple[Array, float]:
    """(u,) what each unit counts: 1 / (variance between units + its own), by moments; how alike the groups are in it.

    A trial's own variance is c / N_i: a quarter of the squared distance of the operators of its halves, taken together
    over the trials of a group (whose frames last equally long). Trials of one animal tell theirs by how they differ.
    """
    in_a = (design.merge > 0).T @ design.in_a > 0
    length = np.array([float(len(one.mean)) for one in trials])
    halves = np.array([_halves(r, w) for r, w in zip(rows, shares, strict=True)])
    own = np.zeros(len(length))
    for side in (True, False):
        mine = in_a == side
        own[mine] = np.mean(halves[mine] * length[mine]) / length[mine]
    member = design.merge > 0
    several = member.sum(axis=1) > 1
    merged = design.merge @ operators
    if several.any():
        within = np.array([np.sum((operators[m] - x) ** 2) for m, x in zip(member, merged, strict=True)])
        between = float(within[several].sum() / (member.sum(axis=1)[several] - 1).sum())
        own = np.maximum(own, between)
    known = (design.merge**2) @ own
    spread = np.zeros(len(merged))
    for side in (True, False):
        mine = design.in_a == side
        spread[mine] = np.sum((merged[mine] - merged[mine].mean(axis=0)) ** 2) / max(mine.sum() - 1, 1)
    common = max(float(spread.mean() - known.mean()), 0.1 * float(spread.mean()))  # no unit is known without end
    weights = 1.0 / (common + known) if common > 0.0 else np.ones(len(merged))
    means = [float(weights[design.in_a == side].mean()) for side in (True, False)]
    for side, mean in zip((True, False), means, strict=True):
        weights[design.in_a == side] /= mean  # between groups they change no mean, and make splits unlike the observed
    return weights, min(means) / max(means)


def _unseen(trials: Sequence[Trial]) -> float:
    return float(np.mean(np.concatenate([~one.measured for one in trials])))


def _halves(rows: Array, share: Array) -> float:
    """A quarter of the squared distance of the operators of the halves of a trial."""
    middle = len(rows) // 2
    if middle == 0:
        return 1.0
    first, last = (
        r.T @ (r * (w / w.sum())[:, None])
        for r, w in ((rows[:middle], share[:middle]), (rows[middle:], share[middle:]))
    )
    return 0.25 * float(np.sum((first - last) ** 2))


def _shrunk(operators: Array, paired: bool) -> Array:
    """(u, u) inner products of the units' operators, each direction of their spread divided by 1 + s / s_1.

    No split changes the spread: of units about their mean; of animals in both groups that of the sides' differences,
    about 0.
    """
    u = len(operators)
    centring = np.eye(u) if paired else np.eye(u) - 1.0 / u
    s, vectors = np.linalg.eigh(centring @ (operators @ operators.T) @ centring)
    s = np.maximum(s, 0.0)
    return (vectors * (s / (1.0 + s / max(float(s[-1]), np.finfo(np.float64).tiny)))) @ vectors.T


def _quantiles(samples: Sequence[Array], shares: Sequence[Array], of_trials: Array, wanted: Sequence[float]) -> Array:
    """(d, k) quantiles of the time of trials, each with its share of it."""
    z = np.concatenate(samples)
    weight = np.concatenate([share * w for share, w in zip(of_trials, shares, strict=True)])
    out = []
    z, weight = z[weight > 0.0], weight[weight > 0.0]
    for x in z.T:
        order = np.argsort(x, kind="stable")
        below = np.cumsum(weight[order])
        before = below - weight[order]
        out.append(np.interp(wanted, before / max(before[-1], np.finfo(np.float64).tiny), x[order]))
    return np.array(out)


LONG = 0.1
"""Of its variance a trial's mean has less where the trial is long: then what is lost to its own mean can be given back.
Chosen."""


def _log_variances(
    samples: Sequence[Array], shares: Sequence[Array], first: Array, second: Array, design: _Design
) -> tuple[Array, Array, str]:
    """(d,) log ratio of the variances, b over a; (u, d) values of units whose means differ by it; and what it is of.

    Within long trials it is their variance, and a quarter of the squared difference of the means of their halves: what
    their own mean took. Short trials, whose halves are parts of one cycle, have it of all of them together: of n units
    with means m and mean squares s it is that of two of them drawn, mean s - (sum m)^2 without its squares, and the
    values are the jackknife's (Tukey 1958), n log V - (n - 1) log V without the unit.
    """
    own = np.stack([w @ (z - w @ z) ** 2 for z, w in zip(samples, shares, strict=True)])
    taken = np.zeros_like(own)
    for i, (z, w) in enumerate(zip(samples, shares, strict=True)):
        middle = len(z) // 2
        if middle > 0:
            taken[i] = (
                0.25 * (w[:middle] @ z[:middle] / w[:middle].sum() - w[middle:] @ z[middle:] / w[middle:].sum()) ** 2
            )
    in_a = (design.merge > 0).T @ design.in_a > 0
    tiny = np.finfo(np.float64).tiny
    short = max(
        float((taken[in_a == side].mean(axis=0) / np.maximum(own[in_a == side].mean(axis=0), tiny)).max())
        for side in (True, False)
    )
    if short < LONG:
        logs = np.log(np.maximum(design.merge @ (own + taken), tiny))
        a, b = (logs[design.in_a == side].mean(axis=0) for side in (True, False))
        return b - a, logs, "within trials"
    pseudo, whole = np.zeros_like(first), []
    for side in (True, False):
        mine = np.flatnonzero(design.in_a == side)
        m, s, n = first[mine], second[mine], len(mine)
        shifted = m - m.mean(axis=0)
        s = s - 2.0 * m * m.mean(axis=0) + m.mean(axis=0) ** 2  # about the mean of all: no cancellation

        def log_variance(keep: NDArray[np.bool_], m: Array = shifted, s: Array = s) -> Array:
            k = keep.sum()
            total = m[keep].sum(axis=0)
            variance = s[keep].mean(axis=0) - (total**2 - (m[keep] ** 2).sum(axis=0)) / (k * (k - 1))
            return np.log(np.maximum(variance, 1e-9 * np.maximum(s[keep].mean(axis=0), 1e-300)))

        every = log_variance(np.ones(n, dtype=bool))
        whole.append(every)
        for i in range(n):
            pseudo[mine[i]] = n * every - (n - 1) * log_variance(np.arange(n) != i)
    return whole[1] - whole[0], pseudo, "all trials together"


def _places(z: Array, pivots: NDArray[np.intp]) -> Array:
    """Points of the map: a grid over the samples in one or two coordinates, and the pivots in more."""
    if z.shape[1] > 2:
        return z[pivots]
    grid = grid_of(z, points=POINTS if z.shape[1] == 1 else 60)  # as the maps of mocap reproduce --quick
    return np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, z.shape[1])
