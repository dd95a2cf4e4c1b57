"""What several figures share: the general case of section 8.2, labels, and tables."""

import numpy as np

from eal.arrays import Array
from mocap.reproduce.draw import Curve, log_log
from mocap.reproduce.record import Figure, Verdict, long_table
from mocap.reproduce.sweep import Experiment, errors, over_lambda

N, DELTA_M, DURATION_S, LAMBDA = 400, 1e-3, 0.05, 1e-6
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


def error_table(axes: dict[str, Array], constraint: Array, state: Array, *, delta: float) -> dict[str, Array]:
    """Columns of errors over axes; T, lambda and N, where they are no axis, as in the general case."""
    columns = long_table(axes, constraint_error=constraint, state_error=state)
    fixed = {"T": DURATION_S, "lambda": LAMBDA, "N": float(N), "delta": delta}
    return columns | {name: np.full(constraint.size, value) for name, value in fixed.items() if name not in axes}


def against_penalty(
    name: str,
    over: str,
    values: Array,
    penalties: Array,
    errors: tuple[Array, Array],
    verdicts: tuple[Verdict, ...],
    *,
    delta: float = DELTA_M,
    y_label: str = CONSTRAINT,
) -> Figure:
    """A figure of errors against 1/eps^2, a curve for each lambda, N or T.

    Args:
        name: Number of the figure.
        over: ``lambda``, ``N`` or ``T``.
        values: Of it.
        penalties: 1/eps^2.
        errors: Constraint and state errors (value, penalty, seed).
        verdicts: On them.
        delta: Noise; 0: exact samples.
        y_label: Which constraint.
    """
    label = {"lambda": "λ = {:.0e}", "N": "N = {}", "T": "T = {:g} s"}[over]
    seeds = errors[0].shape[2]
    axes = {over: values, "penalty": penalties, "seed": np.arange(seeds)}
    curves = [Curve(label=label.format(one), x=penalties, y=y) for one, y in zip(values, errors[0], strict=True)]
    fixed = {"lambda": f", λ = {LAMBDA:g}", "N": f", N = {N}"}
    title = f"Fig. {name}: " + (f"noise {delta:g} m, {seeds} seeds" if delta else "exact samples")
    title += "".join(said for what, said in fixed.items() if what != over)
    return Figure(
        name=name,
        table=error_table(axes, *errors, delta=delta),
        verdicts=verdicts,
        draw=lambda canvas: log_log(canvas, curves, x_label=PENALTY, y_label=y_label, title=title),
    )
