"""Each threshold of the design of joints, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from eal.joint_design import DesignError, Truss, design, equilibria, equilibrium, path


def truss(*stiffness):
    """Linear members of length 1 to the moving point, from fixed nodes of their own."""
    count = len(stiffness)
    return Truss(
        fixed_m=np.stack([np.cos(np.arange(count)), np.sin(np.arange(count))], axis=1),
        internal_m=np.empty((0, 2)),
        ends=np.column_stack([np.arange(count), np.full(count, count)]),
        rest_m=np.ones(count),
        stiffness_n_m=np.array(stiffness, dtype=float),
        laws=("linear",) * count,
    )


def designed(monkeypatch, found, **options):
    """What is made of trusses of (members, RMS, overlap), of which a start finds three."""
    left, alphas = iter(found), []

    def sparse(_target, _offered, *, alpha, **_):
        alphas.append(alpha)
        members, rms, overlap = next(left)
        return SimpleNamespace(rest_m=np.ones(members), fit=SimpleNamespace(rms=rms, iou=(1.0, overlap, 1.0))), 0.0

    for name in ("fixed_nodes", "candidates", "with_members", "_what_binds", "_broken_limit"):
        monkeypatch.setattr(design, name, lambda *_, **__: None)
    monkeypatch.setattr(design, "sparse", sparse)
    monkeypatch.setattr(design, "refine", lambda _target, one, stored, *_, **__: (one, stored))
    monkeypatch.setattr(design, "_without_idle", lambda truss, _target, **_: truss)
    monkeypatch.setattr(design, "measure", lambda truss, *_: truss.fit)
    target, limits = SimpleNamespace(q=np.zeros((1, 2))), SimpleNamespace(members=10)
    rng = np.random.default_rng(0)
    kept = design.design_truss(target, limits, rng=rng, starts=len(found) // 3, **options)
    return [len(one.truss.rest_m) for one in kept], alphas


@pytest.mark.parametrize(
    ("rms", "order"),
    [((0.05, 0.0545, 0.056), [4, 5, 3]), ((0.095, 0.099, 0.104), [4, 5, 3]), ((0.2, 0.21, 0.19), [3, 5, 4])],
)
def test_fewer_members_are_taken_within_a_tenth_and_where_the_goal_is_reached(monkeypatch, rms, order):
    """RMS of trusses of 5, 4 and 3 members: 1.1 of the least, and no more than 0.1 unless none reaches that."""
    assert designed(monkeypatch, [(5 - i, one, 0.9) for i, one in enumerate(rms)])[0] == order


@pytest.mark.parametrize(("overlap", "refused"), [(0.45, True), (0.55, False)])
def test_a_design_overlaps_the_half_level_by_half(monkeypatch, overlap, refused):
    """The best of three, of which one overlaps more."""
    found = [(5, 0.1, overlap), (5, 0.2, 0.9), (5, 0.3, 0.1)]
    if refused:
        with pytest.raises(DesignError):
            designed(monkeypatch, found)
    else:
        assert len(designed(monkeypatch, found)[0]) == 3


def test_weights_of_stiffnesses_are_drawn_over_a_decade(monkeypatch):
    """300 of a uniform logarithm come within a hundredth of a decade of both ends, by odds of 20 to 1."""
    drawn = np.log10(designed(monkeypatch, [(5, 0.1, 0.9)] * 900)[1])
    np.testing.assert_allclose([drawn.min(), drawn.max()], np.log10([3e-4, 3e-3]), atol=0.01)


def test_idle_members_hold_less_than_a_hundredth(monkeypatch):
    """Stretched by a tenth they hold k / 200 at most: 0.009 and 0.012 of V = 1."""
    one = truss(1.8, 2.4)
    monkeypatch.setattr(design, "over_grid", lambda *_: SimpleNamespace(stretch=np.array([[1.0, 1.0], [1.1, 1.1]])))
    kept = design._without_idle(one, SimpleNamespace(inside=np.array([True, True])))
    assert kept.stiffness_n_m.tolist() == [2.4]


@pytest.mark.parametrize(("step", "found"), [(0.9e-9, True), (1.2e-9, False)])
def test_an_equilibrium_is_found_where_steps_are_a_billionth(monkeypatch, step, found):
    """Of the largest rest length, 1."""
    monkeypatch.setattr(equilibrium, "_solver", lambda q, *_: [np.zeros((len(q), 12))] * 6 + [np.full(len(q), step)])
    assert equilibria(truss(1.0), np.zeros((1, 2))).found.tolist() == [found]


@pytest.mark.parametrize(("shortest", "snaps"), [(2.0**-23, []), (2.0**-24, [1e-6])])
def test_a_branch_ends_where_steps_are_a_ten_millionth(monkeypatch, shortest, snaps):
    """2^-23 = 1.2e-7 of a segment is long enough. Where a branch ends, the next begins ten such steps further on."""
    zero, ways = np.zeros((1, 2)), []

    def predicted(_q, way, x, _p):
        ways.append(float(way.max()))
        return x, x, 0.0 if min(ways) <= shortest or len(ways) > 26 else 1.0, 1.0

    monkeypatch.setattr(path, "_predicted", predicted)
    monkeypatch.setattr(path, "_fall", lambda _truss, _q, x, *_: (ways.append(0.0) or x, 0.0))
    found = path._segment(truss(1.0), zero[0], np.ones(2), zero, 0)[1]
    np.testing.assert_allclose([snap.at for snap in found], snaps)
