"""Cameras for tests: a ring that looks at the origin, as OpenCV describes it."""

import numpy as np

from mocap.cameras.camera import pinhole_camera
from mocap.cameras.lens import BrownLens


def look_at(position, target=(0.0, 0.0, 0.0)):
    """Rotation world to camera (x right, y down, z forward) of a camera that looks at a target, z of the world up."""
    z = np.asarray(target) - np.asarray(position)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def ring(n, *, radius_m=2.0, f_px=1200.0, lens=False):
    """Cameras on a circle of the given radius, at heights that differ, about the origin."""
    cameras = []
    for i in range(n):
        angle = 2 * np.pi * i / n + 0.3
        position = radius_m * np.array([np.cos(angle), np.sin(angle), 0.3 + 0.2 * (-1) ** i])
        rotation = look_at(position)
        intrinsic = np.array([[f_px, 0, 640.0], [0, f_px * 1.01, 512.0], [0, 0, 1]])
        brown = BrownLens(f_px=(f_px, f_px * 1.01), centre_px=(640.0, 512.0), k=(-0.2, 0.05, 0.01), p=(1e-3, -5e-4))
        cameras.append(
            pinhole_camera(
                f"cam{i + 1}",
                intrinsic=intrinsic,
                rotation=rotation,
                translation_m=-rotation @ position,
                lens=brown if lens else None,
                size_px=(1280, 1024),
            )
        )
    return tuple(cameras)


def cloud(rng, n, *, radius_m=0.3):
    """(n, 3) points within a cube about the origin."""
    return rng.uniform(-radius_m, radius_m, (n, 3))
