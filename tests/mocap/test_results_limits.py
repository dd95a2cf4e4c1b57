"""Limits of results, batches and proposals, with a case just below and one just above each."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import chdtr

from mocap.batches import engine, trial
from mocap.errors import MocapError
from mocap.proposing.propose_skeleton import Kept, spanning_bones
from mocap.records import Status, marker_tracks
from mocap.rerun.tabs.health import nis_band
from mocap.results import keypoints, long_result


@pytest.mark.parametrize(("within_px", "likelihood"), [(17.0, 0.95), (22.7, 0.814), (12.75, 0.995)])
def test_a_likelihood_is_that_of_17_pixels(monkeypatch, within_px, likelihood):
    """Of a deviation of which 95 % of points are so near: 1 - exp(-r^2 / 2), of two coordinates."""
    variance = within_px**2 / -np.log(0.05)
    monkeypatch.setattr(keypoints, "_projected", lambda _: (np.ones((1, 1, 1, 2)), np.full((1, 1, 1), variance)))
    run = SimpleNamespace(
        tracks=marker_tracks(("a",), np.zeros(1), np.zeros((1, 1, 3))), cameras=[SimpleNamespace(name="c")],
        report={}, name="made",
    )  # fmt: skip
    assert keypoints.contents_of(run).score[0, 0, 0] == pytest.approx(likelihood, abs=5e-4)


@pytest.mark.parametrize(("frames", "detail"), [(1400, 1400), (4000, 1500)])
def test_the_stretch_in_figures_is_of_1500_frames(frames, detail):
    """In the middle of a block."""
    taken = []
    run = SimpleNamespace(
        t_s=np.arange(frames), tracks=SimpleNamespace(status=np.full((frames, 1), Status.MEASURED)),
        at=lambda part: taken.append(part) or run, data=SimpleNamespace(copy=lambda **_: None),
    )  # fmt: skip
    with pytest.raises(TypeError):  # it is no recording
        long_result._better(None, run)
    assert (taken[0].start + taken[0].stop, taken[0].stop - taken[0].start) == (frames, detail)


@pytest.mark.parametrize(("memory", "ok"), [("450MB", False), ("550MB", True)])
def test_a_process_needs_half_a_gigabyte(memory, ok):
    with nullcontext() if ok else pytest.raises(MocapError, match="needs 500 MB"):
        assert engine._bytes(memory) == 5.5e8


@pytest.mark.parametrize(("names", "said"), [("abcd", "a, b, c, d"), ("abcde", "a, b, c, d, ...")])
def test_four_names_are_told(names, said):
    assert trial.some(names) == said


@pytest.mark.parametrize(("varies", "bones"), [(0.09, [(0, 1)]), (0.11, [])])
def test_a_soft_bone_varies_by_a_tenth(varies, bones):
    """Twice what a rigid one does."""
    assert spanning_bones(Kept(length_m=np.ones((2, 2)), varies=np.full((2, 2), varies))) == bones


def test_a_consistent_filter_is_inside_the_band_in_95_of_100_frames():
    """Of two and of thirty rows."""
    rows = np.array([2, 30])
    low, high = nis_band(rows) * rows
    np.testing.assert_allclose(chdtr(rows, high) - chdtr(rows, low), 0.95, atol=1e-9)
    np.testing.assert_allclose(chdtr(rows, low), 0.025, atol=1e-9)
