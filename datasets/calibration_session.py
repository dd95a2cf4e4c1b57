"""Calibration sessions with their truth: a board photographed by every camera of a rig, and a wand waved in view."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from mocap.datasets.film import outside
from mocap.datasets.linkage import draw_wander, rotated, turn, unit
from mocap.datasets.rig import picture_size
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera, decompose, record
from mocap.cameras.lens import BrownLens
from mocap.io.dltdv import write_pixels
from mocap.io.profile import write_profile
from mocap.records import PixelTracks

_TEXELS = 80  # a square
_GRID_PX = 8
_SUPERSAMPLED = 3  # samples along an edge of a pixel, which is their mean
_WHITE, _BLACK, _BEHIND = 0.85, 0.06, 0.35  # share of light that comes back


@dataclass(frozen=True, kw_only=True)
class Board:
    """A checkerboard, or a ChArUco board where ``marker_m`` is not 0.

    Its axes lie in its plane, x along the columns and y down the rows as a viewer sees them, from the outer corner of
    the first square; z points away from the viewer.

    Attributes:
        columns: Squares along x.
        rows: Squares along y.
        square_m: Side of a square.
        marker_m: Side of a ChArUco marker, of the dictionary 4X4_50; 0: a plain checkerboard.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0

    @property
    def corners_m(self) -> Array:
        """((columns - 1) (rows - 1), 3) inner corners, row by row, in the board's axes."""
        x, y = np.meshgrid(np.arange(1.0, self.columns), np.arange(1.0, self.rows))
        return self.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)

    @property
    def options(self) -> str:
        """What ``mocap calibrate images`` is told of it."""
        if self.marker_m:
            kind = f"--charuco {self.columns}x{self.rows} --marker-mm {1e3 * self.marker_m:g}"
        else:
            kind = f"--checkerboard {self.columns - 1}x{self.rows - 1}"
        return f"{kind} --square-mm {1e3 * self.square_m:g}"

    def texture(self) -> NDArray[np.float32]:
        """Share of light that comes back, ``_TEXELS`` a square, with a white margin of one square all around."""
        if self.marker_m:
            dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
            drawn = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)
            white = drawn.generateImage((self.columns * _TEXELS, self.rows * _TEXELS), marginSize=0) > 127
        else:
            odd = np.add.outer(np.arange(self.rows), np.arange(self.columns)) % 2 == 1
            white = np.kron(odd, np.ones((_TEXELS, _TEXELS), dtype=bool))
        return np.pad(np.where(white, _WHITE, _BLACK), _TEXELS, constant_values=_WHITE).astype(np.float32)


@dataclass(frozen=True, eq=False, kw_only=True)
class Viewfinder:
    """Which ideal pixel each recorded one shows: what is needed to draw through a lens.

    Attributes:
        camera: With size.
        across: Ideal u over recorded (v, u).
        down: Ideal v over recorded (v, u).
    """

    camera: Camera
    across: RectBivariateSpline
    down: RectBivariateSpline

    def ideal(self, v_px: Array, u_px: Array) -> Array:
        """(V, U, 2) ideal pixels on the grid of recorded rows (V,) and columns (U,)."""
        return np.stack([self.across(v_px, u_px), self.down(v_px, u_px)], axis=-1)


def viewfinder(camera: Camera) -> Viewfinder:
    """Undistort a grid of 8 px and lay bicubic splines through it; they are right to 1e-4 px in the lenses here.

    Raises:
        ValueError: the camera has no size, or its lens shows the same direction twice within the image.
    """
    u, v = (np.arange(-2.0 * _GRID_PX, n + 3 * _GRID_PX, _GRID_PX) for n in picture_size(camera))
    recorded = np.stack(np.meshgrid(u, v), axis=-1)
    ideal = recorded if camera.lens is None else camera.lens.undistort(recorded)
    if not np.isfinite(ideal).all():
        raise ValueError(f"camera {camera.name!r}: its lens has no inverse over all of the image: weaken it")
    return Viewfinder(
        camera=camera,
        across=RectBivariateSpline(v, u, ideal[..., 0]),
        down=RectBivariateSpline(v, u, ideal[..., 1]),
    )


def photograph(
    finder: Viewfinder,
    board: Board,
    texture: NDArray[np.float32],
    *,
    rotation: Array,
    translation_m: Array,
    rng: np.random.Generator,
    blur_px: float,
    noise: float,
) -> NDArray[np.uint8] | None:
    """An 8-bit grey image of a board; every pixel is the mean of 3 x 3 rays, blurred, with noise.

    Args:
        finder: Of the camera.
        board: The board.
        texture: ``board.texture()``.
        rotation: (3, 3) from the board's axes to the world's.
        translation_m: (3,) the board's origin in the world.
        rng: Source of the noise.
        blur_px: Standard deviation of the blur.
        noise: Standard deviation of the noise, in grey levels of 255.

    Returns:
        (height, width) grey levels; None where no part of the front of the board is in the image.
    """
    camera = finder.camera
    width, height = picture_size(camera)
    plane = camera.matrix @ np.vstack([np.column_stack([rotation[:, :2], translation_m]), [0, 0, 1]])
    if np.linalg.det(plane) <= 0:  # seen from behind
        return None
    scale = _TEXELS / board.square_m
    from_ideal = np.array([[scale, 0, _TEXELS], [0, scale, _TEXELS], [0, 0, 1]]) @ np.linalg.inv(plane)

    def texels(v_px: Array, u_px: Array) -> Array:
        ideal = finder.ideal(v_px, u_px)
        x, y, w = np.moveaxis(ideal @ from_ideal[:, :2].T + from_ideal[:, 2], -1, 0)
        return np.where((w > 0)[..., None], np.stack([x, y], axis=-1) / w[..., None], -1e6)

    u, v = np.arange(0.0, width, _GRID_PX), np.arange(0.0, height, _GRID_PX)
    inside = ((coarse := texels(v, u)) > 0).all(axis=-1) & (coarse < texture.shape[::-1]).all(axis=-1)
    if not inside.any():
        return None
    light = np.full((height, width), _BEHIND)
    rows, columns = (np.flatnonzero(some) * _GRID_PX for some in (np.any(inside, axis=1), np.any(inside, axis=0)))
    top, left = max(rows[0] - _GRID_PX, 0), max(columns[0] - _GRID_PX, 0)
    bottom, right = min(rows[-1] + 2 * _GRID_PX, height), min(columns[-1] + 2 * _GRID_PX, width)
    within = (np.arange(_SUPERSAMPLED) + 0.5) / _SUPERSAMPLED - 0.5
    fine_v, fine_u = (np.add.outer(np.arange(a, b), within).ravel() for a, b in ((top, bottom), (left, right)))
    x, y = np.moveaxis(texels(fine_v, fine_u) - 0.5, -1, 0).astype(np.float32)
    drawn = cv2.remap(texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(_BEHIND,))
    blocks = drawn.reshape(bottom - top, _SUPERSAMPLED, right - left, _SUPERSAMPLED)
    light[top:bottom, left:right] = blocks.mean(axis=(1, 3))
    if blur_px > 0:
        light = cv2.GaussianBlur(light, (0, 0), blur_px)
    # (height, width) falling from 1 in the middle to 0.7 in the corners
    v, u = np.linspace(-1, 1, height) ** 2, np.linspace(-1, 1, width) ** 2
    grey = 255 * light * (1 - 0.15 * np.add.outer(v, u)) + noise * rng.standard_normal(light.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardSession:
    """A board held before a rig, F times.

    Attributes:
        cameras: The C cameras, with sizes.
        board: The board.
        rotation: (F, 3, 3) from the board's axes to the world's.
        translation_m: (F, 3) the board's origin in the world.
        blur_px: Standard deviation of the images' blur.
        noise: Standard deviation of their noise, in grey levels of 255.
        seed: Of all chance.
    """

    cameras: tuple[Camera, ...]
    board: Board
    rotation: Array
    translation_m: Array
    blur_px: float
    noise: float
    seed: int

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "rotation", frozen("rotation", self.rotation, (None, 3, 3)))
        object.__setattr__(self, "translation_m", frozen("translation_m", self.translation_m, (len(self.rotation), 3)))

    @property
    def corners_px(self) -> Array:
        """(C, F, K, 2) where each camera records the inner corners; they may be off its image or seen from behind."""
        world = np.einsum("fij,kj->fki", self.rotation, self.board.corners_m) + self.translation_m[:, None]
        return record(self.cameras, world)


def board_session(
    cameras: Sequence[Camera],
    board: Board,
    *,
    seed: int,
    n_frames: int = 40,
    depth: tuple[float, float] = (0.7, 1.1),
    blur_px: float = 0.7,
    noise: float = 1.5,
) -> BoardSession:
    """A board held before each camera in turn, tilted, in all parts of its image; other cameras see what they can.

    Args:
        cameras: With sizes; they look at the world's origin.
        board: The board.
        seed: Any integer; the same gives the same session.
        n_frames: How often it is held up.
        depth: Least and greatest distance from the camera, in distances of the origin.
        blur_px: Standard deviation of the images' blur.
        noise: Standard deviation of their noise, in grey levels of 255.
    """
    rng = np.random.default_rng(seed)
    rotation, translation = [], []
    for frame in range(n_frames):
        camera = cameras[frame % len(cameras)]
        eye, recorded = decompose(camera), rng.uniform(0.2, 0.8, 2) * picture_size(camera)
        ideal = recorded if camera.lens is None else camera.lens.undistort(recorded)
        ray = np.linalg.solve(eye.intrinsic, np.append(ideal, 1.0))
        distance = rng.uniform(*depth) * np.linalg.norm(eye.position_m)
        centre = eye.position_m + distance * eye.rotation.T @ unit(ray)
        upright = turn(2, rng.uniform(-0.4, 0.4))
        tilted = turn(1, rng.uniform(-0.6, 0.6)) @ turn(0, rng.uniform(-0.6, 0.6))
        # (3, 3) axes (x right, y down, z along ``ray``) in those of a camera
        z = unit(ray)
        x = unit(np.cross([0.0, 1.0, 0.0], z))
        pose = eye.rotation.T @ np.stack([x, np.cross(z, x), z], axis=1) @ tilted @ upright
        rotation.append(pose)
        half = np.array([board.columns, board.rows, 0]) * board.square_m / 2
        translation.append(centre - pose @ half)
    return BoardSession(
        cameras=tuple(cameras),
        board=board,
        rotation=np.array(rotation).reshape(-1, 3, 3),
        translation_m=np.array(translation).reshape(-1, 3),
        blur_px=blur_px,
        noise=noise,
        seed=seed,
    )


def write_board_session(
    session: BoardSession, folder: Path, *, progress: Callable[[float], object] = lambda _: None
) -> int:
    """Write ``images/<camera>/<frame>.png``, ``truth.npz`` and ``card.json``; equal frame names are one instant.

    An image is written where the board's front is in it, at 72 degrees or less.

    Args:
        session: What to write.
        folder: Where to, a new folder.
        progress: Told the share done.

    Returns:
        Number of images.

    Raises:
        FileExistsError: there are images already.
    """
    images = folder / "images"
    images.mkdir(parents=True)
    texture, count = session.board.texture(), 0
    middle = session.board.corners_m.mean(axis=0)
    for c, camera in enumerate(session.cameras):
        finder, eye_m = viewfinder(camera), decompose(camera).position_m
        rng = np.random.default_rng([session.seed, c])
        (images / camera.name).mkdir()
        for f, (rotation, translation_m) in enumerate(zip(session.rotation, session.translation_m, strict=True)):
            progress((c * len(session.rotation) + f) / (len(session.cameras) * len(session.rotation)))
            if unit(rotation @ middle + translation_m - eye_m) @ rotation[:, 2] < 0.3:  # 72 degrees
                continue
            picture = photograph(
                finder,
                session.board,
                texture,
                rotation=rotation,
                translation_m=translation_m,
                rng=rng,
                blur_px=session.blur_px,
                noise=session.noise,
            )
            if picture is not None:
                path = images / camera.name / f"{f + 1:04d}.png"
                path.write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes())
                count += 1
    np.savez_compressed(
        folder / "truth.npz",
        rotation=session.rotation,
        translation_m=session.translation_m,
        corners_m=session.board.corners_m,
        corners_px=session.corners_px,
        matrices=np.stack([c.matrix for c in session.cameras]),
    )
    card = {
        "board": asdict(session.board),
        "options": session.board.options,
        "cameras": [c.name for c in session.cameras],
        "frames": len(session.rotation),
        "pictures": count,
        "blur_px": session.blur_px,
        "noise_grey_levels": session.noise,
        "seed": session.seed,
    }
    (folder / "card.json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    return count


@dataclass(frozen=True, eq=False, kw_only=True)
class WandSweep:
    """A wand in motion.

    Attributes:
        cameras: The C cameras, with sizes.
        length_m: Distance of its ends.
        pixels: Of ``wand_1`` and ``wand_2``, as recorded; NaN where off the image.
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
