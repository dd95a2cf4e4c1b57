"""Figures 11 and 19c: the error against lambda, the V of bias and variance."""

import numpy as np
from matplotlib.figure import Figure as Canvas

from eal.arrays import Array
from mocap.reproduce.draw import Curve, log_log
from mocap.reproduce.record import Figure, Verdict
from mocap.reproduce.settings import CONSTRAINT, DELTA_M, SPHERE, noisy_errors, table_over_lambda
from mocap.reproduce.sweep import planar, slope, spherical

_V = "A typical 'V'-shape curve appears when the learning model becomes more complicated."


def figure_11(*, quick: bool) -> Figure:
    """Error against lambda for several eps, noisy samples: the V of bias and variance."""
    experiment = planar()
    lams = np.logspace(-1, -9, 17 if quick else 25)
    penalties, seeds = np.array([1e3, 1e4, 1e5, 1e6]), 2 if quick else 5
    constraint, state = noisy_errors(experiment, lams, penalties, seeds)
    return Figure(
        name="11",
        table=table_over_lambda(lams, penalties, constraint, state, delta=DELTA_M),
        verdicts=v_verdicts("11", lams, penalties, constraint),
        draw=lambda canvas: _draw_v(
            canvas, lams, penalties, constraint, CONSTRAINT, "Fig. 11: bias and variance, planar pendulum"
        ),
    )


def figure_19c(*, quick: bool) -> Figure:
    """Spherical pendulum, error against lambda with noise."""
    experiment = spherical()
    lams = np.logspace(-1, -9, 9 if quick else 13)
    penalties, seeds = np.array([1e3, 1e4, 1e5]), 1 if quick else 3
    constraint, state = noisy_errors(experiment, lams, penalties, seeds)
    return Figure(
        name="19c",
        table=table_over_lambda(lams, penalties, constraint, state, delta=DELTA_M),
        verdicts=v_verdicts("19c", lams, penalties, constraint),
        draw=lambda canvas: _draw_v(
            canvas, lams, penalties, constraint, SPHERE, "Fig. 19c: bias and variance, spherical"
        ),
    )


def v_verdicts(figure: str, lams: Array, penalties: Array, constraint: Array) -> tuple[Verdict, ...]:
    """The V: lambda falls along the arrays."""
    median = np.median(constraint, axis=2)
    best = np.argmin(median, axis=0)
    rises = [float(min(median[0, j], median[-1, j]) / median[best[j], j]) for j in range(len(penalties))]
    arm = (lams <= 3.3e-2) & (lams > lams[best[-1]]) & (median[:, -1] > 3.0 * median[best[-1], -1])
    right = slope(lams[arm], median[arm, -1])
    where = lams[best]
    low, high = 0.8, 1.2
    moves = bool(np.all(where[1:] <= where[:-1] * 1.01) and where[-1] < 0.99 * where[0])
    return (
        Verdict(
            figure=figure,
            sentence=_V,
            claim="for every eps both ends of the curve lie above its minimum",
            measured="least rise " + ", ".join(f"{r:.2g}" for r in rises),
            holds=min(rises) > 1.05,
        ),
        Verdict(
            figure=figure,
            sentence="The right is dominated by the approximation error that decreases (super)linearly on the plot.",
            claim=f"the right arm, above three times the minimum, has slope {low} to {high}",
            measured=f"{right:.2f}",
            holds=low <= right <= high,
        ),
        Verdict(
            figure=figure,
            sentence="Optimal estimates are obtained by equilibrating these two contributions.",
            claim="the minimum never moves to a larger lambda as eps falls, moves to a smaller one, and is the same at "
            "the last two eps",
            measured=", ".join(f"{x:.1e}" for x in where),
            holds=moves and bool(abs(where[-1] / where[-2] - 1.0) < 0.01),
        ),
    )


def _draw_v(canvas: Canvas, lams: Array, penalties: Array, constraint: Array, label: str, title: str) -> None:
    curves = [Curve(label=f"1/ε² = {p:.0e}", x=lams, y=constraint[:, j]) for j, p in enumerate(penalties)]
    log_log(canvas, curves, x_label="λ", y_label=label, title=title, slope=None)
