"""Runs side by side: each as it was, frame by frame, and what differs between them."""

from dataclasses import replace

import numpy as np
import pytest
import rerun.blueprint as rrb
from flapping import make_run
from readback import column, entities
from test_view_pictures import amount

from mocap.errors import MocapError
from mocap.rerun import palette, paths
from mocap.rerun.compare import APPLICATION, compare_blueprint, difference_mm, recording_of, run_names, write_comparison
from mocap.rerun.record import write_recording
from mocap.rerun.stored import read_recording

SHIFT_M = np.array([0.003, 0.0, -0.004])
"""5 mm."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs of which the second has one marker 5 mm off in frames 20 to 29, and the comparison of them."""
    folder = tmp_path_factory.mktemp("compare")
    first = make_run(n_frames=50, n_cameras=2)
    xyz = first.xyz_m.copy()
    xyz[20:30, 6] += SHIFT_M
    second = first.having(position=xyz)
    out = []
    for name, run in (("ours", first), ("theirs", second)):
        (folder / name).mkdir()
        write_recording(run, folder / name / "recording.rrd")
        out.append(folder / name)
    write_comparison(out, folder / "both.rrd")
    return first, second, out, folder / "both.rrd"


def test_each_run_is_there_as_it_was(runs):
    """Every entity of either recording, with the same positions at the same frames."""
    first, second, folders, both = runs
    for i, (run, folder) in enumerate(zip((first, second), folders, strict=True)):
        alone = {path.rstrip("/") for path in entities(folder / "recording.rrd")}
        assert {f"{paths.run(i)}{path}" for path in alone} <= entities(both)
        frames, _, xyz = column(both, f"{paths.run(i)}{paths.SKELETON}", "Points3D:positions")
        np.testing.assert_array_equal(frames, np.arange(50))
        np.testing.assert_array_equal(xyz.reshape(50, -1, 3), run.xyz_m.astype(np.float32))


def test_what_differs_is_seen_where_it_does(runs):
    """Five millimetres on one marker of M are 5 / sqrt(M seen), in those frames only; its row of the map is yellow."""
    first, _, folders, both = runs
    rms = column(both, f"{paths.APART}/1", "Scalars:scalars")[2]
    seen = first.tracks.seen.sum(axis=1)
    # float32 keeps 6e-8 of positions below 1 m
    np.testing.assert_allclose(rms[20:30], 5 / np.sqrt(seen[20:30]), atol=1e-3)
    np.testing.assert_array_equal(np.delete(rms, np.s_[20:30]), 0.0)
    a, b = (read_recording(folder, name=folder.name) for folder in folders)
    later = replace(b, first=b.first + 4, t_s=b.t_s[4:], xyz_m=b.xyz_m[4:])  # that begins at frame 5
    np.testing.assert_array_equal(difference_mm(a, later)[1][:, 4:], difference_mm(a, b)[1][:, 4:])
    assert np.isnan(difference_mm(a, later)[1][:, :4]).all()
    names, apart = difference_mm(a, b)
    assert names == first.names
    np.testing.assert_allclose(apart[6, 20:30], 5.0, atol=1e-3)
    picture = column(both, f"{paths.difference(1)}/samples", "Image:buffer")[2].reshape(len(names), 50, 3)
    yellow, dark = palette.depth(np.array([0.0, 1.0]))
    assert (picture[6, 20:30] == yellow).all()
    assert (picture[5] == dark).all()


def test_what_is_stored_is_read_back(runs):
    """Names, bones, times and the way up are in the recording itself."""
    first, _, folders, _ = runs
    stored = read_recording(folders[0], name="x")
    assert stored.names == first.names
    assert len(stored.bones) == len(first.skeleton.bones)
    np.testing.assert_allclose(stored.t_s, first.t_s, atol=5e-10)
    np.testing.assert_array_equal(stored.up, (0, 0, 1))
    assert stored.below(paths.CAMERAS) == ["cam1", "cam2"]


def test_the_viewer_shows_both(viewer, runs):
    """Both colours are in the scene, nothing is complained about; a run that is left out is not seen."""
    _, _, folders, both = runs
    stored = [read_recording(folder, name=folder.name) for folder in folders]
    viewer.load(both, "ours - theirs", application=APPLICATION)
    pictures = []
    for i in (0, 1, 3):
        blueprint = compare_blueprint(stored, [difference_mm(*stored)])
        blueprint.root_container.active_tab = i
        pictures.append(viewer.show(blueprint, frame=25))
    one = rrb.Spatial3DView(origin=paths.TOGETHER, contents=[f"{paths.together(0)}/**"])
    alone = viewer.picture(one, frame=25)
    assert len({picture.tobytes() for picture in pictures}) == 3
    scene = pictures[0][100:, : pictures[0].shape[1] // 2]
    assert amount(scene, palette.SKY_BLUE) > 30
    assert amount(scene, palette.ORANGE) > 30
    assert amount(alone, palette.SKY_BLUE) > 30
    assert amount(alone, palette.ORANGE) == 0


def test_what_cannot_be_compared_is_refused(runs, tmp_path):
    """One run is no comparison; other markers, no recording, another program's: a line each."""
    _, _, folders, _ = runs
    with pytest.raises(MocapError, match="1 runs: 2 to 4"):
        write_comparison(folders[:1], tmp_path / "c.rrd")
    with pytest.raises(MocapError, match="there is no recording"):
        write_comparison([folders[0], tmp_path], tmp_path / "c.rrd")
    (tmp_path / "other.rrd").write_bytes(b"RRF2 no recording")
    with pytest.raises(MocapError, match="not a recording of mocap"):
        read_recording(tmp_path / "other.rrd", name="other")
    a, b = (read_recording(folder, name=folder.name) for folder in folders)
    with pytest.raises(MocapError, match="share no marker"):
        difference_mm(a, replace(b, names=tuple(f"new {name}" for name in b.names)))
    assert not list(tmp_path.glob(".*"))


def test_names_tell_runs_apart(tmp_path):
    """Folders by their names; files called recording.rrd by their folders; the same name twice is numbered."""
    (tmp_path / "a").mkdir()
    assert run_names([tmp_path / "a", tmp_path / "b" / "recording.rrd"]) == ["a", "b"]
    assert run_names([tmp_path / "a", tmp_path / "a"]) == ["a (1)", "a (2)"]
    with pytest.raises(MocapError, match="there is no recording"):
        recording_of([tmp_path / "a"], tmp_path)
