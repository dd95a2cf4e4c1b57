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
| ``bat_other`` | those of ``bat_wing``; bat FE404 is learned from 078A3 alone, and back | one a flight |
| ``bat_flights`` | the left wing in all flights of 078A3; in F5 it climbs 0.33 m and turns by 33 degrees | a flight |
| ``snake_other`` | those of ``snake_glide``; snakes of 1.05 m and more learn from shorter ones, and back | a glide |
| ``twin_scaled`` | five synthetic bats of 0.7 to 1.4 times the size, each learned from the others | one a size |
| ``twin_gaits`` | U-turns and level flights of the synthetic bat, pooled | three of each |
| ``twin_speeds`` | the synthetic lizard at 0.6 and 1.2 times its speed, pooled | three of each |

Sets of bats and the twins have pixels (``Trial.film``): markers hidden in them may keep one ray, or two.

Choices:

- Pixels are triangulated and cleaned by ``mocap track``'s own functions: rays that miss, jumps and duplicates are
  rejected, slow errors of rays removed.
- Positions of optical systems are freed from jumps and duplicates: the Vicon head marker is exchanged with another
  in five frames.
- The project of F2 states 25.56 Hz, the rate of playback. Its wings move as far in a frame as those of the others: 700.
- F1 and FE404 show the left wing only. The bats' ankles count as trunk: without them half of the frames of F4 and F5
  have fewer than three trunk markers. The world of the wind tunnel is left-handed, in all trials alike.
- Snakes carry 10 to 18 markers: of each, those ten measured markers are taken that lie nearest to ten stations evenly
  along the body. The middle of the body is the trunk, front and back are limbs.
- Of the C3D samples Eb015 is the longest recording of a repeated movement with native gaps; the others have fewer than
  150 frames, or 51 markers about one arm that moves once.
- Bones are stated for bats and twins, as a user's skeleton would; elsewhere the product finds pairs that keep their
  distance. In the flights the markers of finger tips keep their distance from the wrist to 1 to 3 %, of the wrist from
  the elbow to 4 to 7 %, of the elbow from the shoulder to 6 to 22 %.
- Blocks of one recording are not independent trials: in ``mouse``, ``snake_gap`` and ``gait`` training knows the same
  animal on the same day. All twins of a set are one animal (same bones) in other motion.
- ``sd_m`` is estimated from fourth differences in time (``mocap.cleaning.positions.position_sd``) over all
  trials of a set, and taken as ``LEAST_SD_M`` where it is less: the mouse of Qualisys seems to be smoothed,
  to 0.003 mm.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.gaps import twins
from benchmarks.gaps.method import Film, Trial
from benchmarks.gaps.takes import Take, believed, blocks, trials_of
from eal.arrays import Array
from mocap.cleaning.cleaning import clean
from mocap.io.c3d import read_c3d
from mocap.io.dvproject import read_project
from mocap.io.optical_csv import read_vicon
from mocap.io.qualisys import read_mat, read_tsv
from mocap.reading.decided import decided
from mocap.reading.ideal_pixels import of_pixels
from mocap.records import Status
from mocap.skeleton import Skeleton

DATA = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
"""Where real recordings lie: the environment variable MOCAP_REAL_DATA, or ``../shared/data`` beside the project."""

WIND_TUNNEL_POINTS = (
    *("t3L", "wstL", "t5L", "elbL", "shdL", "ankL", "nl", "str"),
    *("lmb", "shdR", "ankR", "elbR", "wstR", "t5R", "t3R"),
)
"""What pt1, pt2, ... of the wind-tunnel projects are (PROVENANCE.md)."""

GLIDES = ("205_81", "412_86", "506_88", "628_95", "705_86", "706_81", "910_81", "918_30")
LONG = ("81", "88")
"""Snakes of 1.05 to 1.08 m; the others have 0.82 to 0.99 m."""
STATIONS = 10
ARM = (("shd", "elb"), ("elb", "wst"), ("wst", "t3"), ("wst", "t5"))
"""Bones of a bat's wing without its side."""
WING, WING_TRUNK = ("t3L", "wstL", "t5L", "elbL"), ("shdL", "ankL", "str")


@cache
def _flight(flight: str) -> Take:
    """A flight in the wind tunnel."""
    (path,) = sorted((DATA / "bat_windtunnel_dltdv8").joinpath(*flight.split("_")).glob("*dvProject.mat"))
    project = read_project(path).with_rate(700)
    seen = np.flatnonzero(project.pixels.seen.any(axis=(0, 2)))
    part = slice(int(seen[0]), int(seen[-1]) + 1)
    pixels = replace(
        project.pixels,
        names=WIND_TUNNEL_POINTS,
        t_s=project.pixels.t_s[part],
        uv_px=project.pixels.uv_px[:, part],
    )
    skeleton = Skeleton(name="markers only", markers=WIND_TUNNEL_POINTS)
    found = clean(of_pixels(pixels, project.cameras, skeleton, name=flight))
    rows = decided(found).rows
    assert rows is not None  # it was decided
    own = Film(pixels=pixels, cameras=found.cameras, pixel_origin=rows.pixels, calibration_origin=rows.coefficients)
    return Take(flight, pixels.t_s, found.xyz_m, film=own)


def bat() -> list[Trial]:
    """Both wings of one bat."""
    left, right = ("t3L", "wstL", "t5L", "elbL"), ("t3R", "wstR", "t5R", "elbR")
    flights = [_flight(f"078A3_F{k}") for k in (2, 3, 4, 5)]
    trunk = ("str", "lmb", "nl", "shdL", "shdR", "ankL", "ankR")
    bones = [(a + side, b + side) for side in "LR" for a, b in ARM]
    return trials_of(flights, WIND_TUNNEL_POINTS, trunk=trunk, limbs=(left, right), bones=bones)


def _wings(flights: Sequence[Take]) -> list[Trial]:
    takes = [take.only(WIND_TUNNEL_POINTS, WING + WING_TRUNK) for take in flights]
    bones = [(f"{a}L", f"{b}L") for a, b in ARM]
    return trials_of(takes, WING + WING_TRUNK, trunk=WING_TRUNK, limbs=(WING,), bones=bones)


def bat_wing() -> list[Trial]:
    """The left wing of two bats."""
    flights = [(animal, k) for animal in ("078A3", "FE404") for k in ((1, 2, 3, 4, 5) if animal == "078A3" else (2,))]
    return _wings([replace(_flight(f"{animal}_F{k}"), animal=animal) for animal, k in flights])


def bat_other() -> list[Trial]:
    """The left wing of each of two bats, learned from the other; the smaller set of flights is filled first."""
    *many, one = bat_wing()
    return [one, *many]


def bat_flights() -> list[Trial]:
    """The left wing in all flights of one bat, the one in which it manoeuvres first."""
    return _wings([replace(_flight(f"078A3_F{k}"), gait="climb" if k == 5 else "level") for k in (5, 1, 2, 3, 4)])


def mouse() -> list[Trial]:
    """A mouse on a treadmill, from above and behind: hips, knees and ankles are the limbs."""
    tracks = read_mat(DATA / "mouse_mocap_qtm" / "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat").points
    measured = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)
    measured = believed(tracks.t_s, measured, tracks.names)
    limbs = [tuple(f"{side}_{joint}" for joint in ("hip", "knee", "ankle")) for side in ("left", "right")]
    trunk = ("left_coord", "right_coord", "left_back", "right_back", "miniscope")
    return trials_of(blocks("mouse", tracks.t_s, measured, 7), tracks.names, trunk=trunk, limbs=limbs)


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


def _snakes(takes: Sequence[Take]) -> list[Trial]:
    names = tuple(f"station_{k + 1:02d}" for k in range(STATIONS))
    return trials_of(takes, names, trunk=names[3:7], limbs=(names[:3], names[7:]))


def snake_glide() -> list[Trial]:
    """Glides, raw: what the authors filled is not seen."""
    tracks = [(name, read_tsv(DATA / "snake_glide_qualisys" / f"{name}.tsv").points) for name in GLIDES]
    whole = [(name, t.t_s, believed(t.t_s, t.xyz_m, t.names)) for name, t in tracks]
    return _snakes([Take(name, t_s, xyz[:, stations(xyz, STATIONS)]) for name, t_s, xyz in whole])


def snake_other() -> list[Trial]:
    """Glides of long snakes, learned from those of short ones, and back; one of the shortest snake is filled first."""
    glides = [replace(t, animal="long" if t.name.endswith(LONG) else "short") for t in load("snake_glide")]
    return sorted(glides, key=lambda trial: not trial.name.endswith("95"))


def snake_gap() -> list[Trial]:
    """Crossings of a gap, cut in blocks: 3 of the one, 4 of the other."""
    parts = []
    for name, count in (("040_Snake94_gap02_3", 3), ("053_Snake89_gap02_1", 4)):
        tracks = read_vicon(DATA / "snake_gap_vicon" / f"{name}.csv").points
        snake = [m for m, marker in enumerate(tracks.names) if marker.startswith("Snake")]
        xyz = believed(tracks.t_s, tracks.xyz_m[:, snake], [tracks.names[m] for m in snake])
        parts += blocks(name, tracks.t_s, xyz, count)
    return _snakes(parts)


def gait() -> list[Trial]:
    """A walk; measured samples only, interpolated ones (residual 0) are not seen."""
    tracks = read_c3d(DATA / "c3d_samples" / "sample_01" / "Eb015pr.c3d").points
    measured = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)
    measured = believed(tracks.t_s, measured, tracks.names)
    legs = [tuple(name for name in tracks.names if name[0] == side) for side in "LR"]
    trunk = tuple(name for name in tracks.names if name.upper().startswith("PV"))
    return trials_of(blocks("Eb015", tracks.t_s, measured, 3), tracks.names, trunk=trunk, limbs=legs)


def twin_trials(name: str, count: int) -> list[Trial]:
    """The first so many trials of a set of twins."""
    takes, skeleton, limbs = twins.TWINS[name].make(count)
    return trials_of(takes, skeleton.markers, trunk=skeleton.trunk, limbs=limbs, bones=skeleton.rigid)


RECORDED: dict[str, Callable[[], list[Trial]]] = {
    made.__name__: made
    for made in (bat, bat_wing, bat_other, bat_flights, mouse, snake_glide, snake_other, snake_gap, gait)
}
"""Sets of real recordings, by name."""
SETS = (*RECORDED, *twins.TWINS)
"""Names of all sets."""
FILMED = ("bat", "bat_wing", "bat_other", "bat_flights", *twins.TWINS)
"""Sets with pixels."""
OTHERS = ("bat_other", "snake_other", "twin_scaled")
"""Sets in which a trial is learned from other animals only."""


def teachers(name: str, trials: Sequence[Trial], left_out: int) -> list[int]:
    """The trials of a set that one of them is learned from: all others; in ``OTHERS`` those of other animals."""
    own = trials[left_out].animal
    return [k for k, trial in enumerate(trials) if k != left_out and (name not in OTHERS or trial.animal != own)]


@cache
def _loaded(name: str, count: int) -> tuple[Trial, ...]:
    return tuple(RECORDED[name]() if name in RECORDED else twin_trials(name, count))


def load(name: str, count: int | None = None) -> list[Trial]:
    """The trials of a set, read or made once.

    Args:
        name: Of the set.
        count: Of twins only so many are made; None: all.

    Raises:
        KeyError: there is no set of that name.
        FormatError: its recordings are not there (set MOCAP_REAL_DATA) or cannot be read.
    """
    if name in RECORDED:
        return list(_loaded(name, 0))
    every = twins.TWINS[name].count
    return list(_loaded(name, every if count is None else min(count, every)))


def size(name: str) -> int:
    """The number of trials of a set; twins are not made for it.

    Raises:
        FormatError: as ``load``.
    """
    return len(load(name)) if name in RECORDED else twins.TWINS[name].count
