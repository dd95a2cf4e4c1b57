"""Joint forces and moments against closed forms of pendulums, and refused where forces are unknown."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from mocap.datasets.bat_skeleton import bat_skeleton
from mocap.datasets.lizards import lizard_skeleton
from mocap.datasets.pendulums import make_pendulum, pendulum_skeleton
from mocap.filters.velocities import Motion

from eal.systems import GRAVITY_M_S2
from mocap.kinematics.cycles import Footfalls
from mocap.kinematics.moments import moments
from mocap.kinematics.points import Distal, distal_parts
from mocap.kinematics.records import Rests
from mocap.measures import Measures, Segment
from mocap.results.tables import write_kinematics
from mocap.skeleton import Bone, Joint, Skeleton

DT_S = 1e-3


def moving(names, x, v, *, sd_m=0.0, sd_m_s=0.0, kept=1.0):
    """A motion of independent markers with the same deviations."""
    cov = np.diag(np.repeat([sd_m**2, sd_m_s**2], 3))
    return Motion(
        names=tuple(names),
        t_s=DT_S * np.arange(len(x)),
        xyz_m=x,
        velocity_m_s=v,
        own=np.broadcast_to(cov.astype(np.float32), (*x.shape[:2], 6, 6)),
        pairs=np.empty((0, 2), dtype=np.int64),
        cross=np.empty((len(x), 0, 6, 6), dtype=np.float32),
        kept=np.full(x.shape, kept),
        measured=np.ones(x.shape[:2], dtype=bool),
    )


def arm(lengths, segments, *, measures=None):
    """A chain of markers a, b, c, ... that hangs on b; a is above b."""
    names = tuple("abcd"[: len(lengths) + 2])
    joints = [
        Joint(name=names[i + 1], parent=names[i], centre=names[i + 1], child=names[i + 2]) for i in range(len(lengths))
    ]
    return Skeleton(
        name="arm",
        markers=names,
        bones=tuple(Bone(a=p, b=q) for p, q in pairwise(names)),
        joints=tuple(joints),
        trunk=names[:2],
        measures=measures or Measures(segments=segments),
    )


def chain(angle_rad, rate_rad_s, lengths):
    """Positions and velocities of a chain in the plane x z, angles (T, J) from straight down."""
    steps = np.stack([np.sin(angle_rad), 0 * angle_rad, -np.cos(angle_rad)], axis=-1) * np.array(lengths)[:, None]
    ahead = np.stack([np.cos(angle_rad), 0 * angle_rad, np.sin(angle_rad)], axis=-1) * np.array(lengths)[:, None]
    fixed = np.broadcast_to([[0, 0, 0.2], [0, 0, 0.0]], (len(angle_rad), 2, 3))
    x = np.concatenate([fixed, np.cumsum(steps, axis=1)], axis=1)
    v = np.concatenate([0 * fixed, np.cumsum(ahead * rate_rad_s[..., None], axis=1)], axis=1)
    return x, v


def test_a_driven_rod_needs_the_moment_of_its_equation_of_motion():
    """M = (m l^2 / 3) theta'' + m g (l / 2) sin theta about the axis of the swing.

    Central differences are off by (w dt)^2 / 6 = 1.2e-4 for w = 27, the third harmonic in positions of the tip.
    """
    t, length, mass = DT_S * np.arange(400), 0.3, 0.02
    theta, rate, second = 0.8 * np.sin(9 * t), 7.2 * np.cos(9 * t), -64.8 * np.sin(9 * t)
    x, v = chain(theta[:, None], rate[:, None], [length])
    skeleton = arm([length], {"rod": Segment(start="b", end="c", mass_g=1000 * mass)})
    found = moments(moving("abc", x, v), skeleton)
    expected = mass * length**2 / 3 * second + mass * GRAVITY_M_S2 * length / 2 * np.sin(theta)
    inner = slice(2, -2)
    np.testing.assert_allclose(found["b_moment_y_n_m"].value[inner], -expected[inner], atol=2e-4 * expected.max())
    np.testing.assert_allclose(found["b_moment_x_n_m"].value[inner], 0, atol=1e-12)
    flexing = np.sign(theta) * expected  # a is above: swinging out to either side bends the angle
    away = np.abs(theta) > 0.05
    np.testing.assert_allclose(
        found["b_flexion_moment_n_m"].value[inner][away[inner]], flexing[inner][away[inner]], atol=2e-4 * expected.max()
    )


def test_two_links_have_the_moments_of_the_textbook():
    """Two point masses: the equations of the double pendulum (Spong et al. 2006, section 7.4), both joints driven."""
    t, (one, two), (m1, m2) = DT_S * np.arange(300), (0.3, 0.2), (0.05, 0.03)
    angle = np.stack([0.5 * np.sin(8 * t), 0.9 * np.sin(13 * t + 1)], axis=1)
    rate = np.stack([4 * np.cos(8 * t), 11.7 * np.cos(13 * t + 1)], axis=1)
    second = np.stack([-32 * np.sin(8 * t), -152.1 * np.sin(13 * t + 1)], axis=1)
    x, v = chain(angle, rate, [one, two])
    parts = {k: Segment(start=k, end=k, mass_g=1000 * m) for k, m in (("c", m1), ("d", m2))}
    found = moments(moving("abcd", x, v), arm([one, two], parts))
    apart, g = angle[:, 0] - angle[:, 1], GRAVITY_M_S2
    outer = m2 * (
        two**2 * second[:, 1]
        + one * two * (second[:, 0] * np.cos(apart) - rate[:, 0] ** 2 * np.sin(apart))
        + g * two * np.sin(angle[:, 1])
    )
    inner = (
        (m1 + m2) * (one**2 * second[:, 0] + g * one * np.sin(angle[:, 0]))
        + m2 * one * two * (second[:, 1] * np.cos(apart) + rate[:, 1] ** 2 * np.sin(apart))
        + outer
    )
    for joint, expected in (("b", inner), ("c", outer)):
        got = found[f"{joint}_moment_y_n_m"].value[2:-2]
        np.testing.assert_allclose(got, -expected[2:-2], atol=2e-4 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["planar", "spherical"])
def test_a_free_pendulum_needs_no_moment_and_the_force_of_its_rod(kind):
    """The pivot is free: its moment is 0, and the force on the mass is the Lagrange multiplier along the rod.

    Central differences are off by dt^2 / 6 times the fourth derivative, at most 3 theta''^2 + ... = 2000 m/s^4.
    """
    truth = make_pendulum(kind, n_samples=1001, duration_s=1.0)
    q, rate = truth.q, truth.v
    if kind == "planar":
        r, angle = q[:, 0], q[:, 1]
        bob = np.stack([r * np.cos(angle), 0 * r, r * np.sin(angle)], axis=1)
        speed = rate[:, 1:] * np.stack([-r * np.sin(angle), 0 * r, r * np.cos(angle)], axis=1)
    else:
        bob, speed = q, rate
    skeleton = pendulum_skeleton()
    still = np.tile([[0, 0, 0.4], [0.35, 0, 0.15], [0, 0.35, 0.15], [0, 0, 0.0]], (len(bob), 1, 1))
    x = np.concatenate([still, bob[:, None]], axis=1)
    v = np.concatenate([0 * still, speed[:, None]], axis=1)
    found = moments(moving(skeleton.markers, x, v), skeleton)
    force = np.stack([found[f"pivot_force_{axis}_n"].value for axis in "xyz"], axis=1)
    np.testing.assert_allclose(force[2:-2], truth.multiplier[2:-2, None] * bob[2:-2], atol=5e-4)
    for axis in "xyz":
        np.testing.assert_allclose(found[f"pivot_moment_{axis}_n_m"].value[2:-2], 0, atol=5e-4)


@pytest.mark.rare
def test_deviations_are_those_of_samples():
    """Positions and velocities drawn anew 200 times: their spread is the stated one (standard error 5 %)."""
    rng, t = np.random.default_rng(0), DT_S * np.arange(5)
    angle = np.stack([0.5 + 8 * t, -0.3 + 11 * t], axis=1)
    x, v = chain(angle, np.tile([8.0, 11.0], (5, 1)), [0.3, 0.2])
    parts = {"u": Segment(start="b", end="c", mass_g=20, centre=0.4), "f": Segment(start="c", end="d", mass_g=10)}
    skeleton, sd = arm([0.3, 0.2], parts), {"sd_m": 1e-3, "sd_m_s": 1e-3}
    stated = moments(moving("abcd", x, v, **sd), skeleton)
    drawn = [
        moments(moving("abcd", x + 1e-3 * rng.normal(size=x.shape), v + 1e-3 * rng.normal(size=v.shape)), skeleton)
        for _ in range(200)
    ]
    for name in ("b_moment_y_n_m", "c_flexion_moment_n_m", "b_force_z_n"):
        spread = np.std([one[name].value[2] for one in drawn])
        assert stated[name].sd[2] == pytest.approx(spread, rel=0.15)


def test_there_is_no_moment_while_a_foot_stands():
    """The ground pushes with a force that nobody measured: values are missing then, and in the frames beside."""
    t = DT_S * np.arange(40)
    x, v = chain(np.sin(5 * t)[:, None], 5 * np.cos(5 * t)[:, None], [0.3])
    measures = Measures(segments={"rod": Segment(start="b", end="c", mass_g=10)}, feet=("c",))
    skeleton = arm([0.3], {}, measures=measures)
    stance = np.zeros((40, 1), dtype=bool)
    stance[10:20] = True
    steps = Footfalls(feet=("c",), t_s=t, stance=stance, height_m=np.zeros((40, 1)))
    motion = moving("abc", x, v)
    found = moments(motion, skeleton, steps=steps)["b_moment_y_n_m"]
    gone = np.zeros(40, dtype=bool)
    gone[9:21] = True
    np.testing.assert_array_equal(np.isnan(found.value), gone)
    np.testing.assert_array_equal(found.rests == Rests.MISSING, gone)
    unknown = moments(motion, skeleton)
    assert not len(unknown)
    assert "when that stands is not known" in unknown.notes[0]


def test_joints_whose_forces_cannot_be_known_are_left_out_with_the_reason():
    """Wings beat air, the trunk is no limb, a tail undulates, a segment that spans a joint is no rigid part of it."""
    bat = bat_skeleton()
    assert all(isinstance(part, str) for part in distal_parts(bat).values())
    assert "air" in str(distal_parts(bat)["shoulder_l"])
    lizard = lizard_skeleton()
    assert "no masses" in str(distal_parts(lizard)["elbow_l"])
    parts = {
        f"{a}_{side}": Segment(start=f"{a}_{side}", end=f"{b}_{side}", mass_g=0.1)
        for side in "lr"
        for a, b in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand"), ("hip", "knee"))
    }
    known = distal_parts(replace(lizard, measures=replace(lizard.measures, segments=parts)))
    elbow = known["elbow_l"]
    assert isinstance(elbow, Distal)
    assert elbow.feet == ("hand_l",)
    assert [(s.start, s.end) for s in elbow.segments] == [("elbow_l", "wrist_l"), ("wrist_l", "hand_l")]
    assert "trunk" in str(known["neck"])
    assert "undulates" in str(known["tail_1"])
    assert "ankle_l" in str(known["knee_l"])
    whole = {**parts, "shoulder_l": Segment(start="shoulder_l", end="wrist_l", mass_g=1)}
    spanned = distal_parts(replace(lizard, measures=replace(lizard.measures, segments=whole)))
    assert "spans it" in str(spanned["elbow_l"])


def test_a_skeleton_without_joints_is_told():
    """The one note says why nothing is there; so does the command's error."""
    skeleton = arm([0.3], {"rod": Segment(start="b", end="c", mass_g=10)})
    x, v = chain(np.zeros((5, 1)), np.zeros((5, 1)), [0.3])
    found = moments(moving("abc", x, v), replace(skeleton, joints=()))
    assert not len(found)
    assert found.notes == ("no moments of joints: the skeleton has none",)


def test_moments_are_written_as_kinematics_are(tmp_path):
    """Both files hold what the object does: CSV to the digits of its deviations, NetCDF in full."""
    t = DT_S * np.arange(20)
    x, v = chain(0.5 * np.sin(9 * t)[:, None], 4.5 * np.cos(9 * t)[:, None], [0.3])
    skeleton = arm([0.3], {"rod": Segment(start="b", end="c", mass_g=10)})
    found = moments(moving("abc", x, v, sd_m=1e-4, sd_m_s=1e-3), skeleton)
    write_kinematics(found, tmp_path, stem="moments")
    table = pd.read_csv(tmp_path / "moments.csv")
    one = found["b_moment_y_n_m"]
    assert (np.abs(table[one.name] - one.value) <= 0.06 * one.sd).all()
    assert set(table[f"{one.name}_status"]) == {"measured"}
    with xr.open_dataset(tmp_path / "moments.nc") as stored:
        np.testing.assert_allclose(stored["sd"].sel(quantity=one.name), one.sd, rtol=1e-6)
