"""The oracle differs from the product in V_z alone, and that knows the trial that is filled."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.models.base import TrialSet
from mocap.filters.models.pose import PoseSettings
from mocap.filters.poses import MarkerTrial
from mocap.filters.subspace import PoseSubspace

from benchmarks.gaps.oracle import EalOracle, Informed, shapes_in

TRUNK = (0, 1, 2, 3)


def trial(seed, *, frames=300, sd_m=2e-4):
    """Ten markers, four of them a rigid trunk; the others move with two angles a and b, and with a^2 and a b."""
    animal, rng = np.random.default_rng(100), np.random.default_rng(seed)
    t_s = np.arange(frames) / 200
    trunk = np.random.default_rng(99).normal(0, 0.03, (4, 3))
    mean, directions = animal.normal(0, 0.05, 18), np.linalg.qr(animal.normal(size=(18, 4)))[0].T
    a, b = np.sin(2 * np.pi * (rng.random(2)[:, None] + np.array([[4.0], [1.5]]) * t_s))
    shape = mean + 0.03 * np.column_stack([a, b, a**2, a * b]) @ directions
    xyz = np.concatenate([np.tile(trunk.ravel(), (frames, 1)), shape], axis=1).reshape(frames, 10, 3)
    xyz = xyz + rng.normal(0, sd_m, xyz.shape)
    return MarkerTrial(name=f"gait_{seed}", t_s=t_s, xyz_m=xyz, sd_m=np.full(xyz.shape[:2], sd_m))


def test_shapes_are_those_that_poses_were_made_of():
    """Poses of known shapes, a third of them unseen: the shapes come back, to rounding and the small ridge (1e-6)."""
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.normal(size=(30, 4)))[0]
    subspace = PoseSubspace(mean=rng.normal(size=30), basis=basis, residual_sd=np.full(30, 1e-3))
    z = rng.normal(size=(50, 4))
    y = subspace.mean + z @ basis.T
    y[np.repeat(rng.random((50, 10)) < 1 / 3, 3, axis=1)] = np.nan
    np.testing.assert_allclose(shapes_in(subspace, y), z, rtol=1e-3, atol=1e-4)


@pytest.mark.rare
@pytest.mark.slow
def test_only_the_potential_knows_the_trial():
    """Learned from another gait the potential is steep where the hidden trial was; the oracle's is not there.

    Subspace, mechanics and noise are the same arrays with both.
    """
    others, own = [trial(seed) for seed in (1, 2)], trial(3)
    xyz = np.array(own.xyz_m)
    xyz[100:200, 6:] = np.nan
    hidden = replace(own, xyz_m=xyz)
    plain = PoseSettings(ranks=(4,), bones=0.0, regression=0.0)
    informed = Informed(**{**vars(plain), "whole": (*others, own)})
    trials = TrialSet([*others, hidden], Anatomy(tuple(TRUNK)))
    usual, knowing = (model.fit(trials).motion for model in (plain, informed))
    np.testing.assert_array_equal(usual.subspace.basis, knowing.subspace.basis)
    np.testing.assert_array_equal(usual.mechanics.density, knowing.mechanics.density)
    (held,), (known,) = usual.potentials, knowing.potentials
    assert known.samples.shape == (len(own.t_s), 8)
    assert len(held.samples) > 2 * len(own.t_s)
    states = known.samples[100:200]  # what is hidden
    pulls = [np.linalg.norm(known.gradient(states + k * states.std(axis=0)), axis=1).mean() for k in (0, 3)]
    assert pulls[0] < 0.5 * pulls[1]


def test_it_cannot_be_had_without_the_answer():
    """Used as any other method it is an error, not a silent copy of the product."""
    with pytest.raises(TypeError, match="the answer"):
        EalOracle().learn([])
