"""A whole rig from views of a board: lenses one by one, camera poses along a chain, then everything together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.calibration.boards import Board, BoardViews
from mocap.calibration.bundle import adjust
from mocap.calibration.chain import chained, rigid
from mocap.calibration.intrinsics import CHOICES, Intrinsics, fit_intrinsics, lens_trouble, place, without_ray
from mocap.calibration.scene import Adjusted, Free, RigCamera, RigScene, Sightings, in_world, turned_rad
from mocap.cameras.lens import Lens
from mocap.errors import CalibrationError

UP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Board axes (x along the first row of corners, z into it) to world axes (z out of the board, up where it lies)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardCalibration:
    """A calibrated rig, in the frame of one placement of the board.

    Attributes:
        cameras: The C cameras.
        world_frame: Instant whose board is the world's x-y plane, origin at its first corner, z towards the viewer.
        intrinsics: How each lens was chosen, by images of its camera alone.
        f_sd_px: (C,) standard deviations of the focal lengths.
        rms_px: Root mean square error of all corners.
        camera_px: Root mean square and median error by camera.
        image_px: Root mean square error by camera and instant.
        no_ray: Share of each image that no ray reaches.
        left_out: Why images were not used, by camera and instant: they agree with no other, or miss by far.
        T_world_from_board: By instant, (4, 4) places of the board.
    """

    cameras: tuple[RigCamera, ...]
    world_frame: str
    intrinsics: tuple[Intrinsics, ...]
    f_sd_px: Array
    rms_px: float
    camera_px: Mapping[str, tuple[float, float]]
    image_px: Mapping[str, Mapping[str, float]]
    no_ray: Mapping[str, float]
    left_out: Mapping[tuple[str, str], str]
    T_world_from_board: Mapping[str, Array]


def calibrate_boards(
    views: Mapping[str, BoardViews],
    board: Board,
    *,
    world_frame: str | None = None,
    choices: Sequence[str] = tuple(CHOICES),
    lenses: Mapping[str, Lens] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> BoardCalibration:
    """Calibrate cameras from their views of one board.

    Args:
        views: By camera, the corners at each instant.
        board: The board.
        world_frame: Instant whose board gives the world; None: the first that most cameras see.
        choices: Lens models to choose among (``intrinsics.CHOICES``).
        lenses: Known lenses by camera, which are held; None: they are found.
        progress: Told of each stage.

    Raises:
        CalibrationError: too few images, no chain between the cameras, or a result that cannot be.
    """
    names = list(views)
    intrinsics = []
    for name in names:
        if lenses is not None:
            intrinsics.append(_fixed_lens(lenses, name))
            continue
        found = fit_intrinsics(list(views[name].corners.values()), views[name].size_px, name=name, choices=choices)
        intrinsics.append(found)
        progress(f"{name}: {found.choice} lens, f {found.lens.f_px[0]:.1f} px, {found.rms_px:.3f} px on its own images")
    seen, outlying = {}, dict[tuple[str, str], str]()
    for i, name in enumerate(names):
        for k, (stem, corners) in enumerate(views[name].corners.items()):
            if k in intrinsics[i].left_out:
                outlying[name, stem] = intrinsics[i].left_out[k]
            elif (at := place(corners, intrinsics[i].lens)) is not None:
                seen[i, stem] = rigid(*at)
    turn = None
    if board.turnable:  # by 180 degrees about the middle of its corners
        turn = rigid(np.diag([-1.0, -1.0, 1.0]), board.points().max(axis=0) * [1.0, 1.0, 0.0])
    T_camera = chained(seen, names, turn)
    boards, turned, left_out = _boards(seen, T_camera, turn)
    stems = list(boards)
    world_frame = _world(world_frame, stems, seen)
    sightings, pictures = _sightings(views, names, stems, seen, turned, left_out)
    scene = RigScene(
        cameras=tuple(
            RigCamera(name=n, lens=i.lens, rotation=T[:3, :3], translation_m=T[:3, 3], size_px=views[n].size_px)
            for n, i, T in zip(names, intrinsics, T_camera, strict=True)
        ),
        rotation=np.stack([boards[s][:3, :3] for s in stems]),
        position_m=np.stack([boards[s][:3, 3] for s in stems]),
    )
    if lenses is None:
        free = Free(coefficients=tuple(CHOICES[i.choice][1] for i in intrinsics), orientation=True)
    else:
        free = Free(focal="none", centre=False, orientation=True)
    adjusted = adjust(scene, sightings, free=free)
    progress(f"all cameras together: median error {np.median(np.hypot(*adjusted.error_px.T)):.3f} px")
    why = outlying | {(names[i], stem): "it agrees with no other view of the board" for i, stem in left_out}
    return _result(adjusted, sightings, pictures, views, tuple(intrinsics), stems, world_frame, why)


def _fixed_lens(lenses: Mapping[str, Lens], name: str) -> Intrinsics:
    if name not in lenses:
        raise CalibrationError(f"camera {name!r} has no known lens: there are {', '.join(map(repr, lenses))}")
    return Intrinsics(lens=lenses[name], choice="known", held_out_px={}, f_sd_px=0.0, rms_px=0.0, cov=np.zeros((0, 0)))


def _boards(
    seen: Mapping[tuple[int, str], Array], T_camera: Sequence[Array], turn: Array | None
) -> tuple[dict[str, Array], set[tuple[int, str]], list[tuple[int, str]]]:
    """Places of the boards in the first camera's axes, views that see them turned, views that agree with no other."""
    boards, turned, odd = {}, set(), []
    for stem in dict.fromkeys(s for _, s in seen):
        cameras = [c for c, s in seen if s == stem]
        place_of = {c: np.linalg.inv(T_camera[c]) @ seen[c, stem] for c in cameras}
        best, fewest = None, (-1, -np.inf)
        for a in cameras:
            off = {b: _apart(place_of[a], place_of[b], turn, seen[b, stem]) for b in cameras}
            score = (sum(o[0] < 0.15 for o in off.values()), -sum(o[0] for o in off.values()))
            if best is None or score > fewest:
                best, fewest = (a, off), score
        assert best is not None
        boards[stem] = place_of[best[0]]
        turned |= {(b, stem) for b, o in best[1].items() if o[1]}
        odd += [(b, stem) for b, o in best[1].items() if o[0] >= 0.15]
    return boards, turned, odd


def _apart(a: Array, b: Array, turn: Array | None, view: Array) -> tuple[float, bool]:
    """How two places of a board differ (radians, or share of its distance), and whether they agree better turned."""
    off = []
    for other in [b] if turn is None else [b, b @ turn]:
        angle = turned_rad(a[:3, :3].T @ other[:3, :3])
        off.append(max(float(angle), float(np.linalg.norm(a[:3, 3] - other[:3, 3]) / np.linalg.norm(view[:3, 3]))))
    return min(off), int(np.argmin(off)) == 1


def _world(requested: str | None, stems: Sequence[str], seen: Mapping[tuple[int, str], Array]) -> str:
    if requested is None:
        return max(stems, key=lambda s: sum(t == s for _, t in seen))
    if requested not in stems:
        raise CalibrationError(
            f"no camera sees the board in the world frame {requested!r}: choose one of {', '.join(stems[:20])}"
        )
    return requested


def _sightings(
    views: Mapping[str, BoardViews],
    names: Sequence[str],
    stems: Sequence[str],
    seen: Mapping[tuple[int, str], Array],
    turned: set[tuple[int, str]],
    left_out: Sequence[tuple[int, str]],
) -> tuple[Sightings, list[tuple[int, str]]]:
    camera, body, local, uv, pictures = [], [], [], [], []
    for i, stem in seen:
        if (i, stem) in left_out:
            continue
        corners = views[names[i]].corners[stem]
        n = len(corners.ids)
        camera.append(np.full(n, i))
        body.append(np.full(n, stems.index(stem)))
        local.append(corners.local_m)
        uv.append(corners.uv_px[::-1] if (i, stem) in turned else corners.uv_px)
        pictures += [(i, stem)] * n
    return (
        Sightings(
            camera=np.concatenate(camera),
            body=np.concatenate(body),
            local_m=np.concatenate(local),
            uv_px=np.concatenate(uv),
        ),
        pictures,
    )


def _result(
    adjusted: Adjusted,
    sightings: Sightings,
    pictures: list[tuple[int, str]],
    views: Mapping[str, BoardViews],
    intrinsics: tuple[Intrinsics, ...],
    stems: Sequence[str],
    world_frame: str,
    left_out: Mapping[tuple[str, str], str],
) -> BoardCalibration:
    names = list(views)
    squares = np.sum(adjusted.error_px**2, axis=-1)
    at = stems.index(world_frame)
    board = rigid(adjusted.scene.rotation[at], adjusted.scene.position_m[at])
    T_world = UP @ np.linalg.inv(board)
    camera_px = {
        n: (float(np.sqrt(s.mean())), float(np.sqrt(np.median(s))))
        for i, n in enumerate(names)
        for s in [squares[sightings.camera == i]]
    }
    image: dict[str, dict[str, list[float]]] = {n: {} for n in names}
    for (i, stem), square in zip(pictures, squares, strict=True):
        image[names[i]].setdefault(stem, []).append(float(square))
    result = BoardCalibration(
        cameras=in_world(adjusted.scene.cameras, T_world),
        world_frame=world_frame,
        intrinsics=intrinsics,
        f_sd_px=adjusted.f_sd_px,
        rms_px=float(np.sqrt(squares.mean())),
        camera_px=camera_px,
        image_px={n: {s: float(np.sqrt(np.mean(v))) for s, v in per.items()} for n, per in image.items()},
        no_ray={c.name: without_ray(c.lens, views[c.name].size_px) for c in adjusted.scene.cameras},
        left_out=left_out,
        T_world_from_board={
            s: T_world @ rigid(r, p)
            for s, r, p in zip(stems, adjusted.scene.rotation, adjusted.scene.position_m, strict=True)
        },
    )
    _refuse(result, views)
    return result


def _refuse(result: BoardCalibration, views: Mapping[str, BoardViews]) -> None:
    """What no rig of real cameras is.

    Raises:
        CalibrationError: a lens that cannot be, a focal length that the images do not determine, errors far above
            those of finding corners, or two cameras in one place.
    """
    for camera, sd in zip(result.cameras, result.f_sd_px, strict=True):
        size, name = views[camera.name].size_px, camera.name
        if trouble := lens_trouble(camera.lens, size):
            raise CalibrationError(f"camera {name!r}: its lens {trouble}: film the board at more places and tilts")
        if sd > 0.03 * camera.lens.f_px[0]:
            raise CalibrationError(
                f"camera {name!r}: the images do not determine its focal length ({camera.lens.f_px[0]:.0f} +- "
                f"{sd:.0f} px)"
                ": tilt the board by 30 degrees or more in some images"
            )
        median = result.camera_px[name][1]
        if median > 2e-3 * max(size):
            raise CalibrationError(
                f"camera {name!r}: the median error of corners is {median:.1f} px, where their detection is "
                "accurate to tenths of a pixel: check that images taken at the same time have the same name, "
                "none is mirrored or cropped, and the board is flat"
            )
    for i, a in enumerate(result.cameras):
        for b in result.cameras[:i]:
            size = np.linalg.norm(a.position_m) + np.linalg.norm(b.position_m)
            if np.linalg.norm(a.position_m - b.position_m) < 1e-6 * size:
                raise CalibrationError(
                    f"cameras {b.name!r} and {a.name!r} are at the same place: are their images the same files?"
                )
