"""The tab of angles: what it logs is what the tables hold, by side; cycles in their order."""

import numpy as np
import pytest
import rerun.blueprint as rrb
from flapping import make_run
from readback import column, entities
from test_view_pictures import loaded

from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycles import Cycle
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import robust_range, series_view
from mocap.rerun.record import make_layout, write_recording
from mocap.rerun.tabs.angles import sections
from mocap.sides import by_side

NAME = "L_elbow_flexion_deg"
PATH = paths.quantity("left", NAME)


@pytest.fixture(scope="module")
def run():
    return make_run(n_frames=60, n_cameras=0, n_joints=0)


@pytest.fixture(scope="module")
def rrd(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "r.rrd"
    write_recording(run, path)
    return path


def test_lines_are_the_kinematics_with_their_intervals(run, rrd):
    """Values as the tables hold them, and bands of 1.96 standard deviations, where they rest on what was measured."""
    q = kinematics(run.motion, run.skeleton)[NAME]
    _, _, values = column(rrd, f"{PATH}/measured", "Measurements:values")
    _, _, variances = column(rrd, f"{PATH}/measured", "Measurements:variances")
    there = q.rests == 1
    assert there.sum() > 10
    assert (~there).sum() > 3
    np.testing.assert_array_equal(np.isfinite(values), there)
    np.testing.assert_array_equal(values[there], q.value[there])
    np.testing.assert_allclose(np.sqrt(variances[there]), q.high[there] - q.value[there], rtol=1e-6)


def test_every_joint_is_in_the_group_of_its_side(run, rrd):
    layout = make_layout(run)
    assert {name for name in layout.angles if name != "body"} == {"left", "right"}
    found = entities(rrd)
    for group, quantities in layout.angles.items():
        for q in quantities:
            assert any(path.startswith(f"{paths.quantity(group, q.name)}/") for path in found)
            assert group == "body" or q.name[0].upper() == group[0].upper()


@pytest.mark.parametrize(
    ("name", "side"),
    [
        ("elbow_l", "left"), ("L_elbow", "left"), ("leftKnee", "left"), ("Rknee", "trunk"), ("knee right", "right"),
        ("rump", "trunk"), ("tail", "trunk"), ("left_right", "trunk"), ("RFemur", "right"), ("wrist_d5_r", "right"),
    ],
)  # fmt: skip
def test_sides_of_names(name, side):
    """A side is a part of its own; a letter that begins a word is none."""
    assert list(by_side([name])) == [side]


def test_an_outlier_does_not_flatten_the_rest():
    """One of a thousand values a thousand times too large leaves the axis at the others' range, and 10 % more."""
    x = np.sin(np.linspace(0, 60, 1000))
    assert robust_range(np.append(x, [1e3, np.nan])) == pytest.approx((-1.2, 1.2), abs=0.01)
    low, high = robust_range(x)
    assert low < -1
    assert high > 1
    assert robust_range(np.full(3, np.nan)) is None
    low, high = robust_range(np.full(3, 5.0))
    assert low < 5 < high


def test_parts_of_cycles_begin_where_the_cycles_say():
    """A beat of 0.1 s with a down-stroke of 60 %; then a break, which no name fills."""
    common = {"recording": "r", "kind": "wing_beat", "of": "wing_l", "duration_s": 0.1, "frequency_hz": 10.0}
    rows = [
        Cycle(number=n, start_s=s, end_s=s + 0.1, filled=0.0, downstroke_fraction=0.6, **common)
        for n, s in ((1, 0.0), (2, 0.1), (3, 0.5))
    ]
    times, names = zip(*sections(rows), strict=True)
    assert names == ("1 down", "1 up", "2 down", "2 up", "", "3 down", "3 up", "")
    np.testing.assert_allclose(times, [0, 0.06, 0.1, 0.16, 0.2, 0.5, 0.56, 0.6])


def test_a_person_sees_the_line_and_its_band(viewer, run, tmp_path):
    """Pixels of the line's colour; none without the line."""
    view = series_view(PATH, "elbow", legend=False)
    hidden = rrb.TimeSeriesView(origin=PATH, contents=["$origin/filled"], name="without")
    loaded(viewer, run, tmp_path)
    counts = []
    for one in (view, hidden):
        picture = viewer.picture(one, frame=20)
        counts.append(int((np.abs(picture.astype(int) - palette.SIDE["left"]).max(axis=-1) < 24).sum()))
    assert counts[0] > 100  # a line across some 300 columns, its edges blurred
    assert counts[1] == 0
