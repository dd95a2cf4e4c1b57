"""What is shared, and what is served, is seen in a browser that can reach this computer only."""

import json
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from browser import chromium, served, settled
from flapping import make_run
from test_view_pictures import amount

from mocap.rerun import palette
from mocap.rerun.record import write_recording
from mocap.rerun.share import FILES, write_site
from mocap.rerun.viewer import open_viewer

pytestmark = pytest.mark.viewer
SETTLED_COLORS = 150


@pytest.fixture(scope="module")
def browser():
    with chromium() as driver:
        yield driver


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A run, and the same of which nothing is known."""
    folder = tmp_path_factory.mktemp("share")
    run = make_run(n_frames=12, n_cameras=2, n_joints=0)
    markers = run.tracked.markers
    nothing = replace(
        markers,
        xyz_m=np.full_like(markers.xyz_m, np.nan),
        cov_m2=np.full_like(markers.cov_m2, np.nan),
        status=np.zeros_like(markers.status),
    )
    tracked = replace(run.tracked, markers=nothing, used=np.zeros_like(run.tracked.used))
    write_recording(run, folder / "flight.rrd")
    write_recording(replace(run, name="empty", tracked=tracked), folder / "empty.rrd")
    return folder


def scene_of(picture):
    """The left half below the tabs, where the scene is."""
    return picture[100:-40, : picture.shape[1] // 2]


def has_markers(picture):
    """Measured markers are in the scene."""
    return amount(scene_of(picture), palette.SKY_BLUE) > 40


def asked_for(browser):
    """Addresses that pages asked for since the last time."""
    messages = (json.loads(entry["message"])["message"] for entry in browser.get_log("performance"))
    return [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]


def test_the_web_viewer_shows_the_markers(browser, recordings):
    """What mocap view --web serves."""
    viewer = open_viewer(recordings / "flight.rrd", web=True)
    try:
        browser.get(f"{viewer.url}&renderer=webgl&hide_welcome_screen")
        assert has_markers(settled(browser, SETTLED_COLORS, has_markers))
    finally:
        browser.get("about:blank")
        viewer.close()


def test_what_else_a_folder_holds_stays(recordings, tmp_path):
    """Files of the site are replaced, others are not touched; no temporary folder is left."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "notes.txt").write_text("mine")
    write_site([recordings / "flight.rrd"], tmp_path / "site")
    write_site([recordings / "empty.rrd", recordings / "flight.rrd"], tmp_path / "site")
    assert (tmp_path / "site" / "notes.txt").read_text() == "mine"
    assert "empty, flight" in (tmp_path / "site" / "index.html").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
    page = (tmp_path / "site" / "viewer.html").read_text()
    assert "Content-Security-Policy" in page
    assert "<link" not in page.replace('<link rel="icon"', "")


ATTACK = '"><img src=x onerror="document.title=\'ran\'"><script>document.title="ran"</script>{0}</title>'
"""A name that runs a script wherever it is taken for HTML."""


def ran(browser):
    """Whether the page ran it, or holds what would."""
    scripts = "return [document.title === 'ran', document.querySelectorAll('img[src=x]').length]"
    title, images = browser.execute_script(scripts)
    return title or images > 0


def test_an_attack_would_be_seen(browser, tmp_path):
    """The test itself: a page that takes the name for HTML does run it."""
    (tmp_path / "index.html").write_text(f"<!doctype html><title>x</title><p>{ATTACK}")
    with served(tmp_path) as address:
        browser.get(address)
        settled(browser, 1)
        assert ran(browser)


@pytest.fixture(scope="module")
def attacked(tmp_path_factory):
    """The shared folder of a run whose name, folder, markers and report attack."""
    run = make_run(n_frames=12, n_cameras=2, n_joints=0)
    hostile = tuple(f"{ATTACK}{m}" for m in range(len(run.tracked.markers.names)))
    renamed = dict(zip(run.tracked.markers.names, hostile, strict=True))
    bones = tuple(replace(b, a=renamed[b.a], b=renamed[b.b]) for b in run.skeleton.bones)
    ideal = None if run.ideal_px is None else replace(run.ideal_px, names=hostile)
    run = replace(
        run,
        name=ATTACK,
        skeleton=replace(run.skeleton, markers=hostile, bones=bones, joints=(), trunk=()),
        tracked=replace(run.tracked, markers=replace(run.tracked.markers, names=hostile)),
        ideal_px=ideal,
        report_text=f"# {ATTACK}\n\n{ATTACK}\n",
    )
    folder = tmp_path_factory.mktemp("attack")
    named = folder / ATTACK.replace("/", "|")
    named.mkdir()
    write_recording(run, named / "recording.rrd")
    write_site([named], folder / "site")
    return folder / "site"


def test_names_are_text_of_the_first_page(attacked):
    """A parser of HTML finds the tags that we wrote, and the name as text."""
    tags, texts = [], []

    class Tags(HTMLParser):
        def handle_starttag(self, tag, attrs):
            tags.append((tag, *(name for name, _ in attrs if name.startswith("on"))))

        def handle_data(self, data):
            texts.append(data)

    Tags().feed((attacked / "index.html").read_text(encoding="utf-8"))
    assert [tag for tag, *_ in tags].count("script") == 1
    assert "img" not in {tag for tag, *_ in tags}
    assert not [handlers for _, *handlers in tags if handlers]
    assert texts.count(ATTACK.replace("/", "|")) == 2
    assert "onerror" not in (attacked / "viewer.html").read_text(encoding="utf-8").replace("window.onerror", "")


def test_a_shared_folder_shows_the_markers_runs_no_names_and_reaches_nobody(browser, attacked, recordings, tmp_path):
    """From a plain web server, with no other host known: markers and bones are there, and the page asked nobody else.

    Names of the run, its markers and its folder do not run, in the first page and in the viewer. Of a run without
    positions the same page shows none of the colours.
    """
    site = shutil.copytree(attacked, tmp_path / "site")
    assert {path.name for path in site.iterdir()} == {*FILES, "index.html", "viewer.html", "recording.rrd"}
    asked_for(browser)  # what pages of other tests did
    with served(site) as address:
        browser.get(f"{address}?renderer=webgl")
        seen = scene_of(settled(browser, SETTLED_COLORS, has_markers))
        assert not ran(browser)
        shutil.copyfile(recordings / "empty.rrd", site / "recording.rrd")
        browser.get(f"{address}?renderer=webgl")
        empty = scene_of(settled(browser, SETTLED_COLORS))
        elsewhere = [url for url in asked_for(browser) if not url.startswith((address, "data:", "blob:"))]
        assert not elsewhere
    for color in (palette.SKY_BLUE, palette.GREY):
        assert amount(seen, color) > 40
    assert amount(empty, palette.SKY_BLUE) == 0
