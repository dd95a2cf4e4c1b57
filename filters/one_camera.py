"""A recording of one camera: the most probable poses under a learned prior, what shapes leave, and intervals."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from mocap.filters.errors import FilterError
from mocap.filters.first_poses import Starts, between, first_poses, settled, starts_of
from mocap.filters.misfit import Matern, Misfit, misfit
from mocap.filters.moving import Rates
from mocap.filters.observations import WHOLE
from mocap.filters.observe import Observed
from mocap.filters.one_view import Poses, Recorded, Views, counted_once
from mocap.filters.pose_prior import LEAST_MARKERS, PosePrior, learn_prior, running
from mocap.filters.poses import MarkerTrial, poses_of
from mocap.filters.rays_and_bones import held_by_bones
from mocap.filters.records import Estimate
from mocap.filters.subspace import bridge
from mocap.filters.trajectory import SETTLED, Quadratic, covariance, factor, most_probable
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import isotonic_regression
from scipy.spatial.transform import Rotation
from scipy.special import expit

from eal.arrays import Array

ROUGHLY = 1.0
"""Trials that are left out are tracked until nothing moves by so many deviations: numbers by under 1 % of theirs.
Measured on flights of a bat (docs/experiments/one_camera_intervals.md)."""

ALARMS = 0.01
"""Share of the frames of a trial like those that were learned from whose poses are called unlike them. Chosen; not
measured."""

LARGEST = 1 / np.sqrt(3)
"""Share of what poses spread by that a coordinate may be off beyond what trials tell: with more, markers are off their
poses by as much as poses differ, and all frames stay empty. Chosen."""

REACHES = 0.3
"""Least share of the squared distance to the mirror image that variances get, so that 95 % intervals reach it: 1.96
times the root of 0.3 is 1.07. Above it the share is the probability, which makes the variance the mean square."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What was made of a recording of one camera.

    Attributes:
        estimate: Markers, velocities, what was observed.
        joint: (T, 3M, 3M) covariance of all markers of a frame together.
        poses: The most probable trajectory.
        costs: What it cost after each step of the last search.
        other: Probability of the mirror image.
        unlike: (T,) frames whose seen markers fit worse than where deviations are right (``Views.fair``) and than
            ``LeftOut.most``; all, where the misfit exceeds ``LARGEST``.
        wider: (T,) what deviations were multiplied by, as ``LeftOut.wider`` says.
        residual_px: (T, M) what is left of the rays.
        loose: Whether bones did not lead to an end, and poses are those of rays alone.
        left_out: How trials fared that were left out.
        misfit: What was missed beyond what trials tell.
    """

    estimate: Estimate
    joint: Array
    poses: Poses
    costs: tuple[float, ...]
    other: float
    unlike: NDArray[np.bool_]
    wider: Array
    residual_px: Array
    loose: bool
    left_out: "LeftOut"
    misfit: Misfit


@dataclass(frozen=True, eq=False, kw_only=True)
class LeftOut:
    """How trials fared that were left out.

    Attributes:
        most: What ``strange`` exceeds in ``ALARMS`` of their frames, where the others lack no phases; infinite: none
            tells.
        strange: (G,) what it is, increasing.
        wider: (G,) what variances there must be multiplied by, at least 1; it never falls.
        error_m: RMS error in such a view relative to the mean of the markers, where the others lack no phases; NaN:
            none tells.
        spread_m: The same of the mean body in place of what was found: what a view that tells nothing would leave.
    """

    most: float
    strange: Array
    wider: Array
    error_m: float = np.nan
    spread_m: float = np.nan

    def limit(self, views: Views) -> float:
        """``strange`` of frames that are unlike those of the trials."""
        return max(self.most, views.fair) if np.isfinite(self.most) else views.fair


UNDOUBTED = LeftOut(most=np.inf, strange=np.zeros(1), wider=np.ones(1))
"""Of no trials."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Left:
    """What shapes leave of one marker, (T, 3) in the world: a Matern-3/2 process seen by rays (``trajectory.Problem``).

    Attributes:
        views: Rays of the marker.
        xyz_m: (T, 1, 3) where its pose has it.
        sd_m: Its deviation.
        decay: What it keeps from frame to frame (``PosePrior``).
    """

    views: Views
    xyz_m: Array
    sd_m: float
    decay: float

    @cached_property
    def _root(self) -> sparse.csr_array:
        """(T, T) rows whose squares are twice the cost: each frame given the two before it, in its deviations."""
        rho, steps, process = self.decay, len(self.xyz_m), Matern(rho=self.decay)
        c = process.correlations[1]
        share = np.full(steps, process.noise)
        share[:2] = np.array([1, 1 - c**2])[:steps]
        columns = np.tile([[1.0], [-2 * rho], [rho**2]], steps)
        columns[1, 0] = -c
        given = sparse.dia_array((columns, [0, -1, -2]), shape=(steps, steps))
        return sparse.csr_array(sparse.diags_array(1 / (self.sd_m * np.sqrt(share))) @ given)

    def cost(self, e: Array) -> float:
        """See ``trajectory.Problem``."""
        return float(0.5 * np.sum((self._root @ e) ** 2) + self.views.cost(self.xyz_m + e[:, None]).sum())

    def quadratic(self, e: Array) -> Quadratic:
        """See ``trajectory.Problem``."""
        pulled, stiff = self.views.pulled(self.xyz_m + e[:, None])
        square = self._root.T @ self._root
        own, after, later = (square.diagonal(-lag)[:, None, None] * np.eye(3) for lag in range(3))
        return Quadratic(
            gradient=pulled[:, 0] + self._root.T @ (self._root @ e), band=(own + stiff[:, 0], after, later)
        )

    def moved(self, e: Array, step: Array) -> Array:
        """See ``trajectory.Problem``."""
        return e + step


def jitter_px(uv_px: Array) -> float:
    """Deviation of a pixel coordinate from frame to frame, of (C, T, M, 2) tracks; NaN where these are too short.

    By the median third difference, whose variance is 20 times that of white noise and which smooth motion has not.
    """
    change = np.abs(np.diff(uv_px, n=3, axis=1))
    finite = change[np.isfinite(change)]
    return float(np.median(finite) / 0.6745 / np.sqrt(20)) if len(finite) else np.nan


def shown(seen: NDArray[np.bool_]) -> slice:
    """From the first to the last frame in which a camera sees enough markers, of (C, T, M); none: an empty slice.

    Before and after these nothing holds a pose: of what was made of 50 such frames 67 % lay in intervals of 95 %.
    """
    frames = np.flatnonzero((seen.sum(axis=2) >= LEAST_MARKERS).any(axis=0))
    return slice(int(frames[0]), int(frames[-1]) + 1) if len(frames) else slice(0, 0)


def track_views(
    prior: PosePrior,
    views: Views,
    *,
    doubt: Callable[[PosePrior, float, Misfit, Array], LeftOut] = lambda _prior, _noise_m, _beyond, _axes: UNDOUBTED,
    rate_points: RatePoints | None = None,
    progress: Callable[[float], None] | None = None,
) -> Found:
    """Track a recording of one camera, or of several of which one sees most.

    Args:
        prior: What trials tell.
        views: What was seen; deviations are those of the pixels alone.
        doubt: How trials fared that were left out (``left_out``), by what trials and the recording's misfit tell, the
            noise of rays from frame to frame in metres where the animal is, the misfit, and the axes of the mean body
            to the camera's.
        rate_points: Points and pairs whose velocities and joint covariances are kept; None: of none.
        progress: Called with the share done.

    Raises:
        FilterError: no frame shows enough markers.
    """
    tell = progress or (lambda _share: None)
    starts = starts_of(prior, views, every=every_so_many(prior))
    scale = views.px_per_m(starts.position_m)[:, None, None]
    views = replace(views, sd_px=np.maximum(views.sd_px, scale * prior.noise_m))
    recorded, ends = _searched(prior, views, scale, starts)
    tell(0.4)
    beyond = misfit(prior, views, scale, recorded, ends[0].poses)
    if beyond.found:
        recorded, ends, beyond = _with_misfit(prior, views, scale, starts, recorded, ends, beyond)
        prior, views = beyond.told(prior, views, scale)
    else:
        beyond = Misfit()
    tell(0.6)
    (best, costs), (second, more) = ends[0], ends[-1]
    apart = (recorded.markers(second) - recorded.markers(best)).reshape(len(best.z), -1)
    same = np.sqrt(np.mean(apart**2)) < 0.01 * np.sqrt(np.mean(prior.mean**2))  # of the animal: one end
    other = 0.0 if same else float(expit((costs[-1] - more[-1]) / prior.lasts))
    tell(0.8)
    problem, loose = recorded, False
    try:
        problem, best, costs = held_by_bones(recorded, views, best)
    except FilterError:  # shapes that bones contradict, which was seen of animals unlike their trials
        loose = True
    xyz, lags = marked(problem, recorded, views, best)
    noise_m = float(np.median((views.sd_px / scale)[views.seen])) * np.sqrt(1 - views.lasting)
    doubted = doubt(prior, noise_m, beyond, _axes(views, best))
    unlike = bridge(strange(recorded, best)[:, None])[:, 0]  # where too little is seen as in the frames around
    wider = np.sqrt(np.interp(unlike, doubted.strange, doubted.wider))
    for lag, part in enumerate(lags):
        part *= (wider[lag:] * wider[: len(xyz) - lag])[:, None, None]
        if other > 0.05:
            part += max(other, REACHES) * apart[lag:, :, None] * apart[: len(xyz) - lag, None]
    blocks = lags[0].reshape(len(xyz), prior.markers, 3, prior.markers, 3)
    estimate = Estimate(
        xyz_m=xyz,
        cov_m2=np.einsum("tmiml->tmil", blocks).copy(),
        observed=_observed(recorded, views, recorded.markers(best), xyz),
        rates=None if rate_points is None else _rates(rate_points, xyz, lags, prior.dt_s),
    )
    return Found(
        estimate=estimate,
        joint=lags[0],
        poses=best,
        costs=tuple(costs),
        other=other,
        unlike=(unlike > doubted.limit(recorded.views)) | (beyond.sd_m > LARGEST * prior.spread_m),
        wider=wider,
        loose=loose,
        residual_px=(np.linalg.norm(views.missed(xyz), axis=-1) * views.sd_px).max(axis=0),
        left_out=doubted,
        misfit=beyond,
    )


class End(NamedTuple):
    """Where a search ended.

    Attributes:
        poses: The most probable trajectory near its start.
        costs: What it cost after each step.
    """

    poses: Poses
    costs: tuple[float, ...]


def _searched(prior: PosePrior, views: Views, scale: Array, starts: Starts) -> tuple[Recorded, list[End]]:
    """What was minimised by rays alone, and where searches ended, the likeliest first.

    What shapes leave is noise of the rays here. It does not change with what is estimated: an animal that is thought to
    be nearer would err by less, and what is most probable would be too near (by 5 to 10 % of the depth).
    """
    recorded = Recorded(prior=prior, views=replace(views, sd_px=np.hypot(views.sd_px, scale * prior.left_sd[::3])))
    ends = []
    for start in first_poses(recorded, starts):
        costs: list[float] = []
        with suppress(FilterError):  # a mirror image that leads nowhere is not the other pose
            ends.append(End(most_probable(recorded, start, tell=costs.append), tuple(costs)))
    if not ends:
        raise FilterError("poses could not be found from this camera: no search came to an end")
    return recorded, sorted(ends, key=lambda end: end.costs[-1])


def _with_misfit(
    prior: PosePrior,
    views: Views,
    scale: Array,
    starts: Starts,
    recorded: Recorded,
    ends: list[End],
    beyond: Misfit,
) -> tuple[Recorded, list[End], Misfit]:
    """Searches under the misfit that they themselves make likeliest, found by turns (EM)."""
    for _ in range(5):  # it grows by under 5 % from the third on in simulated walks
        recorded, ends = _searched(*beyond.told(prior, views, scale), scale, starts)
        before, beyond = beyond, replace(misfit(prior, views, scale, recorded, ends[0].poses), posed=beyond.posed)
        if abs(beyond.sd_m - before.sd_m) < 0.05 * before.sd_m:
            break
    return recorded, ends, before


def marked(
    problem: Recorded, recorded: Recorded, pixels: Views, at: Poses, *, within: float = SETTLED
) -> tuple[Array, list[Array]]:
    """(T, M, 3) markers in the world, and their covariances (``counted_once``), with what shapes leave.

    Args:
        problem: What was minimised.
        recorded: What was seen; deviations contain what shapes leave.
        pixels: The same; deviations are those of the pixels alone.
        at: The most probable poses.
        within: See ``most_probable``.
    """
    xyz, lags = recorded.markers(at), counted_once(problem, at)
    for m in range(xyz.shape[1]):
        _add_left(recorded.prior, pixels, xyz, lags, m, within)
    return xyz, lags


def _axes(views: Views, at: Poses) -> Array:
    """(3, 3) from the mean body to the camera that sees most."""
    matrix = views.matrices[views.main]
    matrix = matrix * np.sign(np.median(at.position_m @ matrix[2, :3] + matrix[2, 3]))
    axes = np.linalg.qr(matrix[::-1, :3].T)[0].T[::-1]
    axes = axes * np.sign(np.sum(axes * matrix[:, :3], axis=1))[:, None]
    return axes @ Rotation.from_matrix(at.rotation).mean().as_matrix()


def every_so_many(prior: PosePrior) -> int:
    """Frames from one start to the next."""
    return max(1, round(prior.turn_s / prior.dt_s / 3))  # three while the motion turns by a radian


def strange(recorded: Recorded, at: Poses) -> Array:
    """(T,) how badly seen markers fit poses; NaN where too few are seen.

    Minus log of Student's t, as rays are believed by, a ray, in the time in which what shapes leave errs alike. A phase
    that trials lack is drawn to the nearest that they have, and misses what was seen: poses are invented there.
    """
    count = recorded.views.seen.sum(axis=(0, 2))
    count = np.where(count >= LEAST_MARKERS, count, 0)
    cost = recorded.views.misfit(recorded.markers(at))
    return running(np.where(count > 0, cost, 0.0), count, recorded.prior.lasts)


def left_out(
    prior: PosePrior,
    noise_m: float,
    beyond: Misfit,
    axes: Array,
    *,
    trials: Sequence[MarkerTrial],
    trunk: Sequence[int],
) -> LeftOut:
    """How far poses of trials that were not learned from are off, by how badly what was seen of them fits.

    Each trial (of a single one each half) is tracked as the camera sees it, with the shapes that the others tell; and
    again with those that half of their frames tell, above or below the median of the first shape, as trials may lack
    phases that a recording has. Halves of a single trial lack each other's, and tell no limit. Misses are counted in
    the same deviations as those of the recording: fewer trials state others, and shapes follow what they leave, which
    is smooth, but not the noise of rays.

    Args:
        prior: What all trials tell, and the misfit of the recording.
        noise_m: Deviation of the noise of rays from frame to frame, where the animal is.
        beyond: The misfit.
        axes: (3, 3) of the mean body to the camera's.
        trials: As of ``learn_prior``.
        trunk: Indices of the trunk's markers.
    """
    parts, single = list(trials), len(trials) == 1
    if single:
        whole, half = parts[0], len(parts[0].t_s) // 2
        parts = [
            replace(whole, t_s=whole.t_s[s], xyz_m=whole.xyz_m[s], sd_m=whole.sd_m[s])
            for s in (slice(half), slice(half, None))
        ]
    phase = [(bridge(pose.y) - prior.mean) @ prior.basis[:, 0] for pose in poses_of(parts, trunk)]
    above = [one > np.median(one[trial.seen.any(axis=1)]) for one, trial in zip(phase, parts, strict=True)]
    found = []
    for lacking, (k, own) in product((False, True), enumerate(parts)):
        others = [_without(t, lacking & (a == k % 2)) for t, a in zip(parts, above, strict=True) if t is not own]
        part = learn_prior(others, trunk, whole=prior)
        whole = poses_of([*others, own], trunk)[-1]
        some = np.arange(0, len(own.t_s), every_so_many(part))
        at = Poses(
            position_m=whole.frames.position_m[some],
            rotation=whole.frames.rotation[some],
            z=(bridge(whole.y)[some] - part.mean) @ part.basis,
        )
        pixels = _from_afar(own, part, at, axes, noise_m, beyond)
        wider = np.hypot(1.0, part.left_sd[::3] / np.hypot(noise_m, beyond.clicks_m))
        recorded = Recorded(prior=part, views=replace(pixels, sd_px=pixels.sd_px * wider))
        start, _ = settled(replace(recorded, views=recorded.views.frames(some)), at)
        with suppress(FilterError):
            problem, best, _ = held_by_bones(recorded, pixels, between(start, some, len(own.t_s)), within=ROUGHLY)
            xyz, lags = marked(problem, recorded, pixels, best, within=ROUGHLY)
            lacks = np.full(len(xyz), lacking or single)
            shape = (whole.y - part.mean).reshape(xyz.shape)
            off = [_relative(xyz - own.xyz_m), _relative(shape)]
            found.append([strange(recorded, best), _squared(xyz, lags[0], own), lacks, *off])
    unlike, squared, lacks, *off = np.concatenate([np.zeros((5, 0)), *found], axis=1)
    finite = np.isfinite(unlike) & np.isfinite(squared)
    if not finite.any():
        return UNDOUBTED
    order, usual = np.argsort(unlike[finite], kind="stable"), unlike[finite & (lacks == 0)]
    groups = np.array_split(order, max(1, round(len(order) / prior.lasts)))  # frames that err alike
    error, spread = (_rms(one[finite & (lacks == 0)]) for one in off)
    means = np.array([[one[finite][group].mean() for group in groups] for one in (unlike, squared)])
    return LeftOut(
        most=float(np.quantile(usual, 1 - ALARMS)) if len(usual) else np.inf,
        strange=means[0],
        wider=np.maximum(isotonic_regression(means[1]).x, 1.0),
        error_m=error,
        spread_m=spread,
    )


def _relative(error_m: Array) -> Array:
    """(T,) mean square of (T, M, 3) errors relative to the mean of the markers that have one; NaN of fewer than two."""
    seen = np.isfinite(error_m[..., 0])
    count = np.maximum(seen.sum(axis=1), 1)
    error = np.where(seen[..., None], error_m, 0.0)
    centred = np.where(seen[..., None], error - (error.sum(axis=1) / count[:, None])[:, None], 0.0)
    return np.where(count > 1, np.sum(centred**2, axis=(1, 2)) / count, np.nan)


def _rms(squares: Array) -> float:
    """Root of the mean of squares; NaN of none."""
    return float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else np.nan


def _without(trial: MarkerTrial, lacks: NDArray[np.bool_]) -> MarkerTrial:
    """A trial of which some frames (T,) show nothing."""
    return replace(
        trial,
        xyz_m=np.where(lacks[:, None, None], np.nan, trial.xyz_m),
        sd_m=np.where(lacks[:, None], np.nan, trial.sd_m),
    )


def _squared(xyz_m: Array, joint: Array, trial: MarkerTrial) -> Array:
    """(T,) mean square of errors over their deviations, relative to the mean of the markers that the trial has."""
    markers, seen = trial.seen.shape[1], trial.seen
    share = seen / np.maximum(seen.sum(axis=1, keepdims=True), 1)
    less = np.kron(np.eye(markers) - share[:, None, :], np.eye(3))
    noise = np.repeat(np.where(seen, trial.sd_m, 0.0) ** 2, 3, axis=1)
    error = np.where(seen[..., None], xyz_m - trial.xyz_m, 0.0).reshape(len(seen), -1, 1)
    variance = np.sum((less @ (joint + noise[:, None] * np.eye(3 * markers))) * less, axis=2)
    count = seen.sum(axis=1)
    used = np.repeat(seen & (count > 1)[:, None], 3, axis=1)  # of one marker nothing is relative
    total = np.sum(np.where(used, (less @ error)[..., 0] ** 2 / np.where(used, variance, 1.0), 0.0), axis=1)
    return np.where(count > 1, total / np.maximum(3 * count, 1), np.nan)


def _from_afar(trial: MarkerTrial, prior: PosePrior, at: Poses, axes: Array, noise_m: float, beyond: Misfit) -> Views:
    """A trial as a camera sees it that looks along the last of some axes (3, 3) of the mean body.

    The noise of rays is drawn; that of the trial's markers is in what shapes leave, here as in deviations. All of a
    misfit is drawn as errors of clicks, as trials have no other poses than theirs.
    """
    turn = axes @ Rotation.from_matrix(at.rotation).mean().as_matrix().T
    middle = np.mean(at.position_m, axis=0)
    # 20 RMS distances of markers from the middle: an image 6 degrees wide
    distance = 20 * np.sqrt(np.sum(prior.mean**2) / prior.markers) + float(
        np.abs((at.position_m - middle) @ turn[2]).max()
    )
    local = (trial.xyz_m - middle) @ turn.T + [0.0, 0.0, distance]
    matrix = np.column_stack([turn, [0.0, 0.0, distance] - turn @ middle])
    uv = local[..., :2] / local[..., 2:]
    rng = np.random.default_rng(0)
    uv += noise_m / distance * rng.normal(size=uv.shape)
    if beyond.sd_m:
        uv += beyond.sd_m / distance * Matern(rho=prior.left_decay).drawn(rng, uv.shape)
    sd_m = float(np.hypot(noise_m, beyond.clicks_m))
    sd_px = np.full((1, *local.shape[:2]), sd_m / distance)
    return Views(matrices=matrix[None], uv_px=uv[None], sd_px=sd_px, lasting=(beyond.clicks_m / sd_m) ** 2)


def _add_left(prior: PosePrior, views: Views, xyz_m: Array, lags: list[Array], marker: int, within: float) -> None:
    """Move a marker by what its rays say of what shapes leave, and its covariances with it.

    Where rays tell that, they take back what the pose errs by: of an error of the pose (post / prior) is left. Rays see
    the sum of what shapes leave and of errors of clicks that last alike; of what they say ``share`` is the animal's.
    """
    k = slice(3 * marker, 3 * marker + 3)
    sd_px = views.sd_px[:, :, marker : marker + 1]
    place = np.median(xyz_m[:, marker], axis=0)
    clicks_m = np.sqrt(views.lasting) * float(np.median(sd_px[:, :, 0] / views.px_per_m(place)[:, None]))
    left_sd, process = float(prior.left_sd[3 * marker]), Matern(rho=prior.left_decay)
    sd = float(np.hypot(left_sd, clicks_m))
    share = (left_sd / sd) ** 2
    own = replace(views, uv_px=views.uv_px[:, :, marker : marker + 1], sd_px=np.sqrt(1 - views.lasting) * sd_px)
    problem = Left(views=own, xyz_m=xyz_m[:, marker : marker + 1].copy(), sd_m=sd, decay=prior.left_decay)
    left = np.zeros((len(xyz_m), 3))
    with suppress(FilterError):  # rays that are hundreds of deviations off are hardly believed: the shape's place stays
        left = most_probable(problem, left, within=within)
    block, same = covariance(factor(problem.quadratic(left))), process.correlations
    kept = np.eye(3) - share * (np.eye(3) - block[0] / sd**2)
    for lag, part in enumerate(lags):
        part[:, k] = kept[lag:] @ part[:, k]
        part[:, :, k] = part[:, :, k] @ np.swapaxes(kept[: len(part)], 1, 2)
        part[:, k, k] += share**2 * block[lag] + share * (1 - share) * sd**2 * same[lag] * np.eye(3)
    xyz_m[:, marker] += share * left


def _observed(recorded: Recorded, views: Views, pose_m: Array, xyz_m: Array) -> list[Observed]:
    """What was seen in each frame, of each marker as a whole, and how it was believed (Student's weights).

    What is left of a ray is over what poses alone miss it by.
    """
    weight = (views.dof + 2) / (views.dof + np.sum(views.missed(xyz_m) ** 2, axis=-1))
    squared, cost = np.sum(recorded.views.missed(pose_m) ** 2, axis=-1), recorded.views.cost(pose_m)
    out = []
    for frame in range(len(xyz_m)):
        seen = views.seen[:, frame]
        marker = np.flatnonzero(seen.any(axis=0))
        out.append(
            Observed(
                where=np.stack([np.full_like(marker, WHOLE), marker], axis=1),
                innovation=np.zeros((len(marker), 3)),
                weight=np.minimum(np.where(seen, weight[:, frame], 0.0).max(axis=0)[marker], 1.0),
                nis=float(squared[:, frame].sum()) if len(marker) else np.nan,
                n_rows=2 * int(seen.sum()),
                log_likelihood=-float(cost[frame]),
            )
        )
    return out


def _rates(rate_points: RatePoints, xyz_m: Array, lags: list[Array], dt_s: float) -> Rates | None:
    """Velocities by differences, central but at both ends, with their covariances; None of under 3 frames."""
    steps = len(xyz_m)
    if steps < 3:
        return None
    weights, pairs = (
        np.kron(rate_points.all_weights, np.eye(3)),
        np.array(rate_points.pairs, dtype=np.int64).reshape(-1, 2),
    )
    points = len(rate_points.all_weights)
    here, one, two = (weights @ part @ weights.T for part in lags)
    rows = np.zeros((steps, points, 2, 3, points, 2, 3))
    shape = (steps, points, 3, points, 3)
    rows[:, :, 0, :, :, 0] = here.reshape(shape)
    mixed = np.zeros_like(here)  # of positions with velocities
    mixed[1:-1] = (np.swapaxes(one[1:], 1, 2) - one[:-1]) / (2 * dt_s)
    speed = np.zeros_like(here)
    speed[1:-1] = (here[2:] + here[:-2] - two - np.swapaxes(two, 1, 2)) / (4 * dt_s**2)
    mixed[0], mixed[-1] = (one[0].T - here[0]) / dt_s, (here[-1] - one[-1]) / dt_s
    for end, step in ((0, one[0]), (-1, one[-1])):
        speed[end] = (here[end] + here[1 if end == 0 else -2] - step - step.T) / dt_s**2
    rows[:, :, 0, :, :, 1] = mixed.reshape(shape)
    rows[:, :, 1, :, :, 0] = np.swapaxes(mixed, 1, 2).reshape(shape)
    rows[:, :, 1, :, :, 1] = speed.reshape(shape)
    joint = rows.reshape(steps, points, 6, points, 6)
    velocity = np.gradient(xyz_m, dt_s, axis=0).reshape(steps, -1)
    return Rates(
        rate_points=rate_points,
        velocity_m_s=(velocity @ weights.T).reshape(steps, points, 3),
        own=np.einsum("tiaib->tiab", joint).astype(np.float32),
        cross=joint[:, pairs[:, 0], :, pairs[:, 1]].swapaxes(0, 1).astype(np.float32)
        if len(pairs)
        else np.zeros((steps, 0, 6, 6), dtype=np.float32),
        kept=np.ones((steps, points, 3)),
    )
