"""Names with characters that act on terminals or turn the writing: escaped wherever a name is read."""

import numpy as np
import pytest

from mocap.errors import SkeletonError
from mocap.io.registry import read
from mocap.skeleton_files import read_skeleton

TURNED = "tip\u202exyz"


@pytest.mark.parametrize("name", [TURNED, "tip\u2066", "tip\x1b[31m", "tip\u200f"])
def test_names_in_files(tmp_path, name):
    """Marker names of tables and of C3D come without them, and a finding says so."""
    text = f"frame,{name}_x,{name}_y,{name}_z\n" + "1,0.5,0.25,1.0\n2,0.5,0.25,1.5\n"
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    got = read(tmp_path / "a.csv")
    assert got.names[0].isprintable()
    assert got.names[0].startswith("tip")
    assert "\\" in got.names[0]
    assert any("change how text reads" in finding for finding in got.findings)
    assert got.points is not None
    np.testing.assert_array_equal(got.points.xyz_m[:, 0, 2], [1.0, 1.5])


def test_names_in_skeletons(tmp_path):
    """A skeleton is ours: such a name is refused there, in one line that shows it."""
    text = f'markers = ["{TURNED}", "b"]\nbones = [["{TURNED}", "b"]]\n'
    (tmp_path / "s.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SkeletonError, match=r"the name 'tip\\u202exyz', which contains control characters"):
        read_skeleton(tmp_path / "s.toml")
