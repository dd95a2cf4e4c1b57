"""Figures 11 and 19c, the error against lambda, the V of bias and variance; 15a and 15b, for several N."""

import numpy as np

from eal.arrays import Array
from eal.potential import EmpiricalPotential
from mocap.reproduce.draw import Curve, log_log
from mocap.reproduce.record import Figure, Verdict, judged
from mocap.reproduce.sweep import (
    CONSTRAINT,
    DELTA_M,
    LAMBDA,
    SPHERE,
    Experiment,
    against_penalty,
    error_table,
    errors,
    noisy_errors,
    over_lambda,
    planar,
    slope,
    slope_with_error,
    spherical,
)

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
            _NOISY,
            "the plateau falls with N: its slope over all draws is below 0 by two standard errors",
            f"{fall:.2f} +- {doubt:.2f}, medians " + ", ".join(f"{p:.2g}" for p in plateaus) + " m",
            lambda line: line[0] < -2.0 * line[1],
            (fall, doubt),
            control="N in the wrong order",
            faulty=(-fall, doubt),
        ),
        judged(
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


_V = "A typical 'V'-shape curve appears when the learning model becomes more complicated."


def figure_11(*, quick: bool) -> Figure:  # noqa: ARG001
    """Error against lambda for several eps, noisy samples: the V of bias and variance."""
    title = "Fig. 11: bias and variance, planar pendulum"
    return _figure("11", planar(), np.logspace(-1, -9, 17), np.logspace(3, 6, 4), 5, CONSTRAINT, title)


def figure_19c(*, quick: bool) -> Figure:  # noqa: ARG001
    """Spherical pendulum, error against lambda with noise."""
    title = "Fig. 19c: bias and variance, spherical"
    return _figure("19c", spherical(), np.logspace(-1, -9, 9), np.logspace(3, 5, 3), 3, SPHERE, title)


def _figure(
    name: str, experiment: Experiment, lams: Array, penalties: Array, seeds: int, y_label: str, title: str
) -> Figure:
    constraint, state = noisy_errors(experiment, lams, penalties, seeds)
    axes = {"lambda": lams, "penalty": penalties, "seed": np.arange(seeds)}
    curves = [Curve(label=f"1/ε² = {p:.0e}", x=lams, y=constraint[:, j]) for j, p in enumerate(penalties)]
    return Figure(
        name=name,
        table=error_table(axes, constraint, state, delta=DELTA_M),
        verdicts=v_verdicts(lams, penalties, constraint),
        draw=lambda canvas: log_log(canvas, curves, x_label="λ", y_label=y_label, title=title, slope=None),
    )


def v_verdicts(lams: Array, penalties: Array, constraint: Array) -> tuple[Verdict, ...]:
    """The V: lambda falls along the first axis of errors (lambda, penalty, seed)."""
    low, high = 0.8, 1.2

    def rises(errors: Array) -> list[float]:
        median = np.median(errors, axis=2)
        return [float(min(m[0], m[-1]) / m.min()) for m in median.T]

    def right(errors: Array) -> float:
        median = np.median(errors, axis=2)[:, -1]
        arm = (lams <= 3.3e-2) & (lams > lams[np.argmin(median)]) & (median > 3.0 * median.min())
        return slope(lams[arm], median[arm]) if arm.sum() > 1 else 0.0

    def places(errors: Array) -> tuple[Array, Array]:
        """Decimal logarithm of the best lambda, and its standard error over seeds, an eps each."""
        best = np.log10(lams[np.argmin(errors, axis=0)])
        step = float(np.abs(np.diff(np.log10(lams))).mean()) / np.sqrt(12.0)  # no minimum is known better than the grid
        seeds = best.shape[1]
        spread = best.std(axis=1, ddof=1) if seeds > 1 else np.zeros(len(best))
        return best.mean(axis=1), np.hypot(spread, step) / np.sqrt(seeds)

    def moves(errors: Array) -> bool:
        where, doubt = places(errors)
        apart = 2.0 * np.hypot(doubt[1:], doubt[:-1])
        falls = where[0] - where[-1] > 2.0 * np.hypot(doubt[0], doubt[-1])
        return bool((np.diff(where) <= apart).all() and falls and abs(where[-1] - where[-2]) <= apart[-1])

    where, doubt = places(constraint)
    return (
        judged(
            _V,
            "for every eps both ends of the curve lie above its minimum by more than the seeds' spread there",
            "least rise " + ", ".join(f"{r:.2g}" for r in rises(constraint)) + f", spread {_spread(constraint):.2g}",
            lambda errors: min(rises(errors)) > _spread(errors),
            constraint,
            control="errors that only fall with lambda",
            faulty=np.minimum.accumulate(constraint, axis=0),
        ),
        judged(
            "The right is dominated by the approximation error that decreases (super)linearly on the plot.",
            f"the right arm, above three times the minimum, has slope {low} to {high}",
            f"{right(constraint):.2f}",
            lambda slope: low <= slope <= high,
            right(constraint),
            control="the square root of the errors",
            faulty=right(np.sqrt(constraint)),
        ),
        judged(
            "Optimal estimates are obtained by equilibrating these two contributions.",
            "the minimum is at a smaller lambda for the smallest eps than for the largest, moves to no larger one "
            "between, and is the same at the last two eps, by two standard errors over seeds",
            ", ".join(f"10^({x:.1f} +- {e:.1f}) at {p:.0e}" for x, e, p in zip(where, doubt, penalties, strict=True)),
            moves,
            constraint,
            control="eps in the wrong order",
            faulty=constraint[:, ::-1],
        ),
    )


def _spread(errors: Array) -> float:
    """Largest ratio of the highest to the median of the seeds' least errors, an eps each."""
    least = errors.min(axis=0)
    return float((least.max(axis=1) / np.median(least, axis=1)).max())
