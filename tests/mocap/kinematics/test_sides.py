"""Left and right: the same motion of both sides is the same angles."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard
from mocap.filters.anatomy import counterparts
from mocap.filters.velocities import Motion, with_means

from mocap.kinematics.compute import kinematics
from mocap.kinematics.points import rate_points_for


def symmetric(recording):
    """A motion whose right side is the mirror image of its left one, exactly: the mean of it and its reflection."""
    names, t_s = recording.truth.names, recording.truth.t_s
    xyz = recording.truth.xyz_m
    xyz = 0.5 * (xyz + xyz[:, list(counterparts(names))] * [1, -1, 1])
    frames, count = xyz.shape[:2]
    return Motion(
        names=tuple(names),
        t_s=t_s,
        xyz_m=xyz,
        velocity_m_s=np.gradient(xyz, t_s, axis=0),
        own=np.tile(1e-8 * np.eye(6, dtype=np.float32), (frames, count, 1, 1)),
        pairs=np.empty((0, 2), dtype=np.int64),
        cross=np.empty((frames, 0, 6, 6), dtype=np.float32),
        kept=np.ones(xyz.shape),
        measured=np.ones((frames, count), dtype=bool),
    )


def both_sides(motion, skeleton):
    found = kinematics(with_means(motion, rate_points_for(motion.names, skeleton, n_frames=len(motion.t_s))), skeleton)
    left = [
        name
        for name in found
        if "_l_" in name and "_r_" not in name and found[name].kind in ("joint", "stroke", "length", "area")
    ]
    return [(name, found[name], found[name.replace("_l_", "_r_")]) for name in left]


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_a_symmetric_animal_has_the_same_angles_on_both_sides(make):
    """Angles, rates, accelerations, lengths, areas and strokes, with their deviations, to rounding.

    Slopes are differences of 1e-4 of the animal's size, and rates' accelerations differences of these: 1e-6 of the
    largest is rounding over both steps.
    """
    recording = make(seed=1, n_frames=120)
    pairs = both_sides(symmetric(recording), recording.skeleton)
    assert len(pairs) > 30
    assert any("rotation_rate" in name for name, _, _ in pairs)
    for name, left, right in pairs:
        for part in ("value", "sd"):
            one, other = getattr(left, part), getattr(right, part)
            np.testing.assert_allclose(other, one, rtol=0, atol=1e-6 * np.nanmax(np.abs(one)), err_msg=name)


def test_a_line_across_may_be_stated_either_way():
    """It leads to the side of the joint: a skeleton with the line turned about on the right gives the same angles."""
    recording = make_bat(seed=1, n_frames=40)
    measures = recording.skeleton.measures
    turned = {
        name: replace(axes, parent=(axes.parent[0], axes.parent[1][::-1])) if name.endswith("_r") else axes
        for name, axes in measures.axes.items()
    }
    skeleton = recording.skeleton
    stated = [
        {**{name: getattr(skeleton, name) for name in ("markers", "bones", "joints", "trunk")}, "measures": one}
        for one in (measures, replace(measures, axes=turned))
    ]
    found = [both_sides(symmetric(recording), type(skeleton)(**parts)) for parts in stated]
    for (name, _, right), (_, _, other) in zip(*found, strict=True):
        np.testing.assert_allclose(other.value, right.value, rtol=1e-12, err_msg=name)
