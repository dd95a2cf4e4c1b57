"""Whether V_z should count only beyond what the mechanics say already: ``python -m design.net_potential [SET ...]``.

Linear mechanics identified from trials have these trials' covariance when nothing is seen. V_z was learned from the
same poses: what it tells a state as wide as the recordings (``PoseMotion.usual``) is known. In long gaps of all limbs
such a state is narrowed step by step, its phase as well, and is sure of a wrong one. Here V_z counts less its own
quadratic part about the recordings,

    V_net(x) = V_z(x) - g0 (x - m0) - (x - m0) H0 (x - m0) / 2,

g0 and H0 statistically linearised under the recorded mean m0 and covariance, so that a state of that covariance learns
nothing. ``width``: the mean moves as V_z has it, the covariance as V_net has it; ``both``: both by V_net.

As in the gap benchmark the first trial of a set is left out and gaps of every kind are filled by the model held by V_z
alone, with three seeds. Printed: the mean over kinds of gaps of the change of the logarithm of the error in per cent,
of all limbs for 100 frames the error in mm, and the share inside 95 % intervals as the model itself states them.

| set | V_z | width | both |
|---|---|---|---|
| bat_wing | 90 % inside | +1.3 %, 90 % | +15.9 %, 84 % |
| gait | all 100 35.1 mm, 69 % | +8.1 %, 127.7 mm, 64 % | +19.1 %, 90.9 mm, 59 % |

It is no gain: what V_z says of a wide state holds the mean, too, and a wider state is not one that knows its phase
better. Which phase a gap of all limbs comes out at turns with small changes of the model.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from benchmarks.gaps.method import Filled, Filler, Trial
from benchmarks.gaps.ours import marker_trial
from benchmarks.gaps.protocol import cells, evaluate, shown_trials
from benchmarks.gaps.sets import load
from filters.ensemble import Gaussian, default_points, scale, spread
from filters.fitting import Fitting
from filters.learn import PoseSettings
from filters.motion.pose import PoseMotion
from filters.observations import PositionObservations
from filters.track import smooth
from filters.tune import Search, free_pose, held_pose, search_on

USUAL = ("bat", "bat_wing", "gait", "snake_gap", "twin_lizard")


def beyond(model: PoseMotion) -> PoseMotion:
    """The model held by V_net; see the module."""
    k, pull, usual = model.held, model.gradient, model.usual
    assert pull is not None
    assert usual is not None
    factor = np.linalg.cholesky((usual.factor @ usual.factor.T)[:k, :k])
    points = spread(Gaussian(usual.mean[:k], factor), scale(default_points(k))[0])
    design = np.column_stack([np.ones(len(points)), points - points[0]])
    known, *_ = np.linalg.lstsq(design, pull(points), rcond=None)
    slope = 0.5 * (known[1:] + known[1:].T)
    return replace(model, gradient=lambda x: pull(x) - known[0] - (x - points[0]) @ slope)


@dataclass(frozen=True, eq=False, kw_only=True)
class Wide(PoseMotion):
    """A pose model whose mean moves by its own potential, and whose covariance shrinks by that of another."""

    other: PoseMotion | None = None

    def constrain(self, state: Gaussian, dt_s: float) -> Gaussian:
        """Hold the shape."""
        assert self.other is not None
        return Gaussian(super().constrain(state, dt_s).mean, self.other.constrain(state, dt_s).factor)


def filler(search: Search, kind: PoseSettings, version: str) -> Filler:
    """What the model says of a trial."""

    def fill(trial: Trial) -> Filled:
        own = marker_trial(trial)
        model = Fitting([*search.trials, own], search.trunk).pose(kind)
        if version == "width":
            parts = {f.name: getattr(model, f.name) for f in fields(PoseMotion) if f.init}
            model = Wide(**parts, other=beyond(model))
        if version == "both":
            model = beyond(model)
        found = smooth(model, PositionObservations(xyz_m=own.xyz_m, sd_m=own.sd_m), own.t_s)
        return Filled(found.xyz_m, found.cov_m2 + (own.sd_m**2)[..., None, None] * np.eye(3))

    return fill


def main(names: Sequence[str]) -> None:
    """Print a line for each set and version."""
    for name in names:
        trials = load(name)
        trunk = [trials[0].names.index(marker) for marker in trials[0].trunk]
        search = search_on([marker_trial(trial) for trial in trials[1:]], trunk, np.random.default_rng(0))
        kind = held_pose(search, free_pose(search))
        shown = [copy for seed in (0, 1, 2) for copy in shown_trials(trials[0], seed, cells())]
        first = None
        for version in ("V_z", "width", "both"):
            scores = evaluate(filler(search, kind, version), shown).scores
            logs = np.array([np.log(score.rmse_mm) for score in scores])
            first = logs if first is None else first
            longest = [score.rmse_mm for score in scores if (score.scenario, score.gap) == ("all", 100)]
            inside = np.average([score.coverage95 for score in scores], weights=[score.samples for score in scores])
            print(
                f"{name:12}{kind.mechanics:8}{version:8}{100 * np.mean(logs - first):+.1f} %, all 100 "
                f"{'-' if not longest else f'{np.exp(np.mean(np.log(longest))):.1f} mm'}, {100 * inside:.0f} % inside",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:] or USUAL)
