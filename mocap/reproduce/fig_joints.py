"""Figures 7, 8 and 20: potentials of animal joints, and a free joint confined by one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from eal import bounds
from eal.arrays import Array
from eal.comparison import compare
from eal.integrators import simulate
from eal.kernels import GaussianKernel
from eal.lagrangian import PenalisedModel
from eal.potential import EmpiricalPotential, fit_potential, usual_kernel
from eal.stack import PotentialStack
from eal.systems import free_joint
from mocap.reproduce.draw import landscape, paths
from mocap.reproduce.record import Figure, Verdict, judged, long_table
from mocap.reproduce.samples import elbow_flights

_RANGE = (
    "The normalized empirical function depicts both the range and preferred configurations during this motion regime."
)
_LIZARD = "The qualitative resemblance of the two empirical potential functions is striking."
_PATH = "The penalized models give a good representation; as ε is decreased, the motion remains close to a submanifold."
WIDTH = 8.0
"""Beta in units of 1 / median squared distance: V rises to 1 - 1/e at a quarter of that distance."""
SHUFFLES = 99  # the least p is then 0.01

ENERGY_J, TIME_S = 4.0, 4.0
"""T0 of figure 20: the joint moves along the set to its ends, and even the least 1/eps^2 holds it; and its duration."""


def figure_7(samples_m: Array, *, quick: bool, name: str = "7") -> Figure:
    """The bat's joint; a real one under another name."""
    return _landscape(name, samples_m, "bat, wrist about elbow", quick=quick)


def figure_8(samples_m: Array, *, quick: bool, flights_deg: Mapping[str, Sequence[Array]] | None = None) -> Figure:
    """The lizard's joint, and its elbow beside that of bats.

    Args:
        samples_m: (N, 2) samples of the lizard in metres.
        quick: Coarser map.
        flights_deg: (N, 1) angles of the elbow in degrees, for ``bat`` and ``lizard`` a trial each; None: the
            built-in animals.
    """
    flights_deg = elbow_flights() if flights_deg is None else flights_deg
    figure = _landscape("8", samples_m, "lizard, wrist about elbow", quick=quick)
    return replace(figure, verdicts=(*figure.verdicts, *_alike(flights_deg)))


def _alike(flights_deg: Mapping[str, Sequence[Array]]) -> tuple[Verdict, ...]:
    """Elbows of bats and lizards: alike in their range, and yet different."""
    bats, lizards = flights_deg["bat"], flights_deg["lizard"]
    rng = np.random.default_rng(0)
    noise = [rng.uniform(-180.0, 180.0, trial.shape) for trial in lizards]
    found = compare(bats, lizards, names=["elbow"], units=["°"])
    return (
        judged(
            _LIZARD,
            f"the elbow's ranges in {len(bats)} flights of bats and {len(lizards)} walks of lizards overlap by half",
            found.lines()[1],
            lambda both: both.overlap[0] > 0.5,
            found,
            control="noise in the place of the lizard",
            faulty=compare(bats, noise),
        ),
        judged(
            _LIZARD,
            "yet they differ: the two kinds lie farther apart than flights and walks of one kind (p at most 0.05)",
            found.lines()[0],
            lambda both: both.p_value <= 0.05,
            found,
            control="the bats' flights in two groups",
            faulty=compare(bats[::2], bats[1::2]),
        ),
    )


def joint_potential(samples_m: Array, *, lam: float = 1e-3, widths: float = 1.0) -> tuple[EmpiricalPotential, float]:
    """V of the coordinates divided by their median distance, and that distance in metres.

    Args:
        samples_m: (N, 2) samples in metres.
        lam: lambda.
        widths: Of the kernel, in units of its own.

    Returns:
        The potential in scaled coordinates, and the metres of one unit.
    """
    scale = 1.0 / np.sqrt(usual_kernel(samples_m, width=1.0).beta)
    return fit_potential(samples_m / scale, kernel=GaussianKernel(WIDTH / widths**2), lam=lam, accuracy=1e-3), float(
        scale
    )


def _landscape(name: str, samples_m: Array, title: str, *, quick: bool) -> Figure:
    low, high = samples_m.min(axis=0), samples_m.max(axis=0)
    margin = 0.4 * float((high - low).max())
    x, y = (np.linspace(a - margin, b + margin, 60 if quick else 120) for a, b in zip(low, high, strict=True))
    v = _map(samples_m, x, y, widths=1.0)
    return Figure(
        name=name,
        table=long_table({"q2": y, "q1": x}, value=v),
        verdicts=joint_verdicts(samples_m, x, y, v, most=np.inf if name.endswith("_real") else 0.008),
        draw=lambda canvas: landscape(
            canvas, 1e3 * x, 1e3 * y, v, 1e3 * samples_m, unit="mm", title=f"Fig. {name}: {title}, N = {len(samples_m)}"
        ),
    )


def _map(samples_m: Array, x: Array, y: Array, *, widths: float) -> Array:
    """(len(y), len(x)) V over the map, of a kernel so many times as wide."""
    potential, scale = joint_potential(samples_m, widths=widths)
    return potential.value(np.stack(np.meshgrid(x, y), axis=-1) / scale)


def joint_verdicts(samples_m: Array, x: Array, y: Array, v: Array, *, most: float = 0.008) -> tuple[Verdict, ...]:
    """What a map of a joint must show, whichever the joint: a valley, as wide as the kernel.

    Args:
        samples_m: (N, 2) samples in metres, in the order of time.
        x: (n,) first coordinate of the map, in metres.
        y: (m,) second coordinate.
        v: (m, n) the map.
        most: What V of the second half is at most; infinite: nothing is known of it.
    """
    rng = np.random.default_rng(0)
    shuffled = np.stack([samples_m[rng.permutation(len(samples_m)), j] for j in range(2)], axis=1)
    distance = _rise(samples_m, x, y, v)
    low = f", and at most {most:g}, eight times lambda" if np.isfinite(most) else ""
    return (
        judged(
            _RANGE,
            "the samples are a valley: learned from their first half, V is on average lower at the second half than it "
            f"is with their coordinates shuffled, in each of {SHUFFLES} ways{low}",
            "V {:.2g}, shuffled at least {:.2g}".format(*_valley(samples_m)),
            lambda levels: levels[0] < min(levels[1], most),
            _valley(samples_m),
            control="samples whose coordinates are shuffled: no valley is left",
            faulty=_valley(shuffled),
        ),
        judged(
            _RANGE,
            "on the map V rises to 1 - 1/e at a quarter of the samples' median distance from the nearest of them, "
            "within a factor of the square root of 2",
            f"{4.0 * distance:.2f} quarters",
            lambda rise: np.sqrt(0.5) < 4.0 * rise < np.sqrt(2.0),
            distance,
            control="a kernel twice as wide",
            faulty=_rise(samples_m, x, y, _map(samples_m, x, y, widths=2.0)),
        ),
    )


def _valley(samples_m: Array) -> tuple[float, float]:
    """Mean V at the second half of the samples, and the least of means with their coordinates shuffled."""
    half = len(samples_m) // 2
    potential, scale = joint_potential(samples_m[:half])
    rest, rng = samples_m[half:] / scale, np.random.default_rng(1)
    shuffled = np.stack([np.column_stack([rest[:, 0], rng.permutation(rest[:, 1])]) for _ in range(SHUFFLES)])
    return float(potential.value(rest).mean()), float(potential.value(shuffled).mean(axis=1).min())


def _rise(samples_m: Array, x: Array, y: Array, v: Array) -> float:
    """Median distance to the nearest sample where a map passes 1 - 1/e, in median distances of the samples."""
    edge = np.abs(v - (1.0 - np.exp(-1.0))) < 0.1  # some cells to either side of the line
    if not edge.any():
        return 0.0
    distance, _ = KDTree(samples_m).query(np.stack(np.meshgrid(x, y), axis=-1)[edge])
    return float(np.median(distance)) * np.sqrt(usual_kernel(samples_m, width=1.0).beta)


def figure_20(samples_m: Array, *, quick: bool) -> Figure:  # noqa: ARG001
    """A free joint started along the lizard's samples: distance to them against 1/eps^2 and lambda.

    Coordinates are scaled by the median distance; in them m = 1 kg; 1/eps^2 confines above T0.
    """
    lams, penalties = np.array([1e-2, 1e-3, 1e-4]), np.logspace(1.0, 3.5, 6)
    potential, scale = joint_potential(samples_m, lam=float(lams.min()))
    z = samples_m / scale
    start, along = _start(potential, z)
    members = [potential.with_lambda(float(lam)) for lam in lams]
    model = PenalisedModel(
        system=free_joint(),
        penalty=PotentialStack(members),
        strength=np.broadcast_to(penalties, (len(lams), len(penalties))),
    )
    run = simulate(model, start, np.sqrt(2.0 * ENERGY_J) * along, duration_s=TIME_S, h_s=2e-3, every=5)
    loose = PenalisedModel(system=free_joint(), penalty=potential, strength=penalties[:1])
    thrown = simulate(loose, start, np.sqrt(20.0 * ENERGY_J) * along, duration_s=TIME_S, h_s=2e-3, every=5)
    distance, _ = KDTree(z).query(run.q)
    mean = scale * distance.mean(axis=0)
    floor = np.array([[float(member.value(start))] for member in members])
    four_joules = bounds.theorem3(penalties, value0=floor, kinetic0=4.0, potential0=0.0, potential_min=0.0)
    reached = model.penalty.value(run.q.swapaxes(0, 1)).max(axis=1) / four_joules
    falls = mean[:, 0] / mean[:, 2], mean[:, -3] / mean[:, -1]
    verdicts = (
        *_landscape("20", samples_m, "lizard", quick=True).verdicts,
        judged(
            _PATH,
            "the mean distance to the samples falls with 1/eps^2 for every lambda",
            "; ".join(f"{1e3 * m[0]:.2g} to {1e3 * m[-1]:.2g} mm" for m in mean),
            lambda errors: np.all(errors[:, -1] < errors[:, 0]),
            mean,
            control="1/eps^2 in the wrong order",
            faulty=mean[:, ::-1],
        ),
        judged(
            _PATH,
            "it levels off at the width of the cloud: the last decade of 1/eps^2 gains less than the first",
            ", ".join(f"{a:.2g} then {b:.2g} times" for a, b in zip(*falls, strict=True)),
            lambda gains: np.all(gains[1] < gains[0]),
            falls,
            control="1/eps^2 in the wrong order",
            faulty=falls[::-1],
        ),
        judged(
            _PATH,
            "thrown along the valley with 4 J, V stays below V(q0) + 4 J eps^2 (theorem 3, to 1 % for the integrator) "
            "and reaches 0.8 of it, where the valley ends",
            f"{reached.min():.2f} to {reached.max():.2f} of it: {1.0 / reached.min():.2f} times loose at most",
            lambda shares: shares.min() > 0.8 and shares.max() < 1.01,
            reached,
            control="ten times the energy",
            faulty=potential.value(thrown.q).max(axis=0) / four_joules[-1, :1],
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
