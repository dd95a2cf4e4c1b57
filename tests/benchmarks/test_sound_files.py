"""Odd but sound files of the attack's corpus are read with the values of the plain ones, and as ezc3d reads them."""

import ezc3d
import numpy as np
import pytest

from benchmarks.attack.sound import C3D, FRAMES, TEXT, XYZ_MM, c3d, table
from mocap.io.c3d import read_c3d


def test_all_are_read(tmp_path):
    """None is refused, none gives another value."""
    rows = table(tmp_path)
    assert len(rows) == len(C3D) + len(TEXT)
    assert [row for row in rows if row[2] != "same"] == []


# of a parameter given twice ezc3d takes garbage for a size: it fails at once, or fills the memory first
@pytest.mark.parametrize("odd", [what for what in C3D if "wrong" not in what and what != "parameter twice"])
def test_c3d_as_ezc3d_reads_it(tmp_path, odd):
    """Sample by sample: positions to the last bit, and nothing is missing that it has."""
    path = tmp_path / "a.c3d"
    path.write_bytes(C3D[odd](c3d(tmp_path)))
    try:
        theirs = ezc3d.c3d(str(path))["data"]["points"]
    except (OSError, RuntimeError):
        pytest.skip("ezc3d refuses this one")
    if theirs.shape[1:] != (3, FRAMES):
        pytest.skip(f"ezc3d finds {theirs.shape} of it")
    got = read_c3d(path).points
    assert got is not None
    np.testing.assert_array_equal(got.xyz_m, np.transpose(theirs[:3], (2, 1, 0)) * 1e-3)


def test_the_writer_as_ezc3d_reads_it(tmp_path):
    """Our own file: names, rate, unit, values and the samples that were not seen."""
    c3d(tmp_path)
    found = ezc3d.c3d(str(tmp_path / "plain.c3d"))
    assert found["parameters"]["POINT"]["LABELS"]["value"] == ["RASI", "LASI", "SACR"]
    assert found["parameters"]["POINT"]["UNITS"]["value"] == ["mm"]
    assert found["header"]["points"]["frame_rate"] == 100
    np.testing.assert_allclose(np.transpose(found["data"]["points"][:3], (2, 1, 0)), XYZ_MM, rtol=1e-7)
