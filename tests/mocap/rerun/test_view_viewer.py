"""Opening a recording: a viewer that only this computer can reach, or a line that says what to do."""

import urllib.request
from contextlib import suppress
from pathlib import Path

import pytest
from flapping import make_run

from mocap.rerun import viewer as subject
from mocap.rerun.record import write_recording
from mocap.rerun.viewer import HOST, ViewerError, has_display, open_viewer, quiet_environment


@pytest.fixture(scope="module")
def rrd(tmp_path_factory):
    path = tmp_path_factory.mktemp("viewer") / "recording.rrd"
    write_recording(make_run(n_frames=5, n_cameras=1, n_joints=0), path)
    return path


def test_served_to_browsers_of_this_computer_only(rrd):
    """The page answers; every port of the process is bound to 127.0.0.1; closing it ends it."""
    viewer = open_viewer(rrd, web=True)
    try:
        assert viewer.url is not None
        page = viewer.url.partition("?")[0]
        assert page.startswith(f"http://{HOST}:")
        with urllib.request.urlopen(page) as answer:
            assert answer.status == 200
        addresses = _listening(_child(viewer.process.pid))
        assert len(addresses) >= 2
        assert set(addresses) == {HOST}
    finally:
        viewer.close()
    assert viewer.process.poll() is not None


def test_no_recording(tmp_path):
    """Says what writes one."""
    with pytest.raises(ViewerError, match="no such recording"):
        open_viewer(tmp_path / "recording.rrd")


def test_what_is_no_recording_is_not_served(tmp_path):
    """One line, and no server is left."""
    (tmp_path / "other.rrd").write_bytes(b"RRF2 no recording")
    with pytest.raises(ViewerError, match="not a recording for the viewer"):
        open_viewer(tmp_path / "other.rrd", web=True)


def test_no_screen(rrd, monkeypatch):
    """Says how to look at it all the same."""
    monkeypatch.setattr(subject, "has_display", lambda *_: False)
    with pytest.raises(ViewerError, match="--web"):
        open_viewer(rrd)


def test_no_viewer(rrd, monkeypatch):
    """Says what to install."""
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(ViewerError, match="pip install"):
        open_viewer(rrd, web=True)


def test_a_viewer_that_fails_says_why(rrd, monkeypatch):
    """A screen that does not answer is one line with the viewer's last words, whenever it fails."""
    monkeypatch.setattr(subject, "has_display", lambda *_: True)
    monkeypatch.setenv("DISPLAY", ":213")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ViewerError, match=r"ended with code \d+ \(.*try --web"):
        open_viewer(rrd).wait()


@pytest.mark.parametrize(
    ("environment", "platform", "expected"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({"DISPLAY": ""}, "linux", False),
        ({}, "darwin", True),
        ({}, "win32", True),
    ],
)
def test_where_a_window_can_open(environment, platform, expected):
    assert has_display(environment, platform) is expected


def test_no_statistics_are_sent():
    """The switch that the viewer obeys is set, whatever was set before."""
    assert quiet_environment({"CI": "", "HOME": "h"})["CI"] == "1"


def _child(pid: int) -> int:
    """The only child of a process."""
    if not Path("/proc/self/stat").exists():
        pytest.skip("only Linux tells the children of a process")
    children = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it ended just now
            text = stat.read_text()
            if int(text.rpartition(")")[2].split()[1]) == pid:
                children.append(int(stat.parent.name))
    (child,) = children
    return child


def _listening(pid: int) -> list[str]:
    """Addresses on which a process listens, from the kernel's own tables."""
    if not Path("/proc/net/tcp").exists():
        pytest.skip("only Linux tells where a process listens")
    sockets = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            target = str(link.readlink())
        except OSError:
            continue
        if target.startswith("socket:["):
            sockets.add(target[8:-1])
    found = []
    for table in ("tcp", "tcp6"):
        for row in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = row.split()
            if fields[3] == "0A" and fields[9] in sockets:
                raw = bytes.fromhex(fields[1].split(":")[0])
                found.append(".".join(str(b) for b in raw[::-1]) if table == "tcp" else f"tcp6 {raw.hex()}")
    return found
