"""XMALab's rigid bodies and the anatomical coordinate systems that Maya exports are recognised."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap.io.registry import read
from tests.real_data import real

ACS = ["rxx", "rxy", "rxz", "rx0", "ryx", "ryy", "ryz", "ry0", "rzx", "rzy", "rzz", "rz0", "tx", "ty", "tz", "t1"]


def test_a_coordinate_system_of_maya(tmp_path):
    """The 16 numbers of a row are a matrix, its axes one after the other, then its place."""
    rng = np.random.default_rng(1)
    pose = np.tile(np.eye(4), (5, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = Rotation.random(5, random_state=2).as_matrix(), rng.normal(size=(5, 3))
    header = ",".join(f"jaw.{entry}" for entry in ACS)
    rows = pose.transpose(0, 2, 1).reshape(5, 16)
    np.savetxt(tmp_path / "jaw_acs_tm.csv", rows, "%.12g", ",", header=header, comments="")
    found = read(tmp_path / "jaw_acs_tm.csv")
    assert (found.format, found.names) == ("xmalab-rigid-bodies", ("jaw",))
    np.testing.assert_allclose(found.tables["transforms"][:, 0], pose, atol=1e-9)


@pytest.mark.parametrize(("name", "body"), [("Cranium", "cradata"), ("Mandible", None)])
def test_the_pigs_coordinate_systems(name, body):
    """Real exports: one system each, its matrices rotations."""
    found = read(real("xmalab_pig", f"{name}_acs_tm.csv"))
    assert found.format == "xmalab-rigid-bodies"
    assert len(found.names) == 1
    assert body in (None, found.names[0])
    turned = found.tables["transforms"][:, 0, :3, :3]
    ok = np.isfinite(turned).all(axis=(1, 2))
    np.testing.assert_allclose(
        turned[ok] @ turned[ok].transpose(0, 2, 1), np.tile(np.eye(3), (ok.sum(), 1, 1)), atol=1e-6
    )
