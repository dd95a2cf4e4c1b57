"""Clean a recording: what a tracker is given, with every sample that is not believed marked."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap import audit
from mocap.cameras import triangulate
from mocap.cameras.lens_of_tracks import lens_covariance, moved_by_lens
from mocap.cleaning import sentences
from mocap.cleaning.bias import lasting_bias, persistent_px, ray_bias
from mocap.cleaning.by_hand import with_hand
from mocap.cleaning.camera_health import camera_health, shifted_back
from mocap.cleaning.cleaned import Cleaned, written
from mocap.cleaning.click_noise import LEAST_PX, click_noise, student_t
from mocap.cleaning.likelihoods import weighed_clicks
from mocap.cleaning.positions import clean as cleaned_positions
from mocap.cleaning.positions import position_sd
from mocap.cleaning.swap_states import names_put_right
from mocap.cleaning.swaps import DOUBTFUL, exchange, exchanged_markers, without_edited
from mocap.errors import CalibrationError, FormatError
from mocap.filters.anatomy import ends_among
from mocap.findings import Finding, Kind
from mocap.reading.decided import decided
from mocap.reading.ideal_pixels import with_rays, without_hand
from mocap.recording import Recording, as_recording
from mocap.records import LEAST_LIKELIHOOD, Status
from mocap.skeleton import Measures, Skeleton


def clean(recording: Recording, *, first: int = 0) -> Recording:
    """The same recording, cleaned: positions with their noise, and a reason for every sample that is not believed.

    Pixels are undistorted and triangulated, exchanged names put right, jumps and rays that miss rejected, slowly
    varying errors taken out, the noise of each camera, marker and click estimated. ``data`` then has the variables
    that ``mocap.variables`` declares since ``clean``, ``status`` says which samples were rejected,
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
        found, told = _in_plane(recording) if recording.planar else (recording, ())
        if found.points is None:
            raise FormatError(
                f"{recording.where}: contains no tracks ({recording.format}): give a file of pixels or positions"
            )
        if not found.points.seen.any():
            raise FormatError(f"{recording.where}: no marker is ever seen: there is nothing to track")
        return _positions(found, told, first)
    return with_hand(_film(without_hand(with_rays(recording)), first), recording, first=first)


def audit_points(recording: Recording) -> tuple[tuple[audit.StalePoint, ...] | None, list[Finding]]:
    """Compare stored points with those that DLTdv's own triangulation gives, before anything is cleaned."""
    how, pixels = decided(recording), recording.pixels
    rows, beside = how.rows, how.beside
    if beside is None or pixels is None or rows is None:
        return None, []
    where = beside.paths[0].name
    told = how.unit_from == "stated" or (how.unit_from == "assumed" and how.unit != "m")
    stored = (beside.with_unit(how.unit) if told and how.unit else beside).points
    if stored is None:
        return None, [sentences.stored_points(f"{where} was not compared: it contains no positions ({beside.format})")]
    ideal = rows.ideal(recording.cameras, pixels.uv_px, iterations=3)
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


def _in_plane(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """One video without a calibration: positions in its image, in the axes of the file; third coordinates are 0.

    And how it was read.
    """
    pixels, likelihood, own = recording.pixels, recording.score, recording.skeleton
    assert pixels is not None
    assert recording.plane is not None
    plane, uv, unlikely = recording.plane, pixels.uv_px[0], np.zeros_like(pixels.seen[0])
    if likelihood is not None and likelihood.shape == pixels.seen.shape:
        # without a second camera nothing tells what a likelihood is worth
        unlikely = pixels.seen[0] & (likelihood[0] < LEAST_LIKELIHOOD)
        uv = np.where(unlikely[..., None], np.nan, uv)
    flat = np.where(np.isfinite(uv[..., :1]), 0.0, np.nan)
    xyz = plane.unit_m * np.concatenate([uv, flat], axis=-1)
    status = np.where(np.isfinite(xyz[..., 0]), Status.MEASURED, Status.MISSING).astype(np.int8)
    found = recording.having(position=xyz, covariance=np.full((*xyz.shape, 3), np.nan), status=status)
    measures = bool(own.bones or own.joints or own.measures != Measures())
    how, *unused = sentences.in_plane(plane, measures=measures)
    findings = how, *sentences.unlikely_clicks(unlikely, pixels.seen, LEAST_LIKELIHOOD), *unused
    skeleton = replace(own, bones=(), joints=(), measures=Measures())
    return replace(found, skeleton=skeleton), findings


def _film(recording: Recording, first: int) -> Recording:
    """Pixels of calibrated cameras: triangulated, names, rays and jumps judged, slow errors out, noise estimated.

    Raises:
        CalibrationError: no sample is believed.
    """
    film, skeleton, names, t_s, pixels = recording, recording.skeleton, recording.names, recording.t_s, recording.pixels
    assert pixels is not None  # they were undistorted
    how, pixel_sd = decided(film), film.source.pixel_sd
    rows = how.rows
    assert rows is not None  # so that this was decided
    stale, findings = audit_points(film)
    matrices, ideal = film.matrices, film.ideal_px
    likely, unlikely, relative = weighed_clicks(matrices, ideal, film.score)
    ideal = np.where(unlikely[..., None], np.nan, ideal)
    health = camera_health(matrices, ideal)
    ideal, worse = shifted_back(ideal, health), health.factor[..., None] * relative
    found = triangulate.robust(matrices, ideal, least_px=pixel_sd, relative=worse)
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
    audited = audit.audited(
        film.cameras, pixels, ideal, rows, named_px=film.ideal_px, lens_known=how.lens is not None, first=first
    )
    lens_cov, far_mm = _lens_uncertainty(film, audited.lens, uv)
    lens = [] if far_mm is None else [sentences.lens_left(far_mm)]
    bias = ray_bias(matrices, uv, dt_s=film.dt_s, relative=worse)
    bias = replace(bias, jitter_px=max(bias.jitter_px, LEAST_PX))
    uv = uv - bias.bias_px
    start = triangulate.linear(matrices, uv, relative=worse)
    noise = click_noise(matrices, uv, start, relative=worse)
    xyz, cov, ray_sd, ray_scale = student_t(matrices, uv, start, sd_px=bias.jitter_px, relative=worse, noise=noise)
    ratio = 1.0 if pixel_sd is None else pixel_sd / bias.jitter_px
    pointless = np.isnan(found.xyz_m[..., 0])
    lost = found.rejected.any(axis=0) & pointless
    apart = found.rejected & lost & ~doubtful
    uv = np.where(apart[..., None], ideal - lasting_bias(bias.bias_px, uv), uv)
    unsure = unlikely.any(axis=0) & pointless & ~lost
    cameras, clicks = [c.name for c in film.cameras], int(ambiguous.sum())
    rejected = {"rays_miss": lost, "likelihood": unsure, **dict.fromkeys(DOUBTFUL, doubtful), **cleaning.rejected}
    with_lens = {} if lens_cov is None else {"lens_covariance": lens_cov}
    found_out = Cleaned(
        jitter_px=pixel_sd or bias.jitter_px,
        bias_px=bias.sd_px,
        stated_over_shown=ratio,
        noise=noise,
        bad_cameras=health.bad,
        swaps=swaps,
        stale=stale,
        jumps=audited.jumps,
        lens=audited.lens,
        audited=audited.findings,
        told=(
            *sentences.contradiction(pixel_sd, low_px=bias.jitter_px, high_px=shown),
            *(f for f in audited.findings if f.asks),
            *_sides(film, xyz, audited.findings),
            *_rate(film, xyz),
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
    return written(
        film.with_part(replace(how, beside=None)),
        found_out,
        rejected=rejected,
        position=xyz,
        covariance=cov * ratio**2,
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


def _rate(recording: Recording, xyz_m: Array | None) -> list[Finding]:
    """What speaks against the frame rate, by its (T, M, 3) positions (None: in a plane)."""
    how, fps = decided(recording), recording.fps
    playback = how.rate_from == "playback"
    return [] if not fps else audit.rate_findings(xyz_m, fps, playback=playback, in_file=how.rate_in_file)


def _sides(recording: Recording, xyz_m: Array, audited: Sequence[Finding]) -> list[Finding]:
    """What up, forward and left of the skeleton tell of the hand of the world, where cameras do not decide it."""
    doubted = any(one.kind is Kind.MIRRORED_WORLD and not one.alarm for one in audited)
    decided_so = any(one.kind is Kind.MIRRORED_WORLD and one.alarm for one in audited)
    measures = recording.skeleton.measures
    return audit.side_findings(xyz_m, recording.names, measures, decided=decided_so, doubted=doubted)


def _lens_uncertainty(
    film: Recording, hidden: audit.HiddenLens | None, uv_px: Array
) -> tuple[Array | None, Array | None]:
    """(T, M, 3, 3) covariance of points, None where no lens is doubted; and by how many mm one left in moves (N,) each.

    Of a lens that was estimated it follows from the covariance of its coefficients. One that the audit sees and nobody
    corrected moves each point by d: it is counted as an error with the covariance d d^T, which no frame averages out.

    Args:
        film: With ideal pixels.
        hidden: A lens that no file states, and nobody estimated; None: there is none.
        uv_px: (C, T, M, 2) believed ideal pixels.
    """
    lens = decided(film).lens
    if lens is not None:
        each = zip(lens.lenses, lens.k1, uv_px, strict=True)
        bent = np.stack([replace(one, k=(float(k1), 0.0, 0.0)).distort(uv) for one, k1, uv in each])  # as before it
        return lens_covariance(film.cameras, lens, bent), None
    if hidden is None:
        return None, None
    moved = moved_by_lens(film.cameras, uv_px, hidden.k1)
    far = 1e3 * np.linalg.norm(moved, axis=-1)
    far = far[np.isfinite(far)]
    return (moved[..., :, None] * moved[..., None, :], far) if len(far) else (None, None)


def _positions(recording: Recording, told: Sequence[Finding], first: int) -> Recording:
    """Positions, of which the noise is estimated where no covariance states it; ``told``: how they were read."""
    tracks, names, plane, skeleton = recording.tracks, recording.names, recording.plane, recording.skeleton
    given, shown = recording.source.point_sd_mm, position_sd(tracks.xyz_m)
    own = np.where(tracks.sd_m > 0, tracks.sd_m, shown) if given is None else np.full_like(shown, 1e-3 * given)
    sd = np.maximum(own, 1e-6)  # whatever a file says
    named = exchanged_markers(tracks.xyz_m, _rigid(skeleton, names))
    swaps, _ = without_edited(named.swaps, recording.edited)
    xyz, sd = exchange(tracks.xyz_m, swaps), exchange(sd, swaps)
    doubtful = named.unsure & ~recording.edited
    xyz = np.where(doubtful[..., None], np.nan, xyz)
    length = "mm" if plane is None else plane.length
    odd = audit.point_findings(tracks, first=first, sized=plane is None)  # as the file has them
    jumped = audit.jumps(xyz, tracks.t_s)
    jumps = tuple(audit.of_jumps(jumped, names, first=first, length=length))
    cleaning = cleaned_positions(xyz, sd, tracks.t_s, skeleton, names, certain=recording.edited)
    xyz = np.where(cleaning.any[..., None], np.nan, xyz)
    nowhere = np.zeros(xyz.shape[:2], dtype=bool)
    rejected = {"rays_miss": nowhere, **dict.fromkeys(DOUBTFUL, doubtful), **cleaning.rejected}
    found = Cleaned(
        swaps=tuple(swaps),
        jumps=jumped,
        audited=jumps,
        told=(
            *told,
            *odd,
            *(_sides(recording, xyz, ()) if plane is None else ()),
            *_rate(recording, xyz if plane is None else None),
            sentences.position_noise(sd[tracks.seen], plane, stated=given is not None),
            *jumps,
            *sentences.exchange_findings(swaps, doubtful, names, (), first=first),
            *(f for reason, mask in cleaning.rejected.items() for f in sentences.rejected(reason, mask, names)),
            *sentences.never_seen(xyz, names, plane),
            *sentences.never_together(xyz),
        ),
    )
    return written(
        replace(recording, cameras=()),
        found,
        rejected=rejected,
        position=xyz,
        covariance=np.where(np.isfinite(xyz[..., 0]), sd, np.nan)[..., None, None] ** 2 * np.eye(3),
        most_speed=cleaning.max_speed_m_s,
    )


def _rigid(skeleton: Skeleton, names: Sequence[str]) -> NDArray[np.int64]:
    """(B, 2) markers of the rigid bones."""
    return np.array(ends_among(names, skeleton.rigid), dtype=np.int64).reshape(-1, 2)
