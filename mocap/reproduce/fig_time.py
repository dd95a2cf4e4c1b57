"""Figures 13, 16 and 17: coordinates over 10 s, and the error for several final times."""

import numpy as np

from eal.integrators import simulate
from eal.lagrangian import PenalisedModel
from eal.stack import PotentialStack
from eal.systems import GRAVITY_M_S2
from mocap.reproduce import sweep
from mocap.reproduce.draw import over_time
from mocap.reproduce.record import Figure, judged, long_table
from mocap.reproduce.sweep import DELTA_M, LAMBDA, Experiment, N, against_penalty, errors, over_lambda, planar

TIMES_S = (0.01, 0.05, 0.1, 0.3, 0.5)
_FIG13 = "The coordinate r is nearly a constant; the approximate trajectory oscillates rapidly about the submanifold."
_OVERLAY = "Fig. 13: the trajectories of both the actual and homogenization models within 10 s (theta overlays)."
_GROWTH = "The integration error accumulates as the final time increases of course."


def figure_13(*, quick: bool) -> Figure:  # noqa: ARG001
    """R and theta over 10 s at 1/eps^2 = 2e5; three lambda, because theta needs a smaller one than printed."""
    experiment, lams, penalty = planar(), np.array([1e-6, 1e-8, 1e-6 / N, 1e-10]), 2e5
    potentials = over_lambda(experiment.samples(N), experiment.kernel, lams)
    model = PenalisedModel(system=experiment.system, penalty=PotentialStack(potentials), strength=penalty)
    start = np.tile(experiment.start, (len(lams), 1))
    run = simulate(model, start, experiment.velocity, duration_s=10.0, h_s=sweep.STEP_S)
    t, q, v = run.t_s[::100], run.q[::100], run.v[::100]
    truth = experiment.truth(t)
    off = np.abs(q[..., 1] - truth[:, None, 1])
    peak, swing = np.abs(run.q[..., 0] - 1.0).max(axis=0), off.max(axis=0)
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
    exchanged = float(experiment.system.kinetic(q[:, 0], v[:, 0]).max())
    limit = normal_force_errors(experiment, 10.0)[1] / penalty
    verdicts = (
        judged(
            _FIG13,
            "sup |r-1| over 10 s is that of the force across the set, (max |F| + |F(0)|) eps^2/(4 beta) = "
            f"{limit:.3g} m, within 5 %",
            f"{peak[0]:.3g} m",
            lambda sup: abs(sup / limit - 1) < 0.05,
            peak[0],
            control="1/eps^2 twice as large, which halves it",
            faulty=0.5 * peak[0],
        ),
        judged(
            _FIG13,
            "RK4 keeps the energy to a millionth of what the motion exchanges (h = 1e-4 s)",
            f"{drift[0]:.2g} J of {exchanged:.3g} J",
            lambda loss: loss < 1e-6 * exchanged,
            drift[0],
            control="the energy without that of the penalty",
            faulty=penalty * np.ptp(potentials[0].value(q[:, 0])),
        ),
        judged(
            _OVERLAY,
            "with the printed lambda = 1e-6 (of K/N) theta overlays the truth within 0.1 rad",
            f"{swing[0]:.2g} rad off",
            lambda off: off < 0.1,
            swing[0],
            control="a mass that stays where it started",
            faulty=np.abs(truth[:, 1] - truth[0, 1]).max(),
        ),
        judged(
            _OVERLAY,
            "with lambda = 1e-6 in units of K, the literal equation 31 (2.5e-9 of K/N), it does",
            f"{swing[2]:.2g} rad off ({swing[1]:.2g} at 1e-8 of K/N, {swing[3]:.2g} at 1e-10)",
            lambda off: off < 0.1,
            swing[2],
            control="lambda = 1e-6 of K/N",
            faulty=swing[0],
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


def figure_16(*, quick: bool) -> Figure:  # noqa: ARG001
    """Exact samples, several final times; the growth is not integration error."""
    experiment = planar()
    penalties = np.logspace(2, 6, 9)
    potential = over_lambda(experiment.samples(N), experiment.kernel, np.array([LAMBDA]))
    constraint, state = errors(experiment, potential, penalties, durations_s=TIMES_S)
    end = 0.3
    finer, _ = errors(experiment, potential, penalties[-1:], durations_s=(end,), h_s=2e-5)
    early, late = (constraint[TIMES_S.index(t), 0][-1] for t in (0.05, end))
    ratio = (0.2, late / early, finer[0, 0, 0] / early)
    allowed = penalties <= 1.01e4
    least, most = normal_force_errors(experiment, TIMES_S[-1])
    share = constraint[-1, 0][allowed] * penalties[allowed] / most
    verdicts = (
        judged(
            "Cases with different final time, without noise: the same trends.",
            "up to 1/eps^2 = 1e4 the error at 0.5 s is that of the force across the set, F = m theta'^2 - m g "
            f"sin theta: between {least / most:.2f} and 1 times (max |F| + |F(0)|) eps^2/(4 beta), within 5 %",
            f"{share.min():.2f} to {share.max():.2f} times",
            lambda shares: shares.min() > 0.95 * least / most and shares.max() < 1.05,
            share,
            control="twice the force",
            faulty=2.0 * share,
        ),
        judged(
            _GROWTH,
            f"growth from 0.05 to {end:g} s is integration error: a step {ratio[0]:g} times as long halves it",
            f"growth {ratio[1]:.3f} times, {ratio[2]:.3f} with the shorter step: it is the motion's own",
            lambda growth: growth[1] - 1.0 < 0.5 * (growth[0] - 1.0),
            ratio[1:],
            control="a growth that the step does not change",
            faulty=(ratio[1], ratio[1]),
        ),
    )
    found = constraint.swapaxes(1, 2), state.swapaxes(1, 2)
    return against_penalty("16", "T", np.array(TIMES_S), penalties, found, verdicts, delta=0.0)


def normal_force_errors(experiment: Experiment, duration_s: float) -> tuple[float, float]:
    """Least and largest sup |r - 1| over [0, T] times 1/eps^2, from rest on the set, as the true motion's force says.

    V is 2 beta (r - 1)^2 near the set, so that the force F across it displaces r by F eps^2/(4 beta), about which it
    oscillates with the amplitude |F(0)| eps^2/(4 beta) that it starts with.

    Args:
        experiment: The planar pendulum.
        duration_s: T.

    Returns:
        max |F| / (4 beta) and (max |F| + |F(0)|) / (4 beta), in J m.
    """
    angle = experiment.truth(np.linspace(0.0, duration_s, 501))[:, 1]
    lift = np.sin(angle)
    force = GRAVITY_M_S2 * (2.0 * (lift[0] - lift) - lift)  # theta'^2 = 2 g (sin theta0 - sin theta), m = 1 kg, r = 1 m
    bend = 4.0 * experiment.beta
    return float(np.abs(force).max() / bend), float((np.abs(force).max() + abs(force[0])) / bend)


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
        judged(
            "The qualitative trends are quite close to those in which λ is decreased.",
            f"the plateau is the noise floor, 0.03 to 0.3 of delta = {DELTA_M:g} m, at every T",
            ", ".join(f"{p / DELTA_M:.2f}" for p in plateau) + " delta",
            lambda heights: (heights > 0.03 * DELTA_M).all() and (heights < 0.3 * DELTA_M).all(),
            plateau,
            control="samples without noise",
            faulty=errors(
                experiment,
                over_lambda(experiment.samples(N), experiment.kernel, lam),
                penalties[-1:],
                durations_s=TIMES_S,
            )[0][:, 0, 0],
        ),
    )
    found = constraint.swapaxes(1, 2), state.swapaxes(1, 2)
    return against_penalty("17", "T", np.array(TIMES_S), penalties, found, verdicts)
