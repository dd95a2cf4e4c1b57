"""What is kept of the potentials of limbs: it is what the filter used."""

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.filters.limb_potential import OF_TIMES, LimbKeeper
from mocap.filters.models.pose import PoseSettings
from mocap.filters.models.registry import NAMED

from mocap.cleaning.cleaning import clean
from mocap.kinematics.points import rate_points_for
from mocap.reading.ideal_pixels import of_pixels
from mocap.tracking.tracking import learn_motion, seen_part, track


@pytest.fixture(scope="module")
def bat():
    recording = make_bat(seed=5, n_frames=60, n_cameras=4)
    prepared = clean(of_pixels(recording.pixels, recording.cameras, recording.skeleton, name=recording.name))
    return seen_part(prepared)


@pytest.mark.rare
def test_limbs_of_a_tracked_bat_lie_on_their_own_potential(bat):
    """State, covariance, V_z and pull of each frame are those of the model at its smoothed state.

    The state is inside the grid where V_z is low; the plane's coordinates of samples have the largest variance; the
    pull is minus the gradient by markers: a step along it, of all other markers none, lowers the potential.
    """
    part = bat
    model = learn_motion(part, PoseSettings(ranks=(4,), regression=0))
    asked = rate_points_for(part.names, part.skeleton, n_frames=60)
    found = track(part, model, rate_points=asked)
    limbs = LimbKeeper.of(model.motion, asked.names)[0].limbs
    assert found.own["limb"].tolist() == ["pelvis to tail", "shoulder_l to elbow_l", "shoulder_r to elbow_r"]
    for held, limb in zip(each_limb(found), limbs, strict=True):
        assert held["state"].shape == (60, 2)
        assert (np.linalg.eigvalsh(held["covariance"]) > 0).all()
        assert (held["at_state"] < 0.9).mean() > 0.9
        inside = (held["state"] >= [held["x"][0], held["y"][0]]) & (held["state"] <= [held["x"][-1], held["y"][-1]])
        assert inside.mean() > 0.95
        whole = np.linalg.eigvalsh(np.cov((limb.samples - limb.centre).T))[::-1]
        np.testing.assert_allclose(np.linalg.eigvalsh(np.cov(held["samples"].T))[::-1], whole[:2], rtol=1e-9)
        q = limb.mean + 0.3
        body = limb.on_residual.T @ limb.gradient(q[None])[0]
        step = 1e-6 * body / np.linalg.norm(body)
        change = barrier(limb, q + limb.on_residual @ step) - barrier(limb, q - limb.on_residual @ step)
        np.testing.assert_allclose(change, 2e-6 * np.linalg.norm(body) / limb.gradient.stiffness, rtol=1e-4)
        lengths = np.linalg.norm(held["pull"][:, held["marker"] >= 0], axis=-1)
        assert np.isfinite(lengths).all()
        assert lengths.max() > 0


def each_limb(found):
    """What the estimate says of each limb, by its own names; samples without their padding."""
    for i in range(len(found.own["limb"])):
        one = {
            n.removeprefix("limb_"): np.take(of, i, axis=1 if n.removeprefix("limb_") in OF_TIMES else 0)
            for n, of in found.own.items()
            if n.startswith("limb_")
        }
        yield one | {"samples": one["samples"][np.isfinite(one["samples"][:, 0])]}


def barrier(limb, q):
    return float(limb.potential.barrier_value(q))


@pytest.mark.rare
def test_nothing_is_kept_where_nothing_is_asked(bat):
    part = bat
    model = learn_motion(part, PoseSettings(ranks=(4,), regression=0, potential="none"))
    assert not LimbKeeper.of(model.motion, part.names)


@pytest.mark.rare
def test_joint_angles_of_a_tracked_bat_lie_on_their_own_potential(bat):
    """A map for each limb, V_z low where it was; the pull is how markers move with minus the gradient by the angles."""
    part = bat
    motion = learn_motion(part, NAMED["articulated"].settings)
    asked = rate_points_for(part.names, part.skeleton, n_frames=60)
    found = track(part, motion, rate_points=asked)
    assert found.own["limb"].tolist() == ["pelvis to tail", "shoulder_l to elbow_l", "shoulder_r to elbow_r"]
    for held in each_limb(found):
        assert (held["at_state"] < 0.9).mean() > 0.9
        assert np.nanmax(held["pull"]) > 0
    model, rng = motion.motion, np.random.default_rng(0)
    mean, change = 1e-3 * rng.normal(size=(2, model.size)), 1e-6 * rng.normal(size=(2, len(model.arm_m)))
    ahead, back = mean.copy(), mean.copy()
    ahead[:, model.parts[2]] += change
    back[:, model.parts[2]] -= change
    expected = 0.5 * (model._inside(ahead) - model._inside(back))
    np.testing.assert_allclose(model.moved(mean, change), expected, atol=1e-12)
