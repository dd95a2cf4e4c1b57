"""What distances that markers keep add to a pose model, and how stiff they are: ``python -m design.bones [SET ...]``.

As in the gap benchmark (``benchmarks/gaps``): the first trial of a set is left out, the model held by V_z is chosen on
gaps hidden in the others, and gaps of every kind are filled by that model alone with three seeds. Printed: the number
of distances, and by how many per cent they change the error (mean over kinds of gaps of its logarithm).

On the gaps hidden in training trials (by hand; the same model, bones of weight 0.25 / 1 / 4, per cent):

| set | two of a marker within 5 % | all within 5 % (0.25, 1) | of a skeleton |
|---|---|---|---|
| bat | -8.9 / -10.9 / -8.7 | | -0.1 / +0.4 / +1.7 (humerus and radius) |
| bat_wing | -13.5 / -17.2 / -18.4 | -13.7 | -1.7 / -3.1 / -4.5 (the same of one wing) |
| gait | -18.6 / -20.3 / -20.3 | -22.2 / -18.6 | -18.7 (0.3) / -20.9 / -23.1 (markers of a segment) |
| snake_gap | -3.2 / -3.4 / -3.1 | -2.6 / -1.4 | -1.5 (1; neighbours along the body) |
| twin_lizard | -2.4 / -3.7 / -1.4 | | -2.6 / -4.7 / -5.8 (its own) |

On the trial left out, skeletons' bones: bat_wing -2.1 (0.3) / -3.0 / -2.1, gait -13.0 (0.3) / -14.8 / -11.6, lizard
-4.3 (0.3) / -5.9 / -6.0. Many redundant pairs count one thing several times, and a weight over 1 does so in time: with
4 and linear forces gaps of all limbs for 100 frames of gait come out at 114 and 67 mm in place of 32 and 42. So each
marker has the bones that its skeleton names, and pairs up to two; the weight is 1, 0.25 or none.

A search that holds bones from the start finds other ranks, axes and forces, and these may fill worse without all limbs:
in the same gaps of gait the mixture then errs by 82 mm, by 34 where bones come last, and by 48 without.

As measurements after the mixture the same distances are no gain (``design/several.py``), also with lengths of the trial
itself: bat +2.2, bat_wing -1.4, gait +17.9, snake_gap +6.9, twin_lizard +0.7 % (all pairs within 5 %). Holding the
smoothed markers by the bones once more changes nothing (the arm of ``tests/filters/test_bones.py``).
"""

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.gaps.method import Filled, Filler, Trial
from benchmarks.gaps.ours import marker_trial
from benchmarks.gaps.protocol import cells, evaluate, shown_trials
from benchmarks.gaps.sets import load
from filters.bones import rigid_bones
from filters.fitting import Fitting
from filters.learn import PoseSettings
from filters.motion.bones import Bones
from filters.observations import PositionObservations
from filters.tune import Search, free_pose, held_pose, search_on

USUAL = ("bat", "bat_wing", "gait", "snake_gap", "twin_lizard")
CHOICES = {
    "none": (0.05, 2, (0.0,)),
    "two of a marker, within 5 %": (0.05, 2, (0.25, 1.0, 4.0, 16.0)),
    "two of a marker, within 10 %": (0.1, 2, (1.0,)),
    "all within 2 %": (0.02, 1000, (1.0,)),
    "all within 5 %": (0.05, 1000, (0.25, 1.0)),
}
"""Tolerance of ``rigid_bones``, most of a marker, weights of V_b (``PoseSettings.bones``)."""


def held_by(search: Search, pose: PoseSettings, tolerance: float, most: int) -> tuple[Filler, Bones]:
    """What the model says of a trial, held by so many distances; and those of the training trials."""

    def fill(trial: Trial) -> Filled:
        own = marker_trial(trial)
        fitting = Fitting([*search.trials, own], search.trunk)
        fitting.bones = rigid_bones(fitting.trials, tolerance=tolerance, most=most)
        found = fitting.fill(pose, PositionObservations(xyz_m=own.xyz_m, sd_m=own.sd_m))
        return Filled(found.xyz_m, found.cov_m2)

    return fill, rigid_bones(search.trials, tolerance=tolerance, most=most)


def main(names: Sequence[str]) -> None:
    """Print a line for each set and choice."""
    for name in names:
        trials = load(name)
        trunk = [trials[0].names.index(marker) for marker in trials[0].trunk]
        search = search_on([marker_trial(trial) for trial in trials[1:]], trunk, np.random.default_rng(0))
        pose = held_pose(search, free_pose(search))
        shown = [copy for seed in (0, 1, 2) for copy in shown_trials(trials[0], seed, cells())]
        first = None
        for label, (tolerance, most, weights) in CHOICES.items():
            for weight in weights:
                fill, bones = held_by(search, replace(pose, bones=weight), tolerance, most)
                logs = np.array([np.log(score.rmse_mm) for score in evaluate(fill, shown).scores])
                first = logs if first is None else first
                change = 100 * np.mean(logs - first)
                print(f"{name:12}{label:32}{len(bones.ends):4}  {weight:5g}  {change:+.1f} %", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or USUAL)
