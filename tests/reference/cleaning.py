"""Cleaning by trying everything. Slow on purpose."""

from itertools import combinations, pairwise

import numpy as np


def fewest_jumps(x, t, *, max_speed, slack):
    """The size of the smallest set of samples without which each step between neighbours left is slow enough."""
    n = len(x)
    for size in range(n):
        for left_out in combinations(range(n), size):
            kept = [i for i in range(n) if i not in left_out]
            steps = pairwise(kept)
            if all(np.linalg.norm(x[j] - x[i]) <= max_speed * (t[j] - t[i]) + slack for i, j in steps):
                return size
    return n
