"""Whether stated standard deviations are right: z = rms of (error / stated sd), 1 where they are.

    python -m benchmarks.deviations [--quick] [--seeds 0 1 ...] [--jobs 2] --out DIR

Simulated animals (a bat, a bat that turns, a lizard) are filmed, digitised and tracked as users track them, and every
stated standard deviation is compared with the error against ground truth. ``DIR/table.csv`` has a row for each
recording, quantity and kind of sample: n, z, and the share inside 95 % intervals. Kinds of positions, velocities and
accelerations of markers are ``measured with 4+ / 3 / 2 / 1 rays`` (rays that the tracker used) and ``dark to 10 / 25 /
50 / 100 frames`` (by the length of the gap); quantities of several markers are ``measured`` or ``filled``.

Real recordings (``MOCAP_REAL_DATA``) have no ground truth. Two checks stand for it: the root of the normalised
innovation squared per row, 1 where the filter predicts as well as it states, and the rms distance of velocities from a
local cubic through the digitised points, over the stated sd and the cubic's own. ``DIR/cells.csv`` has z of each cell
over recordings, with a 95 % interval from resampling whole recordings, as frames of one are correlated; 10, 50 and 90 %
of z over single recordings, of which pooled ones say nothing, how many are within 0.7 to 1.4, and the recording that is
furthest from 1. Each recording is kept in a file of its own in ``DIR``; those that are there are not
tracked again.
"""

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from mocap.datasets import make_bat, make_lizard, write_recording
from mocap.datasets.bats import bat_motion
from mocap.datasets.film import Motion as SceneMotion
from mocap.datasets.lizards import lizard_motion
from mocap.datasets.real import folder
from mocap.filters.velocities import Motion
from numpy.typing import NDArray

from eal.arrays import Z95, Array, true_runs
from mocap.errors import CalibrationError
from mocap.kinematics.compute import kinematics
from mocap.kinematics.points import rate_points_for
from mocap.kinematics.records import Rests
from mocap.reading.reading import read
from mocap.recording import Recording
from mocap.report.job import run_job
from mocap.skeleton import Skeleton

ANIMALS = {
    "bat": (make_bat, bat_motion),
    "bat_turn": (partial(make_bat, manoeuvre="turn"), partial(bat_motion, manoeuvre="turn")),
    "lizard": (make_lizard, lizard_motion),
}
DARK = (10, 25, 50, 100)
"""Longest gap, in frames, of each kind of dark sample."""
EDGE = 10
"""Frames at both ends that are not scored."""
RIGHT = (0.7, 1.4)
"""Z of a single recording whose stated deviations are right."""
FEWEST = 20
"""Cells of fewer values than this are left out."""
GROUPS = {
    "joint angle": ("joint", ("angle_deg", "flexion_deg", "abduction_deg", "rotation_deg")),
    "angular rate": ("joint", ("rate_deg_s",)),
    "angular acceleration": ("joint", ("acceleration_deg_s2",)),
    "speed": ("marker", ("speed_m_s",)),
    "body turning rate": ("body", ("_deg_s",)),
    "bone length": ("length", ("_m",)),
    "stroke angle": ("stroke", ("stroke_deg", "deviation_deg")),
}
"""Quantities of several markers: kind and ends of their names in ``kinematics.csv``."""


def true_motion(scene: SceneMotion, motion: Motion, skeleton: Skeleton) -> Motion:
    """The motion with true positions, velocities and, where a model states these, accelerations.

    By central differences over 0.2 ms of a closed form; of accelerations they are known to 1e-7 m/s^2.
    """
    t_s, step = motion.t_s, 1e-4
    names = [name for name in motion.names if name in skeleton.markers]
    weights = rate_points_for(names, skeleton, n_frames=len(t_s)).all_weights
    x, later, before = (scene(t).xyz_m for t in (t_s, t_s + step, t_s - step))
    v = (later - before) / (2 * step)
    x, v, a = (np.einsum("nm,tmi->tni", weights, one) for one in (x, v, (later - 2 * x + before) / step**2))
    stated = motion.acceleration_m_s2 is not None
    return replace(motion, xyz_m=x, velocity_m_s=v, acceleration_m_s2=a if stated else None)


def kinds_of(rays: NDArray[np.int64]) -> dict[str, NDArray[np.bool_]]:
    """(T, M) masks of the kinds of samples, from the number of rays (T, M) that the tracker used of each."""
    inner = np.zeros(rays.shape, dtype=bool)
    inner[EDGE:-EDGE] = True
    out = {f"measured with {n} rays": (rays == n) & inner for n in (1, 2, 3)}
    out["measured with 4+ rays"] = (rays >= 4) & inner
    length = np.zeros(rays.shape, dtype=int)
    for m in range(rays.shape[1]):
        for start, stop in true_runs(rays[:, m] == 0):
            if start > 0 and stop < len(rays):  # ends of a recording are no gaps
                length[start:stop, m] = stop - start
    shorter = 0
    for longest in DARK:
        out[f"dark to {longest} frames"] = (length > shorter) & (length <= longest) & inner
        shorter = longest
    return out


def row(recording: str, quantity: str, kind: str, error: Array, sd: Array) -> dict[str, object] | None:
    """One row of the table, of errors and stated standard deviations of any shape; None where there are too few."""
    known = np.isfinite(error) & np.isfinite(sd) & (sd > 0)
    ratio = np.abs(error[known]) / sd[known]
    if len(ratio) < FEWEST:
        return None
    z, inside = float(np.sqrt(np.mean(ratio**2))), float(np.mean(ratio < Z95))
    rms = float(np.sqrt(np.mean(error[known] ** 2)))
    return dict(recording=recording, quantity=quantity, kind=kind, n=len(ratio), z=z, inside=inside, rms_error=rms)


def simulated(animal: str, seed: int, n_frames: int) -> list[dict[str, object]]:
    """Rows of one simulated recording, tracked by the default model from the files that a digitiser would hand on."""
    make, motion = ANIMALS[animal]
    film = make(seed=seed, n_frames=n_frames)
    with TemporaryDirectory() as folder:
        files = write_recording(film, Path(folder))
        source = read(
            files["pixels"],
            fps=film.fps,
            calibration=files["coefficients"],
            profile=files["profile"],
            skeleton=files["skeleton"],
            origin="upper-left",
        )
        run, _ = run_job(source, validated=False)
    name = f"{animal} {seed}"
    truth = true_motion(motion(seed), run.motion, run.skeleton)
    return [r for r in rows_of(name, run, truth) if r is not None]


def rows_of(name: str, run: Recording, truth: Motion) -> Iterator[dict[str, object] | None]:
    """All rows of a tracked recording beside its true motion."""
    markers, motion = run.tracks, run.motion
    count = len(markers.names)
    found, exact = kinematics(motion, run.skeleton), kinematics(truth, run.skeleton)
    variance = np.einsum("tnii->tni", motion.own[:, :count].astype(float))
    states = {
        "position": (markers.xyz_m - truth.xyz_m[:, :count], np.sqrt(np.einsum("tmii->tmi", markers.cov_m2))),
        "velocity": (motion.velocity_m_s[:, :count] - truth.velocity_m_s[:, :count], np.sqrt(variance[..., 3:])),
    }
    names = [[f"{marker}_acceleration_{axis}_m_s2" for axis in "xyz"] for marker in markers.names]
    error = np.array([[found[n].value - exact[n].value for n in three] for three in names])
    sd = np.array([[found[n].sd for n in three] for three in names])
    states["acceleration"] = (np.moveaxis(error, 2, 0), np.moveaxis(sd, 2, 0))
    kinds = kinds_of(run.used.sum(axis=0))
    for quantity, (error, stated) in states.items():
        for kind, where in kinds.items():
            yield row(name, quantity, kind, error[where], stated[where])
    for quantity, (kind, endings) in GROUPS.items():
        for rests in (Rests.MEASURED, Rests.FILLED):
            errors, stated = [], []
            for q in found.of(kind):
                if not q.name.endswith(endings):
                    continue
                error = q.value - exact[q.name].value
                error = (error + 180) % 360 - 180 if q.unit == "deg" else error
                where = q.rests == rests
                where[:EDGE], where[-EDGE:] = False, False
                errors.append(error[where])
                stated.append(q.sd[where])
            if errors:
                yield row(name, quantity, rests.name.lower(), np.concatenate(errors), np.concatenate(stated))


def local_cubic(t_s: Array, xyz_m: Array, sd_m: Array, *, points: int = 15) -> tuple[Array, Array]:
    """Velocity (T, 3) of a local cubic through the nearest digitised points, and its own standard deviation (T, 3).

    Args:
        t_s: (T,) times.
        xyz_m: (T, 3) digitised positions; NaN where there is none.
        sd_m: (T,) their standard deviation.
        points: How many points each fit has; NaN where they do not lie on both sides within twice as many frames.
    """
    velocity, own = np.full(xyz_m.shape, np.nan), np.full(xyz_m.shape, np.nan)
    seen = np.flatnonzero(np.isfinite(xyz_m[:, 0]))
    for t in seen:
        at = np.searchsorted(seen, t)
        near = seen[max(0, at - points // 2) : at + points // 2 + 1]
        if len(near) < points or near[-1] - near[0] > 2 * points:
            continue
        scale = t_s[near[-1]] - t_s[near[0]]
        design = np.vander((t_s[near] - t_s[t]) / scale, 4, increasing=True)
        slope = np.linalg.pinv(design)[1] / scale
        velocity[t] = slope @ xyz_m[near]
        own[t] = np.sqrt(np.sum((slope * sd_m[near]) ** 2))
    return velocity, own


FLIGHTS = "bat_windtunnel_dltdv8"
"""Of ``MOCAP_REAL_DATA``: DLTdv projects of real flights at 700 frames a second."""


def real(project: Path) -> list[dict[str, object]]:
    """Checks without ground truth of a real flight, tracked with its measured lens, or with one that is fitted."""
    try:
        source = read(project, fps=700.0, fit_lens=True)
    except CalibrationError:  # the project has measured lenses
        source = read(project, fps=700.0)
    run, prepared = run_job(source, validated=False)
    name, digitised = f"real {project.parent.parent.name}-{project.parent.name}", prepared.xyz_m
    sd_m = np.sqrt(np.trace(prepared.cov_m2, axis1=-2, axis2=-1) / 3)
    out: list[dict[str, object]] = []
    count = len(run.names)
    stated = np.sqrt(np.einsum("tnii->tni", run.motion.own[:, :count].astype(float))[..., 3:])
    measured = np.isfinite(digitised[..., 0])
    distance, both = np.full(digitised.shape, np.nan), np.full(digitised.shape, np.nan)
    for m in range(count):
        slope, own = local_cubic(run.motion.t_s, digitised[:, m], sd_m[:, m])
        distance[:, m] = run.motion.velocity_m_s[:, m] - slope
        both[:, m] = np.hypot(stated[:, m], own)
    found = row(name, "velocity from a local cubic", "measured", distance[measured], both[measured])
    if found is not None:
        out.append(found)
    ok = np.isfinite(run.nis) & (run.n_rows > 0)
    rows = int(run.n_rows[ok].sum())
    if rows >= FEWEST:
        nis = float(run.nis[ok].sum() / rows)
        out.append(dict(recording=name, quantity="innovation", kind="measured", n=rows, z=np.sqrt(nis), inside=np.nan))
    return out


def cells(table: pd.DataFrame, *, draws: int = 1000) -> pd.DataFrame:
    """Z of each quantity and kind over recordings, of all animals and of each.

    With a 95 % interval from resampling whole recordings; the quantiles of z over single recordings, and how many of
    them are within ``RIGHT``; and the recording whose z is furthest from 1.
    """
    rng = np.random.default_rng(0)
    table = table.assign(animal=table.recording.str.split(" ").str[0])
    out = []
    both = pd.concat([table, table.assign(animal="all")])
    for (animal, quantity, kind), part in both.groupby(["animal", "quantity", "kind"]):
        n, z2, inside = part.n.to_numpy(float), part.z.to_numpy(float) ** 2, part.inside.to_numpy(float)
        pick = rng.integers(0, len(part), (draws, len(part)))
        spread = np.sqrt((n[pick] * z2[pick]).sum(axis=1) / n[pick].sum(axis=1))
        low, high = np.quantile(spread, (0.025, 0.975))
        z = float(np.sqrt((n * z2).sum() / n.sum()))
        share = float((n * inside).sum() / n.sum())
        single = (*np.quantile(part.z, (0.1, 0.5, 0.9)), int(part.z.between(*RIGHT).sum()))
        worst = part.iloc[int(np.argmax(np.abs(np.log(z2))))]
        first = (animal, quantity, kind, len(part), int(n.sum()), z, low, high, share)
        out.append((*first, *single, worst.recording, worst.z))
    names = ["animal", "quantity", "kind", "recordings", "n", "z", "z_low", "z_high", "inside"]
    names += ["z_10", "z_50", "z_90", "right", "worst", "worst_z"]
    return pd.DataFrame(out, columns=pd.Index(names))


def kept(path: Path, rows: Callable[[], list[dict[str, object]]]) -> pd.DataFrame:
    """The rows of a recording, made where its file is not there yet."""
    if not path.exists():
        pd.DataFrame(rows()).to_csv(path, index=False)
    return pd.read_csv(path)


def main() -> None:
    """Run, print, write."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="two seeds of 150 frames each")
    options.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    options.add_argument("--animals", nargs="+", choices=list(ANIMALS), default=list(ANIMALS))
    options.add_argument("--frames", type=int, default=300)
    options.add_argument("--jobs", type=int, default=1)
    options.add_argument("--out", type=Path, required=True)
    given = options.parse_args()
    seeds, frames = (given.seeds[:2], 150) if given.quick else (given.seeds, given.frames)
    given.out.mkdir(parents=True, exist_ok=True)
    asked: list[tuple[Path, Callable[[], list[dict[str, object]]]]] = [
        (given.out / f"{animal}_{seed}_{frames}.csv", partial(simulated, animal, seed, frames))
        for seed in seeds
        for animal in given.animals
    ]
    flights = sorted((folder() / FLIGHTS).glob("*/*/*dvProject.mat"))[: 2 if given.quick else None]
    asked += [(given.out / f"{path.stem}.csv", partial(real, path)) for path in flights]
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        table = pd.concat(pool.map(kept, *zip(*asked, strict=True)))
    table.to_csv(given.out / "table.csv", index=False)
    found = cells(table)
    found.to_csv(given.out / "cells.csv", index=False)
    print(found.pivot_table(index=["quantity", "kind"], columns="animal", values="z").round(2).to_string())
    print(f"z over single recordings: 10, 50, 90 %, and how many are within {RIGHT[0]:g} to {RIGHT[1]:g}")
    single = found[found.animal == "all"].set_index(["quantity", "kind"])
    print(single[["z_10", "z_50", "z_90", "right", "recordings"]].round(2).to_string())


if __name__ == "__main__":
    main()
