"""Choosing hyper-parameters, and how wide intervals must be, on hidden gaps of training trials.

Models are wrong, so their intervals are. Every method that states intervals has them widened or narrowed by what was
seen in validation: in gaps of a length, the deviations are multiplied by the 95 % quantile of |error| / deviation over
1.96, drawn towards that of all lengths together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from benchmarks.gaps.method import Estimate, Filler, Trial
from benchmarks.gaps.peers.edges import BLENDS, Blend, gaps
from benchmarks.gaps.protocol import choose, validation
from eal.arrays import Array

Candidate = TypeVar("Candidate")


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A method whose deviations inside gaps are multiplied by a factor.

    Attributes:
        filler: The method.
        lengths: (L,) lengths of gaps, increasing.
        factors: (L,) factors there; in between they are interpolated over the logarithm of the length.
    """

    filler: Filler
    lengths: Array
    factors: Array

    def __call__(self, trial: Trial) -> Estimate:
        """Fill, then scale the covariances of what is missing."""
        filled = self.filler(trial)
        if filled.cov_m2 is None:
            return filled
        cov = np.array(filled.cov_m2)
        for gap in gaps(np.isfinite(trial.xyz_m[..., 0])):
            factor = np.interp(np.log(gap.stop - gap.start), np.log(self.lengths), self.factors)
            cov[gap.start : gap.stop, gap.marker] *= factor**2
        return Estimate(filled.xyz_m, cov)


def tune(
    candidates: Sequence[Candidate],
    training: Sequence[Trial],
    learn: Callable[[Candidate, Sequence[Trial]], Filler],
) -> Filler:
    """Learn with the best candidate (``protocol.choose``), and calibrate its intervals on the same validation."""
    best = choose(candidates, training, learn) if len(candidates) > 1 else candidates[0]
    filler = learn(best, training)
    found: dict[int, list[Array]] = {}
    for fold in validation(training):
        trained = learn(best, fold.rest)
        for copy in fold.shown:
            filled = trained(copy.shown)
            if filled.cov_m2 is None:
                return filler
            for gap in copy.gaps:
                error = (filled.xyz_m - copy.trial.xyz_m)[gap.frames][:, gap.scored]
                cov = filled.cov_m2[gap.frames][:, gap.scored]
                sd = np.sqrt(np.maximum(np.diagonal(cov, axis1=-2, axis2=-1), 1e-18))
                found.setdefault(gap.length, []).append((np.abs(error) / sd).ravel())
    if not found:
        return filler
    every = _factor([part for parts in found.values() for part in parts])
    lengths = sorted(found)
    factors = [np.sqrt(_factor(found[length]) * every) for length in lengths]
    return Calibrated(filler, np.array(lengths, dtype=float), np.array(factors))


def tune_blended(
    candidates: Sequence[Candidate],
    training: Sequence[Trial],
    learn: Callable[[Candidate, Blend, Sequence[Trial]], Filler],
) -> Filler:
    """``tune`` of a pose model in two rounds: the model with the usual blend, then the blend."""
    best = candidates[0]
    if len(candidates) > 1:
        best = choose(candidates, training, lambda candidate, trials: learn(candidate, Blend(), trials))
    return tune(BLENDS, training, lambda blend, trials: learn(best, blend, trials))


def _factor(parts: Sequence[Array]) -> float:
    return float(np.clip(np.quantile(np.concatenate(parts), 0.95) / 1.959964, 0.2, 20.0))
