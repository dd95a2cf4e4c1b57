"""Whether moments of a chain that swings freely are stated rightly: all net moments are zero.

    python -m benchmarks.passive_chain [--quick] [--first 0] [--count 100] [--kinds plane space] --out DIR

Three thin rods (3, 2, 1 g; 30, 25, 20 mm) hang from a pivot with a marker above it and swing from random angles and
rates, in a plane or in space; five markers, 0.2 mm of noise, 250 frames at 250 a second, tracked as users track them.
``DIR/table.csv`` has a row for each recording and quantity: z = rms(error / stated standard deviation) and the share
inside 95 % intervals, of components of positions, velocities, accelerations and of the moment of each joint.
"""

import argparse
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from eal.arrays import Z95, Array
from eal.systems import GRAVITY_M_S2
from mocap.kinematics.moments import moments
from mocap.measures import Measures, Segment
from mocap.reading.arrays import from_arrays
from mocap.report.job import run_job
from mocap.skeleton import Bone, Joint, Skeleton

LENGTH_M, MASS_KG = np.array([0.030, 0.025, 0.020]), np.array([0.003, 0.002, 0.001])
NOISE_M, FPS, FRAMES, EDGE = 2e-4, 250.0, 250, 10


def skeleton() -> Skeleton:
    """A chain of markers a to e that hangs on b; a is above b."""
    joints = [Joint(name=b, parent=a, centre=b, child=c) for a, b, c in zip("abc", "bcd", "cde", strict=True)]
    rods = zip("bcd", "cde", 1e3 * MASS_KG, strict=True)
    segments = {f"rod_{a}": Segment(start=a, end=b, mass_g=float(mass)) for a, b, mass in rods}
    bones = tuple(Bone(a=a, b=b) for a, b in pairwise("abcde"))
    measures = Measures(segments=segments)
    names = tuple("abcde")
    return Skeleton(name="chain", markers=names, bones=bones, joints=tuple(joints), trunk=names[:2], measures=measures)


def mass_matrix() -> Array:
    """(3, 3) of the ends c, d, e: a thin rod from p to q has kinetic energy m (p'^2 + p' q' + q'^2) / 6."""
    out = np.zeros((4, 4))
    for i, mass in enumerate(MASS_KG):
        out[i : i + 2, i : i + 2] += mass / 6 * np.array([[2, 1], [1, 2]])
    return out[1:, 1:]


def accelerations(x: Array, v: Array) -> Array:
    """(3, 3) of the ends: M x'' = weights + constraint forces, lengths constant to second order."""
    mass = np.kron(mass_matrix(), np.eye(3))
    weight = np.zeros((4, 3))
    for i, one in enumerate(MASS_KG):
        weight[i : i + 2, 2] -= 0.5 * one * GRAVITY_M_S2
    rod, rate = np.diff(x, axis=0, prepend=np.zeros((1, 3))), np.diff(v, axis=0, prepend=np.zeros((1, 3)))
    slope = np.zeros((3, 3, 3))  # of half of the squared lengths
    for i in range(3):
        slope[i, i] = rod[i]
        if i:
            slope[i, i - 1] = -rod[i]
    slope = slope.reshape(3, 9)
    free = np.linalg.solve(mass, weight[1:].ravel())
    pull = np.linalg.solve(slope @ np.linalg.solve(mass, slope.T), -np.sum(rate**2, axis=1) - slope @ free)
    return (free + np.linalg.solve(mass, slope.T @ pull)).reshape(3, 3)


def swing(kind: str, seed: int) -> tuple[Array, Array, Array]:
    """(T, 5, 3) positions, velocities and accelerations of the markers."""
    rng = np.random.default_rng([seed, kind == "space"])
    tilt, way = rng.uniform(-1.2, 1.2, 3), np.zeros(3) if kind == "plane" else rng.uniform(0, 2 * np.pi, 3)
    rods = np.stack([np.sin(tilt) * np.cos(way), np.sin(tilt) * np.sin(way), -np.cos(tilt)], axis=1)
    turn = rng.normal(0, 6, (3, 3)) * ([0, 1, 0] if kind == "plane" else [1, 1, 1])
    x0 = np.cumsum(LENGTH_M[:, None] * rods, axis=0)
    v0 = np.cumsum(LENGTH_M[:, None] * np.cross(turn, rods), axis=0)

    def rate(_t: float, state: Array) -> Array:
        x, v = state.reshape(2, 3, 3)
        return np.concatenate([v.ravel(), accelerations(x, v).ravel()])

    times = np.arange(FRAMES) / FPS
    start = np.concatenate([x0.ravel(), v0.ravel()])
    found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=1e-10, atol=1e-12)
    x, v = np.moveaxis(found.y.reshape(2, 3, 3, -1), -1, 1)
    a = np.array([accelerations(*one) for one in zip(x, v, strict=True)])
    fixed = np.broadcast_to([[0, 0, 0.02], [0, 0, 0.0]], (FRAMES, 2, 3))
    whole = [np.concatenate([still, one], axis=1) for still, one in ((fixed, x), (0 * fixed, v), (0 * fixed, a))]
    return whole[0], whole[1], whole[2]


def recording(kind: str, seed: int, *, model: str = "auto") -> list[dict]:
    """Rows of one recording."""
    x, v, a = swing(kind, seed)
    noisy = x + NOISE_M * np.random.default_rng([seed, 5]).standard_normal(x.shape)
    source = from_arrays(noisy, names=list("abcde"), fps=FPS, unit="m", skeleton=skeleton(), name=f"{kind} {seed}")
    run, _ = run_job(source, model=model, validated=False)
    motion, count = run.motion, len(run.names)
    sd = np.sqrt(np.einsum("tnii->tni", motion.own[:, :count].astype(float)))
    pairs: dict[str, tuple[Array, Array]] = {
        "position": (motion.xyz_m[:, :count] - x, sd[..., :3]),
        "velocity": (motion.velocity_m_s[:, :count] - v, sd[..., 3:]),
    }
    found = run.kinematics
    quantities = [[found[f"{name}_acceleration_{axis}_m_s2"] for axis in "xyz"] for name in run.names]
    value, deviation = (np.array([[getattr(q, of) for q in three] for three in quantities]) for of in ("value", "sd"))
    pairs["acceleration"] = (np.moveaxis(value, 2, 0) - a, np.moveaxis(deviation, 2, 0))
    load = moments(motion, run.skeleton)
    for joint in "bcd":
        every = [load[f"{joint}_moment_{axis}_n_m"] for axis in "xyz"]
        pairs[f"moment {joint}"] = (np.stack([q.value for q in every], 1), np.stack([q.sd for q in every], 1))
    rows = []
    for name, (error, stated) in pairs.items():
        ratio = (error / stated)[EDGE:-EDGE]
        ratio = ratio[np.isfinite(ratio)]
        z, inside = float(np.sqrt(np.mean(ratio**2))), float(np.mean(np.abs(ratio) < Z95))
        rms = float(np.sqrt(np.nanmean(error[EDGE:-EDGE] ** 2)))
        rows.append(dict(kind=kind, seed=seed, quantity=name, z=z, inside=inside, rms=rms, model=run.model))
    return rows


def main() -> None:
    """Run, print, write."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="one recording of each kind")
    options.add_argument("--first", type=int, default=0, help="seed of the first recording")
    options.add_argument("--count", type=int, default=100)
    options.add_argument("--kinds", nargs="+", choices=("plane", "space"), default=["plane", "space"])
    options.add_argument("--out", type=Path, required=True)
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict] = []
    for seed in range(given.first, given.first + (1 if given.quick else given.count)):
        for kind in given.kinds:
            path = given.out / f"{kind}_{seed}.json"
            if not path.exists():
                path.write_text(json.dumps(recording(kind, seed)), encoding="utf-8")
            rows += json.loads(path.read_text(encoding="utf-8"))
    table = pd.DataFrame(rows)
    table.to_csv(given.out / "table.csv", index=False)
    by = table.groupby(["kind", "quantity"], sort=False)
    found = pd.DataFrame({f"{share:.0%}": by["z"].quantile(share) for share in (0.1, 0.5, 0.9)})
    found["z of all"] = by["z"].apply(lambda z: np.sqrt((z**2).mean()))
    print(found.assign(inside=by["inside"].mean(), recordings=by.size()).round(3).to_string())


if __name__ == "__main__":
    main()
