"""What the audit finds reaches the user: in ``mocap info`` and in the reports of tracking."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mocap.audit.inspect import inspect, readable
from mocap.cleaning.cleaned import Cleaned
from mocap.cleaning.cleaning import clean as cleaned
from mocap.io.dltdv import write_coefficients, write_pixels
from mocap.io.format import Hints
from mocap.reading.reading import read
from mocap.records import PixelTracks
from tests.mocap.test_audit import clean


@pytest.fixture
def files(tmp_path):
    """A clean recording as files, and a way to spoil its pixels."""

    def write(spoil=lambda uv: uv):
        scene = clean(lens=False)
        pixels = PixelTracks(
            names=scene.pixels.names,
            cameras=scene.pixels.cameras,
            t_s=scene.pixels.t_s,
            uv_px=spoil(scene.pixels.uv_px.copy()),
        )
        write_pixels(tmp_path / "swim_xypts.csv", pixels)
        write_coefficients(tmp_path / "swim_dltCoefs.csv", [replace(c, lens=None) for c in scene.cameras])
        return tmp_path / "swim_xypts.csv", tmp_path / "swim_dltCoefs.csv"

    return write


def late_rows(uv):
    """Camera 3 is digitised two frames late."""
    uv[2, :-2] = uv[2, 2:]
    return uv


def rounded(uv):
    """Whole pixels."""
    return np.round(uv)


@pytest.mark.parametrize(
    ("spoil", "kind", "says"),
    [
        (late_rows, "camera offsets", "cameras are not synchronised"),
        (rounded, "quantised pixels", "are multiples of 1 px"),
    ],
)
def test_a_fault_is_told_by_info_and_by_tracking(files, spoil, kind, says):
    """The same finding in both, as a sentence and as numbers ready for JSON; clean files have no alarm."""
    told = inspect(files(spoil), Hints())[0]
    assert any(says in finding for finding in told["findings"])
    assert says in readable(told)
    assert [f for f in json.loads(json.dumps(told["audit"])) if f["kind"] == kind and f["alarm"]]
    tracks, coefficients = files(spoil)
    prepared = cleaned(read(tracks, calibration=coefficients, fps=200.0))
    assert any(says in finding.text for finding in prepared.findings)
    assert any(f.kind == kind and f.alarm for f in prepared[Cleaned].audited)
    untouched = inspect(files(), Hints())[0]
    assert not [f for f in untouched["audit"] if f["alarm"]]


def test_cameras_are_brought_in_step_only_when_asked(files):
    """Asked, the late camera alone is read between its frames, and the report says so; unasked, pixels stay."""
    tracks, coefficients = files(late_rows)
    how = {"calibration": coefficients, "fps": 200.0}
    as_is, asked = (cleaned(read(tracks, correct_lag=correct, **how)) for correct in (False, True))
    assert as_is.late_frames is None
    late = asked.late_frames
    assert late is not None
    np.testing.assert_allclose(late, [0, 0, 2, 0], atol=0.1)
    assert any("camera 'cam3': pixels were interpolated" in finding.text for finding in asked.findings)
    assert np.nanmedian(asked.residual_px) < 0.6 < 0.8 * np.nanmedian(as_is.residual_px)
