"""The animal as a tree of segments: kinematics against SciPy and differences, angles of a linkage that is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.ensemble import Gaussian
from mocap.filters.models.articulated import ArticulatedSettings, learn_articulated, rooted
from mocap.filters.models.base import TrialSet, estimate
from mocap.filters.models.pose import PoseSettings
from mocap.filters.motion.potential import Term, enforce
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.track import filter_frame
from mocap.filters.tree import Tree, fit_poses
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from docs.tools.columns import undocumented
from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError
from mocap.recording import of_points
from mocap.records import PARTS, MarkerTracks, Status
from mocap.report.job import run_job
from mocap.results.stored import read_recording
from mocap.results.tables import write_run
from mocap.skeleton import skeleton_text
from tests.mocap.test_articulated import LENGTHS, NAMES, SKELETON, arm

ARM = Anatomy(trunk=(0, 1, 2, 3), bones=((3, 4), (4, 5), (5, 6)))
DT_S, NOISE_M = 0.01, 2e-4


def arm_trial(hidden=None, frames=240):
    """An arm of a ball, a hinge and a wrist of two angles; its forearm is hidden in some frames."""
    xyz, _ = arm(wrist=(30.0, 25.0), elbow_deg=60.0, n=frames)
    shown = xyz.copy()
    if hidden is not None:
        shown[hidden, 5] = np.nan
    sd = np.full(xyz.shape[:2], NOISE_M)
    return xyz, MarkerTrial(name="arm", t_s=DT_S * np.arange(len(xyz)), xyz_m=shown, sd_m=sd)


@pytest.fixture(scope="module")
def learned():
    return learn_articulated([arm_trial()[1]], ARM).model


def small_tree(rng):
    """A ball, a hinge on it, and a universal joint beside them."""
    axes = [Rotation.from_rotvec(rng.normal(size=3)).as_matrix()[:n] for n in (3, 1, 2)]
    return Tree(
        parent=np.array([0, 1, 0]),
        joint_m=rng.normal(size=(3, 3)),
        axes=np.concatenate(axes),
        joint=np.array([0, 0, 0, 1, 2, 2]),
        segment=np.array([0, 1, 2, 2, 3]),
        place_m=rng.normal(size=(5, 3)),
    )


def test_markers_are_products_of_rotations():
    """The chain of rotations about stated axes, multiplied out by SciPy."""
    rng = np.random.default_rng(0)
    tree, q = small_tree(rng), rng.normal(size=6)
    found = tree.markers(tree.pose(q[None]))[0]
    ball = Rotation.from_rotvec(q[:3] @ tree.axes[:3])
    hinge = ball * Rotation.from_rotvec(q[3] * tree.axes[3])
    other = Rotation.from_rotvec(q[4:] @ tree.axes[4:])
    elbow = tree.joint_m[0] + ball.apply(tree.joint_m[1])
    expected = [
        tree.place_m[0],
        tree.joint_m[0] + ball.apply(tree.place_m[1]),
        *(elbow + hinge.apply(tree.place_m[m]) for m in (2, 3)),
        tree.joint_m[2] + other.apply(tree.place_m[4]),
    ]
    np.testing.assert_allclose(found, expected, atol=1e-13)


def test_jacobian_is_that_of_differences():
    """Central differences of the fourth decimal agree to their square."""
    rng = np.random.default_rng(1)
    tree, q, step = small_tree(rng), rng.normal(size=(1, 6)), 1e-5
    posed = tree.pose(q)
    found = tree.jacobian(q, posed, tree.markers(posed))[0]
    for k in range(6):
        ahead, back = (tree.markers(tree.pose(q + sign * step * np.eye(6)[k]))[0] for sign in (1, -1))
        np.testing.assert_allclose(found[..., k], (ahead - back) / (2 * step), atol=1e-8)


def test_fitted_angles_are_those_of_the_pose():
    """Markers of known angles, turned and moved as a whole: all are found back where the prior is wide."""
    rng = np.random.default_rng(2)
    tree, q = small_tree(rng), 0.5 * rng.normal(size=(3, 6))
    tree = replace(tree, segment=np.repeat([0, 1, 2, 3], 4), place_m=rng.normal(size=(16, 3)))
    turn, shift = Rotation.from_rotvec([0.2, -0.3, 0.1]).as_matrix(), np.array([0.1, 0.2, -0.3])
    found = fit_poses(tree, tree.markers(tree.pose(q)) @ turn.T + shift, np.full((3, 16), 1e-5))
    np.testing.assert_allclose(found.angles, q, atol=1e-6)
    np.testing.assert_allclose(found.rotation, np.tile(turn, (3, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(found.shift_m, np.tile(shift, (3, 1)), atol=1e-6)
    assert (found.certainty > 0.999).all()


def test_deviations_and_rates_are_derivatives(learned):
    """Rows of the markers and their velocities against differences of ``markers`` in the state and along its flow.

    Joints turn at some radians a second: what turns changes its lever, which is a term of its own.
    """
    rng, n = np.random.default_rng(3), learned.size
    mean = 0.01 * rng.normal(size=n)
    mean[learned.rank : 2 * learned.rank] *= 100
    mean[learned.parts[4]] *= 100
    view = learned.view(mean, 5)

    def markers(x, frame=5):
        return learned.markers(x[None], frame)[0]

    np.testing.assert_allclose(view.mean, markers(mean), atol=1e-14)
    for k in range(0, n, 7):
        change = 1e-6 * np.eye(n)[k]
        found = (markers(mean + change) - markers(mean - change)) / 2
        np.testing.assert_allclose(view.moved(change), found, atol=1e-12)
    velocity, jacobian = learned.rates(mean, 5)
    jacobian = jacobian.reshape(len(velocity), 6, n)
    for k in [*range(0, n, 9), *range(learned.rank), *range(*learned.parts[2].indices(n))]:
        if k in range(*learned.parts[1].indices(n)):  # the body's own turn is of first order there
            continue
        step = 1e-5 * np.eye(n)[k]
        np.testing.assert_allclose(jacobian[:, :3, k], (markers(mean + step) - markers(mean - step)) / 2e-5, atol=1e-7)
        ahead, back = (learned.rates(mean + sign * step, 5)[0] for sign in (1, -1))
        np.testing.assert_allclose(jacobian[:, 3:, k], (ahead - back) / 2e-5, atol=1e-4)
    assert np.isfinite(velocity).all()


def test_segments_have_the_lengths_and_joints_of_the_linkage(learned):
    """Lengths to half a percent, within four of their standard errors; a ball, a hinge and a universal joint."""
    np.testing.assert_allclose(learned.length_m, LENGTHS, rtol=0.005)
    np.testing.assert_array_equal(np.bincount(learned.tree.joint), [3, 1, 2])


def test_angles_come_out_with_deviations_that_hold():
    """The bend of the elbow is the linkage's; where the wrist is hidden the length of the forearm still holds it.

    It keeps that to 1 mm, and less than half as far off as a pose model without bones.
    """
    hidden = slice(100, 125)
    xyz, trial = arm_trial(hidden)
    observations = PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m)
    trials = TrialSet([trial], ARM)
    found = estimate(ArticulatedSettings(), trials, observations)
    assert "angle_rad" in found.own
    bend, sd = (found.own[name][:, 3] for name in ("angle_rad", "angle_sd_rad"))
    true = np.radians(60.0) + 0.5 * np.sin(1.3 * np.linspace(0, 4 * np.pi, len(xyz)))
    miss = bend - true - np.median(bend - true)  # angles are counted from the mean pose
    assert np.abs(miss).max() < np.radians(3.0)
    assert sd[hidden].max() > 2 * np.median(sd)
    rest = PoseSettings(ranks=(6,), regression=0.0, bones=0.0, potential="none")
    other = estimate(rest, trials, observations)
    apart = [np.linalg.norm(e.xyz_m[hidden, 5] - e.xyz_m[hidden, 4], axis=1) - LENGTHS[1] for e in (found, other)]
    assert np.abs(apart[0]).max() < 1e-3, apart
    assert np.abs(apart[0]).max() < 0.5 * np.abs(apart[1]).max(), apart


def test_a_chain_without_a_trunk_hangs_on_its_middle():
    """Of nine markers in a row the fifth."""
    chain = Anatomy(trunk=tuple(range(9)), bones=tuple((k, k + 1) for k in range(8)))
    assert rooted(chain).trunk == (4,)
    with pytest.raises(MocapError, match="rigid bones"):
        rooted(Anatomy(trunk=(0, 1, 2)))


def test_a_potential_moves_a_state_no_further_than_it_was_linearised_for():
    """A force of a million deviations moves it by three of them; one of 1 moves it by 1."""
    state = Gaussian(np.zeros(2), np.diag([2.0, 3.0]))
    for force, expected in ((1e6, 3.0), (1.0, 1.0)):
        term = Term(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1), np.array([force / 2, 0.0]))
        found, _ = enforce(state, [term], farthest=3.0)
        np.testing.assert_allclose(found.mean, [2 * expected, 0.0])


@pytest.mark.parametrize("model", ["articulated", "lagrangian"])
def test_angles_are_written_and_read(tmp_path, model):
    """The report names the model, the table has angles in degrees and energies, what is read is the same."""
    _, trial = arm_trial(frames=60)
    cov = np.tile(NOISE_M**2 * np.eye(3), (*trial.xyz_m.shape[:2], 1, 1))
    status = np.full(trial.xyz_m.shape[:2], Status.MEASURED)
    tracks = MarkerTracks(names=NAMES, t_s=trial.t_s, xyz_m=trial.xyz_m, cov_m2=cov, status=status)
    run, _ = run_job(clean(of_points(tracks, SKELETON, name="arm")), model=model, validated=False)
    assert run.report["model"]["name"] == model
    assert run.angles is not None
    assert run.angles["segment"].values.tolist() == ["shoulder to elbow", "elbow to wrist", "wrist to tip"]
    write_run(run, tmp_path, write_recording=None)
    (tmp_path / "skeleton.toml").write_text(skeleton_text(SKELETON), encoding="utf-8")
    table = pd.read_csv(tmp_path / "joint_angles.csv")
    np.testing.assert_allclose(
        table["elbow_wrist_bend_deg"], np.degrees(run.angles["angle_rad"].values[:, 3]), atol=1e-3
    )
    again = read_recording(tmp_path).angles
    assert again is not None
    assert set(again) == set(run.angles)
    for name in again:
        np.testing.assert_array_equal(again[name].values, run.angles[name].values)
    np.testing.assert_array_equal(again["angle"], run.angles["angle"])
    assert ("v_z_bound" in table.columns) == (model == "lagrangian")
    if model == "lagrangian":  # columns are in their order, and all frames are known
        assert (table["energy_j"] > 0).all()
        assert (table["v_z"] < table["v_z_bound"]).all()
    words = {"joint": NAMES, "end": NAMES, "part": PARTS[1] + PARTS[3]}
    assert not undocumented(table.columns, "joint_angles.csv", words)


def test_whole_turns_of_a_joint_are_taken_out():
    """The same rotations, less than half a turn each, and deviations that are derivatives of what comes out."""
    rng = np.random.default_rng(4)
    tree, rows = small_tree(rng), rng.normal(size=(6, 2))
    q = np.array([4.0, 3.0, 2.0, -9.0, 0.4, 0.3])
    found, turned = tree.without_turns(q, rows)
    np.testing.assert_allclose(tree.pose(found[None]).rotation, tree.pose(q[None]).rotation, atol=1e-12)
    assert (np.sqrt(np.bincount(tree.joint, found**2)) <= np.pi).all()
    for k in range(2):
        ahead, back = (tree.without_turns(q + sign * 1e-6 * rows[:, k], rows)[0] for sign in (1, -1))
        np.testing.assert_allclose(turned[:, k], (ahead - back) / 2e-6, atol=1e-6)
    same, kept = tree.without_turns(0.1 * q, rows)
    np.testing.assert_array_equal(same, 0.1 * q)
    np.testing.assert_array_equal(kept, rows)


def test_a_marker_far_from_its_prediction_is_met(learned, monkeypatch):
    """One marker of the hand where the arm is bent by a radian: the mode that scipy finds, which one step misses."""
    rng, at = np.random.default_rng(5), learned.initial()
    factor = np.linalg.cholesky(at.cov)
    size, sd, hand = learned.size, 1e-3, 6
    bent = at.mean.copy()
    bent[learned.parts[2]] += rng.choice([-1.0, 1.0], len(learned.arm_m)) * learned.arm_m
    shown = np.full((1, learned.slip_sd.size, 3), np.nan)
    shown[0, hand] = learned.markers(bent[None], 0)[0, hand]
    observations = PositionObservations(xyz_m=shown, sd_m=np.full(shown.shape[:2], sd))

    def away(x):
        mean = at.mean + factor @ x
        return np.append(x, (learned.markers(mean[None], 0)[0, hand] - shown[0, hand]) / sd)

    found = filter_frame(learned, observations, 0, at, None, 6.0).state
    mode = least_squares(away, np.zeros(size), xtol=1e-12, ftol=1e-12)
    own = np.linalg.solve(factor, found.mean - at.mean)
    assert 0.5 * np.sum(away(own) ** 2) < 1.05 * mode.cost + 0.1
    white = factor @ np.linalg.inv(mode.jac.T @ mode.jac) @ factor.T
    np.testing.assert_allclose(found.cov, white, atol=0.1 * np.diag(white).max())
    monkeypatch.setattr("mocap.filters.motion.articulated.BENT_RAD", np.inf)
    monkeypatch.setattr("mocap.filters.motion.pose.VAGUE_RAD", np.inf)
    once = filter_frame(learned, observations, 0, at, None, 6.0).state
    assert np.sum(away(np.linalg.solve(factor, once.mean - at.mean)) ** 2) > 4 * mode.cost


def test_a_held_root_leaves_slips_of_the_trunk_to_its_markers():
    """Three trunk markers that slip turn a free root, and the angles of all limbs with it."""
    rng = np.random.default_rng(6)
    tree, q = small_tree(rng), 0.3 * rng.normal(size=(40, 6))
    place = np.concatenate([0.3 * rng.normal(size=(3, 3)), rng.normal(size=(6, 3))])
    tree = replace(tree, segment=np.array([0, 0, 0, 1, 1, 2, 2, 3, 3]), place_m=place)
    xyz, sd = tree.markers(tree.pose(q)), np.full((40, 9), 0.03)
    xyz[:, :3] += 0.1 * rng.normal(size=(40, 3, 3))
    off = [np.sqrt(np.mean((fit_poses(tree, xyz, sd, root=root).angles - q) ** 2)) for root in ((1, 1), (0.01, 0.03))]
    assert off[1] < 0.7 * off[0]


def test_the_time_of_a_chain_is_that_of_one_filter():
    """Chains are not split into groups of markers, as poses are."""
    chain = ArticulatedSettings()
    pose = chain.pose
    assert chain.fill_s(45, 100) == pose.fill_s(45, 100)
    assert chain.fill_s(60, 100) > 1.5 * chain.fill_s(45, 100)
    assert pose.fill_s(60, 100) < 1.5 * pose.fill_s(45, 100)
