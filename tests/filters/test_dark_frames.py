"""Frames in which nothing at all is seen: wide, and right about how wide."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.ensemble import Gaussian
from mocap.filters.gaussian import Smoothed
from mocap.filters.models.pose import PoseSettings, learn_pose
from mocap.filters.motion.potential import informed
from mocap.filters.motion.shape import LinearShape
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial, poses_of
from mocap.filters.track import smooth


def test_informed_is_bayes_rule():
    """The product of two normal densities of the first components, the others following their correlation."""
    rng = np.random.default_rng(1)
    factor = np.tril(rng.normal(size=(5, 5))) + 2 * np.eye(5)
    state, known = Gaussian(rng.normal(size=5), factor), Gaussian(rng.normal(size=2), np.tril(rng.normal(size=(2, 2))))
    known = Gaussian(known.mean, known.factor + 2 * np.eye(2))
    select = np.eye(2, 5)
    gain = state.cov @ select.T @ np.linalg.inv(select @ state.cov @ select.T + known.cov)
    found = informed(Smoothed(state.mean, state.cov, np.zeros((5, 5))), known)
    np.testing.assert_allclose(found.mean, state.mean + gain @ (known.mean - select @ state.mean), rtol=1e-10)
    np.testing.assert_allclose(found.cov, state.cov - gain @ select @ state.cov, rtol=1e-9, atol=1e-12)


def beating(rng, n_frames, rate_hz=100.0):
    """Eight markers: a trunk of four at rest, four that beat at a frequency that wanders by a tenth."""
    phase = np.cumsum(2 * np.pi * (6 + 0.6 * rng.normal(size=n_frames)) / rate_hz)
    base = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]] * 2, dtype=float)
    xyz = np.repeat(base[None], n_frames, axis=0)
    xyz[:, 4:, 2] += 0.05 * np.sin(phase)[:, None]
    xyz[:, 4:, 0] += 0.02 * np.cos(phase)[:, None]
    noisy = xyz + 2e-4 * rng.normal(size=xyz.shape)
    trial = MarkerTrial(name="beat", t_s=np.arange(n_frames) / rate_hz, xyz_m=noisy, sd_m=np.full((n_frames, 8), 2e-4))
    return trial, xyz


@pytest.mark.rare
def test_a_second_in_the_dark_is_stated_as_such():
    """The limb's intervals hold through six beats in the dark, and become as wide as its whole motion.

    85 to 100 %, as six beats are few samples; also with a potential, which would be sure of a phase that nobody knows.
    """
    rng = np.random.default_rng(2)
    trial, truth = beating(rng, 400)
    xyz = trial.xyz_m.copy()
    xyz[150:250] = np.nan
    shown = MarkerTrial(name="dark", t_s=trial.t_s, xyz_m=xyz, sd_m=trial.sd_m)
    for potential in ("none", "limbs"):
        settings = PoseSettings(potential=potential, ranks=(2,))
        model = learn_pose(poses_of([shown], [0, 1, 2, 3], body_hz=3.0), settings)
        rate = (
            model.shape_sd[2:] / 2
        )  # white accelerations: of a sine at w of this velocity their density is 2 w rate^2
        density = np.diag(rate * np.sqrt(2 * 2 * np.pi * 6))
        model = replace(model, mechanics=LinearShape(*np.zeros((2, 2, 2)), np.zeros(2), density, 0.005))
        found = smooth(model, PositionObservations(xyz_m=xyz, sd_m=trial.sd_m), trial.t_s)
        sd = np.sqrt(np.diagonal(found.cov_m2, axis1=-2, axis2=-1))[150:250]
        miss = np.abs(found.xyz_m - truth)[150:250]
        assert 0.85 < (miss < 1.96 * sd)[:, 4:].mean() <= 1.0
        assert np.median(sd[40:60, 4:, 2]) > 0.5 * 0.05 / np.sqrt(2)
        assert np.isfinite(found.cov_m2).all()
