"""Tables of R and pandas with one row for each marker of a frame."""

import numpy as np
import pandas as pd
import pytest

from mocap import clean
from mocap import read as read_recording
from mocap.errors import FormatError
from mocap.io.registry import read

XYZ = np.random.default_rng(0).uniform(0.1, 0.9, (30, 2, 3)).round(4)


def rows(**more):
    """Frames from 100 on, nose and tail."""
    frame, name = np.repeat(np.arange(100, 130), 2), ["nose", "tail"] * 30
    return pd.DataFrame({"frame": frame, "marker": name, **more} | dict(zip("xyz", XYZ.reshape(60, 3).T, strict=True)))


LAYOUTS = {
    "by frame": lambda table: table,
    "by marker": lambda table: table.sort_values(["marker", "frame"]),
    "shuffled": lambda table: table.sample(frac=1, random_state=1),
    "other titles": lambda table: table.set_axis(["Frame", "bodypart", "X", "Y", "Z"], axis=1),
    "columns elsewhere": lambda table: table[["z", "marker", "y", "x", "frame"]],
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(
    "written", [{"sep": ",", "decimal": "."}, {"sep": ";", "decimal": ","}], ids=["point", "comma"]
)
def test_each_value_is_that_of_its_frame_and_marker(tmp_path, layout, written):
    """In whatever order rows and columns stand; a row that is left out is a sample that was not seen."""
    table = LAYOUTS[layout](rows())
    table.to_csv(tmp_path / "a.csv", index=False, **written)
    found = read(tmp_path / "a.csv")
    order = [found.names.index(name) for name in ("nose", "tail")]
    np.testing.assert_array_equal(found.points.xyz_m[:, order], XYZ)
    np.testing.assert_array_equal(found.frames, np.arange(100, 130))
    counted = table.columns[[title.lower() == "frame" for title in table.columns]][0]
    gone = (table[counted] == 110) & table.isin(["tail"]).any(axis=1)
    table[~gone].to_csv(tmp_path / "a.csv", index=False, **written)
    seen = np.isfinite(read(tmp_path / "a.csv").points.xyz_m[:, order, 0])
    assert np.argwhere(~seen).tolist() == [[10, 1]]


def test_units_times_and_pixels(tmp_path):
    """Millimetres of the titles, times in place of frames; without z the rows are pixels, with their likelihood."""
    table = rows().drop(columns="frame")
    table[list("xyz")] *= 1000
    table.insert(0, "time (s)", np.repeat(np.arange(30) / 50, 2))
    table.rename(columns={a: f"{a} (mm)" for a in "xyz"}).to_csv(tmp_path / "a.csv", index=False)
    found = read(tmp_path / "a.csv")
    assert (found.unit, found.fps) == ("mm", 50)
    np.testing.assert_allclose(found.points.xyz_m, XYZ, rtol=1e-12)
    clean(read_recording(tmp_path / "a.csv"))
    rows(likelihood=np.linspace(0.5, 1, 60)).drop(columns="z").to_csv(tmp_path / "b.csv", index=False)
    pixels = read(tmp_path / "b.csv")
    np.testing.assert_array_equal(pixels.pixels.uv_px[0], XYZ[..., :2])
    np.testing.assert_allclose(pixels.score[0].ravel(), np.linspace(0.5, 1, 60))


def test_a_marker_twice_in_a_frame_is_refused_and_other_columns_are_named(tmp_path):
    """Two animals in one table are not one; what is of no marker is left out by its name."""
    rows(speed=1.0).to_csv(tmp_path / "a.csv", index=False)
    assert "1 column is of no marker, left out: speed" in read(tmp_path / "a.csv").findings
    pd.concat([rows(animal="a"), rows(animal="b")]).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(FormatError, match="line 62: 'nose' stands twice at 100: keep the rows of one animal"):
        read(tmp_path / "a.csv")
    rows().drop(columns="frame").to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(FormatError):
        read(tmp_path / "a.csv")
