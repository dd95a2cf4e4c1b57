"""Velocities, accelerations and angles against the truth of both twins, beside what people use, over noise.

    python -m benchmarks.kinematics [--frames 300] [--noise-mm 0.1 0.3 1 3]

Markers of a twin are moved by independent noise and lose the samples that its cameras lose. What others do: gaps are
filled by cubic splines; then a Butterworth filter of fourth order, forward and back, and central differences (Winter
2009); a cubic smoothing spline and its derivatives; a Savitzky-Golay filter and central differences, as the package
movement does. Their one setting is tuned on the truth, for velocity and acceleration apart, which nobody can do on a
recording; ours has none. Errors are root mean squares over all markers and axes, in samples that were measured and in
those that were filled.
"""

import argparse
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from mocap.datasets.bats import bat_motion, make_bat
from mocap.datasets.lizards import lizard_motion, make_lizard
from mocap.datasets.scene import Motion as SceneMotion
from mocap.filters.anatomy import Anatomy, ends_among
from mocap.filters.interpolate import interpolated
from mocap.filters.models.base import TrialSet
from mocap.filters.models.pose import PoseSettings
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.velocities import Motion
from scipy.interpolate import make_smoothing_spline
from scipy.signal import butter, savgol_filter, sosfiltfilt

from eal.arrays import Array
from mocap.kinematics.compute import kinematics
from mocap.kinematics.points import asked_for
from mocap.kinematics.records import Kinematics, Rests
from mocap.pipeline.demo import measured_demo
from mocap.pipeline.motion import motion_of
from mocap.progress import Stages
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Skeleton

EDGE = 10
"""Frames at both ends that are not scored."""
CUTOFFS_HZ = (3, 5, 8, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100)
WINDOWS = (5, 7, 9, 11, 15, 19, 25, 31, 41)
PENALTIES = tuple(10.0**k for k in np.arange(-14, -3.5, 0.5))


def true_motion(scene: SceneMotion, motion: Motion, skeleton: Skeleton) -> Motion:
    """The motion with true positions and velocities (central differences over 0.2 ms of a closed form)."""
    t_s, step = motion.t_s, 1e-4
    names = [name for name in motion.names if name in skeleton.markers]
    weights = asked_for(names, skeleton, n_frames=len(t_s)).all_weights
    x, later, before = (scene(t).xyz_m for t in (t_s, t_s + step, t_s - step))
    v = (later - before) / (2 * step)
    return replace(
        motion, xyz_m=np.einsum("nm,tmi->tni", weights, x), velocity_m_s=np.einsum("nm,tmi->tni", weights, v)
    )


def true_acceleration(scene: SceneMotion, t_s: Array) -> Array:
    """(T, M, 3) second differences over 1 ms of a closed form."""
    step = 5e-4
    x, later, before = (scene(t).xyz_m for t in (t_s, t_s + step, t_s - step))
    return (later - 2 * x + before) / step**2


def tracked(xyz_m: Array, t_s: Array, skeleton: Skeleton, sd_m: float) -> tuple[MarkerTracks, Motion]:
    """Noisy markers tracked by the pose model."""
    names = list(skeleton.markers)
    sd = np.where(np.isfinite(xyz_m[..., 0]), sd_m, np.nan)
    trial = MarkerTrial(name="twin", t_s=t_s, xyz_m=xyz_m, sd_m=sd)
    trunk = [names.index(name) for name in skeleton.trunk]
    asked = asked_for(names, skeleton, n_frames=len(t_s))
    fitted = PoseSettings().fit(
        TrialSet([trial], Anatomy(trunk=tuple(trunk), bones=tuple(ends_among(names, skeleton.rigid))))
    )
    found = fitted.fill(PositionObservations(xyz_m=xyz_m, sd_m=sd), asked=asked)
    status = np.where(np.isfinite(xyz_m[..., 0]), Status.MEASURED, Status.SMOOTHED)
    markers = MarkerTracks(names=tuple(names), t_s=t_s, xyz_m=found.xyz_m, cov_m2=found.cov_m2, status=status)
    return markers, motion_of(markers, slice(0, len(t_s)), found.rates, asked)


def butterworth(x: Array, t_s: Array, cutoff_hz: float) -> tuple[Array, Array]:
    """Velocity and acceleration by central differences of a filtered path."""
    rate = 1 / (t_s[1] - t_s[0])
    corrected = cutoff_hz / 0.802  # two passes
    if corrected >= rate / 2:
        return np.full_like(x, np.nan), np.full_like(x, np.nan)
    smooth = sosfiltfilt(butter(2, corrected, fs=rate, output="sos"), x, axis=0)
    return differences(smooth, t_s)


def savitzky_golay(x: Array, t_s: Array, window: float) -> tuple[Array, Array]:
    """As movement: a filter of second order, then central differences."""
    return differences(savgol_filter(x, int(window), 2, axis=0), t_s)


def spline(x: Array, t_s: Array, penalty: float) -> tuple[Array, Array]:
    """A cubic smoothing spline and its derivatives."""
    columns = x.reshape(len(x), -1).T  # one by one: SciPy before 1.16 takes no more
    fitted = [make_smoothing_spline(t_s, column, lam=penalty) for column in columns]
    v, a = (np.stack([one.derivative(n)(t_s) for one in fitted], axis=-1).reshape(x.shape) for n in (1, 2))
    return v, a


def differences(x: Array, t_s: Array) -> tuple[Array, Array]:
    """Central differences, twice."""
    v = np.gradient(x, t_s, axis=0)
    return v, np.gradient(v, t_s, axis=0)


Method = Callable[[Array, Array, float], tuple[Array, Array]]
METHODS: dict[str, tuple[Method, Iterable[float]]] = {
    "Butterworth + differences": (butterworth, CUTOFFS_HZ),
    "smoothing spline": (spline, PENALTIES),
    "Savitzky-Golay (movement)": (savitzky_golay, WINDOWS),
}


def rmse(found: Array, truth: Array, where: np.ndarray) -> float:
    """Root mean square over markers and axes."""
    return float(np.sqrt(np.mean((found - truth)[where] ** 2)))


def velocity_errors(name: str, *, n_frames: int, noise_m: float, seed: int = 0) -> dict[str, float]:
    """Root mean square error of measured velocities by method: the smoother's state first, then the tuned filters."""
    recording = (make_bat if name == "bat" else make_lizard)(seed=seed, n_frames=n_frames)
    t_s, skeleton, true = recording.truth.t_s, recording.skeleton, recording.truth.xyz_m
    seen = recording.pixels.seen.sum(axis=0) >= 2
    noise = noise_m * np.random.default_rng(seed).normal(size=true.shape)
    xyz = np.where(seen[..., None], true + noise, np.nan)
    _, motion = tracked(xyz, t_s, skeleton, noise_m)
    scene = bat_motion(seed) if name == "bat" else lizard_motion(seed)
    exact = true_motion(scene, motion, skeleton).velocity_m_s[:, : true.shape[1]]
    seen[:EDGE], seen[-EDGE:] = False, False
    out = {"state of the smoother": rmse(motion.velocity_m_s[:, : true.shape[1]], exact, seen)}
    base = np.where(np.isfinite(xyz), xyz, interpolated(xyz, t_s, kind="cubic"))
    base = np.where(np.isfinite(base), base, true)
    for label, (method, settings) in METHODS.items():
        errors = [rmse(method(base, t_s, float(s))[0], exact, seen) for s in settings]
        out[label] = float(np.nanmin(errors))
    return out


def sweep(name: str, n_frames: int, noises_mm: Iterable[float], seed: int = 0) -> None:
    """Print a table a noise level."""
    recording = (make_bat if name == "bat" else make_lizard)(seed=seed, n_frames=n_frames)
    scene = bat_motion(seed) if name == "bat" else lizard_motion(seed)
    t_s, skeleton, true = recording.truth.t_s, recording.skeleton, recording.truth.xyz_m
    seen = recording.pixels.seen.sum(axis=0) >= 2
    inner = np.zeros_like(seen)
    inner[EDGE:-EDGE] = True
    acceleration = true_acceleration(scene, t_s)
    for noise_mm in noises_mm:
        rng = np.random.default_rng(seed)
        sd = 1e-3 * noise_mm
        xyz = np.where(seen[..., None], true + sd * rng.normal(size=true.shape), np.nan)
        markers, motion = tracked(xyz, t_s, skeleton, sd)
        truth = true_motion(scene, motion, skeleton)
        velocity = truth.velocity_m_s[:, : true.shape[1]]
        found = kinematics(motion, skeleton)
        exact = kinematics(truth, skeleton)
        print(f"\n{name}, noise {noise_mm:g} mm, {n_frames} frames: root mean square errors")
        print(f"  {'':28} velocity m/s       acceleration m/s2")
        print(f"  {'':28} measured  filled    measured  filled")
        ours = [
            stacked(found, markers.names, kind, unit) for kind, unit in (("velocity", "m_s"), ("acceleration", "m_s2"))
        ]
        rows = {"state of the smoother": [(v, v) for v in ours]}
        base = np.where(np.isfinite(xyz), xyz, interpolated(xyz, t_s, kind="cubic"))
        base = np.where(np.isfinite(base), base, true)  # outside of sightings, where others have nothing
        for label, (method, settings) in METHODS.items():
            tried = [method(base, t_s, float(s)) for s in settings]
            rows[label] = [
                best(tried, 0, velocity, seen & inner, ~seen & inner),
                best(tried, 1, acceleration, seen & inner, ~seen & inner),
            ]
        for label, (v, a) in rows.items():
            numbers = [rmse(v[0], velocity, seen & inner), rmse(v[1], velocity, ~seen & inner)]
            numbers += [rmse(a[0], acceleration, seen & inner), rmse(a[1], acceleration, ~seen & inner)]
            print(f"  {label:28} {numbers[0]:8.4f} {numbers[1]:8.4f}   {numbers[2]:8.2f} {numbers[3]:8.2f}")
        print(coverage(found, exact))


def product(name: str, seed: int) -> None:
    """Print what ``mocap demo`` states of a whole twin, filmed and clicked, beside its truth: errors, and coverage.

    The mixture as users run it.
    """
    run, _, true = measured_demo("bat" if name == "bat" else "lizard", stages=Stages(), seed=seed)
    scene = bat_motion(seed) if name == "bat" else lizard_motion(seed)
    truth = true_motion(scene, run.motion, run.skeleton)
    found, exact = kinematics(run.motion, run.skeleton), kinematics(truth, run.skeleton)
    print(f"\n{name}, seed {seed}, {len(true)} frames, by mocap demo: errors and share inside 95 % intervals")
    print(coverage(found, exact), flush=True)


def best(tried: list[tuple[Array, Array]], which: int, truth: Array, *masks: np.ndarray) -> tuple[Array, ...]:
    """What is best in each mask, by the truth."""
    return tuple(
        min((t[which] for t in tried if np.isfinite(t[which]).all()), key=lambda x, m=m: rmse(x, truth, m))
        for m in masks
    )


def stacked(found: Kinematics, names: Iterable[str], kind: str, unit: str) -> Array:
    """(T, M, 3) a vector of each marker."""
    return np.stack([np.stack([found[f"{n}_{kind}_{a}_{unit}"].value for a in "xyz"], axis=1) for n in names], axis=1)


GROUPS = {
    "angles deg": ("joint", ("angle_deg", "flexion_deg", "abduction_deg", "rotation_deg")),
    "angular rates deg/s": ("joint", ("rate_deg_s",)),
    "angular accelerations deg/s2": ("joint", ("acceleration_deg_s2",)),
    "velocities m/s": ("marker", ("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s")),
    "speeds m/s": ("marker", ("speed_m_s",)),
    "accelerations m/s2": ("marker", ("acceleration_x_m_s2", "acceleration_y_m_s2", "acceleration_z_m_s2")),
    "body m, m/s, m/s2": ("body", ("_m", "_m_s", "_m_s2")),
    "yaw, pitch, roll deg": ("body", ("yaw_deg", "pitch_deg", "roll_deg")),
    "lengths m": ("length", ("_m",)),
    "areas m2": ("area", ("_m2",)),
    "strokes deg": ("stroke", ("stroke_deg", "deviation_deg", "phase_deg")),
    "centre of mass": ("mass", ("_m", "_m_s", "_m_s2")),
}


def coverage(found: Kinematics, exact: Kinematics) -> str:
    """RMSE and share of values inside their 95 % intervals, by group."""
    lines = [f"  {'':30} {'measured':>24} {'filled':>28}"]
    for label, (kind, endings) in GROUPS.items():
        cells = []
        for rests in (Rests.MEASURED, Rests.FILLED):
            inside, squares = [], []
            for q in found.of(kind):
                if not q.name.endswith(endings):
                    continue
                error = q.value - exact[q.name].value
                error = (error + 180) % 360 - 180 if q.unit == "deg" else error
                where = (q.rests == rests) & np.isfinite(error)
                where[:EDGE], where[-EDGE:] = False, False
                inside.append(np.abs(error[where]) < 1.96 * q.sd[where])
                squares.append(error[where] ** 2)
            every = np.concatenate(inside) if inside else np.empty(0)
            if len(every):
                cells.append(
                    f"{np.sqrt(np.concatenate(squares).mean()):10.4g} {100 * every.mean():5.1f} % of {len(every):6d}"
                )
            else:
                cells.append(f"{'':28}")
        lines.append(f"  {label:30} {cells[0]} {cells[1]}")
    return "\n".join(lines)


def main() -> None:
    """Both twins."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--noise-mm", type=float, nargs="+", default=[0.05, 0.2, 0.5, 1.0, 2.0])
    parser.add_argument("--product", type=int, metavar="SEEDS", help="mocap demo of so many seeds, no sweep")
    parser.add_argument("--twins", nargs="+", default=["bat", "lizard"])
    given = parser.parse_args()
    for twin in given.twins:
        for seed in range(given.product or 0):
            product(twin, seed)
        if given.product:
            continue
        sweep(twin, given.frames, given.noise_mm)


if __name__ == "__main__":
    main()
