"""Movies of a twin, one a camera: body, bones and membranes in grey, and the markers that the camera can see."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets.film import view
from datasets.linkage import unit
from datasets.occlusion import Solid
from datasets.rig import picture_size
from datasets.scene import Motion, Scene
from mocap.arrays import Array
from mocap.cameras.camera import Camera, decompose, record
from mocap.io.film import pyav

FIRST_PIXEL = 1.0
"""Coordinates of the centre of the first pixel in the files of pixels, as DLTdv counts them."""
_BACKGROUND, _ROD, _BODY, _BONE, _MARKER = 30, 60, 100, 135, 235
_EDGE_ON, _FACE_ON = 45, 90
_RADIUS_PX, _BONE_PX = 3.0, 3
_NEARER_M = 0.002  # bones lie on the near side of membranes and bodies
_FRACTION_BITS = 4
_ROD_M = 0.3
_LOSS = "23"


def write_movies(
    motion: Motion,
    t_s: Array,
    cameras: Sequence[Camera],
    folder: Path,
    *,
    fps: float,
    start_s: Array,
    noise: float = 3.0,
    seed: int = 0,
    progress: Callable[[float], object] = lambda _: None,
) -> list[Path]:
    """Write ``<camera>.mp4`` (H.264) for every camera.

    Args:
        motion: The animal.
        t_s: (T,) times of the frames of a camera that starts at 0.
        cameras: With sizes.
        folder: Where to.
        fps: Frames a second.
        start_s: (C,) time by which each camera starts late.
        noise: Standard deviation of the noise, in grey levels of 255.
        seed: Of the noise.
        progress: Told the share done.

    Returns:
        The files.
    """
    library, paths = pyav(), []
    for c, (camera, late_s) in enumerate(zip(cameras, start_s, strict=True)):
        scene = motion(t_s + late_s)
        uv_px, hidden = view(scene, camera)
        rng = np.random.default_rng([seed, c])
        paths.append(folder / f"{camera.name}.mp4")
        with library.open(str(paths[-1]), "w") as container:
            stream = container.add_stream("libx264", rate=round(fps), options={"crf": _LOSS, "preset": "veryfast"})
            stream.width, stream.height = picture_size(camera)
            stream.pix_fmt = "yuv420p"
            for frame in range(len(t_s)):
                progress((c + frame / len(t_s)) / len(cameras))
                clean = picture(scene, camera, frame, uv_px[frame], hidden[frame])
                noisy = clean + noise * rng.standard_normal(clean.shape, dtype=np.float32)
                grey = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
                for packet in stream.encode(library.VideoFrame.from_ndarray(grey, format="gray")):
                    container.mux(packet)
            for packet in stream.encode():
                container.mux(packet)
    return paths


def picture(scene: Scene, camera: Camera, frame: int, uv_px: Array, hidden: NDArray[np.bool_]) -> NDArray[np.float32]:
    """One frame without noise: what is far is drawn first, the markers that are seen last.

    Args:
        scene: Animal in motion.
        camera: With size.
        frame: Number of the frame.
        uv_px: (M, 2) recorded pixels of the markers.
        hidden: (M,) markers that are not seen.

    Returns:
        (height, width) grey levels between 0 and 255.
    """
    width, height = picture_size(camera)
    drawn = np.full((height, width), _BACKGROUND, dtype=np.uint8)
    normal = camera.matrix[2] / np.linalg.norm(camera.matrix[2, :3])
    eye_m, xyz_m = decompose(camera).position_m, scene.xyz_m[frame]
    shapes: list[tuple[Array, Array, int]] = []
    for corners in xyz_m[scene.triangles]:
        middle = corners.mean(axis=0)
        facing = abs(unit(np.cross(corners[1] - corners[0], corners[2] - corners[0])) @ unit(middle - eye_m))
        shapes.append((middle, corners, round(_EDGE_ON + (_FACE_ON - _EDGE_ON) * float(facing))))
    for solid in scene.solids:
        shapes.append(
            (solid.centre_m[frame], _surface(solid, frame), _BODY if np.isfinite(solid.semi_axes_m).all() else _ROD)
        )
    index = {name: m for m, name in enumerate(scene.skeleton.markers)}
    for bone in (bone for bone in scene.skeleton.bones if bone.rigid):
        ends = xyz_m[[index[bone.a], index[bone.b]]]
        shapes.append((ends.mean(axis=0) - _NEARER_M * unit(ends.mean(axis=0) - eye_m), ends, _BONE))
    for _, points, shade in sorted(shapes, key=lambda shape: -float(normal[:3] @ shape[0])):
        ahead = points[points @ normal[:3] + normal[3] > 0]
        outline = _fixed(record([camera], ahead)[0])
        if len(points) == 2 and len(ahead) == 2:
            cv2.line(drawn, outline[0].tolist(), outline[1].tolist(), shade, _BONE_PX, cv2.LINE_AA, _FRACTION_BITS)
        elif len(ahead) > 2:
            cv2.fillConvexPoly(drawn, cv2.convexHull(outline), shade, cv2.LINE_AA, _FRACTION_BITS)
    for seen in _fixed(uv_px[~hidden]):
        radius = round(_RADIUS_PX * 2**_FRACTION_BITS)
        cv2.circle(drawn, seen.tolist(), radius, _MARKER, cv2.FILLED, cv2.LINE_AA, _FRACTION_BITS)
    return np.asarray(cv2.GaussianBlur(drawn.astype(np.float32), (0, 0), 0.7), dtype=np.float32)


def _fixed(uv_px: Array) -> NDArray[np.int32]:
    """Coordinates of files to OpenCV's of the drawing, in its fractions of a pixel."""
    return np.rint((np.clip(uv_px, -1e4, 1e4) - FIRST_PIXEL) * 2**_FRACTION_BITS).astype(np.int32)


def _surface(solid: Solid, frame: int) -> Array:
    """(N, 3) points of an ellipsoid's surface, or of the piece of a rod that may be in view."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 15), np.linspace(0, 2 * np.pi, 24, endpoint=False))
    across = np.ones_like(polar) if np.isinf(solid.semi_axes_m[0]) else np.sin(polar)
    shape = np.stack([np.cos(polar), across * np.cos(around), across * np.sin(around)], axis=-1)
    points = shape.reshape(-1, 3) * np.minimum(solid.semi_axes_m, _ROD_M)
    return points @ solid.rotation[frame].T + solid.centre_m[frame]
