"""By how much the numbers of a table differ at least."""

import numpy as np

from eal.arrays import Array


def rounding(values: Array) -> float:
    """The smallest difference between two numbers of a table: 1 of whole numbers, next to nothing of others.

    0 where it is more than a hundredth of their range: of few numbers it tells nothing.
    """
    finite = values[np.isfinite(values)]
    steps = np.diff(np.unique(finite[:: max(1, len(finite) // 100_000)]))
    return float(steps.min()) if len(steps) and 100 * steps.min() < steps.sum() else 0.0
