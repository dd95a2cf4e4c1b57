"""One sample is not "1 samples": messages have counts from ``number_of``, with the verb that goes with them."""

import re
from pathlib import Path

import numpy as np
import pytest

import mocap
from mocap.recording import of_points
from mocap.records import MarkerTracks, Status
from mocap.report.job import unknown_positions
from mocap.skeleton import Skeleton
from mocap.text import number_of
from mocap.tracking.learning import learn_from

ROOT = Path(mocap.__file__).parent
BARE = re.compile(
    r"(?<!of )(?<!all )(?<!its )\{[^{}]+\} (?:\w+ )?(samples|clicks|positions|columns|points|frames|markers|images) "
    r"(are|have|were|stand|contradict|show|do)\b"
)
"""A count before a plural and its verb; "3 of 1 samples are" and "its 2 points are" are right or cannot be one."""
ALLOWED = {
    "{frames} frames are": "20,000 at least",
    "{CHECKED_FROM} different points are": "a constant",
    "{until} all positions are": "no count",
}


def test_no_message_counts_without_asking():
    """As far as a verb tells that the noun is the subject."""
    found = {
        f"{path.relative_to(ROOT)}: {one[0]}"
        for path in ROOT.rglob("*.py")
        for one in BARE.finditer(path.read_text(encoding="utf-8"))
        if one[0] not in ALLOWED
    }
    assert found == set()


def test_one_and_several():
    """Also where the noun is irregular, or a verb follows."""
    assert [number_of(n, "sample") for n in (0, 1, 2)] == ["0 samples", "1 sample", "2 samples"]
    assert number_of(1, "marker is", "markers are") == "1 marker is"


@pytest.mark.parametrize(
    ("n", "said"),
    [
        (1, "1 sample at exactly (0, 0, 0) stands for missing and was read so"),
        (2, "2 samples at exactly (0, 0, 0) stand for missing and were read so"),
    ],
)
def test_missing_samples_are_counted_in_words(tmp_path, n, said):
    """In a file of two markers, of which one jumps to zero in a frame or two."""
    t = np.arange(60)
    xyz = np.stack(
        [100 + np.sin(t / 9), 200 + np.cos(t / 9), 300 + t / 50, 150 - t / 40, 210 + t / 60, 300 - t / 70], 1
    )
    xyz[20 : 20 + n, :3] = 0
    head = ",".join(f"{name}_{axis}" for name in ("nose", "tail") for axis in "xyz")
    np.savetxt(tmp_path / "a.csv", xyz, delimiter=",", header=head, comments="", fmt="%.4f")
    told = [str(one) for one in mocap.read(tmp_path / "a.csv", fps=100, unit="mm").findings]
    assert any(said in one for one in told), told


def test_samples_that_are_learned_from_are_counted_in_words():
    """A recording of one sample teaches nothing, and is told as what it is."""
    xyz = np.full((8, 1, 3), np.nan)
    xyz[3] = 0.1
    status = np.where(np.isfinite(xyz[..., 0]), Status.MEASURED, Status.MISSING)
    cov = np.where(np.isfinite(xyz)[..., None], 1e-6 * np.eye(3), np.nan)
    tracks = MarkerTracks(names=("nose",), t_s=np.arange(8) / 100, xyz_m=xyz, cov_m2=cov, status=status)
    one, told = of_points(tracks, Skeleton(name="a", markers=("nose",)), name="a"), []
    with pytest.raises(mocap.MocapError, match="only 1 marker is ever seen"):
        learn_from([one], tell=told.append)
    assert "a: 1 frame, 1 sample" in told


@pytest.mark.parametrize(("n", "begin"), [(1, "1 position is too"), (2, "2 positions are too")])
def test_unknown_positions_are_counted_in_words(n, begin):
    """The report's sentence."""
    (found,) = unknown_positions(n, 10)
    assert found.text.startswith(begin)
