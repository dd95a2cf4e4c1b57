"""Fair timing on a shared machine: everything that is compared takes turns within one run, on one BLAS thread."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits


@dataclass(frozen=True, eq=False)
class Timing:
    """How long one call takes.

    Attributes:
        median_s: Median over the samples, in seconds.
        spread: Interquartile range over the median; 0 with one sample.
        n_samples: Number of samples.
    """

    median_s: float
    spread: float
    n_samples: int


def interleaved(
    calls: Mapping[str, Callable[[], object]], *, repeats: int = 7, budget_s: float = 5.0, sample_s: float = 2e-3
) -> dict[str, Timing]:
    """Time several calls in turn, so that a busy neighbour slows all of them.

    Each call is made once to warm up; that call is the only sample if it took more than ``budget_s``.

    Args:
        calls: What to time, by name.
        repeats: Number of rounds.
        budget_s: A call that has taken so long in all is left out of further rounds.
        sample_s: Calls shorter than this are repeated within a sample.

    Returns:
        The timing of each call, by name.
    """
    with threadpool_limits(1):
        first = {name: _seconds(call, 1) for name, call in calls.items()}
        loops = {name: max(1, int(np.ceil(sample_s / max(first[name], 1e-7)))) for name in calls}
        spent = dict(first)
        samples: dict[str, list[float]] = {name: [] for name in calls}
        for _ in range(repeats):
            for name, call in calls.items():
                if spent[name] < budget_s:
                    samples[name].append(_seconds(call, loops[name]))
                    spent[name] += samples[name][-1] * loops[name]
    return {name: _timing(samples[name] or [first[name]]) for name in calls}


def _seconds(call: Callable[[], object], loops: int) -> float:
    start = time.perf_counter()
    for _ in range(loops):
        call()
    return (time.perf_counter() - start) / loops


def _timing(samples: list[float]) -> Timing:
    low, median, high = np.quantile(samples, [0.25, 0.5, 0.75])
    return Timing(float(median), float((high - low) / median), len(samples))
