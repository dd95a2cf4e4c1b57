"""The recordings of the gap benchmark, real ones and twins, as sets of trials with equal markers.

| set | what | trials |
|---|---|---|
| ``bat`` | wind tunnel, bat 078A3, F2 to F5, 15 markers clicked by hand in 4 cameras at 700 Hz | one a flight |
| ``bat_wing`` | F1 to F5 and bat FE404 F2: left wing, ankle and sternum (7 markers), two animals | one a flight |
| ``mouse`` | treadmill, 11 markers, Qualisys at 300 Hz; what QTM filled counts as not seen | 7 x 1500 frames |
| ``snake_glide`` | gliding snakes, Qualisys at 179 Hz, raw; 6 animals of 0.8 to 1.1 m | one a glide |
| ``snake_gap`` | two snakes crossing a gap, Vicon at 150 Hz, 10 markers | blocks of 168 and 180 frames |
| ``gait`` | a slow human walk, 26 markers on feet, shanks, thighs, pelvis, C3D at 50 Hz | 3 x 150 frames |
| ``twin_bat`` | our synthetic bat, 34 markers, 6 cameras at 240 Hz, a human digitiser's clicks | one a seed |
| ``twin_lizard`` | our synthetic lizard, 24 markers, 4 cameras at 250 Hz, a human digitiser's clicks | one a seed |

Choices:

- Pixels are triangulated and cleaned as ``mocap track`` does it: rays that miss, jumps and duplicates are rejected, and
  slow errors of rays (of which twins have none) removed.
- Positions of optical systems are freed from jumps and duplicates: the Vicon head marker is exchanged with another
  in five frames.
- The project of F2 states 25.56 Hz, the rate of playback. Its wings move as far in a frame as those of the others: 700.
- F1 and FE404 show the left wing only. The bats' ankles count as trunk: without them half of the frames of F4 and F5
  have fewer than three trunk markers. The world of the wind tunnel is left-handed, in all trials alike.
- Snakes carry 10 to 18 markers: of each, those ten measured markers are taken that lie nearest to ten stations evenly
  along the body. The middle of the body is the trunk, front and back are limbs.
- Of the C3D samples Eb015 is the longest recording of a repeated movement with native gaps; the others have fewer than
  150 frames, or 51 markers about one arm that moves once.
- Blocks of one recording are not independent trials: in ``mouse``, ``snake_gap`` and ``gait`` training knows the same
  animal on the same day. All twins of a set are one animal (same bones) in other motion.
- ``sd_m`` is estimated from fourth differences in time (``mocap.cleaning.position_noise.position_sd``) over all
  trials of a set, and taken as ``LEAST_SD_M`` where it is less: the mouse of Qualisys seems to be smoothed,
  to 0.003 mm.
"""

import os
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np

from benchmarks.gaps.method import Trial
from datasets import SyntheticRecording, make_bat, make_lizard
from datasets.bat_skeleton import bat_skeleton
from datasets.lizard_skeleton import lizard_skeleton
from mocap.arrays import Array
from mocap.cameras import triangulate
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.cleaning.bias import ray_bias
from mocap.cleaning.clean import clean
from mocap.cleaning.position_noise import position_sd
from mocap.cleaning.robust_rays import student_t
from mocap.io.c3d import read_c3d
from mocap.io.dvproject import read_project
from mocap.io.qualisys import read_mat, read_tsv
from mocap.io.vicon import read_csv
from mocap.records import MarkerTracks, PixelTracks, Status
from mocap.skeleton import Skeleton

DATA = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
"""Where real recordings lie: the environment variable MOCAP_REAL_DATA, or ``../shared/data`` beside the project."""

WIND_TUNNEL_POINTS = (
    *("t3L", "wstL", "t5L", "elbL", "shdL", "ankL", "nl", "str"),
    *("lmb", "shdR", "ankR", "elbR", "wstR", "t5R", "t3R"),
)
"""What pt1, pt2, ... of the wind-tunnel projects are (PROVENANCE.md)."""

GLIDES = ("205_81", "412_86", "506_88", "628_95", "705_86", "706_81", "910_81", "918_30")
TWIN_SEEDS = (11, 12, 13, 14, 15)
TWIN_FRAMES = 400
STATIONS = 10
LEAST_SD_M = 1e-5


def _trials(
    recordings: Sequence[tuple[str, Array, Array]],
    names: Sequence[str],
    *,
    trunk: Sequence[str],
    limbs: Sequence[Sequence[str]],
) -> list[Trial]:
    """Trials of one set, each from the first to the last frame in which anything was seen.

    Args:
        recordings: Name, times (T,) and positions (T, M, 3) of each.
        names: The M markers.
        trunk: Of them, those of the body.
        limbs: Of them, those of each limb.
    """
    cut = []
    for name, t_s, xyz in recordings:
        frames = np.flatnonzero(np.isfinite(xyz[..., 0]).any(axis=1))
        inside = slice(frames[0], frames[-1] + 1)
        cut.append((name, t_s[inside] - t_s[frames[0]], xyz[inside]))
    sd_m = noise_sd([(t, x) for _, t, x in cut], names)
    return [
        Trial(
            name=name,
            names=tuple(names),
            t_s=t_s,
            xyz_m=xyz,
            sd_m=sd_m,
            trunk=tuple(trunk),
            limbs=tuple(tuple(limb) for limb in limbs),
        )
        for name, t_s, xyz in cut
    ]


def noise_sd(recordings: Sequence[tuple[Array, Array]], names: Sequence[str]) -> Array:
    """(M,) standard deviation of a measured coordinate; recordings are laid end to end, with a hole between them."""
    hole = np.full((5, len(names), 3), np.nan)
    xyz = np.concatenate([part for _, x in recordings for part in (x, hole)])
    tracks = MarkerTracks(
        names=tuple(names),
        t_s=np.arange(len(xyz)) * 1.0,
        xyz_m=xyz,
        cov_m2=np.full((*xyz.shape, 3), np.nan),
        status=np.where(np.isnan(xyz[..., 0]), Status.MISSING, Status.MEASURED),
    )
    return np.maximum(position_sd(tracks)[0], LEAST_SD_M)


def positions(
    pixels: PixelTracks, cameras: Sequence[Camera], skeleton: Skeleton, names: tuple[str, ...], *, biased: bool
) -> Array:
    """(T, M, 3) positions from pixels, cleaned as in ``mocap.pipeline.prepare.prepare``; NaN where none is believed.

    Args:
        pixels: As digitised.
        cameras: Of them.
        skeleton: Rigid bones, and the speed limit if it is known.
        names: The M markers as the skeleton calls them.
        biased: Whether rays err slowly (calibration, lens), which is then removed.
    """
    matrices, uv = stacked(cameras), undistorted(cameras, pixels.uv_px)
    found = triangulate.robust(matrices, uv)
    sd = np.sqrt(np.trace(found.cov_m2, axis1=-2, axis2=-1) / 3)
    cleaning = clean(found.xyz_m, sd, pixels.t_s, skeleton, names)
    uv = np.where((found.rejected | cleaning.any)[..., None], np.nan, uv)
    jitter_px = found.sd_px
    if biased:
        bias = ray_bias(matrices, uv, dt_s=float(pixels.t_s[1] - pixels.t_s[0]))
        uv, jitter_px = uv - bias.bias_px, bias.jitter_px
    return student_t(matrices, uv, triangulate.linear(matrices, uv), sd_px=jitter_px)[0]


def believed(t_s: Array, xyz_m: Array, names: Sequence[str]) -> Array:
    """(T, M, 3) positions without jumps and duplicates (exchanged labels), as ``mocap track`` takes them."""
    sd = np.broadcast_to(noise_sd([(t_s, xyz_m)], names), xyz_m.shape[:2])
    cleaning = clean(xyz_m, sd, t_s, Skeleton(name="markers only", markers=tuple(names)), tuple(names))
    return np.where(cleaning.any[..., None], np.nan, xyz_m)


def _blocks(name: str, t_s: Array, xyz_m: Array, count: int) -> list[tuple[str, Array, Array]]:
    """A recording cut into blocks of equal length."""
    length = len(t_s) // count
    cuts = [slice(i * length, (i + 1) * length) for i in range(count)]
    return [(f"{name}[{cut.start}:{cut.stop}]", t_s[cut], xyz_m[cut]) for cut in cuts]


def _flights(wanted: Sequence[str], flights: Sequence[str]) -> list[tuple[str, Array, Array]]:
    out = []
    names = WIND_TUNNEL_POINTS
    for flight in flights:
        (path,) = sorted((DATA / "bat_windtunnel_dltdv8").joinpath(*flight.split("_")).glob("*dvProject.mat"))
        project = read_project(path, fps=700)
        skeleton = Skeleton(name="markers only", markers=names)
        xyz = positions(project.pixels, project.cameras, skeleton, names, biased=True)
        out.append((flight, project.pixels.t_s, xyz[:, [names.index(name) for name in wanted]]))
    return out


def bat() -> list[Trial]:
    """Both wings of one bat."""
    left, right = ("t3L", "wstL", "t5L", "elbL"), ("t3R", "wstR", "t5R", "elbR")
    flights = _flights(WIND_TUNNEL_POINTS, ("078A3_F2", "078A3_F3", "078A3_F4", "078A3_F5"))
    trunk = ("str", "lmb", "nl", "shdL", "shdR", "ankL", "ankR")
    return _trials(flights, WIND_TUNNEL_POINTS, trunk=trunk, limbs=(left, right))


def bat_wing() -> list[Trial]:
    """The left wing of two bats."""
    wing, trunk = ("t3L", "wstL", "t5L", "elbL"), ("shdL", "ankL", "str")
    flights = ("078A3_F1", "078A3_F2", "078A3_F3", "078A3_F4", "078A3_F5", "FE404_F2")
    return _trials(_flights(wing + trunk, flights), wing + trunk, trunk=trunk, limbs=(wing,))


def mouse() -> list[Trial]:
    """A mouse on a treadmill, from above and behind: hips, knees and ankles are the limbs."""
    tracks = read_mat(DATA / "mouse_mocap_qtm" / "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat").points
    measured = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)
    measured = believed(tracks.t_s, measured, tracks.names)
    limbs = [tuple(f"{side}_{joint}" for joint in ("hip", "knee", "ankle")) for side in ("left", "right")]
    trunk = ("left_coord", "right_coord", "left_back", "right_back", "miniscope")
    return _trials(_blocks("mouse", tracks.t_s, measured, 7), tracks.names, trunk=trunk, limbs=limbs)


def stations(xyz_m: Array, count: int) -> np.ndarray:
    """Markers of a snake nearest to stations evenly along its body, each used once, in order.

    Args:
        xyz_m: (T, M, 3) positions, markers in order from head to tail.
        count: Stations, at most M.

    Returns:
        (count,) marker indices, increasing, with the least sum of squared distances along the body.
    """
    step = np.nanmedian(np.linalg.norm(np.diff(xyz_m, axis=1), axis=-1), axis=0)
    along = np.append(0, np.cumsum(step)) / step.sum()
    cost = (along[None] - np.linspace(0, 1, count)[:, None]) ** 2
    total = np.full((count, len(along)), np.inf)
    before = np.zeros((count, len(along)), dtype=int)
    total[0] = cost[0]
    for k in range(1, count):
        for m in range(k, len(along)):
            before[k, m] = int(np.argmin(total[k - 1, :m]))
            total[k, m] = cost[k, m] + total[k - 1, before[k, m]]
    chosen = [int(np.argmin(total[-1]))]
    for k in range(count - 1, 0, -1):
        chosen.append(int(before[k, chosen[-1]]))
    return np.array(chosen[::-1])


def _snakes(recordings: Sequence[tuple[str, Array, Array]]) -> list[Trial]:
    names = tuple(f"station_{k + 1:02d}" for k in range(STATIONS))
    return _trials(recordings, names, trunk=names[3:7], limbs=(names[:3], names[7:]))


def snake_glide() -> list[Trial]:
    """Glides, raw: what the authors filled is not seen."""
    tracks = [(name, read_tsv(DATA / "snake_glide_qualisys" / f"{name}.tsv").points) for name in GLIDES]
    whole = [(name, t.t_s, believed(t.t_s, t.xyz_m, t.names)) for name, t in tracks]
    return _snakes([(name, t_s, xyz[:, stations(xyz, STATIONS)]) for name, t_s, xyz in whole])


def snake_gap() -> list[Trial]:
    """Crossings of a gap, cut in blocks: 3 of the one, 4 of the other."""
    blocks = []
    for name, count in (("040_Snake94_gap02_3", 3), ("053_Snake89_gap02_1", 4)):
        tracks = read_csv(DATA / "snake_gap_vicon" / f"{name}.csv").points
        snake = [m for m, marker in enumerate(tracks.names) if marker.startswith("Snake")]
        xyz = believed(tracks.t_s, tracks.xyz_m[:, snake], [tracks.names[m] for m in snake])
        blocks += _blocks(name, tracks.t_s, xyz, count)
    return _snakes(blocks)


def gait() -> list[Trial]:
    """A walk; measured samples only, interpolated ones (residual 0) are not seen."""
    tracks = read_c3d(DATA / "c3d_samples" / "sample_01" / "Eb015pr.c3d").points
    measured = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)
    measured = believed(tracks.t_s, measured, tracks.names)
    legs = [tuple(name for name in tracks.names if name[0] == side) for side in "LR"]
    trunk = tuple(name for name in tracks.names if name.upper().startswith("PV"))
    return _trials(_blocks("Eb015", tracks.t_s, measured, 3), tracks.names, trunk=trunk, limbs=legs)


def twin_bat() -> list[Trial]:
    """Five flights of the synthetic bat."""
    skeleton = bat_skeleton()
    limbs = [tuple(n for n in skeleton.markers if n.endswith(f"_{s}") and n[:3] not in ("ear", "ank")) for s in "lr"]
    limbs = [tuple(n for n in limb if n not in skeleton.trunk) for limb in limbs]
    return _twins(partial(make_bat, n_cameras=6), skeleton, limbs)


def twin_lizard() -> list[Trial]:
    """Five walks of the synthetic lizard."""
    skeleton = lizard_skeleton()
    joints = (("elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot"))
    limbs = [tuple(f"{joint}_{side}" for joint in limb) for limb in joints for side in "lr"]
    return _twins(make_lizard, skeleton, limbs)


def _twins(make: Callable[..., SyntheticRecording], skeleton: Skeleton, limbs: Sequence[Sequence[str]]) -> list[Trial]:
    recordings = []
    for seed in TWIN_SEEDS:
        film = make(seed=seed, n_frames=TWIN_FRAMES)
        xyz = positions(film.pixels, film.cameras, skeleton, film.pixels.names, biased=False)
        recordings.append((f"{film.name}_{seed}", film.pixels.t_s, xyz))
    return _trials(recordings, skeleton.markers, trunk=skeleton.trunk, limbs=limbs)


SETS: dict[str, Callable[[], list[Trial]]] = {
    made.__name__: made for made in (bat, bat_wing, mouse, snake_glide, snake_gap, gait, twin_bat, twin_lizard)
}
"""By name."""


@cache
def _loaded(name: str) -> tuple[Trial, ...]:
    return tuple(SETS[name]())


def load(name: str) -> list[Trial]:
    """The trials of a set, read once.

    Raises:
        KeyError: there is no set of that name.
        FormatError: its recordings are not there (set MOCAP_REAL_DATA) or cannot be read.
    """
    return list(_loaded(name))
