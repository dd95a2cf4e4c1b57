"""What ``mocap data`` makes: every twin, pendulum and calibration session, by name."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from mocap.datasets.bats import bat_motion, make_bat, make_bat_wind_tunnel
from mocap.datasets.calibration_session import Board, board_session, wand_sweep, write_board_session, write_wand_sweep
from mocap.datasets.disturbances import ALL, CLEAN, Disturbances
from mocap.datasets.film import Motion, SyntheticRecording
from mocap.datasets.folder import write_recording
from mocap.datasets.lizards import SLOPE_RAD, lizard_motion, make_lizard
from mocap.datasets.movie import shown_pixels, write_movies
from mocap.datasets.pendulums import Pendulum, make_pendulum, write_pendulum
from mocap.datasets.rig import tank_cameras, tunnel_cameras

from mocap.cameras.camera import Camera
from mocap.errors import MocapError
from mocap.io.dltdv import write_pixels
from mocap.io.output import Tell, result_folder, silent

Progress = Callable[[float], object]
_TUNNEL_BOARD = Board(columns=10, rows=7, square_m=0.025)
_TUNNEL_CHARUCO = Board(columns=7, rows=5, square_m=0.036, marker_m=0.027)
_TANK_BOARD = Board(columns=10, rows=7, square_m=0.012)
_TANK_CHARUCO = Board(columns=7, rows=5, square_m=0.018, marker_m=0.0135)


@dataclass(frozen=True, kw_only=True)
class CatalogueEntry:
    """Something that can be made.

    Attributes:
        name: How to ask for it.
        what: One line on what it is.
        write: Writes it into an empty folder, from a seed; tells the share done.
    """

    name: str
    what: str
    write: Callable[[int, Path, Progress], object]


def _recording(name: str, what: str, make: Callable[..., SyntheticRecording], **options: Any) -> CatalogueEntry:
    def write(seed: int, folder: Path, _: Progress) -> None:
        write_recording(make(seed=seed, **options), folder, others=True)

    return CatalogueEntry(name=name, what=what, write=write)


def _movies(
    name: str,
    what: str,
    make: Callable[..., SyntheticRecording],
    motion: Callable[[int], Motion],
    disturbances: Disturbances = CLEAN,
    **options: Any,
) -> CatalogueEntry:
    def write(seed: int, folder: Path, progress: Progress) -> None:
        recording = make(seed=seed, **options)
        filmed = {"start_s": recording.start_s, "disturbances": disturbances, "seed": seed}
        t_s, cameras = recording.truth.t_s, recording.cameras
        card = {**recording.card, "films": asdict(disturbances)}
        write_recording(replace(recording, card=card), folder, others=True)
        write_pixels(folder / f"{recording.name}_shown.csv", shown_pixels(motion(seed), t_s, cameras, **filmed))
        write_movies(motion(seed), t_s, cameras, folder, fps=recording.fps, progress=progress, **filmed)

    return CatalogueEntry(name=name, what=what, write=write)


def _pendulum(name: str, what: str, kind: Pendulum, noise_m: float) -> CatalogueEntry:
    def write(seed: int, folder: Path, _: Progress) -> None:
        write_pendulum(make_pendulum(kind, seed=seed, noise_m=noise_m), folder)

    return CatalogueEntry(name=name, what=what, write=write)


def _session(
    name: str, what: str, rig: Callable[[], tuple[Camera, ...]], board: Board, n_frames: int
) -> CatalogueEntry:
    depth = (0.7, 1.1) if board.square_m > 0.02 else (0.85, 1.1)

    def write(seed: int, folder: Path, progress: Progress) -> None:
        session = board_session(rig(), board, seed=seed, n_frames=n_frames, depth=depth)
        write_board_session(session, folder, progress=progress)

    return CatalogueEntry(name=name, what=what, write=write)


def _wand(name: str, what: str, rig: Callable[[], tuple[Camera, ...]], size_m: float) -> CatalogueEntry:
    def write(seed: int, folder: Path, _: Progress) -> None:
        reach_m = (1.5 * size_m, 0.7 * size_m, 0.7 * size_m)
        write_wand_sweep(wand_sweep(rig(), seed=seed, length_m=size_m, reach_m=reach_m), folder)

    return CatalogueEntry(name=name, what=what, write=write)


_TANK = partial(tank_cameras, 4, slope_rad=SLOPE_RAD)
_TUNNEL, _FISHEYES = partial(tunnel_cameras, 8), partial(tunnel_cameras, 8, lens="fisheye")
_BAT_FILM: dict[str, Any] = {"make": make_bat, "motion": bat_motion, "n_cameras": 4, "n_frames": 60}
_LIZARD_FILM: dict[str, Any] = {"make": make_lizard, "motion": lizard_motion, "n_frames": 250}
_IMPERFECT: dict[str, Any] = {"rolling": 0.03, "skin_m": 0.001, "start_spread_frames": 0.9}

ENTRIES = (
    _recording(
        "bat",
        "bat in level flight, 34 markers, 8 wide-angle cameras (Brown lenses), 240 Hz; used by the demo",
        make_bat,
    ),
    _recording("bat_30", "the same flight, 30 wide-angle cameras (Brown lenses)", make_bat, n_cameras=30),
    _recording("bat_fisheye", "the same flight, 30 fisheye cameras", make_bat, n_cameras=30, lens="fisheye"),
    _recording(
        "bat_turn",
        "bat flying U-turns, 30 wide-angle cameras (Brown lenses)",
        make_bat,
        n_cameras=30,
        manoeuvre="turn",
    ),
    _recording(
        "bat_imperfect",
        "bat flying U-turns, 30 fisheye cameras not synchronised (up to 0.9 frames), rolling joints, loose skin",
        make_bat,
        n_cameras=30,
        lens="fisheye",
        manoeuvre="turn",
        **_IMPERFECT,
    ),
    _recording(
        "bat_wind_tunnel", "bat, 4 cameras, 700 Hz, placed and digitised as in a real wind tunnel", make_bat_wind_tunnel
    ),
    _recording("lizard", "lizard walking up a rod, 24 markers, 4 high-speed cameras, 250 Hz", make_lizard),
    _recording("lizard_imperfect", "the same walk with rolling joints", make_lizard, rolling=0.04, skin_m=0.0004),
    _movies("bat_movies", "a quarter of a second of the bat's flight with movies of 4 cameras", **_BAT_FILM),
    _movies("lizard_movies", "a second of the lizard's walk with movies of 4 cameras", **_LIZARD_FILM),
    _movies(
        "bat_movies_spoilt",
        "the bat's movies with bars, blur, noise, flicker, reflections, merging dots, compression and texture",
        disturbances=ALL,
        **_BAT_FILM,
    ),
    _movies("lizard_movies_spoilt", "the lizard's movies with the same disturbances", disturbances=ALL, **_LIZARD_FILM),
    _pendulum("pendulum_planar", "400 samples of the paper's pendulum in the plane, polar", "planar", 0.0),
    _pendulum("pendulum_planar_noisy", "with uniform noise of 0.1 m width on its radius", "planar", 0.1),
    _pendulum("pendulum_spherical", "400 samples of the paper's pendulum in space, Cartesian", "spherical", 0.0),
    _pendulum("pendulum_spherical_noisy", "with uniform noise of 0.1 m width on its radius", "spherical", 0.1),
    _session("calibration_tunnel", "images of a checkerboard in the bat's 8 cameras", _TUNNEL, _TUNNEL_BOARD, 40),
    _session(
        "calibration_tunnel_charuco", "images of a ChArUco board in the same cameras", _TUNNEL, _TUNNEL_CHARUCO, 40
    ),
    _session("calibration_fisheye", "images of a checkerboard in 8 fisheye cameras", _FISHEYES, _TUNNEL_BOARD, 40),
    _session("calibration_tank", "images of a checkerboard in the lizard's 4 cameras", _TANK, _TANK_BOARD, 32),
    _session("calibration_tank_charuco", "images of a ChArUco board in the same cameras", _TANK, _TANK_CHARUCO, 32),
    _wand("wand_tunnel", "a wand of 0.2 m swept through the view of the bat's 8 cameras", _TUNNEL, 0.2),
    _wand("wand_tank", "a wand of 0.08 m swept through the view of the lizard's 4 cameras", _TANK, 0.08),
)
"""In the order in which they are listed."""


def make(
    name: str,
    folder: Path,
    *,
    seed: int = 0,
    replace: bool = False,
    progress: Progress = lambda _: None,
    tell: Tell = silent,
) -> None:
    """Make an entry; its files appear when all are whole.

    Args:
        name: Of the entry.
        folder: Where to.
        seed: Any integer of 0 or more; the same makes the same.
        replace: As in ``mocap.io.output.result_folder``.
        progress: Told the share done.
        tell: Told of what an interrupted run had left.

    Raises:
        MocapError: there is no such entry, the folder holds something, or it cannot be written.
    """
    entry = next((entry for entry in ENTRIES if entry.name == name), None)
    if entry is None:
        raise MocapError(f"{name!r} cannot be made; what can: {', '.join(entry.name for entry in ENTRIES)}")
    with result_folder(folder, name, replace=replace, tell=tell) as draft:
        entry.write(seed, draft, progress)
