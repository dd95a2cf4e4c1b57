"""Names and findings in a report are text: a Markdown parser that we did not write gives them back."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from mocap.datasets import make_bat, write_recording
from mocap.filters.models.registry import NAMED

from mocap.calibration.calibration_files import table
from mocap.cleaning.cleaned import Cleaned
from mocap.cleaning.cleaning import clean
from mocap.findings import readings
from mocap.reading.reading import read
from mocap.report.report import make_report, readable
from mocap.text import plain
from mocap.tracking.model_choice import ModelChoice
from mocap.tracking.tracking import learn_motion, seen_part, track, with_track

HOSTILE = (
    "a|b", "`rm`", "<img src=x onerror=alert(1)>", "[red]x[/red]", "![x](http://x)", "*bold*", "_it_", "a\\|b", "&lt;",
    "# head", "- item", "1. item", "2) item", "> quote", "===", "~~~", "http://x.org", "a\\", "__x__", "| x |", "+ x",
)  # fmt: skip
PARSER = MarkdownIt("commonmark").enable("table").enable("strikethrough")


def text_of(markdown: str) -> list[str]:
    """Text of every line, cell and heading, as a reader sees it; markup in it fails."""
    found = []
    for token in PARSER.parse(markdown):
        assert token.type not in ("html_block", "fence", "code_block", "hr"), token
        if token.type == "inline":
            for child in token.children or ():
                assert child.type in ("text", "text_special", "softbreak"), (child, token.content)
            found.append("".join(child.content for child in token.children or ()))
    return found


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text(text):
    """In a line, an item, a heading and a cell."""
    assert text_of(plain(text)) == [text]
    assert text_of(f"- {plain(text)}") == [text]
    assert text_of(f"# {plain(text)}") == [text]
    assert text_of("\n".join(table(["name"], [[text]]))) == ["name", text]


@given(
    st.text(
        alphabet=st.one_of(st.sampled_from("\\`*_<>[]|~&#+-=1.)(!: ax"), st.characters(categories=["L", "N"])),
        min_size=1,
    )
)
def test_any_text(text):
    """But for spaces at its ends, which Markdown drops, and several on end."""
    words = " ".join(text.split())
    if words:
        assert text_of(f"- {plain(words)}") == [words]


def test_line_ends_are_said():
    """A name cannot begin a line of its own."""
    assert text_of(plain("a\n# b\r\nc")) == ["a\\n# b\\r\\nc"]


def test_ordinary_text_stays():
    """A report is read as it is written, too."""
    text = "camera cam1: wrist_l 0.5 px (median), 3 of 40; x = 1.2 - 0.3"
    assert plain(text) == text


def test_a_report_of_hostile_names(tmp_path):
    """Each marker, joint and finding of a run is there as text, and tables keep their columns."""
    files = write_recording(make_bat(seed=3, n_frames=40, n_cameras=3), tmp_path)
    source = read(files["pixels"], fps=240.0, calibration=files["coefficients"], profile=files["profile"])
    prepared = clean(source)
    names = tuple(f"{HOSTILE[m % len(HOSTILE)]} {m}" for m in range(len(prepared.names)))
    data = prepared.data.assign_coords(keypoint=list(names))
    found_out = prepared[Cleaned]
    told = (*readings(HOSTILE), *found_out.told)
    prepared = replace(prepared, data=data).with_part(replace(found_out, told=told))
    part = seen_part(prepared)
    model = learn_motion(part, NAMED["constant_velocity"].settings)
    tracked = with_track(prepared, part, "constant_velocity", track(part, model))
    tracked = tracked.with_part(ModelChoice(why="a|b"))
    report = make_report(prepared, tracked, seconds={})
    numbers = ("samples", "effective_rank", "v_at_samples_median", "width", "lambda", "weight")
    report["joints"] = {name: dict.fromkeys(numbers, 1.0) | {"metric": "whitened"} for name in HOSTILE}
    markdown = readable(report, title="<b>*x*|y")
    tokens = PARSER.parse(markdown)
    shown = ["".join(c.content for c in t.children or ()) for t in tokens if t.type == "inline"]
    assert shown[0] == "<b>*x*|y"
    assert set(HOSTILE) <= set(shown)
    assert not [t for t in tokens if t.type in ("html_block", "fence", "code_block")]
    rows = [t for t in tokens if t.type == "tr_open"]
    cells = [t for t in tokens if t.type in ("td_open", "th_open")]
    by_marker = 2 + len(names)  # a title, all of them, each
    assert len(rows) == 6 + 1 + len(HOSTILE) + by_marker
    assert len(cells) == 2 * 6 + 8 * (1 + len(HOSTILE)) + 4 * by_marker
    assert set(names) <= set(shown)
