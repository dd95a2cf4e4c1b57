"""Frames that a file leaves out come back as frames that show nothing, where times have a common step."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eal.arrays import frozen
from mocap.cleaning.cleaning import clean
from mocap.errors import FormatError
from mocap.io.every_frame import MOST, every_frame, frame_steps
from mocap.io.registry import write
from mocap.reading.reading import read
from mocap.records import Status
from tests.mocap.recordings import pixel_recordings, point_recordings, points


def some_frames(recording, keep):
    """The recording without the other frames."""

    def tracks(values, axis):
        return None if values is None else np.compress(keep, values, axis=axis)

    pixels, found = recording.pixels, recording.points
    if pixels is not None:
        pixels = replace(pixels, t_s=pixels.t_s[keep], uv_px=tracks(pixels.uv_px, 1))
    if found is not None:
        parts = {name: getattr(found, name)[keep] for name in ("t_s", "xyz_m", "cov_m2", "status")}
        found = replace(found, **parts)
    score = recording.score
    return replace(
        recording,
        frames=recording.frames[keep],
        pixels=pixels,
        points=found,
        score=None if score is None else tracks(score, score.ndim - 2),
        tables={name: table[keep] for name, table in recording.tables.items()},
    )


def walk(n_frames=60, seed=0):
    xyz = np.cumsum(np.random.default_rng(seed).normal(0, 1e-3, (n_frames, 4, 3)), axis=0) + np.arange(4)[:, None]
    return points(list("abcd"), xyz)


@pytest.mark.parametrize(("digits", "longest"), [(9, 200), (3, 12)])
@given(data=st.data(), fps=st.sampled_from([24.0, 30.0, 59.94, 100.0, 240.0, 333.0]))
def test_frames_are_counted_from_rounded_times(digits, longest, data, fps):
    """Each step is the whole number of frames that it was, whether times have nine decimals or three."""
    frames = [1, 1, *data.draw(st.lists(st.sampled_from([1, 1, 1, 2, 3, longest]), min_size=5, max_size=60))]
    times = np.round(np.cumsum([0, *frames]) / fps, digits)
    found = frame_steps(times).tolist()
    unsaid = digits == 3 and not found  # of steps of 4 and 5 ms: which is one frame may not be said
    assert found == frames or unsaid


@given(recording=st.one_of(point_recordings(), pixel_recordings()))
def test_whole_recordings_are_left_alone(recording):
    assert every_frame(recording) == (recording, ())


def test_a_file_of_every_tenth_frame_is_whole():
    recording = some_frames(walk(), np.arange(60) % 10 == 0)
    assert every_frame(recording) == (recording, ())


@given(recording=st.one_of(point_recordings(), pixel_recordings()), data=st.data())
def test_what_is_left_out_comes_back_unseen(recording, data):
    """All else is where it was; what was left out is missing, in every part."""
    n_frames = len(recording.frames)
    assume(n_frames >= 4)
    keep = np.ones(n_frames, dtype=bool)
    keep[data.draw(st.integers(1, n_frames - 3))] = False
    keep[[0, -2, -1]] = True
    told, findings = every_frame(some_frames(recording, keep))
    assert told.frames.tolist() == recording.frames.tolist()
    assert len(findings) == 1
    assert f"{(~keep).sum()} of {n_frames} frames are not in the file" in findings[0]
    for before, after in ((recording.points, told.points), (recording.pixels, told.pixels)):
        if before is not None:
            np.testing.assert_allclose(after.t_s, before.t_s, atol=1e-9)
    if recording.points is not None:
        np.testing.assert_array_equal(told.points.xyz_m[keep], recording.points.xyz_m[keep])
        assert np.isnan(told.points.xyz_m[~keep]).all()
        assert (told.points.status[~keep] == Status.MISSING).all()
        assert (told.points.status[keep] == recording.points.status[keep]).all()
    else:
        np.testing.assert_array_equal(told.pixels.uv_px[:, keep], recording.pixels.uv_px[:, keep])
        assert not told.pixels.seen[:, ~keep].any()


def test_a_long_pause_is_refused_and_uneven_times_are_told():
    recording = walk()
    late = np.where(np.arange(60) < 30, 0, MOST * 60) / 250 + recording.points.t_s
    with pytest.raises(FormatError, match=r"has 60 frames, of 3060 .* from frame 30 to 31\): split it"):
        every_frame(replace(recording, points=replace(recording.points, t_s=late)))
    times = np.cumsum(np.random.default_rng(0).uniform(0.5, 2.0, 60)) / 250
    uneven = replace(recording, points=replace(recording.points, t_s=frozen("t_s", times, (None,))))
    same, findings = every_frame(uneven)
    assert same is uneven
    assert "times are uneven: steps of 0.00" in findings[0]


def test_a_csv_without_some_frames_is_prepared_with_them(tmp_path):
    """Ten rows are cut out of a file of ours: the gap is 10 frames long, nothing jumps, and the report says so."""
    whole, path = walk(200), tmp_path / "walk.csv"
    keep = ~np.isin(np.arange(200), np.arange(90, 100))
    write(some_frames(whole, keep), path, "csv-long")
    prepared = clean(read(path))
    np.testing.assert_allclose(np.diff(prepared.t_s), 1 / 250, rtol=1e-6)
    assert len(prepared.t_s) == 200
    assert np.isnan(prepared.xyz_m[90:100]).all()
    np.testing.assert_allclose(prepared.xyz_m[keep], whole.points.xyz_m[keep], atol=1e-6)
    assert prepared.findings[0].text.startswith("10 of 200 frames are not in the file (most on end between 90 and 101)")
    assert not any(mask.any() for mask in prepared.rejected.values())


def test_a_stated_deviation_of_nothing_is_not_believed(tmp_path):
    """A file that says 0 for every sample gets the deviation that its own samples show."""
    whole, path = walk(200), tmp_path / "walk.csv"
    told = replace(whole, points=replace(whole.points, cov_m2=np.zeros((200, 4, 3, 3))))
    write(told, path, "csv-long")
    sd = np.sqrt(np.diagonal(clean(read(path)).cov_m2, axis1=-2, axis2=-1))
    assert sd.min() > 1e-4
