"""A recording and its viewer as one page, which opens by a double click and reaches no host."""

import base64
import gzip
import html
import re
import urllib.request
from collections.abc import Mapping
from pathlib import Path

from mocap.errors import OutputError
from mocap.rerun.stored import recording_file
from mocap.rerun.viewer import open_viewer

PAGE = "index.html"
LARGEST_MB = 350.0
"""Browsers hold no text of more than half a gigabyte: so many megabytes of recording, compressed, are the most."""
_SCRIPT, _WASM = "re_viewer.js", "re_viewer_bg.wasm"
_POLICY = "default-src 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'none'"
QUERY, _OPTIONS = "new URLSearchParams(window.location.search)", "url=http%3A%2F%2Fheld%2Frecording.rrd&theme=dark"
_LEGEND = (
    "measured blue, filled yellow, rejected red; ellipsoids and bands: 95 % intervals. Space plays, dragging turns, "
    "the wheel zooms, each tab is another view"
)
_STYLE = """<style>
  .header { box-sizing: border-box; padding: 11px 16px; color: #cad8de; font: 15px sans-serif; white-space: nowrap }
  .header span { margin-left: 2em; color: #9aa7ad; font-size: 13px }
  canvas { top: 44px !important; height: calc(100% - 44px) !important }
</style>"""
_WAIT = "Opening the recording; this takes some seconds."
_WAITS = f'<div class="centered" id="center_text"><p class="strong">{_WAIT}</p>'
_FETCH = """<script>
  window.fetch = async (what) => {
    const address = new URL(what.url ?? what, "http://held/");
    const held = document.getElementById(address.pathname.slice(1));
    if (address.hostname !== "held" || held === null) throw new TypeError("this page asks no host");
    const text = atob(held.textContent), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    held.remove();
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
  };
</script>
"""


def write_page(run: Path, folder: Path) -> None:
    """Write ``index.html``, which holds the viewer and the recording of a run.

    The viewer is that of the installed rerun, taken from a server of our own on this computer. The page holds it and
    the recording compressed, as text, and answers itself what the viewer asks for. It asks no host, and is forbidden to
    by a policy, too: the viewer would send statistics of use.

    Raises:
        MocapError: the run has no recording, or the viewer does not start.
        OutputError: the recording is too large for a page.
    """
    folder.mkdir(exist_ok=True)
    recording = _embedded("recording.rrd", recording_file(run).read_bytes())
    if len(recording) > LARGEST_MB * 1e6 * 4 / 3:
        raise OutputError(
            f"the recording takes {len(recording) * 0.75e-6:.0f} MB compressed, and a page holds {LARGEST_MB:.0f} "
            "MB at most: share a stretch of it (mocap view --frames), or a run without videos"
        )
    text, script, wasm = fetched_viewer()
    title = html.escape(run.resolve().name if run.is_dir() else run.stem)
    parts = {
        f'<script src="{_SCRIPT}"></script>': recording
        + _embedded(_WASM, wasm)
        + _FETCH
        + f"<script>{script.decode('utf-8')}</script>",
        QUERY: f'new URLSearchParams("{_OPTIONS}&hide_welcome_screen&" + window.location.search.slice(1))',
        "enable_history: true": "enable_history: false",
        "<html>": f'<html>\n  <meta http-equiv="Content-Security-Policy" content="{_POLICY}" />',
        "<title>Rerun Viewer</title>": f"<title>{title}</title>{_STYLE}",
        '<div class="header"></div>': f'<div class="header"><b>{title}</b> <span>{_LEGEND}</span></div>',
        '<div class="centered hidden" id="center_text">': _WAITS,
        "Loading Application Bundle…": _WAIT,
    }
    (folder / PAGE).write_text(changed_page(text, parts), encoding="utf-8")


def changed_page(page: bytes, parts: Mapping[str, str]) -> str:
    """The viewer's page without links to other files, and with these parts, each once in it, in place of others.

    Raises:
        OutputError: it is of a version whose page is not known.
    """
    shown = re.sub(r"<link[^>]*>", "", page.decode("utf-8"))
    for theirs, ours in parts.items():
        if shown.count(theirs) != 1:
            raise OutputError(
                f"the page of this version of rerun is not known here: {theirs!r} is not once in it: run `pip install "
                "--force-reinstall eal-mocap`"
            )
        shown = shown.replace(theirs, ours)
    return shown


def fetched_viewer() -> tuple[bytes, bytes, bytes]:
    """Page, script and program of the installed rerun's web viewer, from a server of our own that ends at once.

    Raises:
        ViewerError: it does not start.
    """
    viewer = open_viewer(None, web=True)
    try:
        page = str(viewer.url).partition("?")[0]
        text, script, wasm = (_fetched(page + name) for name in ("", _SCRIPT, _WASM))
    finally:
        viewer.close()
    return text, script, wasm


def _embedded(name: str, content: bytes) -> str:
    """A file in a page: compressed, in letters, under its name."""
    letters = base64.b64encode(gzip.compress(content, 6, mtime=0)).decode("ascii")
    return f'<script type="text/plain" id="{name}">{letters}</script>\n'


def _fetched(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return answer.read()
