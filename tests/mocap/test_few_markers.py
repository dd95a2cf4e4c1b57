"""One to three markers: the model by its name, accelerations that come through, gravity of a ball."""

import json

import numpy as np
import pytest

import mocap
from eal.systems import GRAVITY_M_S2
from mocap.errors import MocapError
from mocap.kinematics.records import Rests

FPS, NOISE_M = 250, 1e-3


def ball(seed, n_frames=110):
    """Positions (T, 1, 3) of a ball thrown aside and dropped, digitised with noise."""
    rng, t = np.random.default_rng(seed), np.arange(n_frames) / FPS
    path = np.stack([0.4 * t, -0.2 * t, 1 - GRAVITY_M_S2 * t**2 / 2], axis=1)
    return (path + NOISE_M * rng.normal(size=path.shape))[:, None]


def tracked(xyz, **options):
    """The result of few markers."""
    names = [f"p{i}" for i in range(xyz.shape[1])]
    return mocap.track(mocap.from_arrays(xyz, names=names, fps=FPS), validate=False, **options)


@pytest.fixture(scope="module")
def fallen():
    """A ball with a gap, as the default tracks it."""
    xyz = ball(0)
    xyz[50:65] = np.nan
    return tracked(xyz)


def test_gravity_is_within_its_interval(fallen):
    """In the middle, in the gap and at both ends: three deviations; known to 10 % in the middle, or it says nothing."""
    down = fallen.kinematics["p0_acceleration_z_m_s2"]
    assert (np.abs(down.value + GRAVITY_M_S2) < 3 * down.sd).all()
    assert down.sd[55] < 0.1 * GRAVITY_M_S2
    assert down.rests[55] == Rests.FILLED
    assert down.rests[0] == Rests.MEASURED


def test_the_report_names_the_model(fallen):
    """The default of one to three markers has its own name, and says why; constant velocity can still be asked for."""
    assert fallen.model == "smooth_acceleration"
    assert "only 1 marker is seen" in fallen.report["model"]["why"]
    plain = tracked(ball(0), model="constant_velocity")
    assert plain.model == "constant_velocity"
    wide = plain.kinematics["p0_acceleration_z_m_s2"].sd[55]
    assert wide > 5 * fallen.kinematics["p0_acceleration_z_m_s2"].sd[55]


def test_what_is_saved_is_loaded(fallen, tmp_path):
    """Accelerations and their deviations, to the last bit, and in the table."""
    fallen.save(tmp_path / "run")
    again = mocap.load(tmp_path / "run").kinematics
    for name in ("p0_acceleration_z_m_s2", "p0_acceleration_m_s2"):
        np.testing.assert_array_equal(again[name].value, fallen.kinematics[name].value)
        np.testing.assert_array_equal(again[name].sd, fallen.kinematics[name].sd)
    head = (tmp_path / "run" / "kinematics.csv").read_text().split("\n")[0]
    assert "p0_acceleration_z_m_s2_sd" in head
    assert json.loads((tmp_path / "run" / "report.json").read_text())["model"]["name"] == "smooth_acceleration"


def test_an_impossible_model_is_refused_with_what_to_give():
    """A pose of one marker: the message names the model that there is."""
    with pytest.raises(MocapError, match="use `model` smooth_acceleration"):
        tracked(ball(1), model="eal")


def test_means_of_points_accelerate_as_their_parts():
    """The body of two balls: the mean of both accelerations, with half the variance."""
    found = tracked(np.concatenate([ball(2), ball(3)], axis=1)).kinematics
    one, two, body = (found[f"{name}_acceleration_z_m_s2"] for name in ("p0", "p1", "body"))
    np.testing.assert_allclose(body.value, (one.value + two.value) / 2, atol=1e-9)
    np.testing.assert_allclose(body.sd**2, (one.sd**2 + two.sd**2) / 4, rtol=1e-3)


def test_pixels_of_several_cameras_show_gravity():
    """A ball seen by two of three cameras at a time, by one in some frames, by none in others: within three deviations.

    Half a pixel of noise at 1 m and 800 px a metre: 0.6 mm a ray, as sure as the positions above.
    """
    rng = np.random.default_rng(4)
    inner = np.array([[800.0, 0, 640], [0, 800, 360], [0, 0, 1]])
    path = ball(4)[:, 0]
    path -= path.mean(axis=0)
    matrices, uv = [], np.empty((3, len(path), 1, 2))
    for k, turn in enumerate(np.radians([0.0, 70.0, 140.0])):
        side, ahead = [np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0]
        matrices.append(inner @ np.column_stack([[side, [0, 0, -1], ahead], [0, 0, 1.5]]))
        seen = np.column_stack([path, np.ones(len(path))]) @ matrices[k].T
        uv[k, :, 0] = seen[:, :2] / seen[:, 2:] + 0.5 * rng.normal(size=(len(path), 2))
    uv[0, 20:50], uv[1, 35:70], uv[2, 45:60] = np.nan, np.nan, np.nan
    recording = mocap.from_pixels(uv, np.array(matrices), names=["p"], fps=FPS, unit="m", origin="upper-left")
    found = mocap.track(recording, validate=False)
    down = found.kinematics["p_acceleration_z_m_s2"]
    assert found.model == "smooth_acceleration"
    assert (np.abs(down.value + GRAVITY_M_S2) < 3 * down.sd).all()
    assert down.sd[30] < 0.1 * GRAVITY_M_S2
