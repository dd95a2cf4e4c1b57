"""A calibration session: a board held before every camera of a rig and photographed, with its truth."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from mocap.datasets.boards import Board, photograph, viewfinder
from mocap.datasets.linkage import turn, unit
from mocap.datasets.rig import picture_size

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera, decompose, record

_LEAST_COSINE = 0.3
"""A board is photographed where it faces a camera by 72 degrees or less."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardSession:
    """A board held before a rig, F times.

    Attributes:
        cameras: The C cameras, with sizes.
        board: The board.
        rotation: (F, 3, 3) from the board's axes to the world's.
        translation_m: (F, 3) the board's origin in the world.
        blur_px: Standard deviation of the pictures' blur.
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
        """(C, F, K, 2) where each camera records the inner corners; they may be off its picture or seen from behind."""
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
    """A board held before each camera in turn, tilted, in all parts of its picture; other cameras see what they can.

    Args:
        cameras: With sizes; they look at the world's origin.
        board: The board.
        seed: Any integer; the same gives the same session.
        n_frames: How often it is held up.
        depth: Least and greatest distance from the camera, in distances of the origin.
        blur_px: Standard deviation of the pictures' blur.
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
        pose = eye.rotation.T @ _facing(ray) @ tilted @ upright
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


def _facing(ray: Array) -> Array:
    """(3, 3) axes (x right, y down, z along ``ray``) in those of a camera."""
    z = unit(ray)
    x = unit(np.cross([0.0, 1.0, 0.0], z))
    return np.stack([x, np.cross(z, x), z], axis=1)


def write_board_session(
    session: BoardSession, folder: Path, *, progress: Callable[[float], object] = lambda _: None
) -> int:
    """Write ``images/<camera>/<frame>.png``, ``truth.npz`` and ``card.json``; equal frame names are one instant.

    A picture is written where the board's front is in it, at 72 degrees or less.

    Args:
        session: What to write.
        folder: Where to, a new folder.
        progress: Told the share done.

    Returns:
        Number of pictures.

    Raises:
        FileExistsError: there are pictures already.
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
            if unit(rotation @ middle + translation_m - eye_m) @ rotation[:, 2] < _LEAST_COSINE:
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
