"""The subspace of poses: PCA where all is seen, the hidden truth where not."""

import numpy as np
import pytest
from mocap.filters.subspace import bridge, fit_subspace, hide_blocks, noise_share, principal_components, white_variance


def low_rank(rng, *, n_frames=300, n_markers=8, rank=3, noise=1e-3, amplitudes=None):
    """Poses on a plane of the given rank, that move smoothly; and the clean ones."""
    t = np.arange(n_frames) * 0.02
    rate, phase = rng.uniform(1, 6, rank), rng.uniform(0, 6, rank)
    amplitudes = np.linspace(1.0, 0.5, rank) if amplitudes is None else amplitudes
    scores = np.sin(t[:, None] * rate + phase) * amplitudes
    basis = np.linalg.qr(rng.normal(size=(3 * n_markers, rank)))[0]
    clean = rng.normal(0, 0.3, 3 * n_markers) + 0.2 * scores @ basis.T
    return clean + noise * rng.normal(size=clean.shape), clean, basis


def principal_angle(a, b):
    """Largest angle between two subspaces, radians."""
    a, b = np.linalg.qr(a)[0], np.linalg.qr(b)[0]
    return np.arcsin(np.clip(np.linalg.norm(b - a @ (a.T @ b), ord=2), 0, 1))


def test_complete_data_is_pca():
    """Without gaps the span is that of the leading singular vectors, noise is the mean of the variance left.

    Tipping & Bishop 1999: the maximum of the likelihood. The weak prior on loadings costs a share of noise / variance.
    """
    rng = np.random.default_rng(1)
    y, _, _ = low_rank(rng, noise=0.01)
    found = principal_components(y, 3, iterations=100)
    centred = y - y.mean(axis=0)
    _, s, vt = np.linalg.svd(centred, full_matrices=False)
    assert principal_angle(found.loading, vt[:3].T) < 1e-3
    np.testing.assert_allclose(found.mean, y.mean(axis=0), atol=1e-4)
    left = np.sum(s[3:] ** 2) / len(y) / (y.shape[1] - 3)
    assert found.noise == pytest.approx(left, rel=0.05)
    variance = s[:3] ** 2 / len(y)
    np.testing.assert_allclose(found.certainty, 1 - np.mean(left / variance), atol=1e-3)


def test_gaps_hide_nothing_of_a_low_rank_set():
    """A third of all samples hidden, in blocks: the model completes them to the noise, the span to a hundredth.

    A hidden entry follows from 16 seen ones: its error is the noise times sqrt(3 / 16) plus the model's, below it.
    """
    rng = np.random.default_rng(2)
    y, clean, basis = low_rank(rng)
    seen = ~hide_blocks(np.ones((300, 8), dtype=bool), rng, share=0.35, length=15)
    gappy = np.where(np.repeat(seen, 3, axis=1), y, np.nan)
    found = principal_components(gappy, 3, iterations=60)
    assert principal_angle(found.loading, basis) < 0.01
    error = (found.poses - clean)[~np.repeat(seen, 3, axis=1)]
    assert np.sqrt(np.mean(error**2)) < 1e-3
    assert np.sqrt(np.mean((bridge(gappy) - clean)[~np.repeat(seen, 3, axis=1)] ** 2)) > 5e-3  # what bridging leaves


@pytest.mark.parametrize("rank", [1, 3, 6])
def test_the_rank_is_found(rank):
    """Of ranks 1 to 11 the true one is chosen: less does not reach hidden samples, more does not gain 5 %."""
    rng = np.random.default_rng(10 + rank)
    y, _, basis = low_rank(rng, rank=rank, n_frames=250)
    subspace, found, z, _ = fit_subspace(y, ranks=(1, 2, 3, 4, 6, 8, 11), block=10, rng=rng)
    assert subspace.basis.shape == (24, rank)
    assert principal_angle(subspace.basis, basis) < 0.02
    np.testing.assert_allclose(subspace.basis.T @ subspace.basis, np.eye(rank), atol=1e-12)
    assert (np.diff(z.std(axis=0)) <= 1e-9).all()
    poses = subspace.mean + z @ subspace.basis.T
    assert np.sqrt(np.mean((poses - y) ** 2)) < 1.5e-3
    assert ((found.certainty > 0.9) & (found.certainty <= 1)).all()


def test_a_small_component_counts():
    """A component that only doubles the error of hidden samples when left out is kept: 5 % decides, not a factor.

    Its coordinates have 0.2 * 0.06 / sqrt(24 * 2) = 1.7e-3 beside noise of 1e-3: left out, sqrt(1 + 3) times the error.
    """
    rng = np.random.default_rng(30)
    y, _, _ = low_rank(rng, n_frames=250, amplitudes=(1.0, 0.8, 0.06))
    subspace, _, _, _ = fit_subspace(y, ranks=(1, 2, 3, 4, 6), block=10, rng=rng)
    assert subspace.basis.shape[1] == 3


def test_the_residual_is_what_hidden_markers_miss():
    """``residual_sd`` is the deviation of hidden samples: about the noise where rank suffices, one a marker."""
    rng = np.random.default_rng(20)
    y, _, _ = low_rank(rng, noise=2e-3)
    subspace, _, _, _ = fit_subspace(y, ranks=(3,), block=10, rng=rng)
    sd = subspace.residual_sd.reshape(8, 3)
    np.testing.assert_array_equal(sd, np.repeat(sd[:, :1], 3, axis=1))
    assert (sd > 1.5e-3).all()
    assert (sd < 4e-3).all()


def test_white_noise_is_told_from_what_lasts():
    """Sinusoids of 40 frames a period beside noise of half their variance: the parabola is off by (2 pi / 40)^4 of it.

    The standard error of two lags with 3000 frames of 12 columns is 2 % of the noise.
    """
    rng = np.random.default_rng(21)
    t = np.arange(3000)[:, None]
    lasts = np.sqrt(2) * np.sin(2 * np.pi * (t / 40 + rng.random(12)))
    series = lasts + np.sqrt(0.5) * rng.normal(size=lasts.shape)
    series[rng.random(series.shape) < 0.3] = np.nan
    assert white_variance(series) == pytest.approx(0.5, rel=0.08)
    assert noise_share(series, np.full(3, 1.0)) == pytest.approx(0.5 / 1.5, rel=0.08)
    assert noise_share(series, np.full(3, 0.3)) == pytest.approx(0.09 / 1.5, rel=0.02)  # no more than was stated
    assert noise_share(series, np.full(3, np.nan)) == 0.0


def test_the_residual_is_without_the_noise_of_the_measurements():
    """A residual that lasts, each column at its own period, beside noise of 2 mm: the square of that is taken out."""
    rng = np.random.default_rng(22)
    y, _, _ = low_rank(rng, noise=2e-3)
    t, period = np.arange(len(y))[:, None], rng.uniform(40, 90, y.shape[1])
    y = y + 2e-3 * np.sqrt(2) * np.sin(2 * np.pi * (t / period + rng.random(y.shape[1])))
    with_noise, without = (
        fit_subspace(y, ranks=(3,), block=10, rng=np.random.default_rng(1), sd=np.full((len(y), 8), sd))[0].residual_sd
        for sd in (0.0, 2e-3)
    )
    assert np.mean(with_noise**2) - np.mean(without**2) == pytest.approx(2e-3**2, rel=0.15)  # white: 1000s of samples


def test_hidden_blocks_are_blocks_of_what_was_seen():
    """About the asked share is hidden, each marker for whole blocks, nothing that was not seen."""
    rng = np.random.default_rng(3)
    seen = rng.random((1000, 20)) < 0.9
    hidden = hide_blocks(seen, rng, share=0.1, length=12)
    assert not (hidden & ~seen).any()
    assert 0.06 < hidden.sum() / seen.sum() < 0.11  # overlaps and ends cost some
    whole = hide_blocks(np.ones((1000, 20), dtype=bool), rng, share=0.1, length=12)
    starts = np.diff(np.pad(whole, ((1, 1), (0, 0))).astype(int), axis=0)
    begin, end = np.nonzero(starts.T > 0)[1], np.nonzero(starts.T < 0)[1]
    inner = (begin > 0) & (end < 1000)
    assert (end - begin)[inner].min() >= 12


def test_a_marker_never_seen_is_not_invented_far_away():
    """Columns without a value are finite, and do not disturb the others; a frame without any is the mean pose."""
    rng = np.random.default_rng(4)
    y, clean, _ = low_rank(rng)
    gappy = y.copy()
    gappy[:, :3] = np.nan
    gappy[100] = np.nan
    found = principal_components(gappy, 3)
    assert np.isfinite(found.poses).all()
    assert np.sqrt(np.mean((found.poses[:100, 3:] - clean[:100, 3:]) ** 2)) < 2e-3
    np.testing.assert_allclose(found.poses[100], found.mean, atol=1e-12)
    assert found.certainty[100] == pytest.approx(0, abs=1e-12)


def test_very_short_recordings():
    """Few frames allow few components, and still give a subspace."""
    rng = np.random.default_rng(5)
    y, _, _ = low_rank(rng, n_frames=9)
    subspace, _, z, _ = fit_subspace(y, ranks=(1, 2, 3, 4), block=3, rng=rng)
    assert subspace.basis.shape[1] == z.shape[1] == 1
    assert np.isfinite(subspace.residual_sd).all()


def test_bridging_by_hand():
    """Linear between neighbours, constant beyond the ends, zero for what was never seen."""
    nan = np.nan
    y = np.array([[nan, 1, nan], [1, nan, nan], [nan, nan, nan], [3, 4, nan], [nan, nan, nan]])
    np.testing.assert_array_equal(bridge(y), [[1, 1, 0], [1, 2, 0], [2, 3, 0], [3, 4, 0], [3, 4, 0]])


def test_sums_over_parts_are_those_over_all(monkeypatch):
    """Poses of two trials, looked at seven at a time: each sum is the same to rounding, and so is what follows."""
    rng = np.random.default_rng(3)
    y = rng.normal(size=(90, 3)) @ rng.normal(size=(3, 12)) + 0.05 * rng.normal(size=(90, 12))
    y[rng.random(y.shape) < 0.2] = np.nan
    trial = np.repeat([0, 1], [40, 50])
    whole = principal_components(y, 3, trial=trial)
    monkeypatch.setattr("mocap.filters.subspace.AT_ONCE", 7)
    parts = principal_components(y, 3, trial=trial)
    for name in ("mean", "trial_offset", "trial_sd", "loading", "scores", "certainty", "noise"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-8, atol=1e-10, err_msg=name)
