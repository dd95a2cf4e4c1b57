"""Thresholds of what is learned, with a case just below and one just above each."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from mocap.filters import one_camera, rigid, roughness
from mocap.filters.anatomy import Anatomy, Limb
from mocap.filters.bodies import rod, rod_masses
from mocap.filters.bones import rigid_bones, size_factor
from mocap.filters.errors import FilterError
from mocap.filters.first_poses import looks_like
from mocap.filters.gaussian import Markers, Moments, Update, View, condition, pushed
from mocap.filters.groups import groups_of
from mocap.filters.joint_types import joints_of
from mocap.filters.misfit import Misfit
from mocap.filters.mixture import Mixture
from mocap.filters.models import articulated, lagrangian, pose
from mocap.filters.models.base import FittedMotion
from mocap.filters.models.delayed_poses import Neighbours
from mocap.filters.models.pose import FittedGroups, PoseSettings
from mocap.filters.motion.articulated import ArticulatedMotion
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.observations import Sights
from mocap.filters.observe import observe
from mocap.filters.poses import MATERN_3_2_HALF, MATERN_HALF, MarkerTrial, known_shapes
from mocap.filters.rigid import wobble_deg
from mocap.filters.score import Residuals
from mocap.filters.trajectory import Quadratic, most_probable
from mocap.filters.tree import Tree
from mocap.filters.whittaker import fastest_hz
from scipy.spatial.transform import Rotation
from scipy.special import fdtri

from eal import fit_potential
from mocap.cameras.camera import project, stacked
from tests.mocap.rigs import ring


@pytest.mark.parametrize(("larger", "counts"), [(1.016, False), (1.024, True)])
def test_animals_that_differ_by_two_percent_are_of_two_sizes(larger, counts):
    """Ten stiff markers, without noise: their size is known to 0.02 / sqrt(45 pairs)."""
    xyz = np.tile(np.random.default_rng(0).normal(size=(10, 3)), (50, 1, 1))
    small, large = (
        MarkerTrial(name="a", t_s=np.arange(50) / 100, xyz_m=size * xyz, sd_m=np.full((50, 10), 1e-4))
        for size in (1.0, larger)
    )
    assert size_factor(small, large) == pytest.approx(larger if counts else 1.0)


def test_poses_are_learned_from_where_four_fifths_are_known():
    """Of more than thirty."""
    known = np.append(np.full(40, 0.95), [0.75, 0.85])
    (learned,) = known_shapes(SimpleNamespace(certainty=[known]))
    assert learned.tolist() == [True] * 40 + [False, True]


@pytest.mark.parametrize(("seen", "found"), [(3, False), (4, True)])
def test_a_pose_is_looked_for_where_four_markers_are_seen(seen, found):
    """Three rays leave up to four poses."""
    matrices, place = stacked(ring(1)), np.random.default_rng(1).normal(0, 0.1, (6, 3))
    shown = np.arange(6)[None, None] < seen
    views = SimpleNamespace(seen=shown, matrices=matrices, uv_px=project(matrices, place[None]))
    prior = SimpleNamespace(shapes=np.zeros((1, 1)), mean=place.ravel(), basis=np.zeros((18, 1)))
    assert (looks_like(prior, views, 0, 0) is not None) == found


@pytest.mark.parametrize(
    ("turned_rad", "step_rad"), [(0.08, None), (0.12, 0.12), (0.45, 0.45), (0.55, 0.5), (2.0, 0.5)]
)
def test_an_update_is_iterated_where_joints_bend(turned_rad, step_rad):
    """From a tenth of a radian, in steps of half a radian at most."""

    class Bent(ArticulatedMotion):
        """A body whose turn is known, and two joints."""

        parts = (slice(0), slice(0, 6))

        def angles(self, states):
            return states[:, 6:]

    prior = Moments(np.zeros(8), np.zeros((8, 8)))
    found = np.append(np.zeros(6), [turned_rad, -turned_rad / 2])
    further = object.__new__(Bent).further(prior, np.zeros(8), found)
    if step_rad is None:
        assert further is None
    else:
        np.testing.assert_allclose(further[6:], [step_rad, -step_rad / 2])


@pytest.mark.parametrize(("moves_sd", "ends"), [(0.045, True), (0.055, False)])
def test_a_search_ends_where_nothing_moves_by_a_twentieth_of_a_deviation(moves_sd, ends):
    """Of a cost that does not change, whose slope moves a state of unit deviation by so much in every step."""
    problem = SimpleNamespace(
        cost=lambda _at: 0.0,
        quadratic=lambda _at: Quadratic(gradient=np.array([[moves_sd]]), band=(np.ones((1, 1, 1)),)),
        moved=lambda at, step: at + step,
    )
    if ends:
        most_probable(problem, np.zeros((1, 1)))
    else:
        with pytest.raises(FilterError, match="not found in 100 steps"):
            most_probable(problem, np.zeros((1, 1)))


@dataclass(frozen=True)
class Part:
    """What stands for rays, and for what is recorded."""

    sd_px: np.ndarray | None = None
    prior: object = None
    views: object = None

    def frames(self, _some):
        """Of some frames."""
        return self


@pytest.mark.parametrize(("moves_sd", "most"), [(0.9, 0.99), (1.1, np.inf)])
def test_trials_left_out_are_tracked_to_one_deviation_and_alarm_in_one_of_a_hundred_frames(monkeypatch, moves_sd, most):
    """Two trials whose misfit grows from 0 to 1 over their frames; steps of a search move by so much, without end."""
    frames, one = 1000, np.ones(3)

    def held(_recorded, _pixels, at, *, within):
        if moves_sd > within:
            raise FilterError("no end")
        return None, at, ()

    posed = SimpleNamespace(
        y=np.zeros((frames, 3)),
        frames=SimpleNamespace(position_m=np.zeros((frames, 3)), rotation=np.tile(np.eye(3), (frames, 1, 1))),
    )
    prior = SimpleNamespace(mean=np.zeros(3), basis=one[:, None], left_sd=one, turn_s=0.3, dt_s=0.01, lasts=10.0)
    monkeypatch.setattr(one_camera, "poses_of", lambda trials, _trunk: [posed] * len(trials))
    monkeypatch.setattr(one_camera, "learn_prior", lambda *_, **__: prior)
    monkeypatch.setattr(one_camera, "_from_afar", lambda *_: Part(sd_px=one))
    monkeypatch.setattr(one_camera, "Recorded", Part)
    monkeypatch.setattr(one_camera, "settled", lambda _recorded, at: (at, None))
    monkeypatch.setattr(one_camera, "between", lambda start, *_: start)
    monkeypatch.setattr(one_camera, "held_by_bones", held)
    monkeypatch.setattr(one_camera, "marked", lambda *_, **__: (np.zeros((frames, 1, 3)), [None]))
    monkeypatch.setattr(one_camera, "strange", lambda *_: np.linspace(0, 1, frames))
    monkeypatch.setattr(one_camera, "_squared", lambda *_: np.ones(frames))
    trials = [trial_of(np.zeros((frames, 1, 3))) for _ in range(2)]
    found = one_camera.left_out(prior, 1e-3, Misfit(), np.eye(3), trials=trials, trunk=(0,))
    assert found.most == pytest.approx(most)


def trial_of(xyz_m, sd_m=1e-6):
    """Markers at 100 Hz, which are known to a micrometre."""
    return MarkerTrial(name="one", t_s=np.arange(len(xyz_m)) / 100, xyz_m=xyz_m, sd_m=np.full(xyz_m.shape[:2], sd_m))


@pytest.mark.parametrize(("varies", "rigid"), [(0.042, True), (0.058, False)])
def test_a_rigid_bone_keeps_its_length_to_five_percent(varies, rigid):
    """Two markers whose distance is longer and shorter in turn, over 2000 frames."""
    xyz = np.zeros((2000, 2, 3))
    xyz[:, 1, 0] = 1 + varies * (-1.0) ** np.arange(2000)
    assert len(rigid_bones([trial_of(xyz)]).ends) == rigid


def joint(bend_rad):
    """The two joints of a limb: of its first bone, which bends evenly so far, and of a second that does not turn."""
    angle = bend_rad * np.linspace(-0.5, 0.5, 201)
    first = np.stack([np.cos(angle), np.sin(angle), np.zeros(201)], axis=1)
    xyz = np.stack([np.zeros((201, 3)), first, first + np.eye(3)[0]], axis=1)
    return joints_of(["s", "e", "w"], xyz, np.full((201, 3), 1e-9), [Limb(children=(1, 2), parents=(0, 1))])


@pytest.mark.parametrize(("range_deg", "kind"), [(8.7, "fixed"), (11.5, "hinge")])
def test_a_joint_moves_by_ten_degrees(range_deg, kind):
    """From the 5th to the 95th percentile, nine tenths of an even motion."""
    assert joint(np.radians(range_deg) / 0.9)[0].kind == kind


@pytest.mark.parametrize(("bend_deg", "straight"), [(12.9, 1.0), (17.1, 0.0)])
def test_segments_are_straight_within_fifteen_degrees(bend_deg, straight):
    """A second bone that bends by so much in every frame."""
    bent = Rotation.from_euler("z", bend_deg, degrees=True).apply([1.0, 0, 0])
    xyz = np.tile(np.stack([0 * bent, [1.0, 0, 0], bent + np.eye(3)[0]]), (50, 1, 1))
    found = joints_of(["s", "e", "w"], xyz, np.full((50, 3), 1e-9), [Limb(children=(1, 2), parents=(0, 1))])
    assert found[0].straight == straight


@pytest.mark.parametrize(("frames", "known"), [(18, False), (22, True)])
def test_ten_frames_count_as_one(frames, known):
    """Two independent ones have a variance."""
    body = np.tile(np.random.default_rng(0).normal(size=(4, 3)), (frames, 1, 1))
    assert np.isfinite(wobble_deg(body)) == known


def test_matern_processes_lose_half_of_their_correlation():
    """Closed forms at the lags that are written with five digits."""
    s = MATERN_3_2_HALF
    assert (1 + s) * np.exp(-s) == pytest.approx(0.5, abs=1e-4)
    s = MATERN_HALF
    assert (1 + s + s**2 / 3) * np.exp(-s) == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(("frame", "counts"), [(290, False), (310, True), (690, True), (710, False)])
def test_rates_are_those_of_four_hundred_frames_in_the_middle(frame, counts):
    """Of a thousand that show nothing but one jump."""
    residual = np.full((1000, 3), np.nan)
    residual[frame : frame + 2] = [[0.0], [5.0]]
    usual, sd = np.full(residual.shape, 0.1), np.ones(3)
    found = roughness.marker_rates(residual, usual, 0.01, sd, 10.0)
    assert (found[0] > 10.0 * roughness.RATES[0]) == counts


def test_the_process_noise_is_judged_in_a_hundred_frames(monkeypatch):
    """In those of 150 that show most."""
    xyz = np.zeros((150, 1, 3))
    xyz[:35], xyz[140:] = np.nan, np.nan
    taken = []
    monkeypatch.setattr(pose, "with_noise", lambda part, _factor: part)
    monkeypatch.setattr(pose, "filter_forward", lambda *_, frames: taken.append(frames) or [])
    monkeypatch.setattr(pose, "replace", lambda model, **_: model)
    pose.likely_noise(None, SimpleNamespace(trials=[trial_of(xyz)]))
    assert {len(frames) for frames in taken} == {100}


@pytest.mark.parametrize(("frames", "others"), [(3900, 2), (4100, 1)])
def test_joints_are_learned_from_four_thousand_frames_of_others(frames, others):
    """A second recording, where the first has fewer."""
    trials = [SimpleNamespace(t_s=np.zeros(n)) for n in (frames, 10, 10)]
    assert len(articulated._taught_by(trials)) == others + 1


def test_a_trunk_stays_near_the_body_by_a_hundredth_and_three_hundredths_of_a_radian(monkeypatch):
    """Four markers on the ends of a cross of unit arms, known to 0.01: of the prior variance 1 / (1 + 4) and so on."""
    cross = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    tree = Tree(  # of a joint that carries nothing
        parent=np.array([0]),
        joint_m=np.zeros((1, 3)),
        axes=np.eye(3)[:1],
        joint=np.array([0]),
        segment=np.zeros(4, int),
        place_m=cross,
    )
    monkeypatch.setattr(articulated, "tree_of", lambda *_: tree)
    build, noise = SimpleNamespace(root=range(4), child=[]), [np.full((1, 4), 0.01)]
    _, _, (found,) = articulated._with_riders(build, cross, [cross[None]], noise, 0.0, chain=False)
    left = [1 / (1 + 4), 1 / (1 + 4), 1 / (1 + 4), 1 / (1 + 18), 1 / (1 + 18), 1 / (1 + 36)]
    np.testing.assert_allclose(1 - found.certainty[0, :6], left, rtol=1e-6)


@pytest.mark.parametrize(("markers", "groups"), [(30, 1), (31, 2)])
def test_groups_have_about_thirty_markers(markers, groups):
    """One more makes two groups."""
    model = SimpleNamespace(subspace=SimpleNamespace(mean=np.zeros(3 * markers)), potentials=(), bones=None)
    assert len(groups_of(model)) == groups


@pytest.mark.parametrize(("markers", "kind"), [(45, FittedMotion), (46, FittedGroups)])
def test_forty_five_markers_are_filtered_together(monkeypatch, markers, kind):
    """More in groups."""
    model = object.__new__(PoseMotion)
    object.__setattr__(model, "subspace", SimpleNamespace(mean=np.zeros(3 * markers)))
    monkeypatch.setattr(PoseSettings, "_learned", lambda *_: model)
    monkeypatch.setattr(PoseSettings, "regressed", lambda *_: None)
    monkeypatch.setattr("mocap.filters.models.pose.with_noise", lambda model, _noise: model)
    monkeypatch.setattr("mocap.filters.models.pose.replace", lambda model, **_: model)
    trials = SimpleNamespace(trials=[SimpleNamespace(t_s=np.zeros(1))], rigid=None)
    assert type(PoseSettings(process_noise=1.0).fit(trials)) is kind


@pytest.mark.parametrize(("learned", "counts"), [(30.0, 30.0), (np.inf, 36.0)])
def test_what_was_learned_of_intervals_counts_as_twelve_gaps(learned, counts):
    """Beside five gaps in the recording whose errors are all as stated: three degrees of freedom each."""
    one = np.ones((5, 3))
    shown = Residuals(error_m=one, variance=one, noise=np.zeros(5), gap=np.arange(5), length=np.full(5, 20))
    mixed = Mixture(
        offset=np.zeros(1), slope=np.zeros(1), length=np.array([20.0]), scale=np.ones((1, 1)), widen=1.0, dof=learned
    )
    found = mixed.calibrated([shown])
    assert found.widen == pytest.approx(1.0)
    assert found.dof == pytest.approx(counts + 15)


def test_frames_of_a_line_are_held_by_three_hundredths_of_its_extent():
    """Closed form: of a line that turns by a they turn by the angle of cos a + 2 k / 3 and sin a, with k = 0.03."""
    line = np.linspace(-1, 1, 4)[:, None] * [1.0, 0, 0]
    near = Neighbours(np.ones(4, dtype=bool), np.full(4, 0.25), line)
    turned = Rotation.from_euler("z", 1.5).apply(line)
    found = Rotation.from_matrix(np.array(near.frames(turned[None]).rotation[0])).as_rotvec()
    np.testing.assert_allclose(found, [0, 0, np.arctan2(np.sin(1.5), np.cos(1.5) + 0.02)], atol=1e-12)


def test_rods_are_a_tenth_of_their_length_thick_and_weigh_a_kilogram_where_none_is_stated():
    """A cylinder of 2 m and 1 kg: m r^2 / 2 about its axis, with r = 0.2 m."""
    assert rod(1.0, np.array([0.0, 0, 2]))[1][2, 2] == pytest.approx(0.02)
    assert rod_masses([(0, 1), (1, 2)], np.array([0.3, 0.2]), [])[0].sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("rate_hz", "cutoff_hz"), [(140.0, 28.0), (160.0, 30.0), (1000.0, 30.0)])
def test_faster_motion_than_thirty_hertz_is_noise(rate_hz, cutoff_hz):
    """Or than a fifth of the frame rate."""
    assert fastest_hz(1 / rate_hz) == pytest.approx(cutoff_hz)


def test_three_tenths_of_the_inertia_turn_with_each_joint():
    """Of the greatest that one of its coordinates feels: a universal joint at the end of three markers of a trunk."""
    tree = Tree(
        parent=np.array([0]),
        joint_m=np.array([[1.0, 0, 0]]),
        axes=np.array([[0.0, 1, 0], [0, 0, 1]]),
        joint=np.array([0, 0]),
        segment=np.array([0, 0, 0, 1]),
        place_m=np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0.5, 0, 0]]),
    )
    model = SimpleNamespace(
        tree=tree,
        ends=np.array([[0, 3]]),
        length_m=np.array([0.5]),
        arm_m=np.ones(2),
        subspace=SimpleNamespace(mean=np.zeros(2)),
    )
    bodies = lagrangian.bodies_of(model, Anatomy(trunk=(0, 1, 2)), 1.0)
    felt = np.diag(lagrangian.inner_mass(replace(bodies, armature_kg_m2=0.0), np.zeros(2)))
    assert felt[0] != pytest.approx(felt[1])
    np.testing.assert_allclose(bodies.armature_kg_m2, 0.3 * felt.max())


def test_an_unseen_pose_is_charged_a_tenth_of_the_kinetic_energy(monkeypatch):
    """Of 3 J, where V_z of unseen poses is a half."""
    monkeypatch.setattr(lagrangian, "_unseen", lambda *_: np.full(10, np.log(2)))
    limb = SimpleNamespace(potential=fit_potential([[0.0], [1.0]]), on_residual=np.eye(1), samples=None)
    model = SimpleNamespace(potentials=(limb,), arm_m=np.ones(1))
    assert lagrangian._valleys(model, 3.0, SimpleNamespace(potential="limbs"))[1] == pytest.approx(0.6)


@pytest.mark.parametrize(("factor", "subtracts"), [(0.9e4, True), (1.1e4, False)])
def test_covariances_are_subtracted_where_a_variance_falls_by_up_to_ten_thousand(factor, subtracts):
    """One row of unit noise; both ways give 1 / (1 / P + 1), here to the digits that a subtraction leaves."""
    state, rows = Moments(np.zeros(2), np.diag([factor, 1.0])), np.array([[1.0, 0.0]])
    after, update = condition(state, rows, rows @ state.cov, np.array([2.0]))
    assert (update.left is None) == subtracts
    assert after.cov[0, 0] == pytest.approx(factor / (1 + factor), rel=1e-11)


@pytest.mark.parametrize(("off_sd", "believed"), [(5.9, True), (6.1, False)])
@pytest.mark.parametrize("vague_m", [0.0, 3.0])
def test_a_row_is_believed_to_six_deviations(off_sd, believed, vague_m):
    """One ray of unit noise in each pixel coordinate, of a marker that is known so well; of both variances together."""
    seen = Sights(
        where=np.array([[0, 0]]),
        size=np.array([2]),
        innovation=np.array([[off_sd * np.hypot(1.0, vague_m), 0, 0]]),
        slope=np.diag([1.0, 1.0, 0.0])[None],
        sd=np.ones((1, 3)),
        dof=np.array([np.inf]),
        apart=np.array([False]),
    )
    state = Moments(np.zeros(3), (vague_m**2 + 1e-12) * np.eye(3))
    _, update, what = observe(Markers(state, View(np.zeros((1, 3)), np.eye(3))), seen)
    assert (update is not None) == believed
    assert what.weight.tolist() == [float(believed)]


@pytest.mark.parametrize("gaps", [2, 6])
def test_scales_of_models_are_drawn_to_what_they_were_by_two_gaps(gaps):
    """Of two models whose errors are e times and 1/e times those stated: by n / (n + 2) of the logarithm."""
    one = np.ones((gaps, 3))
    shown = [
        Residuals(
            error_m=factor * one, variance=one, noise=np.zeros(gaps), gap=np.arange(gaps), length=np.full(gaps, 20)
        )
        for factor in (np.e, 1 / np.e)
    ]
    mixed = Mixture(
        offset=np.zeros(2), slope=np.zeros(2), length=np.array([20.0]), scale=np.ones((1, 2)), widen=1.0, dof=30.0
    )
    part = gaps / (gaps + 2)
    np.testing.assert_allclose(mixed.calibrated(shown).scale, [[np.exp(part), np.exp(-part)]], rtol=1e-5)


@pytest.mark.parametrize(("level", "bodies"), [(0.9985, []), (0.9994, [[0, 1, 2]])])
def test_a_body_stands_out_at_one_of_a_thousand(monkeypatch, level, bodies):
    """Three markers whose distances vary less than those to a fourth, by F of twenty independent samples each."""
    spread = np.ones((4, 4))
    spread[3], spread[:, 3] = 2 * [np.sqrt(fdtri(20, 20, level))]
    monkeypatch.setattr(rigid, "distance_spread", lambda _trial: (spread, np.full((4, 4), 20.0)))
    monkeypatch.setattr(rigid, "wobble_deg", lambda _xyz: 0.0)
    assert rigid.find_bodies(trial_of(np.zeros((5, 4, 3)))) == bodies


@pytest.mark.parametrize(("factor", "at_once"), [(6.0e7, True), (7.5e7, False)])
def test_an_observation_is_taken_at_once_where_half_of_the_digits_are_left(factor, at_once):
    """Variances fall by 6.7e7 at once, the root of 1 / eps; two parts of the information are the same posterior."""
    state, rows = Moments(np.zeros(1), np.array([[factor]])), np.array([[1.0]])
    after, update = condition(state, rows, rows @ state.cov, np.array([2.0]))
    assert (update.first is None) == at_once
    assert after.cov[0, 0] == pytest.approx(1.0, rel=1e-6)
    assert after.mean[0] == pytest.approx(2.0, rel=1e-6)
    assert update.log_det == pytest.approx(np.log1p(factor) if at_once else update.log_det)


@pytest.mark.parametrize(("force", "moves_sd"), [(2.0, 2.0), (4.0, 3.0)])
def test_forces_move_a_state_no_further_than_they_were_linearised_for(force, moves_sd):
    """By P b, of a state of unit deviation; at most by three deviations."""
    none = Update(np.zeros((0, 1)), np.zeros((0, 1)), np.zeros(0), 0.0)
    moved, update = pushed(Moments(np.zeros(1), np.eye(1)), none, np.array([force]), 3.0)
    assert moved.mean[0] == pytest.approx(moves_sd)
    assert update.force == pytest.approx([moves_sd])


def test_no_length_is_known_better_than_to_half_a_percent():
    """Two markers that never move, over 2000 frames: the rest is the standard error of 200 independent ones."""
    xyz = np.zeros((2000, 2, 3))
    xyz[:, 1, 0] = 2.0
    found = rigid_bones([trial_of(xyz)])
    assert found.sd_m[0] == pytest.approx(0.01 * np.sqrt(1 + 1 / 200), rel=1e-3)
