"""What is learned from tracks: noise densities, potentials as forces, models that fit their data."""

from dataclasses import fields

import numpy as np
import pytest
from mocap.filters.body_axes import body_frames
from mocap.filters.models.constant_velocity import acceleration_density, learn_constant_velocity
from mocap.filters.models.pose import (
    PoseSettings,
    learn_pose,
    learn_potential,
    recorded_motion,
    with_potential,
)
from mocap.filters.motion.base import Step
from mocap.filters.motion.potential import Pull
from mocap.filters.poses import pose_trial, shapes_of

from benchmarks.gaps.ours import Quadratic
from eal import GaussianKernel, fit_potential

DT_S = 0.005


def flapping(rng, n_frames=300, n_markers=8):
    """A body that glides and flaps: trunk markers fixed, wing markers on one loop of shapes."""
    t = np.arange(n_frames) * DT_S
    shape = rng.normal(0, 0.05, (n_markers, 3))
    modes = np.zeros((2, n_markers, 3))
    modes[:, 4:] = rng.normal(0, 0.02, (2, n_markers - 4, 3))
    beat = 2 * np.pi * 9 * t
    body = shape + np.sin(beat)[:, None, None] * modes[0] + 0.5 * np.cos(beat)[:, None, None] * modes[1]
    return body + np.stack([0.3 * t, 0 * t, 0.05 * np.sin(t)], axis=1)[:, None]


@pytest.fixture(scope="module")
def learned():
    xyz = flapping(np.random.default_rng(1))
    xyz = xyz + np.random.default_rng(2).normal(0, 1e-4, xyz.shape)
    xyz[80:100, 5] = np.nan
    frames = body_frames(xyz[:, :4], dt_s=DT_S, cutoff_hz=3.0)
    trial = pose_trial(np.arange(len(xyz)) * DT_S, xyz, frames)
    settings = PoseSettings(ranks=(1, 2, 3, 4), potential="none")
    shapes = shapes_of([trial], ranks=settings.ranks)
    return xyz, settings, learn_pose([trial], settings, shapes=shapes), shapes, trial


@pytest.mark.parametrize(("a", "hz"), [(1.0, 2.0), (0.3, 8.0)])
def test_the_density_of_an_oscillation(a, hz):
    """For a sine of variance v at w the density is 2 v w^3, to the smoothing and the differences of the step.

    Half amplitude at 30 Hz costs (8/30)^4 = 0.5 % at 8 Hz; each central difference 1 - sin(w dt)/(w dt) = 1 %.
    """
    t = np.arange(2000) * DT_S
    sine = a * np.sqrt(2) * np.sin(2 * np.pi * hz * t)[:, None]
    found = acceleration_density(sine, dt_s=DT_S, cutoff_hz=30.0)
    assert found[0] == pytest.approx(2 * a**2 * (2 * np.pi * hz) ** 3, rel=0.05)


def test_a_still_series_has_a_positive_density():
    """Nothing moves, and the filter still gets a noise that it can factor."""
    assert (acceleration_density(np.zeros((50, 3)), dt_s=DT_S, cutoff_hz=20.0) > 0).all()


def test_a_pose_is_held_by_the_potential_that_eal_learns():
    """V_z of the filter is ``eal.fit_potential`` of the same samples; of many, of 200 evenly spaced ones."""
    samples = np.random.default_rng(0).normal(size=(399, 3))
    q = np.random.default_rng(1).normal(size=(50, 3))
    for some, all_of in ((samples[:200], samples[:200]), (samples[::2], samples)):
        np.testing.assert_allclose(learn_potential(all_of).value(q), fit_potential(some).value(q), atol=1e-12)


def test_the_penalty_is_a_gradient():
    """Central differences of -log(1 - V_z) / eps^2: their error is step^2 times a third derivative, 1e-6."""
    rng = np.random.default_rng(3)
    angle = rng.uniform(0, 2 * np.pi, 200)
    z = np.sqrt(2) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    potential = learn_potential(z)
    at, step = 1.2 * z[:10], 1e-6

    def value(where):
        return -7.0 * np.log(1 - potential.value(where))

    slopes = [(value(at + e) - value(at - e)) / (2 * step) for e in step * np.eye(2)]
    expected = np.stack(slopes, axis=-1)
    force = Pull(potential=potential, stiffness=7.0)
    np.testing.assert_allclose(force(at), expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_the_penalty_pulls_towards_the_data():
    """Outside a ring of samples the force points inwards, inside outwards, on it there is little."""
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    force = Pull(potential=fit_potential(ring, kernel=GaussianKernel(4.0), lam=1e-4), stiffness=1.0)
    radial = [np.sum(force(r * ring[::7]) * ring[::7], axis=1) for r in (0.7, 1.0, 1.4)]
    assert (radial[0] < 0).all()
    assert (radial[2] > 0).all()
    assert np.abs(radial[1]).max() < 0.2 * min(np.abs(radial[0]).min(), np.abs(radial[2]).min())


def test_the_pose_model_holds_its_data(learned):
    """Two modes are found, and the model's markers at the learned shapes are the measured ones, to the noise."""
    xyz, _, model, shapes, _ = learned
    z, known = shapes.z[0], shapes.certainty[0]
    assert z.shape == (len(xyz), 2)
    assert model.name == "pose_constant_velocity"
    assert (known > 0.9).all()
    states = np.zeros((1, model.size))
    error = []
    for frame in range(0, len(xyz), 10):
        states[0, :2] = z[frame]
        error.append(model.markers(states, frame)[0] - xyz[frame])
    assert np.sqrt(np.nanmean(np.square(error))) < 1e-3
    density = np.diag(model.mechanics.density) ** 2
    assert (density > 0).all()
    assert (model.body.lasting_sd > 0).all()
    assert np.diag(model.body.density)[:3].max() ** 2 < 1e-2 * density.max()  # the body's frame moves by noise only
    assert (model.shape_sd > 0).all()
    assert (model.body_sd > 0).all()
    assert (model.residual_rate_hz > 0).all()


@pytest.mark.parametrize("potential", ["limbs", "limb motion"])
@pytest.mark.parametrize("kind", [PoseSettings, Quadratic])
def test_the_potential_is_added_and_nothing_else(learned, kind, potential):
    """``with_potential`` changes gradient, what it reads, and name; unseen states are pulled, seen ones hardly.

    So does the potential of a person's own settings, here the quadratic one of a benchmark.
    """
    _, settings, model, shapes, trial = learned
    motion = recorded_motion([trial], shapes)
    held = with_potential(model, motion, kind(**{**vars(settings), "potential": potential}))
    (added,) = held.potentials
    states = np.column_stack([motion.z, motion.rate]) @ added.on_shape.T
    assert states.shape[1] == (4 if "motion" in potential else 2)
    np.testing.assert_allclose(states, added.samples)
    changed = {field.name for field in fields(held) if getattr(held, field.name) is not getattr(model, field.name)}
    assert changed - {"points", "reads"} == {"potentials", "name"}
    assert held.name == "eal"
    far, near = (np.linalg.norm(added.gradient(size * states[:5])) for size in (3, 1))
    assert far > (2.9 if kind is Quadratic else 10) * near  # a parabola's force is proportional
    if kind is Quadratic:  # V = (x - mean) grad V / 2 is charged the weight on average
        away = states - states.mean(axis=0)
        charged = 0.5 * np.mean(np.sum(away * added.gradient(states), axis=1))
        assert charged == pytest.approx(4 / motion.tau_s, rel=0.02)


def test_constant_velocity_starts_where_each_marker_is_first_seen(learned):
    """Start positions are first sightings; densities are finite and positive for markers seen only now and then too."""
    xyz = learned[0].copy()
    xyz[:50, 2] = np.nan
    xyz[3:, 7] = np.nan
    model = learn_constant_velocity(xyz, dt_s=DT_S)
    np.testing.assert_array_equal(model.start_m[[0, 2]], [xyz[0, 0], xyz[50, 2]])
    assert np.isfinite(model.density).all()
    assert (model.density > 0).all()
    assert (model.density[4:7] > 100 * model.density[:4].max()).all()  # wings flap, the trunk glides


@pytest.mark.parametrize("n_frames", [1, 2, 5])
def test_constant_velocity_of_few_frames(n_frames):
    """A recording of a frame or two has a model, with numbers."""
    model = learn_constant_velocity(flapping(np.random.default_rng(4))[:n_frames], dt_s=DT_S)
    start = model.initial()
    assert np.isfinite(start.mean).all()
    for cov in (start.cov, model.move(start, Step(1, DT_S)).noise):
        assert (np.einsum("mii->mi", cov) > 0).all()


def test_constant_velocity_learns_from_other_recordings(learned):
    """A marker that rests, or is never seen, has the noise that other recordings show; their mean is geometric."""
    moving = learned[0]
    still, unseen = moving.copy(), moving.copy()
    still[:, 6] = still[0, 6] + 1e-6 * np.random.default_rng(5).normal(size=(len(still), 3))
    unseen[:, 6] = np.nan
    one, other, both, without = (
        learn_constant_velocity(xyz, dt_s=DT_S, others=others).density
        for xyz, others in ((moving, ()), (still, ()), (still, (moving,)), (unseen, (moving,)))
    )
    assert other[6] < 1e-6 * one[6]
    np.testing.assert_allclose(both, np.sqrt(one * other), rtol=1e-9)
    np.testing.assert_allclose(without, one, rtol=1e-9)
