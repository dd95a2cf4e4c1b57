"""Quantities against closed forms, and their standard deviations against Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.velocities import Motion, with_means
from scipy.signal import hilbert
from scipy.spatial.transform import Rotation

from mocap.errors import MocapError
from mocap.kinematics import angles
from mocap.kinematics.compute import kinematics
from mocap.kinematics.delta import Naming, Points, with_rates
from mocap.kinematics.points import rate_points_for
from mocap.kinematics.records import Rests
from mocap.kinematics.stroke import analytic, stroke_plane
from mocap.measures import JointAxes, Measures, Segment
from mocap.skeleton import Joint, Skeleton

NAMES = ("hip", "knee", "ankle", "tip")


def limb(*, n_frames=9, dt_s=0.01, seed=0, noise=1e-3, measures=None):
    """Four markers on smooth paths with known velocities, and a random joint covariance."""
    rng = np.random.default_rng(seed)
    t = dt_s * np.arange(n_frames)
    place = np.array([[0, 0, 0], [0.1, 0.02, 0], [0.15, -0.06, 0.05], [0.22, -0.05, 0.09]])
    swing, phase = rng.normal(0, 0.02, (2, 4, 3))
    x = place + swing * np.sin(9 * t[:, None, None] + phase)
    v = 9 * swing * np.cos(9 * t[:, None, None] + phase)
    root = noise * rng.normal(size=(24, 24)) * np.tile([1, 1, 1, 20, 20, 20], 4)[:, None]
    cov = (root @ root.T).reshape(4, 6, 4, 6)
    pairs = [(a, b) for a in range(4) for b in range(a + 1, 4)]
    motion = Motion(
        names=NAMES,
        t_s=t,
        xyz_m=x,
        velocity_m_s=v,
        own=np.tile([cov[a, :, a] for a in range(4)], (n_frames, 1, 1, 1)),
        pairs=np.array(pairs),
        cross=np.tile([cov[a, :, b] for a, b in pairs], (n_frames, 1, 1, 1)),
        kept=np.full((n_frames, 4, 3), 0.5),
        measured=np.ones((n_frames, 4), dtype=bool),
    )
    joints = (Joint(name="knee", parent="hip", centre="knee", child="ankle"),)
    skeleton = Skeleton(name="limb", markers=NAMES, joints=joints, measures=measures or Measures())
    return motion, skeleton, root


@pytest.mark.parametrize(
    ("function", "names"),
    [
        (angles.flexion, NAMES[:3]),
        (angles.distance, ("hip", "tip")),
        (angles.area, NAMES),
        (angles.yaw(np.array([0, 0, 1.0])), ("hip", "ankle")),
        (angles.pitch(np.array([0, 0, 1.0])), ("knee", "tip")),
        (angles.roll(np.array([0, 0, 1.0])), NAMES),
    ],
)
def test_values_and_rates_spread_as_samples_of_the_joint_covariance_do(function, names):
    """The delta method against 20,000 draws of positions and velocities: deviations agree to their own error, 3 %."""
    motion, _, root = limb(n_frames=3, noise=2e-4)
    points = Points.of(motion, names)
    value, rate, _ = with_rates(points, function, Naming(name="q", unit="m", what="a quantity", kind="length"))
    rng = np.random.default_rng(1)
    drawn = (root @ rng.normal(size=(24, 20_000))).T.reshape(-1, 4, 6)[:, [NAMES.index(n) for n in names]]
    x, v = points.x[1] + drawn[..., :3], points.v[1] + drawn[..., 3:]
    values = function(x)
    rates = (function(x + 1e-5 * v) - function(x - 1e-5 * v)) / 2e-5
    assert values.std() == pytest.approx(value.sd[1], rel=0.03)
    assert rates.std() == pytest.approx(rate.sd[1], rel=0.03)
    exact = (function(points.x + 1e-5 * points.v) - function(points.x - 1e-5 * points.v)) / 2e-5
    np.testing.assert_allclose(rate.value, exact, rtol=1e-5, atol=1e-7)


def test_accelerations_are_changes_of_velocities_with_what_neighbours_share_taken_off():
    """Of a sine: to the second order of the step; the deviation is sqrt(kept (s^2 + s^2)) / 2 dt."""
    motion, skeleton, _ = limb(dt_s=0.002)
    found = kinematics(motion, skeleton)
    exact = -81 * (motion.xyz_m - motion.xyz_m.mean(axis=0))
    value = np.stack([found[f"tip_acceleration_{axis}_m_s2"].value for axis in "xyz"], axis=1)
    centre = np.diff(motion.velocity_m_s[:, 3], axis=0)
    np.testing.assert_allclose(value[1:-1], (centre[1:] + centre[:-1]) / 0.004, rtol=1e-9)
    assert exact.shape[1] == 4
    sd = found["tip_velocity_x_m_s"].sd[0]
    assert found["tip_acceleration_x_m_s2"].sd[4] == pytest.approx(np.sqrt(0.5 * 2 * sd**2) / 0.004)
    steady = replace(motion, velocity_m_s=np.ones_like(motion.velocity_m_s))  # as beyond the last sighting of a marker
    still = kinematics(steady, skeleton)
    whole = np.linalg.norm([still[f"tip_acceleration_{axis}_m_s2"].sd[4] for axis in "xyz"])  # of a size that is 0
    assert still["tip_acceleration_m_s2"].value[4] == 0
    assert still["tip_acceleration_m_s2"].sd[4] == pytest.approx(whole)


def test_angles_of_a_limb_of_known_pose():
    """Straight: flexion 0; a right angle: 90."""
    straight = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]])
    bent = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0.0]]])
    assert np.degrees(angles.flexion(straight))[0] == pytest.approx(0)
    assert np.degrees(angles.flexion(bent))[0] == pytest.approx(90)
    square = np.array([[[0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2.0]]])
    assert angles.area(square)[0] == pytest.approx(4)


def test_three_angles_of_a_joint_are_those_of_scipy():
    """Rz Ry Rx of SciPy's intrinsic rotations, whatever the parent's own attitude."""
    rng = np.random.default_rng(3)
    given = rng.uniform([-3, -1.5, -3], [3, 1.5, 3], (50, 3))
    parent = Rotation.random(50, rng=rng)
    child = parent * Rotation.from_euler("ZYX", given)
    lines = [np.zeros((50, 3)), rotation_column(parent, 0), np.zeros((50, 3)), rotation_column(parent, 1)]
    lines += [np.zeros((50, 3)), rotation_column(child, 0), np.zeros((50, 3)), rotation_column(child, 1)]
    x = np.stack(lines, axis=1)
    found = np.stack([angles.joint_angle(i)(x) for i in range(3)], axis=1)
    np.testing.assert_allclose(found, given, atol=1e-9)


def rotation_column(rotation, k):
    return rotation.as_matrix()[:, :, k]


def test_yaw_pitch_and_roll_of_an_animal_that_is_turned():
    """Turned by yaw about up, then nose up, then its right side down (left side up): all three positive."""
    turn = Rotation.from_euler("ZYX", [0.7, -0.3, 0.4]).as_matrix()  # about y: nose down; about x: left side up
    body = np.array([[0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0.0]]) @ turn.T
    up = np.array([0, 0, 1.0])
    assert angles.yaw(up)(body[None, :2])[0] == pytest.approx(0.7)
    assert angles.pitch(up)(body[None, :2])[0] == pytest.approx(0.3)
    assert angles.roll(up)(body[None])[0] == pytest.approx(0.4)


def test_the_stroke_plane_of_a_beat_in_a_known_plane():
    """A line that beats in a plane tilted by 30 degrees about the left axis: inclination 30 degrees."""
    beat = np.radians(50) * np.sin(np.linspace(0, 20, 200))
    tilt = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    direction = np.stack([np.zeros(200), np.cos(beat), np.sin(beat)], axis=1) @ tilt.T
    plane = stroke_plane(direction)
    assert plane is not None
    assert np.degrees(plane.inclination_rad) == pytest.approx(30, abs=1e-6)
    assert plane.out @ tilt @ [0, 1, 0] == pytest.approx(1, abs=1e-3)


def test_columns_carry_units_and_say_what_they_rest_on():
    """Names as the documentation has them; a frame with a filled marker is filled; nothing is stated of none."""
    motion, skeleton, _ = limb()
    measured = motion.measured.copy()
    measured[4, 2] = False
    xyz = motion.xyz_m.copy()
    xyz[6, 0] = np.nan
    changed = replace(motion, measured=measured, xyz_m=xyz)
    asked = rate_points_for(NAMES, skeleton, n_frames=9)
    table = kinematics(with_means(changed, asked), skeleton, recording="trial")
    for name, unit in (("knee_flexion", "deg"), ("knee_flexion_rate", "deg_s"), ("body_speed", "m_s")):
        assert table[f"{name}_{unit}"].unit == unit
    assert table["knee_angle_deg"].rests.tolist() == [1, 1, 1, 1, 2, 1, 0, 1, 1]
    assert np.isnan(table["knee_angle_deg"].value[6])
    assert table["knee_flexion_acceleration_deg_s2"].rests[3] == Rests.FILLED
    frame = table.to_dataframe()
    assert {"knee_flexion_deg", "knee_flexion_deg_sd", "knee_flexion_deg_status"} <= set(frame.columns)
    assert frame["knee_angle_deg_status"].iloc[4] == "filled"
    long = table.to_dataframe(long=True)
    assert len(long) == 9 * len(table)
    np.testing.assert_array_equal(long[long.quantity == "body_speed_m_s"]["value"], frame["body_speed_m_s"])
    with pytest.raises(MocapError, match="no quantity 'knee_flexion'"):
        table["knee_flexion"]


def test_the_centre_of_mass_of_two_segments():
    """Weights by masses and by where the centres of the segments lie; its covariance is that of the weighted sum."""
    parts = {
        "thigh": Segment(start="hip", end="knee", mass_g=3.0, centre=0.4),
        "shank": Segment(start="knee", end="ankle", mass_g=1.0, centre=0.5),
    }
    motion, skeleton, root = limb(measures=Measures(segments=parts))
    found = kinematics(with_means(motion, rate_points_for(NAMES, skeleton, n_frames=9)), skeleton)
    weights = np.array([0.45, 0.425, 0.125, 0.0])
    np.testing.assert_allclose(found["centre_of_mass_x_m"].value, motion.xyz_m[:, :, 0] @ weights)
    picked = np.zeros((4, 6))
    picked[:, 0] = weights
    assert found["centre_of_mass_x_m"].sd[2] == pytest.approx(np.linalg.norm(picked.ravel() @ root), rel=1e-5)


def test_axes_that_a_skeleton_states_give_three_angles():
    """With axes a joint has flexion, abduction and rotation, without its one angle only."""
    axes = {"knee": JointAxes(parent=(("hip", "knee"), ("hip", "tip")), child=(("knee", "ankle"), ("knee", "tip")))}
    motion, skeleton, _ = limb(measures=Measures(axes=axes))
    found = kinematics(with_means(motion, rate_points_for(NAMES, skeleton, n_frames=9)), skeleton)
    assert {f"knee_{name}_deg" for name in ("angle", "flexion", "abduction", "rotation")} <= set(found)
    assert all(np.isfinite(found[f"knee_{name}_deg"].sd).all() for name in ("flexion", "abduction", "rotation"))


def test_a_course_that_crosses_south_turns_as_it_does_elsewhere():
    """A body on a circle turns at one rate, also where its course goes from 180 to -180 degrees."""
    motion, skeleton, _ = limb(n_frames=80)
    omega, t = 12.0, motion.t_s
    circle = np.stack([np.cos(omega * t), np.sin(omega * t), 0 * t], axis=1)
    along = omega * np.stack([-np.sin(omega * t), np.cos(omega * t), 0 * t], axis=1)
    still = motion.xyz_m[:1]
    turning = replace(motion, xyz_m=still + circle[:, None], velocity_m_s=np.repeat(along[:, None], 4, axis=1))
    found = kinematics(with_means(turning, rate_points_for(NAMES, skeleton, n_frames=80)), skeleton)
    heading = found["body_heading_deg"].value
    assert heading.min() < -170
    assert heading.max() > 170
    np.testing.assert_allclose(found["body_turning_rate_deg_s"].value[1:-1], np.degrees(omega), rtol=1e-3)


@pytest.mark.parametrize("n", [1, 2, 7, 100, 101])
def test_analytic_signals_are_scipys(n):
    """Of one series and of several, of odd and even length."""
    series = np.random.default_rng(n).normal(size=(n, 3))
    np.testing.assert_allclose(analytic(series), hilbert(series, axis=0), atol=1e-13)
    np.testing.assert_allclose(analytic(series[:, 0]), hilbert(series[:, 0]), atol=1e-13)


def test_covariances_are_symmetric_however_a_smoother_rounded():
    """A matrix that is symmetric to 1e-5 of its correlations alone becomes symmetric; others stay as they are."""
    from mocap.schema import not_covariances

    rng = np.random.default_rng(0)
    half = rng.normal(size=(4, 2, 6, 6))
    good = (half @ np.swapaxes(half, -1, -2)).astype(np.float32)
    skew = good.copy()
    skew[..., 0, 1] *= 1 + 1e-5

    def motion(own):
        zero = np.zeros((4, 2, 3))
        return Motion(
            names=("a", "b"), t_s=np.arange(4.0), xyz_m=zero, velocity_m_s=zero, own=own,
            pairs=np.zeros((0, 2)), cross=np.zeros((4, 0, 6, 6)), kept=zero, measured=np.ones((4, 2), dtype=bool),
        )  # fmt: skip

    assert not_covariances(skew).any()
    assert not not_covariances(motion(skew).own).any()
    np.testing.assert_array_equal(motion(good).own, good)
