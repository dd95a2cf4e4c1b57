"""Error against the number of trials learned from: ``python -m benchmarks.gaps.learning_curve --out FILE``.

The left wing of the synthetic bat in level flight, one animal: eight markers of 400 frames at 240 Hz, the truth with
independent noise of 0.2 mm and no other gaps, positions only. Trials that are filled are the same for all; gaps of one
marker, two, and the wing. Seconds are those that pass while a method learns, one process at a time.
"""

import argparse
import csv
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mocap.datasets.bat_skeleton import bat_skeleton
from mocap.datasets.bats import bat_motion
from mocap.datasets.scene import frame_times
from threadpoolctl import threadpool_limits

from benchmarks.gaps.hide import cells
from benchmarks.gaps.method import Method, Trial
from benchmarks.gaps.peers.released.disk import Disk, installed
from benchmarks.gaps.protocol import evaluate, shown_trials
from benchmarks.gaps.registry import methods
from benchmarks.gaps.takes import Take, trials_of
from benchmarks.gaps.twins import FRAMES

WING, TRUNK = ("elbow_l", "wrist_l", "d3_tip_l", "d5_tip_l"), ("sternum", "back", "pelvis", "shoulder_l")
BONES = (("shoulder_l", "elbow_l"), ("elbow_l", "wrist_l"), ("wrist_l", "d3_tip_l"), ("wrist_l", "d5_tip_l"))
NOISE_M = 2e-4
LENGTHS = (10, 25, 50)
FIRST = 1000
"""Seed of the first trial."""


def wing_trials(count: int) -> list[Trial]:
    """So many flights of one bat."""
    t_s, names, known = frame_times(FRAMES, 240.0), (*WING, *TRUNK), bat_skeleton().markers
    index = [known.index(name) for name in names]
    takes = []
    for seed in range(FIRST, FIRST + count):
        scene = bat_motion(seed)(t_s)
        noise = np.random.default_rng(seed).normal(0, NOISE_M, (FRAMES, len(names), 3))
        takes.append(Take(f"bat_{seed}", t_s, scene.xyz_m[:, index] + noise))
    return trials_of(takes, names, trunk=TRUNK, limbs=(WING,), bones=BONES)


def curve(
    method: Method, training: Sequence[Trial], tested: Sequence[Trial], seeds: Sequence[int]
) -> tuple[float, dict[int, float]]:
    """Seconds of learning, and RMSE (mm) at each gap length over all scenarios, weighted by samples."""
    begin = time.perf_counter()
    filler = method.learn(training)
    seconds = time.perf_counter() - begin
    squares: dict[int, list[tuple[float, int]]] = {}
    for trial in tested:
        for seed in seeds:
            shown = shown_trials(trial, seed, cells(scenarios=("single", "pair", "limb"), lengths=LENGTHS), once=True)
            for score in evaluate(filler, shown, by_rays=False).scores:
                squares.setdefault(score.gap, []).append((score.rmse_mm**2 * score.samples, score.samples))
    return seconds, {
        gap: float(np.sqrt(np.sum(parts, axis=0)[0] / np.sum(parts, axis=0)[1])) for gap, parts in squares.items()
    }


def main() -> int:
    """Run it; a row as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gaps.learning_curve")
    parser.add_argument("--trials", type=int, nargs="+", default=[1, 3, 10, 30])
    parser.add_argument(
        "--methods", nargs="+", default=["constant_velocity", "conditional_gaussian_delay", "disk_transformer", "EAL"]
    )
    parser.add_argument("--steps", type=int, default=300, help="of DISK's optimiser (300)")
    parser.add_argument("--tested", type=int, default=2, help="trials that are filled (2)")
    parser.add_argument("--seeds", type=int, default=1, help="draws of gaps in each (1)")
    parser.add_argument("--out", type=Path, required=True, help="csv; rows are added")
    args = parser.parse_args()
    known: list[Method] = list(methods())
    if installed():
        known += [Disk("transformer", args.steps), Disk("gru", args.steps)]
    chosen = {method.name: method for method in known if method.name in args.methods}
    for name in set(args.methods) - set(chosen):
        print(f"{name}: not there", file=sys.stderr)
    trials = wing_trials(args.tested + max(args.trials))
    tested, others = trials[: args.tested], trials[args.tested :]
    with args.out.open("a", newline="") as file, threadpool_limits(1):
        writer = csv.writer(file)
        for count in args.trials:
            for name in args.methods:
                if name in chosen:
                    seconds, rmse = curve(chosen[name], others[:count], tested, range(args.seeds))
                    writer.writerow([name, count, f"{seconds:.1f}", *(f"{rmse[gap]:.3f}" for gap in LENGTHS)])
                    file.flush()
                    print(name, count, f"{seconds:.0f} s", rmse, file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
