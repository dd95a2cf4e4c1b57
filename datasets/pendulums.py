"""The pendulums of the paper, section 8, with truth by SciPy's DOP853: samples to learn from, on and off the circle."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp

from eal.arrays import Array, frozen
from mocap.io.csv_table import write_table

Pendulum = Literal["planar", "spherical"]
GRAVITY_M_S2 = 9.81
_TOLERANCE = 1e-12
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
        return _planar(t_s, swing_rad)
    return _spherical(t_s, azimuth_rad)


def _planar(t_s: Array, swing_rad: float) -> tuple[Array, Array, Array]:
    def slope(_: float, y: Array) -> Array:
        return np.array([y[1], -GRAVITY_M_S2 * np.cos(y[0])])

    angle, speed = _solve(slope, np.array([swing_rad, 0.0]), t_s)
    ones, zeros = np.ones(len(t_s)), np.zeros(len(t_s))
    multiplier = GRAVITY_M_S2 * np.sin(angle) - speed**2
    return np.stack([ones, angle], axis=1), np.stack([zeros, speed], axis=1), multiplier


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
