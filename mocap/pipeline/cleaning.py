"""Clean a recording: what a tracker is given, with every sample that is not believed marked."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap import audit
from mocap.calibration.lens_of_tracks import lens_covariance, lens_of_tracks, moved_by_lens
from mocap.cameras import origin, triangulate
from mocap.cameras.camera import Camera, scaled, stacked
from mocap.cleaning.bias import lasting_bias, persistent_px, ray_bias
from mocap.cleaning.camera_health import camera_health, shifted_back
from mocap.cleaning.clean import clean as cleaned_positions
from mocap.cleaning.clean import position_sd
from mocap.cleaning.click_noise import LEAST_PX, click_noise, student_t
from mocap.cleaning.likelihoods import LikelihoodNoise, likelihood_noise
from mocap.cleaning.swap_states import CAMERAS, mixed, settle_all
from mocap.cleaning.swapped_rays import exchange_rays, exchanged_rays, extent_px
from mocap.cleaning.swaps import DOUBTFUL, Swap, exchange, exchanged_markers, without_edited
from mocap.errors import CalibrationError, FormatError
from mocap.filters.anatomy import ends_among
from mocap.findings import Finding
from mocap.io.optical import UNIT_M
from mocap.io.unstated_unit import of_cameras
from mocap.pipeline import sentences
from mocap.pipeline.arrays import as_recording
from mocap.pipeline.by_hand import with_hand, without_hand
from mocap.pipeline.recording import Recording
from mocap.records import MarkerTracks, Plane, Status, marker_tracks
from mocap.skeleton import Measures, Skeleton

LEAST_LIKELIHOOD = 0.6
"""Clicks below are rejected: without a second camera nothing tells what a likelihood is worth (DeepLabCut's cutoff)."""


def clean(recording: Recording, *, first: int = 0) -> Recording:
    """The same recording, cleaned: positions with their noise, and a reason for every sample that is not believed.

    Pixels are undistorted and triangulated, exchanged names put right, jumps and rays that miss rejected, slowly
    varying errors taken out, the noise of each camera, marker and click estimated. ``data`` then has the variables
    that ``mocap.pipeline.variables`` declares since ``clean``, ``status`` says which samples were rejected,
    ``findings`` what was found. ``mocap.track`` does this itself with what is not cleaned.

    Args:
        recording: As ``mocap.read`` or ``mocap.from_arrays`` gives it.
        first: Frames of a longer recording before these.

    Raises:
        MocapError: whatever makes that impossible, with what to do.
    """
    recording = as_recording(recording, "clean")
    if recording.cleaned:
        return recording
    if recording.planar or not recording.filmed:
        found, points = _in_plane(recording) if recording.planar else (recording, recording.points)
        if points is None:
            raise FormatError(
                f"{recording.where}: contains no tracks ({recording.format}): give a file of pixels or positions"
            )
        if not points.seen.any():
            raise FormatError(f"{recording.where}: no marker is ever seen: there is nothing to track")
        return _positions(found, points, first)
    done = _film(with_ideal_pixels(without_hand(recording)), first)
    return with_hand(done, recording, first=first)


def with_ideal_pixels(recording: Recording, *, iterations: int | None = None, find_unit: bool = True) -> Recording:
    """Decide where pixels are counted from, and take out lenses and lags.

    Args:
        recording: With cameras.
        iterations: As in ``BrownLens.undistort``: 3 is what DLTdv does.
        find_unit: Whether the unit of a calibration that nobody states is chosen by the animal's length.

    Raises:
        FormatError: it contains no pixels, nothing is seen, or no unit makes it an animal.
        CalibrationError: pixels and coefficients do not belong together, or no sample is seen by two cameras.
    """
    if recording.rows is not None:
        return recording
    found = _undistorted(recording, _pixels_of(recording), iterations)
    if not find_unit or (recording.unit or recording.data.attrs.get("space_unit")) is not None:
        return found
    unit, said = of_cameras(found.matrices, found.ideal_px, where=recording.calibration or recording.where)
    if unit != "m":
        recording = replace(recording, unit=unit, cameras=scaled(recording.cameras, UNIT_M[unit]))
        found = _undistorted(recording, _pixels_of(recording), iterations)
    return replace(found, told=(*said, *found.told))


def _pixels_of(recording: Recording) -> Array:
    """(C, T, M, 2) pixels of two or more calibrated cameras, of which two see something at once."""
    where, pixels = recording.where, recording.pixels
    if pixels is None:
        raise FormatError(
            f"{where}: contains positions ({recording.format}), not pixels: give the file of pixels "
            "(2D), or leave the calibration out"
        )
    if not recording.cameras:
        project = recording.format == "dltdv-project"
        what = "a project without DLT coefficients" if project else "contains pixels without a calibration"
        raise CalibrationError(f"{where}: {what}: calibrate, or give `calibration`")
    if len(pixels.cameras) < 2:
        raise CalibrationError(
            f"{where}: contains one camera: 3D points need two or more views in one file, or a model of the "
            "animal from recordings with more (mocap learn): give `model`"
        )
    if not pixels.seen.any():
        raise FormatError(f"{where}: no marker is ever seen: there is nothing to track; digitise first")
    if not (pixels.seen.sum(axis=0) >= 2).any():
        raise CalibrationError(f"{where}: no marker is seen by two cameras at once: no point can be triangulated")
    return pixels.uv_px


def _undistorted(recording: Recording, uv_px: Array, iterations: int | None) -> Recording:
    cameras = recording.cameras

    def decided(uv_px: Array) -> origin.PixelOrigin:
        return origin.decide_origin(
            cameras,
            uv_px,
            origin=recording.pixel_origin,
            coefficients=recording.calibration_origin,
            height_px=recording.image_height_px,
            usual=recording.usual_origin,
        )

    try:
        rows = _decided_apart(uv_px, cameras, decided, correct_lag=recording.correct_lag)
    except CalibrationError as error:
        error.args = (f"{recording.where}: {error}",)
        raise
    ideal, told, lens, late = rows.ideal(cameras, uv_px, iterations=iterations), recording.told, None, None
    if recording.fit_lens:
        if any(c.lens is not None for c in cameras):
            raise CalibrationError("`fit_lens`: the cameras have lenses already: leave it out, or leave the lenses out")
        lens = lens_of_tracks(cameras, ideal)
        ideal = lens.straight(ideal)
        told += (sentences.estimated_lens(lens),)
    if recording.correct_lag and (lags := audit.estimate_offsets(stacked(cameras), ideal)) is not None:
        late = audit.late_cameras(lags)
        ideal = audit.in_step(ideal, late)
    found = recording.having(ideal=ideal) if late is None else recording.having(ideal=ideal, late=late)
    return replace(found, rows=rows, lens=lens, told=told)


def _decided_apart(
    uv_px: Array, cameras: Sequence[Camera], decided: Callable[[Array], origin.PixelOrigin], *, correct_lag: bool
) -> origin.PixelOrigin:
    """The decision on the pixel origin, also of cameras that start apart, where that is asked to be corrected.

    Raises:
        CalibrationError: pixels and coefficients do not belong together; if they do where cameras start at once, it
            says by how much they do not.
    """
    try:
        return decided(uv_px)
    except CalibrationError as error:
        start = audit.start_offsets(stacked(cameras), uv_px)[0]  # lenses move pixels by less than motion does
        if not start.any():
            raise
        with suppress(CalibrationError):  # what was not the cause is not named
            found = decided(audit.moved(uv_px, start))
            if correct_lag:
                return found
            each = ", ".join(f"{c.name} {late:+.0f}" for c, late in zip(cameras, start, strict=True))
            error.args = (f"the cameras start apart, by {each} frames: give `correct_lag`",)
        raise


def by_pixels(recording: Recording, relative: Array | float = 1.0) -> tuple[float, float | None]:
    """What rays show of the pixel noise, and the deviation to reject by: never below that, whatever is stated.

    Args:
        recording: With ideal pixels; where nobody states a deviation, ``triangulate.robust`` finds its own (None).
        relative: Deviations of rays relative to it, broadcastable to (C, T, M).
    """
    if recording.pixel_sd is None:
        return np.nan, None
    shown = triangulate.apparent_sd(recording.matrices, recording.ideal_px, relative=np.asarray(relative))
    return shown, max(recording.pixel_sd, shown)


def audit_points(recording: Recording) -> tuple[tuple[audit.StalePoint, ...] | None, list[Finding]]:
    """Compare stored points with those that DLTdv's own triangulation gives, before anything is cleaned."""
    beside, pixels = recording.stored, recording.pixels
    if beside is None or pixels is None or recording.rows is None:
        return None, []
    where = beside.paths[0].name
    stored = (beside if recording.unit is None else beside.with_unit(recording.unit)).points
    if stored is None:
        return None, [sentences.stored_points(f"{where} was not compared: it contains no positions ({beside.format})")]
    ideal = recording.rows.ideal(recording.cameras, pixels.uv_px, iterations=3)
    if not stored.seen.any():
        return None, []
    xyz = triangulate.linear(recording.matrices, ideal)
    elsewhere = audit.other_world(xyz, stored) if xyz.shape == stored.xyz_m.shape else None
    if elsewhere is not None:
        return None, [sentences.stored_points(f"{where}: {elsewhere.text}")]
    try:
        stale = audit.stale_points(xyz, stored)
    except ValueError as error:
        return None, [sentences.stored_points(f"{where} was not compared: {error}")]
    return tuple(stale), [sentences.compared_points(where, stale, int(stored.seen.sum()))]


def _in_plane(recording: Recording) -> tuple[Recording, MarkerTracks]:
    """One video without a calibration: positions in its image, in the axes of the file; third coordinates are 0."""
    pixels, likelihood, known = recording.pixels, recording.score, recording.skeleton
    assert pixels is not None
    plane, uv, unlikely = Plane(mm_per_px=recording.mm_per_px), pixels.uv_px[0], np.zeros_like(pixels.seen[0])
    if likelihood is not None and likelihood.shape == pixels.seen.shape:
        unlikely = pixels.seen[0] & (likelihood[0] < LEAST_LIKELIHOOD)
        uv = np.where(unlikely[..., None], np.nan, uv)
    flat = np.where(np.isfinite(uv[..., :1]), 0.0, np.nan)
    tracks = marker_tracks(pixels.names, pixels.t_s, plane.unit_m * np.concatenate([uv, flat], axis=-1))
    measures = bool(known.bones or known.joints or known.measures != Measures())
    how, *unused = sentences.in_plane(plane, measures=measures)
    told = how, *sentences.unlikely_clicks(unlikely, pixels.seen, LEAST_LIKELIHOOD), *unused
    skeleton = replace(known, bones=(), joints=(), measures=Measures())
    return replace(recording, skeleton=skeleton, plane=plane, findings=(*recording.findings, *told)), tracks


def _status(xyz_m: Array, rejected: Sequence[NDArray[np.bool_]]) -> NDArray[np.int8]:
    """(T, M) measured, rejected or missing."""
    gone = np.where(np.any(list(rejected), axis=0), Status.REJECTED, Status.MISSING)
    return np.where(np.isfinite(xyz_m[..., 0]), Status.MEASURED, gone).astype(np.int8)


def _film(recording: Recording, first: int) -> Recording:
    """Pixels of calibrated cameras: triangulated, names, rays and jumps judged, slow errors out, noise estimated.

    Raises:
        CalibrationError: no sample is believed.
    """
    film, skeleton, names, t_s, pixels = recording, recording.skeleton, recording.names, recording.t_s, recording.pixels
    assert pixels is not None  # they were undistorted
    rows = film.rows
    assert rows is not None  # so that this was decided
    stale, told = audit_points(film)
    likely, unlikely, relative = _by_likelihood(film)
    film = film.having(ideal=np.where(unlikely[..., None], np.nan, film.ideal_px))
    health = camera_health(film.matrices, film.ideal_px)
    worse = health.factor[..., None] * relative
    film = film.having(ideal=shifted_back(film.ideal_px, health))
    shown, gate = by_pixels(film, worse)
    found = triangulate.robust(film.matrices, film.ideal_px, sd_px=gate, relative=worse)
    film, found, swaps, doubtful, ambiguous, worse = _names_put_right(film, found, skeleton, names, worse)
    matrices, ideal = film.matrices, film.ideal_px
    sd = np.sqrt(np.trace(found.cov_m2, axis1=-2, axis2=-1) / 3)
    xyz = np.where(doubtful[..., None], np.nan, found.xyz_m)
    cleaning = cleaned_positions(xyz, sd, t_s, skeleton, names, certain=film.edited)
    uv = np.where((found.rejected | cleaning.any | doubtful)[..., None], np.nan, ideal)
    if not (np.isfinite(uv[..., 0]).sum(axis=0) >= 2).any():
        raise CalibrationError(
            f"{recording.where}: every sample was rejected because the rays of the cameras do not intersect: "
            "check that coefficients, profile and pixels belong together"
        )
    lasting = persistent_px(matrices, uv, found.xyz_m, relative=worse)
    audited = audit.audit_filmed(film.cameras, pixels, ideal, rows, first=first)
    lens_cov, lens = _lens_uncertainty(film, audited, uv)
    bias = ray_bias(matrices, uv, dt_s=film.dt_s, relative=worse)
    bias = replace(bias, jitter_px=max(bias.jitter_px, LEAST_PX))
    uv = uv - bias.bias_px
    start = triangulate.linear(matrices, uv, relative=worse)
    noise = click_noise(matrices, uv, start, relative=worse)
    xyz, cov, ray_sd, ray_scale = student_t(matrices, uv, start, sd_px=bias.jitter_px, relative=worse, noise=noise)
    pixel_sd = film.pixel_sd
    ratio = 1.0 if pixel_sd is None else pixel_sd / bias.jitter_px
    pointless = np.isnan(found.xyz_m[..., 0])
    lost = found.rejected.any(axis=0) & pointless
    apart = found.rejected & lost & ~doubtful
    uv = np.where(apart[..., None], ideal - lasting_bias(bias.bias_px, uv), uv)
    unsure = unlikely.any(axis=0) & pointless & ~lost
    cameras, clicks = [c.name for c in film.cameras], int(ambiguous.sum())
    rejected = {"rays_miss": lost, "likelihood": unsure, **dict.fromkeys(DOUBTFUL, doubtful), **cleaning.rejected}
    with_lens = {} if lens_cov is None else {"lens_covariance": lens_cov}
    done = film.having(
        rejected=rejected,
        position=xyz,
        covariance=cov * ratio**2,
        status=_status(xyz, list(rejected.values())),
        believed=uv,
        ray_sd=ray_sd * ratio,
        ray_scale=ray_scale * ratio,
        ray_rejected=found.rejected | unlikely | ambiguous,
        residual=found.residual_px,
        most_speed=cleaning.max_speed_m_s,
        persistent=lasting,
        camera_factor=health.factor,
        **with_lens,
    )
    return replace(
        done,
        cleaned=True,
        jitter_px=pixel_sd or bias.jitter_px,
        bias_px=bias.sd_px,
        stated_over_shown=ratio,
        noise=noise,
        bad_cameras=health.bad,
        swaps=swaps,
        stale=stale,
        audited=tuple(audited),
        told=(),
        findings=(
            *film.told,
            *film.findings,
            *sentences.contradiction(pixel_sd, low_px=bias.jitter_px, high_px=shown),
            sentences.pixel_origin(rows),
            *(f for f in audited if f.alarm or f.kind == "mirrored world"),
            *lens,
            *sentences.late_cameras(cameras, film.late_frames),
            *told,
            *sentences.slow_errors(bias, lens_stays=bool(lens)),
            *sentences.likelihood_findings(likely, film.score is not None, int(unlikely.sum()), int(unsure.sum())),
            *sentences.camera_findings(health, cameras, first=first),
            *sentences.never_seen(xyz, names),
            *sentences.never_together(xyz),
            *sentences.exchange_findings(swaps, doubtful, names, cameras, clicks=clicks, first=first),
            *sentences.rejected("rays_miss", lost),
            *(f for reason, mask in cleaning.rejected.items() for f in sentences.rejected(reason, mask, names)),
        ),
    )


def _lens_uncertainty(film: Recording, audited: list[Finding], uv_px: Array) -> tuple[Array | None, list[Finding]]:
    """(T, M, 3, 3) covariance of points, and findings; None where lenses are given, or nothing speaks of one.

    Of a lens that was estimated it follows from the covariance of its coefficients. One that the audit sees and nobody
    corrected moves each point by d: it is counted as an error with the covariance d d^T, which no frame averages out.

    Args:
        film: With ideal pixels.
        audited: Findings, from which those of a lens are removed once it was estimated.
        uv_px: (C, T, M, 2) believed ideal pixels.
    """
    if film.lens is not None:
        audited[:] = [f for f in audited if not (f.kind == "distortion" and f.alarm)]
        each = zip(film.lens.lenses, film.lens.k1, uv_px, strict=True)
        bent = np.stack([replace(lens, k=(float(k1), 0.0, 0.0)).distort(uv) for lens, k1, uv in each])  # as before it
        return lens_covariance(film.cameras, film.lens, bent), []
    seen = [f for f in audited if f.kind == "distortion" and f.alarm and "k1" in f.numbers]
    if not seen:
        return None, []
    moved = moved_by_lens(film.cameras, uv_px, float(seen[0].numbers["k1"]))
    far = 1e3 * np.linalg.norm(moved, axis=-1)
    far = far[np.isfinite(far)]
    if not len(far):
        return None, []
    return moved[..., :, None] * moved[..., None, :], [sentences.lens_left(far)]


def _by_likelihood(film: Recording) -> tuple[LikelihoodNoise | None, NDArray[np.bool_], Array]:
    """What likelihoods are worth; (C, T, M) clicks that are not believed, and deviations relative to a usual click."""
    shape, likelihood = film.ideal_px.shape[:3], film.score
    found = None if likelihood is None else likelihood_noise(film.matrices, film.ideal_px, likelihood)
    if found is None or likelihood is None:
        return None, np.zeros(shape, dtype=bool), np.ones(shape)
    unlikely = np.isfinite(film.ideal_px[..., 0]) & ~found.believed(likelihood)
    return found, unlikely, found.factors(likelihood)


def _positions(recording: Recording, tracks: MarkerTracks, first: int) -> Recording:
    """Positions, of which the noise is estimated where no covariance states it."""
    names, plane, skeleton = tracks.names, recording.plane, recording.skeleton
    sd = np.maximum(np.where(tracks.sd_m > 0, tracks.sd_m, position_sd(tracks)), 1e-6)  # whatever a file says
    named = exchanged_markers(tracks.xyz_m, _rigid(skeleton, names))
    swaps, _ = without_edited(named.swaps, recording.edited)
    xyz, sd = exchange(tracks.xyz_m, swaps), exchange(sd, swaps)
    doubtful = named.unsure & ~recording.edited
    xyz = np.where(doubtful[..., None], np.nan, xyz)
    length = "mm" if plane is None else plane.length
    jumps = tuple(audit.jump_findings(xyz, tracks.t_s, names, first=first, length=length))
    cleaning = cleaned_positions(xyz, sd, tracks.t_s, skeleton, names, certain=recording.edited)
    xyz = np.where(cleaning.any[..., None], np.nan, xyz)
    nowhere = np.zeros(xyz.shape[:2], dtype=bool)
    rejected = {"rays_miss": nowhere, **dict.fromkeys(DOUBTFUL, doubtful), **cleaning.rejected}
    done = recording.having(
        rejected=rejected,
        position=xyz,
        covariance=np.where(np.isfinite(xyz[..., 0]), sd, np.nan)[..., None, None] ** 2 * np.eye(3),
        status=_status(xyz, list(rejected.values())),
        most_speed=cleaning.max_speed_m_s,
    )
    return replace(
        done,
        cleaned=True,
        cameras=(),
        swaps=tuple(swaps),
        audited=jumps,
        findings=(
            *recording.findings,
            sentences.position_noise(sd[tracks.seen], plane),
            *jumps,
            *sentences.exchange_findings(swaps, doubtful, names, (), first=first),
            *(f for reason, mask in cleaning.rejected.items() for f in sentences.rejected(reason, mask, names)),
            *sentences.never_seen(xyz, names, plane),
            *sentences.never_together(xyz),
        ),
    )


def _rigid(skeleton: Skeleton, names: Sequence[str]) -> NDArray[np.int64]:
    """(B, 2) markers of the rigid bones."""
    return np.array(ends_among(names, skeleton.rigid), dtype=np.int64).reshape(-1, 2)


def _names_put_right(
    film: Recording, found: triangulate.Triangulation, skeleton: Skeleton, names: Sequence[str], relative: Array
) -> tuple[Recording, triangulate.Triangulation, tuple[Swap, ...], NDArray[np.bool_], NDArray[np.bool_], Array]:
    """Undo exchanges of names in single cameras, then in all.

    Up to ``CAMERAS`` cameras a single ray says little: there exchanges are proposals, of which a model of all cameras'
    states decides.

    Returns:
        The pixels without ambiguous ones; their points; runs of frames that were undone; (T, M) samples and (C, T, M)
        clicks that may be of either of two markers; and the deviations of rays, exchanged as the rays are.
    """
    matrices, uv = film.matrices, film.ideal_px
    rays = exchanged_rays(matrices, uv, found, relative=relative)
    ambiguous = np.zeros(uv.shape[:3], dtype=bool)
    few = len(uv) <= CAMERAS
    if rays and few:
        settled = settle_all(matrices, uv, rays, sd_px=found.sd_px, relative=relative, extent_px=extent_px(uv))
        uv, relative, rays, ambiguous = settled
        ambiguous &= np.isfinite(uv[..., 0]) & ~film.edited
        uv = np.where(ambiguous[..., None], np.nan, uv)
    elif rays:
        uv, relative = exchange_rays(uv, rays), exchange_rays(relative, rays)
    rays, undone = without_edited(rays, film.edited)
    uv, relative = exchange_rays(uv, undone), exchange_rays(relative, undone)
    if rays or ambiguous.any():
        found = triangulate.robust(matrices, uv, sd_px=found.sd_px, relative=relative)
    doubtful = ambiguous.any(axis=0) & np.isnan(found.xyz_m[..., 0])
    points = exchanged_markers(found.xyz_m, _rigid(skeleton, names))
    swaps, _ = without_edited(points.swaps, film.edited)
    swaps = [swap for swap in swaps if not (few and mixed(swap, rays, ambiguous))]
    if swaps:
        uv, relative = exchange_rays(uv, swaps), exchange_rays(relative, swaps)
        found = replace(
            found,
            xyz_m=exchange(found.xyz_m, swaps),
            cov_m2=exchange(found.cov_m2, swaps),
            residual_px=exchange(found.residual_px, swaps),
            rejected=exchange_rays(found.rejected, swaps),
        )
    doubtful = (points.unsure & ~film.edited) | (exchange(doubtful.astype(float), swaps) > 0)
    return film.having(ideal=uv), found, (*rays, *swaps), doubtful, ambiguous, relative
