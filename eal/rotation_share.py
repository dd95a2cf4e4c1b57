"""Mobility of a joint: what share of all rotations it visits, the same in whatever axes they are measured.

A volume of joint angles depends on the axes chosen and on their order: ten-fold in a bird's hip (Manafzadeh & Gatesy
2020, J. Exp. Biol. 223). Haar's measure on SO(3) does not, nor does V_z of a kernel of the chord |R - R'|: turning
parent or child, mirroring the joint, or exchanging the two moves both alike.

What is visited is the level set V_z <= c, where c holds ``cover`` of the time of a trial that V_z was not learned from.
Each trial in turn is left out; with Tikhonov's filter all of that is blocks of one inverse.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from eal.arrays import Array, positive, read_only
from eal.kernels import LaplaceKernel

LAM = 1e-3
"""Of Tikhonov's filter. Chosen: from 1e-4 on known cones' volumes change by less than their intervals."""
MOST = 600
"""Samples that V_z is learned from, spread evenly over trials and time. Chosen: a minute of a hundred trials."""
POINTS = 4096
"""Quasi-random poses about the samples: they know a share to 2 %."""
HALVES = 20
"""Halves of the trials: they know a standard error to 16 %."""
FEWEST, FEWEST_TRIALS = 5, 4
"""Frames of a trial; trials, of which half must be left out and one of the rest."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mobility:
    """What share of all rotations, or of all rotations and translations within a ball, a joint visits.

    Attributes:
        share: Between 0 and 1, of Haar's measure; corrected for the number of trials.
        interval: (2,) by how halves of the trials differ.
        cover: Share of the time of a trial that the set holds.
        level: Of ``interval``.
        trials: Number of trials.
        within: Radius of the ball of translations; None: of rotations alone.
        hidden: Share of the frames that were not measured.
        share_measured: As ``share``, of measured frames alone; NaN where these are too few.
        rotations: (n, 3, 3) samples, from the child's axes to the parent's.
        visited: (m, 3, 3) poses of the set, as many in each part of it as it is large.
    """

    share: float
    interval: Array
    cover: float
    level: float
    trials: int
    within: float | None
    hidden: float
    share_measured: float
    rotations: Array
    visited: Array

    def __post_init__(self) -> None:
        """Copy and freeze the arrays."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value))

    def line(self) -> str:
        """What a person reads."""
        low, high = 100.0 * self.interval
        of = "all rotations" if self.within is None else f"all rotations and translations within {self.within:.3g}"
        hidden = ""
        if self.hidden:
            hidden = (
                f"; {100 * self.hidden:.0f} % of its frames were hidden, without them {100 * self.share_measured:.3g} %"
            )
        return (
            f"visits {100 * self.share:.3g} % of {of} ({low:.3g} to {high:.3g}; {self.trials} trials, of which each "
            f"spends {100 * self.cover:.0f} % of its time there{hidden})"
        )

    def plot(self, axes: Any = None) -> Any:
        """Spherical frame projection (Herbst et al. 2022, J. Anat.): where the child's axes point, in the parent's.

        Red, green and blue are the child's x, y and z; the left circle is the half of the sphere towards the parent's
        z, the right one the other half, in equal areas (Lambert). Dots are samples, shading is what is visited.

        Args:
            axes: Two matplotlib axes; None: new ones.

        Returns:
            The axes.
        """
        from matplotlib import pyplot

        if axes is None:
            axes = pyplot.subplots(1, 2, figsize=(7.2, 4.0), layout="constrained")[1]
        for ax, side in zip(axes, (1.0, -1.0), strict=True):
            turn = np.linspace(0.0, 2.0 * np.pi, 181)
            ax.plot(np.cos(turn), np.sin(turn), color="0.6", linewidth=0.8)
            for k, colour in enumerate(("#D55E00", "#009E73", "#0072B2")):
                for poses, style in (
                    (self.visited, {"markersize": 11.0, "alpha": 0.06}),
                    (self.rotations, {"markersize": 3.0, "alpha": 0.8}),
                ):
                    flat = hemisphere(poses[:, :, k], side)
                    ax.plot(*flat.T, ".", color=colour, markeredgewidth=0.0, **style)
            ax.set_title(f"parent's z {'towards' if side > 0 else 'away from'} the viewer", fontsize=9)
            ax.set(aspect="equal", xticks=[], yticks=[])
            ax.set_frame_on(False)
        axes[0].plot([], [], ".", color="#D55E00", label="child's x")
        axes[0].plot([], [], ".", color="#009E73", label="y")
        axes[0].plot([], [], ".", color="#0072B2", label="z")
        axes[0].legend(frameon=False, fontsize=8, loc="lower left")
        return axes


def hemisphere(directions: Array, side: float) -> Array:
    """(k, 2) Lambert's azimuthal equal-area projection of those unit vectors (n, 3) whose z has this sign."""
    mine = directions[directions[:, 2] * side >= 0.0]
    return mine[:, :2] / np.sqrt(1.0 + np.abs(mine[:, 2:]))


def mobility(
    trials: Sequence[ArrayLike],
    *,
    translations: Sequence[ArrayLike] | None = None,
    within: float | None = None,
    measured: Sequence[ArrayLike] | None = None,
    cover: float = 0.95,
    level: float = 0.95,
) -> Mobility:
    """What share of all rotations a joint visits, with an interval over trials.

    The kernel is exp(-d / s), d the chord and s the samples' standard deviation about their mean; with translations
    d^2 is the sum of both, each over its own. The measure is of the union of balls about the samples (Karp & Luby
    1983), at quasi-random points in axes that the samples themselves have: other axes give the same number.

    Args:
        trials: Of each (N_i, 3, 3) rotations from the child's axes to the parent's; NaN: not known.
        translations: Of each (N_i, 3) of the child in the parent.
        within: Radius of the ball about their mean that translations are a share of, in their unit.
        measured: Of each (N_i,) whether a frame was measured; frames that were not (as a smoother has them) count.
        cover: Share of the time of a trial that the set must hold.
        level: Of the interval.

    Returns:
        The mobility.

    Raises:
        ValueError: fewer than four trials, or fewer than five known poses in one; no rotations; translations without
            ``within`` or the reverse.
    """
    if (translations is None) != (within is None):
        raise ValueError("translations need `within`, the radius that they are a share of, and `within` needs them")
    poses = [_Poses.of(i, trials, translations, measured) for i in range(len(trials))]
    if len(poses) < FEWEST_TRIALS:
        raise ValueError(f"mobility needs {FEWEST_TRIALS} trials at least, but there are {len(poses)}: give more")
    for name, value in (("cover", cover), ("level", level)):
        if not 0.0 < value < 1.0:
            raise ValueError(f"{name} must be between 0 and 1, but is {value!r}")
    radius = None if within is None else positive("within", within)
    hidden = float(1.0 - np.mean(np.concatenate([one.measured for one in poses])))
    share, interval, visited = _measured(poses, radius, cover, level)
    alone = share
    if hidden > 0.0:
        seen = [one.some(one.measured) for one in poses if one.measured.sum() >= FEWEST]
        alone = _measured(seen, radius, cover, level)[0] if len(seen) >= FEWEST_TRIALS else np.nan
    return Mobility(
        share=share,
        interval=interval,
        cover=cover,
        level=level,
        trials=len(poses),
        within=within,
        hidden=hidden,
        share_measured=alone,
        rotations=np.concatenate([one.rotation for one in poses]),
        visited=visited,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Poses:
    """A trial: (N, 3, 3) rotations, (N, k) translations, k = 0 where there are none, and which were measured."""

    rotation: Array
    translation: Array
    measured: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        i: int,
        trials: Sequence[ArrayLike],
        translations: Sequence[ArrayLike] | None,
        measured: Sequence[ArrayLike] | None,
    ) -> "_Poses":
        rotation = np.asarray(trials[i], dtype=np.float64)
        if rotation.ndim != 3 or rotation.shape[1:] != (3, 3):
            raise ValueError(f"trials[{i}] must be rotations (N, 3, 3), but has shape {rotation.shape}")
        n = len(rotation)
        shift = np.zeros((n, 0)) if translations is None else np.asarray(translations[i], dtype=np.float64)
        seen = np.ones(n, dtype=bool) if measured is None else np.asarray(measured[i], dtype=bool)
        if len(shift) != n or seen.shape != (n,) or (translations is not None and shift.shape != (n, 3)):
            raise ValueError(f"trials[{i}] has {n} rotations, but translations {shift.shape}, measured {seen.shape}")
        known = np.isfinite(rotation).all(axis=(1, 2)) & np.isfinite(shift).all(axis=1)
        if known.sum() < FEWEST:
            raise ValueError(f"trials[{i}] has {known.sum()} known poses and needs {FEWEST}: leave the trial out")
        kept = rotation[known]
        off = np.abs(kept @ np.swapaxes(kept, 1, 2) - np.eye(3)).max()
        if off > 1e-6 or (np.linalg.det(kept) < 0.0).any():
            raise ValueError(f"trials[{i}] must be rotations, but R R^T differs from 1 by {off:.2g}, or det R is -1")
        return cls(rotation=kept, translation=shift[known], measured=seen[known])

    def some(self, rows: NDArray[Any]) -> "_Poses":
        return _Poses(rotation=self.rotation[rows], translation=self.translation[rows], measured=self.measured[rows])


def _measured(poses: Sequence[_Poses], radius: float | None, cover: float, level: float) -> tuple[float, Array, Array]:
    """Share, its interval, and poses of the set.

    With t(T) the logarithm of the share from T trials, 2 t(T) - mean t(T / 2) is without what falls as 1 / T (half of
    the trials make the set too large by twice as much), and the spread of t(T / 2) over halves is the standard error
    of t(T) (McCarthy 1969).
    """
    each = max(MOST // len(poses), FEWEST)
    few = [one.some(np.linspace(0, len(one.measured) - 1, min(len(one.measured), each)).astype(int)) for one in poses]
    frame = _Frame.of(few)
    owner = np.repeat(np.arange(len(few)), [len(one.measured) for one in few])
    z, n = frame.features(frame.vectors, frame.shifts), len(few)
    parts = _fields(z, owner, cover)
    step = 1.0  # in standard deviations: first of all of them, then as far as the set reaches
    vectors, shifts, shares = frame.about(step, radius)
    at = frame.features(vectors, shifts)
    first = parts[0].holds(at)
    if first.any():
        reached = float(np.sqrt(np.maximum(_distance2(at[first], z), 0.0).min(axis=1).max()))
        vectors, shifts, shares = frame.about(float(np.clip(1.5 * reached, 1e-6, 1.0)), radius)
        at = frame.features(vectors, shifts)
    inside = [one.holds(at) for one in parts]
    logs = np.log(np.maximum([float(shares[one].sum()) for one in inside], 1e-300))
    correction = logs[0] - logs[1:].mean()
    middle, error = (
        logs[0] + correction,
        np.hypot(logs[1:].std(), correction / 3.0),
    )  # a third of it is not known: chosen
    half = float(stdtrit(n - 1, 0.5 + 0.5 * level)) * error
    share, ends = np.exp(middle), np.exp(middle + half * np.array([-1.0, 1.0]))
    rows = np.flatnonzero(inside[0])
    kept = np.random.default_rng(0).random(len(rows)) * shares[rows].max(initial=0.0) < shares[rows]
    return float(min(share, 1.0)), np.minimum(ends, 1.0), frame.back(vectors[rows[kept]])


def _fields(z: Array, owner: NDArray[np.intp], cover: float) -> "list[_Field]":
    """Of all trials, and of halves of them."""
    found, rng, n = [_Field.of(z, owner, cover)], np.random.default_rng(0), int(owner.max()) + 1
    for _ in range(HALVES // 2):
        order = rng.permutation(n)
        for half in (order[: n // 2], order[n // 2 :]):
            rows = np.isin(owner, half)
            found.append(_Field.of(z[rows], owner[rows], cover))
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _Frame:
    """Poses about their mean in their own principal axes, in which they are the same whatever axes they came in.

    Attributes:
        mean: (3, 3) mean rotation.
        axes: (3, 3) principal axes of the rotation vectors about it; their third moments are positive.
        vectors: (n, 3) rotation vectors along them.
        shifts: (n, k) translations about their mean along their own principal axes.
        size: Standard deviations of rotations (by the chord) and of translations.
    """

    mean: Array
    axes: Array
    vectors: Array
    shifts: Array
    size: tuple[float, float]

    @classmethod
    def of(cls, poses: Sequence[_Poses]) -> "_Frame":
        rotation = np.concatenate([one.rotation for one in poses])
        left, _, right = np.linalg.svd(rotation.mean(axis=0))
        mean = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        turned = _vectors(mean.T @ rotation)
        axes = _principal(turned)
        shifts = np.concatenate([one.translation for one in poses])
        shifts = shifts - shifts.mean(axis=0)
        if shifts.shape[1]:
            shifts = shifts @ _principal(shifts)
        chords = rotation.reshape(len(rotation), 9) / np.sqrt(2.0)
        sizes = [float(np.sqrt(x.var(axis=0).sum())) for x in (chords, shifts)]
        return cls(
            mean=mean,
            axes=axes,
            vectors=turned @ axes,
            shifts=shifts,
            size=(max(sizes[0], 1e-9), max(sizes[1], 1e-12)),
        )

    def features(self, vectors: Array, shifts: Array) -> Array:
        """(n, D) in which the kernel is one of distance: chords and translations, each over its size."""
        turned = _matrices(vectors).reshape(len(vectors), 9) / (np.sqrt(2.0) * self.size[0])
        return np.concatenate([turned, shifts / self.size[1]], axis=1)

    def back(self, vectors: Array) -> Array:
        """(n, 3, 3) rotations in the axes that they came in."""
        return self.mean @ _matrices(vectors @ self.axes.T)

    def about(self, step: float, radius: float | None) -> tuple[Array, Array, Array]:
        """Poses in balls of ``step`` sizes about the samples, and what share of all poses each of them stands for."""
        angle = 2.0 * np.arcsin(min(0.5 * step * self.size[0], 1.0))
        uniform = _halton(POINTS, 6)
        turns = np.linspace(0.0, angle, 4001)
        inside = turns - np.sin(turns)
        turn = np.interp(uniform[:, 0] * inside[-1], inside, turns)
        near = _matrices(turn[:, None] * _directions(uniform[:, 1], uniform[:, 2]))
        of = np.arange(POINTS) % len(self.vectors)
        own = _matrices(self.vectors)
        rotation = own[of] @ near
        chords = rotation.reshape(-1, 9) / np.sqrt(2.0), own.reshape(-1, 9) / np.sqrt(2.0)
        covered = _distance2(*chords) <= (2.0 * np.sin(0.5 * angle)) ** 2 * (1.0 + 1e-9)
        volume, shifts, outside = inside[-1] / np.pi, np.zeros((POINTS, 0)), np.zeros(POINTS, dtype=bool)
        if radius is not None:
            length = step * self.size[1]
            away = np.cbrt(uniform[:, 3:4]) * _directions(uniform[:, 4], uniform[:, 5])
            shifts = self.shifts[of] + length * away
            covered &= _distance2(shifts, self.shifts) <= length**2 * (1.0 + 1e-9)
            volume *= (length / radius) ** 3
            outside = (shifts**2).sum(axis=1) > radius**2
        shares = volume / covered.mean(axis=1) / POINTS
        return _vectors(rotation), shifts, np.where(outside, 0.0, shares)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Field:
    """V_z of some trials, by Tikhonov's filter: 1 - k (K + N lambda)^-1 k, and the level c of what is visited.

    Attributes:
        z: (N, D) features.
        inverse: (N, N) of K + N lambda.
        limit: c.
    """

    z: Array
    inverse: Array
    limit: float

    @classmethod
    def of(cls, z: Array, owner: NDArray[np.intp], cover: float) -> "_Field":
        n = len(z)
        inverse = np.linalg.inv(LaplaceKernel(1.0).gram(z, z) + n * LAM * np.eye(n))
        left_out = []  # V at the samples of a trial of what was learned from the others
        for trial in np.unique(owner):
            mine = np.flatnonzero(owner == trial)
            left_out.append(np.diagonal(np.linalg.inv(inverse[np.ix_(mine, mine)])) - n * LAM)
        return cls(z=z, inverse=inverse, limit=_quantile(left_out, cover))

    def values(self, at: Array) -> Array:
        """(m,) V_z."""
        gram = LaplaceKernel(1.0).gram(at, self.z)
        return 1.0 - np.einsum("mi,mi->m", gram @ self.inverse, gram)

    def holds(self, at: Array) -> NDArray[np.bool_]:
        """(m,) whether poses are visited."""
        return self.values(at) <= self.limit


def _quantile(parts: Sequence[Array], cover: float) -> float:
    """Of values, each trial as much as the others."""
    values = np.concatenate(parts)
    weight = np.concatenate([np.full(len(part), 1.0 / len(part)) for part in parts])
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, cover * below[-1] * (1.0 - 1e-12))])


def _principal(vectors: Array) -> Array:
    """(3, 3) principal axes as columns, of vectors about 0, with signs that make third moments positive."""
    axes = np.linalg.eigh(vectors.T @ vectors)[1][:, ::-1]
    return axes * np.where(((vectors @ axes) ** 3).sum(axis=0) < 0.0, -1.0, 1.0)


def _matrices(vectors: Array) -> Array:
    if not len(vectors):  # which SciPy 1.15 refuses
        return np.zeros((0, 3, 3))
    return Rotation.from_rotvec(vectors).as_matrix()


def _vectors(matrices: Array) -> Array:
    return Rotation.from_matrix(matrices).as_rotvec()


def _distance2(x: Array, y: Array) -> Array:
    return (x**2).sum(axis=1)[:, None] + (y**2).sum(axis=1)[None, :] - 2.0 * x @ y.T


def _directions(height: Array, turn: Array) -> Array:
    """(n, 3) unit vectors, uniform where their arguments in [0, 1] are."""
    z = 2.0 * height - 1.0
    across, around = np.sqrt(np.maximum(1.0 - z * z, 0.0)), 2.0 * np.pi * turn
    return np.stack([across * np.cos(around), across * np.sin(around), z], axis=1)


def _halton(n: int, d: int) -> Array:
    """(n, d) points of Halton's sequence, without its first, 0."""
    found = np.zeros((n, d))
    for j, base in enumerate((2, 3, 5, 7, 11, 13)[:d]):
        left, share = np.arange(1, n + 1), 1.0 / base
        while left.any():
            found[:, j] += share * (left % base)
            left, share = left // base, share / base
    return found
