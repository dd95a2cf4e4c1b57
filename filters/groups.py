"""Many markers in groups: a pose model's filter at a cost that is linear in the number of markers.

The state of ``PoseMotion`` is what all markers share (shape and body, a few dozen numbers) and a residual of each
marker. The residuals are independent of each other given the whole path of what is shared, but not given its present
value alone: an exact filter of M markers has a dense covariance of size 9M, and costs its cube. Here the markers are
split into groups that each estimate what is shared from their own markers, all with one subspace, mechanics, body path
and regression, which are learned from all markers. A group of 30 markers knows the shape less well than all: hidden
positions differ by 0.2 to 0.6 standard deviations, and are as near to the truth (docs/experiments/many_markers.md).
Covariances between markers of different groups are taken for zero.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mocap.filters.limb_potential import OF_TIMES, HeldPotential, limb_values
from mocap.filters.motion.pose import PoseMotion, Regression
from mocap.filters.motion.potential import Bones, PosePotential
from mocap.filters.moving import Rates
from mocap.filters.observations import Observations, some_markers
from mocap.filters.observe import Observed
from mocap.filters.records import Estimate
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray

from eal.arrays import Array
from eal.efforts import Progress, shares

MOST_MARKERS = 45
"""Models of more markers than this are filtered in groups. The cost of one filter is the cube of their number: of 45 it
is that of 60 in groups (docs/experiments/many_markers.md)."""
GROUP = 30
"""About the most markers of a group. Gaps of 60 markers are filled in two groups as well as by one filter, in three by
up to 8 % worse (docs/experiments/many_markers.md)."""

Smooth = Callable[..., Estimate]
Markers = NDArray[np.int64]
Own = Mapping[str, NDArray[Any]]


def groups_of(model: PoseMotion, size: int | None = None) -> list[Markers]:
    """Markers in groups of about equal size: those of a limb together, and those of bones where there is room.

    A group that has but a part of a limb has no potential of it (``part_of``), and gaps of 25 frames are then filled by
    10 % worse: limbs are whole as long as they, or several that share markers, fill no more than a group.
    """
    count = len(model.subspace.mean) // 3
    wanted = -(-count // (size or GROUP))
    most = -(-count // wanted)
    units = [(limb, max(most, min(len(limb), MOST_MARKERS))) for limb in _limbs(model)]
    units += [] if model.bones is None else [(ends, most // 2) for ends in model.bones.ends.tolist()]
    of = np.arange(count)
    for unit, room in units:
        joined = np.isin(of, of[unit])
        if joined.sum() <= room:
            of[joined] = of[unit[0]]
    parts = sorted((np.flatnonzero(of == k) for k in np.unique(of)), key=len, reverse=True)
    groups: list[list[int]] = [[] for _ in range(wanted)]
    for part in parts:  # each to the smallest group: every group has markers all over the body
        min(groups, key=len).extend(part.tolist())
    return [np.array(sorted(group)) for group in groups]


def _limbs(model: PoseMotion) -> list[list[int]]:
    """Markers that each potential reads by themselves."""
    return [
        np.flatnonzero(np.abs(limb.on_residual).reshape(len(limb.mean), -1, 3).sum(axis=(0, 2))).tolist()
        for limb in model.potentials
        if np.abs(limb.on_residual).any()
    ]


def part_of(model: PoseMotion, markers: Markers) -> PoseMotion:
    """The model of some of its markers; bones and limbs that are not whole among them are left out."""
    rows = (3 * markers[:, None] + np.arange(3)).ravel()
    new = np.full(len(model.subspace.mean) // 3, -1)
    new[markers] = np.arange(len(markers))
    subspace, bones, regression = model.subspace, model.bones, model.regression
    if bones is not None:
        kept = (new[bones.ends] >= 0).all(axis=1)
        bones = Bones(ends=new[bones.ends[kept]], length_m=bones.length_m[kept], sd_m=bones.sd_m[kept])
    if regression is not None:
        regression = Regression(regression.xyz_m[:, markers], regression.cov_m2[:, markers])
    outside = np.setdiff1d(np.arange(len(subspace.mean)), rows)
    potentials: list[PosePotential] = [
        replace(
            limb,
            on_residual=limb.on_residual[:, rows],
            root=int(new[limb.root]) if limb.children else limb.root,
            children=tuple(new[list(limb.children)].tolist()),
        )
        for limb in model.potentials
        if not limb.on_residual[:, outside].any()
    ]
    return replace(
        model,
        residual_rate_hz=model.residual_rate_hz[rows],
        subspace=replace(
            subspace,
            mean=subspace.mean[rows],
            basis=subspace.basis[rows],
            residual_sd=subspace.residual_sd[rows],
        ),
        bones=bones if bones is not None and len(bones.ends) else None,
        regression=regression,
        potentials=tuple(potentials),
    )


def smooth_in_groups(
    model: PoseMotion,
    observations: Observations,
    t_s: Array,
    *,
    groups: Sequence[Markers],
    smooth: Smooth,
    rate_points: RatePoints | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Smooth each group by itself; arguments and result as in ``mocap.filters.track.smooth``, which is ``smooth``."""
    count = len(model.subspace.mean) // 3
    xyz, cov = np.empty((len(t_s), count, 3)), np.empty((len(t_s), count, 3, 3))
    observed: list[list[Observed]] = []
    own: list[tuple[Markers, Own]] = []
    rates = None if rate_points is None else _Together(rate_points, count, len(t_s))
    for markers, tell in zip(groups, shares(progress, [1.0] * len(groups)), strict=True):
        local = None if rate_points is None or rates is None else rates.local(markers)
        part, seen = part_of(model, markers), some_markers(observations, markers)
        found = smooth(part, seen, t_s, rate_points=local, progress=tell)
        xyz[:, markers], cov[:, markers] = found.xyz_m, found.cov_m2
        observed.append(
            [replace(o, where=np.column_stack([o.where[:, 0], markers[o.where[:, 1]]])) for o in found.observed]
        )
        own.append((markers, found.own))
        if rates is not None and found.rates is not None:
            rates.add(markers, found.rates)
    return Estimate(
        xyz_m=xyz,
        cov_m2=cov,
        observed=[_together(frame) for frame in zip(*observed, strict=True)],
        rates=None if rates is None else rates.rates(),
        own=_limbs_together(own, count),
    )


def _limbs_together(parts: Sequence[tuple[Markers, Own]], count: int) -> Own:
    """What groups say of the limbs that they hold (``filters.limb_potential``), with the places of all markers."""
    limbs: dict[str, HeldPotential] = {}
    for markers, own in parts:
        for i, name in enumerate(own.get("limb", np.zeros(0)).tolist()):
            keys = {key.removeprefix("limb_"): key for key in own if key != "limb"}
            one = {key: np.take(own[of], i, axis=int(key in OF_TIMES)) for key, of in keys.items()}
            place, pull = np.full(count, -1), np.full((len(one["pull"]), count, 3), np.nan)
            place[markers], pull[:, markers] = one["marker"], one["pull"]
            limbs[name] = {**one, "marker": place, "pull": pull}
    return {"limb": np.array(list(limbs)), **limb_values(limbs)} if limbs else {}


def _together(parts: Sequence[Observed]) -> Observed:
    """What all groups saw in a frame."""
    nis = np.array([seen.nis for seen in parts])
    return Observed(
        np.concatenate([seen.where for seen in parts]),
        np.concatenate([seen.innovation for seen in parts]),
        np.concatenate([seen.weight for seen in parts]),
        float(np.nansum(nis)) if np.isfinite(nis).any() else np.nan,
        sum(seen.n_rows for seen in parts),
        float(sum(seen.log_likelihood for seen in parts)),
    )


class _Together:
    """Velocities and joint covariances of all groups: means of markers add up over independent groups."""

    def __init__(self, rate_points: RatePoints, count: int, n_frames: int) -> None:
        points = count + len(rate_points.weights)
        self.rate_points, self.count = rate_points, count
        self._velocity = np.zeros((n_frames, points, 3))
        self._own = np.zeros((n_frames, points, 6, 6), dtype=np.float32)
        self._cross = np.zeros((n_frames, len(rate_points.pairs), 6, 6), dtype=np.float32)
        self._kept = np.zeros((n_frames, points, 3))

    def _points(self, markers: Markers) -> list[int]:
        return [*markers.tolist(), *range(self.count, self.count + len(self.rate_points.weights))]

    def _inside(self, markers: Markers) -> list[int]:
        here = set(self._points(markers))
        return [i for i, (a, b) in enumerate(self.rate_points.pairs) if a in here and b in here]

    def local(self, markers: Markers) -> RatePoints:
        """What is asked of a group; of a mean its own markers' share."""
        points = self._points(markers)
        place = {point: i for i, point in enumerate(points)}
        pairs = [self.rate_points.pairs[i] for i in self._inside(markers)]
        return RatePoints(
            names=tuple(self.rate_points.names[point] for point in points),
            weights=tuple(tuple(row[m] for m in markers.tolist()) for row in self.rate_points.weights),
            pairs=tuple((place[a], place[b]) for a, b in pairs),
        )

    def add(self, markers: Markers, found: Rates) -> None:
        """A group's."""
        points = self._points(markers)
        self._velocity[:, points] += found.velocity_m_s
        self._own[:, points] += found.own
        self._kept[:, points] += found.kept * np.einsum("tnii->tni", found.own)[..., 3:]
        self._cross[:, self._inside(markers)] += found.cross

    def rates(self) -> Rates:
        """Of all."""
        spread = np.einsum("tnii->tni", self._own)[..., 3:]
        kept = np.clip(self._kept / np.maximum(spread, 1e-30), 0.0, 2.0)
        return Rates(
            rate_points=self.rate_points, velocity_m_s=self._velocity, own=self._own, cross=self._cross, kept=kept
        )
