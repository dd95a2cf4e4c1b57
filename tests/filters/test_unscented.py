"""The filter for a person's own model, against filterpy's on the same sigma points, and against closed forms."""

import numpy as np
import pytest
from filterpy.kalman import UnscentedKalmanFilter as Peer
from mocap.filters import MerweScaledSigmaPoints, UnscentedKalmanFilter

DT = 0.1


def swing(x, dt):
    """A damped pendulum, by one step of Euler's."""
    return np.array([x[0] + dt * x[1], x[1] - dt * (9.81 * np.sin(x[0]) + 0.1 * x[1])])


def tip(x):
    """Where its tip is, and how high it is seen from a corner."""
    return np.array([np.sin(x[0]), -np.cos(x[0]), np.hypot(np.sin(x[0]) - 1, 2.0)])


def swing_all(x, dt):
    return np.stack(swing(x.T, dt), axis=-1)


def tip_all(x):
    return tip(x.T).T


def points():
    return MerweScaledSigmaPoints(2, alpha=0.5, beta=2.0, kappa=1.0)


def set_up(kind, **options):
    model = {"hx": tip, "fx": swing, **options}
    made = kind(dim_x=2, dim_z=3, dt=DT, points=points(), **model)
    made.x = np.array([0.8, -0.3])
    made.P = np.array([[0.2, 0.05], [0.05, 0.4]])
    made.Q = np.array([[1e-3, 2e-4], [2e-4, 5e-3]])
    made.R = np.array([[2e-2, 5e-3, 0.0], [5e-3, 3e-2, 1e-3], [0.0, 1e-3, 4e-2]])
    return made


def observations(n=25, seed=0):
    rng = np.random.default_rng(seed)
    x, out = np.array([1.0, 0.0]), []
    for _ in range(n):
        x = swing(x, DT)
        out.append(tip(x) + 0.1 * rng.normal(size=3))
    return out


@pytest.mark.parametrize("vectorised", [False, True])
def test_it_is_filterpys_filter_and_smoother(vectorised):
    """Means, covariances, gains and likelihoods, step by step; both round differently, so to 1e-9."""
    model = {"fx": swing_all, "hx": tip_all, "vectorised": True} if vectorised else {}
    ours = set_up(UnscentedKalmanFilter, **model)
    peer = set_up(Peer)
    zs = observations()
    means, covs, theirs, their_covs = [], [], [], []
    for z in zs:
        for one in (ours, peer):
            one.predict()
            if one is peer:  # as filterpy 2 does; 1.4.5 observes points without the process noise
                peer.sigmas_f = peer.points_fn.sigma_points(peer.x, peer.P)
            one.update(z)
        np.testing.assert_allclose(ours.y, peer.y, atol=1e-10)
        assert ours.log_likelihood == pytest.approx(peer.log_likelihood, abs=1e-9)
        means.append(ours.x)
        covs.append(ours.P)
        theirs.append(peer.x)
        their_covs.append(peer.P)
    np.testing.assert_allclose(means, theirs, atol=1e-9)
    np.testing.assert_allclose(covs, their_covs, atol=1e-9)
    smoothed = peer.rts_smoother(np.array(theirs), np.array(their_covs))
    for mine, expected in zip(ours.rts_smoother(means, covs), smoothed, strict=True):
        np.testing.assert_allclose(mine, expected, atol=1e-8)


def test_all_at_once_is_one_by_one():
    """batch_filter is predict and update in turn."""
    one, batch, zs = set_up(UnscentedKalmanFilter), set_up(UnscentedKalmanFilter), observations(6)
    means, covs = batch.batch_filter(zs)
    for z, mean, cov in zip(zs, means, covs, strict=True):
        one.predict()
        one.update(z)
        np.testing.assert_array_equal(one.x, mean)
        np.testing.assert_array_equal(one.P, cov)


def test_missing_rows_are_left_out():
    """NaN in a row is an observation without that row: the filter of the two others, with their part of R."""
    z = observations(1)[0]
    ours = set_up(UnscentedKalmanFilter)
    ours.update([z[0], np.nan, z[2]])
    two = UnscentedKalmanFilter(2, 2, DT, lambda x: tip(x)[[0, 2]], swing, points())
    two.x, two.P, two.R = [0.8, -0.3], set_up(Peer).P, ours.R[np.ix_([0, 2], [0, 2])]
    two.update(z[[0, 2]])
    np.testing.assert_allclose(ours.x, two.x, atol=1e-12)
    np.testing.assert_allclose(ours.P, two.P, atol=1e-12)
    assert ours.log_likelihood == pytest.approx(two.log_likelihood, abs=1e-12)
    assert np.isnan(ours.y[1])


@pytest.mark.parametrize("z", [None, [np.nan] * 3])
def test_nothing_seen_changes_nothing(z):
    """The state stays as predicted."""
    ours = set_up(UnscentedKalmanFilter)
    before = ours.x.copy(), ours.P.copy()
    ours.update(z)
    np.testing.assert_array_equal(ours.x, before[0])
    np.testing.assert_array_equal(ours.P, before[1])


def test_a_line_is_fitted_as_by_least_squares():
    """No process noise, a straight line: the smoothed state at the end is weighted least squares (a closed form)."""
    t, rng = np.arange(12) * DT, np.random.default_rng(1)
    z = 0.3 + 0.7 * t + 0.05 * rng.normal(size=len(t))
    ours = UnscentedKalmanFilter(2, 1, DT, lambda x: x[:1], lambda x, dt: np.array([x[0] + dt * x[1], x[1]]), points())
    ours.x, ours.P, ours.Q, ours.R = [0.0, 0.0], 1e6 * np.eye(2), np.zeros((2, 2)), 0.05**2
    ours.R = np.array([[0.05**2]])
    means, covs = ours.batch_filter([[value] for value in z])
    design = np.column_stack([np.ones_like(t), t - t[-1]])
    cov = 0.05**2 * np.linalg.inv(design.T @ design)
    np.testing.assert_allclose(means[-1], np.linalg.lstsq(design, z, rcond=None)[0], rtol=1e-5)
    np.testing.assert_allclose(covs[-1], cov, rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.update([1.0, 2.0]), r"z has shape \(2,\), expected \(3,\)"),
        (lambda f: f.update(np.zeros(3), R=-1.0), "R is no covariance: its least eigenvalue is -1"),
        (lambda f: setattr(f, "P", np.eye(3)), r"P has shape \(3, 3\), expected \(2, 2\)"),
        (lambda f: setattr(f, "P", np.diag([1.0, -1.0])), "P is no covariance"),
        (
            lambda f: (setattr(f, "hx", lambda x: x), f.update(np.zeros(3))),
            r"shape \(5, 2\) for 5 states, expected \(5, 3\)",
        ),
    ],
)
def test_what_does_not_fit_is_told(change, message):
    """Sizes and covariances, with what was expected."""
    with pytest.raises(ValueError, match=message):
        change(set_up(UnscentedKalmanFilter))


def test_points_of_another_size_are_refused():
    """With what to do."""
    with pytest.raises(ValueError, match="points are for states of size 2, but dim_x = 3"):
        UnscentedKalmanFilter(3, 3, DT, tip, swing, points())
