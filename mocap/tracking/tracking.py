"""Learn motion models from a recording that was cleaned, and track with them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.audit.samples import Jump
from mocap.cameras.triangulate import project
from mocap.cleaning.cleaned import cleaned
from mocap.cleaning.click_noise import USUAL_DOF
from mocap.cleaning.positions import POSE_MARKERS, POSE_SHARE, shows_a_pose
from mocap.filters.anatomy import anatomy_of
from mocap.filters.body_axes import BodyFrames, body_frames
from mocap.filters.model import LearnedModel, MixedTrack, track_alone, track_with
from mocap.filters.models.base import Fitted, TrajectoryModel, TrialSet
from mocap.filters.models.pose import PoseSettings
from mocap.filters.moving import Rates, rate_points_of
from mocap.filters.observations import WHOLE, Observations, PixelObservations, PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.track import forgotten
from mocap.filters.velocities import Motion, RatePoints, without_rates
from mocap.io.unstated_unit import length
from mocap.joints import joint_variables
from mocap.recording import Recording, of_points
from mocap.records import MarkerTracks, Status, angle_names, unknown
from mocap.side_by_side import call_all
from mocap.skeleton import Skeleton
from mocap.text import number_of
from mocap.tracking.lasting_errors import FAR, beyond, departures, lasting_cov, root_mean_square
from mocap.tracking.result import Result, rate_points
from mocap.variables import VARIABLES, Values

Progress = Callable[[float], None]
Mask = NDArray[np.bool_]

PREPARE = "read, triangulate, clean"
"""The stage before a recording is tracked, or teaches."""
POSE_FRAMES = 40
"""Frames that a pose is learned from at least. Chosen, not measured."""
MOVED = {"moved": f"the track lies more than {FAR:g} standard deviations from where the sample was measured"}
"""Why a sample was rejected here, by the key that reports use."""


def seen_frames(recording: Recording) -> slice:
    """From the first to the last frame with a point."""
    frames = np.flatnonzero(np.isfinite(recording.xyz_m[..., 0]).any(axis=1))
    return slice(int(frames[0]), int(frames[-1]) + 1)


def seen_part(recording: Recording) -> Recording:
    """The frames in which anything is seen, of the markers that are ever seen in 3D: what is learned from, and tracked.

    ``recording.place`` says where they are in it.
    """
    ever = np.isfinite(recording.xyz_m[..., 0]).any(axis=0)
    return recording.at(seen_frames(recording)).only(np.flatnonzero(ever))


def each_alone(part: Recording) -> str:
    """The model, by its name in the registry, that follows each marker by itself where no pose can be learned.

    Of fewer markers than a pose has they are all that is known, and their accelerations are asked for.
    """
    return (
        "constant_velocity"
        if np.isfinite(part.xyz_m[..., 0]).any(axis=0).sum() >= POSE_MARKERS
        else "smooth_acceleration"
    )


def why_no_pose(part: Recording) -> str | None:
    """Why a whole-pose model cannot be learned from the seen part of a recording; None where it can."""
    seen = np.isfinite(part.xyz_m[..., 0])
    if seen.shape[1] < POSE_MARKERS:
        return f"only {number_of(seen.shape[1], 'marker is', 'markers are')} seen: a pose needs at least {POSE_MARKERS}"
    spread = np.nanstd(part.xyz_m, axis=0)
    noise = np.sqrt(np.nanmedian(np.trace(part.cov_m2, axis1=-2, axis2=-1)) / 3) / cleaned(part).stated_over_shown
    if float(np.nanmax(spread)) < 3 * noise:
        return "no marker moves by more than its noise"
    together = int(shows_a_pose(seen).sum())
    if together < POSE_FRAMES:
        share = f"{100 * POSE_SHARE:g} %"
        shown = number_of(together, "frame shows", "frames show")
        return f"only {shown} {share} of the markers together: a pose needs at least {POSE_FRAMES}"
    return None


def observations(recording: Recording, *, hidden: Mask | None = None) -> Observations:
    """Rows for a tracker, of a recording that was cleaned, without (T, M) samples that are hidden."""
    noise = cleaned(recording).noise
    keep = np.ones(recording.xyz_m.shape[:2], dtype=bool) if hidden is None else ~hidden
    xyz, cov = np.where(keep[..., None], recording.xyz_m, np.nan), recording.cov_m2
    if not recording.cameras:
        return PositionObservations(xyz_m=xyz, sd_m=np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 3))
    uv = np.where(keep[None, ..., None], recording.uv_px, np.nan)
    middle = np.nanmedian(recording.xyz_m.reshape(-1, 3), axis=0)
    depth = np.median(np.abs(recording.matrices[:, 2, :3] @ middle + recording.matrices[:, 2, 3]))
    return PixelObservations(
        matrices=recording.matrices,
        uv_px=uv,
        sd_px=recording.ray_scale_px,
        dof=np.full(len(uv), USUAL_DOF) if noise is None else noise.dof,
        xyz_m=xyz,
        cov_m2=cov,
        wide_m=0.05 * float(depth),  # vaguer ones: no sigma points
        by_hand=recording.by_hand,
    )


def learn_motion(part: Recording, settings: TrajectoryModel) -> Fitted:
    """A motion model learned from a recording alone."""
    return settings.fit(trial_set(part))


def trial_set(part: Recording) -> TrialSet:
    """A recording alone, with its anatomy; see ``marker_trial``."""
    skeleton = part.skeleton
    masses, bodies = skeleton.measures.masses, skeleton.bodies.values()
    anatomy = anatomy_of(part.names, skeleton.trunk, skeleton.rigid, masses, bodies=bodies)
    return TrialSet([marker_trial(part)], anatomy)


def marker_trial(part: Recording) -> MarkerTrial:
    """A recording as models learn from it: with the noise that it shows, whatever is stated."""
    sd_m = np.sqrt(np.trace(part.cov_m2, axis1=-2, axis2=-1) / 3) / cleaned(part).stated_over_shown
    return MarkerTrial(name=part.name, t_s=part.t_s, xyz_m=part.xyz_m, sd_m=sd_m)


def track_mixed(
    part: Recording,
    learned: LearnedModel | None = None,
    *,
    rate_points: RatePoints | None = None,
    compared: Mapping[str, TrajectoryModel] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> MixedTrack | None:
    """Filter and smooth a recording with a mixture of models.

    Args:
        part: The seen part of a recording that was cleaned.
        learned: A model of other trials; None: the mixture learns from this recording alone.
        rate_points: Points whose velocities and joint covariances are kept; None: of none.
        compared: Models that fill hidden gaps, too; None: nothing is scored.
        seed: Where gaps are hidden.
        progress: Called with the share done.

    Returns:
        None: no gap could be hidden, for the recording to teach itself.
    """
    names, skeleton = part.names, part.skeleton
    trial, seen = marker_trial(part), observations(part)
    options: dict[str, Any] = {"compared": compared, "seed": seed, "progress": progress, "call_all": call_all}
    options["rate_points"] = None if rate_points is None else rate_points_of(names, rate_points)
    if learned is not None:
        return track_with(learned, names, trial, seen, **options)
    bodies = [*skeleton.bodies.values()]
    return track_alone(
        names, skeleton.trunk, trial, seen, PoseSettings(), bones=skeleton.rigid, bodies=bodies, **options
    )


def track(
    part: Recording,
    model: Fitted,
    *,
    hidden: Mask | None = None,
    rate_points: RatePoints | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Filter and smooth the seen part of a recording."""
    points = None if rate_points is None else rate_points_of(part.names, rate_points)
    return model.fill(observations(part, hidden=hidden), rate_points=points, progress=progress)


def with_track(recording: Recording, part: Recording, name: str, smoothed: Estimate) -> Result:
    """The recording with a part of it, smoothed, in place of what was cleaned, every sample with its status.

    With joints, and what the model says of its own state: limbs that were held, joint angles.

    What a marker does before its first and after its last sighting is kept while its standard deviation stays under a
    twentieth of the extent of all motion. What is too uncertain to use is left empty (``unknown_samples``).
    """
    n_frames, n_markers = recording.xyz_m.shape[:2]
    n_cameras = recording.uv_px.shape[0]
    frames, markers = recording.place(part)

    def spread(name: str, values: Values) -> Values:
        """A variable of the part as one of the recording."""
        dims, least = VARIABLES[name].dims, VARIABLES[name].entry.get("least", 0)
        sizes = [{"time": n_frames, "keypoint": n_markers}.get(d, n) for d, n in zip(dims, values.shape, strict=True)]
        out = np.full(sizes, np.nan if values.dtype.kind == "f" else least, dtype=values.dtype)
        out[tuple({"time": frames, "keypoint": markers}.get(dim, slice(None)) for dim in dims)] = values
        return out

    xyz, cov = spread("position", smoothed.xyz_m), spread("covariance", smoothed.cov_m2) + lasting_cov(recording)
    used = np.zeros((n_cameras, n_frames, n_markers), dtype=bool)
    innovation = np.full((n_cameras, n_frames, n_markers, 2), np.nan)
    believed = np.zeros((n_frames, n_markers), dtype=bool)
    believed[frames][:, markers] = smoothed.believed
    for frame, seen in enumerate(smoothed.observed, start=frames.start):
        rays = seen.where[:, 0] >= WHOLE  # not what other markers of a body say
        camera, marker = seen.where[rays, 0], markers[seen.where[rays, 1]]
        ok, whole, missed = seen.weight[rays] > 0, camera == WHOLE, seen.innovation[rays]
        used[camera[ok & ~whole], frame, marker[ok & ~whole]] = True
        used[:, frame, marker[ok & whole]] |= np.isfinite(recording.uv_px[:, frame][:, marker[ok & whole], 0])
        innovation[camera[~whole], frame, marker[~whole]] = missed[~whole, :2]
    origin = _origins(recording, believed, np.isfinite(xyz[..., 0]))
    off, far = moved(recording, xyz, cov)
    left = (
        np.where(far[..., None], np.gradient(np.nan_to_num(off), recording.t_s, axis=0), 0.0) if n_frames > 1 else 0.0
    )
    departure: dict[str, Any] = {}
    if not recording.cameras:  # of rays cleaning found what lasts
        believed_off = np.where((origin == Status.MEASURED)[..., None], off, np.nan)
        left_m2, kept = departures(believed_off, cov + recording.cov_m2)
        cov += left_m2
        departure = {"departure": root_mean_square(left_m2, origin == Status.MEASURED)}
        far = moved(recording, xyz, cov)[1] & ~kept
    far &= (origin == Status.MEASURED) & ~recording.edited  # what a person states is believed
    origin[far] = Status.REJECTED
    cov += jump_cov(cleaned(recording).jumps, xyz, origin)
    sd = np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 3)
    extent = float(np.linalg.norm(np.nanmax(recording.xyz_m, axis=(0, 1)) - np.nanmin(recording.xyz_m, axis=(0, 1))))
    vague = (origin == Status.PREDICTED) & ~(sd < 0.05 * extent)
    empty = unknown_samples(xyz, sd, origin, extent_m=extent)
    xyz[vague | empty], cov[vague | empty] = np.nan, np.nan
    origin[vague | (empty & (origin != Status.REJECTED))] = Status.MISSING
    rays, likelihood = {}, np.zeros(n_frames)
    likelihood[frames] = smoothed.log_likelihood
    if recording.cameras:
        rays = {"innovation": innovation, "used": used, "reprojected": project(recording.matrices, xyz)}
    found = Result.of(recording).having(
        position=xyz,
        covariance=cov,
        status=origin,
        unknown=empty,
        nis=spread("nis", np.array([seen.nis for seen in smoothed.observed], dtype=float)),
        n_rows=spread("n_rows", np.array([seen.n_rows for seen in smoothed.observed], dtype=np.int64)),
        log_likelihood=likelihood,
        **rays,
        **departure,
    )
    motion = motion_of(found.tracks, frames, smoothed.rates, rate_points(recording), left_m_s=left)
    found = _with_joints(found.with_motion(motion), whole_frames(recording))
    found = replace(found, data=found.data.assign_attrs(model=name, y_up=int(recording.y_up)))
    own: dict[str, Any] = {name: spread(name, of) for name, of in smoothed.own.items() if name in VARIABLES}
    return found.having(_named(smoothed.own, part.names), **own)


def _named(own: Mapping[str, NDArray[Any]], names: Sequence[str]) -> dict[str, Sequence[str]]:
    """Names of the limbs, joint angles and segments that a model says something of (``Estimate.own``)."""
    found: dict[str, Sequence[str]] = {"limb": own["limb"].tolist()} if "limb" in own else {}
    if "segment_ends" in own:
        ends = [(names[int(a)], names[int(b)]) for a, b in own["segment_ends"]]
        found["angle"] = angle_names(ends, own["freedoms"].tolist())
        found["segment"] = [f"{a} to {b}" for a, b in ends]
    return found


def unknown_samples(xyz_m: Array, sd_m: Array, origin: NDArray[np.int8], *, extent_m: float) -> Mask:
    """(T, M) filled samples of which nothing is known: their 95 % interval is as wide as the animal is long.

    Or nothing at all was seen for longer than a motion is remembered (``mocap.filters.track.forgotten``).

    What a gap adds is meant: the variance of a typical measured sample of the marker, in which are errors of
    calibration and of one camera's depth that all samples share, is taken off. Of fewer markers than a pose has the
    length of the animal is not known: there it is the extent of all that was seen.

    Args:
        xyz_m: (T, M, 3) positions of the track.
        sd_m: (T, M) their standard deviations.
        origin: (T, M) status of each.
        extent_m: Of all motion.
    """
    measured = origin == Status.MEASURED
    shown, posed = measured.any(axis=1), measured.any(axis=0).sum() >= POSE_MARKERS
    if not shown.any():
        return np.zeros(origin.shape, dtype=bool)
    widest = length(xyz_m[shown]) if posed else extent_m
    usual = np.array(
        [np.median(of[where]) if where.any() else 0.0 for of, where in zip(sd_m.T, measured.T, strict=True)]
    )
    added = np.sqrt(np.maximum(sd_m**2 - usual**2, 0.0))
    vague = unknown(added, widest) | forgotten(shown)[:, None]
    return vague & ~measured & np.isfinite(xyz_m[..., 0])


def _with_joints(recording: Result, frames: BodyFrames) -> Result:
    """The recording with its joints, where its skeleton has some."""
    if not recording.skeleton.joints:
        return recording
    values: dict[str, Any] = joint_variables(recording.tracks, recording.skeleton, frames)
    return recording.having({"joint": [joint.name for joint in recording.skeleton.joints]}, **values)


def of_tracks(markers: MarkerTracks, skeleton: Skeleton, *, name: str, model: str) -> Result:
    """Positions as a model tracked them, of which nothing else is known: no pixels, no velocities."""
    n_frames = len(markers.t_s)
    found = Result.of(of_points(markers, skeleton, name=name)).having(
        nis=np.full(n_frames, np.nan),
        n_rows=np.zeros(n_frames, dtype=np.int64),
        log_likelihood=np.zeros(n_frames),
        repaired=np.zeros(markers.status.shape, dtype=np.int8),
        unknown=np.zeros(markers.status.shape, dtype=bool),
    )
    axes = BodyFrames(rotation=np.repeat(np.eye(3)[None], n_frames, axis=0), position_m=np.zeros((n_frames, 3)))
    found = _with_joints(found.with_motion(still(markers)), whole_frames(found) if markers.seen.any() else axes)
    return replace(found, data=found.data.assign_attrs(model=model))


def still(markers: MarkerTracks) -> Motion:
    """Markers of which no velocity is known."""
    measured = markers.status == Status.MEASURED
    return without_rates(markers.names, markers.t_s, markers.xyz_m, markers.cov_m2, measured)


def whole_frames(recording: Recording) -> BodyFrames:
    """Body frames of every frame, from the skeleton's trunk, or from all markers if none of it is seen.

    Outside the seen part they are those of its ends.
    """
    part = seen_part(recording)
    trunk = [part.names.index(name) for name in recording.skeleton.trunk if name in part.names]
    xyz_m = part.xyz_m[:, trunk] if trunk else part.xyz_m
    inner, (frames, _) = body_frames(xyz_m, dt_s=recording.dt_s), recording.place(part)
    index = np.clip(np.arange(len(recording.t_s)) - frames.start, 0, len(xyz_m) - 1)
    return BodyFrames(rotation=inner.rotation[index], position_m=inner.position_m[index])


def motion_of(
    markers: MarkerTracks, frames: slice, rates: Rates | None, rate_points: RatePoints, *, left_m_s: Array | float = 0.0
) -> Motion:
    """Velocities and joint covariances of the smoother, for the positions that were returned.

    Where the returned covariance of a marker's position is not the smoother's own (mixed and widened in gaps,
    calibration errors added), its block P is carried over as A P A' with A = C^(1/2) P^(-1/2), C the returned one,
    which keeps the correlations with other markers. Velocities keep the smoother's: an error of calibration that
    lasts moves positions alone. Where the track leaves measured points, either may be right: half of the square of
    their velocities' difference is added.

    Args:
        markers: The markers as returned.
        frames: Those that were tracked.
        rates: What the smoother knows; None: velocities are NaN.
        rate_points: Points and pairs of the whole recording.
        left_m_s: (T, M, 3) the track's velocity less that of the points that it leaves; 0 where it leaves none.
    """
    count, steps, n = len(markers.names), len(markers.t_s), len(rate_points.names)
    weights = rate_points.all_weights
    xyz = np.einsum("nm,tmi->tni", weights, np.nan_to_num(markers.xyz_m))
    uses = (weights > 0).astype(float)
    lost = np.einsum("nm,tm->tn", uses, np.isnan(markers.xyz_m[..., 0]).astype(float)) > 0.5
    other = np.einsum("nm,tm->tn", uses, (markers.status != Status.MEASURED).astype(float)) > 0.5
    xyz[lost] = np.nan
    velocity, kept = np.full((steps, n, 3), np.nan), np.ones((steps, n, 3))
    own = np.full((steps, n, 6, 6), np.nan, dtype=np.float32)
    pairs = np.array(rate_points.pairs if rates is not None else (), dtype=np.int64).reshape(-1, 2)
    cross = np.full((steps, len(pairs), 6, 6), np.nan, dtype=np.float32)
    accelerated: dict[str, Any] = {}
    if rates is not None:
        here = np.array([rate_points.names.index(name) for name in rates.rate_points.names])
        inside = np.ix_(np.arange(steps)[frames], here)
        velocity[inside], kept[inside] = rates.velocity_m_s, rates.kept
        scale = np.broadcast_to(np.eye(3), (steps, n, 3, 3)).copy()
        given = np.full((steps, n, 3, 3), np.nan)
        given[:, :count] = markers.cov_m2
        block = rates.own[..., :3, :3].astype(float)
        scale[inside] = _scales(given[inside], block)
        mine = np.einsum("nm,tm->tn", weights**2, np.nan_to_num(np.trace(scale[:, :count], axis1=-2, axis2=-1) / 3))
        means = mine[:, count:] / np.sum(weights[count:] ** 2, axis=1)
        scale[:, count:] = means[..., None, None] * np.eye(3)
        done = _carried(scale[inside], rates.own, scale[inside])
        own[inside] = 0.5 * (done + np.swapaxes(done, -1, -2))  # products in single precision are skew by 1e-6
        column = {pair: i for i, pair in enumerate(map(tuple, pairs.tolist()))}
        for i, (a, b) in enumerate(rates.rate_points.pairs):
            pair, turned = (int(here[a]), int(here[b])), False
            if pair not in column:
                pair, turned = pair[::-1], True
            found = rates.cross[:, i]
            one, two = scale[frames, here[a]], scale[frames, here[b]]
            done = _carried(one, found, two)
            cross[frames, column[pair]] = np.swapaxes(done, 1, 2) if turned else done
        left = left_m_s * np.ones((steps, count, 3))
        own[..., 3:, 3:] += 0.5 * np.einsum("nm,tmi,tmj->tnij", weights**2, left, left, optimize=True)
        velocity[lost] = np.nan
        if rates.acceleration_m_s2 is not None and rates.acceleration_cov is not None:
            acceleration = np.full((steps, n, 3), np.nan)
            spread = np.full((steps, n, 3, 3), np.nan, dtype=np.float32)
            acceleration[inside], spread[inside] = rates.acceleration_m_s2, rates.acceleration_cov
            acceleration[lost], spread[lost] = np.nan, np.nan
            accelerated = {"acceleration_m_s2": acceleration, "acceleration_cov": spread}
    return Motion(
        names=rate_points.names,
        t_s=markers.t_s,
        xyz_m=xyz,
        velocity_m_s=velocity,
        own=own,
        pairs=pairs,
        cross=cross,
        kept=kept,
        measured=~other & ~lost,
        **accelerated,
    )


def _scales(before: Array, smoothed: Array) -> Array:
    """(..., 3, 3) A = C^(1/2) P^(-1/2); 1 where either is unknown."""
    finite = np.asarray(np.isfinite(before + smoothed).all(axis=(-2, -1)))
    unit = np.eye(3)
    c, p = np.where(finite[..., None, None], before, unit), np.where(finite[..., None, None], smoothed, unit)
    return _power(c, 0.5) @ _power(p, -0.5)


def _power(matrix: Array, power: float) -> Array:
    value, vectors = np.linalg.eigh(matrix)
    value = np.maximum(value, 1e-18)
    return (vectors * value[..., None, :] ** power) @ np.swapaxes(vectors, -1, -2)


def _carried(left: Array, block: np.ndarray, right: Array) -> np.ndarray:
    """(..., 6, 6) blocks with the position of both sides scaled."""
    done = block.copy()
    done[..., :3, :] = left.astype(np.float32) @ done[..., :3, :]
    done[..., :3] = done[..., :3] @ np.swapaxes(right.astype(np.float32), -1, -2)
    return done


def moved(recording: Recording, xyz_m: Array, cov_m2: Array) -> tuple[Array, Mask]:
    """How (T, M, 3) positions with their (T, M, 3, 3) covariance lie from the measured ones, NaN without one.

    (T, M, 3) metres from the points of the believed clicks, or the positions of the file; and whether their length is
    more than ``FAR`` standard deviations.

    The distance of a measurement from its estimate has at most the covariance of both together; its deviation here is
    the root mean square over the three coordinates.
    """
    off = xyz_m - recording.xyz_m
    return off, beyond(off, cov_m2 + recording.cov_m2)


def moved_report(recording: Recording, markers: MarkerTracks) -> dict[str, object]:
    """Median, 90 % and largest distance in mm of all that was measured and believed, and where the largest is."""
    off_m, far = moved(recording, markers.xyz_m, markers.cov_m2)
    distance_m = np.linalg.norm(off_m, axis=-1)
    rejected = np.any(list(recording.rejected.values()), axis=0)
    far &= (markers.status == Status.REJECTED) & ~rejected
    compared = ((markers.status == Status.MEASURED) | far) & np.isfinite(distance_m)
    if not compared.any():
        return {"median_mm": None, "90%_mm": None, "largest": None, "beyond_3_sd": 0, "samples": []}
    distance = np.where(compared, 1e3 * distance_m, -1.0)
    frame, marker = (int(i) for i in np.unravel_index(np.argmax(distance), distance.shape))
    return {
        "median_mm": float(np.median(distance[compared])),
        "90%_mm": float(np.quantile(distance[compared], 0.9)),
        "largest": {"frame": frame + 1, "marker": markers.names[marker], "mm": float(distance[frame, marker])},
        "beyond_3_sd": int(far.sum()),
        "samples": [
            {"frame": int(t) + 1, "marker": markers.names[m], "mm": float(distance[t, m])} for t, m in np.argwhere(far)
        ],
    }


def jump_cov(jumps: Sequence[Jump], xyz_m: Array, origin: NDArray[np.int8]) -> Array:
    """(T, M, 3, 3) covariance of what was filled across a jump, from the last believed sample to the next.

    The marker is at one place or at the other, d apart: half of that either way, a covariance of d d^T / 4.

    Args:
        jumps: Of the recording.
        xyz_m: (T, M, 3) positions of the track.
        origin: (T, M) origin of each sample.
    """
    out = np.zeros((*origin.shape, 3, 3))
    for jump in jumps:
        believed = np.flatnonzero(origin[:, jump.marker] == Status.MEASURED)
        before, after = believed[believed < jump.frames[1]], believed[believed >= jump.frames[1]]
        if len(before) and len(after):
            far = (xyz_m[after[0], jump.marker] - xyz_m[before[-1], jump.marker]) / 2
            out[before[-1] + 1 : after[0], jump.marker] += np.outer(far, far)
    return out


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
