"""The pendulums of the paper, section 8, with truth by SciPy's DOP853: samples to learn from, on and off the circle."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from mocap.datasets.film import FilmedScene, SyntheticRecording, film
from mocap.datasets.linkage import rotated, turn
from mocap.datasets.observe import Digitiser
from mocap.datasets.rig import aimed
from scipy.integrate import solve_ivp

from eal.arrays import Array, frozen
from eal.systems import GRAVITY_M_S2
from mocap.cameras.lens import BrownLens
from mocap.io.csv_table import write_table
from mocap.measures import Measures, Segment
from mocap.skeleton import Bone, Joint, Skeleton

Pendulum = Literal["planar", "spherical"]
_TOLERANCE = 1e-12  # relative; far below what is clicked
_COORDINATES: dict[str, tuple[str, ...]] = {"planar": ("r_m", "theta_rad"), "spherical": ("x1_m", "x2_m", "x3_m")}


@dataclass(frozen=True, eq=False, kw_only=True)
class PendulumRecording:
    """A pendulum of 1 m and 1 kg.

    Attributes:
        kind: ``planar``: polar (r, theta) with theta from the horizontal; ``spherical``: Cartesian, x3 up.
        t_s: (T,) times.
        samples: (T, D) as measured: the truth with its radius off by uniform noise.
        q: (T, D) true configurations.
        v: (T, D) true velocities.
        multiplier: (T,) force along the outward radius that keeps the radius at 1 m, in newtons.
        noise_m: Width of the noise: radii are 1 m within half of it.
        seed: Of the noise.
    """

    kind: Pendulum
    t_s: Array
    samples: Array
    q: Array
    v: Array
    multiplier: Array
    noise_m: float
    seed: int

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "t_s", frozen("t_s", self.t_s, (None,)))
        shape = (len(self.t_s), len(_COORDINATES[self.kind]))
        for name in ("samples", "q", "v"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape))
        object.__setattr__(self, "multiplier", frozen("multiplier", self.multiplier, shape[:1]))


def make_pendulum(
    kind: Pendulum, *, seed: int = 0, noise_m: float = 0.0, n_samples: int = 400, duration_s: float = 10.0
) -> PendulumRecording:
    """A pendulum sampled along its motion, z = ((1 + dr) r, ...) with dr uniform in +-noise / 2; section 8.1.

    The planar one follows theta'' = -g cos theta from theta = pi / 6 at rest; the spherical one
    x'' = -g e3 + m x with m = g x3 - |x'|^2 from (sin 45, 0, -cos 45) at (0, 1, 0) m/s.

    Args:
        kind: ``planar`` or ``spherical``.
        seed: Of the noise.
        noise_m: Width of the uniform noise of the radius.
        n_samples: Evenly in time.
        duration_s: Length of the recording.

    Raises:
        ValueError: an unknown kind, fewer than 2 samples, a duration that is not positive, or negative noise.
    """
    if kind not in _COORDINATES:
        raise ValueError(f"kind must be planar or spherical, but is {kind!r}")
    if n_samples < 2 or not duration_s > 0 or not noise_m >= 0:
        raise ValueError(
            f"n_samples must be 2 or more, duration_s above 0 and noise_m 0 or more, but they are {n_samples}, "
            f"{duration_s:g} and {noise_m:g}"
        )
    t_s = np.linspace(0, duration_s, n_samples)
    q, v, multiplier = pendulum_motion(kind, t_s)
    radius = 1 + noise_m * np.random.default_rng(seed).uniform(-0.5, 0.5, n_samples)
    samples = q * (np.stack([radius, np.ones(n_samples)], axis=1) if kind == "planar" else radius[:, None])
    return PendulumRecording(
        kind=kind, t_s=t_s, samples=samples, q=q, v=v, multiplier=multiplier, noise_m=noise_m, seed=seed
    )


def pendulum_motion(
    kind: Pendulum, t_s: Array, *, swing_rad: float = np.pi / 6, azimuth_rad: float = 0.0
) -> tuple[Array, Array, Array]:
    """The true motion at increasing times.

    Args:
        kind: ``planar`` or ``spherical``.
        t_s: (T,) times; the start is at the first.
        swing_rad: theta at which the planar one is released at rest.
        azimuth_rad: Turn of the spherical one's start about the vertical.

    Returns:
        Configurations and velocities (T, D), and the multiplier (T,), as in ``PendulumRecording``.
    """
    if kind == "planar":

        def slope(_: float, y: Array) -> Array:
            return np.array([y[1], -GRAVITY_M_S2 * np.cos(y[0])])

        angle, speed = _solve(slope, np.array([swing_rad, 0.0]), t_s)
        ones, zeros = np.ones(len(t_s)), np.zeros(len(t_s))
        multiplier = GRAVITY_M_S2 * np.sin(angle) - speed**2
        return np.stack([ones, angle], axis=1), np.stack([zeros, speed], axis=1), multiplier
    return _spherical(t_s, azimuth_rad)


def _spherical(t_s: Array, azimuth_rad: float) -> tuple[Array, Array, Array]:
    down = np.array([0.0, 0.0, -GRAVITY_M_S2])

    def slope(_: float, y: Array) -> Array:
        x, v = y[:3], y[3:]
        # |x| = 1 twice differentiated; divided by |x|^2, a small drift is not amplified
        m = -(down @ x + v @ v) / (x @ x)
        return np.concatenate([v, down + m * x])

    east, north = np.cos(azimuth_rad), np.sin(azimuth_rad)
    half = np.sqrt(0.5)
    y = _solve(slope, np.array([half * east, half * north, -half, -north, east, 0.0]), t_s)
    x, v = y[:3].T, y[3:].T
    return x, v, GRAVITY_M_S2 * x[:, 2] - np.sum(v**2, axis=1)


def _solve(slope, start: Array, t_s: Array) -> Array:
    found = solve_ivp(
        slope, (t_s[0], t_s[-1]), start, t_eval=t_s, method="DOP853", rtol=_TOLERANCE, atol=_TOLERANCE / 10
    )
    return found.y


def write_pendulum(recording: PendulumRecording, folder: Path) -> None:
    """Write ``samples.csv`` (times and coordinates as measured), ``truth.npz`` and ``card.json``."""
    folder.mkdir(parents=True, exist_ok=True)
    titles = ["t_s", *_COORDINATES[recording.kind]]
    table = np.column_stack([recording.t_s, recording.samples])
    write_table(folder / "samples.csv", titles, table, decimals=12)
    np.savez_compressed(
        folder / "truth.npz", t_s=recording.t_s, q=recording.q, v=recording.v, multiplier_n=recording.multiplier
    )
    card = {
        "name": f"{recording.kind} pendulum",
        "length_m": 1.0,
        "mass_kg": 1.0,
        "gravity_m_s2": GRAVITY_M_S2,
        "samples": len(recording.t_s),
        "radial_noise_width_m": recording.noise_m,
        "seed": recording.seed,
        "truth": f"SciPy DOP853, tolerance {_TOLERANCE:g}",
    }
    (folder / "card.json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


STAND_M = {"top": (0.0, 0.0, 0.4), "front": (0.35, 0.0, 0.15), "side": (0.0, 0.35, 0.15), "pivot": (0.0, 0.0, 0.0)}
"""Markers that stand still; the pivot is the joint's centre, z is up."""


def make_pendulum_film(
    kind: Pendulum,
    *,
    seed: int = 0,
    n_frames: int = 600,
    fps: float = 100.0,
    swing_rad: float = np.pi / 6,
    azimuth_rad: float = 0.0,
) -> SyntheticRecording:
    """A pendulum of 1 m and 1 kg before four cameras.

    Args:
        kind: ``planar`` or ``spherical``.
        seed: Of clicks and losses; the motion does not depend on it.
        n_frames: Number of frames.
        fps: Frames a second.
        swing_rad: Angle above the horizontal at which the planar pendulum is released at rest.
        azimuth_rad: Turn of the spherical pendulum's start about the vertical.

    Returns:
        The recording, with its truth: markers ``top``, ``front``, ``side``, ``pivot``, ``bob``.
    """
    cameras = []
    for i in range(4):
        azimuth, elevation = np.deg2rad(20 + 90 * i), np.deg2rad((15, 35)[i % 2])
        around = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        lens = BrownLens(f_px=(1000.0, 1000.0), centre_px=(640.0, 512.0), k=(-0.1, 0.03, 0.0))
        target = np.array([0.0, 0.0, -0.2])
        cameras.append(
            aimed(f"cam{i + 1}", position_m=target + 3.4 * around, target_m=target, size_px=(1280, 1024), lens=lens)
        )
    return film(
        partial(_scene, kind=kind, swing_rad=swing_rad, azimuth_rad=azimuth_rad),
        tuple(cameras),
        name=f"{kind}_pendulum",
        seed=seed,
        n_frames=n_frames,
        fps=fps,
        digitiser=Digitiser(bursts_per_s=1.5, burst_frames=(10, 40)),  # lost in all cameras at times
        card={
            "name": f"{kind} pendulum on a stand",
            "length_m": 1.0,
            "mass_kg": 1.0,
            "gravity_m_s2": GRAVITY_M_S2,
            "rig": "four cameras, 3 m from the pivot",
        },
    )


def pendulum_skeleton() -> Skeleton:
    """A stand that is the trunk, one joint, and a mass."""
    return Skeleton(
        name="pendulum",
        markers=(*STAND_M, "bob"),
        bones=(Bone(a="top", b="pivot"), Bone(a="front", b="pivot"), Bone(a="side", b="pivot")),
        joints=(Joint(name="pivot", parent="top", centre="pivot", child="bob"),),
        trunk=tuple(STAND_M),
        measures=Measures(segments={"bob": Segment(start="bob", end="bob", mass_g=1000.0)}),
    )


def _scene(t_s: Array, *, kind: Pendulum, swing_rad: float, azimuth_rad: float) -> FilmedScene:
    q = pendulum_motion(kind, t_s, swing_rad=swing_rad, azimuth_rad=azimuth_rad)[0]
    if kind == "planar":
        bob = np.stack([q[:, 0] * np.cos(q[:, 1]), np.zeros(len(q)), q[:, 0] * np.sin(q[:, 1])], axis=1)
        bob = rotated(turn(2, 0.45), bob)
    else:
        bob = q
    stand = np.broadcast_to(np.array(list(STAND_M.values())), (len(q), len(STAND_M), 3))
    return FilmedScene(
        skeleton=pendulum_skeleton(),
        t_s=t_s,
        xyz_m=np.concatenate([stand, bob[:, None]], axis=1),
        triangles=np.empty((0, 3), dtype=int),
        solids=(),
        clearance_m=0.001,
        clusters=(("bob",),),
        contact=np.zeros((len(q), len(STAND_M) + 1), dtype=bool),
    )
