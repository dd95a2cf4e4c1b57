"""Tables keep as many digits as the standard deviation justifies, in any unit."""

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat, write_recording

import mocap
from mocap.cleaning.triangulate_file import triangulate_file
from mocap.io.contents import point_recording
from mocap.io.csv_table import decimals_in, decimals_of
from mocap.io.dltdv import write_points
from mocap.io.registry import read, write
from mocap.records import MarkerTracks, Status
from mocap.results.tables import write_markers


@pytest.mark.parametrize(
    ("sd", "decimals"),
    [
        (3.2e-4, 7),
        (1.0e-6, 7),
        (9.9e-7, 8),
        (1.23e-9, 10),
        (1e-30, 15),  # of numbers up to 1 a float64 holds no more
        (0.0, 7),
        (np.nan, 7),
        (np.inf, 7),
    ],
)
def test_two_digits_of_the_smallest_deviation(sd, decimals):
    """Never fewer than before, no more than a float64 holds; zero, none and infinite deviations tell nothing."""
    values = np.array([0.9, -0.2, np.nan])
    found = decimals_of(values, np.array([1.0, sd, 0.0]), least=7)
    assert found == decimals
    assert decimals_of(np.full(3, np.nan), np.full(3, np.nan), least=7) == 7
    if 0 < sd < 1 and found < 15:
        assert float(f"{sd:.{found}f}") == pytest.approx(sd, rel=0.051)


@pytest.mark.parametrize(("greatest", "decimals"), [(1.0, 6), (9.9, 6), (10.0, 5), (0.1, 7), (2e-4, 10), (0.0, 0)])
def test_digits_of_the_greatest(greatest, decimals):
    """Seven digits of it."""
    assert decimals_in(np.array([greatest, 0.0, np.nan]), digits=7) == decimals


def tracks(scale_m: float, sd_m: np.ndarray) -> MarkerTracks:
    xyz = scale_m * np.random.default_rng(0).normal(size=(20, 2, 3))
    xyz[3, 0], xyz[4, 1] = 0.0, np.nan
    cov = sd_m[..., None, None] ** 2 * np.eye(3) * np.ones((20, 2, 1, 1))
    origin = np.where(np.isnan(xyz[..., 0]), Status.MISSING, Status.MEASURED)
    return MarkerTracks(names=("a", "b"), t_s=np.arange(20) / 100, xyz_m=xyz, cov_m2=cov, status=origin)


@pytest.mark.parametrize(("scale", "sd"), [(1.0, 3e-4), (1e-4, 2e-8), (1e-6, 1e-9), (1.0, 0.0)])
def test_a_run_of_any_size(tmp_path, scale, sd):
    """To half of the last of two digits of the deviation (0.05 of it), or of seven decimals; one form a column."""
    given, near = tracks(scale, np.array([sd, 3 * sd])), 0.051 * sd or 0.51e-7
    write_markers(given, np.zeros((20, 2), dtype=bool), tmp_path / "markers.csv")
    text = pd.read_csv(tmp_path / "markers.csv", dtype=str, keep_default_na=False)
    for m, name in enumerate(given.names):
        for k, axis in enumerate("xyz"):
            column = text[f"{name}_{axis}"]
            written = column.replace("NaN", np.nan).astype(float)
            np.testing.assert_allclose(written, given.xyz_m[:, m, k], rtol=0, atol=near)
            assert len({len(cell.partition(".")[2]) for cell in column if cell != "NaN"}) == 1
            assert len(column[0].partition(".")[2]) >= 7
        seen = given.seen[:, m]
        np.testing.assert_allclose(text[f"{name}_sd"].astype(float)[seen], given.sd_m[seen, m], rtol=0.051)
    np.testing.assert_allclose(read(tmp_path / "markers.csv").points.xyz_m, given.xyz_m, rtol=0, atol=near)


@pytest.mark.parametrize("deviations", [True, False])
def test_points_of_dltdv(tmp_path, deviations):
    """Micrometres come out as they went in, to seven digits of the greatest, with deviations to two of theirs."""
    given = tracks(1e-6, np.array([2e-9, 3e-9]))
    write_points(tmp_path / "xyzpts.csv", given, sd=deviations)
    back = read(tmp_path / "xyzpts.csv").points
    np.testing.assert_allclose(back.xyz_m, given.xyz_m, rtol=0, atol=1e-12)
    if deviations:
        np.testing.assert_allclose(back.sd_m, given.sd_m, rtol=0.051)


@pytest.mark.parametrize("format", ["csv-wide", "csv-long"])
def test_micrometres_through_a_table(tmp_path, format):
    """To the last bit."""
    xyz = np.random.default_rng(0).normal(size=(5, 2, 3))
    path = tmp_path / ("a.csv" if format == "csv-wide" else "a.long.csv")
    given = point_recording(path, "made", names=["a", "b"], xyz=xyz, unit="um", fps=100.0)
    write(given, path, format)
    np.testing.assert_array_equal(read(path).points.xyz_m, given.points.xyz_m)


def test_triangulation_in_micrometres(tmp_path):
    """Coefficients calibrated in um give the points of those in m, a millionth in size, to six digits."""
    files = write_recording(make_bat(seed=3, n_frames=10, n_cameras=3), tmp_path)
    found = {}
    for unit in ("m", "um"):
        out = tmp_path / f"{unit}_xyzpts.csv"
        source = mocap.read(files["pixels"], fps=1.0, calibration=files["coefficients"], unit=unit)
        triangulate_file(source, out, refine=False)
        found[unit] = read(out).points.xyz_m
    np.testing.assert_allclose(1e6 * found["um"], found["m"], rtol=0, atol=1.01e-6)
