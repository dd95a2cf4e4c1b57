"""Figures 7, 8 and 20: potentials of animal joints, and a free joint confined by one."""

import numpy as np
from scipy.spatial import KDTree

from eal import EmpiricalPotential, GaussianKernel, fit_potential, usual_kernel
from eal.arrays import Array
from eal.integrators import simulate
from eal.lagrangian import PenalisedModel
from eal.stack import PotentialStack
from eal.systems import free_joint
from mocap.reproduce.draw import landscape, paths
from mocap.reproduce.record import Figure, Verdict, long_table

_RANGE = (
    "The normalized empirical function depicts both the range and preferred configurations during this motion regime."
)
_LIZARD = "The qualitative resemblance of the two empirical potential functions is striking."
_PATH = "The penalized models give a good representation; as ε is decreased, the motion remains close to a submanifold."
WIDTH = 8.0
"""Beta in units of 1 / median squared distance: a kernel a third as wide as the range of the joint."""


ENERGY_J, TIME_S = 4.0, 4.0
"""T0 of figure 20: above the wells in the floor of V, so that the joint moves along the set; and its duration."""


def figure_7(samples_m: Array, *, quick: bool, name: str = "7") -> Figure:
    """The bat's joint; a real one under another name."""
    return _landscape(name, samples_m, _RANGE, "bat, wrist about elbow", quick=quick)


def figure_8(samples_m: Array, *, quick: bool) -> Figure:
    """The lizard's joint."""
    return _landscape("8", samples_m, _LIZARD, "lizard, wrist about elbow", quick=quick)


def joint_potential(samples_m: Array, *, lam: float = 1e-3) -> tuple[EmpiricalPotential, float]:
    """V of the coordinates divided by their median distance, and that distance in metres.

    Args:
        samples_m: (N, 2) samples in metres.
        lam: lambda.

    Returns:
        The potential in scaled coordinates, and the metres of one unit.
    """
    scale = 1.0 / np.sqrt(usual_kernel(samples_m, width=1.0).beta)
    return fit_potential(samples_m / scale, kernel=GaussianKernel(WIDTH), lam=lam, accuracy=1e-3), float(scale)


def _landscape(name: str, samples_m: Array, sentence: str, title: str, *, quick: bool) -> Figure:
    potential, scale = joint_potential(samples_m)
    half, half_scale = joint_potential(samples_m[: len(samples_m) // 2])
    low, high = samples_m.min(axis=0), samples_m.max(axis=0)
    margin = 0.4 * float((high - low).max())
    x, y = (np.linspace(a - margin, b + margin, 60 if quick else 120) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    v = potential.value(grid / scale)
    corners = float(potential.value(grid[[0, 0, -1, -1], [0, -1, 0, -1]] / scale).min())
    a = potential.kernel.gram(grid.reshape(-1, 2) / scale, potential.centres) @ potential.root
    least = float((1.0 - np.einsum("nr,nr->n", a, a)).min())
    on_data = float(np.quantile(potential.value(samples_m / scale), 0.95))
    held_out = float(np.mean(half.value(samples_m[len(samples_m) // 2 :] / half_scale) < 0.1))
    verdicts = (
        Verdict(
            figure=name,
            sentence=sentence,
            claim="V is below 0.1 on 95 % of the samples and above 0.9 in the corners of the map, and before rounding "
            "is cut nowhere below -1e-6",
            measured=f"95 % quantile {on_data:.2g}, corners {corners:.3f}, least {least:.2g}",
            holds=bool(on_data < 0.1 and corners > 0.9 and least > -1e-6),
        ),
        Verdict(
            figure=name,
            sentence=sentence,
            claim="learned from the first half of the samples, V is below 0.1 on most of the second half",
            measured=f"{100 * held_out:.0f} %",
            holds=held_out > 0.5,
        ),
    )
    table = long_table({"q2": y, "q1": x}, value=v)
    return Figure(
        name=name,
        table=table,
        verdicts=verdicts,
        draw=lambda canvas: landscape(
            canvas, 1e3 * x, 1e3 * y, v, 1e3 * samples_m, unit="mm", title=f"Fig. {name}: {title}, N = {len(samples_m)}"
        ),
    )


def figure_20(samples_m: Array, *, quick: bool) -> Figure:  # noqa: ARG001
    """A free joint started along the lizard's samples: distance to them against 1/eps^2 and lambda.

    Coordinates are scaled by the median distance; in them m = 1 kg; 1/eps^2 confines above T0.
    """
    lams, penalties = np.array([1e-2, 1e-3, 1e-4]), np.logspace(1.0, 3.5, 6)
    potential, scale = joint_potential(samples_m, lam=float(lams.min()))
    z = samples_m / scale
    start, along = _start(potential, z)
    model = PenalisedModel(
        system=free_joint(),
        penalty=PotentialStack([potential.with_lambda(float(lam)) for lam in lams]),
        strength=np.broadcast_to(penalties, (len(lams), len(penalties))),
    )
    run = simulate(model, start, np.sqrt(2.0 * ENERGY_J) * along, duration_s=TIME_S, h_s=2e-3, every=5)
    distance, _ = KDTree(z).query(run.q)
    mean = scale * distance.mean(axis=0)
    first, last = np.log(mean[:, 0] / mean[:, 2]), np.log(mean[:, -3] / mean[:, -1])
    verdicts = (
        Verdict(
            figure="20",
            sentence=_PATH,
            claim="the mean distance to the samples falls with 1/eps^2 for every lambda",
            measured="; ".join(f"{1e3 * m[0]:.2g} to {1e3 * m[-1]:.2g} mm" for m in mean),
            holds=bool(np.all(mean[:, -1] < mean[:, 0])),
        ),
        Verdict(
            figure="20",
            sentence=_PATH,
            claim="it levels off at the width of the cloud: the last decade of 1/eps^2 gains less than the first",
            measured=", ".join(f"{np.exp(a):.2g} then {np.exp(b):.2g} times" for a, b in zip(first, last, strict=True)),
            holds=bool(np.all(last < first)),
        ),
    )
    table = long_table({"lambda": lams, "penalty": penalties}, constraint_error=mean)
    rows = len(table["lambda"])
    table |= {"T": np.full(rows, TIME_S), "N": np.full(rows, float(len(z)))}
    shown = [0, len(penalties) // 2, len(penalties) - 1]
    runs = [(f"1/ε² = {penalties[j]:.2g}, λ = {lams[1]:.0e}", 1e3 * scale * run.q[:, 1, j]) for j in shown]
    return Figure(
        name="20",
        table=table,
        verdicts=verdicts,
        draw=lambda canvas: paths(canvas, 1e3 * samples_m, runs, unit="mm", title="Fig. 20: wrist about elbow, lizard"),
    )


def _start(potential: EmpiricalPotential, z: Array) -> tuple[Array, Array]:
    """The sample in the middle of the cloud, and the direction of the valley there."""
    start = z[int(np.argmin(((z - np.median(z, axis=0)) ** 2).sum(axis=1)))]
    _, vectors = np.linalg.eigh(potential.hessian(start))
    return start, vectors[:, 0]
