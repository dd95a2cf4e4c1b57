"""Zeros and other numbers that stand for missing samples are read as missing, in every format; places are kept."""

import numpy as np
import pytest

import mocap
from mocap.audit.inspect import inspect
from mocap.io.format import Hints
from mocap.io.plausible import placeholders
from mocap.io.registry import read
from mocap.io.together import convert_files

T, M = 120, 4


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def xyz(rng):
    """Markers about 1 m from the origin, in mm; the second is at zero in 20 frames, the last in all."""
    t = np.arange(T) / 100
    way = np.stack([50 * np.sin(6 * t), 30 * np.cos(6 * t), 20 * np.sin(12 * t)], axis=-1)
    out = rng.uniform(500, 1000, (1, M, 3)) + way[:, None] + rng.normal(0, 0.1, (T, M, 3))
    out[40:60, 1] = 0
    out[:, 3] = 0
    return out


def rows(xyz, before, separator):
    return "".join(
        separator.join([*before(i), *(f"{v:.4f}" for v in row.ravel())]) + "\r\n" for i, row in enumerate(xyz)
    )


def write_c3d(path, xyz, residual=0.0, scale=None):
    """Residuals, one or (T, M), of a file of reals whose residuals count in units of ``scale``."""
    import ezc3d

    file = ezc3d.c3d()
    parameters = file["parameters"]["POINT"]
    parameters["UNITS"]["value"], parameters["RATE"]["value"] = ["mm"], [100]
    parameters["LABELS"]["value"] = [f"M{m}" for m in range(xyz.shape[1])]
    if scale is not None:
        file.add_parameter("POINT", "SCALE", [-scale])
    data = np.ones((4, *xyz.shape[1::-1]))
    data[:3] = np.moveaxis(xyz, -1, 0).swapaxes(1, 2)
    file["data"]["points"] = data
    shape = data.shape[1:]
    file["data"]["meta_points"] = {
        "residuals": np.broadcast_to(np.transpose(residual), shape)[None].copy(),
        "camera_masks": np.zeros((7, *shape), bool),
    }
    file.write(str(path))


def write_tsv(path, xyz):
    names = "\t".join(f"M{m}" for m in range(M))
    head = f"NO_OF_FRAMES\t{T}\r\nNO_OF_MARKERS\t{M}\r\nFREQUENCY\t100\r\nMARKER_NAMES\t{names}\r\n"
    path.write_bytes((head + rows(xyz, lambda _: [], "\t")).encode())


def write_vicon(path, xyz):
    names = "".join(f",M{m},," for m in range(M))
    head = f"Trajectories\r\n100\r\n,{names}\r\nFrame,Sub Frame{',X,Y,Z' * M}\r\n,{',mm,mm,mm' * M}\r\n".replace(
        ",,M0", ",,M0"
    )
    path.write_bytes((head + rows(xyz, lambda i: [str(i + 1), "0"], ",")).encode())


def write_dltdv(path, xyz):
    titles = ",".join(f"M{m}_{a}" for m in range(M) for a in "XYZ")
    path.write_bytes((titles + "\r\n" + rows(xyz, lambda _: [], ",")).encode())


def write_table(path, xyz):
    titles = ",".join(["frame", *(f"M{m} {a} (mm)" for m in range(M) for a in "xyz")])
    path.write_bytes((titles + "\r\n" + rows(xyz, lambda i: [str(i + 1)], ",")).encode())


def write_trc(path, xyz):
    head = (
        f"PathFileType\t4\t(X/Y/Z)\tx\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t{T}\t{M}\tmm\n"
        + "Frame#\tTime\t" + "\t\t\t".join(f"M{m}" for m in range(M)) + "\t\t\n\t\t"
        + "\t".join(f"{a}{m}" for m in range(M) for a in "XYZ") + "\n\n"
    )  # fmt: skip
    path.write_bytes((head + rows(xyz, lambda i: [str(i + 1), f"{i / 100:.2f}"], "\t")).encode())


FORMATS = {
    "x.c3d": write_c3d,
    "x.tsv": write_tsv,
    "x_vicon.csv": write_vicon,
    "x_xyzpts.csv": write_dltdv,
    "x_table.csv": write_table,
    "x.trc": write_trc,
}


@pytest.mark.parametrize("name", FORMATS)
def test_zeros_of_every_format_are_missing_and_counted(tmp_path, xyz, name):
    """20 samples and a marker that was never seen: in the record, in ``info`` and among what a report begins with."""
    FORMATS[name](tmp_path / name, xyz)
    found = read(tmp_path / name)
    np.testing.assert_array_equal(found.points.seen, (xyz != 0).any(axis=-1))
    said = (
        f"{20 + T} samples at exactly (0, 0, 0) stand for missing and were read so: "
        "20 of 'M1' (from frame 41 on), all of 'M3', which was never seen"
    )
    assert found.findings[0] == said
    (told,) = inspect([tmp_path / name], Hints())
    assert said in told["findings"]
    assert told["undigitised"]["markers"] == ["M3"]
    assert said in map(str, mocap.read(tmp_path / name, fps=100, unit="mm").findings)


def test_converted_zeros_are_gaps(tmp_path, xyz):
    """To a table they are empty cells, to TRC ``NaN``: none is moved by a nanometre; the finding is passed on."""
    write_c3d(tmp_path / "x.c3d", xyz)
    for name in ("o.csv", "o.trc"):
        done = convert_files([tmp_path / "x.c3d"], tmp_path / name, hints=Hints())
        assert "stand for missing" in done["findings"][0]
        assert not any("1 nm" in remark for remark in done["remarks"])
        back = read(tmp_path / name)
        np.testing.assert_array_equal(back.points.seen, (xyz != 0).any(axis=-1))
        assert not any("stand for missing" in finding for finding in back.findings)


def test_pixels_at_the_corner_are_missing(tmp_path, rng):
    """(0, 0) of one camera, in 30 frames; the same marker's other camera is kept."""
    uv = 500 + np.cumsum(rng.normal(0, 2, (T, 2, 2, 2)), axis=0)
    uv[10:40, 0, 1] = 0
    titles = ",".join(f"pt{m}_cam{c}_{a}" for m in (1, 2) for c in (1, 2) for a in "XY")
    np.savetxt(tmp_path / "x_xypts.csv", uv.reshape(T, -1), "%.3f", ",", header=titles, comments="")
    found = read(tmp_path / "x_xypts.csv")
    assert found.pixels.seen.sum(axis=1).tolist() == [[T, T], [T - 30, T]]
    assert "30 samples of camera 'cam2' at exactly (0, 0)" in found.findings[0]


@pytest.mark.parametrize("number", [9999.99, -16512.0, -3.697314e28])
def test_numbers_outside_everything_else_are_missing(xyz, number):
    """Five frames of one marker and all of another: x = y = z, twice or more, far outside what was recorded."""
    xyz[xyz == 0] = np.nan
    xyz[7:12, 0], xyz[:, 3] = number, number
    want = np.zeros((T, M), dtype=bool)
    want[7:12, 0] = want[:, 3] = True
    np.testing.assert_array_equal(placeholders(xyz), want)


def passing(t):
    """A ball thrown through the origin, which it meets exactly in frame 50, at 20 mm a frame and faster and faster."""
    s = (t - 50)[:, None]
    return s * [20.0, -10, 5] + s**2 * [0.0, 0, -0.3]


def whole(t):
    """Whole millimetres of a marker that lies at the origin and jitters by less than one."""
    return np.round(np.random.default_rng(3).normal(0, 0.4, (len(t), 3)))


def planar(t):
    """A marker in the plane z = 0 that moves over the axes."""
    return np.stack([t - 50.0, np.where(t == 50, 0.0, 3 * (t - 50.0)), np.zeros(len(t))], axis=-1)


def corner(t):
    """A marker of a calibration frame at the origin, measured: it lies still, to the noise of its cameras."""
    return np.random.default_rng(4).normal(0, 0.05, (len(t), 3))


def away(t):
    """It begins at the origin and moves off."""
    return 0.01 * t[:, None] ** 2 * [1.0, 2, 3]


def still(t):
    """A simulated marker that never leaves its place, which is as far from the axes as no other."""
    return np.full((len(t), 3), 1200.0)


def diagonal(t):
    """A pendulum along x = y = z, outside all other markers, that is in each place again and again."""
    return 1200.0 + np.round(100 * np.sin(2 * np.pi * t / 20), 9)[:, None] * np.ones(3)


@pytest.mark.parametrize("harmless", [passing, whole, planar, corner, away, still, diagonal])
def test_places_are_kept(xyz, harmless):
    """Tracks through the origin, at rest near it, in a plane through it, and far from it: nothing is missing."""
    xyz[xyz == 0] = np.nan
    xyz[:, 3] = harmless(np.arange(T))
    xyz = np.round(xyz) if harmless is whole else xyz  # a file rounds all of its numbers
    assert not placeholders(xyz).any()


def test_a_marker_at_the_origin_that_cameras_measured(tmp_path, xyz):
    """Exactly zero throughout is "never seen"; in C3D, unless its samples have residuals above 0: cameras saw it there.

    Noise leaves no measured coordinate exactly zero a hundred times, so without residuals nothing speaks for a place.
    """
    for residual, there in ((0.0, False), (1.0, True)):
        write_c3d(tmp_path / "x.c3d", xyz, residual)
        found = read(tmp_path / "x.c3d")
        assert bool(found.points.seen[:, 3].all()) == there
        assert not found.points.seen[40:60, 1].any()  # it is elsewhere before and after


def test_zeros_for_missing_near_the_origin(rng):
    """A marker 30 mm from the origin that moves 1 mm a frame: its 100 zeros are no places, not even the middle."""
    xyz = np.full((300, 1, 3), 17.0) + np.cumsum(rng.normal(0, 1, (300, 1, 3)), axis=0) * 0.3
    xyz[100:200] = 0
    assert placeholders(xyz)[100:200].all()


@pytest.fixture
def relative(rng):
    """Hip, knee and ankle in m, relative to the hip: the first is the origin in all frames, and nothing is missing."""
    t = np.arange(T) / 100
    angle = np.stack([0.3 * np.sin(5 * t), 0.3 * np.sin(5 * t) - 0.5 - 0.4 * np.cos(5 * t)])
    thigh, shank = (np.stack([np.sin(a), 0 * a, -np.cos(a)], axis=-1) * 0.25 for a in angle)
    return np.stack([np.zeros((T, 3)), thigh, thigh + shank], axis=1) + rng.normal(0, 1e-4, (T, 3, 3)) * [
        [[0], [1], [1]]
    ]


def write_relative(path, xyz):
    head = "time (s)," + ",".join(f"{name}_{a} (m)" for name in ("hip", "knee", "ankle") for a in "XYZ")
    path.write_text(head + "\n" + rows(xyz, lambda i: [f"{i / 100:.2f}"], ","))


def test_the_marker_that_is_the_origin_is_a_position(tmp_path, relative):
    """One marker alone at zero in all frames, and no zeros elsewhere: it is the root, counted; as ``zero`` states it.

    The finding goes the other way where a second marker stays there too, or another jumps there and back.
    """
    path = tmp_path / "x.csv"
    write_relative(path, relative)
    found = read(path)
    assert found.points.seen.all()
    assert found.findings[0].startswith(f"{T} samples at exactly (0, 0, 0) are positions and were read so")
    assert "all of 'hip', the origin of the others; if they stand for missing, give `zero` missing" in found.findings[0]
    assert found.findings[0] in found.assumed
    stated = read(path, Hints(zero="missing"))
    assert stated.points.seen.all(axis=0).tolist() == [False, True, True]
    assert f"{T} samples at exactly (0, 0, 0) stand for missing and were read so, as stated" in stated.findings[0]
    for other in (np.arange(T), np.arange(40, 60)):
        zeros = relative.copy()
        zeros[other, 2] = 0.0
        write_relative(path, zeros)
        assert read(path).points.seen.any(axis=0).tolist() == [False, True, len(other) < T]
        assert read(path, Hints(zero="position")).points.seen.all()


def test_markers_at_zero_throughout_are_missing_whatever_their_residual(tmp_path, xyz):
    """Two markers in one place were not seen there, nor one whose residual is the largest of its byte; one else was.

    Read by ezc3d too, so that the file is what it is meant to be: zeros, with a residual above 0.
    """
    import ezc3d

    xyz[40:60, 1] = xyz[39, 1]  # only the last marker is at zero
    one, both = xyz.copy(), xyz.copy()
    both[:, 2] = 0
    scale = 0.1
    largest = np.full((T, M), 5 * scale)
    largest[:, 3] = 255 * scale
    for name, places, residual, seen in (
        ("one", one, 5 * scale, [True, True, True, True]),
        ("both", both, 5 * scale, [True, True, False, False]),
        ("largest", one, largest, [True, True, True, False]),
    ):
        write_c3d(tmp_path / f"{name}.c3d", places, residual, scale)
        back = ezc3d.c3d(str(tmp_path / f"{name}.c3d"))
        np.testing.assert_allclose(back["data"]["meta_points"]["residuals"][0, 3], np.max(residual), rtol=1e-6)
        found = read(tmp_path / f"{name}.c3d")
        assert found.points.seen.all(axis=0).tolist() == seen, name
        assert found.points.seen.any(axis=0).tolist() == seen, name
        assert "samples at exactly (0, 0, 0)" in found.findings[0]


def test_zero_is_stated_on_the_command_line(mocap, tmp_path, relative):
    """``--zero missing`` is heard, and the finding names the option, and not the argument of Python."""
    write_relative(tmp_path / "x.csv", relative)
    code, out, _ = mocap("info", tmp_path / "x.csv")
    assert code == 0
    assert "give --zero missing" in " ".join(out.split())
    code, out, _ = mocap("info", tmp_path / "x.csv", "--zero", "missing")
    assert "was never seen" in " ".join(out.split())
