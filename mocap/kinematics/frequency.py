"""The frequency of a recording: cycles between its first and last turning point, over the time between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from eal.arrays import Z95, Array
from mocap.kinematics.cycle_checks import turning_times
from mocap.kinematics.records import COUNTED, Cycle
from mocap.text import number_of

WANDER = 0.05
"""Scale of the half-Cauchy prior of how much one period differs from the next, as a share of the period: wing beats of
a bat in steady flight differ by 3 to 5 %, strides by 5 to 10 (the six shared flights; a lizard on a rod)."""
JITTER = 0.01
"""The same of what a turning point's time errs by beyond its stated deviation, or differs between two limbs."""
SHARES = np.array([0.0, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2])
"""Both as they are tried, shares of the period; each is weighed by its likelihood and its prior."""
MOST = 120
"""Turning points that are taken together; a longer recording is cut, and its parts are joined by their lengths."""


@dataclass(frozen=True, kw_only=True)
class Frequency:
    """The mean frequency of a recording's cycles.

    Attributes:
        kind: Of cycle.
        value_hz: Cycles over the time between the first and the last turning point that can be believed.
        sd_hz: Its standard deviation: how well the two ends are known. How much the cycles differ is ``spread_hz``.
        low_hz: Lower end of its 95 % interval.
        high_hz: Upper end.
        spread_hz: Standard deviation of the frequencies of single cycles; NaN of one.
        n_cycles: Cycles that are counted, of all limbs.
        n_doubtful: Those that are not.
    """

    kind: str
    value_hz: float
    sd_hz: float
    low_hz: float
    high_hz: float
    spread_hz: float
    n_cycles: int
    n_doubtful: int

    @property
    def number(self) -> str:
        """With half the width of its interval, two digits of it and the value as exactly, and its unit."""
        half = self.high_hz - self.value_hz
        digits = max(2, 1 - int(np.floor(np.log10(half)))) if np.isfinite(half) and half > 0 else 2
        return f"{self.value_hz:.{digits}f} ± {half:.{digits}f} Hz"

    @property
    def meaning(self) -> str:
        """What the number is of, and what was left out."""
        left = f", {self.n_doubtful} doubtful ones left out" if self.n_doubtful else ""
        spread = f", single cycles differ by SD {self.spread_hz:.2g} Hz" if np.isfinite(self.spread_hz) else ""
        counted = f"{number_of(self.n_cycles, 'cycle')}{left}"
        return f"mean {self.kind.replace('_', ' ')} frequency, 95 % interval ({counted}){spread}"


@dataclass(frozen=True)
class _Turns:
    """Turning points: ``time_s`` with ``sd_s``, the ``cycle`` of each, and its ``series`` (limb, upper or lower)."""

    time_s: Array
    sd_s: Array
    cycle: Array
    series: Array


def frequencies(rows: Sequence[Cycle]) -> list[Frequency]:
    """One for each kind of cycle of which any is counted."""
    found = (
        _frequency(kind, [row for row in rows if row.kind == kind]) for kind in dict.fromkeys(r.kind for r in rows)
    )
    return [one for one in found if one is not None]


def _frequency(kind: str, rows: Sequence[Cycle]) -> Frequency | None:
    """Of the phase of all limbs together: state-space model of the times s of turning points.

    Turning point j of cycle k (upper ones k = 0, 1, ...; lower ones k + 1/2) of series i (limb, upper or lower) is at

        s_j = a_i + P k + W(k) + v_j,    W(k) a random walk of variance q^2 a cycle,   v_j ~ N(0, sd_j^2 + r^2),

    with flat priors of a_i and P. W is of all limbs: they beat with one animal. Given all s, the time from the first to
    the last cycle has a normal distribution for each q and r, which are weighed by their restricted likelihood.
    """
    some = [row for row in rows if row.status == COUNTED]
    if not some:
        return None
    period = float(np.median([row.duration_s for row in some]))
    turns = _turns(some, period)
    order = np.argsort(turns.cycle, kind="stable")
    parts = np.array_split(order, max(1, int(np.ceil(len(order) / MOST))))
    count, time, variance = 0.0, 0.0, 0.0
    for part in parts:
        cycles, mean, var = _between_ends(
            _Turns(turns.time_s[part], turns.sd_s[part], turns.cycle[part], turns.series[part]), period
        )
        count, time, variance = count + cycles, time + mean, variance + var
    value, sd = count / time, float(count * np.sqrt(variance)) / time**2
    rates = np.array([row.frequency_hz for row in some])
    return Frequency(
        kind=kind,
        value_hz=value,
        sd_hz=sd,
        low_hz=value - Z95 * sd,
        high_hz=value + Z95 * sd,
        spread_hz=float(rates.std(ddof=1)) if len(rates) > 1 else np.nan,
        n_cycles=len(some),
        n_doubtful=len(rows) - len(some),
    )


def _turns(rows: Sequence[Cycle], period: float) -> _Turns:
    """The turning points of cycles, each once, with the cycle that it is of: the nearest whole (or half) number."""
    found: dict[tuple[str, str, float], float] = {}
    for row in rows:
        times = [time for _, time in turning_times(row)]
        sds = [row.start_sd_s, *([row.middle_sd_s] if len(times) == 3 else []), row.end_sd_s]
        for number, (time, sd) in enumerate(zip(times, sds, strict=True)):
            kind = "lower" if len(times) == 3 and number == 1 else "upper"
            found[row.of, kind, time] = sd if sd == sd else 0.0  # of waves none is known: all is jitter
    keys = sorted(found, key=lambda key: key[2])
    names = list(dict.fromkeys((of, kind) for of, kind, _ in keys))
    series = np.array([names.index((of, kind)) for of, kind, _ in keys])
    time, sd = np.array([key[2] for key in keys]), np.array([found[key] for key in keys])
    # whole cycles since the one before, within each series; each series where it fits the first one best
    cycle = np.empty(len(keys))
    for i, (_, kind) in enumerate(names):
        own = np.flatnonzero(series == i)
        whole = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(time[own]) / period))])
        half = 0.5 if kind == "lower" else 0.0
        done = np.flatnonzero(series < i)
        if len(done):
            at = np.interp(time[own], time[done], cycle[done])
            away = np.where(time[own] < time[done[0]], time[own] - time[done[0]], 0.0)
            away += np.where(time[own] > time[done[-1]], time[own] - time[done[-1]], 0.0)
            whole += np.rint(np.median(at + away / period - half - whole))
        cycle[own] = whole + half
    return _Turns(time, sd, cycle, series)


def _between_ends(turns: _Turns, period: float) -> tuple[float, float, float]:
    """Cycles from the first to the last, the time that they took, s, and its variance."""
    first, last = float(turns.cycle.min()), float(turns.cycle.max())
    k = turns.cycle - first
    design = np.column_stack([turns.series[:, None] == np.unique(turns.series), k]).astype(float)
    walk, own = np.minimum.outer(k, k), turns.sd_s**2
    ends = np.minimum(k, last - first)  # covariance of W(k) with W(last), over q^2
    weights, means, variances = [], [], []
    for q, r in product(period * SHARES, period * SHARES):
        cov = q**2 * walk + np.diag(own + r**2 + (1e-6 * period) ** 2)
        factor = cho_factor(cov, lower=True)
        solved = cho_solve(factor, design)
        information = design.T @ solved
        beta = np.linalg.solve(information, solved.T @ turns.time_s)
        left = turns.time_s - design @ beta
        power = left @ cho_solve(factor, left)
        log_det = 2 * np.log(np.diag(factor[0])).sum()
        weight = -0.5 * (power + log_det + np.linalg.slogdet(information)[1])
        weight -= np.log1p((q / (WANDER * period)) ** 2) + np.log1p((r / (JITTER * period)) ** 2)
        # P (last - first) + W(last), given the data
        gain = q**2 * cho_solve(factor, ends)
        asked = np.append(np.zeros(design.shape[1] - 1), last - first) - design.T @ gain
        mean = (last - first) * beta[-1] + gain @ left
        variance = q**2 * (last - first) - gain @ (q**2 * ends) + asked @ np.linalg.solve(information, asked)
        weights.append(weight)
        means.append(mean)
        variances.append(max(float(variance), 0.0))
    share = np.exp(np.array(weights) - max(weights))
    share /= share.sum()
    mean = float(share @ np.array(means))
    return last - first, mean, float(share @ (np.array(variances) + (np.array(means) - mean) ** 2))
