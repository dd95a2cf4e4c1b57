"""A recording as a folder of static files, for any web server: it holds the viewer, and reaches no other host."""

import html
import re
import shutil
import urllib.request
from collections.abc import Sequence
from pathlib import Path

from mocap.rerun.compare import run_names, write_comparison
from mocap.rerun.stored import recording_file
from mocap.rerun.viewer import open_viewer

FILES = ("re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""What the viewer's page loads."""
_POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' data: blob:"
_ELSEWHERE = re.compile(r"<link[^>]*https?://[^>]*>|<link[^>]*apple-touch-icon[^>]*>")
_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>{title}</title>
<style>body {{ background: #101217; color: #ebeef2; font: 16px sans-serif; margin: 4em; }}</style>
<h1>{title}</h1>
<p id="note">The viewer starts ...</p>
<noscript><p>It needs JavaScript.</p></noscript>
<script>
  if (location.protocol === "file:") {{
    document.getElementById("note").textContent =
      "A browser opens this only from a web server: run `python -m http.server` in this folder, then open " +
      "http://127.0.0.1:8000/";
  }} else {{
    const recording = encodeURIComponent(new URL("recording.rrd", location.href).href);
    const more = location.search.replace("?", "&");
    location.replace("viewer.html?url=" + recording + "&theme=dark&hide_welcome_screen" + more);
  }}
</script>
</html>
"""


def write_site(runs: Sequence[Path], folder: Path) -> None:
    """Write ``index.html``, the viewer, and the recording of a run, or a comparison of several.

    The viewer is that of the installed rerun, fetched from a server of our own on this computer. Its page is forbidden
    to reach other hosts: it would send statistics of use.

    Args:
        runs: Folders of runs, or their recordings.
        folder: Where to, as ``mocap.io.output.result_folder`` gives it.

    Raises:
        MocapError: a run has no recording, or the viewer does not start.
    """
    folder.mkdir(exist_ok=True)
    target = folder / "recording.rrd"
    if len(runs) == 1:
        shutil.copyfile(recording_file(runs[0]), target)
    else:
        write_comparison(runs, target)
    viewer = open_viewer(target, web=True)
    try:
        page = str(viewer.url).partition("?")[0]
        for name in FILES:
            (folder / name).write_bytes(_fetched(page + name))
        text = _fetched(page).decode("utf-8")
    finally:
        viewer.close()
    policy = f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}" />'
    text = _ELSEWHERE.sub("", text).replace("<html>", f"<html>\n  {policy}", 1)
    (folder / "viewer.html").write_text(text, encoding="utf-8")
    title = html.escape(", ".join(run_names(runs)))
    (folder / "index.html").write_text(_PAGE.format(title=title), encoding="utf-8")


def _fetched(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return answer.read()
