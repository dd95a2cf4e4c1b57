"""A wand swept through the volume of a rig, as wand calibration wants it, with its truth."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mocap.datasets.film import outside
from mocap.datasets.linkage import rotated, turn
from mocap.datasets.wander import draw_wander

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera, record
from mocap.cameras.lens import BrownLens
from mocap.io.dltdv import write_pixels
from mocap.io.profile import write_profile
from mocap.records import PixelTracks


@dataclass(frozen=True, eq=False, kw_only=True)
class WandSweep:
    """A wand in motion.

    Attributes:
        cameras: The C cameras, with sizes.
        length_m: Distance of its ends.
        pixels: Of ``wand_1`` and ``wand_2``, as recorded; NaN where off the picture.
        xyz_m: (T, 2, 3) true ends.
        click_px: Standard deviation of a pixel.
        seed: Of all chance.
    """

    cameras: tuple[Camera, ...]
    length_m: float
    pixels: PixelTracks
    xyz_m: Array
    click_px: float
    seed: int

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "xyz_m", frozen("xyz_m", self.xyz_m, (len(self.pixels.t_s), 2, 3)))


def wand_sweep(
    cameras: Sequence[Camera],
    *,
    seed: int,
    length_m: float,
    reach_m: Sequence[float],
    n_frames: int = 300,
) -> WandSweep:
    """A wand that is waved and tumbled about the world's origin.

    Args:
        cameras: With sizes.
        seed: Any integer; the same gives the same sweep.
        length_m: Distance of the ends.
        reach_m: (3,) root mean square way of its middle along each axis.
        n_frames: Number of frames.
    """
    fps, click_px = 60.0, 0.3  # the middle of a light or ball is found better than a skin marker
    rng = np.random.default_rng(seed)
    t_s = np.arange(n_frames) / fps
    middle = np.stack([reach * draw_wander(rng, band_hz=(0.1, 0.6)).value(t_s) for reach in reach_m], axis=-1)
    yaw, pitch = (draw_wander(rng, band_hz=(0.1, 0.5)).value(t_s) for _ in range(2))
    along = rotated(turn(2, 1.5 * yaw) @ turn(1, 0.8 * pitch), np.array([length_m / 2, 0, 0]))
    xyz_m = np.stack([middle + along, middle - along], axis=1)
    exact_px = record(cameras, xyz_m)
    uv_px = exact_px + click_px * rng.standard_normal(exact_px.shape)
    uv_px[outside(cameras, xyz_m, exact_px)] = np.nan
    names = tuple(c.name for c in cameras)
    return WandSweep(
        cameras=tuple(cameras),
        length_m=length_m,
        pixels=PixelTracks(names=("wand_1", "wand_2"), cameras=names, t_s=t_s, uv_px=uv_px),
        xyz_m=xyz_m,
        click_px=click_px,
        seed=seed,
    )


def write_wand_sweep(sweep: WandSweep, folder: Path) -> None:
    """Write ``wand_xypts.csv`` (DLTdv: what easyWand and Argus take), ``truth.npz``, ``card.json``.

    The true lenses are written as a camera profile where all are Brown's: wand calibration takes lenses as known.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_pixels(folder / "wand_xypts.csv", sweep.pixels)
    if all(isinstance(camera.lens, BrownLens) for camera in sweep.cameras):
        write_profile(folder / "wand_camera_profile.txt", sweep.cameras)
    np.savez_compressed(
        folder / "truth.npz", xyz_m=sweep.xyz_m, matrices=np.stack([camera.matrix for camera in sweep.cameras])
    )
    card = {
        "wand_length_m": sweep.length_m,
        "cameras": [camera.name for camera in sweep.cameras],
        "frames": len(sweep.xyz_m),
        "both_ends_seen": sweep.pixels.seen.all(axis=2).mean(axis=1).round(4).tolist(),
        "click_px": sweep.click_px,
        "seed": sweep.seed,
    }
    (folder / "card.json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
