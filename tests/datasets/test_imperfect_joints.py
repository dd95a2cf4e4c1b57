"""Joints whose centres wander: condyles that roll without slip, in wings and in limbs of fixed reach."""

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard
from mocap.datasets.linkage import bent, hinged, unit


def flexed(angle_rad):
    return np.stack([np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)], axis=-1)


def test_the_instantaneous_centre_is_where_the_condyles_touch():
    """The bone beyond turns about the contact: there, and only there, its velocity vanishes. The contact wanders."""
    condyle_m, length_m = 0.002, 0.05
    angle, h = np.linspace(0.1, 1.8, 9), 1e-5
    straight = np.broadcast_to([1.0, 0, 0], (9, 3))

    def far_end(angle_rad):
        return hinged(straight, flexed(angle_rad), length_m=length_m, condyle_m=condyle_m)

    # planar rigid motion by one radian a second: velocity = z x (end - centre), so centre = end - velocity x z turned
    velocity = (far_end(angle + h) - far_end(angle - h)) / (2 * h)
    centre = far_end(angle) + np.stack([-velocity[:, 1], velocity[:, 0], velocity[:, 2]], axis=-1)
    contact = condyle_m * unit(straight + flexed(angle))
    # central differences: h^2 / 6 x |third derivative| < 1e-11 x 0.06, and roundings of 1e-17 / h
    np.testing.assert_allclose(centre, contact, atol=1e-11)
    # over 1.7 rad the contact goes along 1.7 / 2 rad of the condyle
    assert np.linalg.norm(contact[-1] - contact[0]) == pytest.approx(2 * condyle_m * np.sin(1.7 / 4), rel=1e-9)


@pytest.mark.parametrize("condyle_m", [0.0, 0.03])
def test_a_limb_that_rolls_still_ends_where_it_must(condyle_m):
    """From the joint that ``bent`` found, the condyle and the bone beyond lead to the end, in the limb's plane."""
    rng = np.random.default_rng(0)
    root, pole = rng.normal(size=(200, 3)), np.array([0.2, 1.0, -0.1])
    end = root + rng.uniform(0.4, 1.7, (200, 1)) * unit(rng.normal(size=(200, 3)))
    middle = bent(root, end, pole, upper_m=1.0, lower_m=0.8, condyle_m=condyle_m)
    before = unit(middle - root)
    np.testing.assert_allclose(np.linalg.norm(middle - root, axis=1), 1.0, atol=4e-15)
    # the bone beyond: the direction of least miss, by bisection on the flexion in the plane of root, middle and end
    normal = unit(np.cross(before, end - root))
    low, high = np.zeros(200), np.full(200, np.pi - 1e-9)
    for _ in range(100):
        half = (low + high) / 2
        direction = np.cos(half)[:, None] * before + np.sin(half)[:, None] * np.cross(normal, before)
        reached = middle + hinged(before, direction, length_m=0.8, condyle_m=condyle_m)
        too_far = np.linalg.norm(reached - root, axis=1) > np.linalg.norm(end - root, axis=1)
        low, high = np.where(too_far, half, low), np.where(too_far, high, half)
    # the reach is flat in the flexion near the straight limb: sqrt of a rounding
    np.testing.assert_allclose(reached, end, atol=1e-7)


@pytest.mark.parametrize(("make", "joint"), [(make_bat, "elbow_l"), (make_lizard, "knee_r")])
def test_rolling_joints_change_the_distance_of_their_markers_only(make, joint):
    """Ideal bones keep their length to 1e-12; rolling ones change it by 2 r (1 - cos(bend / 2)), r 3 % of the bone."""
    ideal, rolling = make(seed=3, skin_m=0), make(seed=3, skin_m=0, rolling=0.03)
    parent, centre, child = next((j.parent, j.centre, j.child) for j in ideal.skeleton.joints if j.name == joint)
    index = {name: m for m, name in enumerate(ideal.truth.names)}

    def bone(recording, a, b):
        return recording.truth.xyz_m[:, index[b]] - recording.truth.xyz_m[:, index[a]]

    length = np.linalg.norm(bone(ideal, centre, child), axis=1)
    np.testing.assert_allclose(length, length[0], atol=1e-12)
    before, beyond = bone(rolling, parent, centre), bone(rolling, centre, child)
    condyle = 0.03 * length[0]
    # |beyond|^2 = (2 r)^2 + (L - 2 r)^2 + 4 r (L - 2 r) cos(half the bend), and 2 r cos(half) + (L - 2 r) cos(bend)
    # is what of it lies along the bone before: both from one half angle
    squared, along = np.sum(beyond**2, axis=1), np.sum(beyond * unit(before), axis=1)
    rest = length[0] - 2 * condyle
    cos_half = (squared - 4 * condyle**2 - rest**2) / (4 * condyle * rest)
    np.testing.assert_allclose(along, 2 * condyle * cos_half + rest * (2 * cos_half**2 - 1), atol=1e-12)
    change = length[0] - np.sqrt(squared)
    assert change.min() > 0
    assert change.max() < 2 * condyle
    assert np.ptp(change) > 0.05 * condyle
