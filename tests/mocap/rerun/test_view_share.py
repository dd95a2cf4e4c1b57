"""What is shared, and what is served, is seen in a browser that can reach this computer only."""

import json
import time
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest
from browser import chromium, served, settled
from flapping import make_run
from test_view_pictures import amount

from mocap.errors import OutputError
from mocap.rerun import palette, share
from mocap.rerun.record import write_recording
from mocap.rerun.share import PAGE, write_page
from mocap.rerun.viewer import HOST, open_viewer
from mocap.tracking.report_part import Report

pytestmark = pytest.mark.viewer
SETTLED_COLORS = 150


@pytest.fixture(autouse=True, scope="module")
def _fetched_once():
    """The installed viewer is fetched and compressed once, not for each page."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("fetched_viewer", "_embedded"):
            patch.setattr(share, name, cache(getattr(share, name)))
        yield


@pytest.fixture(scope="module")
def browser():
    with chromium() as driver:
        yield driver


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A run, and the same of which nothing is known."""
    folder = tmp_path_factory.mktemp("share")
    run = make_run(n_frames=12, n_cameras=2, n_joints=0)
    markers = run.tracks
    nothing = run.having(
        position=np.full_like(markers.xyz_m, np.nan),
        covariance=np.full_like(markers.cov_m2, np.nan),
        status=np.zeros_like(markers.status),
        used=np.zeros_like(run.used),
    )
    write_recording(run, folder / "flight.rrd")
    write_recording(replace(nothing, name="empty"), folder / "empty.rrd")
    return folder


def scene_of(picture):
    """The left half below the tabs, where the scene is."""
    return picture[100:-40, : picture.shape[1] // 2]


def has_markers(picture):
    """Measured markers are in the scene."""
    return amount(scene_of(picture), palette.SKY_BLUE) > 40


def told(browser):
    """What the browser told of its network since the last time."""
    return [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]


def asked_for(browser):
    """Addresses that pages asked for since the last time."""
    return [m["params"]["request"]["url"] for m in told(browser) if m["method"] == "Network.requestWillBeSent"]


@pytest.mark.main
def test_the_web_viewer_is_sent_the_recording(browser, recordings):
    """What mocap view --web serves: its page starts the viewer, which asks our server for the recording and gets it.

    It would send statistics of use, ask for a newer version and load fonts: a policy refuses what is of another host.
    What the same program then draws is seen on the page from the disk.
    """
    file = recordings / "flight.rrd"
    viewer = open_viewer(file, web=True)
    server, sent, streams = viewer.sink.removeprefix("rerun+").removesuffix("proxy"), 0, set()
    others = {}
    told(browser)
    try:
        browser.get(f"{viewer.url}&renderer=webgl&hide_welcome_screen")
        while sent < file.stat().st_size / 4:  # coded otherwise it is half as long; of none a few hundred bytes come
            for m in told(browser):
                if m["method"] == "Network.requestWillBeSent":
                    url = m["params"]["request"]["url"]
                    if url.startswith(server):
                        streams.add(m["params"]["requestId"])
                    elif not url.startswith((f"http://{HOST}:", "data:", "blob:")):
                        others[m["params"]["requestId"]] = url
                elif m["method"] == "Network.loadingFailed" and m["params"].get("blockedReason") == "csp":
                    others.pop(m["params"]["requestId"], None)
                elif m["method"] == "Network.dataReceived" and m["params"]["requestId"] in streams:
                    sent += m["params"]["dataLength"]
            time.sleep(0.2)
    finally:
        browser.get("about:blank")
        viewer.close()
    assert not others


@pytest.mark.main
def test_what_else_a_folder_holds_stays(recordings, tmp_path, monkeypatch):
    """The page is replaced, other files are not touched; no temporary folder is left. It lacks the viewer's program."""
    page, script, _ = share.fetched_viewer()
    monkeypatch.setattr(share, "fetched_viewer", lambda: (page, script, b""))
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "notes.txt").write_text("mine")
    write_page(recordings / "flight.rrd", tmp_path / "site")
    write_page(recordings / "empty.rrd", tmp_path / "site")
    assert (tmp_path / "site" / "notes.txt").read_text() == "mine"
    assert "<title>empty</title>" in (tmp_path / "site" / PAGE).read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
    assert sorted(path.name for path in (tmp_path / "site").iterdir()) == [PAGE, "notes.txt"]


def test_a_recording_beyond_what_browsers_hold_is_refused(recordings, tmp_path, monkeypatch):
    """With its size and what to do; nothing is written."""
    monkeypatch.setattr("mocap.rerun.share.LARGEST_MB", 1e-3)
    with pytest.raises(OutputError, match=r"MB compressed, and a page holds .* share a stretch of it"):
        write_page(recordings / "flight.rrd", tmp_path)
    assert not list(tmp_path.iterdir())


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
        assert ran(browser)


@pytest.fixture(scope="module")
def attacked(tmp_path_factory):
    """The folder of a shared run whose name, folder, markers and report attack."""
    run = make_run(n_frames=12, n_cameras=2, n_joints=0)
    hostile = tuple(f"{ATTACK}{m}" for m in range(len(run.names)))
    renamed = dict(zip(run.names, hostile, strict=True))
    bones = tuple(replace(b, a=renamed[b.a], b=renamed[b.b]) for b in run.skeleton.bones)
    run = replace(
        run,
        name=ATTACK,
        skeleton=replace(run.skeleton, markers=hostile, bones=bones, joints=(), trunk=()),
        data=run.data.assign_coords(keypoint=list(hostile), point=list(hostile)),
    ).with_part(Report(numbers=dict(run.report), text=f"# {ATTACK}\n\n{ATTACK}\n"))
    folder = tmp_path_factory.mktemp("attack")
    named = folder / ATTACK.replace("/", "|")
    named.mkdir()
    write_recording(run, named / "recording.rrd")
    write_page(named, folder / "site")
    return folder / "site"


def test_names_are_text_of_the_page(attacked):
    """A parser of HTML finds the name as the page's title alone, and no element that it would make."""
    tags, titles, inside = [], [], []

    class Tags(HTMLParser):
        def handle_starttag(self, tag, attrs):
            inside.append(tag)
            tags.append((tag, *(name for name, _ in attrs if name.startswith("on"))))

        def handle_data(self, data):
            if inside and inside[-1] == "title" and data.strip():
                titles.append(data)
                inside.append("")

    Tags().feed((attacked / PAGE).read_text(encoding="utf-8"))
    assert titles == [ATTACK.replace("/", "|")]
    assert "img" not in {tag for tag, *_ in tags}
    assert not [handlers for _, *handlers in tags if handlers]


def test_a_page_from_the_disk_shows_the_markers_runs_no_names_and_reaches_nobody(browser, attacked):
    """Opened as by a double click, with no other host known: markers and bones are there, and it asked nobody.

    Names of the run, its markers and its folder do not run.
    """
    asked_for(browser)  # what pages of other tests did
    browser.get(f"{(attacked / PAGE).as_uri()}?renderer=webgl")
    seen = scene_of(settled(browser, SETTLED_COLORS, has_markers))
    assert not ran(browser)
    assert not [url for url in asked_for(browser) if not url.startswith(("file:", "data:", "blob:"))]
    for color in (palette.SKY_BLUE, palette.GREY):
        assert amount(seen, color) > 40
