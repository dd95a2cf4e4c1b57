"""What a file does not state is said once, from what was read, by no reader of its own."""

import re
from pathlib import Path

import numpy as np

from mocap.io.contents import point_recording

RATE, UNIT = "the frame rate of the cameras is not stated", "the unit of lengths is not stated"


def test_a_rate_and_a_unit_are_asked_for_until_they_are_stated():
    """Of positions both, of any format; neither where the file or the user states them."""
    bare = point_recording(Path("a.csv"), "made", names=["a"], xyz=np.ones((2, 1, 3)), unit=None, findings=("odd",))
    assert bare.remarks == ("odd", RATE, UNIT)
    assert bare.with_rate(100.0).remarks == ("odd", UNIT)
    assert bare.with_rate(100.0).with_unit("mm").remarks == ("odd",)


def test_no_reader_says_so_itself():
    """The sentences stand in one place."""
    folder = Path(__file__).parents[2] / "mocap" / "io"
    phrase = re.compile(
        "(frame rate|rate of the cameras|unit of lengths) is not (stated|in the file)|state the frame rate"
    )
    assert [p.name for p in folder.glob("*.py") if phrase.search(p.read_text(encoding="utf-8"))] == ["contents.py"]
