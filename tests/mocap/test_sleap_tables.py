"""SLEAP's analysis files: the order of axes that HDF5 states, and rows of instances (CSV), as sleap-io has them."""

import numpy as np
import pytest

from mocap.errors import FormatError
from mocap.io.registry import read

sleap_io = pytest.importorskip("sleap_io")
analysis_h5, csv = (pytest.importorskip(f"sleap_io.io.{name}") for name in ("analysis_h5", "csv"))
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

NODES = ["snout", "mid", "tail"]


def labels(n_tracks, n_frames, *, named=True):
    """Animals whose nodes are elsewhere in every frame; one node is hidden in some, and one frame is empty."""
    rng = np.random.default_rng(n_tracks)
    skeleton = sleap_io.Skeleton(NODES)
    tracks = [sleap_io.Track(f"mouse{k}") for k in range(n_tracks)]
    video = sleap_io.Video("clip.mp4")
    frames = []
    for frame in range(n_frames):
        if frame == 3:
            continue
        own = []
        for track in tracks:
            points = rng.uniform(0, 500, (3, 2))
            points[2] = np.nan if frame % 4 == 1 else points[2]
            instance = sleap_io.PredictedInstance.from_numpy(
                points, point_scores=rng.uniform(0.5, 1, 3), score=0.9, skeleton=skeleton,
                track=track if named else None,
            )  # fmt: skip
            own.append(instance)
        frames.append(sleap_io.LabeledFrame(video=video, frame_idx=frame, instances=own))
    return sleap_io.Labels(frames)


def by_name(found, frames):
    """(frames, 2) pixels and (frames,) scores of each marker at frame numbers, by its name."""
    at = [int(np.flatnonzero(found.frames == frame)[0]) for frame in frames]
    return {name: (found.pixels.uv_px[0, at, m], found.score[0, at, m]) for m, name in enumerate(found.names)}


def is_as(found, other, frames):
    one, two = by_name(found, frames), by_name(other, frames)
    assert one.keys() == two.keys()
    for name in one:
        for a, b in zip(one[name], two[name], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize(("n_tracks", "n_frames"), [(1, 12), (2, 12), (2, 3), (3, 2), (5, 40)])
def test_dims_say_the_order_of_axes(tmp_path, n_tracks, n_frames):
    """Every order of axes that sleap-io writes is one recording, also where shapes could be those of another."""
    whole = labels(n_tracks, n_frames)
    sleap_io.save_file(whole, str(tmp_path / "x.slp"), embed=False)
    reference = read(tmp_path / "x.slp")
    orders = [{"preset": "matlab"}, {"preset": "standard"}]
    orders += [{"frame_dim": 1, "track_dim": 3, "node_dim": 0, "xy_dim": 2}]
    for k, order in enumerate(orders):
        path = tmp_path / f"x{k}.analysis.h5"
        analysis_h5.write_labels(whole, str(path), **order)
        found = read(path)
        assert sorted(found.names) == sorted(reference.names)
        is_as(found, reference, [f for f in reference.frames if f in found.frames])


@pytest.mark.parametrize("n_tracks", [1, 2])
def test_rows_of_instances_are_the_recording_of_the_project(tmp_path, n_tracks):
    """Positions, scores, names and frames of the CSV are those of the .slp of the same labels, one track or two."""
    whole = labels(n_tracks, 12)
    sleap_io.save_file(whole, str(tmp_path / "x.slp"), embed=False)
    path = tmp_path / "x.analysis.csv"
    csv.write_labels(whole, str(path), format="sleap")
    found, reference = read(path), read(tmp_path / "x.slp")
    assert found.format == "sleap-csv"
    assert sorted(found.names) == sorted(reference.names)
    np.testing.assert_array_equal(found.frames, reference.frames)
    is_as(found, reference, found.frames)
    assert not found.pixels.seen[0, 3].any()  # a frame without rows


def test_instances_without_tracks(tmp_path):
    """One a frame is one animal; two are told apart by their place alone, and said so; a track twice is refused."""
    head = "track,frame_idx,instance.score,a.x,a.y,a.score\n"
    path = tmp_path / "x.analysis.csv"
    path.write_text(head + "".join(f",{k},1.0,{k}.5,2.0,0.9\n" for k in range(5)))
    found = read(path)
    assert (found.names, found.findings) == (("a",), ())
    path.write_text(head + "".join(f",{k},1.0,{k}.5,2.0,0.9\n,{k},1.0,{k}.5,300.0,0.8\n" for k in range(5)))
    found = read(path)
    assert found.names == ("animal1_a", "animal2_a")
    assert any("in no order" in finding for finding in found.findings)
    path.write_text(head + "".join(f"m,{k},1.0,{k}.5,2.0,0.9\nm,{k},1.0,{k}.5,300.0,0.8\n" for k in range(5)))
    with pytest.raises(FormatError, match=r"line 3: track 'm' has a second instance in frame 0"):
        read(path)
    path.write_text(head + ",0,1.0,1.5,2.0,0.9\n,1,1.0,?,2.0,0.9\n")
    with pytest.raises(FormatError, match=r"line 3, a.x: '\?' is not a number"):
        read(path)
