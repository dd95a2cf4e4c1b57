"""Figures 15a and 15b: the error against 1/eps^2 for several N."""

import numpy as np

from eal import EmpiricalPotential
from eal.arrays import Array
from mocap.reproduce.record import Figure, judged
from mocap.reproduce.settings import DELTA_M, LAMBDA, against_penalty
from mocap.reproduce.sweep import errors, over_lambda, planar, slope, slope_with_error

_EXACT = "When exact, noise-free measurements are assumed, the error curves of all cases overlap with each other."
_NOISY = "As predicted in Eq. 9, the limiting error bound is smaller in the cases with more samples."


def figure_15a(*, quick: bool) -> Figure:
    """Exact samples: N does not matter once the curve is covered."""
    experiment, counts = planar(), np.array([50, 100, 200, 400, 800])
    penalties = np.logspace(2, 6, 9 if quick else 17)
    lam = np.array([LAMBDA])
    potentials = [over_lambda(experiment.samples(int(n)), experiment.kernel, lam)[0] for n in counts]
    constraint, state = (e[0] for e in errors(experiment, potentials, penalties))
    noisy = [over_lambda(experiment.samples(int(n), delta=DELTA_M), experiment.kernel, lam)[0] for n in counts[[0, -1]]]
    spread, wrong = (
        float((error.max(axis=0) / error.min(axis=0)).max() - 1)
        for error in (constraint, errors(experiment, noisy, penalties[-1:])[0][0])
    )
    verdict = judged(
        "15a",
        _EXACT,
        "the curves for N = 50 .. 800 agree within 2 %",
        f"{100 * spread:.2g} %",
        lambda share: share < 0.02,
        spread,
        control="noisy samples",
        faulty=wrong,
    )
    exact = constraint[:, :, None], state[:, :, None]
    return against_penalty("15a", "N", counts, penalties, exact, (verdict,), delta=0.0)


def figure_15b(*, quick: bool) -> Figure:
    """Noisy samples at independent times: plateaus and the offset of the valley fall with N."""
    experiment = planar()
    counts = np.array([100, 400, 1600] if quick else [50, 100, 200, 400, 800, 1600])
    penalties, seeds = np.logspace(2, 6, 5 if quick else 9), 6 if quick else 8
    potentials = [
        over_lambda(
            experiment.samples(int(n), delta=DELTA_M, rng=np.random.default_rng([seed, n]), independent=True),
            experiment.kernel,
            np.array([LAMBDA]),
        )[0]
        for n in counts
        for seed in range(seeds)
    ]
    shape = (len(counts), seeds, len(penalties))
    constraint, state = (e[0].reshape(shape).swapaxes(1, 2) for e in errors(experiment, potentials, penalties))
    on_set = experiment.samples(200)
    offsets = np.array([valley_offset(p, on_set) for p in potentials]).reshape(shape[:2])
    plateaus = np.median(constraint[:, -1], axis=1)
    offset = np.median(offsets, axis=1)
    fall, doubt = slope_with_error(np.repeat(counts, seeds).astype(float), constraint[:, -1].reshape(-1))
    rate = slope(counts[counts >= 100].astype(float), offset[counts >= 100])
    verdicts = (
        judged(
            "15b",
            _NOISY,
            "the plateau falls with N: its slope over all draws is below 0 by two standard errors",
            f"{fall:.2f} +- {doubt:.2f}, medians " + ", ".join(f"{p:.2g}" for p in plateaus) + " m",
            lambda line: line[0] < -2.0 * line[1],
            (fall, doubt),
            control="N in the wrong order",
            faulty=(-fall, doubt),
        ),
        judged(
            "15b",
            _NOISY,
            "the valley of V is off the set as N^-1/2 (slope -0.6 to -0.4)",
            f"{rate:.2f}, from {offset[0]:.2g} to {offset[-1]:.2g} m",
            lambda slope: -0.6 <= slope <= -0.4,
            rate,
            control="an offset that falls as 1/N, as its square does",
            faulty=slope(counts[counts >= 100].astype(float), offset[counts >= 100] ** 2),
        ),
    )
    return against_penalty("15b", "N", counts, penalties, (constraint, state), verdicts)


def valley_offset(potential: EmpiricalPotential, on_set: Array) -> float:
    """Root mean square of r - 1 where V is least across the set: one Newton step in r from r = 1."""
    step = potential.gradient(on_set)[:, 0] / potential.hessian(on_set)[:, 0, 0]
    return float(np.sqrt(np.mean(step**2)))
