"""What does V_z do as the paper has it, as a force with substeps, beside the same V_z enforced implicitly?

The gap benchmark's trials and gaps: the first trials are left out in turn, all models are learned from the others with
the same settings. Root mean square error in mm over all scenarios, by length of gap. "weight" is the potential that an
unseen pose is charged (``filters.learn``): of the log density a radian of the motion where it is enforced, of the mean
kinetic energy where it is a force.

    python -m design.literal_eal [--sets twin_bat bat ...] [--folds 2] [--seeds 2] [--frames 300]

| mm at 10, 25, 50 frames | bat, 3 folds, 1 seed | twin_bat, 2 folds, 1 seed |
|---|---|---|
| constant velocity in the subspace | 3.9, 14.1, 24.7 | 9.2, 19.7, 23.8 |
| + V_z as a force, weight 1 | 4.1, 15.2, 41.6 (9 substeps) | 11.3, 9.8, 36.4 (15) |
| + V_z as a force, weight 4 | 4.7, 15.4, 42.3 (18 substeps) | 7.7, 13.1, 12.7 (30) |
| + V_z implicitly, weight 1 | 3.8, 13.5, 24.7 | 7.0, 12.6, 14.2 |
| + V_z implicitly, weight 4 | 3.8, 13.5, 25.7 | 7.3, 12.7, 14.6 |

On the bat the force is worse at every length than no potential; on the twin it is better or worse than the implicit one
by length and weight, without order. It takes 2.4 to 4.1 times the time. So the implicit one is used; with one seed and
two or three folds this tells large differences only, and why the force fails on the bat was not looked into.

It depends on the noise. With excess = residual = residual_rate = 1 in place of ``SHARP``'s: bat (3 folds, 2 seeds)
3.6, 13.6, 24.1 without; 4.8, 16.7, 36.2 by force (weight 4); 3.9, 15.4, 30.7 by the implicit one, which loses, too; one
fold of the twin 10.1, 22.7, 21.2, then 8.5, 8.2, 11.2, then 9.4, 12.6, 16.4: there the force is the best of the three.
"""

import argparse
import time
from dataclasses import replace

import numpy as np

from benchmarks.gaps.hide import SCENARIOS, cells
from benchmarks.gaps.method import Trial
from benchmarks.gaps.protocol import shown_trials
from benchmarks.gaps.sets import load
from filters.learn import learn_pose
from filters.motion.literal import LiteralShape
from filters.motion.pose import PoseMotion
from filters.observations import PositionObservations
from filters.poses import MarkerTrial, poses_of, shapes_of
from filters.track import smooth
from filters.tune import SHARP
from mocap.arrays import Array

LENGTHS = (10, 25, 50)
BASE = replace(SHARP, ranks=(2, 4, 8, 15), centres=200)
KINDS = {
    "constant velocity in the subspace": replace(BASE, potential="none"),
    "+ V_z as a force, weight 1": replace(BASE, mechanics="literal", weight=1.0),
    "+ V_z as a force, weight 4": replace(BASE, mechanics="literal", weight=4.0),
    "+ V_z implicitly, weight 1": replace(BASE, weight=1.0),
    "+ V_z implicitly, weight 4": replace(BASE, weight=4.0),
}


def marker_trial(trial: Trial) -> MarkerTrial:
    """A trial as models learn from it."""
    sd = np.broadcast_to(np.maximum(trial.sd_m, 5e-5), trial.xyz_m.shape[:2])
    return MarkerTrial(name=trial.name, t_s=trial.t_s, xyz_m=trial.xyz_m, sd_m=sd)


def squares(trials: list[Trial], left_out: int, seed: int, frames: int, out: dict[str, dict[int, list[Array]]]) -> str:
    """Add the squared errors of every model in the gaps of one trial; a line on substeps and time."""
    told, learned = {}, [marker_trial(t) for i, t in enumerate(trials) if i != left_out]
    trunk = [trials[0].names.index(name) for name in trials[0].trunk]
    wanted = cells(scenarios=SCENARIOS, lengths=LENGTHS)
    for copy in shown_trials(trials[left_out], seed, wanted, frames=frames):
        own = marker_trial(copy.trial)
        poses = poses_of([*learned, own], trunk, body_hz=BASE.body_hz)
        shapes = shapes_of(poses, ranks=BASE.ranks)
        for name, settings in KINDS.items():
            model = learn_pose(poses, settings, shapes=shapes)
            begin = time.process_time()
            found = smooth(model, PositionObservations(xyz_m=own.xyz_m, sd_m=own.sd_m), own.t_s)
            told[name] = f"{1e3 * (time.process_time() - begin) / len(own.t_s):.1f} ms{_substeps(model, own.dt_s)}"
            filled = found.xyz_m - copy.truth.xyz_m
            for gap in copy.gaps:
                error = filled[gap.frames][:, gap.scored].reshape(-1, 3)
                out[name].setdefault(gap.length, []).append(np.sum(error**2, axis=1))
    return "; ".join(told.values())


def _substeps(model: PoseMotion, dt_s: float) -> str:
    return f", {model.mechanics.substeps(dt_s)} substeps" if isinstance(model.mechanics, LiteralShape) else ""


def main() -> None:
    """Print a table a set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", nargs="+", default=["twin_bat", "bat"])
    parser.add_argument("--folds", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--frames", type=int, default=300)
    options = parser.parse_args()
    for name in options.sets:
        try:
            trials = load(name)
        except FileNotFoundError as error:
            print(f"{name}: not here ({error.filename})")
            continue
        out: dict[str, dict[int, list[Array]]] = {kind: {} for kind in KINDS}
        told = ""
        for left_out in range(min(options.folds, len(trials))):
            for seed in range(options.seeds):
                told = squares(trials, left_out, seed, options.frames, out) or told
        print(f"\n{name:36}" + "".join(f"{f'{n} frames':>12}" for n in LENGTHS))
        for (kind, found), cost in zip(out.items(), told.split("; "), strict=True):
            rmse = [1e3 * np.sqrt(np.concatenate(found[n]).mean()) if n in found else np.nan for n in LENGTHS]
            print(f"{kind:36}" + "".join(f"{value:12.1f}" for value in rmse) + f"   {cost}", flush=True)


if __name__ == "__main__":
    main()
