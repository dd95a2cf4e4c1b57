"""Slips that lead nowhere: each is told with what was meant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets import make_lizard

import mocap as library
from mocap.errors import FormatError
from mocap.io.contents import of_animals, point_recording
from mocap.io.dltdv import write_coefficients, write_pixels
from mocap.io.format import Hints

MADE = make_lizard(seed=3, n_frames=20, n_cameras=3)


@pytest.fixture
def files(tmp_path):
    write_pixels(tmp_path / "t_xypts.csv", MADE.pixels)
    write_coefficients(tmp_path / "rig.csv", [replace(one, lens=None) for one in MADE.cameras])
    return tmp_path


def test_tracks_and_calibration_in_each_others_place(files):
    """They are to be exchanged."""
    with pytest.raises(FormatError, match=r"is a calibration, and t_xypts.csv, .* holds tracks: exchange"):
        library.read(files / "rig.csv", calibration=files / "t_xypts.csv", fps=100)


@pytest.mark.parametrize("name", ["film.mp4", "film.avi"])
def test_a_video_is_to_be_digitised(tmp_path, name):
    """It holds no tracks yet."""
    (tmp_path / name).write_bytes(b"\x00\x00\x00\x18ftypmp42" if name.endswith("mp4") else b"RIFF1234AVI ")
    with pytest.raises(FormatError, match="is a video, in which nothing is digitised yet: mocap digitise"):
        library.read(tmp_path / name, fps=100)


def test_a_list_of_names_is_half_a_skeleton(files):
    """A name a line, in the order of the file; one too few is told."""
    called = [f"m{k}" for k in range(len(MADE.skeleton.markers))]
    (files / "names.txt").write_text("\n".join(called))
    stated = {"calibration": files / "rig.csv", "fps": 100, "unit": "m", "origin": "upper-left"}
    found = library.read(files / "t_xypts.csv", skeleton=files / "names.txt", **stated)
    assert list(found.names) == list(found.skeleton.markers) == called
    (files / "names.txt").write_text("\n".join(called[1:]))
    with pytest.raises(FormatError, match=r"names for .* points"):
        library.read(files / "t_xypts.csv", skeleton=files / "names.txt", **stated)


def test_two_animals_in_a_file_are_two_recordings():
    """None is taken for both; each has the body parts as its markers."""
    names, pairs = of_animals(["ann", "bob"], ["nose", "tail"])
    xyz = np.random.default_rng(0).normal(size=(9, 4, 3))
    both = replace(point_recording(Path("two.h5"), "made", names=names, xyz=xyz, unit="m", fps=50.0), animals=pairs)
    with pytest.raises(FormatError, match=r"holds 2 animals, .* \(ann, bob\): give `individual`"):
        both.of_animal(None)
    with pytest.raises(FormatError, match=r"no animal 'eve' \(ann, bob\)"):
        both.of_animal("eve")
    bob = both.of_animal("bob")
    assert bob.names == ("nose", "tail")
    np.testing.assert_array_equal(bob.points.xyz_m, xyz[:, 2:])
    assert bob.of_animal(None) is bob
    assert Hints().individual is None
