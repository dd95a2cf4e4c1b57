"""Clean a recording: what a tracker is given, with every sample that is not believed marked."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap import audit
from mocap.calibration.lens_of_tracks import lens_covariance, moved_by_lens
from mocap.cameras import triangulate
from mocap.cleaning.bias import lasting_bias, persistent_px, ray_bias
from mocap.cleaning.camera_health import camera_health, shifted_back
from mocap.cleaning.clean import clean as cleaned_positions
from mocap.cleaning.clean import position_sd
from mocap.cleaning.click_noise import LEAST_PX, click_noise, student_t
from mocap.cleaning.likelihoods import weighed_clicks
from mocap.cleaning.swap_states import names_put_right
from mocap.cleaning.swaps import DOUBTFUL, exchange, exchanged_markers, exchanged_samples, without_edited
from mocap.errors import CalibrationError, FormatError
from mocap.filters.anatomy import ends_among
from mocap.findings import Finding
from mocap.io.deeplabcut import LEAST_LIKELIHOOD
from mocap.pipeline import sentences
from mocap.pipeline.by_hand import with_hand
from mocap.pipeline.ideal_pixels import with_rays, without_hand
from mocap.pipeline.recording import Recording, as_recording
from mocap.records import Plane, Status
from mocap.skeleton import Measures, Skeleton


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
        found = _in_plane(recording) if recording.planar else recording
        if found.points is None:
            raise FormatError(
                f"{recording.where}: contains no tracks ({recording.format}): give a file of pixels or positions"
            )
        if not found.points.seen.any():
            raise FormatError(f"{recording.where}: no marker is ever seen: there is nothing to track")
        done = _positions(found, first)
    else:
        done = _film(without_hand(with_rays(recording)), first)
        done = with_hand(done, recording, first=first)
    exchanged = np.any(list(exchanged_samples(done.xyz_m.shape[:2], done.swaps).values()), axis=0)
    return done.having(repaired=np.where(done.edited, 2, exchanged).astype(np.int8))


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


def _in_plane(recording: Recording) -> Recording:
    """One video without a calibration: positions in its image, in the axes of the file; third coordinates are 0."""
    pixels, likelihood, own = recording.pixels, recording.score, recording.skeleton
    assert pixels is not None
    plane, uv, unlikely = Plane(mm_per_px=recording.mm_per_px), pixels.uv_px[0], np.zeros_like(pixels.seen[0])
    if likelihood is not None and likelihood.shape == pixels.seen.shape:
        # without a second camera nothing tells what a likelihood is worth
        unlikely = pixels.seen[0] & (likelihood[0] < LEAST_LIKELIHOOD)
        uv = np.where(unlikely[..., None], np.nan, uv)
    flat = np.where(np.isfinite(uv[..., :1]), 0.0, np.nan)
    xyz = plane.unit_m * np.concatenate([uv, flat], axis=-1)
    found = recording.having(position=xyz, covariance=np.full((*xyz.shape, 3), np.nan), status=_status(xyz, ()))
    measures = bool(own.bones or own.joints or own.measures != Measures())
    how, *unused = sentences.in_plane(plane, measures=measures)
    findings = how, *sentences.unlikely_clicks(unlikely, pixels.seen, LEAST_LIKELIHOOD), *unused
    skeleton = replace(own, bones=(), joints=(), measures=Measures())
    return replace(found, skeleton=skeleton, plane=plane, findings=(*recording.findings, *findings))


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
    stale, findings = audit_points(film)
    matrices, ideal = film.matrices, film.ideal_px
    likely, unlikely, relative = weighed_clicks(matrices, ideal, film.score)
    ideal = np.where(unlikely[..., None], np.nan, ideal)
    health = camera_health(matrices, ideal)
    ideal, worse = shifted_back(ideal, health), health.factor[..., None] * relative
    found = triangulate.robust(matrices, ideal, least_px=film.pixel_sd, relative=worse)
    shown = found.shown_px
    ideal, found, swaps, doubtful, ambiguous, worse = names_put_right(
        matrices, ideal, found, bones=_rigid(skeleton, names), edited=film.edited, relative=worse
    )
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
    audited = audit.audit_filmed(film.cameras, pixels, ideal, rows, named_px=film.ideal_px, first=first)
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
        ideal=ideal,
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
        readings=(),
        findings=(
            *sentences.contradiction(pixel_sd, low_px=bias.jitter_px, high_px=shown),
            *film.readings,
            *film.findings,
            *(f for f in audited if f.alarm or f.kind == "mirrored world"),
            *lens,
            *sentences.late_cameras(cameras, film.late_frames),
            *findings,
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


def _positions(recording: Recording, first: int) -> Recording:
    """Positions, of which the noise is estimated where no covariance states it."""
    tracks, names, plane, skeleton = recording.tracks, recording.names, recording.plane, recording.skeleton
    sd = np.maximum(np.where(tracks.sd_m > 0, tracks.sd_m, position_sd(tracks.xyz_m)), 1e-6)  # whatever a file says
    named = exchanged_markers(tracks.xyz_m, _rigid(skeleton, names))
    swaps, _ = without_edited(named.swaps, recording.edited)
    xyz, sd = exchange(tracks.xyz_m, swaps), exchange(sd, swaps)
    doubtful = named.unsure & ~recording.edited
    xyz = np.where(doubtful[..., None], np.nan, xyz)
    length = "mm" if plane is None else plane.length
    odd = audit.point_findings(tracks, first=first, measured=plane is None)  # as the file has them
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
            *odd,
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
