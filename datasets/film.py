"""Film a scene: project, hide, digitise, and write the card."""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from datasets.gaps import gap_statistics
from datasets.observe import Digitiser, click_noise, lost, misplace
from datasets.occlusion import occluded
from datasets.recording import SyntheticRecording
from datasets.scene import Scene
from mocap.arrays import Array
from mocap.cameras import Camera, record, stacked
from mocap.records import PixelTracks


def film(
    scene: Scene,
    cameras: Sequence[Camera],
    *,
    name: str,
    fps: float,
    digitiser: Digitiser,
    rng: np.random.Generator,
    card: dict,
) -> SyntheticRecording:
    """Record and digitise a scene.

    Args:
        scene: The animal in motion.
        cameras: Cameras with lens and size.
        name: Name of the recording.
        fps: Frames a second, those of ``scene.t_s``.
        digitiser: Quality of the digitising.
        rng: Source of noise and faults.
        card: Entries that the caller adds to the card: species, rig, seed.

    Returns:
        The recording, with its truth.
    """
    exact_px = record(cameras, scene.xyz_m)
    hidden = outside(cameras, scene.xyz_m, exact_px) | occluded(
        cameras, scene.xyz_m, triangles=scene.triangles, solids=scene.solids, clearance_m=scene.clearance_m
    )
    index = {marker: m for m, marker in enumerate(scene.skeleton.markers)}
    missing = lost(
        rng,
        hidden.shape,
        digitiser,
        fps=fps,
        neighbours=[(index[b.a], index[b.b]) for b in scene.skeleton.bones],
        clusters=[[index[marker] for marker in cluster] for cluster in scene.clusters],
    )
    uv_px = exact_px + click_noise(rng, hidden.shape, digitiser)
    uv_px[hidden | missing] = np.nan
    uv_px, outlier = misplace(rng, uv_px, digitiser)
    pixels = PixelTracks(
        names=scene.skeleton.markers, cameras=tuple(c.name for c in cameras), t_s=scene.t_s, uv_px=uv_px
    )
    return SyntheticRecording(
        name=name,
        pixels=pixels,
        cameras=tuple(cameras),
        skeleton=scene.skeleton,
        truth=scene.truth,
        fps=fps,
        occluded=hidden,
        lost=missing,
        outlier=outlier,
        contact=scene.contact,
        card=_card(card, pixels, fps, digitiser, hidden, outlier),
    )


def outside(cameras: Sequence[Camera], xyz_m: Array, uv_px: Array) -> NDArray[np.bool_]:
    """(C, T, M) True where a marker is behind a camera or off its picture.

    Args:
        cameras: C cameras with sizes.
        xyz_m: (T, M, 3) markers.
        uv_px: (C, T, M, 2) recorded pixels.

    Raises:
        ValueError: a camera has no size.
    """
    for camera in cameras:
        if camera.size_px is None:
            raise ValueError(f"camera {camera.name!r} has no size_px: give it, to tell what is out of its picture")
    size_px = np.array([c.size_px for c in cameras])[:, None, None, :]
    normals = stacked(cameras)[:, 2]
    depth_m = np.einsum("ci,tmi->ctm", normals[:, :3], xyz_m) + normals[:, 3, None, None]
    return (depth_m <= 0) | ((uv_px < -0.5) | (uv_px > size_px - 0.5)).any(axis=-1)


def _card(
    card: dict,
    pixels: PixelTracks,
    fps: float,
    digitiser: Digitiser,
    hidden: NDArray[np.bool_],
    outlier: NDArray[np.bool_],
) -> dict:
    n_cameras, n_frames, n_markers = hidden.shape
    counts = pixels.seen.sum(axis=0)
    return {
        **card,
        "frames": n_frames,
        "fps": fps,
        "markers": n_markers,
        "cameras": n_cameras,
        "units": {"world": "m, right-handed, z up", "pixels": "px, origin upper-left, as recorded (distorted)"},
        "digitiser": {**asdict(digitiser), "sd_px": round(digitiser.sd_px, 4)},
        "pixels_seen": round(float(pixels.seen.mean()), 4),
        "pixels_occluded": round(float(hidden.mean()), 4),
        "outliers": int(outlier.sum()),
        "outlier_share": round(float(outlier.sum() / max(pixels.seen.sum(), 1)), 5),
        "cameras_a_sample": round(float(counts.mean()), 3),
        "in_3d": gap_statistics(counts >= 2),
        "share_seen_by_two_or_more": {
            name: round(float(share), 4) for name, share in zip(pixels.names, (counts >= 2).mean(axis=0), strict=True)
        },
    }
