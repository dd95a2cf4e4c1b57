"""Cycles against motions whose cycles are known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from mocap.datasets import make_lizard
from mocap.datasets.bats import BEAT_HZ, bat_motion, make_bat
from mocap.datasets.lizards import GAIT, lizard_motion
from mocap.filters.velocities import Motion, with_means

from eal.arrays import true_runs
from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycles import cycles, cycles_table, ensemble, footfalls, mean_angles
from mocap.kinematics.points import rate_points_for
from mocap.measures import Measures
from mocap.skeleton import Skeleton


def exact(scene, skeleton, t_s, *, sd_m=1e-4, sd_m_s=1e-3):
    """A motion with the true positions and velocities of a scene, and small independent covariances."""
    x, later, before = (scene(t).xyz_m for t in (t_s, t_s + 1e-4, t_s - 1e-4))
    shape = x.shape[:2]
    own = np.broadcast_to(np.diag([sd_m**2] * 3 + [sd_m_s**2] * 3), (*shape, 6, 6))
    motion = Motion(
        names=skeleton.markers,
        t_s=t_s,
        xyz_m=x,
        velocity_m_s=(later - before) / 2e-4,
        own=own,
        pairs=np.empty((0, 2), dtype=int),
        cross=np.empty((len(t_s), 0, 6, 6)),
        kept=np.ones(x.shape),
        measured=np.ones(shape, dtype=bool),
    )
    return with_means(motion, rate_points_for(skeleton.markers, skeleton, n_frames=len(t_s)))


@pytest.fixture(scope="module")
def bat():
    recording = make_bat(seed=0, n_frames=2, n_cameras=2)
    motion = exact(bat_motion(0), recording.skeleton, np.arange(240) / 240.0)
    found = kinematics(motion, recording.skeleton, recording="bat")
    return motion, recording.skeleton, found, cycles(found, motion, recording.skeleton)


@pytest.fixture(scope="module")
def lizard():
    recording = make_lizard(seed=0, n_frames=400, n_cameras=2)
    motion = exact(lizard_motion(0), recording.skeleton, recording.truth.t_s)
    found = kinematics(motion, recording.skeleton, recording="lizard")
    return recording, motion, found, cycles(found, motion, recording.skeleton)


def test_wing_beats_have_the_frequency_of_the_twin(bat):
    """9 Hz within the twin's own variation of beats; both wings beat together; a down-stroke is about half a beat."""
    beats = [row for row in bat[3] if row.kind == "wing_beat" and row.of == "wing_l"]
    assert len(beats) >= 7
    assert np.mean([b.frequency_hz for b in beats]) == pytest.approx(BEAT_HZ, rel=0.02)
    others = [row.start_s for row in bat[3] if row.of == "wing_r"]
    np.testing.assert_allclose([b.start_s for b in beats], others[: len(beats)], atol=0.004)
    assert all(0.4 < b.downstroke_fraction < 0.65 and b.amplitude_deg > 60 for b in beats)
    assert all(a.end_s == pytest.approx(b.start_s) for a, b in pairwise(beats))


def test_turning_points_are_where_the_stroke_is_highest(bat):
    """Between frames, to a tenth of a frame: against the peak of a parabola through the three highest samples."""
    _, _, found, rows = bat
    stroke = found["wing_l_stroke_deg"].value
    for beat in [row for row in rows if row.of == "wing_l"][1:4]:
        top = int(np.argmin(np.abs(found.t_s - beat.start_s)))
        top = top - 1 + int(np.argmax(stroke[top - 1 : top + 2]))
        a, b, c = stroke[top - 1 : top + 2]
        peak = found.t_s[top] + 0.5 * (a - c) / (a - 2 * b + c) / 240
        assert beat.start_s == pytest.approx(peak, abs=0.1 / 240)


def test_footfalls_and_duty_are_those_of_the_walk(lizard):
    """True contacts of four feet: 94 % of frames, footfalls within three frames, duty and stride near the gait's.

    The twin's feet swing along a smooth step, which is as slow as a standing foot in a few per cent of the cycle at
    either end.
    """
    recording, motion, _, rows = lizard
    steps = footfalls(motion, recording.skeleton)
    assert steps is not None
    true = recording.contact[:, [recording.skeleton.markers.index(f) for f in steps.feet]]
    assert (true == steps.stance).mean() > 0.94
    for foot in range(4):
        starts, known = ([a for a, _ in true_runs(s[:, foot]) if a > 5] for s in (steps.stance, true))
        assert np.abs(np.subtract(starts[: len(known)], known[: len(starts)])).max() <= 3
    strides = [row for row in rows if row.kind == "stride"]
    assert len(strides) >= 12
    assert np.mean([s.duty_factor for s in strides]) == pytest.approx(GAIT.duty, abs=0.04)
    assert np.mean([s.stride_length_m for s in strides]) == pytest.approx(GAIT.stride_m, rel=0.02)


def test_a_foot_that_never_overtakes_the_body_has_not_left_the_ground(lizard):
    """Noise of a filled gap in the middle of a contact, slower than the body: the same contacts as without."""
    recording, motion, _, _ = lizard
    steps = footfalls(motion, recording.skeleton)
    foot = motion.index(steps.feet[0])
    start, stop = next((a, b) for a, b in true_runs(steps.stance[:, 0]) if a > 5 and b - a > 20)
    pace = np.median(np.linalg.norm(motion.velocity_m_s[:, motion.index("body")], axis=-1))
    found = []
    for share in (0.7, 3.0):
        velocity = motion.velocity_m_s.copy()
        velocity[start + 8 : stop - 8, foot, 0] = share * pace
        found.append(footfalls(replace(motion, velocity_m_s=velocity), recording.skeleton))
    np.testing.assert_array_equal(found[0].stance, steps.stance)
    assert not found[1].stance[start + 8 : stop - 8, 0].any()


def test_a_wave_down_a_body_has_its_wavelength_and_frequency():
    """Sideways a sin(2 pi (x / lambda + f t)) on a body that moves ahead: a, lambda, f."""
    t = np.arange(300) / 100
    along = np.linspace(0, -0.5, 9)
    length, f, a, speed = 0.3, 1.5, 0.01, 0.2
    names = tuple(f"v{i}" for i in range(9))
    skeleton = Skeleton(name="snake", markers=names, measures=Measures(chain=names))

    def scene(t_s):
        phase = 2 * np.pi * (along / length + f * t_s[:, None])
        x = along + speed * t_s[:, None]
        xyz = np.stack([x, a * np.sin(phase), np.zeros_like(x)], axis=-1)
        return type("Scene", (), {"xyz_m": xyz})

    motion = exact(scene, skeleton, t)
    rows = cycles(kinematics(motion, skeleton), motion, skeleton)
    middle = rows[1:-1]
    assert len(middle) >= 2
    assert np.mean([r.frequency_hz for r in middle]) == pytest.approx(f, rel=0.02)
    assert np.mean([r.wavelength_m for r in middle]) == pytest.approx(length, rel=0.05)
    assert np.mean([r.amplitude_m for r in middle]) == pytest.approx(a, rel=0.1)


def test_curves_over_the_phase_of_equal_cycles_are_equal(bat):
    """The mean of N curves has the interval of Student's t; a quantity that is the phase itself has none."""
    _, _, found, rows = bat
    beats = [row for row in rows if row.of == "wing_l"]
    one = ensemble(found, beats, "elbow_l_flexion_deg")
    assert one.n == len(beats)
    np.testing.assert_allclose(one.mean, one.curves.mean(axis=0))
    assert (one.low <= one.mean).all()
    clock = replace(found["body_speed_m_s"], value=np.sin(2 * np.pi * found.t_s))
    same = replace(found, quantities=(clock,))
    second = [replace(beats[0], start_s=0.1 + k, end_s=0.6 + k) for k in (0, 0)]
    flat = ensemble(same, second, "body_speed_m_s")
    np.testing.assert_allclose(flat.sd, 0, atol=1e-12)


def test_a_table_of_cycles_is_tidy(bat):
    """A row a cycle, columns that no cycle has are left out."""
    table = cycles_table(bat[3])
    assert set(table["kind"]) == {"wing_beat"}
    assert "duty_factor" not in table
    assert {"frequency_hz", "amplitude_deg", "recording", "of"} <= set(table)
    assert len(cycles_table([]).columns) == 13


def test_means_over_cycles_are_those_of_the_angle(bat):
    """Of A + B sin over whole turns the mean is A, its deviation at most the values'; a course past 180 is followed."""
    _, _, found, rows = bat
    beat = replace(rows[0], start_s=0.25, end_s=0.5)
    wave = np.sin(8 * np.pi * found.t_s)
    flexion = replace(found["elbow_l_flexion_deg"], value=40 + 9 * wave, sd=np.full(len(wave), 2.0))
    course = replace(found["body_heading_deg"], value=180 - (5 + 20 * wave) % 360)  # between 155 and 195
    gap = replace(found["body_climb_deg"], value=np.where(found.t_s == found.t_s[70], np.nan, wave))
    table = mean_angles(replace(found, quantities=(flexion, course, gap)), [beat])
    assert table.loc[0, "elbow_l_flexion_deg"] == pytest.approx(40, abs=0.01)  # straight lines between 60 frames a beat
    assert table.loc[0, "elbow_l_flexion_deg_sd"] == pytest.approx(2)
    assert table.loc[0, "body_heading_deg"] == pytest.approx(175, abs=0.01)
    assert np.isnan(table.loc[0, "body_climb_deg"])
    assert list(table.columns[:7]) == ["recording", "kind", "of", "number", "start_s", "end_s", "filled"]
    real = mean_angles(found, rows)
    assert list(real["start_s"]) == [row.start_s for row in rows]
    assert set(cycles_table(rows)) >= set(real.columns[:7])
