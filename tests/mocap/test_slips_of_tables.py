"""Slips of tables that change numbers are told, and the sound table beside them is not accused."""

import numpy as np
import pytest

from benchmarks.silent import SLIPS, slips
from mocap.audit.columns import column_findings
from mocap.audit.frames import exchanged_frames, path_findings
from mocap.findings import Kind
from mocap.io.registry import read

FRAMES, MARKERS = 160, 8
NAMES = tuple(f"pt{m + 1}" for m in range(MARKERS))


def moving(axes, *, size=1.0, noise=0.0, seed=0):
    """(T, M, axes) smooth paths of markers of one body, with errors of a digitiser."""
    rng = np.random.default_rng(seed)
    t = np.arange(FRAMES)[:, None, None] / FRAMES
    where, phase = rng.uniform(-1, 1, (MARKERS, axes)), rng.uniform(0, 6, (MARKERS, axes))
    body = np.sin(5 * t + rng.uniform(0, 6, axes)) + 0.5 * where
    return size * (body + 0.2 * np.sin(25 * t + phase)) + rng.normal(0, noise, (FRAMES, MARKERS, axes)) + 3 * size


def vicon(path, xyz):
    """As Nexus writes it."""
    head = ",," + ",,,".join(f"snake:{name}" for name in NAMES)
    rows = [f"{i + 100},0," + ",".join(f"{x:.6g}" for x in row.ravel()) for i, row in enumerate(xyz)]
    axes, units = "Frame,Sub Frame" + ",X,Y,Z" * MARKERS, "," + ",mm,mm,mm" * MARKERS
    path.write_text("\n".join(["Trajectories", "150", head, axes, units, *rows, ""]))
    return path


def xypts(path, uv):
    titles = ",".join(f"{name}_cam1_{a}" for name in NAMES for a in "XY")
    path.write_text("\n".join([titles, *(",".join(f"{x:.6f}" for x in row.ravel()) for row in uv), ""]))
    return path


def dlc(path, uv):
    """As DeepLabCut writes it."""
    rows = [[f"{i}", *(f"{x:.6f},{y:.6f},0.99" for x, y in row)] for i, row in enumerate(uv)]
    titles = [
        ["scorer", *["net"] * (3 * MARKERS)],
        ["bodyparts", *(name for name in NAMES for _ in range(3))],
        ["coords", *["x", "y", "likelihood"] * MARKERS],
    ]
    path.write_text("\n".join(",".join(row) for row in [*titles, *rows]) + "\n")
    return path


FILES = {
    "vicon-csv": lambda path: vicon(path / "a.csv", moving(3, size=200, noise=0.1)),
    "dltdv-xypts": lambda path: xypts(path / "a_xypts.csv", moving(2, size=150, noise=0.2)),
    "deeplabcut-csv": lambda path: dlc(path / "aDLC.csv", moving(2, size=100, noise=0.5)),
}


@pytest.mark.parametrize("format", SLIPS)
def test_what_a_check_can_see_is_told(format, tmp_path):
    """Of every kind of slip five: those that change numbers by more than the recording moves are refused or told."""
    path = FILES[format](tmp_path)
    found = read(path)
    assert found.format == format
    done = list(slips(path, found, 5, tmp_path / "out"))
    assert len(done) == 5 * len(SLIPS[format])
    assert [row["mutant"] for row in done if row["visible"] and not row["told"]] == []
    assert sum(bool(row["visible"]) for row in done) > 0.6 * len(done)
    assert (tmp_path / "out" / "sound" / path.name).read_text() == path.read_text()


NEW = (Kind.EXCHANGED_FRAMES, Kind.SINGLE_SAMPLES, Kind.NEGATIVE_PIXELS, Kind.UNITS)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("noise", [0.0, 0.3, 5.0])
def test_sound_tables_are_not_accused(noise, seed):
    """Smooth, digitised and careless tables alike, in pixels and in space, also with whole pixels."""
    uv, xyz = moving(2, size=120, noise=noise, seed=seed), moving(3, size=0.1, noise=noise / 1e3, seed=seed)
    for pixels in (uv, np.round(uv)):
        found = [*column_findings(pixels, NAMES, camera="a"), *path_findings(pixels, NAMES, camera="a")]
        assert [*found, *exchanged_frames(pixels.reshape(FRAMES, -1), axes=2)] == []
    assert [*path_findings(xyz, NAMES), *exchanged_frames(xyz.reshape(FRAMES, -1), axes=3)] == []


@pytest.mark.parametrize(("a", "b"), [(40, 41), (20, 130)])
def test_exchanged_lines_are_named(a, b):
    """Two neighbours and two far ones: the finding has the rows that are to be put back, from 1."""
    uv = moving(2, size=120, noise=0.3).reshape(FRAMES, -1)
    uv[[a, b]] = uv[[b, a]]
    (found,) = exchanged_frames(uv, axes=2)
    assert (found.frames, found.alarm) == ((a + 1, b + 1), True)


def test_a_sudden_move_that_lasts_is_no_single_sample():
    """A step that does not come back, and a flap of three frames, are moves; one frame alone is not."""
    step, flap, one = (moving(3, size=0.1, noise=1e-4) for _ in range(3))
    step[80:, 2], flap[80:83, 2], one[80, 2] = step[80:, 2] + 0.05, flap[80:83, 2] + 0.05, one[80, 2] + 0.05
    assert path_findings(step, NAMES) == path_findings(flap, NAMES) == []
    (found,) = path_findings(one, NAMES)
    assert "3 coordinates of 'pt3' leave their path for one frame and are back in the next" in found.text
    one[80, 2, 1:] -= 0.05
    (found,) = path_findings(one, NAMES)
    assert "1 coordinate of 'pt3' leaves its path for one frame and is back in the next" in found.text
    assert (found.markers, found.frames) == (("pt3",), (81,))


def test_negative_pixels():
    """A minus sign is told; coordinates from the middle of the image, and clicks just outside it, are not."""
    uv = moving(2, size=120)
    assert column_findings(uv - uv.mean(axis=(0, 1)), NAMES, camera="a") == []
    near, wrong = uv.copy(), uv.copy()
    near[5, 1, 0], wrong[5, 1, 0] = -6.0, -wrong[5, 1, 0]
    assert column_findings(near, NAMES, camera="a") == []
    (found,) = column_findings(wrong, NAMES, camera="a")
    assert (found.kind, found.markers, found.frames) == (Kind.NEGATIVE_PIXELS, ("pt2",), (6,))


def test_half_a_sample_is_told(tmp_path):
    """A sample whose x is there and whose y is empty is told with its frame; one that is all empty is a gap."""
    for name, cells, told in (("half", ["", None, None], True), ("whole", ["", "", ""], False)):
        path = vicon(tmp_path / f"{name}.csv", moving(3, size=200))
        lines = path.read_text().split("\n")
        row = lines[5 + 7].split(",")
        row[5:8] = [old if new is None else new for old, new in zip(row[5:8], cells, strict=True)]
        lines[5 + 7] = ",".join(row)
        path.write_text("\n".join(lines))
        texts = [f for f in read(path).findings if "and not the others" in f]
        assert len(texts) == told
        assert all("1 of 'snake:pt2' (from frame 107 on)" in text for text in texts)


def test_what_leaves_the_image_has_no_lost_sign():
    """A marker that walks out at the left, by 30 px a frame, and comes back is where it is."""
    uv = moving(2, size=120)
    uv[60:80, 3, 0] = np.abs(np.arange(-10, 10)) * 30.0 - 150
    assert (uv[60:80, 3, 0] < -100).any()
    assert not [f for f in column_findings(uv, NAMES, camera="a") if f.kind is Kind.NEGATIVE_PIXELS]
