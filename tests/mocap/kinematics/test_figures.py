"""Figures and the report of one file."""

import re

import numpy as np
import pytest

from mocap.errors import MocapError
from mocap.library.tracked import Tracked
from mocap.plots.kinematics import label, sensible
from tests.mocap.rerun.flapping import make_run


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    result = Tracked(make_run(n_frames=60))
    result.write_kinematics(folder)
    return result, folder


def test_pictures_are_written_as_png_and_svg(written):
    """Each figure in both forms; PNG by its signature, SVG as XML."""
    _, folder = written
    names = {path.stem for path in (folder / "figures").iterdir()}
    assert {"angles", "gaps", "residuals"} <= names
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


def test_plots_of_the_library_refuse_what_they_cannot_draw(written):
    """Quantities of two units, cycles and feet that are not there: one clear line."""
    result, _ = written
    names = [q.name for q in result.kinematics.quantities]
    degree = next(n for n in names if n.endswith("_deg"))
    assert result.plot.over_time(degree).get_xlabel().startswith("time")
    assert len(result.plot.gaps().get_yticklabels()) == len(result.run.tracked.markers.names)
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


def test_labels_are_words():
    """Without unit and underscores."""
    assert label("elbow_l_flexion_deg") == "elbow l flexion"
    assert label("body_speed_m_s") == "body speed"
