"""Times that a file rounds too coarsely for its rate: what is stated beats what is derived of them."""

import numpy as np
import pytest

import mocap
from mocap.errors import FormatError, MocapError
from mocap.io.format import Hints
from mocap.io.lines import even_times
from mocap.io.registry import read


def write_trc(path, times, rate, frames=None):
    """Two markers that move by 1 mm a frame."""
    frames = np.arange(1, len(times) + 1) if frames is None else frames
    head = (
        f"PathFileType\t4\t(X/Y/Z)\tx\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n{rate}\t{rate}\t{len(times)}"
        "\t2\tmm\nFrame#\tTime\ta\t\t\tb\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    )
    rows = (
        f"{k}\t{t}\t" + "\t".join(f"{1000 + 10 * c + k:.3f}" for c in range(6)) + "\n"
        for k, t in zip(frames, times, strict=True)
    )
    path.write_text(head + "".join(rows))


def write_csv(path, times):
    rows = (f"{t},{k}.5,{k}.25,{k}.125\n" for k, t in enumerate(times, start=1))
    path.write_text("time (s),a_x (mm),a_y (mm),a_z (mm)\n" + "".join(rows))


@pytest.mark.parametrize(("fps", "decimals"), [(2000, 3), (700, 3), (240, 2), (59.94, 2)])
def test_the_rate_of_the_header_beats_rounded_times(tmp_path, fps, decimals):
    """Frames are even at DataRate, whatever digits its times lack: to 1e-12 s of k / fps, none lost, none added."""
    count = np.arange(100)
    write_trc(tmp_path / "x.trc", [f"{k / fps:.{decimals}f}" for k in count], fps)
    found = read(tmp_path / "x.trc")
    assert found.fps == fps
    np.testing.assert_allclose(found.points.t_s, count / fps, atol=1e-12)
    assert any("times are rounded" in finding for finding in found.findings)
    assert mocap.read(tmp_path / "x.trc").data.sizes["time"] == 100


def test_frames_that_are_left_out_stay_out(tmp_path):
    """Frame numbers with a hole, and times rounded to less than a frame: the hole is one of 20 frames in time too."""
    frames = np.append(np.arange(1, 51), np.arange(71, 121))
    write_trc(tmp_path / "x.trc", [f"{(k - 1) / 2000:.3f}" for k in frames], 2000, frames)
    found = read(tmp_path / "x.trc")
    np.testing.assert_allclose(found.points.t_s, (frames - 1) / 2000, atol=1e-12)


def test_the_rate_that_is_stated_beats_a_column_of_times(tmp_path):
    """Without a header the user's rate stands; without that, what fits: one rate of many frames, else it is asked."""
    for count, fits in ((3000, True), (40, False)):
        write_csv(tmp_path / "x.csv", [f"{k / 29.97:.1f}" for k in range(count)])
        assert read(tmp_path / "x.csv", Hints(fps=29.97)).fps == 29.97
        recording = mocap.read(tmp_path / "x.csv", fps=29.97)
        np.testing.assert_allclose(recording.data["time"], np.arange(count) / 29.97, atol=1e-9)
        found = read(tmp_path / "x.csv")
        assert found.fps == (29.97 if fits else None)
        if not fits:
            assert any("leaves the rate open" in finding for finding in found.findings)
            with pytest.raises(MocapError, match="the frame rate is not in the file: give `fps`"):
                mocap.read(tmp_path / "x.csv")


def test_a_line_that_stands_twice_is_no_rounding(tmp_path):
    """100 a second with two decimals: a time that repeats is a line too many, also by the header; so is a fall."""
    times = [f"{k / 100:.2f}" for k in range(100)]
    for wrong in ([*times[:50], *times[49:]], [*times[:50], times[51], times[50], *times[52:]]):
        write_trc(tmp_path / "x.trc", wrong, 100)
        with pytest.raises(FormatError, match="times do not increase"):
            read(tmp_path / "x.trc")
        assert any("were not used" in finding for finding in read(tmp_path / "x.trc", Hints(fps=100.0)).findings)


def test_uneven_times_stay_uneven(tmp_path):
    """Every third of frames of 1 kHz was lost at random: no even rate rounds to these, so holes stay holes."""
    rng = np.random.default_rng(0)
    t_s = np.sort(rng.choice(900, 600, replace=False)) / 1000
    times, fps, notes = even_times(tmp_path, t_s, header=1000.0)
    np.testing.assert_array_equal(times, t_s)
    assert fps == 1000
    assert "uneven" in notes[0]
