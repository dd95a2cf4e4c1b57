"""Figures 11, 14a, 14b and 19: the error against 1/eps^2 and against lambda."""

import numpy as np

from app.reproduce.draw import Curve, log_log
from app.reproduce.record import Figure, Verdict, long_table
from app.reproduce.sweep import Experiment, errors, over_lambda, planar, slope, spherical
from eal.arrays import Array
from eal.systems import GRAVITY_M_S2

N, DELTA_M, DURATION_S = 400, 1e-3, 0.05
PENALTY = "penalty factor 1/ε² (J)"
CONSTRAINT = "sup |r − 1| (m)"
SPHERE = "sup ||x| − 1| (m)"
_REST_SLOPE = "The constraint violation is bounded by at least the same order of ε guaranteed in Eq. 34 (slope -1/2)."
_PLATEAU = "As λ decreases, more information from V_ρ is retained and the limit on accuracy gets smaller accordingly."
_NOISE = "Where measurements are noisy, the decrease in error as λ decreases reaches a limit that depends on the noise."
_V = "A typical 'V'-shape curve appears when the learning model becomes more complicated."


def figure_14a(*, quick: bool) -> Figure:
    """Error against 1/eps^2 for several lambda, exact samples, planar pendulum."""
    experiment, lams = planar(), np.logspace(-2, -7, 6)
    penalties = np.logspace(2, 6, 9 if quick else 17)
    potentials = over_lambda(experiment.samples(N), experiment.kernel, lams)
    constraint, state = (e[0] for e in errors(experiment, potentials, penalties))
    left = penalties >= 1e3
    rate = slope(penalties[left], constraint[-1][left])
    expected = GRAVITY_M_S2 * np.sin(experiment.start[1]) / (2 * experiment.beta * 1e6)
    plateaus = constraint[:4, -1]
    floor = [float(p.value(experiment.start)) / (2 * experiment.beta) for p in potentials[:4]]
    pushed, _ = errors(experiment, potentials[-1:], penalties, velocity=np.array([1.0, 0.0]))
    generic = slope(penalties[left], pushed[0, 0][left])
    verdicts = (
        _verdict(
            "14a", _REST_SLOPE, "slope at most -1/2 left of the plateau (-1.00 at rest on the set)", rate, -1.05, -0.95
        ),
        Verdict(
            figure="14a",
            sentence="The slope of the reference line is -1/2.",
            claim="with 1 m/s across the set the generic rate -1/2 appears",
            measured=f"{generic:.2f}",
            holds=-0.6 < generic < -0.45,
        ),
        Verdict(
            figure="14a",
            sentence=_REST_SLOPE,
            claim=f"sup |r-1| at 1/eps^2 = 1e6 is g sin(theta0) eps^2/(2 beta) = {expected:.3g} m within 5 %",
            measured=f"{constraint[-1, -1]:.3g} m",
            holds=abs(constraint[-1, -1] / expected - 1) < 0.05,
        ),
        Verdict(
            figure="14a",
            sentence=_PLATEAU,
            claim="plateaus fall with lambda = 1e-2 .. 1e-5 and are V(q0)/(2 beta) within a factor 2.5",
            measured=", ".join(f"{p:.2g}" for p in plateaus) + " m",
            holds=bool(np.all(np.diff(plateaus) < 0) and np.all(np.abs(np.log(plateaus / floor)) < np.log(2.5))),
        ),
    )
    curves = [Curve(label=f"λ = {lam:.0e}", x=penalties, y=y) for lam, y in zip(lams, constraint, strict=True)]
    return Figure(
        name="14a",
        table=_table(lams, penalties, constraint[:, :, None], state[:, :, None], delta=0.0),
        verdicts=verdicts,
        draw=lambda canvas: log_log(
            canvas, curves, x_label=PENALTY, y_label=CONSTRAINT, title="Fig. 14a: exact samples, N = 400, T = 0.05 s"
        ),
    )


def figure_14b(*, quick: bool) -> Figure:
    """As 14a with noisy samples."""
    experiment, lams = planar(), np.logspace(-2, -7, 6)
    penalties, seeds = np.logspace(2, 6, 9 if quick else 17), 2 if quick else 5
    constraint, state = _noisy(experiment, lams, penalties, seeds)
    plateaus = np.median(constraint[:, -1], axis=1)
    best = float(plateaus.min())
    verdicts = (
        Verdict(
            figure="14b",
            sentence=_NOISE,
            claim=f"the lowest plateau is the noise floor, 0.03 to 0.3 of delta = {DELTA_M:g} m",
            measured=f"{best / DELTA_M:.2f} delta at lambda = {lams[int(np.argmin(plateaus))]:.0e}",
            holds=0.03 < best / DELTA_M < 0.3,
        ),
        Verdict(
            figure="14b",
            sentence=_NOISE,
            claim="from lambda = 1e-5 to 1e-6 the plateau no longer falls tenfold (it does without noise)",
            measured=f"ratio {plateaus[3] / plateaus[4]:.2f}",
            holds=plateaus[3] / plateaus[4] < 3.0,
        ),
    )
    curves = [Curve(label=f"λ = {lam:.0e}", x=penalties, y=y) for lam, y in zip(lams, constraint, strict=True)]
    return Figure(
        name="14b",
        table=_table(lams, penalties, constraint, state, delta=DELTA_M),
        verdicts=verdicts,
        draw=lambda canvas: log_log(
            canvas,
            curves,
            x_label=PENALTY,
            y_label=CONSTRAINT,
            title=f"Fig. 14b: noise {DELTA_M:g} m, {seeds} seeds",
        ),
    )


def figure_11(*, quick: bool) -> Figure:
    """Error against lambda for several eps, noisy samples: the V of bias and variance."""
    experiment = planar()
    lams = np.logspace(-1, -9, 17 if quick else 25)
    penalties, seeds = np.array([1e3, 1e4, 1e5, 1e6]), 2 if quick else 5
    constraint, state = _noisy(experiment, lams, penalties, seeds)
    return Figure(
        name="11",
        table=_table(lams, penalties, constraint, state, delta=DELTA_M),
        verdicts=_v_verdicts("11", lams, penalties, constraint),
        draw=lambda canvas: _draw_v(canvas, lams, penalties, constraint, "Fig. 11: bias and variance, planar pendulum"),
    )


def figure_19a(*, quick: bool) -> Figure:
    """Spherical pendulum, exact samples."""
    experiment, lams = spherical(), np.logspace(-2, -7, 6)
    penalties = np.logspace(2, 6, 9 if quick else 17)
    potentials = over_lambda(experiment.samples(N), experiment.kernel, lams)
    constraint, state = (e[0] for e in errors(experiment, potentials, penalties))
    left = (penalties >= 1e2) & (penalties <= 1e4)
    rate = slope(penalties[left], constraint[-1][left])
    plateaus = constraint[:, -1]
    verdicts = (
        _verdict("19a", _REST_SLOPE, "slope at most -1/2 left of the plateau (about -1)", rate, -1.1, -0.85),
        Verdict(
            figure="19a",
            sentence="We observe the same qualitative behavior of the dependence of the error on the parameters.",
            claim="plateaus fall with lambda",
            measured=", ".join(f"{p:.2g}" for p in plateaus) + " m",
            holds=bool(np.all(np.diff(plateaus) < 0)),
        ),
    )
    curves = [Curve(label=f"λ = {lam:.0e}", x=penalties, y=y) for lam, y in zip(lams, constraint, strict=True)]
    return Figure(
        name="19a",
        table=_table(lams, penalties, constraint[:, :, None], state[:, :, None], delta=0.0),
        verdicts=verdicts,
        draw=lambda canvas: log_log(
            canvas, curves, x_label=PENALTY, y_label=SPHERE, title="Fig. 19a: spherical, exact, N = 400"
        ),
    )


def figure_19b(*, quick: bool) -> Figure:
    """Spherical pendulum, noisy samples."""
    experiment, lams = spherical(), np.logspace(-2, -6, 5)
    penalties, seeds = np.logspace(2, 6, 5 if quick else 9), 1 if quick else 3
    constraint, state = _noisy(experiment, lams, penalties, seeds)
    plateaus = np.median(constraint[:, -1], axis=1)
    verdicts = (
        Verdict(
            figure="19b",
            sentence=_NOISE,
            claim=f"the lowest plateau is a noise floor, 0.02 to 1 of delta = {DELTA_M:g} m",
            measured=f"{plateaus.min() / DELTA_M:.2f} delta",
            holds=0.02 < plateaus.min() / DELTA_M < 1.0,
        ),
    )
    curves = [Curve(label=f"λ = {lam:.0e}", x=penalties, y=y) for lam, y in zip(lams, constraint, strict=True)]
    return Figure(
        name="19b",
        table=_table(lams, penalties, constraint, state, delta=DELTA_M),
        verdicts=verdicts,
        draw=lambda canvas: log_log(
            canvas,
            curves,
            x_label=PENALTY,
            y_label=SPHERE,
            title=f"Fig. 19b: noise {DELTA_M:g} m, {seeds} seeds",
        ),
    )


def figure_19c(*, quick: bool) -> Figure:
    """Spherical pendulum, error against lambda with noise."""
    experiment = spherical()
    lams = np.logspace(-1, -9, 9 if quick else 13)
    penalties, seeds = np.array([1e3, 1e4, 1e5]), 1 if quick else 3
    constraint, state = _noisy(experiment, lams, penalties, seeds)
    return Figure(
        name="19c",
        table=_table(lams, penalties, constraint, state, delta=DELTA_M),
        verdicts=_v_verdicts("19c", lams, penalties, constraint),
        draw=lambda canvas: _draw_v(canvas, lams, penalties, constraint, "Fig. 19c: bias and variance, spherical"),
    )


def _noisy(experiment: Experiment, lams: Array, penalties: Array, seeds: int) -> tuple[Array, Array]:
    """Constraint and state errors (lambda, penalty, seed) of noisy samples."""
    found = []
    for seed in range(seeds):
        z = experiment.samples(N, delta=DELTA_M, rng=np.random.default_rng(seed))
        found.append([e[0] for e in errors(experiment, over_lambda(z, experiment.kernel, lams), penalties)])
    constraint, state = np.moveaxis(np.array(found), 1, 0)
    return np.moveaxis(constraint, 0, -1), np.moveaxis(state, 0, -1)


def _v_verdicts(figure: str, lams: Array, penalties: Array, constraint: Array) -> tuple[Verdict, ...]:
    """The V: lambda falls along the arrays."""
    median = np.median(constraint, axis=2)
    best = np.argmin(median, axis=0)
    rises = [float(min(median[0, j], median[-1, j]) / median[best[j], j]) for j in range(len(penalties))]
    arm = (lams <= 3.3e-2) & (lams > lams[best[-1]]) & (median[:, -1] > 3.0 * median[best[-1], -1])
    right = slope(lams[arm], median[arm, -1])
    where = lams[best]
    low, high = (0.8, 1.2) if figure == "11" else (0.3, 1.2)
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
            claim="the minimum moves to smaller lambda as eps falls, then stays",
            measured=", ".join(f"{x:.1e}" for x in where),
            holds=bool(np.all(where[1:] <= where[:-1] * 1.01) or where[-1] < where[0]),
        ),
    )


def _draw_v(canvas, lams: Array, penalties: Array, constraint: Array, title: str) -> None:
    curves = [Curve(label=f"1/ε² = {p:.0e}", x=lams, y=constraint[:, j]) for j, p in enumerate(penalties)]
    log_log(canvas, curves, x_label="λ", y_label=CONSTRAINT, title=title, slope=None)


def _verdict(figure: str, sentence: str, claim: str, value: float, low: float, high: float) -> Verdict:
    return Verdict(figure=figure, sentence=sentence, claim=claim, measured=f"{value:.2f}", holds=low <= value <= high)


def _table(lams: Array, penalties: Array, constraint: Array, state: Array, *, delta: float) -> dict[str, Array]:
    axes = {"lambda": lams, "penalty": penalties, "seed": np.arange(constraint.shape[2])}
    columns = long_table(axes, constraint_error=constraint, state_error=state)
    rows = len(columns["lambda"])
    fixed = {"T": DURATION_S, "N": float(N), "delta": delta}
    return columns | {name: np.full(rows, value) for name, value in fixed.items()}
