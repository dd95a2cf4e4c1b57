"""Films are an extra: without PyAV all else works, and what needs it says what to install."""

import re
import sys

import numpy as np
import pytest
from mocap.datasets.movie import write_movies

from mocap.io.movies import FilmError, open_movie
from mocap.rerun.log_video import av1
from tests.conftest import ROOT
from tests.mocap.test_cli import files, track_arguments  # noqa: F401 - fixtures

EXTRA = r"pip install .*\[film\]'"


@pytest.fixture
def no_av(monkeypatch):
    """PyAV cannot be imported."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "av"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "av", None)


def test_nothing_but_films_needs_it():
    """No module of the program imports it as it is imported itself: only what reads or writes a film does."""
    paths = [path for name in ("mocap", "datasets", "filters", "eal") for path in (ROOT / name).rglob("*.py")]
    at_once = [line for path in paths for line in re.findall(r"(?m)^(?:import|from) .*", path.read_text("utf-8"))]
    assert len(at_once) > 1000
    assert not [line for line in at_once if re.search(r"^from av\b|^import (.*, )?av\b", line)]


def test_a_recording_is_tracked_without_it(mocap, tmp_path, no_av):  # noqa: ARG001
    """Table, report and recording are written."""
    rows = [f"{i},{i / 100},{np.sin(i / 5)},{i / 50},0,measured" for i in range(1, 30)]
    (tmp_path / "a.csv").write_text("\n".join(["frame,t_s,a_x,a_y,a_z,a_origin", *rows]) + "\n")
    assert mocap("track", tmp_path / "a.csv", "--out", tmp_path / "run", "--no-validate")[0] == 0
    assert (tmp_path / "run" / "recording.rrd").exists()


def test_films_say_what_to_install(mocap, files, tmp_path, no_av):  # noqa: F811, ARG001
    """In one line, before anything is computed; of a movie, of pictures, and of movies to make."""
    (tmp_path / "a.mp4").write_bytes(b"film")
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / "1.png").write_bytes(b"picture")
    for film in ("a.mp4", "shots"):
        code, _, err = mocap(*track_arguments(files, tmp_path / "run"), "--video", tmp_path / film)
        assert code == 1
        assert re.search(EXTRA, err)
        assert len(err.splitlines()) == 1
        with pytest.raises(FilmError, match=EXTRA):
            open_movie(tmp_path / film)
    with pytest.raises(FilmError, match=EXTRA):
        write_movies(lambda _t: None, [], np.zeros(1), tmp_path, start_s=[], fps=1.0, seed=0)  # type: ignore[arg-type]
    with pytest.raises(FilmError, match=EXTRA):
        next(av1(iter([]), (64, 64)))
    assert not (tmp_path / "run").exists()
