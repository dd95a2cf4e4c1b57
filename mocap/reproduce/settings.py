"""What several figures share: the general case of section 8.2, labels, and tables."""

import numpy as np

from eal.arrays import Array
from mocap.reproduce.record import long_table
from mocap.reproduce.sweep import Experiment, errors, over_lambda

N, DELTA_M, DURATION_S = 400, 1e-3, 0.05
PENALTY = "penalty factor 1/ε² (J)"
CONSTRAINT = "sup |r − 1| (m)"
SPHERE = "sup ||x| − 1| (m)"


def noisy_errors(experiment: Experiment, lams: Array, penalties: Array, seeds: int) -> tuple[Array, Array]:
    """Constraint and state errors (lambda, penalty, seed) of noisy samples."""
    found = []
    for seed in range(seeds):
        z = experiment.samples(N, delta=DELTA_M, rng=np.random.default_rng(seed))
        found.append([e[0] for e in errors(experiment, over_lambda(z, experiment.kernel, lams), penalties)])
    constraint, state = np.moveaxis(np.array(found), 1, 0)
    return np.moveaxis(constraint, 0, -1), np.moveaxis(state, 0, -1)


def table_over_lambda(
    lams: Array, penalties: Array, constraint: Array, state: Array, *, delta: float
) -> dict[str, Array]:
    """Columns of errors (lambda, penalty, seed) with T, N and delta."""
    axes = {"lambda": lams, "penalty": penalties, "seed": np.arange(constraint.shape[2])}
    columns = long_table(axes, constraint_error=constraint, state_error=state)
    rows = len(columns["lambda"])
    fixed = {"T": DURATION_S, "N": float(N), "delta": delta}
    return columns | {name: np.full(rows, value) for name, value in fixed.items()}
