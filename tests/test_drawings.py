"""Drawings of quantities are what their script makes, and stay inside their frames."""

import re
from xml.etree import ElementTree

import pytest

from docs.tools.drawings import DRAWINGS, FOLDER, HEIGHT, WIDTH, svg


@pytest.mark.parametrize("name", DRAWINGS)
def test_drawings_are_what_the_script_makes(name):
    """A file edited by hand, or a script that was not run, shows here."""
    assert (FOLDER / f"{name}.svg").read_text(encoding="utf-8") == svg(name)


@pytest.mark.parametrize("name", DRAWINGS)
def test_nothing_is_cut_off(name):
    """All that is drawn lies inside the picture; a letter of 13 px is at most 8 px wide, in the mean under 7.2."""
    root = ElementTree.fromstring(svg(name))
    for one in root.iter():
        tag = one.tag.rpartition("}")[2]
        if tag == "text":
            length = 7.2 * len(one.text or "")
            left = (
                float(one.get("x", 0)) - {"start": 0, "middle": 0.5, "end": 1}[one.get("text-anchor", "start")] * length
            )
            assert left >= 0
            assert left + length <= WIDTH, one.text
            assert 11 <= float(one.get("y", 0)) <= HEIGHT
        places = [float(v) for key in ("x1", "x2", "cx") if (v := one.get(key))]
        heights = [float(v) for key in ("y1", "y2", "cy") if (v := one.get(key))]
        for pair in re.findall(r"([-\d.]+),([-\d.]+)", one.get("points", "")):
            places.append(float(pair[0]))
            heights.append(float(pair[1]))
        assert all(0 <= x <= WIDTH for x in places)
        assert all(0 <= y <= HEIGHT for y in heights)
