"""``mocap track`` of a recording in which no marker is seen by two cameras, with a model learned from others."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.cleaning.cleaned import Cleaned, written
from mocap.cleaning.click_noise import LEAST_PX
from mocap.errors import CalibrationError, FormatError
from mocap.filters.anatomy import anatomy_of
from mocap.filters.hidden_views import filled_views
from mocap.filters.model import LearnedModel, check_rates, for_recording, renamed
from mocap.filters.models.base import TrialSet
from mocap.filters.models.one_camera import OneCameraSettings
from mocap.filters.moving import rate_points_of
from mocap.filters.one_camera import jitter_px, shown
from mocap.filters.one_view import Views
from mocap.filters.pose_prior import LEAST_MARKERS
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.score import Score
from mocap.findings import Finding, Kind
from mocap.progress import Stages
from mocap.recording import Recording
from mocap.text import number_of
from mocap.tracking.result import rate_points

NAME = "one camera"
"""Of the model, in reports and tables."""
RARE = 0.05
"""Mirror images of a smaller probability are not told of. Chosen."""

POOR = 0.5
"""A view is poor if trials left out err in it by more than this share of what poses spread by: three quarters of their
variance are told at 0.5. Chosen: limbs seen across their swing have 0.03 to 0.1, along it 0.65 (simulated)."""


def track_one_camera(
    source: Recording,
    learned: LearnedModel | None,
    *,
    stages: Stages,
    validated: bool = False,
    seed: int = 0,
) -> tuple[Recording, Recording, Estimate, str, Mapping[str, Score]]:
    """Track a recording of one camera.

    Args:
        source: The recording.
        learned: A model of other trials.
        stages: Timer and progress.
        validated: Whether to hide samples and measure how they are filled, across the line of sight.
        seed: Which samples to hide.

    Returns:
        The recording, with points where a camera saw the marker; the part that was tracked; what was found; how the
        model was made; and how gaps that were hidden in it were filled.

    Raises:
        CalibrationError: there is no model.
        FilterError: the model knows fewer than four of the markers, or another frame rate.
    """
    if learned is None:
        seen = "contains one camera" if len(source.camera_names) == 1 else "no marker is seen by two cameras at once"
        raise CalibrationError(
            f"{source.where}: {seen}: 3D points need two or more views, or a model of the animal learned from "
            "recordings with more (mocap learn): give `model`"
        )
    film, skeleton, names = source, source.skeleton, source.names
    learned = renamed(learned, skeleton.renamed(learned.names))
    t_s, uv = film.t_s, film.ideal_px
    empty = MarkerTrial(
        name=source.name, t_s=t_s, xyz_m=np.full((*uv.shape[1:3], 3), np.nan), sd_m=np.full(uv.shape[1:3], np.nan)
    )
    check_rates([*learned.trials, empty])
    trials = for_recording(learned, names, empty)
    tracked = np.any([trial.seen.any(axis=0) for trial in trials], axis=0)
    markers = np.flatnonzero(tracked)
    frames = shown(film.seen[:, :, markers])
    if frames.stop == 0:
        raise FormatError(f"{source.where}: no frame shows {LEAST_MARKERS} markers of the model to one camera")
    part = film.at(frames).only(markers)
    trials = [replace(t, xyz_m=t.xyz_m[:, markers], sd_m=t.sd_m[:, markers]) for t in trials]
    own, inside = part.names, part.ideal_px
    noise = source.source.pixel_sd or max(float(np.nan_to_num(jitter_px(inside))), LEAST_PX)
    views = Views(matrices=film.matrices, uv_px=inside, sd_px=np.full(inside.shape[:3], noise))
    unseen = replace(empty, xyz_m=empty.xyz_m[:, markers], sd_m=empty.sd_m[:, markers])
    anatomy = replace(anatomy_of(own, learned.trunk, ()), bodies=())
    fitted = OneCameraSettings().fit(TrialSet([*trials, unseen], anatomy))
    with stages.stage("track one camera") as progress:
        found = fitted.fill(views, rate_points=rate_points_of(own, rate_points(source)), progress=progress)
    scores: Mapping[str, Score] = {}
    if validated:
        points = np.where(np.any(part.seen, axis=0)[..., None], found.xyz_m, np.nan)
        filled = replace(unseen, t_s=part.t_s, xyz_m=points, sd_m=unseen.sd_m[frames])
        with stages.stage("validate on hidden samples") as progress:
            scores = filled_views(
                fitted, TrialSet([*trials, filled], anatomy), views, name=NAME, seed=seed, progress=progress
            )
    why = (
        f"learned from {', '.join(trial.name for trial in trials)}; the size of the animal is the model's, within "
        f"{fitted.prior.size_sd:.1%} (standard deviation)"
    )
    return _cleaned(film, part, found, noise, len(trials)), part, found, why, scores


def _cleaned(film: Recording, part: Recording, found: Estimate, noise: float, trials: int) -> Recording:
    """The recording as others are cleaned: with the points that were found where a marker was seen."""
    n_cameras, n_frames, n_markers, _ = film.ideal_px.shape
    seen = film.seen.any(axis=0)
    frames, markers = film.place(part)
    inside = np.ix_(np.arange(n_frames)[frames], markers)
    xyz, cov = np.full((n_frames, n_markers, 3), np.nan), np.full((n_frames, n_markers, 3, 3), np.nan)
    residual = np.full((n_frames, n_markers), np.nan)
    own = found.own
    xyz[inside], cov[inside], residual[inside] = found.xyz_m, found.cov_m2, own["residual_px"]
    xyz[~seen], cov[~seen], residual[~seen] = np.nan, np.nan, np.nan
    other = float(own["mirror_image"])
    rays = np.full(film.ideal_px.shape[:3], noise)
    wider, loose = own["wider"][~own["unlike"]], bool(own["loose"])
    told = _told(other if other > RARE else None, int(own["unlike"].sum()), wider, trials=trials, loose=loose)
    told += _off(*map(float, own["misfit"]), dt_s=part.dt_s, empty=bool(own["unlike"].all()))
    told += _poor(*map(float, own["left_out_m"]))
    return written(
        film,
        Cleaned(jitter_px=noise, told=tuple(told)),
        rejected={},
        position=xyz,
        covariance=cov,
        believed=film.ideal_px,
        ray_sd=rays,
        ray_scale=rays,
        residual=residual,
        ray_rejected=np.zeros((n_cameras, n_frames, n_markers), dtype=bool),
        most_speed=np.full(n_markers, np.nan),
        camera_factor=np.ones((n_cameras, n_frames)),
        persistent=np.zeros(n_markers),
    )


def _told(other: float | None, strange: int, wider: Array, *, trials: int, loose: bool) -> list[Finding]:
    """What one camera alone leaves open.

    Args:
        other: Probability of the mirror image of the pose; None: it is out of the question.
        strange: Frames whose poses are unlike those of the trials.
        wider: (T,) what standard deviations of the other frames were multiplied by, at least 1.
        trials: Number of trials.
        loose: Whether the lengths of bones could not be kept.
    """
    alone = (
        "one camera alone: depth follows from the size of the animal in the model, and poses from its trials; standard "
        "deviations along the line of sight are the largest"
    )
    found = [Finding(kind=Kind.ONE_CAMERA, text=alone)]
    if other is not None:
        text = f"the pose or its mirror image: the other has a probability of {other:.0%}, and intervals cover both"
        found.append(Finding(kind=Kind.MIRROR_IMAGE, text=text, numbers={"probability": other}))
    if strange:
        usual = "fit worse than is stated, and than in 99 % of the frames of trials that a model was not learned from"
        worse = "have larger reprojection errors than the model states" if trials == 1 else usual
        frames = number_of(strange, "frame shows a pose", "frames show poses")
        text = f"{frames} unlike those of the trials, left empty: seen markers {worse}"
        found.append(Finding(kind=Kind.UNLIKE_POSES, text=text, numbers={"frames": strange}))
    if (wider > 1).any():
        share, times = float(np.mean(wider > 1)), float(np.sqrt(np.mean(wider[wider > 1] ** 2)))
        text = (
            f"standard deviations of {share:.0%} of the frames are {times:.2f} times as large (RMS; at most "
            f"{wider.max():.2f}) as the model states, as trials erred that were left out of it"
        )
        found.append(
            Finding(kind=Kind.WIDER_INTERVALS, text=text, numbers={"share": share, "times": times, "most": wider.max()})
        )
    if trials == 1:
        text = (
            "the model was learned from one trial, which cannot show how another differs: intervals are those of its "
            "halves; learn from two or more"
        )
        found.append(Finding(kind=Kind.ONE_TRIAL, text=text))
    if loose:
        text = "no poses fit both the pixels and the bones of the model: check that it is of this animal"
        found.append(Finding(kind=Kind.BONES_NOT_KEPT, text=text))
    return found


def _off(sd_m: float, sd_px: float, half_life_s: float, clicks_m: float, *, dt_s: float, empty: bool) -> list[Finding]:
    """That markers are off their poses by more than trials tell, for so long; 0: they are not."""
    if sd_m == 0:
        return []
    text = (
        f"markers are off the poses of the trials by {sd_px:.2g} px ({1e3 * sd_m:.2g} mm) beyond what trials show that "
        f"are left out (standard deviation of a coordinate; it lasts {half_life_s / dt_s:.0f} frames): clicks that "
        f"stay off ({(clicks_m / sd_m) ** 2:.0%} of the variance: neighbours are off apart), or poses that differ "
        "(together); one camera cannot tell for certain, and intervals are as wide as either needs"
    )
    if empty:
        text += ". Nothing is shown: learn from trials of such movements, or state `pixel_sd`"
    numbers = {"sd_m": sd_m, "sd_px": sd_px, "half_life_s": half_life_s}
    return [Finding(kind=Kind.MISFIT, text=text, numbers=numbers)]


def _poor(error_m: float, spread_m: float) -> list[Finding]:
    """That a view tells little of poses, by what trials that were left out erred by in it; NaN: none tells."""
    if not error_m > POOR * spread_m:
        return []
    text = (
        f"this view tells little of the pose: in it trials that the model left out err by {1e3 * error_m:.1f} mm "
        f"(RMS, relative to the mean of the markers), one pose for all frames by {1e3 * spread_m:.1f}: film across the "
        "plane of the movement, or with a second camera"
    )
    return [Finding(kind=Kind.POOR_VIEW, text=text, numbers={"error_m": error_m, "spread_m": spread_m})]
