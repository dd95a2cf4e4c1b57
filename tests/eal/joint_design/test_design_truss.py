"""Trusses shaped after potentials: a known truss's energy is found again, limits are kept or named."""

from types import SimpleNamespace

import numpy as np
import pytest

from eal.joint_design import (
    DesignError,
    Limits,
    Tolerance,
    Truss,
    design_truss,
    equilibria,
    make_target,
    measure,
    release,
    tolerance_study,
    truss_penalty,
)
from eal.joint_design.design import _without_idle, crossings, with_internal_node
from eal.lagrangian import AnalyticPenalty

LIMITS = Limits(shortest=0.3, longest=4.0, reach=2.2, contraction=0.6, extension=1.2, spacing=0.2)


def known():
    """A truss whose energy is an arc's: a rod of length 1 to the joint, and a cable and a strut at its ends."""
    return Truss(
        fixed_m=np.array([[0.05, 0.0], [1.4, 0.3], [-1.6, 0.9]]),
        internal_m=np.empty((0, 2)),
        ends=np.array([[0, 3], [1, 3], [2, 3]]),
        rest_m=np.array([1.0, 1.7, 1.2]),
        stiffness_n_m=np.array([14.0, 3.0, 4.0]),
        laws=("linear", "cable", "strut"),
    )


def energy_of(truss):
    return lambda q: equilibria(truss, q.reshape(-1, truss.dimension)).energy_j.reshape(q.shape[:-1])


@pytest.fixture(scope="module")
def arc():
    return over_arc(400)


def over_arc(points):
    """The energy of the known truss as a target, over an arc of positions."""
    angle = np.linspace(np.deg2rad(65), np.deg2rad(125), 60)
    return make_target(energy_of(known()), np.stack([np.cos(angle), np.sin(angle)], axis=1), points=points)


@pytest.fixture(scope="module")
def designs(arc):
    return design_truss(arc, LIMITS, rng=np.random.default_rng(4), starts=1)


def test_the_energy_of_a_known_truss_is_found_again(arc, designs):
    """RMS below 0.01 of V = 1 in the region, half-level sets that overlap by 0.95, on a grid that the fit did not see.

    Cells of the finer grid are 2 % of the region wide, hence the overlap.
    """
    finer = make_target(energy_of(known()), arc.q[arc.inside], points=2000)
    fit = measure(designs[0].truss, designs[0].stored, finer)
    assert fit.rms < 0.01
    assert fit.iou[1] > 0.95
    assert fit.r2 > 0.998
    assert len(designs[0].truss.rest_m) <= LIMITS.members


def test_the_same_seed_gives_the_same_truss(arc, designs):
    """Another run with the same generator: to the last bit."""
    again = design_truss(arc, LIMITS, rng=np.random.default_rng(4), starts=1)
    assert np.array_equal(again[0].truss.fixed_m, designs[0].truss.fixed_m)
    assert again[0].truss.laws == designs[0].truss.laws


def test_limits_are_kept(arc, designs):
    """Every length, stretch and place of every design, measured anew from coordinates."""
    region = arc.q[arc.inside]
    for design in designs:
        truss = design.truss
        lengths = np.linalg.norm(region[:, None] - truss.fixed_m[truss.ends[:, 0]], axis=-1)
        pushes = np.array([law != "cable" for law in truss.laws])
        pulls = np.array([law != "strut" for law in truss.laws])
        assert lengths.min() >= LIMITS.shortest
        assert lengths.max() <= LIMITS.longest
        assert np.linalg.norm(truss.fixed_m, axis=1).max() <= LIMITS.reach
        assert ((lengths / truss.rest_m).min(axis=0)[pushes] >= 1 - LIMITS.contraction).all()
        assert ((lengths / truss.rest_m).max(axis=0)[pulls] <= 1 + LIMITS.extension).all()


def test_a_symmetric_design_is_its_own_image(arc):
    """Mirrored at the y axis, its energy is the same everywhere, to rounding; the arc itself is not symmetric."""
    mirror = np.diag([-1.0, 1.0])
    design = design_truss(arc, LIMITS, rng=np.random.default_rng(0), starts=1, mirror=mirror)[0]
    one, other = (equilibria(design.truss, q).energy_j for q in (arc.q, arc.q @ mirror))
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_of_a_mirrored_pair_both_members_are_kept():
    """A cable on the left that the region never stretches, and its image that it does: both stay."""
    ends = np.array([[0, 2], [1, 2]])
    truss = Truss(
        fixed_m=np.array([[-1.0, 0.0], [1.0, 0.0]]), internal_m=np.zeros((0, 2)), ends=ends, laws=("cable", "cable"),
        rest_m=np.ones(2), stiffness_n_m=np.ones(2),
    )  # fmt: skip
    region = SimpleNamespace(q=np.array([[-1.0, 0.5], [-0.9, 0.5]]), inside=np.ones(2, dtype=bool))
    assert len(_without_idle(truss, region).rest_m) == 1
    assert len(_without_idle(truss, region, pairs=True).rest_m) == 2


@pytest.mark.parametrize(
    ("change", "named"),
    [({"longest": 0.45}, "longest"), ({"reach": 0.01, "shortest": 1.5}, "reach"), ({"shortest": 3.9}, "shortest")],
)
def test_what_cannot_be_reached_is_an_error_that_names_the_limit(arc, change, named):
    """A limit that leaves no member at all is found before anything is fitted, and named."""
    limits = Limits(**({"shortest": 0.3, "longest": 4.0, "reach": 2.2} | change))
    with pytest.raises(DesignError, match=f"'{named}'"):
        design_truss(arc, limits, rng=np.random.default_rng(0), starts=1)


def test_too_few_members_are_named():
    """Two members with hardly any reach cannot hold an arc: the message says what reached how far, and what binds."""
    limits = Limits(members=2, shortest=0.3, longest=4.0, reach=2.2, laws=("cable",))
    with pytest.raises(DesignError, match=r"'members' .* binds most"):
        design_truss(over_arc(900), limits, rng=np.random.default_rng(0), starts=1)


def test_a_truss_with_an_internal_node_is_stable_all_over_the_grid(arc):
    """A known truss opened and braced: two members more, an equilibrium at every point, and no members that cross."""
    few = make_target(energy_of(known()), arc.q[arc.inside], points=30)
    opened = with_internal_node(known(), few, np.random.default_rng(1))
    assert len(opened.rest_m) == len(known().rest_m) + 2
    assert measure(opened, 0.0, few).unstable == 0
    assert crossings(known(), few) == 0


def test_a_spatial_truss_is_found_again():
    """In space: three linear members to a point over them; RMS below 0.02 over a region round where they rest."""
    angle = 2 * np.pi * np.arange(3) / 3
    truss = Truss(
        fixed_m=np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3)]),
        internal_m=np.empty((0, 3)),
        ends=np.array([[0, 3], [1, 3], [2, 3]]),
        rest_m=np.full(3, 1.4),
        stiffness_n_m=np.full(3, 9.0),
        laws=("linear",) * 3,
    )
    rest = np.array([0.0, 0.0, np.sqrt(1.4**2 - 1)])
    samples = rest + 0.15 * np.random.default_rng(0).standard_normal((50, 3))
    target = make_target(energy_of(truss), samples, level=0.6, points=200)
    limits = Limits(shortest=0.3, longest=4.0, reach=2.0, laws=("linear",))
    design = design_truss(target, limits, rng=np.random.default_rng(0), starts=1)[0]
    assert design.rms < 0.02


def test_perfect_manufacture_changes_nothing(arc, designs):
    """Without errors the built truss is the design: the study's RMS is the fit's, but for the constant taken out."""
    rms, iou = tolerance_study(
        designs[0].truss, arc, Tolerance(position=0.0, length=0.0, stiffness=0.0), rng=np.random.default_rng(0), draws=2
    )
    fit = measure(designs[0].truss, designs[0].stored, arc)
    assert rms[0] == rms[1] <= fit.rms + 1e-12
    worse, _ = tolerance_study(
        designs[0].truss, arc, Tolerance(position=0.05, length=0.05, stiffness=0.1), rng=np.random.default_rng(0)
    )
    assert np.median(worse) > 2 * rms[0]
    assert iou.min() > 0.9


def test_a_released_mass_keeps_its_energy_and_swings_in_time():
    """On a linear spring pulled along its axis the mass swings as a cosine of omega = sqrt(k), RK4 at 0.02: 1e-6."""
    truss = Truss(
        fixed_m=np.array([[0.0, 0.0]]),
        internal_m=np.empty((0, 2)),
        ends=np.array([[0, 1]]),
        rest_m=np.ones(1),
        stiffness_n_m=np.array([4.0]),
        laws=("linear",),
    )
    everywhere = AnalyticPenalty(
        value=lambda q: np.linalg.norm(q, axis=-1) - 0.5, gradient=lambda q: q, curvature_limit=1.0
    )
    held = truss_penalty(truss, 0.0, equilibria(truss, np.array([[1.2, 0.0], [0.8, 0.0]])))
    run = release(held, everywhere, np.array([[1.2, 0.0]]), np.zeros((1, 2)), level=0.6, duration=5.0, step=0.02)
    np.testing.assert_allclose(run.q[:, 0, 0], 1.0 + 0.2 * np.cos(2.0 * run.t), atol=1e-6)
    assert run.drift < 1e-8
    below = np.mean(1.0 + 0.2 * np.cos(2.0 * run.t) - 0.5 < 0.6)
    assert run.inside == pytest.approx(below, abs=1.5 / len(run.t))
