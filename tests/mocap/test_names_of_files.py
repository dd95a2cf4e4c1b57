"""Files are found beside others in whatever case a system of files keeps their names."""

import pytest
from mocap.datasets import make_lizard, write_recording

from mocap.reading.reading import recording_name, stored_file


@pytest.mark.parametrize(("pixels", "points"), [("xypts.csv", "XYZPTS.CSV"), ("XYpts.csv", "xyzPts.CSV")])
def test_stored_points_are_found_in_any_case(tmp_path, pixels, points):
    """As on Windows: the points beside the pixels, and the name of the trial without what the file holds."""
    files = write_recording(make_lizard(seed=0, n_frames=20), tmp_path)
    tracks = files["pixels"].rename(tmp_path / f"Flügel 1_{pixels}")
    beside = tmp_path / f"FLÜGEL 1_{points}"
    beside.write_text("a_X,a_Y,a_Z\n1,2,3\n")
    (tmp_path / f"Flügel 2_{points}").write_text("a_X,a_Y,a_Z\n1,2,3\n")
    assert stored_file(tracks, None) == beside
    assert recording_name(tracks) == "Flügel 1"
    exact = tmp_path / "Flügel 1_xyzpts.csv"
    exact.write_text("a_X,a_Y,a_Z\n1,2,3\n")
    assert stored_file(tracks, None) == exact
