"""A pose tracked live, without its body's path: as with the path, which drops out of what is predicted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from filters.learn import PoseSettings, learn_pose
from filters.live import live, looks
from filters.motion.laid_path import LaidPath
from filters.motion.pose import BodyPath
from filters.observations import PositionObservations
from filters.poses import pose_trial
from filters.track import filter_forward, smooth
from mocap.body import BodyFrames, body_frames
from tests.filters.test_learned_models import DT_S, flapping


@pytest.fixture(scope="module")
def flight():
    """A body that flaps, turns by half a circle and climbs; a wing is hidden for a while."""
    rng = np.random.default_rng(1)
    body = flapping(rng, 240)
    t_s = DT_S * np.arange(240)
    turn = Rotation.from_rotvec(np.stack([0.2 * np.sin(5 * t_s), 0 * t_s, np.pi / 1.2 * t_s], axis=1)).as_matrix()
    truth = np.einsum("tij,tmj->tmi", turn, body) + np.stack([t_s, t_s**2, 0.1 * t_s], axis=1)[:, None]
    xyz = truth + rng.normal(0, 2e-4, truth.shape)
    xyz[100:125, 4:6] = np.nan
    trial = pose_trial(t_s, xyz, body_frames(xyz[:, :4], dt_s=DT_S, cutoff_hz=3.0))
    model = learn_pose([trial], PoseSettings(ranks=(1, 2, 3)))
    return model, PositionObservations(xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 2e-4)), t_s, truth


def begun(model):
    """The model with the first frame of its path alone."""
    path = model.path
    first = BodyFrames(rotation=path.frames.rotation[:1], position_m=path.frames.position_m[:1])
    return LaidPath(
        pose=replace(
            model, path=BodyPath(frames=first, velocity_m_s=path.velocity_m_s[:1], rate_rad_s=path.rate_rad_s[:1])
        )
    )


def test_the_path_drops_out(flight):
    """Smoothed markers and deviations are those with the path known to the end, to a tenth of the stated deviation.

    What differs is the second order of the turn between body and path, a degree: (0.02)^2 / 2 of some cm is 0.01 mm.
    """
    model, seen, t_s, _ = flight
    whole = smooth(model, seen, t_s)
    found = smooth(replace(begun(model), kept=1000), seen, t_s)
    sd = np.sqrt(np.diagonal(whole.cov_m2, axis1=-2, axis2=-1))
    assert np.abs((found.xyz_m - whole.xyz_m) / sd).max() < 0.1
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.cov_m2, axis1=-2, axis2=-1)) / sd, 1, atol=0.05)


def test_bodies_are_predicted_on_their_path(flight):
    """Every prediction has the body's deviation from the path at zero, to the second order of its turn."""
    model, seen, t_s, _ = flight
    own = replace(begun(model), kept=1000)
    _, g, _, g_rate, _ = model.parts
    for prediction in filter_forward(own, seen, t_s).predictions[1:]:
        assert prediction is not None
        assert np.abs(prediction.state.mean[g]).max() < 1e-3
        assert np.abs(prediction.state.mean[g_rate][:3]).max() < 1e-9


def test_live_without_a_future(flight):
    """With a lag of 20 frames live is as good as the smoother that knows the whole path; and the path's memory ends."""
    model, seen, t_s, truth = flight
    own = replace(begun(model), kept=30)
    found = np.array([e.xyz_m for e in live(own, looks(seen, t_s), lag=20)])
    whole = smooth(model, seen, t_s).xyz_m
    measured = np.isfinite(seen.xyz_m[..., 0])

    def rms(xyz, where):
        return np.sqrt(np.mean(np.sum((xyz - truth)[where] ** 2, axis=-1)))

    assert rms(found, measured) < 1.1 * rms(whole, measured)
    assert len(own.places) == 30
