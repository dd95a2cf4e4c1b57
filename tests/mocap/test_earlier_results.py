"""A result of the version before is read for one release: ``earlier/`` was written by it, of the made-up flight."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import mocap
from tests.mocap.rerun.flapping import make_run

EARLIER = Path(__file__).parent / "earlier"


def test_a_result_of_the_version_before_is_the_same_record():
    """Positions, covariances, rays, velocities and rows are those of the flight; limbs and angles as they were made."""
    result, flight = mocap.load(EARLIER), make_run(n_frames=12, n_cameras=2, n_joints=4)
    for name in ("position", "covariance", "status", "reprojected", "innovation", "used", "ideal", "nis", "n_rows"):
        # the flight is made anew, and products of matrices round as the processor adds: 1e-12 of 1000 px
        np.testing.assert_allclose(result.data[name], flight.data[name], rtol=1e-12, atol=1e-11, err_msg=name)
    np.testing.assert_allclose(result.motion.own, flight.motion.own, rtol=1e-6)  # in single precision
    assert (result.name, result.model, result.camera_names) == (flight.name, flight.model, flight.camera_names)
    np.testing.assert_allclose(result.matrices, flight.matrices, rtol=1e-12)
    (limb,) = result.limbs.values()
    assert [result.names[m] for m in limb["marker"]] == ["L_shoulder", "L_elbow"]
    np.testing.assert_array_equal(limb["samples"], np.arange(14.0).reshape(7, 2))
    assert result.angles is not None
    assert (result.angles["energies"] == 1).all()
    world = result.data["joint_world"].values[:, 0]
    names = list(flight.names)
    expected = flight.xyz_m[:, names.index("L_wrist")] - flight.xyz_m[:, names.index("L_elbow")]
    np.testing.assert_allclose(world, expected, atol=1e-15)


def test_it_is_saved_as_one_of_this_version(tmp_path):
    """And read back the same."""
    mocap.load(EARLIER).save(tmp_path / "new")
    assert not (tmp_path / "new" / "run.nc").exists()
    np.testing.assert_array_equal(mocap.load(tmp_path / "new").motion.own, mocap.load(EARLIER).motion.own)


def test_half_of_one_is_refused(tmp_path):
    """In one line that names the folder."""
    shutil.copytree(EARLIER, tmp_path / "half")
    (tmp_path / "half" / "motion.nc").unlink()
    with pytest.raises(mocap.MocapError, match=r"motion\.nc"):
        mocap.load(tmp_path / "half")


def test_a_tracked_recording_is_not_tracked_again():
    """Its positions are smoothed: taken for measured ones, their errors would be counted as independent."""
    with pytest.raises(mocap.MocapError, match="was tracked already"):
        mocap.track(mocap.load(EARLIER))
