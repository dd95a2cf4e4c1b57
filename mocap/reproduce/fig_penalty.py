"""Figures 14a, 14b, 19a and 19b: the error against 1/eps^2 for several lambda."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eal.arrays import Array
from eal.systems import GRAVITY_M_S2
from mocap.reproduce.draw import Curve, log_log
from mocap.reproduce.record import Figure, Verdict, judged
from mocap.reproduce.sweep import (
    CONSTRAINT,
    DELTA_M,
    PENALTY,
    SPHERE,
    Experiment,
    N,
    against_penalty,
    error_table,
    errors,
    noisy_errors,
    over_lambda,
    planar,
    slope,
    spherical,
)

_REST_SLOPE = "The constraint violation is bounded by at least the same order of ε guaranteed in Eq. 34 (slope -1/2)."
_PLATEAU = "As λ decreases, more information from V_ρ is retained and the limit on accuracy gets smaller accordingly."
_NOISE = "Where measurements are noisy, the decrease in error as λ decreases reaches a limit that depends on the noise."


def figure_14a(*, quick: bool) -> Figure:
    """Error against 1/eps^2 for several lambda, exact samples, planar pendulum."""
    experiment, lams = planar(), np.logspace(-2, -7, 6)
    penalties = np.logspace(2, 6, 9 if quick else 17)
    potentials = over_lambda(experiment.samples(N), experiment.kernel, lams)
    constraint, state = (e[0] for e in errors(experiment, potentials, penalties))
    left = penalties >= 1e3
    rate = slope(penalties[left], constraint[-1][left])
    expected = GRAVITY_M_S2 * np.sin(experiment.start[1]) / (2 * experiment.beta * 1e6)
    plateaus, turn = constraint[:4, -1], penalties[int(np.argmin(state[4]))]
    floor = [float(p.value(experiment.start)) / (2 * experiment.beta) for p in potentials[:4]]
    pushed, _ = errors(experiment, potentials[-1:], penalties, velocity=np.array([1.0, 0.0]))
    generic = slope(penalties[left], pushed[0, 0][left])
    verdicts = (
        _slope(
            "slope at most -1/2 left of the plateau (-1.00 at rest on the set)",
            (rate, generic),
            (-1.05, -0.95),
            control="a start with 1 m/s across the set",
        ),
        judged(
            "The slope of the reference line is -1/2.",
            "with 1 m/s across the set the generic rate -1/2 appears",
            f"{generic:.2f}",
            lambda slope: -0.6 < slope < -0.45,
            generic,
            control="a start at rest on the set",
            faulty=rate,
        ),
        judged(
            _REST_SLOPE,
            f"sup |r-1| at 1/eps^2 = 1e6 is g sin(theta0) eps^2/(2 beta) = {expected:.3g} m within 5 %",
            f"{constraint[-1, -1]:.3g} m",
            lambda error: abs(error / expected - 1) < 0.05,
            constraint[-1, -1],
            control="the next smaller 1/eps^2 of the figure",
            faulty=constraint[-1, -2],
        ),
        judged(
            "Equation 33: the norm of the difference of the two trajectories in C[0, T] is O(eps).",
            "the full state error falls with 1/eps^2 up to 1e6, as the constraint error does (lambda = 1e-6)",
            f"least {state[4].min():.2g} at {turn:.1g}, {state[4, -1]:.2g} at 1e6: "
            "the uneven floor of V drives the motion along the set",
            lambda error: error[-1] <= 1.05 * error.min(),
            state[4],
            control="1/eps^2 in the wrong order",
            faulty=constraint[4][::-1],
        ),
        judged(
            _PLATEAU,
            "plateaus fall with lambda = 1e-2 .. 1e-5 and are V(q0)/(2 beta) within a factor 2.5",
            ", ".join(f"{p:.2g}" for p in plateaus)
            + " m, times "
            + ", ".join(f"{p / f:.2g}" for p, f in zip(plateaus, floor, strict=True)),
            lambda heights: np.all(np.diff(heights) < 0) and np.all(np.abs(np.log(heights / floor)) < np.log(2.5)),
            plateaus,
            control="plateaus of the next larger lambda",
            faulty=np.append(10.0 * plateaus[0], plateaus[:-1]),
        ),
    )
    curves = [
        Curve(label=f"λ = {lam:.0e}", x=penalties, y=y, state=z)
        for lam, y, z in zip(lams, constraint, state, strict=True)
    ]
    return Figure(
        name="14a",
        table=error_table({"lambda": lams, "penalty": penalties, "seed": np.zeros(1)}, constraint, state, delta=0.0),
        verdicts=verdicts,
        draw=lambda canvas: log_log(
            canvas,
            curves,
            x_label=PENALTY,
            y_label=CONSTRAINT,
            title="Fig. 14a: exact, N = 400, T = 0.05 s (dotted: |q_λ − q_ε|)",
        ),
    )


def _noisy(
    experiment: Experiment, lams: Array, penalties: Array, seeds: int
) -> tuple[tuple[Array, Array], Array, Array]:
    """Errors (lambda, penalty, seed) of noisy samples, their plateaus (lambda,), and those of exact samples."""
    found = noisy_errors(experiment, lams, penalties, seeds)
    exact, _ = errors(experiment, over_lambda(experiment.samples(N), experiment.kernel, lams), penalties[-1:])
    return found, np.median(found[0][:, -1], axis=1), exact[0, :, 0]


def _levels_off(i: int, plateaus: Array, exact: Array, more: str = "") -> Verdict:
    """Of noisy plateaus from the i-th lambda, 1e-(i + 2), to the next."""
    return judged(
        _NOISE,
        f"from lambda = 1e-{i + 2} to 1e-{i + 3} the plateau no longer falls tenfold, but by less than the root of it",
        f"ratio {plateaus[i] / plateaus[i + 1]:.2f}, without noise {exact[i] / exact[i + 1]:.2f}{more}",
        lambda heights: heights[i] / heights[i + 1] < np.sqrt(10.0),
        plateaus,
        control="samples without noise",
        faulty=exact,
    )


def figure_14b(*, quick: bool) -> Figure:
    """As 14a with noisy samples."""
    lams, penalties = np.logspace(-2, -7, 6), np.logspace(2, 6, 9 if quick else 17)
    found, plateaus, exact = _noisy(planar(), lams, penalties, 2 if quick else 5)
    best = float(plateaus.min())
    verdicts = (
        judged(
            _NOISE,
            f"the lowest plateau is the noise floor, 0.03 to 0.3 of delta = {DELTA_M:g} m",
            f"{best / DELTA_M:.2f} delta at lambda = {lams[int(np.argmin(plateaus))]:.0e}",
            lambda height: 0.03 < height / DELTA_M < 0.3,
            best,
            control="samples without noise",
            faulty=float(exact.min()),
        ),
        _levels_off(2, plateaus, exact),
    )
    return against_penalty("14b", "lambda", lams, penalties, found, verdicts)


SPANS_S = (1.0, 10.0)
"""Spans of the samples of figure 19a, which the paper does not give: the first is that of the other figures."""


def figure_19a(*, quick: bool, spans_s: Sequence[float] = SPANS_S) -> Figure:
    """Spherical pendulum, exact samples, over each of several spans of the true motion."""
    lams, penalties = np.logspace(-2, -7, 6), np.logspace(2, 6, 9 if quick else 17)
    left = penalties <= 3.2e3
    tables, verdicts, curves = [], [], []
    for i, span_s in enumerate(spans_s):
        experiment = replace(spherical(), span_s=span_s)
        potentials = over_lambda(experiment.samples(N), experiment.kernel, lams)
        constraint, state = (e[0] for e in errors(experiment, potentials, penalties))
        rate, plateaus = slope(penalties[left], constraint[-1][left]), constraint[:, -1]
        over = f"samples over {span_s:g} s: "
        verdicts += [
            _slope(
                f"{over}slope at most -1/2 left of the plateau (about -1)",
                (rate, slope(penalties[~left], constraint[0][~left])),
                (-1.1, -0.85),
                control="the plateau at the largest lambda",
            ),
            judged(
                "We observe the same qualitative behavior of the dependence of the error on the parameters.",
                f"{over}plateaus fall with lambda",
                ", ".join(f"{p:.2g}" for p in plateaus) + " m",
                lambda heights: np.all(np.diff(heights) < 0),
                plateaus,
                control="lambda in the wrong order",
                faulty=plateaus[::-1],
            ),
        ]
        table = error_table({"lambda": lams, "penalty": penalties, "seed": np.zeros(1)}, constraint, state, delta=0.0)
        tables.append(table | {"span_s": np.full(len(table["T"]), span_s)})
        curves += [
            Curve(label=f"λ = {lam:.0e}, {span_s:g} s", x=penalties, y=y, dashed=i > 0)
            for lam, y in zip(lams, constraint, strict=True)
        ]
    return Figure(
        name="19a",
        table={key: np.concatenate([table[key] for table in tables]) for key in tables[0]},
        verdicts=tuple(verdicts),
        draw=lambda canvas: log_log(
            canvas,
            curves,
            x_label=PENALTY,
            y_label=SPHERE,
            title="Fig. 19a: spherical, exact, N = 400, samples over " + " and ".join(f"{s:g} s" for s in spans_s),
        ),
    )


def figure_19b(*, quick: bool) -> Figure:
    """Spherical pendulum, noisy samples."""
    lams, penalties = np.logspace(-2, -6, 5), np.logspace(2, 6, 5 if quick else 9)
    found, plateaus, exact = _noisy(spherical(), lams, penalties, 1 if quick else 3)
    verdict = _levels_off(3, plateaus, exact, f"; lowest {plateaus.min() / DELTA_M:.2f} delta")
    return against_penalty("19b", "lambda", lams, penalties, found, (verdict,), y_label=SPHERE)


def _slope(claim: str, found: tuple[float, float], limits: tuple[float, float], *, control: str) -> Verdict:
    """Of a slope within limits; the second of ``found`` is the control's."""
    return judged(
        _REST_SLOPE,
        claim,
        f"{found[0]:.2f}",
        lambda slope: limits[0] <= slope <= limits[1],
        found[0],
        control=control,
        faulty=found[1],
    )
