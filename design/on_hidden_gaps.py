"""Settings of the models that are mixed, judged on hidden gaps: ``python -m design.on_hidden_gaps [SET ...]``.

The first trial of a set (``benchmarks.gaps.sets``) is left out; gaps are hidden in the others as a search hides them
(``filters.tune.search_on``), and one setting is changed at a time. Printed: root mean square error in mm in gaps of
10 / 25 / 50 / 100 frames, the geometric mean, and the same where at most two markers are hidden.

Geometric means in mm on bat, bat_wing, gait and snake_gap:

| | all gaps | one or two markers |
|---|---|---|
| delayed poses from the body (900 rows, 300 own) | 6.44, 8.82, 14.1, 3.86 | 6.97, 5.63, 6.21, 3.37 |
| from the body and the neighbours (300 rows, 150 own) | 5.90, 8.13, 13.0, 3.75 | 6.40, 4.89, 4.57, 3.16 |

More rows changed nothing (500 and 200: 5.88, 8.23, 13.0, 3.80). On rigid segments (gait) the neighbours take a quarter
off; where a limb is hidden they alone are worse than the body alone, and the mean of both is the best or near it.

| mechanics: body | bat | bat_wing | gait | snake_gap | snake_glide |
|---|---|---|---|---|---|
| 1 | 6.61 | 8.48 | 18.9 | 4.58 | 57.6 |
| 0.3 | 6.67 | 8.07 | 18.3 | 4.10 | 43.1 |
| 0.1 | 6.81 | 8.02 | 18.0 | 3.86 | 34.3 |
| 0.01 | 7.21 | 8.23 | 18.4 | 3.63 | 34.7 |

So a search starts at 0.1 and tries 0.01 and 1. A recording alone keeps 1 (``recording_alone``).
"""

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from filters.hidden import Fill

from benchmarks.gaps.ours import marker_trial
from benchmarks.gaps.sets import load
from filters.delayed import DelaySettings
from filters.fitting import Kind
from filters.tune import SHARP, search_on

USUAL = ("bat", "bat_wing", "gait", "snake_gap", "snake_glide")
DELAYED = DelaySettings(ranks=(16,))
POSE = replace(SHARP, ranks=(8,), mechanics="linear", potential="none")
KINDS: dict[str, Kind] = {
    "delayed, both views": DELAYED,
    "from the body": replace(DELAYED, views=("body",)),
    "from the neighbours": replace(DELAYED, views=("neighbours",)),
    "axes do not turn": replace(DELAYED, turns=False),
    "900 rows, 300 own": replace(DELAYED, rows=900, own=300),
    "mechanics, body 0.1": POSE,
    "body 1": replace(POSE, body=1.0),
    "body 0.3": replace(POSE, body=0.3),
    "body 0.01": replace(POSE, body=0.01),
}


def errors(fill: Fill, *, most: float = np.inf) -> dict[int, float]:
    """Root mean square errors in mm by length of gaps that hide at most so many markers."""
    squared, size = np.sum(fill.miss_m**2, axis=1), np.empty(len(fill.gap))
    for gap in np.unique(fill.gap):
        here = fill.gap == gap
        size[here] = here.sum() / fill.length[here][0]
    few = size <= most
    lengths = np.unique(fill.length[few])
    return {int(n): 1e3 * float(np.sqrt(squared[few & (fill.length == n)].mean())) for n in lengths}


def main(names: Sequence[str]) -> None:
    """Print a table for each set."""
    for name in names:
        trials = load(name)
        trunk = [trials[0].names.index(marker) for marker in trials[0].trunk]
        search = search_on([marker_trial(trial) for trial in trials[1:]], trunk, np.random.default_rng(0))
        for label, kind in KINDS.items():
            fill = search.both(kind)
            everything, few = errors(fill), errors(fill, most=2.5)
            mean, single = (np.exp(np.mean(np.log(list(found.values())))) for found in (everything, few))
            cells = " / ".join(f"{value:.2f}" for value in everything.values())
            print(f"{name:12}{label:24}{cells}: {mean:.2f} mm; one or two markers {single:.2f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or USUAL)
