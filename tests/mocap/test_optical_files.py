"""Qualisys, Vicon and C3D exports of other people, against what their authors and other readers say of them."""

import re

import numpy as np
import pytest

from mocap.errors import FormatError
from mocap.io.c3d import read_c3d
from mocap.io.optical_csv import read_vicon
from mocap.io.qualisys import read_mat, read_tsv
from mocap.io.registry import read
from mocap.records import Status
from tests.real_data import real

GLIDES = ["205_81", "412_86", "506_88", "628_95", "705_86", "706_81", "910_81", "918_30"]
MOUSE = ("mouse_mocap_qtm", "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat")

TSV = (
    "NO_OF_FRAMES\t2\r\nNO_OF_MARKERS\t2\r\nFREQUENCY\t100\r\nMARKER_NAMES\ttip\troot\r\n"
    "Frame\tTime\ttip X\ttip Y\ttip Z\troot X\troot Y\troot Z\t\r\n"
    "11\t0.10000\t1\t2\t3\tNA\tNA\tNA\t\r\n12\t0.11000\t4\t5\t6\t0.000\t0.000\t0.000\t\r\n"
)
CSV = (
    "Trajectories\r\n100\r\n,,A:tip,,,A:root,,\r\nFrame,Sub Frame,X,Y,Z,X,Y,Z\r\n,,mm,mm,mm,mm,mm,mm\r\n"
    "11,0,1,2,3,,,\r\n12,0,4,5,6,0,0,0\r\n"
)


def test_mouse_counts_are_the_exporters():
    """PROVENANCE.md: 29927 missing, 83025 measured, 2548 filled of 11 markers x 10500 frames at 300 Hz."""
    tracks = read_mat(real(*MOUSE)).points
    assert tracks.xyz_m.shape == (10500, 11, 3)
    assert tracks.names[0] == "left_hip"
    assert tracks.names[-1] == "miniscope"
    counts = [np.sum(tracks.status == code) for code in (Status.MISSING, Status.MEASURED, Status.INTERPOLATED)]
    assert counts == [29927, 83025, 2548]
    np.testing.assert_array_equal(tracks.seen, tracks.status != Status.MISSING)
    np.testing.assert_allclose(np.diff(tracks.t_s), 1 / 300, rtol=1e-9)
    # a mouse: its hips lie a centimetre or two apart
    assert 0.005 < np.nanmedian(np.linalg.norm(tracks.xyz_m[:, 0] - tracks.xyz_m[:, 1], axis=-1)) < 0.03


@pytest.mark.parametrize("trial", GLIDES)
def test_the_authors_fill_changes_no_measured_value(trial):
    """PROVENANCE.md: raw and filled files have one shape, and what was measured was left alone to the last digit."""
    raw = read_tsv(real("snake_glide_qualisys", f"{trial}.tsv")).points
    filled = read_tsv(real("snake_glide_qualisys", f"{trial}_filled.tsv")).points
    assert filled.names == raw.names
    np.testing.assert_array_equal(filled.t_s, raw.t_s)
    assert filled.seen[raw.seen].all()
    np.testing.assert_array_equal(filled.xyz_m[raw.seen], raw.xyz_m[raw.seen])


@pytest.mark.parametrize(
    ("trial", "frames", "markers", "missing", "filled"),
    [("705_86", 321, 18, 37.7, 225), ("628_95", 317, 14, 38.9, 216), ("412_86", 241, 17, 0.5, 21)],
)
def test_glide_statistics_are_those_of_another_reader(trial, frames, markers, missing, filled):
    """The table in PROVENANCE.md was counted with other code; its per cents have one decimal."""
    raw = read_tsv(real("snake_glide_qualisys", f"{trial}.tsv")).points
    full = read_tsv(real("snake_glide_qualisys", f"{trial}_filled.tsv")).points
    assert raw.seen.shape == (frames, markers)
    assert 100 * (1 - raw.seen.mean()) == pytest.approx(missing, abs=0.051)
    assert np.sum(full.seen & ~raw.seen) == filled
    np.testing.assert_allclose(np.diff(raw.t_s), 1 / 179, rtol=1e-9)


@pytest.mark.parametrize(
    ("trial", "frames", "missing"), [("040_Snake94_gap02_3", 542, 1.6), ("053_Snake89_gap02_1", 672, 0.3)]
)
def test_vicon_statistics_are_those_of_another_reader(trial, frames, missing):
    """PROVENANCE.md: frames, rate, and the share of the ten snake markers that is missing, to one decimal."""
    tracks = read_vicon(real("snake_gap_vicon", f"{trial}.csv")).points
    assert tracks.seen.shape == (frames, 14)
    snake = [m for m, name in enumerate(tracks.names) if name.lower().startswith("snake")]
    assert len(snake) == 10
    assert 100 * (1 - tracks.seen[:, snake].mean()) == pytest.approx(missing, abs=0.051)
    np.testing.assert_allclose(np.diff(tracks.t_s), 1 / 150, rtol=1e-9)
    # the head's marker is a metre-sized number of millimetres in the file
    assert 0.01 < np.nanmedian(np.abs(tracks.xyz_m)) < 2


def test_variants_of_one_c3d_agree():
    """The readme of sample_01 and 02: the same values in Intel, DEC and SGI, integers and reals.

    Integers are cut off at the scale of the file, 0.083 and 0.281 mm; reals to 24 bits of at most 2.5 m. Residuals are
    whole multiples of the scale, in some files of sample_02 one more.
    """
    for folder, files, scale_mm in (
        ("sample_01", ["Eb015pr", "Eb015pi", "Eb015vi", "Eb015vr", "Eb015si", "Eb015sr"], 0.0834),
        ("sample_02", ["pc_real", "pc_int", "dec_int", "dec_real", "sgi_int", "sgi_real"], 0.2812),
    ):
        first, *others = [read_c3d(real("c3d_samples", folder, f"{name}.c3d")) for name in files]
        for other in others:
            assert other.points.names == first.points.names
            assert (other.fps, other.unit) == (first.fps, first.unit)
            np.testing.assert_array_equal(other.points.status, first.points.status)
            residuals = other.tables["residual_m"], first.tables["residual_m"]
            np.testing.assert_allclose(*residuals, rtol=0, atol=scale_mm * 1e-3)
            np.testing.assert_allclose(other.points.xyz_m, first.points.xyz_m, rtol=0, atol=scale_mm * 1e-3 + 1e-6)
        assert (first.points.status == Status.INTERPOLATED).any()


def test_c3d_counts_are_those_of_another_reader():
    """PROVENANCE.md, counted elsewhere: gait-raw 27 x 142 with 54 % missing; Eb015 26 x 450 at 50 Hz."""
    raw = read_c3d(real("c3d_samples", "sample_03", "gait-raw.c3d")).points
    assert raw.seen.shape == (142, 27)
    assert 1 - raw.seen.mean() == pytest.approx(0.545, abs=0.001)
    eb015 = read_c3d(real("c3d_samples", "sample_01", "Eb015pi.c3d")).points
    assert eb015.seen.shape == (450, 26)
    np.testing.assert_allclose(np.diff(eb015.t_s), 1 / 50, rtol=1e-9)
    assert 1 < np.nanmax(eb015.xyz_m) < 3


def test_modelled_quantities_are_no_markers():
    """gait-pig holds 77 points, 30 of which its groups call angles, forces, moments and powers: those are not places.

    It records no residuals (all are 0 or -1): what it holds is measured, as far as the file tells.
    """
    pig = read_c3d(real("c3d_samples", "sample_03", "gait-pig.c3d")).points
    assert len(pig.names) < 77
    assert not any("Angle" in name or "Moment" in name or "Power" in name for name in pig.names)
    assert set(np.unique(pig.status)) == {Status.MISSING, Status.MEASURED}


def test_small_qualisys_file(tmp_path):
    """Times follow from frame numbers, millimetres become metres, NA is not seen and zero is a place."""
    path = tmp_path / "a.tsv"
    path.write_bytes(TSV.encode())
    tracks = read_tsv(path).points
    assert tracks.names == ("tip", "root")
    np.testing.assert_allclose(tracks.t_s, [0.10, 0.11])
    np.testing.assert_allclose(tracks.xyz_m[:, 0], [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
    assert np.isnan(tracks.xyz_m[0, 1]).all()
    assert not tracks.xyz_m[1, 1].any()
    np.testing.assert_array_equal(tracks.status, [[Status.MEASURED, Status.MISSING], [Status.MEASURED] * 2])


@pytest.mark.parametrize("before", ["", "Devices\r\n1000\r\nFrame,Sub Frame,V\r\n1,0,0.5\r\n\r\n"])
@pytest.mark.parametrize("after", ["", "\r\nModel Outputs\r\n100\r\n,,x\r\n"])
def test_small_vicon_file(tmp_path, before, after):
    """The section is found between others, and read to the empty line after it."""
    path = tmp_path / "a.csv"
    path.write_bytes((before + CSV + after).encode())
    tracks = read_vicon(path).points
    assert tracks.names == ("A:tip", "A:root")
    np.testing.assert_allclose(tracks.t_s, [0.10, 0.11])
    np.testing.assert_allclose(tracks.xyz_m[:, 0], [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
    np.testing.assert_array_equal(tracks.seen, [[True, False], [True, True]])
    assert not tracks.xyz_m[1, 1].any()


def test_rows_that_somebody_took_out(tmp_path):
    """NO_OF_FRAMES of the whole recording is told, and the rows that are there are read."""
    part = tmp_path / "a.tsv"
    part.write_text(TSV.split("12\t")[0])
    got = read_tsv(part)
    assert list(got.frames) == [11]
    assert "NO_OF_FRAMES is 2, but there are 1 rows" in got.findings


DAMAGED_TSV = {
    "empty": ("", "the file is empty"),
    "cut in a number": (TSV.removesuffix("0\t\r\n"), "line 7 has 7 cells, expected 8 as the header states"),
    "no rows": (TSV.split("11\t")[0], "no frames after the header"),
    "no names": (re.sub(r"MARKER_NAMES[^\n]*\n", "", TSV), "no line MARKER_NAMES"),
    "a name short": (TSV.replace("\troot\r", "\r"), "NO_OF_MARKERS is 2, with 1 names"),
    "the same name twice": (TSV.replace("\troot\r", "\ttip\r"), "marker 'tip' appears twice"),
    "a word": (TSV.replace("\t5\t", "\tx5\t"), "line 7, cell 4: 'x5' is not a finite number"),
    "infinite": (TSV.replace("\t5\t", "\tinf\t"), "line 7, cell 4: 'inf' is not a finite number"),
    "a cell short": (TSV.replace("\t5\t", "\t"), "line 7 has 7 cells, expected 8"),
    "no rate": (TSV.replace("FREQUENCY\t100", "FREQUENCY\t0"), "the frame rate is 0"),
    "another rate": (
        TSV.replace("FREQUENCY\t100", "FREQUENCY\t120"),
        "line 6: frame 11 at 120 Hz does not fall on 0.1 s",
    ),
    "neither titles nor times, one cell left": (
        re.sub(r"Frame\tTime[^\n]*\n", "", TSV).replace("11\t0.10000\t1", "1"),
        "2 names and 6 columns|line 6 has",
    ),
    "frames backwards": (TSV.replace("12\t0.11", "10\t0.09"), "line 7: 10 follows frame 11"),
    "not text": (b"MATLAB\0\xff\xfe\n", "not a text file"),
}
DAMAGED_CSV = {
    "empty": ("", "the file is empty"),
    "another table": ("pt1_X,pt1_Y\r\n1,2\r\n", "no line Trajectories"),
    "cut in the head": (CSV.split("Frame,")[0], "should contain the rate"),
    "no frames": (CSV.split("11,0")[0], "no frames after the header"),
    "a word": (CSV.replace("4,5,6", "4,x5,6"), "line 7, cell 4: 'x5' is not a finite number"),
    "a cell short": (CSV.replace("4,5,6", "4,6"), "line 7 has 7 cells, expected 8"),
    "no unit": (CSV.replace("mm", ""), r"units are \[\]"),
    "two units": (CSV.replace("mm\r", "m\r"), r"units are \['m', 'mm'\]"),
    "another unit": (CSV.replace("mm", "furlong"), "lengths are in 'furlong'"),
    "no positions": (CSV.replace("X,Y,Z,X,Y,Z", "X,Y,Z,X',Y',Z'"), "6 columns, 1 of X, for 2 marker names"),
    "no rate": (CSV.replace("\r\n100\r\n", "\r\n-1\r\n"), "the frame rate is -1"),
    "no frame number": (CSV.replace("12,0", ",0"), "line 7: no frame number"),
}


@pytest.mark.parametrize(
    ("read", "content", "message"),
    [(read_tsv, *case) for case in DAMAGED_TSV.values()] + [(read_vicon, *case) for case in DAMAGED_CSV.values()],
    ids=[f"qualisys: {name}" for name in DAMAGED_TSV] + [f"vicon: {name}" for name in DAMAGED_CSV],
)
def test_damaged_text_is_refused_in_one_line(tmp_path, read, content, message):
    """One line that names the file, the place and what to do."""
    path = tmp_path / "trial7.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FormatError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith("trial7.csv: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("read", "parts"), [(read_mat, MOUSE), (read_c3d, ("c3d_samples", "sample_01", "Eb015pi.c3d"))]
)
@pytest.mark.parametrize("keep", [0, 10, 600, 20_000, 150_000])
def test_cut_binaries_are_refused(tmp_path, read, parts, keep):
    """However early a binary file ends, the reader says that it cannot be read, and nothing else happens."""
    path = tmp_path / "cut.bin"
    path.write_bytes(real(*parts).read_bytes()[:keep])
    with pytest.raises(FormatError, match=r"cut\.bin: ") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_a_recording_longer_than_its_head_can_say_is_called_cut(tmp_path):
    """16 bits count the frames of a C3D file; the parameter that counts the others is compared with what came."""
    import ezc3d

    path = tmp_path / "long.c3d"
    for words, cut in (([70000 & 0xFFFF, 70000 >> 16], True), ([5, 0], False)):
        file = ezc3d.c3d()
        file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
        file["parameters"]["POINT"]["LABELS"]["value"] = ["a"]
        file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
        file.add_parameter("TRIAL", "ACTUAL_END_FIELD", words)
        file["data"]["points"] = np.ones((4, 1, 5))
        file.write(str(path))
        findings = " ".join(read_c3d(path).findings)
        assert ("TRIAL:ACTUAL_END_FIELD states 70000 frames, but the file contains 5" in findings) == cut


def motive(kinds=("Rigid Body", "Rigid Body Marker", "Marker")):
    """An export as Motive 2 and 3 write it: a body with rotation, its fitted marker, and the marker as measured."""
    parts = {
        "Rigid Body": ("box", "Rotation,Rotation,Rotation,Rotation,Position,Position,Position", "X,Y,Z,W,X,Y,Z"),
        "Rigid Body Marker": ("box:tip", "Position,Position,Position", "X,Y,Z"),
        "Marker": ("box:tip", "Position,Position,Position", "X,Y,Z"),
    }
    rows = {
        "Rigid Body": ["0,0,0,1,7,8,9", "0,0,0,1,7,8,9", "0,0,0,1,7,8,9"],
        "Rigid Body Marker": ["1.5,2.5,3.5"] * 3,
        "Marker": ["1,2,3", ",,", "4,5,6"],
    }
    some = [(kind, *parts[kind]) for kind in kinds]
    head = [
        "Format Version,1.23,Take Name,Take 1,Take Notes,,Capture Frame Rate,120.000000,Export Frame Rate,120.000000,"
        "Capture Start Time,2023-03-29 06.23.40.520,Rotation Type,Quaternion,Length Units,Millimeters,"
        "Coordinate Space,Global",
        "",
        ",Type," + ",".join(",".join([kind] * len(axes.split(","))) for kind, _, _, axes in some),
        ",Name," + ",".join(",".join([name] * len(axes.split(","))) for _, name, _, axes in some),
        ",ID," + ",".join(",".join(['"C5B9"'] * len(axes.split(","))) for _, _, _, axes in some),
        ",," + ",".join(what for _, _, what, _ in some),
        "Frame,Time (Seconds)," + ",".join(axes for _, _, _, axes in some),
    ]
    data = [f"{t},{t / 120:.6f}," + ",".join(rows[kind][t] for kind in kinds) for t in range(3)]
    return "\r\n".join([*head, *data, ""])


def test_markers_of_motive(tmp_path):
    """Markers as measured come first, then those of a fitted body, then bodies; frame 0 is at 0 s; mm become metres."""
    path = tmp_path / "take.csv"
    for kinds, first in (
        (("Rigid Body", "Rigid Body Marker", "Marker"), [1, 2, 3]),
        (("Rigid Body", "Rigid Body Marker"), [1.5, 2.5, 3.5]),
        (("Rigid Body",), [7, 8, 9]),
    ):
        path.write_text(motive(kinds), newline="")
        found = read(path)
        assert found.format == "optitrack-csv"
        assert found.fps == 120
        np.testing.assert_allclose(found.points.t_s, [0, 1 / 120, 2 / 120])
        np.testing.assert_allclose(found.points.xyz_m[0, 0], np.array(first) / 1000)
        assert any("no markers" in line for line in found.findings) == ("Marker" not in kinds)
    path.write_text(motive(), newline="")
    assert read(path).points.seen[:, 0].tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("Millimeters", "Furlongs"), "Length Units is 'Furlongs'"),
        (("Frame,Time (Seconds)", "Time"), "no line Frame,Time"),
        ((",Name,box,", ",Name,"), "should contain the types, names, IDs"),
        (("4,5,6", "4,5"), "line 10 has 14 cells, expected 15"),
        (("4,5,6", "4,x,6"), "line 10, cell 14: 'x' is not a finite number"),
        (("Position", "Rotation"), "no columns of positions"),
        (("Export Frame Rate,120", "Export Frame Rate,0"), "the frame rate is 0"),
    ],
)
def test_a_damaged_export_of_motive_is_refused(tmp_path, change, said):
    """Each with what was expected, and its line where there is one."""
    path = tmp_path / "take.csv"
    path.write_text(motive().replace(*change), newline="")
    with pytest.raises(FormatError, match=re.escape(said)):
        read(path)
