"""The figures of the paper: files, columns, verdicts, and the reference numbers through the public entry."""

import csv
import json
from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas

from mocap.reproduce import FIGURES, fig_joints, reproduce, sweep
from mocap.reproduce.fig_balance import figure_11, figure_19c, v_verdicts
from mocap.reproduce.fig_joints import figure_7, figure_8, figure_20, joint_potential
from mocap.reproduce.fig_penalty import figure_19a
from mocap.reproduce.figures import ELSEWHERE
from mocap.reproduce.record import long_table
from mocap.reproduce.samples import wrist_about_elbow
from mocap.reproduce.sweep import planar, spherical
from mocap.reproduce.theorems import circle_draws
from tests.reference import circle


@pytest.fixture(scope="module")
def arcs():
    """A bend of 2 rad about the origin at 11 mm, 0.1 mm of noise: a wrist about its elbow."""
    rng = np.random.default_rng(3)
    angle = 1.5 + np.sin(np.linspace(0, 12, 300))
    radius = 0.011 + 1e-4 * rng.standard_normal(300)
    z = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return {"bat": 4 * z, "lizard": z}


@pytest.fixture
def coarser(monkeypatch):
    """Steps of RK4 twice as long, which 1/eps^2 up to 1e6 still bears (the limit is 3e6): half the time."""
    monkeypatch.setattr(sweep, "STEP_S", 2e-4)


@pytest.mark.main
@pytest.mark.usefixtures("coarser")
def test_figures_are_written_with_verdicts(arcs, tmp_path):
    """Pictures, tables and verdicts.json for a figure of each kind; nothing half-written stays."""
    lines = []
    verdicts = reproduce(["14a", "fig12", "7"], tmp_path, True, lines.append, samples_m=arcs)
    names = {"fig14a.png", "fig14a.csv", "fig12.png", "fig12.csv", "fig7.png", "fig7.csv"}
    names |= {"verdicts.json", "figures.md"}
    assert {p.name for p in tmp_path.iterdir()} == names
    stored = json.loads((tmp_path / "verdicts.json").read_text(encoding="utf-8"))
    assert [v["claim"] for v in stored] == [v.claim for v in verdicts]
    assert all(v.line() in lines for v in verdicts)
    with (tmp_path / "fig14a.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert set(rows[0]) == {"lambda", "penalty", "seed", "constraint_error", "state_error", "T", "N", "delta"}
    small = [float(r["constraint_error"]) for r in rows if float(r["lambda"]) == 1e-7 and float(r["penalty"]) == 1e6]
    assert small == [pytest.approx(8.17e-7, rel=0.05)]
    assert all(v.refused for v in verdicts)
    held = {v.figure: [w.holds for w in verdicts if w.figure == v.figure] for v in verdicts}
    assert held == {"14a": [True, True, True, False, True], "12": [True], "7": [True, True]}


@pytest.mark.usefixtures("coarser")
def test_figure_13_has_the_reference_numbers(tmp_path):
    """Sup |r-1| = 1.84e-5 m, energy drift 9e-8 J (one digit), theta off by 2.4, 0.04, 1.8e-4 rad."""
    verdicts = reproduce(["13"], tmp_path, True)
    assert all(v.refused for v in verdicts)
    table = np.genfromtxt(tmp_path / "fig13.csv", delimiter=",", names=True)
    for lam, expected in ((1e-6, 2.4), (1e-8, 0.04), (1e-10, 1.8e-4)):
        rows = np.isclose(table["lambda"], lam, atol=0)
        assert table["state_error"][rows].max() == pytest.approx(expected, rel=0.05)
        assert table["constraint_error"][rows].max() == pytest.approx(1.84e-5, rel=0.05)
    assert [v.holds for v in verdicts] == [True, True, False, True]


@pytest.mark.main
def test_figure_20_confines_a_free_joint(arcs):
    figure = figure_20(arcs["lizard"], quick=True)
    assert all(v.holds and v.refused for v in figure.verdicts)


def test_figure_20_notices_less_energy(arcs, monkeypatch):
    """V no longer reaches what 4 J are worth: the bound, whose control is more energy, is not all that is looked at."""
    monkeypatch.setattr(fig_joints, "ENERGY_J", 0.4)
    monkeypatch.setattr(fig_joints, "TIME_S", 1.0)
    assert not figure_20(arcs["lizard"], quick=True).verdicts[-1].holds


def test_maps_of_joints_notice_a_narrower_kernel(arcs, monkeypatch):
    """V rises elsewhere: the second verdict of figures 7, 8 and 20, whose control is a wider one."""
    monkeypatch.setattr(fig_joints, "WIDTH", 4.0 * fig_joints.WIDTH)
    assert [v.holds for v in figure_7(arcs["bat"], quick=True).verdicts][1] is False


def test_maps_of_joints_notice_another_lambda(arcs, monkeypatch):
    """Ten times as large V is that much higher in the valley: the first verdict of figures 7, 8 and 20."""
    monkeypatch.setattr(fig_joints, "joint_potential", partial(fig_joints.joint_potential, lam=1e-2))
    assert [v.holds for v in figure_7(arcs["bat"], quick=True).verdicts] == [False, True]


def test_maps_of_joints_notice_what_is_no_joint(arcs, rng):
    """Coordinates shuffled each by itself; noise in the place of the lizard."""
    z = arcs["lizard"]
    shuffled = np.column_stack([rng.permutation(column) for column in z.T])
    noise = rng.uniform(z.min(axis=0), z.max(axis=0), z.shape)
    assert all(v.holds for v in figure_7(z, quick=True).verdicts)
    assert not figure_7(shuffled, quick=True).verdicts[0].holds
    assert not figure_7(noise, quick=True).verdicts[0].holds
    x, y = (np.linspace(a - 0.004, b + 0.004, 60) for a, b in zip(z.min(axis=0), z.max(axis=0), strict=True))
    v = fig_joints._map(z, x, y, widths=1.0)
    assert [one.holds for one in fig_joints.joint_verdicts(z, x, y, v)] == [True, True]
    assert not fig_joints.joint_verdicts(z, x, y, v.T)[1].holds


@pytest.mark.main
def test_figure_8_compares_trials(arcs):
    """Ranges of 90 to 110 and 95 to 115 degrees: alike and different; of one kind: alike and not different."""
    rng = np.random.default_rng(5)

    def trials(middle, count=8):
        return [(m + 10.0 * np.sin(np.linspace(0, 9, 60)))[:, None] for m in rng.normal(middle, 1.0, count)]

    found = figure_8(arcs["lizard"], quick=True, flights_deg={"bat": trials(100.0), "lizard": trials(105.0)})
    assert all(v.holds and v.refused for v in found.verdicts)
    same = figure_8(arcs["lizard"], quick=True, flights_deg={"bat": trials(100.0), "lizard": trials(100.0)})
    assert [v.holds for v in same.verdicts[-2:]] == [True, False]


OTHERS = ("3", "6", "14b", "15a", "15b", "16", "17", "18", "19b", "8")


@pytest.mark.usefixtures("coarser")
def test_every_verdict_refuses_its_negative_control(tmp_path, monkeypatch):
    """The other figures in tests of their own. A test that refuses nothing would pass whatever came.

    Each is laid out, but no picture is made of it: that takes a quarter of the time.
    """
    monkeypatch.setattr(Canvas, "savefig", lambda *_: None)
    verdicts = reproduce(OTHERS, tmp_path, True)
    assert [v.control for v in verdicts if not v.refused] == []
    assert [v.holds for v in verdicts if v.figure == "16"] == [True, False]
    assert all(v.control for v in verdicts)
    stored = json.loads((tmp_path / "verdicts.json").read_text(encoding="utf-8"))
    assert all(v["refused"] and v["control"] for v in stored)


@pytest.mark.usefixtures("coarser")
@pytest.mark.parametrize(("figure", "whole"), [(figure_11, [17, 4, 5]), (figure_19c, [9, 3, 3])])
def test_the_v_does_not_change_with_quick(figure, whole):
    """Its minima are found on the whole grid, of all seeds: nothing that a verdict rests on is left out."""
    quick = figure(quick=True)
    axes = [len(np.unique(quick.table[name])) for name in ("lambda", "penalty", "seed")]
    assert axes == whole
    assert all(v.refused for v in quick.verdicts)


@pytest.mark.main
def test_unknown_figures_are_refused(tmp_path):
    with pytest.raises(ValueError, match="there is no figure '9': the figures are 3, 6, 7, 8, 11"):
        reproduce(["9"], tmp_path)
    with pytest.raises(ValueError, match="spans_s must be times above 0 s"):
        reproduce(["19a"], tmp_path, spans_s=(1.0, 0.0))
    assert len(FIGURES) == 21


def test_every_figure_of_the_paper_is_made_or_is_said_to_be_elsewhere():
    """Figures 1 to 20, each once."""
    numbers = {int("".join(c for c in name if c.isdigit())) for name in (*FIGURES, *ELSEWHERE) if "theorem" not in name}
    assert numbers == set(range(1, 21))
    assert not set(FIGURES) & set(ELSEWHERE)


def test_figure_19a_is_over_the_spans_asked_for():
    """Over 1 s the plateau at lambda = 1e-4 and 1/eps^2 = 1e6 is 1.08e-3 m, over 10 s 3.8e-4 to 4.5e-4 m."""
    figure = figure_19a(quick=True, spans_s=(1.0, 10.0))
    at = np.isclose(figure.table["lambda"], 1e-4, atol=0) & (figure.table["penalty"] == 1e6)
    found = dict(zip(figure.table["span_s"][at], figure.table["constraint_error"][at], strict=True))
    assert found[1.0] == pytest.approx(1.08e-3, rel=0.02)
    assert 3.7e-4 < found[10.0] < 4.6e-4
    assert all(v.refused for v in figure.verdicts)
    assert [v.claim.split(":")[0] for v in figure.verdicts] == ["samples over 1 s"] * 2 + ["samples over 10 s"] * 2


@pytest.mark.usefixtures("coarser")
def test_verdicts_on_the_theorems(tmp_path):
    """As printed theorems 1 and 3 do not hold, as corrected they do; V_j of the circle is the closed form's."""
    verdicts = reproduce(["theorem1", "theorem2", "theorem3"], tmp_path, True)
    assert [v.holds for v in verdicts] == [False, True, True, True, False, True]
    assert all(v.refused for v in verdicts)  # an exponent 32 times tighter, C = 0.5, a tenth of the bound
    assert ["loose" in v.measured for v in verdicts] == [False, True, False, True, False, True]
    gap, deviations = circle_draws(24)
    sigma = circle.eigenvalues(1.0)
    assert gap == pytest.approx(sigma[2] - sigma[3], rel=1e-6)
    assert deviations.shape == (3, 24)
    assert (tmp_path / "theorem3.png").exists()
    assert "Theorem 3: theorem3.png, theorem3.csv; 1 of 2 claims hold" in (tmp_path / "figures.md").read_text()


@pytest.mark.main
def test_verdicts_can_fail():
    """The V of figure 11 with its minimum at a larger lambda for the smallest eps, and with a flat right arm."""
    lams, penalties = np.logspace(-1, -9, 17), np.array([1e3, 1e4, 1e5, 1e6])

    def judged(best, power):
        away = np.abs(np.log10(lams)[:, None] - np.log10(best))
        curves = 1e-5 * np.where(lams[:, None] > best, (lams[:, None] / best) ** power, 10 ** (0.3 * away))
        return [v.holds for v in v_verdicts(lams, penalties, curves[:, :, None])]

    good = np.array([1e-3, 1e-4, 1e-4, 1e-4])
    assert judged(good, 1.0) == [True, True, True]
    assert judged(good, 0.5) == [True, False, True]
    assert judged(np.array([1e-3, 1e-4, 1e-5, 1e-6]), 1.0) == [True, True, False]  # never stays
    assert judged(np.array([1e-4, 1e-3, 1e-5, 1e-5]), 1.0) == [True, True, False]  # moves back


def test_tables_run_over_the_grid():
    """The last axis runs fastest."""
    table = long_table({"a": np.array([1.0, 2.0]), "b": np.array([3.0, 4.0])}, c=np.array([[5.0, 6.0], [7.0, 8.0]]))
    assert {k: v.tolist() for k, v in table.items()} == {"a": [1, 1, 2, 2], "b": [3, 4, 3, 4], "c": [5, 6, 7, 8]}


def test_the_wrist_is_measured_in_the_plane_of_the_arm(rng):
    """Turning and moving the animal changes nothing; a right angle at the elbow is (0, forearm)."""
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    points = np.array([[[0.0, 0.0, 0.0]], [[0.02, 0.0, 0.0]], [[0.02, 0.0, 0.011]]])
    moved = (points @ turn.T + [0.3, -0.1, 2.0]).swapaxes(0, 1)
    arm = ("shoulder", "elbow", "wrist")
    np.testing.assert_allclose(wrist_about_elbow(moved, arm, arm), [[0.0, 0.011]], atol=1e-15)


@pytest.mark.parametrize("experiment", [planar(), spherical()], ids=["planar", "spherical"])
def test_samples_are_of_the_true_motion(experiment):
    """Exact samples satisfy the constraint to the spline's 1e-8; noise of width delta is uniform: delta^2/12."""
    assert experiment.violation(experiment.samples(300)).max() < 1e-8
    noisy = experiment.samples(4000, delta=0.01, rng=np.random.default_rng(1)) - experiment.samples(4000)
    assert np.abs(noisy).max() <= 0.005
    assert noisy[:, : experiment.noisy].var() == pytest.approx(0.01**2 / 12, rel=0.1)
    assert (noisy[:, experiment.noisy :] == 0).all()


def test_joint_potential_does_not_know_the_unit(arcs):
    """Samples in millimetres give the same V at the same places."""
    one, scale = joint_potential(arcs["lizard"])
    two, bigger = joint_potential(1000 * arcs["lizard"])
    q = arcs["lizard"][:20] * 1.1
    assert bigger == pytest.approx(1000 * scale)
    np.testing.assert_allclose(two.value(1000 * q / bigger), one.value(q / scale), atol=1e-6)
