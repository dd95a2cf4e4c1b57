"""Learn motion models from a recording that was cleaned, and track with them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import project
from mocap.cleaning.persistence import lasting_share
from mocap.cleaning.swaps import exchanged_samples
from mocap.filters.anatomy import anatomy_of
from mocap.filters.body_axes import BodyFrames, body_frames
from mocap.filters.model import LearnedModel, MixedTrack, track_alone, track_with
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.models.pose import PoseSettings
from mocap.filters.moving import asked_of
from mocap.filters.observations import WHOLE
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.velocities import Asked, Motion
from mocap.kinematics.points import asked_for
from mocap.pipeline.jumped import jump_cov
from mocap.pipeline.lens_effect import filled
from mocap.pipeline.moved import moved
from mocap.pipeline.moving import motion_of
from mocap.pipeline.recording import Recording
from mocap.pipeline.sentences import TOGETHER
from mocap.pipeline.track_variables import with_motion
from mocap.records import Status
from mocap.side_by_side import call_all

Progress = Callable[[float], None]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """The part of a recording in which anything is seen.

    Attributes:
        frames: From the first to the last frame with a point.
        markers: Indices of the markers that are ever seen in 3D.
    """

    frames: slice
    markers: NDArray[np.int64]


def seen_part(recording: Recording) -> Part:
    """Frames and markers that are seen often enough to be tracked."""
    seen = np.isfinite(recording.xyz_m[..., 0])
    frames = np.flatnonzero(seen.any(axis=1))
    return Part(frames=slice(int(frames[0]), int(frames[-1]) + 1), markers=np.flatnonzero(seen.any(axis=0)))


def why_no_pose(recording: Recording, part: Part) -> str | None:
    """Why a whole-pose model cannot be learned from this recording; None where it can."""
    seen = np.isfinite(recording.xyz_m[part.frames][:, part.markers, 0])
    if seen.shape[1] < 4:
        return f"only {seen.shape[1]} markers are seen: a pose needs at least 4"
    spread = np.nanstd(recording.xyz_m[part.frames][:, part.markers], axis=0)
    noise = np.sqrt(np.nanmedian(np.trace(recording.cov_m2, axis1=-2, axis2=-1)) / 3) / recording.stated_over_shown
    if float(np.nanmax(spread)) < 3 * noise:
        return "no marker moves by more than its noise"
    together = int((seen.mean(axis=1) >= TOGETHER).sum())
    if together < 40:
        return f"only {together} frames show 60 % of the markers together: a pose needs at least 40"
    return None


def trunk_frames(recording: Recording, part: Part, *, cutoff_hz: float) -> BodyFrames:
    """Body frames of the tracked frames, from the skeleton's trunk, or from all markers if it names none."""
    wanted = [recording.names.index(m) for m in recording.skeleton.trunk] or list(part.markers)
    xyz = recording.xyz_m[part.frames][:, np.array(wanted)]
    if not np.isfinite(xyz).any():
        xyz = recording.xyz_m[part.frames][:, part.markers]
    return body_frames(xyz, dt_s=recording.dt_s, cutoff_hz=cutoff_hz)


def learn_motion(recording: Recording, part: Part, settings: TrajectoryModel) -> FittedMotion:
    """A motion model learned from the seen part of a recording alone."""
    return settings.fit(trial_set(recording, part))


def part_names(recording: Recording, part: Part) -> list[str]:
    """Names of the tracked markers."""
    return [recording.names[int(m)] for m in part.markers]


def trial_set(recording: Recording, part: Part) -> TrialSet:
    """The seen part alone, with its anatomy; see ``marker_trial``."""
    skeleton, names = recording.skeleton, part_names(recording, part)
    masses, bodies = skeleton.measures.masses, skeleton.bodies.values()
    anatomy = anatomy_of(names, skeleton.trunk, skeleton.rigid, masses, bodies=bodies)
    return TrialSet([marker_trial(recording, part)], anatomy)


def marker_trial(recording: Recording, part: Part) -> MarkerTrial:
    """The seen part as models learn from it: with the noise that it shows, whatever is stated."""
    cov = recording.cov_m2[part.frames][:, part.markers]
    return MarkerTrial(
        name=recording.name,
        t_s=recording.t_s[part.frames],
        xyz_m=recording.xyz_m[part.frames][:, part.markers],
        sd_m=np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 3) / recording.stated_over_shown,
    )


def track_mixed(
    recording: Recording,
    part: Part,
    learned: LearnedModel | None = None,
    *,
    asked: Asked | None = None,
    compared: Mapping[str, TrajectoryModel] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> MixedTrack | None:
    """Filter and smooth the seen part with a mixture of models.

    Args:
        recording: The recording, cleaned.
        part: Its seen part.
        learned: A model of other trials; None: the mixture learns from this recording alone.
        asked: Points whose velocities and joint covariances are kept; None: of none.
        compared: Models that fill hidden gaps, too; None: nothing is scored.
        seed: Where gaps are hidden.
        progress: Called with the share done.

    Returns:
        None: no gap could be hidden, for the recording to teach itself.
    """
    names, skeleton = part_names(recording, part), recording.skeleton
    trial, seen = marker_trial(recording, part), recording.observations(part.frames, part.markers)
    options: dict[str, Any] = {"compared": compared, "seed": seed, "progress": progress, "call_all": call_all}
    options["asked"] = None if asked is None else asked_of(names, asked)
    if learned is not None:
        return track_with(learned, names, trial, seen, **options)
    bodies = [*skeleton.bodies.values()]
    return track_alone(
        names, skeleton.trunk, trial, seen, PoseSettings(), bones=skeleton.rigid, bodies=bodies, **options
    )


def track(
    recording: Recording,
    part: Part,
    model: FittedMotion,
    *,
    hidden: Mask | None = None,
    asked: Asked | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Filter and smooth the seen part."""
    points = None if asked is None else asked_of(part_names(recording, part), asked)
    observations = recording.observations(part.frames, part.markers, hidden=hidden)
    return model.fill(observations, asked=points, progress=progress)


def with_track(
    recording: Recording, part: Part, name: str, smoothed: Estimate, asked: Asked | None = None
) -> Recording:
    """The recording with the smoothed part in place of what was cleaned, every sample with its status.

    What a marker does before its first and after its last sighting is kept while its standard deviation stays under a
    twentieth of the extent of all motion.
    """
    n_frames, n_markers = recording.xyz_m.shape[:2]
    n_cameras = recording.uv_px.shape[0]
    inside = np.ix_(np.arange(n_frames)[part.frames], part.markers)
    xyz, cov = np.full((n_frames, n_markers, 3), np.nan), np.full((n_frames, n_markers, 3, 3), np.nan)
    xyz[inside], cov[inside] = smoothed.xyz_m, smoothed.cov_m2 + lasting_cov(recording)[inside]
    used = np.zeros((n_cameras, n_frames, n_markers), dtype=bool)
    innovation = np.full((n_cameras, n_frames, n_markers, 2), np.nan)
    believed = np.zeros((n_frames, n_markers), dtype=bool)
    believed[inside] = smoothed.believed
    for frame, seen in enumerate(smoothed.observed, start=part.frames.start):
        rays = seen.where[:, 0] >= WHOLE  # not what other markers of a body say
        camera, marker = seen.where[rays, 0], part.markers[seen.where[rays, 1]]
        ok, whole, missed = seen.weight[rays] > 0, camera == WHOLE, seen.innovation[rays]
        used[camera[ok & ~whole], frame, marker[ok & ~whole]] = True
        used[:, frame, marker[ok & whole]] |= np.isfinite(recording.uv_px[:, frame][:, marker[ok & whole], 0])
        innovation[camera[~whole], frame, marker[~whole]] = missed[~whole, :2]
    origin = _origins(recording, believed, np.isfinite(xyz[..., 0]))
    far = moved(recording, xyz, cov)[1] & ~recording.edited  # what a person states is believed
    origin[far & (origin == Status.MEASURED)] = Status.REJECTED
    cov += jump_cov(recording, xyz, origin)
    sd = np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 3)
    extent = float(np.linalg.norm(np.nanmax(recording.xyz_m, axis=(0, 1)) - np.nanmin(recording.xyz_m, axis=(0, 1))))
    vague = (origin == Status.PREDICTED) & ~(sd < 0.05 * extent)
    xyz[vague], cov[vague], origin[vague] = np.nan, np.nan, Status.MISSING
    nis, likelihood, rows_used = np.full(n_frames, np.nan), np.zeros(n_frames), np.zeros(n_frames, dtype=np.int64)
    nis[part.frames] = [seen.nis for seen in smoothed.observed]
    rows_used[part.frames] = [seen.n_rows for seen in smoothed.observed]
    likelihood[part.frames] = smoothed.log_likelihood
    rays = {}
    if recording.cameras:
        rays = {"innovation": innovation, "used": used, "reprojected": project(recording.matrices, xyz)}
    exchanged = np.any(list(exchanged_samples((n_frames, n_markers), recording.swaps).values()), axis=0)
    found = recording.having(
        position=xyz,
        covariance=cov,
        status=origin,
        nis=nis,
        n_rows=rows_used,
        log_likelihood=likelihood,
        repaired=np.where(recording.edited, 2, exchanged).astype(np.int8),
        **rays,
    )
    asked = asked or asked_for(recording.names, recording.skeleton, n_frames=n_frames)
    motion = motion_of(found.tracks, part.frames, smoothed.rates, asked)
    y_up = recording.rows is not None and recording.rows.coefficients == "lower-left"
    return replace(found, data=with_motion(found.data, motion).assign_attrs(model=name, y_up=int(y_up)))


def tracks_alone(recording: Recording, model: str, motion: Motion) -> Recording:
    """Positions as if a model had tracked them, of whose pixels and innovations nothing is known."""
    n_frames, n_markers = recording.xyz_m.shape[:2]
    found = recording.having(
        nis=np.full(n_frames, np.nan),
        n_rows=np.zeros(n_frames, dtype=np.int64),
        log_likelihood=np.zeros(n_frames),
        repaired=np.zeros((n_frames, n_markers), dtype=np.int8),
    )
    return replace(found, data=with_motion(found.data, motion).assign_attrs(model=model))


def _origins(recording: Recording, believed: Mask, estimated: Mask) -> NDArray[np.int8]:
    """(T, M) origin of each sample; between a marker's first and last sighting what is not measured is smoothed."""
    index = np.arange(len(believed))[:, None]
    ever = believed.any(axis=0)
    first = np.where(ever, np.argmax(believed, axis=0), len(believed))
    last = np.where(ever, len(believed) - 1 - np.argmax(believed[::-1], axis=0), -1)
    between = (index > first) & (index < last)
    origin = np.where(between, Status.SMOOTHED, Status.PREDICTED).astype(np.int8)
    refused = np.any(list(recording.rejected.values()), axis=0) | (np.isfinite(recording.xyz_m[..., 0]) & ~believed)
    origin[refused] = Status.REJECTED
    origin[believed] = Status.MEASURED
    origin[~estimated & (origin != Status.REJECTED)] = Status.MISSING
    return origin


def lasting_cov(recording: Recording) -> Array:
    """(T, M, 3, 3) covariance of a point from ray errors that last, which no filter can average out.

    The jitter's covariance scaled to the variance of the lasting errors of each marker and of what all cameras share
    (``mocap.cleaning.persistence``), and that of a lens which was estimated or is not corrected; where a marker is not
    seen, that of the sample of median variance.
    """
    if not recording.cameras:
        return np.zeros_like(recording.cov_m2)
    usual = recording.jitter_px * (np.ones(len(recording.names)) if recording.noise is None else recording.noise.marker)
    cov = recording.cov_m2 * lasting_share(recording.persistent_px, usual, removed_px=recording.bias_px)[:, None, None]
    return filled(cov) if recording.lens_cov_m2 is None else filled(cov) + filled(recording.lens_cov_m2)
