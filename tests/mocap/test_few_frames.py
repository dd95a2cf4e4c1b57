"""One frame, one marker, two frames: a result, or one sentence that says what is needed."""

import numpy as np
import pytest

from mocap import from_arrays, from_pixels, load, track
from mocap.cameras.camera import record
from mocap.io.contents import point_recording
from mocap.io.registry import read, write
from tests.mocap.rigs import cloud, ring

SHAPES = [(1, 1), (1, 6), (2, 1), (2, 6), (3, 1)]


def positions(frames, markers):
    """(T, M, 3) markers that move by millimetres."""
    rng = np.random.default_rng(0)
    return cloud(rng, markers) + rng.normal(0, 1e-3, (frames, markers, 3))


@pytest.mark.parametrize("validate", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_few_positions_and_pixels_are_tracked(shape, validate):
    """Every measured sample has its position, within the noise; what no motion shows has no number of its own."""
    xyz = positions(*shape)
    uv = record(ring(3), xyz)
    for recording in (from_arrays(xyz, fps=100, unit="m"), from_pixels(uv, ring(3), fps=100, unit="m")):
        found = track(recording, validate=validate)
        np.testing.assert_allclose(found.data["position"].values, xyz, atol=5e-3)
        assert len(found.kinematics) > 0


def test_one_frame_goes_through_the_commands(mocap, tmp_path):
    """Info, track, kinematics and convert end with 0; learn says in a line what it needs."""
    path, out = tmp_path / "one.csv", tmp_path / "o"
    write(point_recording(path, "made", names=list("abcdef"), xyz=positions(1, 6), unit="m", fps=100.0), path)
    stated = ["--fps", 100]
    assert mocap("info", path)[0] == 0
    assert mocap("track", path, *stated, "--no-validate", "--out", out)[0] == 0
    assert load(out).data.sizes["time"] == 1
    assert mocap("kinematics", out, "--out", tmp_path / "k")[0] == 0
    assert mocap("convert", path, tmp_path / "one.trc", *stated)[0] == 0
    assert len(read(tmp_path / "one.trc").frames) == 1
    code, _, said = mocap("learn", path, path, *stated, "--out", tmp_path / "m.npz")
    assert code == 1
    assert "give longer or more complete trials" in said
