"""Boards before cameras, as corners with noise: what detection gives, with its truth."""

from dataclasses import replace

import numpy as np

from mocap.calibration.boards import BoardViews, Checkerboard, Corners
from mocap.calibration.scene import RigCamera, rig_camera, turn
from mocap.cameras.lens import BrownLens, Lens
from tests.mocap.rigs import ring

SIZE = (1280, 1024)
BOARD = Checkerboard(columns=9, rows=6, square_m=0.03)


def rig(n: int, lens: Lens | None = None) -> tuple[RigCamera, ...]:
    """A ring of n cameras that look at the origin from 2 m."""
    lens = BrownLens.of((1200.0, 1212.0), (645.0, 505.0), (-0.2, 0.08, 0.0, 0.0, 0.0)) if lens is None else lens
    cameras = [replace(c, lens=None) for c in ring(n)]
    return tuple(replace(rig_camera(c), lens=lens, size_px=SIZE) for c in cameras)


def poses(rng: np.random.Generator, camera: RigCamera, n: int, *, spread_m: float = 0.35) -> list[np.ndarray]:
    """(4, 4) boards held before a camera, tilted by up to 40 degrees, turned in their plane by up to 25."""
    out = []
    for _ in range(n):
        tilt = turn(np.array([*rng.uniform(-0.7, 0.7, 2), 0.0])) @ turn(np.array([0.0, 0.0, rng.uniform(-0.45, 0.45)]))
        middle = BOARD.points().mean(axis=0)
        T = np.eye(4)
        T[:3, :3] = camera.rotation.T @ tilt
        T[:3, 3] = rng.uniform(-spread_m, spread_m, 3) * [1, 1, 0.7] - T[:3, :3] @ middle
        out.append(T)
    return out


def seen(
    rng: np.random.Generator,
    cameras: tuple[RigCamera, ...],
    boards: dict[str, np.ndarray],
    *,
    noise_px: float = 0.1,
    who: dict[str, set[int]] | None = None,
    local: np.ndarray | None = None,
) -> dict[str, BoardViews]:
    """What each camera sees: corners inside its picture, of boards that face it; whole boards only.

    Args:
        rng: Of the noise.
        cameras: The cameras.
        boards: (4, 4) place of each instant's board.
        noise_px: Standard deviation of a corner's coordinate.
        who: Cameras that may see an instant; None: all.
        local: Corners of the board; None: those of ``BOARD``.
    """
    local = BOARD.points() if local is None else local
    out = {}
    for i, camera in enumerate(cameras):
        corners = {}
        for stem, T in boards.items():
            if who is not None and i not in who[stem]:
                continue
            facing = (camera.rotation @ T[:3, 2])[2] > 0.4
            uv = camera.record(local @ T[:3, :3].T + T[:3, 3])
            if facing and (uv > 5).all() and (uv < np.array(SIZE) - 5).all():
                uv = uv + rng.normal(0, noise_px, uv.shape)
                corners[stem] = Corners(ids=np.arange(len(local)), local_m=local, uv_px=uv)
        out[camera.name] = BoardViews(size_px=SIZE, corners=corners)
    return out
