"""Figures 13, 16 and 17: coordinates over 10 s, and the error for several final times."""

import numpy as np

from eal.arrays import Array
from eal.compiled import simulate_compiled
from mocap.reproduce.draw import Curve, log_log, over_time
from mocap.reproduce.fig_samples import LAMBDA
from mocap.reproduce.record import Figure, Verdict, long_table
from mocap.reproduce.settings import CONSTRAINT, DELTA_M, PENALTY, N
from mocap.reproduce.sweep import errors, over_lambda, planar

TIMES_S = (0.01, 0.05, 0.1, 0.3, 0.5)
_FIG13 = "The coordinate r is nearly a constant; the approximate trajectory oscillates rapidly about the submanifold."
_OVERLAY = "Fig. 13: the trajectories of both the actual and homogenization models within 10 s (theta overlays)."
_GROWTH = "The integration error accumulates as the final time increases of course."


def _radius_error(q: Array) -> Array:
    return abs(q[0] - 1.0)


def figure_13(*, quick: bool) -> Figure:  # noqa: ARG001
    """R and theta over 10 s at 1/eps^2 = 2e5; three lambda, because theta needs a smaller one than printed."""
    experiment, lams, penalty = planar(), np.array([1e-6, 1e-8, 1e-6 / N, 1e-10]), 2e5
    potentials = over_lambda(experiment.samples(N), experiment.kernel, lams)
    run = simulate_compiled(
        experiment.system,
        potentials,
        np.array([penalty]),
        experiment.start,
        experiment.velocity,
        duration_s=10.0,
        every=100,
        monitor=_radius_error,
    )
    t, q, v = run.trajectory.t_s, run.trajectory.q[:, :, 0], run.trajectory.v[:, :, 0]
    truth = experiment.truth(t)
    off = np.abs(q[..., 1] - truth[:, None, 1])
    peak, swing = run.peaks[-1, :, 0], off.max(axis=0)
    energy = np.stack(
        [
            experiment.system.kinetic(q[:, i], v[:, i])
            + experiment.system.potential(q[:, i])
            + penalty * p.value(q[:, i])
            for i, p in enumerate(potentials)
        ],
        axis=1,
    )
    drift = np.abs(energy - energy[0]).max(axis=0)
    verdicts = (
        Verdict(
            figure="13",
            sentence=_FIG13,
            claim="sup |r-1| over 10 s is 1.84e-5 m within 5 %",
            measured=f"{peak[0]:.3g} m",
            holds=abs(peak[0] / 1.84e-5 - 1) < 0.05,
        ),
        Verdict(
            figure="13",
            sentence=_FIG13,
            claim="the energy drifts by less than 2e-7 J (RK4, h = 1e-4 s)",
            measured=f"{drift[0]:.2g} J",
            holds=drift[0] < 2e-7,
        ),
        Verdict(
            figure="13",
            sentence=_OVERLAY,
            claim="with the printed lambda = 1e-6 (of K/N) theta overlays the truth within 0.1 rad",
            measured=f"{swing[0]:.2g} rad off",
            holds=bool(swing[0] < 0.1),
        ),
        Verdict(
            figure="13",
            sentence=_OVERLAY,
            claim="with lambda = 1e-6 in units of K, the literal equation 31 (2.5e-9 of K/N), it does",
            measured=f"{swing[2]:.2g} rad off ({swing[1]:.2g} at 1e-8 of K/N, {swing[3]:.2g} at 1e-10)",
            holds=bool(swing[2] < 0.1),
        ),
    )
    table = long_table({"T": t, "lambda": lams}, constraint_error=np.abs(q[..., 0] - 1.0), state_error=off)
    table |= {"penalty": np.full(len(table["T"]), penalty), "N": np.full(len(table["T"]), float(N))}
    table |= {
        "r": q[..., 0].reshape(-1),
        "theta": q[..., 1].reshape(-1),
        "theta_true": np.repeat(truth[:, 1], len(lams)),
    }
    names = [f"EAL, λ = {lam:.0e}" for lam in lams]
    panels = [
        ("r (m)", [("actual", np.ones_like(t)), (names[0], q[:, 0, 0])]),
        ("θ (rad)", [("actual", truth[:, 1]), *((n, q[:, i, 1]) for i, n in enumerate(names))]),
    ]
    return Figure(
        name="13",
        table=table,
        verdicts=verdicts,
        draw=lambda canvas: over_time(canvas, t, panels, "Fig. 13: 1/ε² = 2e5 J, N = 400, β = 3"),
    )


def figure_16(*, quick: bool) -> Figure:
    """Exact samples, several final times; the growth is not integration error."""
    experiment = planar()
    penalties = np.logspace(2, 6, 5 if quick else 17)
    potential = over_lambda(experiment.samples(N), experiment.kernel, np.array([LAMBDA]))
    constraint, state = errors(experiment, potential, penalties, durations_s=TIMES_S)
    checked, end = penalties[[0, -3, -1]], 0.3
    fine = simulate_compiled(
        experiment.system,
        potential,
        checked,
        experiment.start,
        experiment.velocity,
        duration_s=end,
        h_s=5e-5 if quick else 1e-5,
        every=100,
        monitor=_radius_error,
    ).peaks[-1, 0]
    early, late = (constraint[TIMES_S.index(t), 0][-1] for t in (0.05, end))
    ratio = (0.5 if quick else 0.1, late / early, fine[-1] / early)
    growth = constraint[-1, 0] / constraint[1, 0]
    verdicts = (
        Verdict(
            figure="16",
            sentence="Cases with different final time, without noise: the same trends.",
            claim="the error grows with T at every penalty (0.5 s over 0.05 s)",
            measured=f"{growth.min():.2g} to {growth.max():.2g} times",
            holds=bool(growth.min() > 1.0),
        ),
        Verdict(
            figure="16",
            sentence=_GROWTH,
            claim=f"growth from 0.05 to {end:g} s is integration error: a step {ratio[0]:g} times as long halves it",
            measured=f"growth {ratio[1]:.3f} times, {ratio[2]:.3f} with the shorter step: it is the motion's own",
            holds=bool(ratio[2] - 1.0 < 0.5 * (ratio[1] - 1.0)),
        ),
    )
    return _times("16", penalties, constraint, state, 0.0, verdicts, "exact samples")


def figure_17(*, quick: bool) -> Figure:
    """Noisy samples, several final times."""
    experiment = planar()
    penalties, seeds = np.logspace(2, 6, 5 if quick else 9), 1 if quick else 4
    lam = np.array([LAMBDA])
    potentials = [
        over_lambda(experiment.samples(N, delta=DELTA_M, rng=np.random.default_rng(s)), experiment.kernel, lam)[0]
        for s in range(seeds)
    ]
    constraint, state = errors(experiment, potentials, penalties, durations_s=TIMES_S)
    plateau = np.median(constraint[:, :, -1], axis=1)
    verdicts = (
        Verdict(
            figure="17",
            sentence="The qualitative trends are quite close to those in which λ is decreased.",
            claim="the plateau grows with T and stays at the noise floor, below delta",
            measured=", ".join(f"{p:.2g}" for p in plateau) + " m",
            holds=bool(np.all(np.diff(plateau) >= 0) and plateau[-1] < DELTA_M),
        ),
    )
    return _times("17", penalties, constraint, state, DELTA_M, verdicts, f"noise {DELTA_M:g} m, {seeds} seeds")


def _times(
    name: str,
    penalties: Array,
    constraint: Array,
    state: Array,
    delta: float,
    verdicts: tuple[Verdict, ...],
    title: str,
) -> Figure:
    """Errors are (T, seed, penalty)."""
    axes = {"T": np.array(TIMES_S), "seed": np.arange(constraint.shape[1]), "penalty": penalties}
    table = long_table(axes, constraint_error=constraint, state_error=state)
    rows = len(table["T"])
    table |= {k: np.full(rows, v) for k, v in {"lambda": LAMBDA, "N": float(N), "delta": delta}.items()}
    curves = [Curve(label=f"T = {t:g} s", x=penalties, y=y.T) for t, y in zip(TIMES_S, constraint, strict=True)]
    return Figure(
        name=name,
        table=table,
        verdicts=verdicts,
        draw=lambda canvas: log_log(
            canvas, curves, x_label=PENALTY, y_label=CONSTRAINT, title=f"Fig. {name}: {title}, λ = {LAMBDA:g}, N = {N}"
        ),
    )
