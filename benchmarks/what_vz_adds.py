"""What does V_z add to a tracker, and on what does it depend? ``python -m benchmarks.what_vz_adds [--seeds N]``.

A synthetic animal of ten markers, four of them a rigid trunk. The other six move with two angles a and b, which swing
at 3 to 5 and 1 to 2 Hz with wandering phases: along two directions, and by ``bend`` times (a^2, a b) along two others.
With bend 0 the set of shapes is a plane, which a Gaussian holds; with more it is curved. A second gait has other
directions and another mean: a Gaussian over both holds neither. Trials are of one gait each, the last of the first one;
gaps are hidden in it (``filters.hide``), and filled by the same pose model without a potential, with the quadratic
one of a Gaussian, and with V_z, both of shapes and velocities, with and without identified linear mechanics, at the
same stiffness.

Printed: root mean square error in mm (geometric mean over lengths of gaps and seeds), and V_z over the others.

| 4 seeds: V_z over the quadratic potential (range) | free mechanics | linear mechanics |
|---|---|---|
| one gait, bend 0 / 1 / 3, one trial | 1.01 / 1.04 / 1.22 (0.98-1.48) | 1.01 / 1.02 / 1.10 (1.00-1.28) |
| one gait, bend 0 / 1 / 3, four trials | 1.01 / 1.01 / 1.05 (1.00-1.11) | 1.01 / 1.01 / 1.03 (1.00-1.08) |
| two gaits, bend 0 / 1 / 3, one trial each | 1.06 / 0.97 / 0.92 (0.87-1.18) | 1.00 / 0.95 / 0.94 (0.92-1.00) |
| two gaits, bend 0 / 1 / 3, four trials each | 1.00 / 0.96 / 0.91 (0.82-1.01) | 0.99 / 0.94 / 0.90 (0.86-1.00) |

V_z adds what a Gaussian cannot hold: 3 to 10 % where two gaits are curved, nothing where they are flat. On one gait it
costs 1 to 5 %, and 10 to 22 % where a single trial shows a strongly curved one: what is seen of a curved set of few
dimensions in a linear subspace of eight tells the rest linearly, and a few cycles teach a Gaussian more surely. (With
the quadratic potential of shapes alone, half as stiff, the costs were 0 to 7 %.) The real sets of the gap benchmark are
one gait each, most of three to seven trials: there V_z and the quadratic potential differ by less than folds do.
"""

import argparse
from itertools import product

import numpy as np
from mocap.filters.anatomy import Anatomy
from mocap.filters.hide import hide_neighbours
from mocap.filters.models.base import TrialSet, estimate
from mocap.filters.models.pose import Mechanics, PoseSettings, Potential
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.score import Residuals, residuals_of

from eal.arrays import Array

FPS, FRAMES, NOISE_M = 200.0, 300, 2e-4
TRUNK = (0, 1, 2, 3)
POTENTIALS: tuple[Potential, ...] = ("none", "quadratic motion", "motion")
MECHANICS: tuple[Mechanics, ...] = ("free", "linear")


def wandering(rng: np.random.Generator, low_hz: float, high_hz: float) -> Array:
    """(T,) a swing of amplitude 1 whose frequency wanders between two."""
    rate = low_hz + (high_hz - low_hz) * (0.5 + 0.5 * np.sin(np.cumsum(rng.normal(0, 0.1, FRAMES))))
    return np.sin(2 * np.pi * (rng.random() + np.cumsum(rate) / FPS))


def trial(seed: int, *, bend: float, gait: int) -> MarkerTrial:
    """A trial of a gait: the same directions in all its trials."""
    animal, rng = np.random.default_rng(100 + gait), np.random.default_rng(seed)
    trunk = np.random.default_rng(99).normal(0, 0.03, (4, 3))
    mean, directions = animal.normal(0, 0.05, 18), np.linalg.qr(animal.normal(size=(18, 4)))[0].T
    a, b = wandering(rng, 3, 5), wandering(rng, 1, 2)
    shape = mean + 0.03 * np.column_stack([a, b, bend * a**2, bend * a * b]) @ directions
    xyz = np.concatenate([np.tile(trunk.ravel(), (FRAMES, 1)), shape], axis=1).reshape(FRAMES, 10, 3)
    xyz = xyz + rng.normal(0, NOISE_M, xyz.shape)
    sd = np.full(xyz.shape[:2], NOISE_M)
    return MarkerTrial(name=f"gait{gait}_{seed}", t_s=np.arange(FRAMES) / FPS, xyz_m=xyz, sd_m=sd)


def fills(seed: int, *, bend: float, gaits: int, trials: int) -> dict[tuple[Mechanics, Potential], Residuals]:
    """How each model fills gaps of a trial of the first gait, learned from so many others of each gait."""
    others = [trial(1000 * seed + i, bend=bend, gait=i % gaits) for i in range(1, trials * gaits + 1)]
    hidden = hide_neighbours(trial(1000 * seed, bend=bend, gait=0), np.random.default_rng(seed))
    shown = hidden.shown
    trial_set, out = TrialSet([*others, shown], Anatomy(tuple(TRUNK))), {}
    for mechanics, potential in product(MECHANICS, POTENTIALS):
        model = PoseSettings(
            ranks=(8,), rotating=False, mechanics=mechanics, potential=potential, bones=0.0, regression=0.0
        )
        found = estimate(model, trial_set, PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m))
        out[mechanics, potential] = residuals_of(hidden, found.xyz_m, found.cov_m2)
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    seeds = range(parser.parse_args().seeds)
    print(f"{'bend':>5}{'gaits':>6}{'trials':>7}  {'mechanics':10}{'none':>7}{'quadratic':>10}{'V_z':>7}", end="")
    print(f"{'V_z / none':>12}{'V_z / quadratic':>17}   (range over seeds)")
    for bend, gaits, trials in product((0.0, 1.0, 3.0), (1, 2), (1, 4)):
        found = [fills(seed, bend=bend, gaits=gaits, trials=trials) for seed in seeds]
        for mechanics in MECHANICS:
            logs = {p: np.array([f[mechanics, p].log_rmse for f in found]) for p in POTENTIALS}
            errors = "".join(
                f"{1e3 * np.exp(logs[p].mean()):{w}.2f}" for p, w in zip(POTENTIALS, (7, 10, 7), strict=True)
            )
            line = f"{bend:5.0f}{gaits:6}{trials:7}  {mechanics:10}{errors}"
            for beside, width in (("none", 12), ("quadratic motion", 17)):
                gain = logs["motion"] - logs[beside]
                line += f"{np.exp(gain.mean()):{width}.2f} ({np.exp(gain.min()):.2f}-{np.exp(gain.max()):.2f})"
            print(line, flush=True)


if __name__ == "__main__":
    main()
