"""Gaps made on purpose: what may be hidden, and what is said of how it was filled."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.hidden_gaps import within
from mocap.filters.hide import GAP_FRAMES, excerpt, hide_neighbours, hide_own, nearest_length
from mocap.filters.poses import MarkerTrial
from mocap.filters.score import Residuals, joined, residuals_of, score
from scipy.stats import multivariate_normal


def recorded(rng, n_frames, n_markers, lost=0.0):
    """Markers that drift; stretches of some of them are not seen."""
    xyz = np.cumsum(rng.normal(0, 1e-3, (n_frames, n_markers, 3)), axis=0) + rng.normal(0, 0.1, (n_markers, 3))
    for _ in range(round(lost * n_frames * n_markers / 10)):
        start = rng.integers(n_frames)
        xyz[start : start + 10, rng.integers(n_markers)] = np.nan
    sd = np.where(np.isfinite(xyz[..., 0]), rng.uniform(1e-4, 1e-3, xyz.shape[:2]), np.nan)
    return MarkerTrial(name="drift", t_s=np.arange(n_frames) / 100, xyz_m=xyz, sd_m=sd)


@given(
    seed=st.integers(0, 1000),
    n_frames=st.integers(20, 320),
    n_markers=st.integers(1, 9),
    lost=st.sampled_from([0, 0.3]),
)
def test_hidden_samples_were_measured_and_have_their_flanks(seed, n_frames, n_markers, lost):
    """What is hidden was seen, gap by gap of one stated length, with three seen frames before and after each.

    Half of a gap's length was measured for every marker in it, and two gaps never overlap in time.
    """
    rng = np.random.default_rng(seed)
    trial = recorded(rng, n_frames, n_markers, lost)
    hidden = hide_neighbours(trial, rng)
    assert not (hidden.mask & ~trial.seen).any()
    np.testing.assert_array_equal(hidden.mask, hidden.gap >= 0)
    np.testing.assert_array_equal(hidden.mask, hidden.length > 0)
    spans = []
    for number in np.unique(hidden.gap[hidden.mask]):
        frames, markers = np.nonzero(hidden.gap == number)
        (length,) = set(hidden.length[hidden.gap == number])
        assert length in GAP_FRAMES or length == n_frames // 4
        assert frames.max() - frames.min() < length
        spans.append((frames.min(), frames.max()))
        for marker in np.unique(markers):
            own = frames[markers == marker]
            assert 2 * len(own) >= length
            # the gap starts at most so much earlier than its first measured frame
            starts = range(max(own.max() - length + 1, 3), own.min() + 1)
            assert any(
                trial.seen[s - 3 : s, marker].all() and trial.seen[s + length : s + length + 3, marker].sum() == 3
                for s in starts
            )
    spans.sort()
    assert all(a[1] < b[0] for a, b in pairwise(spans))


def test_neighbours_are_hidden_together():
    """Two clusters of four markers a metre apart: a gap of two to four markers lies in one of them."""
    rng = np.random.default_rng(1)
    trial = recorded(rng, 400, 8)
    trial = replace(trial, xyz_m=0.1 * trial.xyz_m + np.repeat([0.0, 1.0], 4)[:, None])
    hidden = hide_neighbours(trial, rng)
    sizes = set()
    for number in np.unique(hidden.gap[hidden.mask]):
        group = np.unique(np.nonzero(hidden.gap == number)[1])
        sizes.add(len(group))
        assert len(group) > 4 or len(set(group // 4)) == 1
    assert sizes == {1, 2, 4, 6}  # one, a quarter, half, three quarters of eight


def test_what_is_shown_holds_the_rest_and_nothing_hidden():
    """Shown samples are those of the trial to the last bit, hidden ones NaN; the trial itself is as it was."""
    rng = np.random.default_rng(2)
    trial = recorded(rng, 120, 5, lost=0.2)
    before = trial.xyz_m.copy()
    hidden = hide_neighbours(trial, rng)
    assert hidden.mask.sum() > 50
    assert np.isnan(hidden.shown.xyz_m[hidden.mask]).all()
    np.testing.assert_array_equal(hidden.shown.xyz_m[~hidden.mask], trial.xyz_m[~hidden.mask])
    np.testing.assert_array_equal(trial.xyz_m, before)


@pytest.mark.parametrize("n_frames", [*range(1, 12), 15, 19])
@pytest.mark.parametrize("n_markers", [1, 4])
def test_short_trials_hide_what_they_have_room_for(n_frames, n_markers):
    """Three frames on each side of a gap of a quarter of the trial: nothing below seven frames, then as before."""
    trial = recorded(np.random.default_rng(4), n_frames, n_markers)
    mask = hide_neighbours(trial, np.random.default_rng(0)).mask
    assert mask.any() == (n_frames >= 7)
    assert not mask[:3].any()
    assert not mask[-3:].any()


def test_a_trial_that_shows_nothing_hides_nothing():
    """All NaN, or a marker that is never seen: no gap there, and no warning."""
    trial = recorded(np.random.default_rng(5), 80, 5)
    none = replace(trial, xyz_m=np.full_like(trial.xyz_m, np.nan))
    assert not hide_neighbours(none, np.random.default_rng(0)).mask.any()
    xyz = trial.xyz_m.copy()
    xyz[:, 2] = np.nan
    mask = hide_neighbours(replace(trial, xyz_m=xyz), np.random.default_rng(0)).mask
    assert mask.any()
    assert not mask[:, 2].any()


@pytest.fixture
def filled():
    """Estimates of hidden samples that err by a known noise, and state it."""
    rng = np.random.default_rng(6)
    trial = recorded(rng, 600, 8)
    hidden = hide_neighbours(trial, rng)
    sd = np.where(hidden.length >= 50, 2e-2, 3e-3)
    truth = trial.xyz_m - trial.sd_m[..., None] * rng.normal(size=trial.xyz_m.shape)
    estimate = truth + sd[..., None] * rng.normal(size=truth.shape)
    return hidden, residuals_of(hidden, estimate, (sd**2)[..., None, None] * np.eye(3))


def test_stated_variances_hold_for_measurements(filled):
    """Misses are of measurements, so that their variance is that of the estimate plus the measurement's own.

    Of n normal numbers the mean square is 1 within 4 sqrt(2 / n).
    """
    hidden, fill = filled
    assert len(fill.error_m) == hidden.mask.sum()
    squared = fill.error_m**2 / fill.expected
    assert abs(squared.mean() - 1) < 4 * np.sqrt(2 / squared.size)


def test_log_rmse_is_a_mean_over_lengths(filled):
    """Each length counts once, however many samples it has; errors that grow by a factor add its logarithm."""
    _, fill = filled
    by_length = [
        np.log(np.sqrt(np.mean(np.linalg.norm(fill.error_m[fill.length == n], axis=1) ** 2)))
        for n in np.unique(fill.length)
    ]
    assert fill.log_rmse == pytest.approx(np.mean(by_length), abs=1e-12)
    grown = replace(fill, error_m=3 * fill.error_m)
    assert grown.log_rmse == pytest.approx(fill.log_rmse + np.log(3), abs=1e-12)


def test_joined_gaps_stay_apart(filled):
    """Gaps of several trials keep their samples together and get numbers of their own."""
    _, fill = filled
    empty = Residuals(**{name: value[:0] for name, value in vars(fill).items()})
    both = joined([fill, empty, fill])
    assert len(np.unique(both.gap)) == 2 * len(np.unique(fill.gap))
    np.testing.assert_array_equal(both.error_m, np.concatenate([fill.error_m, fill.error_m]))
    halves = np.split(both.gap, 2)
    assert not set(halves[0]) & set(halves[1])
    for half in halves:
        np.testing.assert_array_equal(
            np.unique(half, return_inverse=True)[1], np.unique(fill.gap, return_inverse=True)[1]
        )


def test_one_score_is_numpy_s_own_and_scipy_s_likelihood():
    """Of errors and covariances by loops: root mean square distance, share inside 1.96 deviations, scipy's density."""
    rng = np.random.default_rng(8)
    error = rng.normal(0, 2e-3, (40, 3))
    factor = rng.normal(0, 2e-3, (40, 3, 3))
    cov = factor @ np.swapaxes(factor, 1, 2) + 1e-6 * np.eye(3)
    found = score(error, cov)
    assert found.rmse_mm == pytest.approx(np.sqrt(np.mean([1e6 * e @ e for e in error])), rel=1e-12)
    inside = [abs(e[i]) <= 1.959964 * np.sqrt(c[i, i]) for e, c in zip(error, cov, strict=True) for i in range(3)]
    assert found.coverage95 == np.mean(inside)
    ratio = [e[i] / np.sqrt(c[i, i]) for e, c in zip(error, cov, strict=True) for i in range(3)]
    assert found.z == pytest.approx(np.sqrt(np.mean(np.square(ratio))), rel=1e-12)
    density = [multivariate_normal(cov=1e6 * c).logpdf(1e3 * e) for e, c in zip(error, cov, strict=True)]
    assert found.nll == pytest.approx(-np.mean(density) / 3, rel=1e-9)


def test_what_cannot_be_scored_is_not_a_number():
    """No samples, no intervals, a covariance that is none: NaN each, and None in reports; the rest is as it was."""
    error, cov = np.full((2, 3), 1e-3), np.tile(1e-6 * np.eye(3), (2, 1, 1))
    nothing = {"coverage95": None, "z": None}
    assert score(error[:0], None).as_json() == {"rmse_mm": None, **nothing}
    assert score(error, None).as_json() == {"rmse_mm": pytest.approx(np.sqrt(3)), **nothing}
    assert np.isnan(score(error, cov - 2e-6).nll)
    assert score(error, cov).as_json() == {"rmse_mm": pytest.approx(np.sqrt(3)), "coverage95": 100.0, "z": 1.0}


@pytest.mark.parametrize("frames", [1, 7, 30, 31])
def test_an_excerpt_is_where_most_is_seen(frames):
    """Against counting every stretch; the first of several; a short recording is whole."""
    seen = np.random.default_rng(9).random((30, 4)) < 0.5
    if frames >= 30:
        assert excerpt(seen, frames) == slice(0, 30)
        return
    counts = [seen[s : s + frames].sum() for s in range(31 - frames)]
    assert excerpt(seen, frames).start == int(np.argmax(counts))


@pytest.mark.parametrize("seed", range(8))
def test_gaps_like_the_recording_s_own_are_its_gaps_at_other_times(seed):
    """What is lost together is hidden together, for as many frames, where it was seen; one in ten samples at most.

    Markers 0 to 2 are lost for 9 frames at once, marker 5 for 4: each gap that is hidden is one of these.
    """
    rng = np.random.default_rng(seed)
    trial = recorded(rng, 300, 8)
    xyz = trial.xyz_m.copy()
    for start in (40, 120, 200):
        xyz[start : start + 9, :3] = np.nan
        xyz[start + 30 : start + 34, 5] = np.nan
    trial = replace(trial, xyz_m=xyz)
    hidden = hide_own(trial, rng)
    assert not (hidden.mask & ~trial.seen).any()
    assert 0.1 <= hidden.mask.sum() / trial.seen.sum() < 0.15
    shapes = {(gap.length, *np.flatnonzero(gap.hidden)) for gap in hidden.gaps}
    assert {(9, 0, 1, 2), (4, 5)} <= shapes
    assert all(set(own) <= ({5} if length == 4 else {0, 1, 2}) for length, *own in shapes)
    for gap in hidden.gaps:
        beside = [*range(gap.start - 3, gap.start), *range(gap.frames.stop, gap.frames.stop + 3)]
        assert np.isfinite(hidden.shown.xyz_m[beside][:, gap.hidden]).all()
    first, again = (hide_own(trial, np.random.default_rng(seed)).mask for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_a_recording_without_gaps_has_none_like_its_own():
    """Nor has one that is missing at its ends alone."""
    trial = recorded(np.random.default_rng(0), 60, 4)
    xyz = trial.xyz_m.copy()
    xyz[:9, 1], xyz[50:, 2] = np.nan, np.nan
    assert not hide_own(trial, np.random.default_rng(1)).gaps
    assert not hide_own(replace(trial, xyz_m=xyz), np.random.default_rng(1)).gaps


@given(seed=st.integers(0, 200), most=st.integers(10, 80))
def test_a_stretch_keeps_the_gaps_that_lie_in_it(seed, most):
    """Its hidden samples are those of the whole trial, of whole gaps."""
    rng = np.random.default_rng(seed)
    hidden = hide_own(recorded(rng, 90, 5, 0.2), rng)
    part = within(hidden, most)
    assert len(part.trial.t_s) == min(most, 90)
    start = int(np.flatnonzero(hidden.trial.t_s == part.trial.t_s[0])[0])
    for gap in part.gaps:
        whole = hidden.mask[start + gap.start : start + gap.frames.stop, gap.hidden]
        np.testing.assert_array_equal(part.mask[gap.frames, gap.hidden], whole)


def test_lengths_are_put_together_by_the_nearest_power_of_two():
    """By ratio: 5 is nearer to 4, 6 to 8."""
    np.testing.assert_array_equal(nearest_length(np.array([1, 2, 3, 5, 6, 11, 12, 100])), [1, 2, 4, 4, 8, 8, 16, 128])
