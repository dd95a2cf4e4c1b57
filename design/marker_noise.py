"""What noise constant velocity of single markers should have: ``python -m design.marker_noise [SET ...]``.

As in the gap benchmark (``benchmarks/gaps``): a trial of a set is left out, gaps of every kind are hidden in it with
five seeds. Printed for each way to know the process noise of a marker, and each factor on it: the mean over kinds of
gaps of the logarithm of the error against ``own`` with the factor 0.3.

| way | density of each marker's acceleration |
|---|---|
| own | ``marker_density`` of the recording itself |
| all | the geometric mean of ``marker_density`` of all recordings, the one to be filled among them |
| likelihood | that of largest marginal likelihood in the others (``benchmarks.gaps.peers.kalman``) |
| flat | the geometric mean of ``own`` over markers, for each |

Mean over both trials of six sets (USUAL), per cent; "chosen" is the best factor of each trial, which a search on hidden
gaps comes near:

| way | 1 | 0.3 | 0.1 | 0.03 | 0.01 | chosen |
|---|---|---|---|---|---|---|
| own | +1.9 | 0 | -0.5 | +0.6 | +3.4 | -2.4 |
| all | +1.9 | -0.4 | -1.5 | -0.7 | +2.1 | -2.8 |
| likelihood | +3.2 | +1.0 | 0.0 | +1.0 | +4.4 | -2.1 |
| flat | +2.4 | +2.1 | +3.4 | +7.1 | +13.3 | -1.3 |

``all`` is within 1 % of the best way in nine of twelve trials, within 1.4 % in all, and on ``snake_gap``, where a piece
of 180 frames shows some markers at rest, 2.5 and 0.6 % better than ``own``. The factor matters more: the snakes want
0.01 to 0.03 (``snake_glide`` -10 and -8 % against 0.3), the lizard twin 1.
"""

import sys
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.gaps.method import Filled, Trial
from benchmarks.gaps.peers.coordinates import World
from benchmarks.gaps.peers.kalman import KalmanFiller, likeliest_density
from benchmarks.gaps.protocol import cells, evaluate, shown_trials
from benchmarks.gaps.sets import load
from filters.learn_markers import marker_density
from mocap.arrays import Array

USUAL = ("bat", "bat_wing", "gait", "snake_gap", "snake_glide", "twin_lizard")
FACTORS = (0.3, 0.1, 0.03, 0.01, 1.0)


def main(names: Sequence[str]) -> None:
    """Print a line for each set, trial left out and way."""
    for name in names:
        trials = load(name)
        dt_s = float(np.median(np.diff(trials[0].t_s)))
        for left_out in (0, 1):
            training = [trial for i, trial in enumerate(trials) if i != left_out]
            shown = [copy for seed in range(5) for copy in shown_trials(trials[left_out], seed, cells())]
            first = None
            for way, density in ways(training, dt_s).items():
                found = [errors(shown, density, factor) for factor in FACTORS]
                first = found[0] if first is None else first
                line = "  ".join(
                    f"{f:g}: {100 * (e - first).mean():+5.1f}" for f, e in zip(FACTORS, found, strict=True)
                )
                print(f"{name:12s} {left_out}  {way:10s} {line} %", flush=True)


def ways(training: Sequence[Trial], dt_s: float) -> dict[str, Callable[[Trial], Array]]:
    """Densities (M,) in m^2 per frame^3 for a trial."""

    def own(trial: Trial) -> Array:
        found = dt_s**3 * marker_density(trial.xyz_m, dt_s=dt_s)
        return np.where(np.isfinite(found), found, np.nanmedian(found))

    others = [np.log(own(trial)) for trial in training]
    likeliest = likeliest_density([trial.xyz_m for trial in training], training[0].sd_m, 2)
    return {
        "own": own,
        "all": lambda trial: np.exp(np.mean([*others, np.log(own(trial))], axis=0)),
        "likelihood": lambda _trial: likeliest,
        "flat": lambda trial: np.full(len(trial.names), np.exp(np.log(own(trial)).mean())),
    }


def errors(shown: Sequence, density: Callable[[Trial], Array], factor: float) -> Array:
    """Logarithms of the errors in all kinds of gaps."""

    def fill(trial: Trial) -> Filled:
        return KalmanFiller(World(), 2, factor * density(trial))(trial)

    return np.log([score.rmse_mm for score in evaluate(fill, shown).scores])


if __name__ == "__main__":
    main(sys.argv[1:] or USUAL)
