"""How should models be mixed? ``python -m benchmarks.mixture --out DIR [--whole] [--sets ...] [--folds N]``.

Gaps of the gap benchmark are filled by each model of the mixture, once; ways of mixing them are then compared in
seconds. Its ``--quick`` extent (two excerpts of 160 frames to learn from) tells how a mixture learns from little; with
``--whole`` all trials are learned whole, as users do it. What is stored of a fold in ``DIR``: what each model missed
the gaps by that were hidden in training trials and in the recording itself, and what it says in the gaps that are
judged. A run that was broken off goes on where it was.

Printed: the error of each way over that of the product, %, mean and standard error over sets, by cameras left and
length of gap; the share of coordinates inside 95 % intervals; the negative log likelihood of a coordinate. ``mix.csv``
has them by set. Then mixtures without each of the models (``fewer_models``), and what it would be worth to learn
weights and widths in gaps that keep a ray (``by_rays``). Errors that last, which the product adds to its covariances,
are not in these: where rays are left, more is inside the product's own intervals.
"""

import argparse
import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from mocap.filters.anatomy import anatomy_of
from mocap.filters.hidden_gaps import MODELS, hidden_gaps, own_gaps
from mocap.filters.hide import gap_lengths
from mocap.filters.mixture import Mixture, learn_mixture
from mocap.filters.model import members, models_of, trials_for
from mocap.filters.score import Residuals, score
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.gaps.cells import QUICK, QUICK_PLAN, Extent, fold_trials
from benchmarks.gaps.hide import cells
from benchmarks.gaps.ours import effort
from benchmarks.gaps.prepared import LEAST_SD_M, recording
from benchmarks.gaps.protocol import FULL, plan, shown_trials
from benchmarks.gaps.sets import FILMED, SETS, size
from eal.arrays import Array
from mocap.errors import MocapError
from mocap.pipeline.learning import learn_from
from mocap.pipeline.tracking import marker_trial, part_names, seen_part

WHOLE = Extent(lengths=(10, 25, 50))
Way = Callable[[Sequence[Residuals], Sequence[Residuals] | None], Mixture]
"""From what models missed in training trials and in the recording itself (None: nothing could be hidden) a mixture."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """What K models say of the n samples of a gap.

    Attributes:
        seed: Of the draw.
        rays: Cameras that are left.
        frames: Length.
        error_m: (K, n, 3) what they miss measurements by.
        cov_m2: (K, n, 3, 3) what they state.
        length: (n,) frames that each sample's marker is not seen.
        noise_m: (n,) deviation of the measurements.
        own: What they missed gaps by that were hidden in the recording itself; None: there were none.
    """

    seed: int
    rays: int
    frames: int
    error_m: Array
    cov_m2: Array
    length: NDArray[np.int64]
    noise_m: Array
    own: tuple[Residuals, ...] | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Fold:
    """A trial left out.

    Attributes:
        learned: What models missed gaps in training trials by.
        gaps: Gaps in it.
    """

    learned: tuple[Residuals, ...]
    gaps: tuple[Gap, ...]


def filled(name: str, left_out: int, extent: Extent) -> Fold:
    """Learn from the other trials and fill the gaps of one."""
    trials = fold_trials(name, left_out, extent)
    learned = learn_from([recording(trial) for trial in trials[:-1]], effort=effort(), models=MODELS)
    anatomy = anatomy_of(learned.names, learned.trunk, learned.bones)
    hidden = hidden_gaps(learned.trials, anatomy, np.random.default_rng(0), effort=effort())
    gaps: list[Gap] = []
    wanted = cells(scenarios=extent.scenarios, lengths=extent.lengths)
    for seed in extent.seeds:
        rays = (0, 1) if name in FILMED else (0,)
        for copy in shown_trials(trials[-1], seed, wanted, frames=extent.frames, rays=rays, once=extent.once):
            prepared = recording(copy.shown)
            part = seen_part(prepared)
            names, own_trial = part_names(prepared, part), marker_trial(prepared, part)
            every = trials_for(learned, names, own_trial)
            own = own_gaps(every)
            seen = prepared.observations(part.frames, part.markers)
            found = members(models_of(learned, every), every, seen).found
            missed = own.fill(learned.models) if own.hidden else None
            truth = copy.trial.xyz_m[part.frames][:, part.markers]
            noise = np.broadcast_to(np.maximum(trials[-1].sd_m, LEAST_SD_M)[part.markers], truth.shape[:2])
            length = gap_lengths(own_trial.seen)
            for gap in copy.gaps:
                inside, start = np.zeros(truth.shape[:2], dtype=bool), gap.start - part.frames.start
                inside[max(0, start) : start + gap.length] = gap.scored[part.markers]
                gaps.append(
                    Gap(
                        seed=seed,
                        rays=copy.rays,
                        frames=gap.length,
                        error_m=np.stack([one.xyz_m[inside] - truth[inside] for one in found]),
                        cov_m2=np.stack([one.cov_m2[inside] for one in found]),
                        length=length[inside],
                        noise_m=noise[inside],
                        own=missed,
                    )
                )
    return Fold(learned=hidden.fill(learned.models), gaps=tuple(gaps))


def product(
    learned: Sequence[Residuals], own: Sequence[Residuals] | None, *, strength: float = 0.1, power: float = 1.0
) -> Mixture:
    """As the product mixes."""
    mixture = learn_mixture(learned, strength=strength, power=power)
    return mixture if own is None else mixture.calibrated(own)


def unused(learned: Sequence[Residuals], _own: Sequence[Residuals] | None) -> Mixture:
    """Own gaps tell nothing."""
    return learn_mixture(learned)


def widths(learned: Sequence[Residuals], own: Sequence[Residuals] | None) -> Mixture:
    """Own gaps tell how wide intervals are, not how models are weighed."""
    mixture = learn_mixture(learned)
    return mixture if own is None else mixture.calibrated(own, own=np.inf)


def doubted(learned: Sequence[Residuals], own: Sequence[Residuals] | None) -> Mixture:
    """A model that fills own gaps badly is believed less, one that fills them well no more than before."""
    mixture = learn_mixture(learned)
    if own is None:
        return mixture
    found = mixture.calibrated(own)
    return replace(found, scale=np.maximum(found.scale, mixture.scale))


def ways() -> dict[str, Way]:
    """Ways of mixing; the first is the product's."""
    return {
        "product": product,
        "own gaps unused": unused,
        "own gaps: widths": widths,
        "own gaps: doubt": doubted,
        "penalty 0.03": partial(product, strength=0.03),
        "penalty 1": partial(product, strength=1.0),
        "power 0.5": partial(product, power=0.5),
        "power 1.5": partial(product, power=1.5),
    }


def judged(fold: Fold, way: Way) -> list[dict[str, float]]:
    """A row for each seed, number of rays and length of gap."""
    parts: dict[tuple[int, int, int], list[tuple[Array, Array]]] = {}
    for gap in fold.gaps:
        mixture = way(fold.learned, gap.own)
        mean, cov = mixture.combine(list(gap.error_m[:, :, None]), list(gap.cov_m2[:, :, None]), gap.length[:, None])
        cov = cov[:, 0] + (gap.noise_m**2)[:, None, None] * np.eye(3)
        parts.setdefault((gap.seed, gap.rays, gap.frames), []).append((mean[:, 0], cov))
    rows = []
    for (seed, rays, frames), found in parts.items():
        one = score(np.concatenate([mean for mean, _ in found]), np.concatenate([cov for _, cov in found]))
        place = {"seed": seed, "rays": rays, "frames": frames}
        rows.append(place | {"log_mm": np.log(one.rmse_mm), "inside": 100 * one.coverage95, "nll": one.nll})
    return rows


def by_rays(folds: dict[tuple[str, int], Fold]) -> pd.DataFrame:
    """Gaps with one camera left, mixed by what gaps of the set's other judged trials show: dark, or with one ray."""
    tables = []
    for (name, left_out), fold in folds.items():
        others = [gap for (n, i), one in folds.items() if n == name and i != left_out for gap in one.gaps]
        if not any(gap.rays for gap in others):
            continue
        for way, rays in {"learned in the dark": (0,), "with one ray": (1,), "in both": (0, 1)}.items():
            mixture = learn_mixture(residuals([gap for gap in others if gap.rays in rays]))
            rows = judged(replace(fold, gaps=tuple(gap for gap in fold.gaps if gap.rays)), lambda *_, m=mixture: m)
            tables.append(pd.DataFrame(rows).assign(set=name, way=way))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def fewer_models(folds: dict[tuple[str, int], Fold]) -> pd.DataFrame:
    """The mixture of all models, and of all but one."""
    every = list(range(len(MODELS)))
    kinds = {"all": every, **{f"no {type(MODELS[k]).__name__}": [i for i in every if i != k] for k in every}}
    tables = [
        pd.DataFrame(judged(some_models(fold, kept), product)).assign(set=name, way=kind)
        for kind, kept in kinds.items()
        for (name, _), fold in folds.items()
    ]
    return pd.concat(tables, ignore_index=True)


def some_models(fold: Fold, which: Sequence[int]) -> Fold:
    """A fold as some of its models would have left it."""
    gaps = [
        replace(
            gap,
            error_m=gap.error_m[which],
            cov_m2=gap.cov_m2[which],
            own=None if gap.own is None else tuple(gap.own[k] for k in which),
        )
        for gap in fold.gaps
    ]
    return Fold(learned=tuple(fold.learned[k] for k in which), gaps=tuple(gaps))


def residuals(gaps: Sequence[Gap]) -> tuple[Residuals, ...]:
    """What each model missed the samples of gaps by."""
    return tuple(
        Residuals(
            error_m=np.concatenate([gap.error_m[k] for gap in gaps]),
            variance=np.concatenate([np.diagonal(gap.cov_m2[k], axis1=-2, axis2=-1) for gap in gaps]),
            noise=np.concatenate([gap.noise_m**2 for gap in gaps]),
            gap=np.repeat(np.arange(len(gaps)), [len(gap.length) for gap in gaps]),
            length=np.repeat([gap.frames for gap in gaps], [len(gap.length) for gap in gaps]),
        )
        for k in range(len(MODELS))
    )


def main() -> int:
    """Collect, compare, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mixture", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--whole", action="store_true", help="learn whole trials, as users do")
    parser.add_argument("--folds", type=int, default=2, help="trials of each set that are left out, at most")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    plan.set(FULL if args.whole else QUICK_PLAN)
    extent = replace(WHOLE if args.whole else QUICK, seeds=tuple(range(args.seeds)), folds=args.folds)
    folds: dict[tuple[str, int], Fold] = {}
    for name in args.sets:
        for left_out in range(min(args.folds, size(name))):
            file = args.out / f"{name}_{left_out}_{args.seeds}_{'whole' if args.whole else 'quick'}.pickle"
            if not file.exists():
                try:
                    with threadpool_limits(1):
                        fold = filled(name, left_out, extent)
                except MocapError as error:
                    print(f"{name}, trial {left_out}: {error}", file=sys.stderr)
                    continue
                file.write_bytes(pickle.dumps(fold))
                print(f"{name}, trial {left_out}: {len(fold.gaps)} gaps", file=sys.stderr)
            folds[name, left_out] = pickle.loads(file.read_bytes())
    if not folds:
        print("no set could be loaded: set MOCAP_REAL_DATA to the folder of the recordings", file=sys.stderr)
        return 1
    tables = [
        pd.DataFrame(judged(fold, mix)).assign(set=name, way=way)
        for (name, _), fold in folds.items()
        for way, mix in ways().items()
    ]
    by_set = shown(pd.concat(tables, ignore_index=True))
    by_set.assign(rmse_mm=np.exp(by_set["log_mm"])).drop(columns="log_mm").to_csv(args.out / "mix.csv")
    print("\n# What each model adds\n")
    shown(fewer_models(folds))
    left = by_rays(folds)
    if len(left):
        print("\n# One camera left: where should weights and widths be learned?\n")
        shown(left)
    return 0


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Print ways beside the first; means by set."""
    place, known = ["set", "rays", "frames"], list(dict.fromkeys(table["way"]))
    by_set = table.pivot_table(index=[*place, "way"], values=["log_mm", "inside", "nll"], sort=False)
    error = table.pivot_table(index=place, columns="way", values="log_mm", sort=False)[known]
    over = error.sub(error[known[0]], axis=0).apply(np.expm1) * 100
    means = over.groupby(["rays", "frames"]).agg(["mean", "sem"]).round(1).transpose()
    print(f"error over {known[0]}, %:\n{over.round(1).to_string()}\n\nmean over sets:\n{means.to_string()}")
    for what in ("inside", "nll"):
        means = by_set.pivot_table(index=["rays", "frames"], columns="way", values=what)[known]
        print(f"\n{what}:\n{means.round(2).transpose().to_string()}")
    return by_set


if __name__ == "__main__":
    raise SystemExit(main())
