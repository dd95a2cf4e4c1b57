"""The registry of motion models: each is written, read and told in plain words."""

import json
from dataclasses import is_dataclass, replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.hidden_gaps import Effort, hidden_gaps
from mocap.filters.models.articulated import ArticulatedSettings
from mocap.filters.models.base import TrialSet, estimate
from mocap.filters.models.constant_velocity import LastingSettings, MarkerSettings
from mocap.filters.models.lagrangian import LagrangianSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.models.registry import MODELS
from mocap.filters.models.smooth_acceleration import SmoothSettings
from mocap.filters.observations import PositionObservations

from mocap.tracking.model_file import read, written
from tests.filters.test_gaps_in_trials import trial_of

POSE = PoseSettings(ranks=(2,), bones=1 / 3)
EXAMPLES = {
    "articulated": ArticulatedSettings(pose=POSE),
    "constant velocity": MarkerSettings(acceleration=0.1),
    "lagrangian": LagrangianSettings(pose=replace(POSE, potential="limbs"), trunk=300.0),
    "lasting acceleration": LastingSettings(),
    "pose": POSE,
    "smooth acceleration": SmoothSettings(free=(1, 3)),
}


def test_every_model_has_an_example_here():
    """A model that is added to the registry is tested below."""
    assert set(EXAMPLES) == set(MODELS)
    assert all(is_dataclass(model) for model in MODELS.values())


@pytest.mark.parametrize("name", MODELS)
def test_what_is_written_is_read(name):
    """Through JSON and back every setting is the same; the file has the model's name from the registry."""
    again = json.loads(json.dumps(written(EXAMPLES[name])))
    assert again["model"] == name
    assert read(again) == EXAMPLES[name]


@pytest.mark.parametrize(("mechanics", "name"), [("linear", "articulated"), ("lagrangian", "lagrangian")])
def test_what_was_written_with_its_mechanics_is_read(mechanics, name):
    """Files of before have both models under one name, and which it is in ``mechanics``, whose trunk only one uses."""
    before = written(EXAMPLES[name]) | {"model": "articulated", "mechanics": mechanics, "trunk": 300.0}
    assert read(json.loads(json.dumps(before))) == EXAMPLES[name]


@pytest.mark.rare
@pytest.mark.parametrize("name", MODELS)
def test_every_model_fills_what_is_missing(name):
    """Fitted to two trials it fills the gap of the last with positions and covariances that are positive definite."""
    trial = trial_of(3)
    xyz = trial.xyz_m.copy()
    xyz[40:60, 5] = np.nan
    shown = replace(trial, xyz_m=xyz)
    observations = PositionObservations(xyz_m=shown.xyz_m, sd_m=shown.sd_m)
    shares = []
    trials = TrialSet([trial_of(1), shown], Anatomy((0, 1, 2, 3), ((3, 4), (4, 5), (3, 6), (6, 7))))
    found = estimate(EXAMPLES[name], trials, observations, progress=shares.append)
    assert np.isfinite(found.xyz_m[40:60, 5]).all()
    assert (np.linalg.eigvalsh(found.cov_m2[40:60, 5]) > 0).all()
    assert shares[-1] == pytest.approx(1.0)
    assert (np.linalg.norm(found.xyz_m - trial.xyz_m, axis=-1)[40:60, 5] < 0.1).all()


@pytest.mark.rare
def test_learning_tells_how_far_it_is():
    """A line for each trial that is filled, numbered to the last, with what each model errs by."""
    told = []
    trials, rng = [trial_of(seed, 70) for seed in (1, 2)], np.random.default_rng(0)
    gaps = hidden_gaps(trials, Anatomy((0, 1, 2, 3)), rng, effort=Effort(validated=2, times=1), tell=told.append)
    gaps.fill((MarkerSettings(), POSE))
    assert [line.split("(")[1].split(")")[0] for line in told] == ["1 of 2", "2 of 2"]
    assert all("mm by constant velocity, " in line and line.endswith(" mm by pose model") for line in told)
