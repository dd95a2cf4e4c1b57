"""A lizard that walks up a rod by a gait, filmed by high-speed cameras around a tank."""

from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from mocap.datasets.film import FilmedScene, Motion, SyntheticRecording, film
from mocap.datasets.linkage import bent, draw_wander, ramp, rotated, skin_motion, turn
from mocap.datasets.observe import Digitiser
from mocap.datasets.occlusion import Solid
from mocap.datasets.rig import tank_cameras
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.measures import JointAxes, Measures
from mocap.skeleton import Skeleton

# footholds are drawn for so many strides and then repeat: far more than a recording holds
_STRIDES = 512


@dataclass(frozen=True, kw_only=True)
class Gait:
    """A symmetrical gait at a steady stride length.

    Attributes:
        stride_m: Way of the body in one cycle.
        duty: Share of the cycle that a foot stands; 0.65 is a walking trot, 0.63 that of Dipsosaurus at its slowest
            (Fieler & Jayne 1998, J. Exp. Biol. 201, 609).
        lift_m: How far a foot rises from the rod in its swing.
        scatter_m: Standard deviation of footholds along the rod.
        scatter_rad: Standard deviation of footholds around it.
    """

    stride_m: float = 0.044
    duty: float = 0.65
    lift_m: float = 0.005
    scatter_m: float = 0.001
    scatter_rad: float = 0.06


@dataclass(frozen=True, eq=False, kw_only=True)
class Footsteps:
    """One foot over time, in cylindrical coordinates of the rod.

    Attributes:
        along_m: (T,) position along the rod.
        around_rad: (T,) angle from the top of the rod, to the left.
        lift_m: (T,) height above the rod's surface.
        cycle: (T,) share of the cycle that has passed since touch-down, 0 to 1.
        stance: (T,) True where the foot stands.
    """

    along_m: Array
    around_rad: Array
    lift_m: Array
    cycle: Array
    stance: NDArray[np.bool_]


def steps(
    rng: np.random.Generator, progress_m: Array, gait: Gait, *, offset: float, ahead_m: float, around_rad: float
) -> Footsteps:
    """The steps of one foot of a body that has come ``progress_m`` along the rod.

    Step k stands while the body goes from (k + offset) to (k + offset + duty) strides, so that in mid-stance the foot
    is ``ahead_m`` before the body; between steps it swings along a smooth step, without a jump in acceleration.

    Args:
        rng: Source of the scatter of footholds.
        progress_m: (T,) position of the body, increasing.
        gait: Stride and duty.
        offset: Phase of the limb in cycles.
        ahead_m: Mid-stance position of the foot relative to the body.
        around_rad: Mean angle of the foothold from the top of the rod; to the left is positive.

    Returns:
        The foot over time.
    """
    cycles = progress_m / gait.stride_m - offset
    k = np.floor(cycles).astype(int)
    u = cycles - k
    # within two standard deviations, so that no seed asks for a step out of reach
    scatter = np.clip(rng.standard_normal((_STRIDES, 2)), -2, 2) * [gait.scatter_m, gait.scatter_rad]

    def foothold(step: NDArray[np.intp]) -> Array:
        middle = gait.stride_m * (step + offset + gait.duty / 2) + ahead_m
        mean = np.stack([middle, np.full(len(step), around_rad)], axis=-1)
        return mean + scatter[step % _STRIDES]

    swing = np.maximum(u - gait.duty, 0) / (1 - gait.duty)
    here, there = foothold(k), foothold(k + 1)
    place = here + ramp(swing)[:, None] * (there - here)
    return Footsteps(
        along_m=place[:, 0],
        around_rad=place[:, 1],
        lift_m=gait.lift_m * (4 * swing * (1 - swing)) ** 3,
        cycle=u,
        stance=u < gait.duty,
    )


AXIAL = ("snout", "head", "neck", "spine", "pelvis", "tail_1", "tail_2", "tail_3")
LIMBS = {"fore": ("shoulder", "elbow", "wrist", "hand"), "hind": ("hip", "knee", "ankle", "foot")}
MARKERS = AXIAL + tuple(f"{name}_{side}" for limb in LIMBS.values() for side in "lr" for name in limb)
TRUNK = ("neck", "spine", "shoulder_l", "shoulder_r")


def lizard_skeleton() -> Skeleton:
    """The lizard's skeleton; every bone is rigid."""
    bones = [*pairwise(AXIAL), ("shoulder_l", "shoulder_r"), ("hip_l", "hip_r")]
    chains = [AXIAL]
    chains += [
        (girdle, *(f"{name}_{side}" for name in LIMBS[limb]))
        for side in "lr"
        for girdle, limb in (("neck", "fore"), ("pelvis", "hind"))
    ]
    for chain in chains[1:]:
        bones += pairwise(chain)
    # what a paper on locomotion reports
    ahead = {"shoulder": ("spine", "neck"), "hip": ("pelvis", "spine")}
    axes = {}
    for limb, (root, middle, end, _) in LIMBS.items():
        across = ("shoulder_r", "shoulder_l") if limb == "fore" else ("hip_r", "hip_l")
        for side in "lr":
            upper, lower = (f"{root}_{side}", f"{middle}_{side}"), (f"{middle}_{side}", f"{end}_{side}")
            axes[upper[0]] = JointAxes(parent=(ahead[root], across), child=(upper, lower))
    return Skeleton(
        name="lizard",
        markers=MARKERS,
        bones=bones,
        joints={triple[1]: triple for chain in chains for triple in zip(chain, chain[1:], chain[2:], strict=False)},
        trunk=TRUNK,
        max_speed_m_s=3.0,
        measures=Measures(
            forward=("spine", "neck"),
            left=("shoulder_r", "shoulder_l"),
            axes=axes,
            distances={"snout_vent": ("snout", "pelvis")},
            feet=("hand_l", "foot_r", "hand_r", "foot_l"),
            ground="rod",
            chain=("neck", "spine", "pelvis", "tail_1", "tail_2", "tail_3"),
        ),
    )


SLOPE_RAD = np.deg2rad(35)
SPEED_M_S = 0.14  # chosen; not measured
GAIT = Gait()
_DEG = np.pi / 180
_ROD_RADIUS_M = 0.005  # chosen
# bones in metres: an adult Anolis sagrei of 60 mm from snout to vent
_AXIS_M = {
    "snout": 0.012,
    "head": 0.009,
    "neck": 0.018,
    "pelvis": 0.020,
    "tail_1": 0.03,
    "tail_2": 0.03,
    "tail_3": 0.03,
}
_LIMB_M = {"fore": (0.0125, 0.0115, 0.007), "hind": (0.0135, 0.0125, 0.010)}
_ROOT_M = {"fore": (-0.001, 0.0070, -0.0050), "hind": (0.001, 0.0062, -0.0050)}
# mid-stance reach of hand and foot before the spine's marker, angle of the foothold, phase of the left one
_REACH_M = {"fore": 0.0225, "hind": -0.0085}
_GRIP_RAD = {"fore": 50 * _DEG, "hind": 58 * _DEG}
_OFFSET = {"fore": 0.0, "hind": 0.5}
_POLE = {"fore": np.array([-0.4, 1.0, 0.35]), "hind": np.array([0.5, 1.0, 0.35])}


def make_lizard(
    *,
    seed: int = 0,
    n_frames: int = 500,
    fps: float = 250.0,
    n_cameras: int = 4,
    skin_m: float = 0.0002,
    rolling: float = 0.0,
    start_spread_frames: float = 0.0,
    digitiser: Digitiser | None = None,
) -> SyntheticRecording:
    """A lizard that walks up a rod at a trot.

    The motion depends on the seed only: a longer recording, or one with more cameras, begins with the same walk.

    Args:
        seed: Any integer; the same gives the same bytes.
        n_frames: Number of frames; the images hold the first 2 s of the walk.
        fps: Frames a second.
        n_cameras: Number of cameras, 2 or more.
        skin_m: Root mean square of one coordinate of the markers' motion on the bone, but for hands and feet; 0: rigid.
        rolling: Radius of the condyles of elbow and knee as a share of the bone beyond, so that the centres of these
            joints wander; 0: ideal joints.
        start_spread_frames: Cameras start within so much of a frame of each other; 0: at the same instant.
        digitiser: Quality of the digitising; None: a human's, on markers that are mostly in plain view.

    Returns:
        The recording, with its truth.

    Raises:
        ValueError: fewer than 2 cameras or 1 frame, or a rate that is not positive.
    """
    card = {
        "species": "brown anole (Anolis sagrei), adult, walking up a rod",
        "rig": f"tank with a rod of {2e3 * _ROD_RADIUS_M:.0f} mm at {np.rad2deg(SLOPE_RAD):.0f} degrees, "
        f"{n_cameras} high-speed cameras",
        "stride_hz": round(SPEED_M_S / GAIT.stride_m, 3),
        "duty": GAIT.duty,
        "skin_m": skin_m,
        "rolling": rolling,
    }
    return film(
        lizard_motion(seed, skin_m=skin_m, rolling=rolling),
        tank_cameras(n_cameras, slope_rad=SLOPE_RAD),
        name="lizard",
        seed=seed,
        n_frames=n_frames,
        fps=fps,
        digitiser=digitiser or Digitiser(bursts_per_s=0.4),
        card=card,
        start_spread_frames=start_spread_frames,
    )


def lizard_motion(seed: int, *, skin_m: float = 0.0002, rolling: float = 0.0) -> Motion:
    """The lizard that ``make_lizard`` films, as a function of time."""
    return partial(lizard_scene, seed=np.random.SeedSequence(seed).spawn(3)[0], skin_m=skin_m, rolling=rolling)


def lizard_scene(t_s: Array, *, seed: np.random.SeedSequence, skin_m: float, rolling: float) -> FilmedScene:
    """The lizard's motion at times (T,), the same function of time for the same seed; others as in ``make_lizard``."""
    rng = np.random.default_rng(seed)
    progress = -0.14 + SPEED_M_S * (t_s + 0.1 * draw_wander(rng, band_hz=(0.3, 2.0)).integral(t_s))
    phase = 2 * np.pi * progress / GAIT.stride_m
    rod, girdles = _axis(rng, t_s, progress, phase)
    contact = {}
    for limb, names in LIMBS.items():
        girdle = "neck" if limb == "fore" else "pelvis"
        for side, mirror in (("l", 1.0), ("r", -1.0)):
            flip = np.array([1.0, mirror, 1.0])
            foot = steps(
                rng,
                progress,
                GAIT,
                offset=_OFFSET[limb] + (0.5 if side == "r" else 0.0),
                ahead_m=_REACH_M[limb],
                around_rad=mirror * _GRIP_RAD[limb],
            )
            root = rod[girdle] + rotated(girdles[girdle], np.array(_ROOT_M[limb]) * flip)
            upper, lower, last = _LIMB_M[limb]
            toe, heel = _foot(foot, last, mirror)
            pole, condyle = _POLE[limb] * flip, rolling * lower
            middle = bent(root, heel, pole, upper_m=upper, lower_m=lower, condyle_m=condyle)
            rod |= {f"{name}_{side}": xyz for name, xyz in zip(names, (root, middle, heel, toe), strict=True)}
            contact[f"{names[-1]}_{side}"] = foot.stance

    xyz = np.stack([rod[name] for name in MARKERS], axis=1)
    if skin_m > 0:
        scale = skin_m * np.array([0.0 if name in contact else 1.0 for name in MARKERS])
        xyz = xyz + skin_motion(rng, t_s, phase, scale * rng.uniform(0.6, 1.4, len(MARKERS)))
    world = turn(1, np.array(-SLOPE_RAD))
    standing = [contact.get(name, np.zeros(len(t_s), dtype=bool)) for name in MARKERS]
    # sets of markers that are lost together: each hand, each foot, the end of the tail
    return FilmedScene(
        skeleton=lizard_skeleton(),
        t_s=t_s,
        xyz_m=rotated(world, xyz),
        triangles=np.empty((0, 3), dtype=int),
        solids=_solids(rod, girdles, world),
        clearance_m=0.0015,
        clusters=(
            *((f"{a}_{side}", f"{b}_{side}") for side in "lr" for a, b in (("wrist", "hand"), ("ankle", "foot"))),
            ("tail_2", "tail_3"),
        ),
        contact=np.stack(standing, axis=1),
    )


def _axis(
    rng: np.random.Generator, t_s: Array, progress_m: Array, phase_rad: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Axial markers (T, 3) and rotations (T, 3, 3) of both girdles and the head, in the axes of the rod.

    The trunk bends sideways in a standing wave, as that of lizards with strong limbs does at low speed (Ritter 1992,
    J. Exp. Biol. 173, 1), so that the shoulder of the arm that touches down, and the hip across,
    are in front; the tail follows in a travelling wave.
    """
    slow = [draw_wander(rng, band_hz=(0.2, 1.5)).value(t_s) for _ in range(6)]
    wave = (13 + 1.5 * slow[0]) * _DEG
    chest = -wave * np.cos(phase_rad) + 2 * _DEG * slow[1]
    hips = wave * np.cos(phase_rad - 0.2) + 2 * _DEG * slow[1]
    girdles: dict[str, Array] = {
        "neck": turn(2, chest) @ turn(0, 4 * _DEG * np.sin(phase_rad)),
        "pelvis": turn(2, hips) @ turn(0, -4 * _DEG * np.sin(phase_rad)),
    }
    girdles["head"] = turn(2, -0.3 * chest + 5 * _DEG * slow[2]) @ turn(1, _DEG * (-6 + 3 * slow[3]))
    height = 0.018 + 0.0005 * np.cos(2 * phase_rad + 0.5)
    sway = 0.0012 * np.sin(phase_rad) + 0.0008 * slow[4]
    rod: dict[str, Array] = {"spine": np.stack([progress_m, sway, height], axis=-1)}
    ahead = np.array([1.0, 0, 0])
    rod["neck"] = rod["spine"] + _AXIS_M["neck"] * rotated(girdles["neck"], ahead)
    rod["head"] = rod["neck"] + _AXIS_M["head"] * rotated(girdles["head"] @ turn(1, np.array(-0.2)), ahead)
    rod["snout"] = rod["head"] + _AXIS_M["snout"] * rotated(girdles["head"] @ turn(1, np.array(0.3)), ahead)
    rod["pelvis"] = rod["spine"] - _AXIS_M["pelvis"] * rotated(girdles["pelvis"], ahead)
    parent = "pelvis"
    for k, name in enumerate(("tail_1", "tail_2", "tail_3")):
        yaw = -(14 + 3 * k) * _DEG * np.cos(phase_rad - 0.9 * (k + 1)) + 4 * (k + 1) * _DEG * slow[5]
        droop = np.full(len(t_s), (-7, -2, 3)[k] * _DEG)
        rod[name] = rod[parent] - _AXIS_M[name] * rotated(turn(2, yaw) @ turn(1, droop), ahead)
        parent = name
    return rod, girdles


def _foot(foot: Footsteps, length_m: float, mirror: float) -> tuple[Array, Array]:
    """Toe and heel (T, 3) in the axes of the rod: the toe stands, the heel rises until the toe leaves."""
    outward = np.stack([np.zeros_like(foot.around_rad), np.sin(foot.around_rad), np.cos(foot.around_rad)], axis=-1)
    along = np.stack([foot.along_m, np.zeros_like(foot.along_m), np.zeros_like(foot.along_m)], axis=-1)
    toe = along + (_ROD_RADIUS_M + 0.001 + foot.lift_m)[:, None] * outward
    pitch = _DEG * (38 + 17 * np.cos(2 * np.pi * (foot.cycle - 0.68)))[:, None]
    level = np.array([-np.cos(0.5), mirror * np.sin(0.5), 0.0])
    # level and outward are not at right angles: the sum is made a unit vector
    direction = np.cos(pitch) * level + np.sin(pitch) * outward
    return toe, toe + length_m * direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def _solids(rod: dict[str, Array], girdles: dict[str, Array], world: Array) -> tuple[Solid, ...]:
    def solid(centre: Array, rotation: Array, semi_axes: tuple[float, float, float]) -> Solid:
        return Solid(centre_m=rotated(world, centre), rotation=world @ rotation, semi_axes_m=np.array(semi_axes))

    below = np.array([0, 0, -0.0063])
    skull = (rod["head"] + rod["snout"]) / 2 + rotated(girdles["head"], np.array([0, 0, -0.0045]))
    still = np.broadcast_to(np.eye(3), girdles["neck"].shape)
    return (
        solid((rod["neck"] + rod["spine"]) / 2 + below, girdles["neck"], (0.013, 0.0055, 0.0055)),
        solid((rod["spine"] + rod["pelvis"]) / 2 + below, girdles["pelvis"], (0.014, 0.0055, 0.0055)),
        solid(skull, girdles["head"], (0.009, 0.0045, 0.004)),
        solid(np.zeros_like(rod["spine"]), still, (np.inf, _ROD_RADIUS_M, _ROD_RADIUS_M)),
    )
