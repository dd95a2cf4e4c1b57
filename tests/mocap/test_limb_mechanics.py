"""A limb of two rods, filmed, tracked by its own Lagrangian: energies, bound, truth inside."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Limb, masses_of
from mocap.filters.bodies import rod_masses

from eal.rods import RodLimb
from mocap.cameras.camera import project, stacked
from mocap.errors import MocapError
from mocap.pipeline.limb_mechanics import Filmed, limb_mechanics, longest_chain
from mocap.plots.mechanics import draw_mechanics
from mocap.records import marker_tracks
from mocap.results.mechanics import mechanics_table
from mocap.skeleton import Bone, Skeleton
from tests.mocap.rigs import ring

NAMES = ("a", "b", "root", "elbow", "hand")
BONES = (Bone(a="root", b="elbow"), Bone(a="elbow", b="hand"))
SKELETON = Skeleton(name="arm", markers=NAMES, bones=BONES, trunk=("a", "b", "root"))
ROD = RodLimb(
    parents=(-1, 0),
    length_m=np.array([0.3, 0.2]),
    mass_kg=np.ones(2),
    centre=np.full(2, 0.5),
    mean=np.array([[1.0, 0, 0], [0, 1.0, 0]]),
)


@pytest.fixture(scope="module")
def arm():
    """44 frames of an arm that swings, seen by two cameras to 1 px, its hand dark for five frames."""
    rng = np.random.default_rng(0)
    t = np.arange(44) / 100.0
    phase = 2 * np.pi * 2.5 * t
    q = np.stack([0.5 * np.sin(phase), 0.2 * np.cos(phase), 0.4 * np.cos(phase), 0.1 * np.sin(phase)], axis=1)
    xyz = np.zeros((44, 5, 3))
    xyz[:, 0], xyz[:, 1] = (-0.3, 0.1, 0), (-0.2, -0.2, 0.1)
    xyz[:, 3:] = ROD.joints_m(q)
    matrices = stacked(ring(2))
    uv = project(matrices, xyz) + rng.normal(0, 1.0, (2, 44, 5, 2))
    dark = np.zeros((44, 5), dtype=bool)
    dark[20:25, 4] = True
    uv[:, dark] = np.nan
    rough = xyz + rng.normal(0, 0.0005, xyz.shape)
    rough[:, :3] = xyz[:, :3]
    markers = marker_tracks(NAMES, t, rough, cov_m2=np.broadcast_to(1e-8 * np.eye(3), (*xyz.shape, 3)))
    filmed = Filmed(
        name="arm",
        skeleton=SKELETON,
        markers=markers,
        seen=~dark,
        matrices=matrices,
        uv_px=uv,
        sd_px=np.ones((2, 44, 5)),
        dof=np.full(2, 8.0),
    )
    return filmed, xyz, limb_mechanics(filmed)


def test_the_limb_is_tracked_with_its_truth_inside(arm):
    """90 to 100 % of coordinates in 95 %, of 44 correlated frames; bones of constant length by construction."""
    filmed, xyz, (limb,) = arm
    assert (limb.root, limb.markers, limb.stated) == ("root", ("elbow", "hand"), False)
    sd = np.sqrt(np.diagonal(limb.cov_m2, axis1=-2, axis2=-1))
    inside = np.abs(limb.xyz_m - xyz[:, 3:]) <= 1.96 * sd
    assert 0.9 <= inside.mean() <= 1.0
    assert np.linalg.norm(limb.xyz_m - filmed.markers.xyz_m[:, 3:], axis=-1)[:, 0].mean() < 0.005
    lengths = np.linalg.norm(limb.xyz_m[:, 1] - limb.xyz_m[:, 0], axis=-1)
    np.testing.assert_allclose(lengths, limb.limb.length_m[1], rtol=1e-9)
    assert lengths[0] == pytest.approx(0.2, rel=0.01)


def test_energy_and_bound_are_those_of_the_tracked_limb(arm):
    """T = v^T M(q) v / 2 with the rods' M at the track; the bound is V + eps^2 T, and the energy over 1/eps^2."""
    filmed, _, (limb,) = arm
    q, v = limb.track.q, limb.track.v
    kinetic = 0.5 * np.einsum("ti,tij,tj->t", v, limb.model.system.mass(q), v)
    np.testing.assert_allclose(limb.kinetic_j, kinetic, rtol=1e-9)
    np.testing.assert_allclose(limb.bound, limb.track.value + kinetic / limb.strength_j, rtol=1e-9)
    np.testing.assert_allclose(limb.track.energy_j, limb.bound * limb.strength_j, rtol=1e-9)
    table = mechanics_table([limb], filmed.markers.t_s)
    assert list(table.columns) == ["frame", "t_s", *(f"hand_{c}" for c in ("kinetic_j", "energy_j", "v_z", "bound"))]
    np.testing.assert_allclose(table["hand_bound"][limb.first :], limb.bound)
    shown = [line.get_ydata() for axes in draw_mechanics(limb).axes for line in axes.lines]
    assert any(np.allclose(line, limb.bound) for line in shown if len(line) == len(limb.bound))


def test_masses_are_those_stated_spread_over_the_bones_between():
    """An arm of 30 g over 0.3 and 0.2 m: 18 and 12 g; the finger gets the least density; one bone keeps its centre."""
    names = ["s", "e", "w", "t"]
    bones = [(0, 1), (1, 2), (2, 3)]
    lengths = np.array([0.3, 0.2, 0.1])
    mass, centre, stated = rod_masses(bones, lengths, masses_of(names, [("s", "w", 0.03, 0.5)]))
    assert stated
    np.testing.assert_allclose(mass, [0.018, 0.012, 0.006])
    _, centre, _ = rod_masses(bones, lengths, masses_of(names, [("e", "s", 0.001, 0.4)]))
    np.testing.assert_allclose(centre, [0.6, 0.5, 0.5])
    mass, _, stated = rod_masses(bones, lengths, [])
    assert not stated
    assert mass.sum() == pytest.approx(1.0)


def test_a_skeleton_without_limbs_is_refused(arm):
    filmed = arm[0]
    with pytest.raises(MocapError, match="has no limb of 2 rigid bones"):
        limb_mechanics(replace(filmed, skeleton=replace(SKELETON, bones=BONES[:1])))


def test_the_longest_chain_of_a_branching_limb():
    limb = Limb((1, 2, 3, 4, 5), (0, 1, 1, 2, 4))
    chain = longest_chain(limb)
    assert (chain.children, chain.parents) == ((1, 2, 4, 5), (0, 1, 2, 4))
