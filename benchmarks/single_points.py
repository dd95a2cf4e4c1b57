"""Accelerations of single points, beside splines and a Butterworth filter that are tuned on the answer.

    python -m benchmarks.single_points [--quick] [--seeds 0 1 ...] --out DIR

Points whose accelerations are known are tracked as users track them: a simulated swallow, a mosquito and a dropped
ball, whole and with gaps, and the field's own measurement (Pezzack, Norman & Winter 1977, J. Biomech. 10, 377): an
angle, here as a point on an arm of 1 m, and its angular acceleration by an accelerometer, noisy and raw.
``DIR/table.csv`` has a row for each recording and method: RMS error of the acceleration, over that of the quintic
spline whose smoothing is best in hindsight, z = rms(error / stated standard deviation), the share inside 95 %
intervals. Of the measurement a second row has the accelerometer half a frame earlier, where it agrees best with the
film.
``DIR/spread.csv`` has 10, 50 and 90 % over recordings of each kind.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from mocap.datasets.real import folder
from scipy.interpolate import BSpline, make_smoothing_spline
from scipy.signal import butter, sosfiltfilt

from eal.arrays import Z95, Array
from eal.systems import GRAVITY_M_S2
from mocap.kinematics.records import Rests
from mocap.reading.arrays import from_arrays
from mocap.results.tracked import track

EDGE = 5
"""Frames at both ends that are not scored."""
FINE = 20
"""Steps of a simulated path in a frame."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Point:
    """One recording.

    Attributes:
        name: Its kind and seed.
        t_s: (T,) times.
        xyz_m: (T, 3) digitised positions.
        truth: (T, 3) accelerations, or (T,) along ``along``.
        along: (T, 3) unit vectors; None: all three components are known.
    """

    name: str
    t_s: Array
    xyz_m: Array
    truth: Array
    along: Array | None = None

    def error(self, acceleration: Array) -> Array:
        """(T, 3) or (T,) of accelerations (T, 3)."""
        if self.along is None:
            return acceleration - self.truth
        return np.sum(self.along * acceleration, axis=1) - self.truth

    def deviation(self, sd: Array) -> Array:
        """The same of standard deviations, which are taken for independent."""
        return sd if self.along is None else np.sqrt(np.sum((self.along * sd) ** 2, axis=1))


def bursts(rng: np.random.Generator, t_s: Array, *, size: float, count: int, width_s: float) -> Array:
    """(T,) sum of so many bells at any time, normal in size."""
    at, high = rng.uniform(0, t_s[-1], count), size * rng.normal(size=count)
    wide = width_s * rng.uniform(0.6, 1.6, count)
    return (high[:, None] * np.exp(-0.5 * ((t_s - at[:, None]) / wide[:, None]) ** 2)).sum(axis=0)


def flight(kind: str, seed: int) -> Point:
    """A swallow (9 m/s, 200 frames/s, 4 mm), a mosquito (0.45 m/s, 100 frames/s, 0.8 mm), a ball (250, 1 mm).

    Flyers turn in bursts; the swallow's body bobs by 5 mm at 7 beats a second.
    """
    rng = np.random.default_rng(seed)
    fps, n_frames, noise = {"swallow": (200, 300, 4e-3), "mosquito": (100, 300, 8e-4), "ball": (250, 110, 1e-3)}[kind]
    step = 1 / fps / FINE
    t_s = step * np.arange((n_frames + 2) * FINE)
    if kind == "ball":
        fall = np.tile([0.0, 0.0, -GRAVITY_M_S2], (len(t_s), 1))
        x = rng.normal(0, [0.3, 0.0, 0.3]) * t_s[:, None] + fall * t_s[:, None] ** 2 / 2
    else:
        fast, rate, width, up = (9.0, 6.0, 0.12, 0.3) if kind == "swallow" else (0.45, 10.0, 0.06, 0.5)
        count = 4 if kind == "swallow" else round(4 * t_s[-1])
        yaw = step * np.cumsum(bursts(rng, t_s, size=rate, count=count, width_s=width)) + rng.uniform(0, 2 * np.pi)
        turn = step * np.cumsum(bursts(rng, t_s, size=rate / 2, count=count, width_s=width))
        pitch = up * np.tanh(turn)
        speed = fast * np.exp(0.3 * np.tanh(bursts(rng, t_s, size=1.0, count=count, width_s=2 * width)))
        way = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], axis=1)
        x = step * np.cumsum(speed[:, None] * way, axis=0)
        if kind == "swallow":
            x[:, 2] += 5e-3 * np.sin(2 * np.pi * 7 * t_s + rng.uniform(0, 2 * np.pi))
        fall = np.gradient(np.gradient(x, step, axis=0), step, axis=0)
    shown = slice(FINE, FINE * (n_frames + 1), FINE)
    seen = x[shown] + noise * rng.normal(size=(n_frames, 3))
    return Point(name=f"{kind} {seed}", t_s=np.arange(n_frames) / fps, xyz_m=seen, truth=fall[shown])


def measured(path: Path) -> Iterator[Point]:
    """The angle on its arm, noisy and raw; and with the accelerometer half a frame earlier."""
    t_s, raw, noisy, acceleration = np.loadtxt(path).T
    half = 0.5 * (t_s[1] - t_s[0])
    for name, angle in (("noisy", noisy), ("raw", raw)):
        arm = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        along = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
        for more, truth in (("", acceleration), (", earlier", np.interp(t_s + half, t_s, acceleration))):
            yield Point(name=f"measured {name}{more}", t_s=t_s, xyz_m=arm, truth=truth, along=along)


def with_gaps(point: Point) -> Point:
    """Ten frames of every fifty are not seen."""
    xyz = point.xyz_m.copy()
    xyz[(np.arange(len(xyz)) + 20) % 50 >= 40] = np.nan  # not at the ends
    return Point(name=f"{point.name.replace(' ', ', gaps ')}", t_s=point.t_s, xyz_m=xyz, truth=point.truth)


def quintic(point: Point) -> Callable[[float], Array]:
    """Accelerations of a smoothing spline of degree 5 (Woltring 1986), by how smooth it is."""
    t_s, y, degree = point.t_s, point.xyz_m, 5
    knots = np.r_[[t_s[0]] * degree, t_s, [t_s[-1]] * degree]
    seen = np.isfinite(y[:, 0])
    design = BSpline.design_matrix(t_s[seen], knots, degree).toarray()
    nodes, weights = np.polynomial.legendre.leggauss(3)
    step = np.diff(t_s)
    places = (t_s[:-1, None] + step[:, None] * (nodes + 1) / 2).ravel()
    third = BSpline(knots, np.eye(design.shape[1]), degree).derivative(3)(places)
    rough = (third * (0.5 * step[:, None] * weights).ravel()[:, None]).T @ third
    left, right = design.T @ design, design.T @ y[seen]

    def acceleration(smoothing: float) -> Array:
        found = np.linalg.solve(left + smoothing * rough + 1e-300, right)
        return BSpline(knots, found, degree).derivative(2)(t_s)

    return acceleration


def lowpass(point: Point) -> Callable[[float], Array]:
    """Second differences after a Butterworth filter of second order, forward and back, by its cutoff in Hz."""
    dt_s = float(point.t_s[1] - point.t_s[0])
    seen = np.isfinite(point.xyz_m[:, 0])
    whole = np.stack([np.interp(point.t_s, point.t_s[seen], y[seen]) for y in point.xyz_m.T], axis=1)

    def acceleration(cutoff_hz: float) -> Array:
        both: Any = butter(2, min(2 * cutoff_hz * dt_s / 0.802, 0.99), output="sos")  # of two passes (Winter 2009)
        y = sosfiltfilt(both, whole, axis=0)
        return np.gradient(np.gradient(y, dt_s, axis=0), dt_s, axis=0)

    return acceleration


def cubic(point: Point) -> Array:
    """Accelerations of a cubic smoothing spline by generalised cross-validation, of SciPy."""
    seen = np.isfinite(point.xyz_m[:, 0])
    splines = [make_smoothing_spline(point.t_s[seen], y[seen]) for y in point.xyz_m.T]
    return np.stack([spline(point.t_s, nu=2) for spline in splines], axis=1)


def rms(error: Array) -> float:
    """Root mean square of what is scored."""
    return float(np.sqrt(np.mean(error[EDGE:-EDGE] ** 2)))


def best(point: Point, of: Callable[[float], Array], choices: Array) -> float:
    """The least error in hindsight."""
    return min(rms(point.error(of(float(choice)))) for choice in choices)


def rows(point: Point) -> Iterator[dict[str, object]]:
    """One of each method."""
    dt_s = float(point.t_s[1] - point.t_s[0])
    other = best(point, quintic(point), 10.0 ** np.arange(-20, 3, 0.25))
    rivals = {"quintic spline, best in hindsight": other, "cubic spline, GCV": rms(point.error(cubic(point)))}
    cutoffs = np.geomspace(0.5, 0.39 / dt_s, 40)
    rivals["Butterworth, best in hindsight"] = best(point, lowpass(point), cutoffs)
    for method, error in rivals.items():
        yield dict(recording=point.name, method=method, rms=error, over_quintic=error / other)
    for model in ("auto", "constant_velocity"):
        source = from_arrays(point.xyz_m[:, None], names=["p"], fps=1 / dt_s)
        result = track(source, model=model, validate=False)
        parts = [result.kinematics[f"p_acceleration_{axis}_m_s2"] for axis in "xyz"]
        error = point.error(np.stack([part.value for part in parts], axis=1))
        ratio = error / point.deviation(np.stack([part.sd for part in parts], axis=1))
        inner = np.abs(ratio[EDGE:-EDGE])
        dark = (parts[0].rests != Rests.MEASURED)[EDGE:-EDGE]
        yield dict(
            recording=point.name,
            method=result.model,
            rms=rms(error),
            over_quintic=rms(error) / other,
            z=float(np.sqrt(np.mean(inner**2))),
            z_filled=float(np.sqrt(np.mean(inner[dark] ** 2))) if dark.any() else np.nan,
            inside=float(np.mean(inner < Z95)),
        )


def main() -> None:
    """Run, print, write."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="one seed")
    options.add_argument("--seeds", type=int, nargs="+", default=list(range(6)))
    options.add_argument("--out", type=Path, required=True)
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    seeds = given.seeds[:1] if given.quick else given.seeds
    points = [flight(kind, seed) for kind in ("swallow", "mosquito", "ball") for seed in seeds]
    points += [with_gaps(point) for point in points]
    angle = folder() / "angle_with_acceleration" / "angle.txt"
    points += list(measured(angle)) if angle.is_file() else []
    table = pd.DataFrame([row for point in points for row in rows(point)])
    table.to_csv(given.out / "table.csv", index=False)
    kind = table.recording.str.replace(r" \d+$", "", regex=True).rename("kind")
    groups = table.groupby([kind, "method"])[["over_quintic", "z", "z_filled"]]
    spread = groups.quantile(np.array([0.1, 0.5, 0.9])).unstack()
    spread.to_csv(given.out / "spread.csv")
    print(table.round(3).to_string(index=False))
    print(spread.round(2).to_string())


if __name__ == "__main__":
    main()
