"""Figures and the report of one file."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mocap.datasets.bats import bat_motion, make_bat

from mocap.cleaning.cleaned import Cleaned
from mocap.errors import MocapError
from mocap.findings import Finding, Kind
from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycles import cycles
from mocap.kinematics.extremes import cycle_statistics
from mocap.kinematics.records import DOUBTFUL, Quantity
from mocap.plots.figures import Picture
from mocap.plots.kinematics import LEAVES, label, lines_over_time, new_axes, plot_gaps, sensible
from mocap.plots.page import _peaks, report_page
from mocap.records import Status
from mocap.results.tracked import Tracked
from mocap.text import plain
from mocap.tracking.report_part import Report
from tests.mocap.kinematics.test_cycles import exact
from tests.mocap.rerun.flapping import make_run

INK = True
"""These tests look at what is drawn (tests/mocap/conftest.py)."""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    result = Tracked.of(make_run(n_frames=60))
    result.write_kinematics(folder)
    return result, folder


def test_the_report_has_the_peaks_of_counted_cycles():
    """Those of ``cycle_statistics``, a row a joint and limb, largest range first; without a doubtful beat."""
    skeleton = make_bat(seed=0, n_frames=2, n_cameras=2).skeleton
    motion = exact(bat_motion(0), skeleton, np.arange(240) / 240.0)
    found = kinematics(motion, skeleton)
    rows = cycles(found, motion, skeleton)
    table = _peaks(SimpleNamespace(skeleton=skeleton), found, [replace(rows[0], status=DOUBTFUL), *rows[1:]])
    elbow = next(line for line in table["lines"] if line[:2] == ["left elbow", "left wing"])
    own = cycle_statistics(found, [row for row in rows[1:] if row.of == "wing_l"], "elbow_l_flexion_deg")
    peaks = own[own["statistic"] == "peak"]["value"]
    assert elbow[2] == str(len(peaks))
    assert elbow[3] == f"{peaks.mean():.1f} ± {peaks.std():.2g}"
    ranges = [float(line[6].split(" ")[0]) for line in table["lines"]]
    assert ranges == sorted(ranges, reverse=True)
    assert _peaks(SimpleNamespace(skeleton=skeleton), found, []) is None


@pytest.mark.slow
def test_pictures_are_written_as_png_and_svg(written):
    """Each figure in both forms; PNG by its signature, SVG as XML."""
    _, folder = written
    names = {path.stem for path in (folder / "figures").iterdir()}
    assert {"animal", "angles", "gaps", "residuals"} <= names
    for name in names:
        assert (folder / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert "<svg" in (folder / "figures" / f"{name}.svg").read_text(encoding="utf-8")


def test_the_report_needs_no_other_file_or_host(written):
    """Every source is in the page itself; findings and tables are there."""
    _, folder = written
    page = (folder / "report.html").read_text(encoding="utf-8")
    sources = re.findall(r'src="([^"]{0,30})', page)
    assert sources
    assert all(source.startswith("data:") for source in sources)
    assert not re.search(r'(href|src)="https?:', page)
    assert "Findings" in page
    assert "<table" in page
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page


def test_what_a_page_shows_is_text_and_frames_link_to_the_gaps(written):
    """Names cannot become markup; a frame in a finding is a link to the figure of the gaps, which is there."""
    result, _ = written
    named = "<script>x</script> & _y_"
    report = {**result.report, "wrong": [f"{named} jumps at frame 12"], "findings": []}
    text = f"# {plain(named)}\n\n## {plain(named)}\n\n{plain(named)}\n"
    run = replace(result, name=named).with_part(Report(numbers=report, text=text))
    shown = [Picture(name="gaps", caption=named, figure=result.plot.gaps().figure)]
    page = report_page(run, result.kinematics, [], shown, {"gaps": "<svg/>"})
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 5
    assert '<a href="#gaps">frame 12</a>' in page
    assert '<figure id="gaps"' in page


def test_each_finding_leads_to_what_can_be_done_about_it(written):
    """Two of one kind to one entry of the manual, which stands on the page once; what nothing is known of to none.

    So does what is left open to be stated. Notes are counted as on the terminal; those on quantities are apart.
    """
    result, _ = written
    kinds = {"p jumps": Kind.JUMP, "q jumps": Kind.JUMP, "the unit is odd": Kind.UNITS}
    told = tuple(Finding(kind=kind, text=text, alarm=True) for text, kind in kinds.items())
    told += (Finding(kind=Kind.ASSUMED_UNIT, text="no unit is stated"),)
    report = {**result.report, "wrong": [*kinds, "something else"], "open": ["no unit is stated"]}
    report["findings"] = [*report["wrong"], *report["open"], "one sample repaired"]
    run = result.with_part(Cleaned(told=told)).with_part(Report(numbers=report, text="# a\n"))
    page = report_page(run, result.kinematics, [], [], {})
    assert re.findall(r'<a href="#(do\d)">What to do</a>', page) == ["do1", "do1", "do2", "do2"]
    assert "What was decided or repaired (1)" in page
    assert re.findall(r'<section id="(do\d)">', page) == ["do1", "do2"]
    assert "something else</li>" in page
    assert "mocap help" in page or "--unit" in page
    assert ".md" not in page


def test_a_speed_is_never_below_zero():
    """Its interval is that of the length of a normal vector: 95 % of draws lie inside, also near zero; else as normal.

    Of 20000 draws the share has a standard deviation of 0.15 %.
    """
    rng = np.random.default_rng(0)
    value, sd = np.array([0.0, 0.5, 3.0, 200.0]), np.ones(4)
    shared = {"unit": "m_s", "what": "", "kind": "body", "markers": (), "value": value, "sd": sd}
    speed = Quantity(name="body_speed_m_s", rests=np.ones(4, dtype=np.int8), **shared)
    assert (speed.low >= 0).all()
    for v, low, high in zip(value, speed.low, speed.high, strict=True):
        draws = np.linalg.norm(rng.normal([v, 0, 0], 1.0, (20000, 3)), axis=1)
        assert abs(np.mean((draws >= low) & (draws <= high)) - 0.95) < 0.006
    np.testing.assert_allclose([speed.low[3], speed.high[3]], [198.04, 201.96], atol=0.01)
    other = Quantity(name="wrist_velocity_x_m_s", rests=np.ones(4, dtype=np.int8), **shared)
    np.testing.assert_allclose(other.low, value - 1.96 * sd, atol=1e-3)


def test_a_legend_names_what_is_there(written):
    """Kinds of gaps that no marker has are left out; a figure over time shows how wide its intervals are."""
    result, _ = written
    markers = result.tracks
    measured = np.full_like(markers.status, Status.MEASURED)
    measured[3, 0] = Status.REJECTED
    measured[:2, 1] = Status.PREDICTED
    texts = [t.get_text() for t in plot_gaps(markers.names, markers.t_s, measured).get_legend().get_texts()]
    assert [text.split()[0] for text in texts] == ["measured", "extrapolated", "rejected"]
    ax = result.plot.over_time("body_speed_m_s")
    assert len(ax.figure.axes) == 2
    half = ax.figure.axes[1].lines[0].get_ydata()
    speed = result.kinematics["body_speed_m_s"]
    np.testing.assert_allclose(half, 0.5 * (speed.high - speed.low))
    assert "time" in ax.figure.axes[1].get_xlabel()


def test_plots_of_the_library_refuse_what_they_cannot_draw(written):
    """Quantities of two units, cycles and feet that are not there: one clear line."""
    result, _ = written
    names = [q.name for q in result.kinematics.quantities]
    degree = next(n for n in names if n.endswith("_deg"))
    assert result.plot.over_time(degree).get_ylabel().endswith("(°)")
    assert len(result.plot.gaps().get_yticklabels()) == len(result.tracks.names)
    with pytest.raises(MocapError, match="one unit"):
        result.plot.over_time(degree, "body_speed_m_s")
    with pytest.raises(MocapError, match="no cycles of 'wing_l'"):
        result.plot.by_phase(degree, of="wing_l")
    with pytest.raises(MocapError, match="feet"):
        result.plot.gait()


def test_one_outlier_does_not_flatten_a_plot():
    """Limits hold 99 % of the values."""
    values = np.concatenate([np.sin(np.linspace(0, 20, 500)), [1000.0]])
    low, high = sensible([values])
    assert -1.3 < low < -1
    assert 1 < high < 1.3


@pytest.mark.parametrize(("widest", "leaves"), [(40.0, False), (400.0, True)])
def test_a_band_is_drawn_whole_or_said_to_leave_the_axes(widest, leaves):
    """Full if no wider than the curve is high (100 degrees); else the axis is that of all others, with a triangle."""
    t, sd = np.arange(200) / 100, np.full(200, 2.0)
    sd[90:110] = 0.5 * widest / 1.96
    value = 90 + 50 * np.sin(2 * np.pi * t)
    rests = np.zeros(200, dtype=np.int8)
    more = {"what": "flexion", "kind": "joint", "markers": ()}
    q = Quantity(name="elbow_flexion_deg", unit="deg", value=value, sd=sd, rests=rests, **more)
    ax = new_axes()
    lines_over_time(ax, None, [q], t)
    low, high = ax.get_ylim()
    outside = (q.low < low) | (q.high > high)
    assert outside.any() == leaves
    assert not outside[:90].any()
    assert high - low < 2.2 * np.ptp(value)
    marks = [line for line in ax.lines if line.get_marker() in ("^", "v") and len(line.get_xdata())]
    assert bool(marks) == leaves
    assert (LEAVES in [text.get_text() for text in ax.get_legend().get_texts()]) == leaves


def test_labels_are_words():
    """Without unit and underscores, the side first."""
    assert label("elbow_l_flexion_deg") == "left elbow flexion"
    assert label("L_knee_angle_deg") == "left knee angle"
    assert label("body_speed_m_s") == "body speed"
