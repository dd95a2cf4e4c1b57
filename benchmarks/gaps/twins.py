"""Sets of the gap benchmark that we make: animals of one size and gait, of other sizes, in two gaits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from mocap.datasets.bat_skeleton import bat_skeleton
from mocap.datasets.bats import Manoeuvre, bat_motion
from mocap.datasets.film import FilmedScene, Motion, film
from mocap.datasets.lizards import SLOPE_RAD, lizard_motion, lizard_skeleton
from mocap.datasets.observe import Digitiser
from mocap.datasets.rig import tank_cameras, tunnel_cameras

from benchmarks.gaps.method import Film
from benchmarks.gaps.prepared import prepared_film
from benchmarks.gaps.takes import Take
from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.skeleton import Skeleton

Made = tuple[list[Take], Skeleton, list[tuple[str, ...]]]
"""The recordings of a set, its skeleton, its limbs."""
SEEDS = (11, 12, 13, 14, 15)
FRAMES = 400
SIZES = (1.4, 0.85, 1.2, 0.7, 1.0)
"""Of the five bats of ``twin_scaled``, over that of ``twin_bat``."""
SPEEDS = (1.2, 0.6)
"""Of the walks of ``twin_speeds``, over that of ``twin_lizard``."""


@dataclass(frozen=True, kw_only=True)
class Twin:
    """One filmed motion.

    Attributes:
        name: Of the trial.
        motion: The animal as a function of time.
        seed: Of the clicks.
        animal: Which it is.
        gait: How it moves.
    """

    name: str
    motion: Motion
    seed: int
    animal: str = ""
    gait: str = ""


def scaled_scene(t_s: Array, *, motion: Motion, size: float) -> FilmedScene:
    """A motion of an animal of so many times the size, about the world's origin."""
    scene = motion(t_s)
    solids = tuple(
        replace(solid, centre_m=size * solid.centre_m, semi_axes_m=size * np.asarray(solid.semi_axes_m))
        for solid in scene.solids
    )
    return replace(scene, xyz_m=size * scene.xyz_m, solids=solids, clearance_m=size * scene.clearance_m)


def sped_scene(t_s: Array, *, motion: Motion, speed: float) -> FilmedScene:
    """A motion that runs so many times as fast."""
    return replace(motion(speed * t_s), t_s=t_s)


def bats(twins: Sequence[Twin]) -> Made:
    """Bats in the flight tunnel: takes, skeleton, limbs."""
    skeleton = bat_skeleton()
    wings = [tuple(n for n in skeleton.markers if n.endswith(f"_{s}") and n[:3] not in ("ear", "ank")) for s in "lr"]
    limbs = [tuple(n for n in wing if n not in skeleton.trunk) for wing in wings]
    cameras = tunnel_cameras(6, lens="brown")
    return _takes(twins, skeleton, cameras, 240.0, Digitiser()), skeleton, limbs


def lizards(twins: Sequence[Twin]) -> Made:
    """Lizards on the rod: takes, skeleton, limbs."""
    joints = (("elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot"))
    limbs = [tuple(f"{joint}_{side}" for joint in limb) for limb in joints for side in "lr"]
    cameras = tank_cameras(4, slope_rad=SLOPE_RAD)
    skeleton = lizard_skeleton()
    return _takes(twins, skeleton, cameras, 250.0, Digitiser(bursts_per_s=0.4)), skeleton, limbs


def _takes(
    twins: Sequence[Twin], skeleton: Skeleton, cameras: Sequence[Camera], fps: float, clicks: Digitiser
) -> list[Take]:
    out = []
    for twin in twins:
        filmed = film(
            twin.motion,
            cameras,
            name=twin.name,
            seed=twin.seed,
            n_frames=FRAMES,
            fps=fps,
            digitiser=clicks,
            card={},
        )
        own = Film(
            pixels=filmed.pixels, cameras=filmed.cameras, pixel_origin="upper-left", calibration_origin="upper-left"
        )
        xyz = prepared_film(own, skeleton, name=twin.name).xyz_m
        out.append(Take(twin.name, filmed.pixels.t_s, xyz, film=own, animal=twin.animal, gait=twin.gait))
    return out


def level_bats(count: int) -> Made:
    """Level flights of one bat."""
    return bats([Twin(name=f"bat_{seed}", motion=bat_motion(seed), seed=seed) for seed in SEEDS[:count]])


def walking_lizards(count: int) -> Made:
    """Walks of one lizard."""
    return lizards([Twin(name=f"lizard_{seed}", motion=lizard_motion(seed), seed=seed) for seed in SEEDS[:count]])


def scaled_bats(count: int) -> Made:
    """Level flights of bats of other sizes."""
    twins = [
        Twin(
            name=f"bat_{size:g}",
            motion=partial(scaled_scene, motion=bat_motion(seed), size=size),
            seed=seed,
            animal=f"{size:g} times the size",
        )
        for seed, size in zip(SEEDS, SIZES, strict=True)
    ]
    return bats(twins[:count])


def turning_bats(count: int) -> Made:
    """U-turns and level flights of one bat, in turn."""
    gaits: tuple[Manoeuvre, ...] = ("turn", "level", "turn", "level", "turn", "level")
    twins = [
        Twin(name=f"{gait}_{seed}", motion=bat_motion(seed, manoeuvre=gait), seed=seed, gait=gait)
        for seed, gait in enumerate(gaits, start=SEEDS[0])
    ]
    return bats(twins[:count])


def hurrying_lizards(count: int) -> Made:
    """Walks of one lizard at two speeds, in turn."""
    twins = [
        Twin(
            name=f"lizard_{seed}_{speed:g}",
            motion=partial(sped_scene, motion=lizard_motion(seed), speed=speed),
            seed=seed,
            gait=f"{speed:g} times the speed",
        )
        for seed, speed in enumerate(SPEEDS * 3, start=SEEDS[0])
    ]
    return lizards(twins[:count])


@dataclass(frozen=True)
class TwinSet:
    """A set that can be made.

    Attributes:
        make: Makes the first so many of its trials.
        count: All of them.
    """

    make: Callable[[int], Made]
    count: int


TWINS = {
    "twin_bat": TwinSet(level_bats, len(SEEDS)),
    "twin_lizard": TwinSet(walking_lizards, len(SEEDS)),
    "twin_scaled": TwinSet(scaled_bats, len(SIZES)),
    "twin_gaits": TwinSet(turning_bats, 6),
    "twin_speeds": TwinSet(hurrying_lizards, 6),
}
"""By name."""
