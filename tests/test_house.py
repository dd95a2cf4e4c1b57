"""The page "The house in ten minutes" is what the code is: its rooms, parts and steps are found, not written."""

import re
from xml.etree import ElementTree

import pytest

from docs.tools import house, record
from mocap.cli.table import SATELLITES
from mocap.results.stored import PARTS


@pytest.fixture(scope="module")
def page():
    return house.page()


def test_every_room_stands_above_all_that_it_imports():
    """In the picture, too: the ground and the cameras that its record knows are the one pair that know each other."""
    floor = {name: level for level, names in enumerate(house.floors()) for name in names}
    assert floor.keys() == {house.room(path) for path in house.files()}
    for name, others in house.imported().items():
        above = {other for other in others if floor[other] >= floor[name]}
        assert not above or name == "mocap", (name, above)
    root = ElementTree.fromstring(house.drawn())
    texts = [one.text for one in root.iter() if one.tag.endswith("text")]
    assert {name.removeprefix("mocap/") for name in floor} <= set(texts)
    dashed = sum("stroke-dasharray" in one.attrib for one in root.iter())
    assert dashed == len({package for one in SATELLITES.values() for package in one.packages} - {"eal.joint_design"})


@pytest.mark.rare
def test_rooms_parts_and_variables_are_on_the_page(page):
    """Each room with its sentence, each part with its step."""
    for name in house.imported():
        assert re.search(rf"\| `{name}` \| [\d,]+ \| \S", page), name
    for name, kind in PARTS.items():
        assert f"| `{name}` | `{kind.__module__}.{kind.__name__}` |" in page
        assert kind.__name__ in record.page()
    assert "`believed`" in page


@pytest.mark.rare
def test_the_way_goes_through_the_rooms(page):
    """Reading asks the formats, cleaning triangulates, tracking runs the one filter; all with what they say."""
    verbs = dict(re.findall(r"^### (\w+)$(.*?)(?=^###|\Z)", page, re.MULTILINE | re.DOTALL))
    assert list(verbs) == ["read", "clean", "track"]
    for verb, words in {
        "read": ["mocap.io.registry.read"],
        "clean": ["triangulate"],
        "track": ["mocap.filters."],
    }.items():
        assert all(word in verbs[verb] for word in words), verb
    assert all(
        re.match(r" *- `[\w.]+`: \S", line) for line in page.splitlines() if line.lstrip().startswith("- `mocap")
    )
