"""The filter of single markers against filterpy, and the two-filter smoother against an RTS smoother."""

import numpy as np
from filterpy.kalman import KalmanFilter

from mocap.digitising import motion
from mocap.digitising.motion import JERK, State, fused, jerk_density, positioned, predicted

RNG = np.random.default_rng(0)
STEP = np.kron(motion.TRANSITION, np.eye(3))


def random_state(n):
    x = RNG.normal(size=(n, 9))
    root = RNG.normal(size=(n, 9, 9))
    return State(x, root @ np.swapaxes(root, 1, 2) + 9 * np.eye(9))


def test_four_frames_have_one_difference():
    """Which tells too little: every frame has the greatest there is, which is none."""
    xyz = np.random.default_rng(0).normal(size=(4, 2, 3))
    assert np.isnan(jerk_density(xyz, np.ones((4, 2)))).all()


def test_prediction_and_update_are_filterpys():
    """A position that is observed with noise R, by the posterior of the position alone and by filterpy's update."""
    state, density = random_state(3), np.array([0.1, 1.0, 2.0])
    noise = np.diag([0.5, 1.0, 2.0])
    ahead = predicted(state, density)
    z = RNG.normal(size=(3, 3))
    gain = ahead.cov_m2 @ np.linalg.inv(ahead.cov_m2 + noise)
    xyz = ahead.xyz_m + np.einsum("mij,mj->mi", gain, z - ahead.xyz_m)
    after = positioned(ahead, xyz, ahead.cov_m2 - gain @ ahead.cov_m2, np.ones(3, dtype=bool))
    for m in range(3):
        kf = KalmanFilter(dim_x=9, dim_z=3)
        kf.x, kf.P, kf.F, kf.Q = state.mean[m].copy(), state.cov[m].copy(), STEP, density[m] * JERK
        kf.H, kf.R = np.eye(3, 9), noise
        kf.predict()
        kf.update(z[m])
        np.testing.assert_allclose(after.mean[m], kf.x, atol=1e-9)
        np.testing.assert_allclose(after.cov[m], kf.P, atol=1e-9)


def test_two_filters_are_the_smoother():
    """Forward and backward opinions on a path of positions, fused, are those of filterpy's RTS smoother."""
    n, density, noise = 12, np.array([1e-3]), 0.01
    z = np.cumsum(RNG.normal(size=(n, 3)), axis=0) * 0.1

    def pass_over(rows):
        state, ahead, out = None, None, []
        for row in rows:
            ahead = State(np.zeros((1, 9)), np.eye(9)[None] * 1e4) if state is None else predicted(state, density)
            out.append(ahead)
            gain = ahead.cov_m2 @ np.linalg.inv(ahead.cov_m2 + noise * np.eye(3))
            xyz = ahead.xyz_m + np.einsum("mij,mj->mi", gain, row[None] - ahead.xyz_m)
            state = positioned(ahead, xyz, ahead.cov_m2 - gain @ ahead.cov_m2, np.ones(1, dtype=bool))
            out[-1] = (ahead, state)
        return out

    forward, backward = pass_over(z), pass_over(z[::-1])[::-1]
    kf = KalmanFilter(dim_x=9, dim_z=3)
    kf.F, kf.Q, kf.H, kf.R, kf.P = STEP, density[0] * JERK, np.eye(3, 9), noise * np.eye(3), np.eye(9) * 1e4
    means, covs = [], []
    for i, row in enumerate(z):
        if i:
            kf.predict()
        kf.update(row)
        means.append(kf.x.copy())
        covs.append(kf.P.copy())
    smooth, smooth_cov, _, _ = kf.rts_smoother(np.array(means), np.array(covs))
    for i in (3, 6, 9):
        both = fused(forward[i][1], backward[i][0].turned())
        # the backward filter begins with a wide prior of its own: 1e-4 of information
        np.testing.assert_allclose(both.mean[0], np.ravel(smooth[i]), atol=2e-3)
        np.testing.assert_allclose(both.cov_m2[0], smooth_cov[i][:3, :3], atol=1e-5)


def test_density_of_the_jerk_is_that_of_the_motion():
    """Paths of white jerk of three densities, seen with noise and without 30 frames: each within 15 %.

    The median of 500 squares of three coordinates, of which neighbours depend on each other, varies by 5 %.
    """
    density, noise_m = np.array([1.0, 0.2, 5.0]), 0.05
    rng, root = np.random.default_rng(1), np.linalg.cholesky(JERK)
    x, path = np.zeros((3, 9)), []
    for _ in range(500):
        x = x @ STEP.T + np.sqrt(density)[:, None] * (rng.normal(size=(3, 9)) @ root.T)
        path.append(x[:, :3].copy())
    xyz = np.array(path) + noise_m * rng.normal(size=(500, 3, 3))
    xyz[200:230, 1] = np.nan
    found = jerk_density(xyz, np.full((500, 3), 3 * noise_m**2), reach=500)
    np.testing.assert_allclose(found[250], density, rtol=0.15)
    near = jerk_density(xyz, np.full((500, 3), 3 * noise_m**2))
    assert near[215, 1] == np.nanmax(near[:, 1])
    assert np.isnan(jerk_density(xyz[:3], np.zeros((3, 3)))).all()
