"""From a recording to the input of a tracker: triangulated and cleaned, slowly varying pixel errors removed."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap import audit
from mocap.cameras import triangulate
from mocap.cameras.camera import Camera
from mocap.cleaning.bias import lasting_bias, ray_bias
from mocap.cleaning.camera_health import BadTime, camera_health, shifted_back
from mocap.cleaning.clean import clean
from mocap.cleaning.click_noise import USUAL_DOF, ClickNoise, click_noise
from mocap.cleaning.likelihoods import LikelihoodNoise, likelihood_noise
from mocap.cleaning.persistence import persistent_px
from mocap.cleaning.position_noise import position_sd
from mocap.cleaning.robust_rays import LEAST_PX, student_t
from mocap.cleaning.swap_states import CAMERAS, mixed, settle_all
from mocap.cleaning.swapped_rays import exchange_rays, exchanged_rays, extent_px
from mocap.cleaning.swaps import DOUBTFUL, Swap, exchange, exchanged_markers, exchanged_samples
from mocap.errors import CalibrationError, FormatError, MocapError
from mocap.filters.anatomy import ends_among
from mocap.filters.observations import Observations, PixelObservations, PositionObservations
from mocap.findings import Finding
from mocap.pipeline import sentences
from mocap.pipeline.lens_effect import lens_uncertainty
from mocap.pipeline.plane import in_plane
from mocap.pipeline.recording import (
    Filmed,
    Recording,
    audit_points,
    by_pixels,
    film_of,
    load_in_unit,
    load_points,
)
from mocap.pipeline.run import Plane
from mocap.records import MarkerTracks, PixelTracks
from mocap.skeleton import Measures, Skeleton

LEAST_SD_M = 1e-6
"""Positions are not known better than that, whatever a file says."""

WIDE = 0.05
"""A marker vaguer than this share of its distance from the cameras is not projected from sigma points."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Prepared:
    """A recording ready to be tracked.

    Attributes:
        name: Of the recording.
        skeleton: Its skeleton, at least with its markers.
        names: The M markers.
        t_s: (T,) times.
        xyz_m: (T, M, 3) points of believed samples, corrected for slow ray errors; NaN else.
        cov_m2: (T, M, 3, 3) covariance of their jitter.
        filmed: Pixels and cameras; None where positions were given.
        uv_px: (C, T, M, 2) believed ideal pixels, corrected; C = 0 without cameras. Where a sample has two and no
            point, they do not meet: one of them may be right.
        ray_sd_px: (C, T, M) standard deviation of a coordinate of each corrected pixel, weighed by how the rays of its
            marker meet.
        ray_scale_px: (C, T, M) scale of Student's t that its error follows before anything is known of the others.
        jitter_px: The same over all rays; NaN without cameras.
        plane: The picture of one film, in which positions are; None: they are in space.
        lens_cov_m2: (T, M, 3, 3) covariance of points from a lens that was estimated or is not corrected; NaN where not
            seen; None: lenses are taken as known.
        stated_over_shown: Factor by which all deviations above were multiplied, so that they are what the user states
            of a pixel; 1: nothing is stated.
        bias_px: Standard deviation of the slow ray errors that were removed.
        persistent_px: (M,) standard deviation of a pixel coordinate of errors that no filter averages out.
        residual_px: (T, M) residuals of triangulation before correction; NaN without.
        rejected: (T, M) masks by reason.
        rays_rejected: (C, T, M) rays that miss.
        max_speed_m_s: (M,) speed limits that jumps were judged by.
        findings: For the report; those that ask for something to be done (``alarm``) stand worst first.
        camera_factor: (C, T) 1 or more: how much worse a camera is than in its good time
            (``mocap.cleaning.camera_health``); contained in ``ray_sd_px``.
        bad_cameras: Runs of frames in which a camera was bad.
        noise: Relative scales of cameras and markers, and degrees of freedom of cameras, by which rays were weighed;
            None without cameras.
        likelihoods: What the likelihoods of clicks were found to be worth; contained in ``ray_sd_px``. None: there are
            none, or nothing can be learned of them.
        swaps: Runs of frames in which two markers bore each other's names; undone in all that is above.
        stale: Stored points that do not follow from the pixels; None where there was no file to compare.
        audited: What pixels and cameras tell of each other, and of faults of the programs that wrote them.
    """

    name: str
    skeleton: Skeleton
    names: tuple[str, ...]
    t_s: Array
    xyz_m: Array
    cov_m2: Array
    filmed: Filmed | None
    uv_px: Array
    ray_sd_px: Array
    ray_scale_px: Array
    jitter_px: float
    bias_px: float
    persistent_px: Array
    residual_px: Array
    rejected: dict[str, NDArray[np.bool_]]
    rays_rejected: NDArray[np.bool_]
    max_speed_m_s: Array
    camera_factor: Array
    findings: tuple[Finding, ...] = ()
    bad_cameras: tuple[BadTime, ...] = ()
    noise: ClickNoise | None = None
    likelihoods: LikelihoodNoise | None = None
    swaps: tuple[Swap, ...] = ()
    stale: tuple[audit.StalePoint, ...] | None = field(default=None)
    audited: tuple[Finding, ...] = ()
    stated_over_shown: float = 1.0
    plane: Plane | None = None
    lens_cov_m2: Array | None = None

    def in_space(self, what: str) -> "Prepared":
        """The same, refused where it is of one film.

        Raises:
            MocapError: positions are in the plane of a picture.
        """
        if self.plane is not None:
            raise MocapError(f"{self.name}: one film without a calibration: {what} needs positions in space")
        return self

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0

    @property
    def camera_sd_px(self) -> Array:
        """(C,) standard deviation of a coordinate that informs as much as the mean ray of each camera; NaN: no ray."""
        seen = np.isfinite(self.uv_px[..., 0])
        total = np.where(seen, 1 / self.ray_sd_px**2, 0.0).sum(axis=(1, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(total > 0, np.sqrt(seen.sum(axis=(1, 2)) / total), np.nan)

    @property
    def repaired(self) -> dict[str, NDArray[np.bool_]]:
        """(T, M) samples whose name was corrected, by the keys of ``mocap.cleaning.swaps.REPAIRS``."""
        n_frames, n_markers = self.xyz_m.shape[:2]
        return exchanged_samples((n_frames, n_markers), self.swaps)

    def observations(
        self, frames: slice, markers: NDArray[np.int64], *, hidden: NDArray[np.bool_] | None = None
    ) -> Observations:
        """Rows for a tracker.

        Args:
            frames: Frames to track.
            markers: Markers to track.
            hidden: (T, M) samples to leave out.
        """
        keep = np.ones(self.xyz_m.shape[:2], dtype=bool) if hidden is None else ~hidden
        keep = keep[frames][:, markers]
        xyz = np.where(keep[..., None], self.xyz_m[frames][:, markers], np.nan)
        cov = self.cov_m2[frames][:, markers]
        if self.filmed is None:
            return PositionObservations(xyz_m=xyz, sd_m=np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 3))
        uv = np.where(keep[None, ..., None], self.uv_px[:, frames][:, :, markers], np.nan)
        depth = np.median(np.abs(self.filmed.matrices[:, 2, :3] @ _middle(self.xyz_m) + self.filmed.matrices[:, 2, 3]))
        return PixelObservations(
            matrices=self.filmed.matrices,
            uv_px=uv,
            sd_px=self.ray_scale_px[:, frames][:, :, markers],
            dof=np.full(len(uv), USUAL_DOF) if self.noise is None else self.noise.dof,
            xyz_m=xyz,
            cov_m2=cov,
            wide_m=WIDE * float(depth),
        )


def _middle(xyz_m: Array) -> Array:
    return np.nanmedian(xyz_m.reshape(-1, 3), axis=0)


def prepare(source: Recording) -> Prepared:
    """Clean a recording; see the module.

    Raises:
        MocapError: whatever makes that impossible, with what to do.
    """
    if source.planar:
        return _prepare_plane(source)
    if not source.filmed:
        return prepare_tracks(load_points(source), source.skeleton, name=source.name, findings=source.findings)
    source, filmed = load_in_unit(source, iterations=None)
    stale, told = audit_points(source, filmed)
    return prepare_filmed(
        filmed,
        source.skeleton,
        name=source.name,
        file=source.where,
        pixel_sd=source.pixel_sd,
        findings=source.findings,
        likelihood=source.contents.score,
        stored_findings=told,
        stale=stale,
    )


def prepare_pixels(pixels: PixelTracks, cameras: Sequence[Camera], skeleton: Skeleton, *, name: str) -> Prepared:
    """Pixels that are in memory, prepared as those of a file are.

    Args:
        pixels: As digitised, named as the skeleton names them.
        cameras: Their cameras, in the same order.
        skeleton: What is known of the animal.
        name: Of the recording.

    Raises:
        MocapError: whatever makes that impossible, with what to do.
    """
    return prepare_filmed(film_of(pixels, cameras, name=name), skeleton, name=name)


def prepare_filmed(
    filmed: Filmed,
    skeleton: Skeleton,
    *,
    name: str,
    file: str | None = None,
    pixel_sd: float | None = None,
    findings: Sequence[Finding] = (),
    likelihood: Array | None = None,
    stored_findings: Sequence[Finding] = (),
    stale: tuple[audit.StalePoint, ...] | None = None,
    first: int = 0,
) -> Prepared:
    """Triangulate and clean pixels whose cameras are known.

    Args:
        filmed: Pixels, named as the skeleton names them, and cameras.
        skeleton: What is known of the animal.
        name: Of the recording.
        file: What errors call it; None: its name.
        pixel_sd: Standard deviation of a pixel that the user states; None: estimated.
        findings: The first of the report.
        likelihood: (C, T, M) the clicking program's own likelihood of each click; None: it states none.
        stored_findings: On stored points.
        stale: Stored points that do not follow from the pixels.
        first: Frames of the recording before these.

    Raises:
        CalibrationError: no sample is believed.
    """
    names = filmed.pixels.names
    likely, unlikely, relative = _by_likelihood(filmed, likelihood)
    filmed = replace(filmed, ideal_px=np.where(unlikely[..., None], np.nan, filmed.ideal_px))
    health = camera_health(filmed.matrices, filmed.ideal_px)
    worse = health.factor[..., None] * relative
    filmed = replace(filmed, ideal_px=shifted_back(filmed.ideal_px, health))
    shown, gate = by_pixels(filmed, pixel_sd, worse)
    found = triangulate.robust(filmed.matrices, filmed.ideal_px, sd_px=gate, relative=worse)
    named = _names_put_right(filmed, found, skeleton, names, worse)
    filmed, found, swaps, doubtful, worse = named.filmed, named.found, named.swaps, named.doubtful, named.relative
    sd = np.sqrt(np.trace(found.cov_m2, axis1=-2, axis2=-1) / 3)
    t_s = filmed.pixels.t_s
    cleaning = clean(np.where(doubtful[..., None], np.nan, found.xyz_m), sd, t_s, skeleton, names)
    uv = np.where((found.rejected | cleaning.any | doubtful)[..., None], np.nan, filmed.ideal_px)
    if not (np.isfinite(uv[..., 0]).sum(axis=0) >= 2).any():
        raise CalibrationError(
            f"{file or name}: every sample was rejected because the rays of the cameras do not intersect: "
            "check that coefficients, profile and pixels belong together"
        )
    dt = float(t_s[1] - t_s[0]) if len(t_s) > 1 else 1.0
    lasting = persistent_px(filmed.matrices, uv, found.xyz_m, relative=worse)
    audited = audit.audit_filmed(filmed.cameras, filmed.pixels, filmed.ideal_px, filmed.pixel_origin, first=first)
    lens_cov, lens = lens_uncertainty(filmed, audited, uv)
    bias = ray_bias(filmed.matrices, uv, dt_s=dt, relative=worse)
    bias = replace(bias, jitter_px=max(bias.jitter_px, LEAST_PX))
    uv = uv - bias.bias_px
    start = triangulate.linear(filmed.matrices, uv, relative=worse)
    noise = click_noise(filmed.matrices, uv, start, relative=worse)
    xyz, cov, ray_sd, ray_scale = student_t(
        filmed.matrices, uv, start, sd_px=bias.jitter_px, relative=worse, noise=noise
    )
    ratio = 1.0 if pixel_sd is None else pixel_sd / bias.jitter_px
    pointless = np.isnan(found.xyz_m[..., 0])
    lost = found.rejected.any(axis=0) & pointless
    apart = found.rejected & lost & ~doubtful
    uv = np.where(apart[..., None], filmed.ideal_px - lasting_bias(bias.bias_px, uv), uv)
    unsure = unlikely.any(axis=0) & pointless & ~lost
    cameras, clicks = [c.name for c in filmed.cameras], int(named.ambiguous.sum())
    return Prepared(
        name=name,
        skeleton=skeleton,
        names=names,
        t_s=t_s,
        xyz_m=xyz,
        cov_m2=cov * ratio**2,
        filmed=filmed,
        uv_px=uv,
        ray_sd_px=ray_sd * ratio,
        ray_scale_px=ray_scale * ratio,
        jitter_px=pixel_sd or bias.jitter_px,
        bias_px=bias.sd_px,
        persistent_px=lasting,
        residual_px=found.residual_px,
        rejected={"rays_miss": lost, "likelihood": unsure, **dict.fromkeys(DOUBTFUL, doubtful), **cleaning.rejected},
        rays_rejected=found.rejected | unlikely | named.ambiguous,
        max_speed_m_s=cleaning.max_speed_m_s,
        camera_factor=health.factor,
        bad_cameras=health.bad,
        noise=noise,
        likelihoods=likely,
        findings=(
            *filmed.told,
            *findings,
            *sentences.contradiction(pixel_sd, low_px=bias.jitter_px, high_px=shown),
            sentences.pixel_origin(filmed.pixel_origin),
            *(f for f in audited if f.alarm or f.kind == "mirrored world"),
            *lens,
            *sentences.late_cameras(cameras, filmed.late_frames),
            *stored_findings,
            *sentences.slow_errors(bias, lens_stays=bool(lens)),
            *sentences.likelihood_findings(likely, likelihood is not None, int(unlikely.sum()), int(unsure.sum())),
            *sentences.camera_findings(health, cameras, first=first),
            *sentences.never_seen(xyz, names),
            *sentences.never_together(xyz, names),
            *sentences.exchange_findings(swaps, doubtful, names, cameras, clicks=clicks, first=first),
            *sentences.rejected("rays_miss", lost),
            *(f for reason, mask in cleaning.rejected.items() for f in sentences.rejected(reason, mask, names)),
        ),
        swaps=swaps,
        stale=stale,
        audited=tuple(audited),
        stated_over_shown=ratio,
        lens_cov_m2=lens_cov,
    )


def _by_likelihood(filmed: Filmed, likelihood: Array | None) -> tuple[LikelihoodNoise | None, NDArray[np.bool_], Array]:
    """What likelihoods are worth; (C, T, M) clicks that are not believed, and deviations relative to a usual click."""
    shape = filmed.ideal_px.shape[:3]
    found = None if likelihood is None else likelihood_noise(filmed.matrices, filmed.ideal_px, likelihood)
    if found is None or likelihood is None:
        return None, np.zeros(shape, dtype=bool), np.ones(shape)
    unlikely = np.isfinite(filmed.ideal_px[..., 0]) & ~found.believed(likelihood)
    return found, unlikely, found.factors(likelihood)


def _prepare_plane(source: Recording) -> Prepared:
    tracks, plane, found = in_plane(source)
    if not tracks.seen.any():
        raise FormatError(f"{source.where}: no marker is ever seen: there is nothing to track")
    skeleton = replace(source.skeleton, bones=(), joints=(), measures=Measures())
    return prepare_tracks(tracks, skeleton, name=source.name, findings=(*source.findings, *found), plane=plane)


def prepare_tracks(
    tracks: MarkerTracks,
    skeleton: Skeleton,
    *,
    name: str,
    findings: Sequence[Finding] = (),
    first: int = 0,
    plane: Plane | None = None,
) -> Prepared:
    """Positions that are in memory, cleaned as those of a file are.

    Args:
        tracks: Positions, named as the skeleton names them; their noise is estimated where no covariance states it.
        skeleton: What is known of the animal.
        name: Of the recording.
        findings: The first of the report.
        first: Frames of the recording before these.
        plane: The picture of one film, in which they are; None: they are in space.
    """
    names = tracks.names
    sd = np.maximum(np.where(tracks.sd_m > 0, tracks.sd_m, position_sd(tracks)), LEAST_SD_M)
    named = exchanged_markers(tracks.xyz_m, _rigid(skeleton, names))
    xyz, sd = exchange(tracks.xyz_m, named.swaps), exchange(sd, named.swaps)
    xyz = np.where(named.unsure[..., None], np.nan, xyz)
    length = "mm" if plane is None else plane.length
    jumps = tuple(audit.jump_findings(xyz, tracks.t_s, names, first=first, length=length))
    cleaning = clean(xyz, sd, tracks.t_s, skeleton, names)
    xyz = np.where(cleaning.any[..., None], np.nan, xyz)
    cov = np.where(np.isfinite(xyz[..., 0]), sd, np.nan)[..., None, None] ** 2 * np.eye(3)
    shape = (0, *xyz.shape[:2])
    return Prepared(
        name=name,
        skeleton=skeleton,
        names=names,
        t_s=tracks.t_s,
        xyz_m=xyz,
        cov_m2=cov,
        filmed=None,
        uv_px=np.zeros((*shape, 2)),
        ray_sd_px=np.zeros(shape),
        ray_scale_px=np.zeros(shape),
        jitter_px=np.nan,
        bias_px=0.0,
        persistent_px=np.zeros(len(names)),
        residual_px=np.full(xyz.shape[:2], np.nan),
        rejected={
            "rays_miss": np.zeros(xyz.shape[:2], dtype=bool),
            **dict.fromkeys(DOUBTFUL, named.unsure),
            **cleaning.rejected,
        },
        rays_rejected=np.zeros(shape, dtype=bool),
        max_speed_m_s=cleaning.max_speed_m_s,
        camera_factor=np.zeros((0, len(xyz))),
        findings=(
            *findings,
            sentences.position_noise(sd[tracks.seen], plane),
            *jumps,
            *sentences.exchange_findings(named.swaps, named.unsure, names, (), first=first),
            *(f for reason, mask in cleaning.rejected.items() for f in sentences.rejected(reason, mask, names)),
            *sentences.never_seen(xyz, names, plane),
            *sentences.never_together(xyz, names),
        ),
        swaps=named.swaps,
        audited=jumps,
        plane=plane,
    )


def _rigid(skeleton: Skeleton, names: Sequence[str]) -> NDArray[np.int64]:
    """(B, 2) markers of the rigid bones."""
    return np.array(ends_among(names, skeleton.rigid), dtype=np.int64).reshape(-1, 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Named:
    """Pixels and points with exchanged names undone.

    Attributes:
        filmed: The pixels; without ambiguous ones.
        found: The points.
        swaps: Runs of frames that were undone.
        doubtful: (T, M) samples that may be of either of two markers.
        ambiguous: (C, T, M) clicks that may be of either of two markers.
        relative: (C, T, M) deviations of rays, exchanged as the rays are.
    """

    filmed: Filmed
    found: triangulate.Triangulation
    swaps: tuple[Swap, ...]
    doubtful: NDArray[np.bool_]
    ambiguous: NDArray[np.bool_]
    relative: Array


def _names_put_right(
    filmed: Filmed, found: triangulate.Triangulation, skeleton: Skeleton, names: Sequence[str], relative: Array
) -> _Named:
    """Undo exchanges of names in single cameras, then in all.

    Up to ``CAMERAS`` cameras a single ray says little: there exchanges are proposals, of which a model of all cameras'
    states decides.
    """
    matrices, uv = filmed.matrices, filmed.ideal_px
    rays = exchanged_rays(matrices, uv, found, relative=relative)
    ambiguous = np.zeros(uv.shape[:3], dtype=bool)
    few = len(uv) <= CAMERAS
    if rays and few:
        settled = settle_all(matrices, uv, rays, sd_px=found.sd_px, relative=relative, extent_px=extent_px(uv))
        uv, relative, rays, ambiguous = settled
        ambiguous &= np.isfinite(uv[..., 0])
        uv = np.where(ambiguous[..., None], np.nan, uv)
    elif rays:
        uv, relative = exchange_rays(uv, rays), exchange_rays(relative, rays)
    if rays or ambiguous.any():
        found = triangulate.robust(matrices, uv, sd_px=found.sd_px, relative=relative)
    doubtful = ambiguous.any(axis=0) & np.isnan(found.xyz_m[..., 0])
    points = exchanged_markers(found.xyz_m, _rigid(skeleton, names))
    swaps = [swap for swap in points.swaps if not (few and mixed(swap, rays, ambiguous))]
    if swaps:
        uv, relative = exchange_rays(uv, swaps), exchange_rays(relative, swaps)
        found = replace(
            found,
            xyz_m=exchange(found.xyz_m, swaps),
            cov_m2=exchange(found.cov_m2, swaps),
            residual_px=exchange(found.residual_px, swaps),
            rejected=exchange_rays(found.rejected, swaps),
        )
    return _Named(
        filmed=replace(filmed, ideal_px=uv),
        found=found,
        swaps=(*rays, *swaps),
        doubtful=points.unsure | (exchange(doubtful.astype(float), swaps) > 0),
        ambiguous=ambiguous,
        relative=relative,
    )
