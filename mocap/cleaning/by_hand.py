"""Corrections by hand in a recording that was cleaned without them: what a person states wins, and tells of more."""

from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.audit.offsets import in_step
from mocap.cameras import triangulate
from mocap.cleaning import sentences
from mocap.cleaning.bias import carried, hand_sd, share_left
from mocap.cleaning.cleaned import Cleaned, written
from mocap.cleaning.click_noise import LEAST_PX
from mocap.reading.ideal_pixels import without_hand, without_lens
from mocap.recording import Recording


def errors_left(recording: Recording) -> float:
    """Share of a ray's error that lasts which is left a frame later, of a recording that was cleaned."""
    believed = np.where(np.isfinite(recording.uv_px), recording.ideal_px, np.nan)  # with slow errors not taken out
    relative = recording.ray_scale_px / recording[Cleaned].jitter_px
    return share_left(recording.matrices, believed, recording.xyz_m, relative=relative)


def with_hand(recording: Recording, edited: Recording, *, left: float | None = None, first: int = 0) -> Recording:
    """A recording that was cleaned without what a person placed, with it.

    A placed marker is where its clicks meet: they have the deviation of a person's clicks, and no other ray or motion
    has them rejected. Rays of the same camera and marker in other frames are corrected by what they are expected to
    share of the error, and known the less for it (``mocap.cleaning.bias``); as far as they are, slow errors, which
    were estimated of rays that do not meet, are not taken out.

    Args:
        recording: Cleaned, of pixels as ``without_hand`` has them.
        edited: The same as it was read, with what a person placed.
        left: ``errors_left`` of the recording, where it is known.
        first: Frames of a longer recording before these.
    """
    hand = _placed(recording, edited)
    placed = np.isfinite(hand[..., 0])
    there = placed.any(axis=0)
    if not there.any():
        return recording
    matrices, uv, usual = recording.matrices, recording.uv_px, recording[Cleaned].jitter_px
    sd, apart = hand_sd(matrices, hand[:, there], usual_px=usual)
    left = errors_left(recording) if left is None else left
    raw = np.where(np.isfinite(uv), recording.ideal_px, np.nan)
    error, variance, share = carried(raw, recording.ray_sd_px, hand, hand_sd_px=sd, left=left, dt_s=recording.dt_s)
    own = np.where(placed[..., None], hand, raw - error - (1 - share.max(axis=0))[..., None] * (raw - uv))
    shown = np.nan_to_num(np.sum((own - uv) ** 2, axis=-1)) + variance > LEAST_PX**2
    uv, variance = np.where((shown | placed)[..., None], own, uv), np.where(shown, variance, 0.0)
    ray_sd, ray_scale = (
        np.where(placed, sd, np.sqrt(each**2 + variance)) for each in (recording.ray_sd_px, recording.ray_scale_px)
    )
    moved = shown.any(axis=0) & ~there
    found = triangulate.robust(
        matrices, uv[:, None, there], sd_px=sd, relative=ray_sd[:, None, there] / sd, certain=placed[:, None, there]
    )
    uv[:, there] = np.where(found.rejected[:, 0, :, None], np.nan, uv[:, there])
    xyz, cov = np.array(recording.xyz_m), np.array(recording.cov_m2)
    xyz[there], cov[there] = found.xyz_m[0], found.cov_m2[0]
    xyz[moved], cov[moved] = triangulate.refine(matrices, uv[:, moved], xyz[moved], sd_px=ray_sd[:, moved])
    rays_rejected = recording.rays_rejected & ~placed
    rays_rejected[:, there] |= found.rejected[:, 0]
    found_out = recording[Cleaned]
    told = sentences.hand_findings(np.argwhere(there)[apart], recording.names, first=first)
    return written(
        recording,
        replace(found_out, told=(*found_out.told, *told)),
        believed=uv,
        ray_sd=ray_sd,
        ray_scale=ray_scale,
        position=xyz,
        covariance=cov,
        by_hand=placed,
        edited=edited.edited,
        pixels=edited.data["pixels"].values,
        ray_rejected=rays_rejected,
        rejected={reason: mask & ~there for reason, mask in recording.rejected.items()},
    )


def _placed(recording: Recording, edited: Recording) -> Array:
    """(C, T, M, 2) ideal pixels of what a person placed, in the frame and place of the corrected camera; NaN elsewhere.

    Of a camera that is late they are of the nearest frame, and as far from the file's own there as in the image.
    """
    late, at = recording.late_frames, edited.by_hand[..., None]
    out = np.array(without_lens(recording, np.where(at, edited.data["pixels"].values, np.nan)))
    if late is not None and late.any():
        own = np.array(without_lens(recording, without_hand(edited).data["pixels"].values))
        together = in_step(own, late)
        for c in np.flatnonzero(late):
            out[c], own[c] = (_moved(pixels[c], round(float(late[c]))) for pixels in (out, own))
            finite = np.isfinite(together[c] - own[c])
            out[c] += np.where(finite, together[c] - own[c], 0.0)
    for bad in recording[Cleaned].bad_cameras:
        if bad.moved:
            out[bad.camera, bad.start : bad.stop] -= bad.offset_px
    return out


def _moved(pixels: Array, by: int) -> Array:
    """(T, M, 2) pixels some frames later, or (``by`` below 0) earlier."""
    out, n = np.full_like(pixels, np.nan), len(pixels)
    out[max(by, 0) : n + min(by, 0)] = pixels[max(-by, 0) : n - max(by, 0)]
    return out
