"""Some markers tracked again around a correction, at once; the whole recording is ``mocap.track``'s to solve again."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mocap.cameras import triangulate
from mocap.cleaning.cleaned import Cleaned, written
from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.reading.ideal_pixels import straightened, without_hand
from mocap.recording import Recording, of_points
from mocap.records import MarkerTracks, Status, marker_tracks
from mocap.skeleton import Skeleton
from mocap.tracking.tracking import track, trial_set, with_track

AROUND = 40
"""Frames on either side of an edit that are filtered again; on the built-in bat at 500 frames a second half of them, or
four times as many, put the corrected sample at the same place to 1e-8 m."""


def tracked_again(
    recording: Recording,
    tracks: MarkerTracks,
    *,
    sd_px: float,
    markers: Sequence[int],
    first: int,
    last: int,
    cleaned: Recording | None = None,
) -> tuple[slice, MarkerTracks]:
    """Some markers again, in the frames around an edit: filtered as each by itself, with the noise of the whole.

    It is what can be known at once; the whole recording, with all that markers tell of each other, is ``mocap.track``'s
    to solve again.

    Args:
        recording: With edits.
        tracks: Of the whole, as they were: how these markers accelerate.
        sd_px: Standard deviation of a coordinate of a pixel.
        markers: Which.
        first: Row of the first edited frame.
        last: Row of the last.
        cleaned: The whole, cleaned, with what a person placed (``mocap.cleaning.by_hand``); None: it is made.

    Returns:
        The frames, and what these markers do in them.

    Raises:
        MocapError: nothing is seen of them there.
    """
    window = slice(max(0, first - AROUND), last + 1 + AROUND)
    which, seen = np.array(markers), recording.at(window)
    names = tuple(recording.names[m] for m in which)
    bare = Skeleton(name="markers only", markers=names)
    measured = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)[:, which]
    if seen.pixels is None:
        cov = tracks.cov_m2[window][:, which]
        xyz = seen.xyz_m[:, which]
        own = np.where(np.isfinite(cov), cov, np.nanmedian(tracks.cov_m2[:, which], axis=(0, 1)))
        of = of_points(marker_tracks(names, seen.t_s, xyz, cov_m2=own), bare, name=recording.name)
        of = of.having(rejected={"rays_miss": np.zeros(xyz.shape[:2], dtype=bool)})
        of = of.with_part(Cleaned())
    else:
        cleaned = clean(recording) if cleaned is None else cleaned
        of = replace(cleaned.at(window).only(which), skeleton=bare)
        of = of.with_part(replace(of[Cleaned], jumps=()))  # a correction may be the end of one
        of = _as_named(of, without_hand(seen), which, sd_px) if of.cameras else of
    if not np.isfinite(of.xyz_m[..., 0]).any():
        raise MocapError(f"nothing is seen of {', '.join(names)} in the frames around: place it in two cameras")
    whole = of_points(marker_tracks(names, tracks.t_s, measured), bare, name=recording.name)
    whole = whole.with_part(Cleaned())
    model = replace(MarkerSettings().fit(trial_set(whole)), t_s=seen.t_s, rigid=None)
    return window, with_track(of, of, "constant_velocity", track(of, model)).tracks


def _as_named(of: Recording, seen: Recording, which: NDArray[np.int64], sd_px: float) -> Recording:
    """Some markers of a recording that was cleaned before a person exchanged or deleted some of it (``seen``)."""
    new = seen.edited[:, which] & ~of.by_hand.any(axis=0)
    if not new.any() or seen.pixels is None:
        return of
    own = straightened(seen, seen.pixels.uv_px[:, :, which])[:, None, new]
    found = triangulate.robust(of.matrices, own, sd_px=sd_px)
    uv, scale, xyz, cov = (np.array(a) for a in (of.uv_px, of.ray_scale_px, of.xyz_m, of.cov_m2))
    uv[:, new], scale[:, new] = np.where(found.rejected[..., None], np.nan, own)[:, 0], sd_px
    xyz[new], cov[new] = found.xyz_m[0], found.cov_m2[0]
    rejected = {reason: mask & ~new for reason, mask in of.rejected.items()}
    return written(of, of[Cleaned], believed=uv, ray_scale=scale, position=xyz, covariance=cov, rejected=rejected)
