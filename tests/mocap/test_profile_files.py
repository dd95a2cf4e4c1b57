"""Camera profile text: lenses and picture sizes, a line a camera."""

from dataclasses import replace

import numpy as np
import pytest

from mocap.cameras.camera import Camera, dlt_camera
from mocap.cameras.lens import BrownLens
from mocap.errors import FormatError
from mocap.io.profile import read_profile, with_profile, write_profile

EYE = np.eye(3, 4)


def camera(number, **lens):
    return Camera(name=f"cam{number}", matrix=EYE, lens=BrownLens(**lens), size_px=(2560, 1600 + number))


def test_profiles_come_back(tmp_path):
    """Writing and reading is the identity to the twelve digits that are written; fy travels as f AR.

    Half of the twelfth digit is at most 5e-12 of a number, twice that for a product of two.
    """
    rng = np.random.default_rng(5)
    cameras = [
        camera(
            i,
            f_px=tuple(rng.uniform(500, 2000, 2)),
            centre_px=tuple(rng.uniform(300, 1300, 2)),
            k=tuple(rng.normal(0, 0.1, 3)),
            p=tuple(rng.normal(0, 1e-3, 2)),
        )
        for i in range(1, 12)
    ]
    write_profile(tmp_path / "p.txt", cameras)
    for (lens, size), source in zip(read_profile(tmp_path / "p.txt"), cameras, strict=True):
        assert size == source.size_px
        for name in ("f_px", "centre_px", "k", "p"):
            np.testing.assert_allclose(getattr(lens, name), getattr(source.lens, name), rtol=1.1e-11)


def test_columns_mean_what_argus_and_easywand_mean(tmp_path):
    """Cam f W H cx cy AR k1 k2 p1 p2 k3: k3 comes last, as in OpenCV's order of coefficients."""
    (tmp_path / "p.txt").write_text("1 1000 640 480 320.5 240.5 1.1 -0.1 0.01 0.002 -0.003 0.5\n")
    ((lens, size),) = read_profile(tmp_path / "p.txt")
    expected = BrownLens(f_px=(1000.0, 1100.0), centre_px=(320.5, 240.5), k=(-0.1, 0.01, 0.5), p=(0.002, -0.003))
    assert lens == expected
    assert size == (640, 480)


def test_lines_belong_to_cameras_by_number(tmp_path):
    """A profile whose lines are out of order describes the same cameras."""
    lines = [f"{i} {1000 + i} 640 480 320 240 1 -0.1 0 0 0 0" for i in (1, 2, 10)]
    (tmp_path / "straight.txt").write_text("\n".join(lines))
    (tmp_path / "mixed.txt").write_text("\ufeff\n" + "\n\n".join([lines[2], lines[0], lines[1]]))
    assert read_profile(tmp_path / "mixed.txt") == read_profile(tmp_path / "straight.txt")


def test_a_lens_that_moves_nothing_is_no_lens(tmp_path):
    """All-zero coefficients leave recorded pixels as they are; the picture size is still known."""
    (tmp_path / "p.txt").write_text("1 1000 640 480 320 240 1 0 0 0 0 0\n2 1000 640 480 320 240 1 -0.1 0 0 0 0\n")
    plain = tuple(dlt_camera(f"cam{i}", np.arange(11.0) + i) for i in (1, 2))
    first, second = with_profile(plain, tmp_path / "p.txt")
    assert first.lens is None
    assert first.size_px == second.size_px == (640, 480)
    assert second.lens.k == (-0.1, 0.0, 0.0)
    np.testing.assert_array_equal(second.matrix, plain[1].matrix)


@pytest.mark.parametrize("lacking", ["lens", "size_px"])
def test_a_camera_without_lens_or_size_is_not_written_as_one(tmp_path, lacking):
    """The format cannot say "none": refused, the first camera's line is not left behind."""
    good = camera(1, f_px=(1000.0, 1000.0), centre_px=(320.0, 240.0))
    with pytest.raises(FormatError, match="camera 'cam2' has no lens or image size"):
        write_profile(tmp_path / "p.txt", [good, replace(good, name="cam2", **{lacking: None})])
    assert list(tmp_path.iterdir()) == []
