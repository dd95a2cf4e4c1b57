"""C3D files whose parts contradict each other: refused with the place, or read with a finding, never in silence."""

import struct

import ezc3d
import numpy as np
import pytest

from mocap.errors import FormatError
from mocap.io.c3d import read_c3d
from tests.real_data import real

SAMPLES = ("pyomeca/markers_analogs", "sample_01/Eb015pi", "sample_01/Eb015vr", "sample_03/gait-pig")


def made(path, frames=40, markers=3, words=None):
    """A file of ezc3d: reals, Intel, no analog channels."""
    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [100.0], ["mm"]
    point["LABELS"]["value"] = [f"m{i}" for i in range(markers)]
    for name, value in (words or {}).items():
        file.add_parameter("TRIAL", name, value)
    data = np.ones((4, markers, frames))
    data[:3] = np.random.default_rng(1).normal(scale=500.0, size=(3, markers, frames))
    file["data"]["points"] = data
    file.write(str(path))
    return path


def at_word(data: bytes, number: int) -> int:
    """Byte of the n-th word of the first block, from 1 as the guide counts."""
    assert len(data) >= 512
    return 2 * (number - 1)


def value_at(data: bytes, name: bytes, *, rank: int = 0) -> int:
    """Byte of the first value of a parameter of so many dimensions; the group's own record comes before it."""
    return data.index(name, 512) + len(name) + 2 + 2 + rank


@pytest.mark.parametrize("name", SAMPLES)
def test_values_are_those_of_another_reader(name):
    """ezc3d 1.7 and this reader give the same positions and residuals to the last bit."""
    path = real("c3d_samples", f"{name}.c3d")
    theirs, ours = ezc3d.c3d(str(path))["data"], read_c3d(path)
    xyz = np.transpose(theirs["points"][:3], (2, 1, 0)) * 1e-3
    labels = ezc3d.c3d(str(path))["parameters"]["POINT"]["LABELS"]["value"]
    which = [labels.index(label) for label in ours.names]
    np.testing.assert_array_equal(ours.points.xyz_m, xyz[:, which])
    residual = theirs["meta_points"]["residuals"][0].T[:, which] * 1e-3
    np.testing.assert_array_equal(ours.tables["residual_m"], np.where(residual > 0, residual, np.nan))


HEAD = {
    "points": (2, "the header states 4 points, but the file contains 3 points"),
    "analog values": (3, "the header states 1 analog values a frame, but the file contains 0 analog values a frame"),
    "begin of the data": (9, "the header states data from byte"),
    "scale of whole numbers": (7, "the header states a scale of"),
    "last frame, too low": (5, "the header states 20 frames, but the file contains 40 frames"),
    "last frame, too high": (5, "the header states 60 frames, but the file contains 40 frames"),
}


@pytest.mark.parametrize("what", HEAD)
def test_a_word_of_the_first_block_that_contradicts_the_rest(tmp_path, what):
    """Points, analog values, data start, scale and frames stand twice: the file's size says which number is right."""
    whole = read_c3d(made(tmp_path / "a.c3d"))
    word, message = HEAD[what]
    data = bytearray((tmp_path / "a.c3d").read_bytes())
    place = at_word(data, word)
    if word == 7:
        struct.pack_into("<f", data, place, 0.125)
    else:
        number = struct.unpack_from("<H", data, place)[0]
        changed = {2: number + 1, 3: number + 1, 9: number - 1, 5: 20 if "low" in what else 60}[word]
        struct.pack_into("<H", data, place, changed)
    (tmp_path / "a.c3d").write_bytes(data)
    got = read_c3d(tmp_path / "a.c3d")
    np.testing.assert_array_equal(got.points.xyz_m, whole.points.xyz_m)
    assert any(finding.startswith(message) for finding in set(got.findings) - set(whole.findings))


def test_two_scales_of_whole_numbers_are_refused(tmp_path):
    """The size of the file is the same with either scale, and no position is right with both: nothing is chosen."""
    data = bytearray(real("c3d_samples", "sample_01", "Eb015pi.c3d").read_bytes())
    struct.pack_into("<f", data, at_word(data, 7), 0.5)
    (tmp_path / "a.c3d").write_bytes(data)
    with pytest.raises(FormatError, match=r"a\.c3d: .* a scale of 0\.5 or 0\.0833\d*.*the size fits several"):
        read_c3d(tmp_path / "a.c3d")


def test_bytes_lost_within_the_data_are_seen(tmp_path):
    """One byte less moves all that follows; the padding of a file of whole blocks does not hide it."""
    data = real("c3d_samples", "sample_01", "Eb015pr.c3d").read_bytes()
    assert len(data) % 512 == 0
    for changed in (data[:9000] + data[9001:], data[:9000] + b"\0" + data[9000:], data[:9000] + data[9512:]):
        (tmp_path / "a.c3d").write_bytes(changed)
        with pytest.raises(FormatError, match=r"a\.c3d: .*(do not fill|are stated)"):
            read_c3d(tmp_path / "a.c3d")


def test_whole_blocks_after_the_data_are_told(tmp_path):
    """Some writers reserve blocks: where all agree on the frames, what follows them is left, and said."""
    whole = read_c3d(made(tmp_path / "a.c3d"))
    data = (tmp_path / "a.c3d").read_bytes()
    assert len(data) % 512 == 0
    (tmp_path / "a.c3d").write_bytes(data + bytes(1024))
    got = read_c3d(tmp_path / "a.c3d")
    np.testing.assert_array_equal(got.points.xyz_m, whole.points.xyz_m)
    frames = 40 * 3 * 16  # bytes; the last block is filled up
    assert f"{1024 + -frames % 512} bytes after the last frame were ignored" in got.findings


@pytest.mark.parametrize("back", [1, 2, 3], ids=["size", "rank", "type"])
def test_a_record_that_does_not_fit_takes_the_names_but_no_position(tmp_path, back):
    """POINT:LABELS with a type, rank or size of 127 ends where no other begins: unnamed points, and a finding."""
    whole = read_c3d(made(tmp_path / "a.c3d"))
    data = bytearray((tmp_path / "a.c3d").read_bytes())
    data[value_at(data, b"LABELS", rank=2) - back - (back == 1)] = 127
    (tmp_path / "a.c3d").write_bytes(data)
    got = read_c3d(tmp_path / "a.c3d").with_unit("mm")
    np.testing.assert_array_equal(got.points.xyz_m, whole.points.xyz_m)
    assert got.names == ("U_1", "U_2", "U_3")
    assert any("cannot be read" in finding or "differs from the one" in finding for finding in got.findings)


def test_a_wrong_length_of_a_record_is_a_finding():
    """The SGI files of sample_02 state the length of their last parameter with its bytes exchanged: all is read."""
    recording = read_c3d(real("c3d_samples", "sample_02", "sgi_int.c3d"))
    assert len(recording.names) == 36
    assert any("the length of the parameter LABELS" in finding for finding in recording.findings)


def test_a_frame_rate_stated_twice(tmp_path):
    """The rate of the first block is used; that POINT:RATE says another is told."""
    data = bytearray(made(tmp_path / "a.c3d").read_bytes())
    struct.pack_into("<f", data, 20, 200.0)
    (tmp_path / "a.c3d").write_bytes(data)
    recording = read_c3d(tmp_path / "a.c3d")
    assert recording.fps == 200
    assert "the frame rate is 100 in POINT:RATE, 200 in the header: the latter is used" in recording.findings
    struct.pack_into("<f", data, 20, 1e-38)
    (tmp_path / "a.c3d").write_bytes(data)
    assert read_c3d(tmp_path / "a.c3d").fps == 100


def test_bits_that_are_no_number_warn_nobody(tmp_path):
    """A signalling NaN (7F80 0001) among the reals of a DEC file is a sample that was not seen, without a warning."""
    data = bytearray(real("c3d_samples", "sample_01", "Eb015vr.c3d").read_bytes())
    start = 512 * (struct.unpack_from("<H", data, at_word(data, 9))[0] - 1)
    data[start : start + 4] = b"\x80\x7f\x01\x00"
    (tmp_path / "a.c3d").write_bytes(data)
    whole = read_c3d(real("c3d_samples", "sample_01", "Eb015vr.c3d"))
    assert whole.points.seen[0, 0]
    assert read_c3d(tmp_path / "a.c3d").points.seen.sum() == whole.points.seen.sum() - 1


def test_words_for_residuals_that_no_writer_makes(tmp_path):
    """A fourth word of 0.37 or NaN is neither a residual nor a mask of cameras: counted, and its sample not seen."""
    data = bytearray(made(tmp_path / "a.c3d").read_bytes())
    start = 512 * (struct.unpack_from("<H", data, at_word(data, 9))[0] - 1)
    for sample in (4, 5):
        struct.pack_into("<f", data, start + 16 * sample + 12, 0.37 if sample == 4 else np.nan)
    (tmp_path / "a.c3d").write_bytes(data)
    recording = read_c3d(tmp_path / "a.c3d")
    assert recording.points.seen.sum() == 118
    assert any(finding.startswith("2 samples have an invalid entry for residual") for finding in recording.findings)


def test_more_frames_than_sixteen_bits_count(tmp_path):
    """70,000 frames: the head says 65535 or less, TRIAL:ACTUAL_END_FIELD says it all, and the size agrees."""
    frames = 70_000
    words = {"ACTUAL_START_FIELD": [1, 0], "ACTUAL_END_FIELD": [frames & 0xFFFF, frames >> 16]}
    path = made(tmp_path / "a.c3d", frames=40, markers=1, words=words)
    data = bytearray(path.read_bytes())
    struct.pack_into("<H", data, at_word(data, 5), 0xFFFF)
    body = np.tile(np.array([1.5, 2.5, 3.5, 0.0], dtype="<f4"), (frames, 1))
    body[:, 0] = np.arange(frames) / 16  # exact in 24 bits
    path.write_bytes(data[: 512 * (struct.unpack_from("<H", data, at_word(data, 9))[0] - 1)] + body.tobytes())
    recording = read_c3d(path)
    np.testing.assert_array_equal(recording.frames[[0, -1]], [1, frames])
    np.testing.assert_allclose(recording.points.xyz_m[:, 0, 0], np.arange(frames) / 16e3, rtol=1e-15)
