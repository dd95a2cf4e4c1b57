"""The picture of a joint's potential: its values, and the interval of its edge."""

import numpy as np
import pytest

from eal.kernels import GaussianKernel
from eal.potential import fit_potential
from eal.radius import value_deviation
from mocap.tracking.joint_map import EDGE, RANK, RESAMPLES, joint_map

LENGTH_M, WIDTH = 0.03, 0.15


@pytest.fixture(scope="module")
def elbow():
    """An elbow that goes to and fro between 30 and 100 degrees, 300 frames; coordinates in lengths of the segment."""
    rng, t = np.random.default_rng(3), np.linspace(0, 12 * np.pi, 300)
    angle = np.radians(65 + 35 * np.sin(t) + rng.normal(0, 1, 300))
    q = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * (1 + rng.normal(0, 0.01, (300, 1)))
    potential = fit_potential(q, kernel=GaussianKernel(0.5 / WIDTH**2), lam=1e-3)
    return potential, joint_map("elbow_l", potential, LENGTH_M * q, LENGTH_M)


def test_far_from_all_samples_it_is_one_without_being_computed(elbow):
    """Every value is that of all kernels, also where these are not multiplied out."""
    potential, found = elbow
    q = np.stack(np.meshgrid(found.x_mm, found.y_mm), axis=-1).reshape(-1, 2) / (1e3 * LENGTH_M)
    whole = 1 - ((potential.kernel.gram(q, potential.centres) @ potential.root) ** 2).sum(axis=1)
    assert np.abs(found.value.reshape(-1) - whole).max() < 1e-12
    assert (whole > 1 - 1e-15).mean() > 0.3
    assert np.array_equal(potential.value(q[:5]), found.value.reshape(-1)[:5])


def test_the_interval_lies_on_both_sides_of_the_edge(elbow):
    """Lines of the ends have V below the edge's on one side and above on the other, no farther than two widths."""
    potential, found = elbow
    edge = np.concatenate(found.edge_mm)
    line = np.concatenate(found.interval_mm)
    value = potential.value(line / (1e3 * LENGTH_M))
    assert (value < EDGE - 0.01).mean() > 0.2
    assert (value > EDGE + 0.01).mean() > 0.2
    away = np.linalg.norm(line[:, None] - edge, axis=-1).min(axis=1)
    assert away.max() < 2 * WIDTH * LENGTH_M * 1e3


def test_fewer_draws_and_functions_know_the_deviation_to_a_fifth(elbow):
    """Beside 300 resamples of 300 functions."""
    potential, found = elbow
    q = np.stack(np.meshgrid(found.x_mm, found.y_mm), axis=-1)[::4, ::4].reshape(-1, 2) / (1e3 * LENGTH_M)
    q = q[np.abs(potential.value(q) - EDGE) < 0.4]
    whole = value_deviation(potential, q, rng=np.random.default_rng(1), resamples=300)
    short = [
        value_deviation(potential, q, rng=np.random.default_rng(seed), resamples=RESAMPLES, max_rank=RANK)
        for seed in range(5)
    ]
    off = np.log(np.array(short) / whole)
    assert np.sqrt((off**2).mean()) < 0.25
    assert abs(off.mean()) < 0.1
