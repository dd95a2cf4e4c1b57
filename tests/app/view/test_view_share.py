"""What is shared, and what is served, is seen in a browser that can reach this computer only."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from browser import chromium, served, settled
from flapping import make_run
from test_view_pictures import amount

from app.view import palette
from app.view.record import write_recording
from app.view.share import FILES, write_site
from app.view.viewer import open_viewer

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
        origin=np.zeros_like(markers.origin),
    )
    tracked = replace(run.tracked, markers=nothing, used=np.zeros_like(run.tracked.used))
    write_recording(run, folder / "flight.rrd")
    write_recording(replace(run, name="empty", tracked=tracked), folder / "empty.rrd")
    return folder


def scene_of(picture):
    """The left half below the tabs, where the scene is."""
    return picture[100:-40, : picture.shape[1] // 2]


def asked_for(browser):
    """Addresses that pages asked for since the last time."""
    messages = (json.loads(entry["message"])["message"] for entry in browser.get_log("performance"))
    return [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]


def test_a_shared_folder_shows_the_markers_and_reaches_nobody(browser, recordings, tmp_path):
    """From a plain web server, with no other host known: markers and bones are there, and the page asked nobody else.

    Of a run without positions the same page shows none of their colours.
    """
    site = tmp_path / "site"
    write_site([recordings / "flight.rrd"], site)
    assert {path.name for path in site.iterdir()} == {*FILES, "index.html", "viewer.html", "recording.rrd"}
    seen = {}
    with served(site) as address:
        for name in ("flight", "empty"):
            shutil.copyfile(recordings / f"{name}.rrd", site / "recording.rrd")
            browser.get(f"{address}?renderer=webgl")
            seen[name] = scene_of(settled(browser, SETTLED_COLORS))
        elsewhere = [url for url in asked_for(browser) if not url.startswith((address, "data:", "blob:"))]
        assert not elsewhere
    for color in (palette.SKY_BLUE, palette.GREY):
        assert amount(seen["flight"], color) > 40
    assert amount(seen["empty"], palette.SKY_BLUE) == 0


def test_the_web_viewer_shows_the_markers(browser, recordings):
    """What mocap view --web serves."""
    viewer = open_viewer(recordings / "flight.rrd", web=True)
    try:
        browser.get(f"{viewer.url}&renderer=webgl&hide_welcome_screen")
        picture = scene_of(settled(browser, SETTLED_COLORS))
    finally:
        browser.get("about:blank")
        viewer.close()
    assert amount(picture, palette.SKY_BLUE) > 40


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
