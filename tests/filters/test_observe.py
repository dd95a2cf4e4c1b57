"""Conditioning on what a frame shows: three rows a marker are all rows, and Student's t by its formula."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mocap.filters.ensemble import Gaussian, default_points, update
from mocap.filters.gaussian import Markers, View
from mocap.filters.observations import PixelObservations, Sights
from mocap.filters.observe import observe as observe_markers
from mocap.filters.track import smooth

from mocap.cameras.camera import project, stacked
from tests.filters.filmed import pixels, still
from tests.mocap.rigs import cloud, ring


def observe(state, sights, view, **options):
    """The posterior, and what was seen."""
    found, _, seen = observe_markers(Markers(state, view), sights, **options)
    return found, seen


def frame(rng, *, n_cameras, n_markers, n=None, share=1.0, dof=np.inf, sd=(0.5, 2.0)):
    """A state whose first components move markers, and rays of random directions that see them.

    Returns:
        State, sights, the view of the markers and their dependence (3 M, reads) on the state.
    """
    reads = int(rng.integers(1, 3 * n_markers + 3)) if n is None else n
    size = reads + int(rng.integers(0, 4))
    factor = np.tril(rng.normal(0, 0.3, (size, size)), -1) + np.diag(rng.uniform(0.5, 1.5, size))
    state, depends = Gaussian(rng.normal(size=size), factor), rng.normal(size=(3 * n_markers, reads))
    where = np.argwhere(rng.random((n_cameras, n_markers)) < share)
    count, rows = len(where), np.arange(3) < 2
    sights = Sights(
        where=where,
        size=np.full(count, 2),
        innovation=np.where(rows, rng.normal(0, 2, (count, 3)), 0.0),
        slope=np.where(rows[:, None], rng.normal(size=(count, 3, 3)), 0.0),
        sd=np.where(rows, rng.uniform(*sd, (count, 3)), 1.0),
        dof=np.full(count, dof),
        apart=np.zeros(count, dtype=bool),
    )
    return state, sights, View(np.zeros((n_markers, 3)), depends), depends


def uncompressed(state, sights, depends, weight):
    """The same rows one by one, each deviation over the root of its weight, by the engine's own update."""
    used = weight > 0
    marker, reads = sights.where[used, 1], depends.shape[1]
    slope = np.einsum("gri,gik->grk", sights.slope[used, :2], depends.reshape(-1, 3, reads)[marker]).reshape(-1, reads)
    sd = (sights.sd[used, :2] / np.sqrt(weight[used, None])).ravel()
    y = sights.innovation[used, :2].ravel() + slope @ state.mean[:reads]
    return update(state, lambda x: x[:, :reads] @ slope.T, y, sd, default_points(len(state.mean)))


def agree(ours, seen, expected, *, tolerance=1e-10):
    """Same mean in deviations, covariance, surprise and density; rounding grows with a condition of 1e4 at most."""
    sd = np.sqrt(np.diag(expected.state.cov))
    np.testing.assert_allclose(ours.mean / sd, expected.state.mean / sd, atol=tolerance)
    unit = np.outer(sd, sd)
    np.testing.assert_allclose(ours.cov / unit, expected.state.cov / unit, atol=tolerance)
    assert seen.nis == pytest.approx(expected.nis, rel=tolerance, abs=tolerance)
    assert seen.log_likelihood == pytest.approx(expected.log_likelihood, rel=tolerance, abs=tolerance)
    assert seen.n_rows == len(expected.innovation)


@given(
    seed=st.integers(0, 1000),
    n_cameras=st.integers(1, 30),
    n_markers=st.integers(1, 6),
    share=st.sampled_from([0.1, 0.5, 1.0]),
    dof=st.sampled_from([2.0, 5.0, np.inf]),
)
def test_three_rows_a_marker_are_all_rows(seed, n_cameras, n_markers, share, dof):
    """Posterior, NIS and log-likelihood of any number of rays, single ones too, weighted or not: those of every row.

    NIS is over the share of the information that Student's errors leave: (nu + 2) / (nu + 4) for two rows.
    """
    rng = np.random.default_rng(seed)
    state, sights, view, depends = frame(
        rng, n_cameras=n_cameras, n_markers=n_markers, share=share, dof=dof, sd=(0.05, 2.0)
    )
    found, seen = observe(state, sights, view, gate_sd=np.inf)
    if not len(sights.where):
        assert found is state
        assert np.isnan(seen.nis)
        assert (seen.n_rows, seen.log_likelihood) == (0, 0.0)
        return
    expected = uncompressed(state, sights, depends, seen.weight)
    assert seen.nis * ((dof + 2) / (dof + 4) if np.isfinite(dof) else 1) == pytest.approx(expected.nis, rel=1e-9)
    agree(found, replace(seen, nis=expected.nis), expected)


def test_gated_rays_are_as_if_they_never_were():
    """With a gate that some rays fail: what is left is conditioned on as every row of it."""
    rng = np.random.default_rng(1)
    counts = []
    for _ in range(20):
        state, sights, view, depends = frame(rng, n_cameras=4, n_markers=5)
        found, seen = observe(state, sights, view, gate_sd=0.5)
        counts.append(np.count_nonzero(seen.weight == 0))
        if (seen.weight > 0).any():
            agree(found, seen, uncompressed(state, sights, depends, seen.weight))
        else:
            assert found is state
    assert 0 < np.mean(counts) < 20


def test_parallel_rays_say_nothing_of_their_depth():
    """Thirty cameras in one place: along the ray the deviation stays the prior's, to the rounding of 30 sums."""
    rng = np.random.default_rng(2)
    state, view = Gaussian(np.zeros(3), np.eye(3)), View(np.zeros((1, 3)), np.eye(3))
    _, sights, _, _ = frame(rng, n_cameras=30, n_markers=1, n=3)
    slope = np.zeros((30, 3, 3))
    slope[:, :2] = np.eye(3)[:2] + 1e-9 * rng.normal(size=(30, 2, 3))
    sights = Sights(**{**vars(sights), "slope": slope, "sd": np.full((30, 3), 0.1)})
    found, _ = observe(state, sights, view, gate_sd=np.inf)
    np.testing.assert_allclose(np.diag(found.cov), [1 / 3001, 1 / 3001, 1], rtol=1e-6)


def expected_weights(state, sights, depends, weight):
    """(nu + d) / (nu + E r^2), with the posterior that the weights lead to, written out with dense matrices."""
    posterior = uncompressed(state, sights, depends, weight).state
    reads = depends.shape[1]
    shift = depends @ (posterior.mean - state.mean)[:reads]
    cov = depends @ posterior.cov[:reads, :reads] @ depends.T
    out = []
    for (_, marker), y, slope, sd, nu in zip(
        sights.where, sights.innovation, sights.slope, sights.sd, sights.dof, strict=True
    ):
        here = slice(3 * marker, 3 * marker + 3)
        white = slope[:2] / sd[:2, None]
        left = y[:2] / sd[:2] - white @ shift[here]
        out.append((nu + 2) / (nu + left @ left + np.trace(white @ cov[here, here] @ white.T)))
    return np.array(out)


@given(seed=st.integers(0, 1000), dof=st.floats(1.0, 30.0))
@settings(max_examples=12)
def test_students_weights_are_a_fixed_point_of_their_formula(seed, dof):
    """A round is the formula with the posterior of the round before; after many rounds nothing changes any more.

    The weights that were used are that times (nu + 2) / (nu + 4).
    Expectation maximisation converges linearly: 300 rounds leave 1e-6 even where a step only halves a thousandth.
    """
    rng = np.random.default_rng(seed)
    state, sights, view, depends = frame(rng, n_cameras=5, n_markers=3, dof=dof)

    def weights(rounds):
        _, seen = observe(state, sights, view, gate_sd=np.inf, rounds=rounds)
        return seen.weight * ((dof + 4) / (dof + 2) if rounds else 1)

    np.testing.assert_array_equal(weights(0), 1)
    for rounds in (0, 1, 2):
        expected = expected_weights(state, sights, depends, weights(rounds))
        np.testing.assert_allclose(weights(rounds + 1), expected, rtol=1e-9)
    settled = weights(300)
    np.testing.assert_allclose(expected_weights(state, sights, depends, settled), settled, rtol=1e-6)


@pytest.mark.parametrize(("dof", "n_rays"), [(3.0, 4), (8.0, 4)])
def test_intervals_of_students_rays_hold(dof, n_rays):
    """Of a point with a normal prior, seen by rays with errors of Student's t: 95 % intervals hold 95 %, in 1500 draws.

    Three deviations of a share of 4500 is 1 %. Without the factor of the information they hold 91 to 93 %. NIS a row is
    1, within a fifth.
    """
    rng = np.random.default_rng(9)
    inside, nis = [], []
    for _ in range(1500):
        truth, slope = rng.normal(size=3), np.zeros((n_rays, 3, 3))
        slope[:, :2] = np.linalg.qr(rng.normal(size=(n_rays, 3, 3)))[0][:, :2]
        noise = rng.standard_normal((n_rays, 3)) / np.sqrt(rng.chisquare(dof, (n_rays, 1)) / dof)
        sights = Sights(
            where=np.column_stack([np.arange(n_rays), np.zeros(n_rays, dtype=int)]),
            size=np.full(n_rays, 2),
            innovation=np.where(np.arange(3) < 2, slope @ truth + noise, 0.0),
            slope=slope,
            sd=np.ones((n_rays, 3)),
            dof=np.full(n_rays, dof),
            apart=np.zeros(n_rays, dtype=bool),
        )
        found, seen = observe(Gaussian(np.zeros(3), np.eye(3)), sights, View(np.zeros((1, 3)), np.eye(3)))
        nis.append(seen.nis / seen.n_rows)
        inside.append(np.abs(found.mean - truth) < 1.96 * np.sqrt(np.diag(found.cov)))
    assert 0.938 < np.mean(inside) < 0.962
    assert 0.85 < np.mean(nis) < 1.2


def test_an_outliers_weight_falls():
    """The further a ray is off, the less it is believed, as 1 / distance^2 in the end; the others as much as before."""
    rng = np.random.default_rng(3)
    state, sights, view, _ = frame(rng, n_cameras=12, n_markers=2, n=6, dof=4.0)
    weights = []
    for off in (0.0, 10.0, 30.0, 100.0, 300.0):
        innovation = sights.innovation.copy()
        innovation[7, 0] += off * sights.sd[7, 0]
        moved = Sights(**{**vars(sights), "innovation": innovation})
        weights.append(observe(state, moved, view, gate_sd=np.inf, rounds=30)[1].weight)
    lone = np.array([w[7] for w in weights])
    assert (np.diff(lone) < 0).all()
    assert lone[-1] == pytest.approx(lone[-2] / 9, rel=0.1)
    others = np.delete(weights[-1], 7)
    np.testing.assert_allclose(others, np.delete(weights[-2], 7), rtol=0.05)
    assert others.min() > 10 * lone[-1]


def test_normal_errors_are_students_with_infinite_freedom():
    """Infinite freedom is the plain update to the last digit, beside Student-t rays too, and 1e12 is it to rounding."""
    rng = np.random.default_rng(4)
    state, sights, view, depends = frame(rng, n_cameras=5, n_markers=3)
    options = {"gate_sd": np.inf}
    plain, normal = observe(state, sights, view, rounds=0, **options)
    found, seen = observe(state, sights, view, **options)
    np.testing.assert_array_equal(found.mean, plain.mean)
    np.testing.assert_array_equal(found.cov, plain.cov)
    np.testing.assert_array_equal(seen.weight, 1)
    assert seen.log_likelihood == normal.log_likelihood
    nearly = Sights(**{**vars(sights), "dof": np.full(len(sights.size), 1e12)})
    agree(
        *observe(state, nearly, view, **options),
        uncompressed(state, sights, depends, np.ones(len(sights.size))),
        tolerance=1e-8,
    )
    mixed = Sights(**{**vars(sights), "dof": np.where(sights.where[:, 0] == 1, 3.0, np.inf)})
    _, seen = observe(state, mixed, view, **options)
    np.testing.assert_array_equal(seen.weight == 1, sights.where[:, 0] != 1)


def test_cameras_without_dof_are_normal():
    """``dof`` = None and infinite degrees of freedom track alike, to the last digit."""
    seen, _ = pixels(np.random.default_rng(5))
    infinite = PixelObservations(**{**vars(seen), "dof": np.full(3, np.inf)})
    one, other = (smooth(still(seen), x, np.arange(4) * 0.01) for x in (seen, infinite))
    np.testing.assert_array_equal(one.xyz_m, other.xyz_m)
    np.testing.assert_array_equal(one.cov_m2, other.cov_m2)


def test_gross_errors_do_little_to_students_rays():
    """5 % of rays 80 px off, none gated: nu = 4 is over ten times nearer to the truth than the normal, near the clean.

    Near: a ray of weight 1.5 / (1 + 80^2 / 4) at most still pulls, and a t of scale 1 wastes a seventh of normal data.
    """
    rng = np.random.default_rng(6)
    matrices, mean = stacked(ring(6)), cloud(rng, 60)
    state = Gaussian(mean.ravel(), 0.02 * np.eye(180))
    truth = mean + 0.02 * rng.normal(size=mean.shape)
    clean = project(matrices, truth) + rng.normal(size=(6, 60, 2))
    bad = rng.permutation(360).reshape(6, 60) < 18
    angle = rng.uniform(0, 2 * np.pi, (6, 60))
    gross = clean + np.where(bad, 80.0, 0.0)[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def error_mm(uv, dof):
        seen = PixelObservations(
            matrices=matrices,
            uv_px=uv[:, None],
            sd_px=np.ones((6, 1, 60)),
            xyz_m=truth[None],
            cov_m2=np.zeros((1, 60, 3, 3)),
            wide_m=np.inf,
            dof=np.full(6, dof),
        )
        sights = seen.sights(0, mean, np.tile(0.02**2 * np.eye(3), (60, 1, 1)))
        found, _ = observe(state, sights, View(mean, np.eye(180)), gate_sd=np.inf, rounds=5)
        return 1e3 * np.sqrt(np.mean(np.sum((found.mean.reshape(-1, 3) - truth) ** 2, axis=1)))

    assert error_mm(gross, 4.0) < 0.1 * error_mm(gross, np.inf)
    assert error_mm(gross, 4.0) < 1.25 * error_mm(clean, np.inf)


def test_weights_are_found_in_three_rounds():
    """Unless it is said otherwise; a fourth changes them by less than the third did."""
    rng = np.random.default_rng(8)
    state, sights, view, _ = frame(rng, n_cameras=5, n_markers=3, dof=3.0)
    weight = [observe(state, sights, view, gate_sd=np.inf, rounds=k)[1].weight for k in range(5)]
    np.testing.assert_array_equal(observe(state, sights, view, gate_sd=np.inf)[1].weight, weight[3])
    changes = [np.abs(after - before).max() for before, after in pairwise(weight)]
    assert 0 < changes[3] < changes[2]
