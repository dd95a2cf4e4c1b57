"""Each threshold of reading and writing, with a case just below and one just above it."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from mocap.errors import FormatError
from mocap.io import other_rigs
from mocap.io.apart import most_bytes
from mocap.io.c3d import _agrees, _rate, read_c3d, write_c3d
from mocap.io.contents import pixel_recording, point_recording
from mocap.io.every_frame import every_frame, frame_steps
from mocap.io.lines import frame_numbers, rate_of_times
from mocap.io.plausible import plausible
from mocap.io.registry import read, write
from mocap.io.title_rows import _numbers
from mocap.io.unstated_unit import ANIMALS_M, PATHS_M, XRAYED_M, assumed_unit, guessed


def refused(*, ok, match):
    """What a reader does with it."""
    return nullcontext() if ok else pytest.raises(FormatError, match=match)


def sparse(path, megabytes):
    """A file of zeros."""
    with path.open("wb") as stream:
        stream.truncate(megabytes * 1_000_000)


@pytest.mark.parametrize(
    ("long", "noise", "bounds", "unit"),
    [
        (0.8e-4, np.nan, ANIMALS_M, None),  # from a mite
        (1.2e-4, np.nan, ANIMALS_M, "m"),
        (17e3, np.nan, ANIMALS_M, "mm"),  # to a whale
        (24e3, np.nan, ANIMALS_M, None),
        (250.0, np.nan, PATHS_M, "m"),
        (350.0, np.nan, PATHS_M, "mm"),
        (0.25, np.nan, XRAYED_M, "m"),  # 2.5 mm in cm, 0.25 mm in mm
        (0.35, np.nan, XRAYED_M, "cm"),
        (42.0, np.nan, XRAYED_M, "cm"),
        (58.0, np.nan, XRAYED_M, "mm"),
        (2.5, 0.06, ANIMALS_M, "m"),  # few animals are longer than 3 m, and no system errs by more than 5 cm
        (3.5, 0.06, ANIMALS_M, "mm"),
        (3.5, 0.04, ANIMALS_M, "m"),
    ],
)
def test_a_unit_makes_it_an_animal(long, noise, bounds, unit):
    assert guessed(long, noise, bounds_m=bounds) == unit


@pytest.mark.parametrize(
    ("long", "noise", "words"), [(2.5, 0.04, ""), (3.5, 0.04, "state the"), (2.5, 0.06, "jitters")]
)
def test_an_unusual_length_is_told(long, noise, words):
    """A longer animal with other units that may be meant, a noisier one in capitals."""
    _, finding = assumed_unit(long, noise, bounds_m=ANIMALS_M, where="a.csv", what="the animal")
    assert words in finding.text
    assert finding.alarm == (words == "jitters")
    assert ("state the" in finding.text) == bool(words)


def made(value=0.0, *, unit="m", fps=100.0):
    """One marker in three frames, at so much in the last one."""
    xyz = np.array([[[0.1, 0.2, 0.3]], [[0.1, 0.2, 0.3]], [[value, 0.2, 0.3]]])
    return point_recording(Path("a.trc"), "trc", names=["a"], xyz=xyz, unit=unit, fps=fps)


@pytest.mark.parametrize(
    ("given", "ok"),
    [
        ({"fps": 0.8e-4}, False),
        ({"fps": 1.2e-4}, True),
        ({"fps": 0.8e7}, True),
        ({"fps": 1.2e7}, False),
        ({"value": 0.8e8}, True),  # metres
        ({"value": 1.2e8}, False),
        ({"value": 0.8e11, "unit": None}, True),  # millimetres, for all that is known
        ({"value": 1.2e11, "unit": None}, False),
    ],
)
def test_what_no_recording_is(given, ok):
    """Rates of a picture in three hours to those of the fastest cameras; places on the earth."""
    with refused(ok=ok, match="expected"):
        plausible(made(**given))


@pytest.mark.parametrize(
    ("px", "score", "ok", "odd"), [(0.8e7, 1.4, True, 0), (1.2e7, 1.4, False, 0), (1, 1.6, True, 1)]
)
def test_what_no_pixel_and_no_score_is(px, score, ok, odd):
    """No image is ten million pixels wide; scores are 1 at most, and of some networks a little more."""
    uv = np.array([[[[1.0, 2.0]], [[3.0, float(px)]]]])
    recording = pixel_recording(
        Path("a.csv"), "dlc", names=["a"], cameras=["c"], uv_px=uv, fps=100.0, score=np.full((1, 2, 1), score)
    )
    with refused(ok=ok, match="expected"):
        assert sum("scores are" in said for said in plausible(recording).findings) == odd


@pytest.mark.parametrize(("frame", "ok"), [(0.8e9, True), (1.2e9, False)])
def test_frame_numbers_are_those_of_twelve_days_at_a_kilohertz(frame, ok):
    with refused(ok=ok, match="is not a frame number"):
        frame_numbers(Path("a.csv"), [0.0, frame])


@pytest.mark.parametrize(("last", "ok"), [(145, True), (155, False)])
def test_a_recording_becomes_fifty_times_as_long(last, ok):
    """Three frames, the last of which is so many frames after the first."""
    frames = np.array([1, 2, last])
    recording = point_recording(
        Path("a.csv"), "made", names=["a"], xyz=np.zeros((3, 1, 3)), unit="m", frames=frames, fps=100.0
    )
    with refused(ok=ok, match="split it"):
        assert len(every_frame(recording)[0].frames) == last


@pytest.mark.parametrize(("step", "whole"), [(2.25, 2), (2.35, 0), (9.5, 0), (10.5, 10)])
def test_steps_are_whole_to_three_tenths_or_ten_frames_long(step, whole):
    """After a hundred steps of a frame; half of a frame goes to the even number."""
    found = frame_steps(np.append(np.arange(101.0), 100 + step))
    assert (found[-1] if len(found) else 0) == whole


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        ([0.01] * 9 + [0.0145], ""),  # uneven by half of the usual step
        ([0.01] * 9 + [0.0155], "uneven"),
        ([0.8] * 9, ""),
        ([1.25] * 9, "milliseconds"),
        ([800.0] * 9, "milliseconds"),
        ([1250.0] * 9, "microseconds"),
    ],
)
def test_times_are_uneven_or_slow(steps, said):
    """A frame a second or fewer is asked after, in the unit in which it would be a thousand times as fast."""
    _, notes = rate_of_times(Path("a.csv"), np.cumsum([0.0, *steps]))
    assert bool(notes) == bool(said)
    assert said in "".join(notes)


@pytest.mark.parametrize(("second", "seconds"), [("01:01:00", -43_140), ("00:59:00", 43_140)])
def test_a_clock_that_goes_back_by_half_a_day_has_passed_midnight(second, seconds):
    """From one o'clock at noon on."""
    cells, _ = _numbers("t", ["13:00:00", second], quoted=False)
    assert float(cells[1]) - float(cells[0]) == seconds


def test_files_may_hold_24_minutes_of_20_markers_or_a_hundred_times_their_size(tmp_path):
    """At 250 Hz, nine doubles a sample: places and their covariances."""
    path = tmp_path / "a.nc"
    path.write_bytes(b"0")
    assert most_bytes(path) == pytest.approx(24 * 60 * 250 * 20 * 9 * 8, rel=0.05)
    sparse(path, 10)
    assert most_bytes(path) == 1_000_000_000


@pytest.mark.parametrize(("megabytes", "ok"), [(17, True), (23, False)])
def test_a_calibration_is_no_longer_than_twenty_megabytes(tmp_path, monkeypatch, megabytes, ok):
    path = tmp_path / "a.xcp"
    sparse(path, megabytes)
    monkeypatch.setattr(other_rigs, "decoded", lambda *_: ("<a/>", None))
    with refused(ok=ok, match="too long"):
        other_rigs.xml_root(path)


@pytest.mark.parametrize(("off", "same"), [(0.8e-5, True), (1.2e-5, False)])
def test_two_statements_of_a_c3d_file_are_the_same_to_five_digits(off, same):
    class Head:
        rate_hz = 100.0

        def number(self, _):
            return 100 * (1 + off)

    assert _agrees("scale", 1 + off, 1.0) == same
    assert (_rate(Head())[1] == []) == same


@pytest.mark.parametrize("fps", [0.8e-4, 1.2e-4, 0.8e7, 1.2e7])
def test_a_c3d_file_has_the_rates_of_all_recordings(fps):
    class Head:
        rate_hz = fps

        def number(self, _):
            return None

    assert _rate(Head())[0] == (fps if 1e-4 < fps < 1e7 else None)


@pytest.mark.parametrize(
    ("residual_m", "kept_m"), [(0.4e-5, 1e-5), (1.4e-5, 1e-5), (2.5e-3, 2.5e-3), (2.7e-3, 2.55e-3)]
)
def test_residuals_of_c3d_files_are_255_hundredths_of_a_millimetre(tmp_path, residual_m, kept_m):
    recording = point_recording(
        Path("a.csv"), "made", names=["a"], xyz=np.ones((2, 1, 3)), unit="m", fps=100.0,
        tables={"residual_m": np.full((2, 1), residual_m)},
    )  # fmt: skip
    write_c3d(tmp_path / "a.c3d", recording)
    np.testing.assert_allclose(read_c3d(tmp_path / "a.c3d").tables["residual_m"], kept_m, rtol=1e-5)


@pytest.mark.parametrize(("likelihood", "low"), [(0.55, 1), (0.65, 0)])
def test_likelihoods_are_low_below_deeplabcuts_cutoff(tmp_path, likelihood, low):
    path = tmp_path / "a.csv"
    path.write_text(f"scorer,s,s,s\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,2,0.99\n1,2,3,{likelihood}\n")
    assert sum("has a likelihood below 0.6" in said for said in read(path).findings) == low


@pytest.mark.parametrize(("off_m", "moved"), [(0.4e-9, 1), (0.6e-9, 0)])
def test_zero_is_a_nanometre_away_where_it_means_missing(tmp_path, off_m, moved):
    """In files that are written to a nanometre."""
    xyz = np.array([[[1.0, 2.0, 3.0]], [[off_m, 0.0, 0.0]]])
    recording = point_recording(Path("a.csv"), "made", names=["a"], xyz=xyz, unit="m", fps=100.0)
    lost = write(recording, tmp_path / "a.trc")
    assert sum("is set 1 nm away" in said for said in lost) == moved
