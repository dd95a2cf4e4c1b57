"""A model of constant velocity alone, quick to save and track with, and whether two records are the same."""

from dataclasses import fields

import numpy as np
from mocap.filters.mixture import Mixture
from mocap.filters.model import LearnedModel
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.poses import MarkerTrial


def small_model():
    """Five markers that wander for 40 frames."""
    rng = np.random.default_rng(1)
    xyz = rng.normal(0, 0.1, (5, 3)) + np.cumsum(rng.normal(0, 1e-3, (40, 5, 3)), axis=0)
    trial = MarkerTrial(name="walk", t_s=np.arange(40) / 100, xyz_m=xyz, sd_m=np.full((40, 5), 1e-3))
    one = np.ones((1, 1))
    mixture = Mixture(offset=[0.0], slope=[0.0], length=[10.0], scale=one, widen=1.0, dof=36.0)
    return LearnedModel(
        names=tuple("abcde"),
        trunk=(),
        bones=(("a", "b"),),
        trials=(trial,),
        models=(MarkerSettings(),),
        mixture=mixture,
        scores={"mixture": {}},
    )


def same(a, b):
    """Whether two records hold the same, to the last bit."""
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b
