"""The literal EAL: V_z as an explicit force, integrated as SciPy has it, keeping energy, refusing what is too stiff."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eal.integrators import StabilityError
from filters.ensemble import Gaussian
from filters.learn import PoseSettings, learn_pose, learn_potential
from filters.motion import literal
from filters.motion.literal import LiteralShape
from filters.poses import pose_trial, shapes_of
from mocap.body import body_frames
from tests.filters.test_learned_models import DT_S, flapping


def ring(strength=40.0, **more):
    """Shapes on a circle of 2 cm."""
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    samples = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    potential = learn_potential(samples, PoseSettings(beta=3.0))
    return LiteralShape(potential=potential, unit=0.02, strength=strength, density=np.eye(2), **more)


def starts():
    """States near the circle that move along it and across it."""
    rng = np.random.default_rng(1)
    angle = rng.uniform(0, 2 * np.pi, 6)
    z = 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.8, 1.2, (6, 1))
    return np.concatenate([z, rng.normal(0, 0.8, (6, 2))], axis=1)


def swirl(x):
    """A known force that depends on the velocity."""
    return -300 * x[:, :2] + 20 * x[:, [3, 2]] * [1, -1]


@pytest.mark.parametrize("known", [None, swirl])
def test_the_flow_is_scipys(known, monkeypatch):
    """States after 5 ms as Dormand and Prince find them; halving the substep quarters the error: order 2."""
    x, dt_s = starts(), 0.005
    model = ring(known=known)

    def rate(_, flat):
        at = flat.reshape(x.shape)
        force = -model.strength / model.unit * model.potential.gradient(at[:, :2] / model.unit)
        return np.concatenate([at[:, 2:], force + (0 if known is None else known(at))], axis=1).ravel()

    truth = solve_ivp(rate, (0, dt_s), x.ravel(), method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1].reshape(x.shape)
    error = []
    for reach in (0.2, 0.1, 0.05):
        monkeypatch.setattr(literal, "REACH", reach)
        error.append(np.abs(model.flow(x, dt_s) - truth).max(axis=0))
    np.testing.assert_allclose(error[0] / error[1], 4, rtol=0.25)
    np.testing.assert_allclose(error[1] / error[2], 4, rtol=0.15)


def test_energy_is_kept():
    """Over 2 s, some hundred oscillations, the energy swings by less than (omega h)^2 / 4 = 6 % and does not drift.

    The means of the first and of the last quarter differ by less than half of a swing.
    """
    model, x = ring(), starts()
    energy = [model.energy(x)]
    for _ in range(400):
        x = model.flow(x, 0.005)
        energy.append(model.energy(x))
    kept = np.array(energy)
    swing = literal.REACH**2 / 4
    assert np.abs(kept / kept[0] - 1).max() < swing
    assert np.abs(kept[300:].mean(axis=0) / kept[:100].mean(axis=0) - 1).max() < swing / 2


def test_the_flow_can_be_reversed():
    """With velocities turned round the same steps lead back, to rounding."""
    model, x = ring(), starts()
    back = model.flow(model.flow(x, 0.02) * [1, 1, -1, -1], 0.02) * [1, 1, -1, -1]
    np.testing.assert_allclose(back, x, atol=1e-9)


def test_the_potential_contains():
    """Theorem 3: V(z(t)) <= V(z(0)) + eps^2 T(0), up to the swing of the energy; and without it shapes fly off."""
    model = ring()
    x = starts()
    limit = model.energy(x) / model.strength
    free = ring(strength=1e-9)
    flown = x
    for _ in range(100):
        x, flown = model.flow(x, 0.005), free.flow(flown, 0.005)
        assert (model.potential.value(x[:, :2] / model.unit) <= limit * (1 + literal.REACH**2 / 4)).all()
    assert np.linalg.norm(flown[:, :2], axis=1).min() > 3 * np.linalg.norm(x[:, :2], axis=1).max()


def test_substeps_follow_the_stability_limit():
    """Omega h is below ``REACH``, by as little as a whole number of substeps allows; stiffer models are refused.

    The fastest oscillation is that of the second derivative of the force at a sample, or slower.
    """
    model = ring()
    n = model.substeps(0.02)
    assert model.fastest_rad_s * 0.02 / n <= literal.REACH < model.fastest_rad_s * 0.02 / (n - 1)
    hessian = model.strength / model.unit**2 * model.potential.hessian(model.potential.samples)
    assert np.sqrt(np.linalg.eigvalsh(hessian).max()) <= model.fastest_rad_s
    assert ring(known=swirl, known_rad_s=4 * model.fastest_rad_s).substeps(0.02) > 4 * n - 4
    with pytest.raises(StabilityError, match=r"needs \d+ substeps in 0.02 s, more than 500: lower weight"):
        replace(model, strength=1e6).substeps(0.02)


def test_small_deviations_move_as_differences_do():
    """Mean and transition of a state known to 1 um are the flow and its derivative; what bends is of second order."""
    model, x = ring(), starts()[0]
    mean, transition, bent = model.linearised(Gaussian(x, 1e-6 * np.diag([1.0, 1.0, 50.0, 50.0])), 0.005)
    np.testing.assert_allclose(mean, model.flow(x[None], 0.005)[0], rtol=1e-6)
    step = 1e-6
    derivative = [(model.flow((x + e)[None], 0.005) - model.flow((x - e)[None], 0.005))[0] for e in step * np.eye(4)]
    scale = np.abs(transition).max(axis=1, keepdims=True)
    np.testing.assert_allclose(transition / scale, np.transpose(derivative) / (2 * step) / scale, atol=1e-5)
    assert np.abs(bent).max() < 1e-6


def test_a_pose_model_takes_it_by_name():
    """``mechanics="literal"``: the force is in the mechanics, nothing is enforced, poses are tracked and finite.

    Its strength: the mean kinetic energy is ``weight`` times less than what the potential charges an unseen pose.
    """
    rng = np.random.default_rng(2)
    xyz = flapping(rng) + rng.normal(0, 1e-4, (300, 8, 3))
    frames = body_frames(xyz[:, :4], dt_s=DT_S, cutoff_hz=3.0)
    trial = pose_trial(np.arange(300) * DT_S, xyz, frames)
    settings = PoseSettings(ranks=(1, 2, 3), mechanics="literal")
    shapes = shapes_of([trial], ranks=settings.ranks)
    soft = learn_pose([trial], settings, shapes=shapes)
    stiff = learn_pose([trial], replace(settings, weight=8.0), shapes=shapes)
    for model in (soft, stiff):
        assert isinstance(model.mechanics, LiteralShape)
        assert model.gradient is None
        assert model.name == "eal_literal"
    assert stiff.mechanics.strength == pytest.approx(2 * soft.mechanics.strength)
    kinetic = 0.5 * shapes.rate[0].var(axis=0).sum()
    assert soft.mechanics.strength > 4 * kinetic
    start = np.concatenate([shapes.z[0][0], shapes.rate[0][0]])
    mean, _, _ = soft.mechanics.linearised(Gaussian(start, 1e-6 * np.eye(len(start))), DT_S)
    later = shapes.z[0][1]
    assert np.linalg.norm(mean[: len(later)] - later) < 0.3 * np.linalg.norm(later - shapes.z[0][0])
