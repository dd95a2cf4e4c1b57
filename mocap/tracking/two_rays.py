"""Two rays that no third one confirms: checked by the filter before anything is learned from them.

Where markers are dense a click on the wrong one lies near the epipolar line of the right one in a third of the frames:
the two rays meet, and nothing but the motion tells that they are of two markers. Somebody who takes one marker for
another does so for many frames: where two cameras do not meet in some frames of a run, one of them is looked for that
is wrong in all of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from eal.efforts import Progress, shares
from mocap.cleaning import sentences
from mocap.cleaning.cleaned import Cleaned, written
from mocap.filters.hidden_gaps import EACH_MARKER
from mocap.filters.model import LearnedModel, trials_for
from mocap.filters.models.base import TrialSet
from mocap.filters.models.pose import PoseSettings
from mocap.filters.observations import linearised_pixels
from mocap.filters.poses import MarkerTrial
from mocap.findings import Finding, Kind
from mocap.recording import Recording
from mocap.text import number_of
from mocap.tracking.tracking import learn_motion, marker_trial, seen_part, track, trial_set, why_no_pose

CONTRADICTED = 6.0
"""Points at a larger Mahalanobis distance from what the filter expects are contradicted: its deviations are small.
Of normal errors in three coordinates one in 13 million is."""
PAUSE = 5
"""Frames that show a marker in two cameras are of one run, with at most so many between them that do not.
Chosen, not measured."""
WRONG_CAMERA = 2 * np.log(33)
"""A camera is taken to be wrong if the mean squared distance of its rays is larger by so much: in one frame the other
marker would be 33 times less likely, and all frames count as one, for the filter errs alike in them."""

PASSES = 1.0, 3.0, 2.0, 1.0
"""Time of what is learned, of rounds of rays, of points and of rays again, beside each other. Chosen; not measured."""
ROUNDS = 2.0, 1.0, 1.0
"""Time of at most so many rounds: later ones are often not needed."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Disagreement:
    """Two cameras alone that see a marker, and do not agree where.

    Attributes:
        marker: Index.
        frames: (n,) frames in which both see it.
        cameras: Both.
    """

    marker: int
    frames: NDArray[np.int64]
    cameras: tuple[int, int]


def disagreements(recording: Recording, wrong: Mask | None = None) -> list[Disagreement]:
    """Runs of frames in which two cameras alone, of three or more, see a marker and often do not meet.

    Those, too, in which one of both is wrong about another marker in half of the frames.

    Args:
        recording: The recording.
        wrong: (C, T, M) rays that are known to be wrong; None: none are.
    """
    rays = np.isfinite(recording.uv_px[..., 0])
    if len(rays) < 3:
        return []
    pair = np.asarray(rays.sum(axis=0) == 2) & ~recording.edited
    apart = pair & np.isnan(recording.xyz_m[..., 0])
    doubted = np.zeros(rays.shape[:2], dtype=bool) if wrong is None else np.asarray(wrong.any(axis=2))
    found = []
    for marker in np.flatnonzero((apart | (pair & np.asarray(doubted.any(axis=0))[:, None])).sum(axis=0) > 1).tolist():
        frames = np.flatnonzero(pair[:, marker])
        cameras = np.nonzero(rays[:, frames, marker].T)[1].reshape(-1, 2)
        ends = np.flatnonzero((np.diff(frames) > PAUSE + 1) | np.diff(cameras, axis=0).any(axis=1)) + 1
        for run in np.split(np.arange(len(frames)), ends):
            misses = apart[frames[run], marker]
            first, second = cameras[run[0]].tolist()
            beside = max(doubted[camera, frames[run]].mean() for camera in (first, second))
            # their rays do not meet in a tenth of the frames, or one is wrong about another marker in half
            if (misses.sum() > 1 and misses.mean() >= 0.1) or beside >= 0.5:
                found.append(Disagreement(marker=marker, frames=frames[run], cameras=(first, second)))
    return found


def unconfirmed(recording: Recording) -> Mask:
    """(T, M) points of two rays, in recordings of three cameras or more."""
    rays = np.isfinite(recording.uv_px[..., 0])
    measured = np.isfinite(recording.xyz_m[..., 0]) & ~recording.edited
    return measured & (rays.sum(axis=0) == 2) & (len(rays) > 2)


def worth_checking(recording: Recording) -> bool:
    """Whether two cameras disagree about a marker, or enough points are of two rays."""
    return bool(disagreements(recording)) or _many(recording)


def _many(recording: Recording) -> bool:
    # that costs a pass of the filter
    return bool(unconfirmed(recording).sum() > 0.05 * np.isfinite(recording.xyz_m[..., 0]).sum())


def without_contradicted(
    recording: Recording, learned: LearnedModel | None = None, *, progress: Progress | None = None
) -> Recording:
    """The recording without what the pose filter contradicts where two cameras alone see a marker.

    First rays of cameras that are wrong for a run of frames, then single points, then rays again, where points were.

    Args:
        recording: The recording.
        learned: A model of other trials; None: one is learned from this one.
        progress: Called with the share done, at most: passes that are not needed are left out.
    """
    part = seen_part(recording)
    first, *rest = shares(progress, PASSES)
    pose = _pose(part, learned)
    if first is not None:
        first(1.0)
    checked = _without_wrong_rays(part, pose, learned, rest[0])
    if not disagreements(part) or _many(part):  # else few points of two rays are not worth the pass
        further = _without_wrong_points(checked, pose, learned, rest[1])
        checked = checked if further is checked else _without_wrong_rays(further, pose, learned, rest[2])
    points, rays = np.zeros(recording.xyz_m.shape[:2], dtype=bool), np.zeros(recording.uv_px.shape[:3], dtype=bool)
    frames, markers = recording.place(part)
    points[frames][:, markers] = np.isfinite(part.xyz_m[..., 0]) & np.isnan(checked.xyz_m[..., 0])
    rays[:, frames][:, :, markers] = np.isfinite(part.uv_px[..., 0]) & np.isnan(checked.uv_px[..., 0])
    found = recording[Cleaned]
    told = (*found.told, *sentences.rejected("contradicted", points, recording.names), *_rays_told(rays))
    return _without(recording, points, rays).with_part(replace(found, told=told))


def _without_wrong_points(
    recording: Recording, pose: PoseSettings, learned: LearnedModel | None, progress: Progress | None
) -> Recording:
    """The recording without points of two rays that the pose filter contradicts; one of their rays may be right.

    The filter has not learned from such points, and is given at most one ray of each, the one that is nearer to its
    prediction, so that no wrong point drags it along; it then says where the markers are, and how sure it is. It has no
    regression, which would take the points themselves for true. A filter that never saw such a pose is wrong and sure:
    runs of points that go on from where others have the marker, and lead to where they have it, are believed.
    """
    points = unconfirmed(recording)
    # half as many again in all as are asked: the filter learns from the others alone
    points &= np.isfinite(recording.xyz_m[..., 0]).sum(axis=0) >= 1.5 * points.sum(axis=0)
    doubted = recording.having(position=np.where(points[..., None], np.nan, recording.xyz_m))
    if not points.any() or not _can_expect(doubted, learned):
        return recording
    xyz, cov = _expected(doubted, pose, _trials(doubted, learned), progress=progress)
    far = points & (_distance(xyz - recording.xyz_m, cov + recording.cov_m2, where=points) > CONTRADICTED)
    if far.any():
        away_m = np.where(far, np.linalg.norm(xyz - recording.xyz_m, axis=-1), np.nan)
        far &= ~continuing(recording, points, away_m)
    if not far.any():
        return recording
    return _without(recording, far, np.zeros(recording.uv_px.shape[:3], dtype=bool))


def continuing(recording: Recording, doubtful: Mask, away_m: Array) -> Mask:
    """(T, M) True for contradicted points of runs, among those that are asked about, that continue a marker's motion.

    Somebody who takes one marker for another jumps to it. Each marker is followed with neither ray in such frames; at
    an end of a run, where another point of the marker is near, it knows where to expect it. Amid a run that joins, a
    point is believed where the marker by itself is expected less than half as far away as the pose filter expects it.

    Args:
        recording: The seen part of a recording.
        doubtful: (T, M) points that are asked about.
        away_m: (T, M) how far contradicted ones are from where the pose filter expects them; NaN elsewhere.
    """
    doubted = recording.having(position=np.where(doubtful[..., None], np.nan, recording.xyz_m))
    xyz = track(recording, learn_motion(doubted, EACH_MARKER), hidden=doubtful).xyz_m
    finite = np.isfinite(recording.xyz_m[..., 0])
    miss_m, out = np.linalg.norm(xyz - recording.xyz_m, axis=-1), np.zeros_like(doubtful)
    for marker in np.flatnonzero(np.isfinite(away_m).any(axis=0)).tolist():
        frames, others = np.flatnonzero(doubtful[:, marker]), finite[:, marker] & ~doubtful[:, marker]
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > PAUSE + 1) + 1):
            contradicted = run[np.isfinite(away_m[run, marker])]
            ends = [(run[0], slice(max(0, run[0] - 3), run[0])), (run[-1], slice(run[-1] + 1, run[-1] + 4))]
            misses = [miss_m[end, marker] for end, beside in ends if others[beside].any()]
            # in six flights and their copies with wrong clicks (docs/experiments/two_cameras.md) right
            # runs have up to 0.2, wrong ones 0.24 to 1.5
            if len(contradicted) and misses and max(misses) < 0.2 * np.median(away_m[contradicted, marker]):
                # those that the marker by itself is expected less than half as far from
                out[contradicted, marker] = miss_m[contradicted, marker] < 0.5 * away_m[contradicted, marker]
    return out


def _without_wrong_rays(
    recording: Recording, pose: PoseSettings, learned: LearnedModel | None, progress: Progress | None
) -> Recording:
    """The recording without the rays of cameras that are wrong for a run of frames, and the points that they made.

    The filter is given neither ray of such a run, and has not learned from their points.
    """
    checked, wrong, trials = recording, np.zeros(recording.uv_px.shape[:3], dtype=bool), None
    for tell in shares(progress, ROUNDS):
        runs, hidden = disagreements(checked, wrong), np.zeros(wrong.shape[1:], dtype=bool)
        for run in runs:
            hidden[run.frames, run.marker] = True
        doubted = checked.having(position=np.where(hidden[..., None], np.nan, checked.xyz_m))
        if not runs or not _can_expect(doubted, learned):
            break
        trials = _trials(doubted, learned, trials)  # a round that doubts no more points learns from the same
        more = _wrong_rays(checked, runs, *_expected(doubted, pose, trials, hidden=hidden, progress=tell))
        if not more.any():
            break
        wrong |= more
        checked = checked.having(
            believed=np.where(more[..., None], np.nan, checked.uv_px),
            position=np.where(np.asarray(more.any(axis=0))[..., None], np.nan, checked.xyz_m),
        )
    if not wrong.any():
        return recording
    return _without(recording, wrong.any(axis=0) & np.isfinite(recording.xyz_m[..., 0]), wrong)


def _without(recording: Recording, points: Mask, rays: Mask) -> Recording:
    """The recording without points (T, M) and rays (C, T, M) that are contradicted."""
    before = recording.rejected.get("contradicted", np.zeros_like(points))
    more = {"contradicted": before | points} if points.any() else {}
    return written(
        recording,
        recording[Cleaned],
        rejected={**recording.rejected, **more},
        position=np.where(points[..., None], np.nan, recording.xyz_m),
        covariance=np.where(points[..., None, None], np.nan, recording.cov_m2),
        believed=np.where(rays[..., None], np.nan, recording.uv_px),
        ray_rejected=recording.rays_rejected | rays,
    )


def _can_expect(recording: Recording, learned: LearnedModel | None) -> bool:
    """Whether a pose filter can be had: of other trials, or of what is left of this recording."""
    return learned is not None or why_no_pose(recording) is None


def _expected(
    recording: Recording,
    pose: PoseSettings,
    trials: TrialSet,
    *,
    hidden: Mask | None = None,
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """Where the pose filter expects markers: (T, M, 3) and its (T, M, 3, 3) covariance; NaN where it says nothing."""
    smoothed = track(recording, pose.fit(trials), hidden=hidden, progress=progress)
    return smoothed.xyz_m, smoothed.cov_m2


def _wrong_rays(recording: Recording, runs: Sequence[Disagreement], xyz_m: Array, cov_m2: Array) -> Mask:
    """(C, T, M) rays of the camera of each run that is wrong, where one of both surely is and the other one fits.

    They are those from the first to the last frame that shows it.

    Args:
        recording: The recording.
        runs: Where two cameras disagree.
        xyz_m: (T, M, 3) where the filter expects markers that neither camera shows it; NaN: nowhere.
        cov_m2: (T, M, 3, 3) covariance of that.
    """
    wrong = np.zeros(recording.uv_px.shape[:3], dtype=bool)
    for run in runs:
        frames = run.frames[np.isfinite(xyz_m[run.frames, run.marker, 0])]
        if not len(frames):
            continue
        away = np.array([_ray_distances(recording, c, frames, run.marker, xyz_m, cov_m2) for c in run.cameras])
        bad = int(np.argmax(away.mean(axis=1)))
        kept = float(away[1 - bad].mean())
        more = (away[bad] - away[1 - bad]) / max(1.0, kept / 2)  # of two rows: the filter may be surer than it should
        if more.mean() < WRONG_CAMERA or kept > CONTRADICTED**2:
            continue
        shows = np.flatnonzero((more >= WRONG_CAMERA) | np.isnan(recording.xyz_m[frames, run.marker, 0]))
        wrong[run.cameras[bad], frames[shows[0] : shows[-1] + 1], run.marker] = True
    return wrong


def _ray_distances(
    recording: Recording, camera: int, frames: NDArray[np.int64], marker: int, xyz_m: Array, cov_m2: Array
) -> Array:
    """(n,) squared Mahalanobis distances of a camera's rays from where a marker is expected."""
    which, cameras = np.arange(len(frames)), np.full(len(frames), camera)
    pixel, slope, bend = linearised_pixels(
        recording.matrices, xyz_m[frames, marker], cov_m2[frames, marker], cameras, which
    )
    miss = recording.uv_px[camera, frames, marker] - pixel
    noise = recording.ray_sd_px[camera, frames, marker, None] ** 2 + bend
    cov = slope @ cov_m2[frames, marker] @ np.swapaxes(slope, 1, 2) + noise[..., None] * np.eye(2)
    return np.einsum("gi,gi->g", miss, np.linalg.solve(cov, miss[..., None])[..., 0])


def _pose(recording: Recording, learned: LearnedModel | None) -> PoseSettings:
    """The pose model without a regression, and with the rank and process noise that all passes share, looked for once.

    Positions are asked for: of ranks that fill hidden samples alike the smallest will do.
    """
    settings = None if learned is None else learned.models[-1]
    pose = replace(settings if isinstance(settings, PoseSettings) else PoseSettings(), regression=0.0)
    if pose.process_noise or not _can_expect(recording, learned):
        return pose
    trials = _trials(recording, learned)
    return replace(pose, ranks=trials.shapes(pose.ranks)[1].ranks[:1]).tuned(trials)


def _trials(recording: Recording, learned: LearnedModel | None, trials: TrialSet | None = None) -> TrialSet:
    """What is left of the recording, and other trials: those that are known, with their models, if it is the same."""
    own = marker_trial(recording)
    if trials is not None and _same(trials.trials[-1], own):
        return trials
    if learned is not None:
        return trials_for(learned, recording.names, own)
    return trial_set(recording)


def _same(a: MarkerTrial, b: MarkerTrial) -> bool:
    return all(np.array_equal(x, y, equal_nan=True) for x, y in ((a.xyz_m, b.xyz_m), (a.sd_m, b.sd_m)))


def _distance(miss: Array, cov: Array, *, where: Mask) -> Array:
    """(T, M) Mahalanobis distances of (T, M, 3) in (T, M, 3, 3), where asked for and known; 0 elsewhere."""
    finite = where & np.isfinite(miss[..., 0])
    out = np.zeros(where.shape)
    solved = np.linalg.solve(cov[finite], miss[finite][..., None])[..., 0]
    out[finite] = np.sqrt(np.maximum(np.einsum("ki,ki->k", miss[finite], solved), 0.0))
    return out


def _rays_told(mask: NDArray[np.bool_]) -> list[Finding]:
    """Rays (C, T, M) of one of two cameras that disagree."""
    count = int(mask.sum())
    text = (
        f"{number_of(count, 'ray')} rejected (of two cameras that disagree in some frames the one that the motion and "
        "the other markers contradict)"
    )
    return [Finding(kind=Kind.REJECTED_RAYS, text=text, numbers={"rays": count})] if count else []
