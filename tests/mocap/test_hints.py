"""What the user states of a file that does not say it is heard by every command that reads tracks."""

import inspect
import json

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.cli.convert import convert, triangulate
from mocap.cli.info import info
from mocap.cli.learn import learn
from mocap.cli.track import track
from mocap.io.dltdv import read_points


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_recording(make_bat(seed=3, n_frames=60, n_cameras=4), tmp_path_factory.mktemp("bat"), others=True)


@pytest.mark.parametrize("command", [info, convert, triangulate, track, learn])
def test_every_reader_takes_the_same_hints(command):
    """A message that names an option is followed with the command that gave it."""
    assert {"columns", "cameras", "format_name", "sheet", "unit", "fps"} <= set(inspect.signature(command).parameters)


@pytest.fixture
def nameless(files, tmp_path):
    """The points of the bat, as a table whose titles tell nothing, in millimetres, with a time."""
    points = read_points(files["points"], fps=240.0)
    columns = {f"c{k}": 1e3 * points.xyz_m.reshape(60, -1)[:, k] for k in range(3 * len(points.names))}
    table = pd.DataFrame({"clock": points.t_s, **columns})
    path = tmp_path / "table.csv"
    table.to_csv(path, index=False)
    stated = [f"{name}=c{3 * m},c{3 * m + 1},c{3 * m + 2}" for m, name in enumerate(points.names)]
    return path, points, ";".join([*stated, "time=clock"])


def test_a_table_of_unknown_titles_is_tracked_as_its_columns_are_stated(mocap, nameless, tmp_path):
    """Measured samples stay near what the table holds, times the unit; without columns the message names the option."""
    path, points, columns = nameless
    options = ["--model", "constant_velocity", "--no-validate", "--out", tmp_path / "run"]
    code, _, err = mocap("track", path, *options)
    assert code == 1
    assert "--columns" in err
    code, _, err = mocap("track", path, "--columns", columns, "--unit", "mm", *options)
    assert code == 0, err
    markers = pd.read_csv(tmp_path / "run" / "markers.csv")
    name = points.names[0]
    there = points.seen[:, 0] & (markers[f"{name}_origin"] == "measured").to_numpy()
    got = markers[[f"{name}_{axis}" for axis in "xyz"]].to_numpy()
    assert there.sum() > 40
    apart = np.linalg.norm(got - points.xyz_m[:, 0], axis=-1)[there]
    assert np.median(apart) < 0.002  # smoothing moves a sample by less than the noise of the recording, in metres


def test_info_uses_what_is_stated(mocap, nameless):
    """Rate and unit of the summary are those that are stated where the file does not hold them."""
    path, _, columns = nameless
    code, out, err = mocap("info", path, "--columns", columns.rpartition(";")[0], "--fps", 50, "--unit", "mm", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert (found["fps"], found["units"]) == (50.0, "mm")


def test_triangulate_takes_the_unit_of_the_calibration(mocap, files, tmp_path):
    """Coefficients in millimetres give points a thousandth as large in metres."""
    for unit in ("m", "mm"):
        code, _, err = mocap(
            "triangulate", files["pixels"], "--dlt", files["coefficients"], "--unit", unit, "--out",
            tmp_path / f"{unit}_xyzpts.csv",
        )  # fmt: skip
        assert code == 0, err
    in_m, in_mm = (read_points(tmp_path / f"{unit}_xyzpts.csv", fps=1.0).xyz_m for unit in ("m", "mm"))
    np.testing.assert_allclose(in_mm, in_m / 1000, atol=2e-6)  # six decimals, and seven digits
