"""What distances that markers keep add to a pose model, and how stiff they are: ``python -m design.bones [SET ...]``.

As in the gap benchmark (``benchmarks/gaps``): the first trial of a set is left out, the model held by V_z is chosen on
gaps hidden in the others, and gaps of every kind are filled by that model alone with three seeds. Printed: the number
of distances, and by how many per cent they change the error (mean over kinds of gaps of its logarithm).
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
