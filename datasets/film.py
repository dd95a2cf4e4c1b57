"""A scene, and its video whose truth is known: project, hide, digitise, and write the card."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from mocap.datasets.observe import Digitiser, click_noise, lasting_errors, lost, misplace
from mocap.datasets.occlusion import Solid, occluded
from mocap.datasets.rig import picture_size
from numpy.typing import NDArray

from eal.arrays import Array, frozen, true_runs
from mocap.cameras.camera import Camera, record, stacked
from mocap.records import MarkerTracks, PixelTracks, Status
from mocap.skeleton import Skeleton


@dataclass(frozen=True, eq=False, kw_only=True)
class FilmedScene:
    """An animal in motion.

    Attributes:
        skeleton: Its markers, M of them, in the order of ``xyz_m``.
        t_s: (T,) times.
        xyz_m: (T, M, 3) markers in the world: right-handed, z up, origin in the measured volume.
        triangles: (K, 3) marker indices of opaque membranes.
        solids: Opaque bodies.
        clearance_m: A membrane or surface this close to a marker does not hide it.
        clusters: Sets of markers that are lost together, such as a wing tip.
        contact: (T, M) True where a marker stands still on the ground.
    """

    skeleton: Skeleton
    t_s: Array
    xyz_m: Array
    triangles: NDArray[np.intp]
    solids: tuple[Solid, ...]
    clearance_m: float
    clusters: tuple[tuple[str, ...], ...]
    contact: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        n_markers = len(self.skeleton.markers)
        object.__setattr__(self, "t_s", frozen("t_s", self.t_s, (None,)))
        object.__setattr__(self, "xyz_m", frozen("xyz_m", self.xyz_m, (len(self.t_s), n_markers, 3)))
        object.__setattr__(self, "triangles", frozen("triangles", self.triangles, (None, 3), dtype=np.intp))
        object.__setattr__(self, "contact", frozen("contact", self.contact, self.xyz_m.shape[:2], dtype=np.bool_))

    @property
    def truth(self) -> MarkerTracks:
        """The markers, complete and without error."""
        n_frames, n_markers = self.xyz_m.shape[:2]
        return MarkerTracks(
            names=self.skeleton.markers,
            t_s=self.t_s,
            xyz_m=self.xyz_m,
            cov_m2=np.zeros((n_frames, n_markers, 3, 3)),
            status=np.full((n_frames, n_markers), Status.MEASURED),
        )


Motion = Callable[[Array], FilmedScene]
"""An animal over all time: from times (T,) to the scene at these times."""


def start_times(seed: np.random.SeedSequence, n_cameras: int, spread_s: float) -> Array:
    """(C,) times by which each camera starts late: the first at 0, the others uniform within ``spread_s`` about it.

    With a spread of up to a frame, equal frame numbers stay the nearest in time, as after matching frames by eye.

    Raises:
        ValueError: the spread is negative.
    """
    if not spread_s >= 0:
        raise ValueError(f"cameras start within {spread_s:g} s of each other: give 0 or more")
    late_s = np.random.default_rng(seed).uniform(-spread_s / 2, spread_s / 2, n_cameras)
    late_s[0] = 0.0
    return late_s


def frame_times(n_frames: int, fps: float) -> Array:
    """(T,) times of ``n_frames`` frames from 0 on.

    Raises:
        ValueError: no frames, or a rate that is not positive.
    """
    if n_frames < 1 or not fps > 0:
        raise ValueError(f"n_frames must be 1 or more and fps above 0, but they are {n_frames} and {fps:g}")
    return np.arange(n_frames) / fps


@dataclass(frozen=True, eq=False, kw_only=True)
class SyntheticRecording:
    """What the cameras recorded, what was digitised, and what was true.

    Attributes:
        name: Short name; file names begin with it.
        pixels: Pixels as digitised: distorted, noisy, with markers missing and misplaced.
        cameras: The C cameras with lens and size.
        skeleton: The animal.
        truth: Every marker in every frame.
        fps: Frames a second.
        start_s: (C,) time by which each camera starts late; its frame n is taken at ``pixels.t_s[n] + start_s``.
        occluded: (C, T, M) True where the animal or its surroundings hide the marker, or it is out of the image.
        lost: (C, T, M) True where the digitiser lost it, hidden or not.
        outlier: (C, T, M) True where it was digitised in a wrong place.
        contact: (T, M) True where a marker stands still on the ground.
        card: Species, rig, units, rates, seed, faults injected and their statistics; ready for JSON.
    """

    name: str
    pixels: PixelTracks
    cameras: tuple[Camera, ...]
    skeleton: Skeleton
    truth: MarkerTracks
    fps: float
    start_s: Array
    occluded: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    outlier: NDArray[np.bool_]
    contact: NDArray[np.bool_]
    card: dict

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        shape = self.pixels.uv_px.shape[:3]
        for name in ("occluded", "lost", "outlier"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape, dtype=np.bool_))
        object.__setattr__(self, "start_s", frozen("start_s", self.start_s, shape[:1]))
        object.__setattr__(self, "contact", frozen("contact", self.contact, shape[1:], dtype=np.bool_))


def film(
    motion: Motion,
    cameras: Sequence[Camera],
    *,
    name: str,
    seed: int,
    n_frames: int,
    fps: float,
    digitiser: Digitiser,
    card: dict,
    start_spread_frames: float = 0.0,
) -> SyntheticRecording:
    """Record and digitise an animal in motion.

    Args:
        motion: The animal.
        cameras: C cameras with lens and size.
        name: Name of the recording.
        seed: Of noise, faults and starts.
        n_frames: Number of frames; the truth is at those of a camera that starts at 0.
        fps: Frames a second.
        digitiser: Quality of the digitising.
        card: Entries that the caller adds to the card: species, rig.
        start_spread_frames: Cameras start within so much of a frame of each other; 0: at the same instant.

    Returns:
        The recording, with its truth.
    """
    _, clicks_seed, starts_seed = np.random.SeedSequence(seed).spawn(3)  # the first is the motion's
    t_s, rng = frame_times(n_frames, fps), np.random.default_rng(clicks_seed)
    start_s = start_times(starts_seed, len(cameras), start_spread_frames / fps)
    scene = motion(t_s)
    scenes = [scene if late_s == 0 else motion(t_s + late_s) for late_s in start_s]
    views = [
        view(seen, camera, grazing_rad=digitiser.grazing_rad) for seen, camera in zip(scenes, cameras, strict=True)
    ]
    exact_px, hidden = np.stack([exact for exact, _ in views]), np.stack([behind for _, behind in views])
    index = {marker: m for m, marker in enumerate(scene.skeleton.markers)}
    missing = lost(
        rng,
        hidden.shape,
        digitiser,
        fps=fps,
        neighbours=[(index[b.a], index[b.b]) for b in scene.skeleton.bones],
        clusters=[[index[marker] for marker in cluster] for cluster in scene.clusters],
    )
    uv_px = exact_px + click_noise(rng, hidden.shape, digitiser) + lasting_errors(rng, hidden.shape, digitiser)
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
        start_s=start_s,
        occluded=hidden,
        lost=missing,
        outlier=outlier,
        contact=scene.contact,
        card={"name": name, **card, "seed": seed} | _statistics(pixels, fps, start_s, digitiser, hidden, outlier),
    )


def view(scene: FilmedScene, camera: Camera, *, grazing_rad: float = 0.0) -> tuple[Array, NDArray[np.bool_]]:
    """Recorded pixels (T, M, 2) of a scene, and where a marker is hidden or off the image (T, M)."""
    exact_px = record([camera], scene.xyz_m)
    behind = occluded(
        [camera],
        scene.xyz_m,
        triangles=scene.triangles,
        solids=scene.solids,
        clearance_m=scene.clearance_m,
        grazing_rad=grazing_rad,
    )
    return exact_px[0], (outside([camera], scene.xyz_m, exact_px) | behind)[0]


def outside(cameras: Sequence[Camera], xyz_m: Array, uv_px: Array) -> NDArray[np.bool_]:
    """(C, T, M) True where a marker is behind a camera or off its image.

    Args:
        cameras: C cameras with sizes.
        xyz_m: (T, M, 3) markers.
        uv_px: (C, T, M, 2) recorded pixels.

    Raises:
        ValueError: a camera has no size.
    """
    size_px = np.array([picture_size(c) for c in cameras])[:, None, None, :]
    normals = stacked(cameras)[:, 2]
    depth_m = np.einsum("ci,tmi->ctm", normals[:, :3], xyz_m) + normals[:, 3, None, None]
    return (depth_m <= 0) | ((uv_px < -0.5) | (uv_px > size_px - 0.5)).any(axis=-1)


def _statistics(
    pixels: PixelTracks,
    fps: float,
    start_s: Array,
    digitiser: Digitiser,
    hidden: NDArray[np.bool_],
    outlier: NDArray[np.bool_],
) -> dict:
    n_cameras, n_frames, n_markers = hidden.shape
    counts = pixels.seen.sum(axis=0)
    return {
        "frames": n_frames,
        "fps": fps,
        "markers": n_markers,
        "cameras": n_cameras,
        "cameras_start_late_ms": [round(1e3 * late_s, 6) for late_s in start_s.tolist()],
        "units": {"world": "m, right-handed, z up", "pixels": "px, as recorded (distorted)"},
        "pixel_origin": "upper-left",
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


def gap_statistics(seen: NDArray[np.bool_]) -> dict:
    """Share seen, and number and lengths of interior gaps, of (T, M) samples; ready for JSON."""
    runs = [(m, stop - start, stop) for m, row in enumerate(~seen.T) for start, stop in true_runs(row) if start]
    marker, length, stop = np.array(runs, dtype=np.intp).reshape(-1, 3).T
    marker, length = marker[stop < len(seen)], length[stop < len(seen)]
    medium = (length >= 10) & (length <= 60)
    quantiles = np.quantile(length, [0.5, 0.9, 1.0]) if len(length) else np.zeros(3)
    return {
        "share_seen": round(float(seen.mean()), 4),
        "interior_gaps": len(length),
        "interior_gap_frames": int(length.sum()),
        "gaps_10_to_60_frames": int(medium.sum()),
        "markers_with_gaps_10_to_60_frames": len(np.unique(marker[medium])),
        "gap_frames_median": float(quantiles[0]),
        "gap_frames_90_percent": float(quantiles[1]),
        "gap_frames_max": float(quantiles[2]),
    }
