"""Rays as linear functions of their markers: Jacobians near, moments of the projection far, the engine's own update.

About a marker a pixel is u + a d / (1 + b d) exactly, with a its gradient and b that of the log of the depth.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.ensemble import Gaussian, default_points, ensemble, scale, spread, update
from mocap.filters.gaussian import Markers, View
from mocap.filters.observations import PixelObservations, linearised_pixels
from mocap.filters.observe import observe

from mocap.cameras.camera import project, stacked
from tests.mocap.rigs import cloud, ring

N_CAMERAS, N_MARKERS = 6, 4
MATRICES = stacked(ring(N_CAMERAS))
CAMERA, MARKER = np.divmod(np.arange(N_CAMERAS * N_MARKERS), N_MARKERS)


def gradients(mean):
    """Gradient a (g, 2, 3) of each pixel and b (g, 3) of the log of its depth, from the quotient rule."""
    p = MATRICES[CAMERA]
    depth = np.einsum("gi,gi->g", p[:, 2, :3], mean[MARKER]) + p[:, 2, 3]
    uv = project(MATRICES, mean)[CAMERA, MARKER]
    return (p[:, :2, :3] - uv[:, :, None] * p[:, 2:, :3]) / depth[:, None, None], p[:, 2, :3] / depth[:, None]


def factors(rng, sd_m):
    """(M, 3, 3) lower factors of random covariances whose root mean square deviation is ``sd_m``."""
    factor = np.tril(rng.normal(0, 0.4, (N_MARKERS, 3, 3))) + np.eye(3)
    return sd_m * factor / np.sqrt((factor**2).sum(axis=(1, 2)) / 3)[:, None, None]


@given(seed=st.integers(0, 1000), sd_m=st.sampled_from([0.0, 1e-7, 1e-5, 1e-4]), rank=st.integers(1, 3))
def test_near_their_mean_they_are_the_jacobian(seed, sd_m, rank):
    """The pixel itself, its gradient, nothing left; also where a covariance has no extent in some directions.

    Third order: (sd / depth)^2 of the gradient, 1e-8 at 0.1 mm; directions without extent are probed over 1e-8 m, where
    rounding of 1e-13 px is 1e-5 px/m; of the 600 px/m of a gradient 1e-7.
    """
    rng = np.random.default_rng(seed)
    mean, factor = cloud(rng, N_MARKERS), factors(rng, sd_m)
    factor[:, :, rank:] = 0
    pixel, slope, left = linearised_pixels(MATRICES, mean, factor @ np.swapaxes(factor, 1, 2), CAMERA, MARKER)
    a, _ = gradients(mean)
    np.testing.assert_allclose(pixel, project(MATRICES, mean)[CAMERA, MARKER], atol=1e3 * sd_m**2 + 1e-9)
    np.testing.assert_allclose(slope, a, atol=1e-6 * np.abs(a).max())
    assert (left >= 0).all()
    assert left.max() < (1e3 * sd_m**2) ** 2 + 1e-15


@pytest.mark.parametrize("sd_m", [0.05, 0.1])
def test_far_from_it_they_have_the_moments_of_the_projection(sd_m):
    """Mean of each pixel, its covariance with the marker and its variance, by Monte Carlo.

    The tangent at the mean is a control variate: what is sampled is of second order, about (600 px/m) sd^2 / depth with
    depths of 1.7 m and more, and known to a hundredth. The mean is right to third order. Slope and variance lack the
    mixed third derivatives, a b P b + 2 b a P b: relative three and six times (sd / depth)^2.
    """
    rng = np.random.default_rng(1)
    mean, factor = cloud(rng, N_MARKERS), factors(rng, sd_m)
    cov = factor @ np.swapaxes(factor, 1, 2)
    pixel, slope, left = linearised_pixels(MATRICES, mean, cov, CAMERA, MARKER)
    steps = np.einsum("mij,smj->msi", factor, rng.normal(size=(60_000, N_MARKERS, 3)))
    a, _ = gradients(mean)
    centre, tangent = project(MATRICES, mean)[CAMERA, MARKER], steps[MARKER] @ np.swapaxes(a, 1, 2)
    uv = project(MATRICES, np.swapaxes(mean[:, None] + steps, 0, 1))[CAMERA, :, MARKER]  # (g, S, 2)
    bent = uv - centre[:, None] - tangent
    second, relative = 600 * sd_m**2 / 1.7, (sd_m / 1.7) ** 2
    np.testing.assert_allclose(pixel - centre, bent.mean(axis=1), atol=0.02 * second)
    assert np.abs(pixel - centre).max() > 0.5 * second
    moment = np.swapaxes(bent, 1, 2) @ steps[MARKER] / steps.shape[1]
    sampled = a + moment @ np.linalg.inv(cov)[MARKER]
    np.testing.assert_allclose(slope, sampled, atol=(3 * relative + 0.02 * sd_m / 1.7) * np.abs(a).max())
    linear = np.einsum("gri,gij,grj->gr", a, cov[MARKER], a)
    variance = linear + 2 * np.mean(bent * tangent, axis=1) + bent.var(axis=1)
    total = np.einsum("gri,gij,grj->gr", slope, cov[MARKER], slope) + left
    np.testing.assert_allclose(total, variance, rtol=6 * relative)


def test_they_are_the_engines_unscented_transform():
    """Mean, and variance as slope and what is left, of each pixel: those of ``ensemble`` with c = 3 and gamma = 0."""
    rng = np.random.default_rng(2)
    mean, factor = cloud(rng, N_MARKERS), factors(rng, 0.1)
    cov = factor @ np.swapaxes(factor, 1, 2)
    pixel, slope, left = linearised_pixels(MATRICES, mean, cov, CAMERA, MARKER)
    c, gamma = scale(default_points(3))
    for group, (camera, marker) in enumerate(zip(CAMERA, MARKER, strict=True)):
        points = spread(Gaussian(mean[marker], np.linalg.cholesky(cov[marker])), c)
        expected, rows = ensemble(project(MATRICES[camera : camera + 1], points)[0], c, gamma)
        np.testing.assert_allclose(pixel[group], expected, rtol=1e-9)
        total = np.einsum("ri,ij,rj->r", slope[group], cov[marker], slope[group]) + left[group]
        np.testing.assert_allclose(total, np.sum(rows**2, axis=0), rtol=1e-7)


def test_what_is_left_is_the_curvature_along_the_axes():
    """3 sum_i (a L)_i^2 (b L)_i^2: the second derivatives along the columns of the factor, squared.

    The exact second order, |a L|^2 |b L|^2 + (a L . b L)^2, has the mixed ones too. Seven points see none of these: a
    ray along an axis of the factor is said to be straighter than it is, others up to 3/2 more bent in variance.
    """
    rng = np.random.default_rng(3)
    mean, factor = cloud(rng, N_MARKERS), factors(rng, 1e-3)
    _, _, left = linearised_pixels(MATRICES, mean, factor @ np.swapaxes(factor, 1, 2), CAMERA, MARKER)
    a, b = gradients(mean)
    across, deep = a @ factor[MARKER], np.einsum("gi,gij->gj", b, factor[MARKER])
    seen = 3 * np.einsum("gri,gi->gr", across**2, deep**2)
    np.testing.assert_allclose(left, seen, rtol=1e-3, atol=1e-12)
    exact = np.sum(across**2, axis=2) * np.sum(deep**2, axis=1)[:, None] + np.einsum("gri,gi->gr", across, deep) ** 2
    assert (left < 1.5 * exact * (1 + 1e-3)).all()


def test_updates_are_the_engines_to_second_order():
    """Conditioning on linearised rays, and on the same pixels by sigma points of the whole state, as any UKF does.

    With pixel noise in proportion to the prior both differ by what they make of the curvature, of second order in
    prior / depth: half the prior, a quarter of the difference, in deviations and in correlations.
    """
    rng = np.random.default_rng(4)
    mean = cloud(rng, N_MARKERS)
    n = 2 * mean.size
    loading = np.tril(rng.normal(0, 0.3, (n, n)), -1) + np.diag(rng.uniform(0.5, 1.5, n))
    draw, noise = rng.normal(size=n), rng.normal(size=(N_CAMERAS, N_MARKERS, 2))

    def apart(sd_m):
        state = Gaussian(np.append(mean.ravel(), np.zeros(mean.size)), sd_m * loading)
        truth = (state.mean + state.factor @ draw)[: mean.size].reshape(-1, 3)
        sd_px = 100 * sd_m
        seen = PixelObservations(
            matrices=MATRICES,
            uv_px=(project(MATRICES, truth) + sd_px * noise)[:, None],
            sd_px=np.full((N_CAMERAS, 1, N_MARKERS), sd_px),
            xyz_m=truth[None],
            cov_m2=np.zeros((1, N_MARKERS, 3, 3)),
            wide_m=np.inf,
        )
        markers = Markers(state, View(mean, np.eye(mean.size)))
        ours, _, _ = observe(markers, seen.sights(0, mean, markers.cov), gate_sd=np.inf)

        def h(x):
            return np.moveaxis(project(MATRICES, x[:, : mean.size].reshape(len(x), -1, 3)), 1, 0).reshape(len(x), -1)

        y, sd = seen.uv_px[:, 0].ravel(), np.full(seen.uv_px.size, sd_px)
        peer = update(state, h, y, sd, default_points(n)).state
        spread_of = np.sqrt(np.diag(peer.cov))
        return np.array(
            [
                np.abs((ours.mean - peer.mean) / spread_of).max(),
                np.abs((ours.cov - peer.cov) / np.outer(spread_of, spread_of)).max(),
            ]
        )

    coarse, fine = apart(0.02), apart(0.01)
    assert (coarse < 0.02).all()
    assert (fine < 0.3 * coarse).all()
