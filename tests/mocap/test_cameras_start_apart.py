"""Cameras that start seconds apart, found from the motion of points alone."""

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.datasets.bats import bat_motion

from mocap.audit.offsets import moved, offset_findings, start_offsets
from mocap.cameras.camera import project, stacked
from mocap.cameras.origin import PixelOptions
from mocap.errors import CalibrationError
from mocap.reading.decided import Decided
from mocap.reading.ideal_pixels import of_pixels
from mocap.records import PixelTracks

STARTS = np.array([0, 173, -61])


@pytest.fixture(scope="module")
def filmed():
    """Three cameras of a flying bat whose rows begin 0, 173 and -61 frames late: 0.5 px noise, a tenth not seen."""
    recording = make_bat(seed=2, n_frames=4, n_cameras=3)
    rng, n_frames = np.random.default_rng(0), 500
    matrices = stacked(recording.cameras)
    scene = bat_motion(2)
    uv = np.stack([
        project(matrices[c : c + 1], scene((np.arange(n_frames) + start) / 240).xyz_m[:, :8])[0]
        for c, start in enumerate(STARTS)
    ])  # fmt: skip
    uv += rng.normal(0, 0.5, uv.shape)
    uv[rng.random(uv.shape[:3]) < 0.1] = np.nan
    return recording, matrices, uv


def test_the_lag_is_found_to_the_frame(filmed):
    """Two wing beats and more apart: the likeliest lag is the true one, that of odd and of even blocks, too."""
    _, matrices, uv = filmed
    offset, sd = start_offsets(matrices, uv)
    np.testing.assert_array_equal(offset - offset[0], STARTS)
    assert (sd < 1).all()
    moments = moved(np.arange(500.0)[None, :, None, None] + STARTS[:, None, None, None], offset)[..., 0, 0]
    there = np.isfinite(moments).all(axis=0)
    assert there.sum() == 500 - 234
    np.testing.assert_array_equal(moments[:, there], np.broadcast_to(moments[0, there], (3, there.sum())))


def test_noise_tells_no_lag():
    """Of pixels without a motion in common odd and even blocks have other lags: none is told."""
    rng = np.random.default_rng(1)
    matrices = stacked(make_bat(seed=2, n_frames=4, n_cameras=2).cameras)
    for _ in range(20):
        offset, _ = start_offsets(matrices, rng.uniform(0, 1000, (2, 300, 3, 2)))
        assert not offset.any()


def test_the_audit_says_by_how_much(filmed):
    """Offsets with their deviations, and residuals before and after, where rays still give a point somewhere."""
    recording, _, uv = filmed
    (found,) = offset_findings(recording.cameras, uv)
    assert found.alarm
    told = [found.numbers[f"{camera.name}_frames"] for camera in recording.cameras]
    np.testing.assert_allclose(np.array(told) - told[0], STARTS, atol=0.1)


def test_a_recording_that_starts_apart_is_refused_with_the_lags_and_tracked_when_asked(filmed):
    """Without correct_lag one line says by how much; with it the rays meet within their noise."""
    recording, _, uv = filmed
    names = tuple(f"p{i}" for i in range(8))
    pixels = PixelTracks(names=names, cameras=recording.pixels.cameras, t_s=np.arange(500) / 240, uv_px=uv)
    cameras = [type(c)(name=c.name, matrix=c.matrix) for c in recording.cameras]
    with pytest.raises(CalibrationError, match=r"start apart.*cam2 \+?\d+.*`correct_lag`"):
        of_pixels(pixels, cameras, name="bat")
    found = of_pixels(pixels, cameras, name="bat", options=PixelOptions(correct_lag=True))
    np.testing.assert_allclose(found.late_frames - found.late_frames[0], STARTS, atol=0.1)
    assert found[Decided].rows.residual_px < 1
