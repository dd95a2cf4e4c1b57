"""Movies of a twin, one a camera: body, bones and membranes in grey, and the markers that the camera can see.

What spoils videos (blur, noise, reflections, ...) is in ``mocap.datasets.disturbances``.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mocap.datasets.disturbances import CLEAN, Disturbances, Spoiler
from mocap.datasets.film import FilmedScene, Motion, outside, view
from mocap.datasets.linkage import unit
from mocap.datasets.occlusion import Solid
from mocap.datasets.rig import picture_size
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import Camera, decompose, record
from mocap.io.movies import FIRST_PIXEL, pyav
from mocap.records import PixelTracks

_BACKGROUND, _ROD, _BODY, _BONE, _MARKER = 30, 60, 100, 135, 235
_EDGE_ON, _FACE_ON = 45, 90
_FRACTION_BITS = 4  # OpenCV draws to a sixteenth of a pixel


def write_movies(
    motion: Motion,
    t_s: Array,
    cameras: Sequence[Camera],
    folder: Path,
    *,
    fps: float,
    start_s: Array,
    disturbances: Disturbances = CLEAN,
    seed: int = 0,
    progress: Callable[[float], object] = lambda _: None,
) -> list[Path]:
    """Write ``<camera>.mp4`` (H.264) for every camera.

    Args:
        motion: The animal.
        t_s: (T,) times of the frames of a camera that starts at 0: the middle of their exposures.
        cameras: With sizes.
        folder: Where to.
        fps: Frames a second.
        start_s: (C,) time by which each camera starts late.
        disturbances: What spoils the images.
        seed: Of what is random in them.
        progress: Told the share done.

    Returns:
        The files.
    """
    library, paths = pyav(), []
    for c, (camera, late_s) in enumerate(zip(cameras, start_s, strict=True)):
        paths.append(folder / f"{camera.name}.mp4")
        options = {"crf": str(disturbances.compression), "preset": "veryfast"}
        with library.open(str(paths[-1]), "w") as container:
            stream = container.add_stream("libx264", rate=round(fps), options=options)
            stream.width, stream.height = picture_size(camera)
            stream.pix_fmt = "yuv420p"
            film = pictures(motion, t_s + late_s, camera, fps=fps, disturbances=disturbances, seed=(seed, c))
            for frame, grey in enumerate(film):
                progress((c + frame / len(t_s)) / len(cameras))
                for packet in stream.encode(library.VideoFrame.from_ndarray(grey, format="gray")):
                    container.mux(packet)
            for packet in stream.encode():
                container.mux(packet)
    return paths


def pictures(
    motion: Motion,
    t_s: Array,
    camera: Camera,
    *,
    fps: float,
    disturbances: Disturbances = CLEAN,
    seed: tuple[int, ...] = (0, 0),
) -> Iterator[NDArray[np.uint8]]:
    """The frames of one camera's video, each as it is asked for; arguments as of ``write_movies``.

    Yields:
        (height, width) grey levels.
    """
    scene = motion(t_s)
    uv_px, hidden = visible(scene, camera, disturbances=disturbances, seed=seed)
    spoiler = _spoiler(scene, camera, disturbances, seed)
    steps = _exposure_steps(uv_px, hidden, disturbances.exposure)
    shutter = (np.arange(steps) - (steps - 1) / 2) / steps * disturbances.exposure / fps
    parts = (
        [(scene, uv_px)]
        if steps == 1
        else [(s, record([camera], s.xyz_m)[0]) for s in map(motion, (t_s + late for late in shutter))]
    )
    for frame in range(len(t_s)):
        drawn = [picture(s, camera, frame, uv[frame], hidden[frame], spoiler=spoiler) for s, uv in parts]
        yield spoiler.spoilt(np.asarray(sum(drawn) / np.float32(steps), dtype=np.float32), frame)


def visible(
    scene: FilmedScene, camera: Camera, *, disturbances: Disturbances = CLEAN, seed: tuple[int, ...] = (0, 0)
) -> tuple[Array, NDArray[np.bool_]]:
    """Recorded pixels (T, M, 2), and the markers that a video does not show (T, M): the truth that it is fit for."""
    uv_px, hidden = view(scene, camera)
    if disturbances.occlusion < 1:
        shines = np.random.default_rng([*seed, 7]).random(hidden.shape[1]) >= disturbances.occlusion
        hidden = np.where(shines, outside([camera], scene.xyz_m, uv_px[None])[0], hidden)
    return uv_px, hidden | _spoiler(scene, camera, disturbances, seed).behind_bars(uv_px - FIRST_PIXEL)


def shown_pixels(
    motion: Motion,
    t_s: Array,
    cameras: Sequence[Camera],
    *,
    start_s: Array,
    disturbances: Disturbances = CLEAN,
    seed: int = 0,
) -> PixelTracks:
    """Where the videos of ``write_movies`` show each marker, exactly; NaN where they do not."""
    scenes = [motion(t_s + late_s) for late_s in start_s]
    uv_px = []
    for c, (scene, camera) in enumerate(zip(scenes, cameras, strict=True)):
        exact, hidden = visible(scene, camera, disturbances=disturbances, seed=(seed, c))
        uv_px.append(np.where(hidden[..., None], np.nan, exact))
    names = scenes[0].skeleton.markers
    return PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=np.stack(uv_px))


def _spoiler(scene: FilmedScene, camera: Camera, disturbances: Disturbances, seed: tuple[int, ...]) -> Spoiler:
    bones = sum(bone.rigid for bone in scene.skeleton.bones)
    return Spoiler(sizes=disturbances, size_px=picture_size(camera), n_frames=len(scene.t_s), n_bones=bones, seed=seed)


def _exposure_steps(uv_px: Array, hidden: NDArray[np.bool_], exposure: float) -> int:
    """How many instants of an exposure are averaged: the fastest of most markers moves 2 px from one to the next."""
    if exposure == 0 or len(uv_px) < 2:
        return 1
    moved = np.linalg.norm(np.diff(uv_px, axis=0), axis=-1)[~hidden[1:]]
    fast = float(np.percentile(moved, 99)) if moved.size else 0.0
    return int(np.clip(np.ceil(exposure * fast / 2.0), 2, 8))


def picture(
    scene: FilmedScene,
    camera: Camera,
    frame: int,
    uv_px: Array,
    hidden: NDArray[np.bool_],
    *,
    spoiler: Spoiler | None = None,
) -> NDArray[np.float32]:
    """One instant without noise: what is far is drawn first, the markers that are seen last.

    Args:
        scene: Animal in motion.
        camera: With size.
        frame: Number of the frame.
        uv_px: (M, 2) recorded pixels of the markers.
        hidden: (M,) markers that are not seen.
        spoiler: Background, reflections and look of the dots; None: of a clean video.

    Returns:
        (height, width) grey levels between 0 and 255.
    """
    spoiler = spoiler or _spoiler(scene, camera, CLEAN, (0, 0))
    width, height = picture_size(camera)
    drawn = np.full((height, width), _BACKGROUND, dtype=np.uint8)
    if spoiler.sizes.background:
        drawn = cv2.convertScaleAbs(np.maximum(spoiler.texture + 2.0 * _BACKGROUND, 0))
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
    bone_ends = [(index[bone.a], index[bone.b]) for bone in scene.skeleton.bones if bone.rigid]
    for ends in (xyz_m[list(pair)] for pair in bone_ends):
        # bones lie on the near side of membranes and bodies
        shapes.append((ends.mean(axis=0) - 0.002 * unit(ends.mean(axis=0) - eye_m), ends, _BONE))
    for _, points, shade in sorted(shapes, key=lambda shape: -float(normal[:3] @ shape[0])):
        ahead = points[points @ normal[:3] + normal[3] > 0]
        outline = _fixed(record([camera], ahead)[0])
        if len(points) == 2 and len(ahead) == 2:
            cv2.line(drawn, outline[0].tolist(), outline[1].tolist(), shade, 3, cv2.LINE_AA, _FRACTION_BITS)
        elif len(ahead) > 2:
            cv2.fillConvexPoly(drawn, cv2.convexHull(outline), shade, cv2.LINE_AA, _FRACTION_BITS)
    spots = spoiler.spots(frame, uv_px[bone_ends] - FIRST_PIXEL) + FIRST_PIXEL
    grey = round(_BONE + spoiler.sizes.contrast * (_MARKER - _BONE))
    radius = round(spoiler.sizes.radius_px * 2**_FRACTION_BITS)
    bare = np.isin(scene.skeleton.markers, spoiler.sizes.unpainted)
    for m in np.flatnonzero(bare & ~hidden):
        _draw_skin(drawn, scene, camera, frame, int(m), spoiler.skin(int(m)))
    for dot in _fixed(np.concatenate([spots, uv_px[~hidden & ~bare]])):
        cv2.circle(drawn, dot.tolist(), radius, grey, cv2.FILLED, cv2.LINE_AA, _FRACTION_BITS)
    return np.asarray(cv2.GaussianBlur(drawn.astype(np.float32), (0, 0), 0.7), dtype=np.float32)


def _draw_skin(
    drawn: NDArray[Any], scene: FilmedScene, camera: Camera, frame: int, marker: int, texture: NDArray[np.float32]
) -> None:
    """A round piece of skin about a marker, in the plane of the trunk and turned with it, as the camera sees it."""
    names = scene.skeleton.markers
    trunk = scene.xyz_m[frame, [names.index(name) for name in scene.skeleton.trunk]]
    _, _, axes = np.linalg.svd(trunk - trunk.mean(axis=0))
    ahead = trunk[0] - trunk[-1]
    along = unit(ahead - axes[2] * (ahead @ axes[2]))
    across = np.cross(axes[2] * np.sign(axes[2, 2]), along)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.005
    ends = record([camera], scene.xyz_m[frame, marker] + corners @ np.stack([along, across]))[0] - FIRST_PIXEL
    low, high = np.floor(ends.min(axis=0)).astype(int) - 1, np.ceil(ends.max(axis=0)).astype(int) + 2
    low, high = np.maximum(low, 0), np.minimum(high, drawn.shape[::-1])
    if not (high > low).all():
        return
    n = len(texture)
    source = (np.array([[0, 0], [n, 0], [n, n], [0, n]]) - 0.5).astype(np.float32)
    onto = cv2.getPerspectiveTransform(source, (ends - low).astype(np.float32))
    v, u = np.mgrid[:n, :n] - (n - 1) / 2
    round_ = np.clip(n / 2 - np.hypot(u, v), 0, 1).astype(np.float32)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    skin, share = (cv2.warpPerspective(sheet, onto, size, flags=cv2.INTER_LINEAR) for sheet in (texture, round_))
    part = drawn[low[1] : high[1], low[0] : high[0]]
    part[:] = np.clip(np.rint(part * (1 - share) + (_BODY + skin) * share), 0, 255).astype(np.uint8)


def _fixed(uv_px: Array) -> NDArray[np.int32]:
    """Coordinates of files to OpenCV's of the drawing, in its fractions of a pixel."""
    return np.rint((np.clip(uv_px, -1e4, 1e4) - FIRST_PIXEL) * 2**_FRACTION_BITS).astype(np.int32)


def _surface(solid: Solid, frame: int) -> Array:
    """(N, 3) points of an ellipsoid's surface, or of the piece of a rod that may be in view."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 15), np.linspace(0, 2 * np.pi, 24, endpoint=False))
    across = np.ones_like(polar) if np.isinf(solid.semi_axes_m[0]) else np.sin(polar)
    shape = np.stack([np.cos(polar), across * np.cos(around), across * np.sin(around)], axis=-1)
    points = shape.reshape(-1, 3) * np.minimum(solid.semi_axes_m, 0.3)
    return points @ solid.rotation[frame].T + solid.centre_m[frame]
