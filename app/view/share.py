"""A recording as a folder of static files, for any web server: it holds the viewer, and reaches no other host."""

import html
import re
import shutil
import tempfile
import urllib.request
from collections.abc import Sequence
from pathlib import Path

from app.view.compare import recording_of, run_names
from app.view.viewer import open_viewer

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
        folder: To write; its parent exists. Files of these names in it are replaced once all are written.

    Raises:
        MocapError: a run has no recording, or the viewer does not start.
    """
    partial = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        recording = recording_of(runs, partial)
        target = partial / "recording.rrd"
        recording.replace(target) if recording.parent == partial else shutil.copyfile(recording, target)
        viewer = open_viewer(target, web=True)
        try:
            page = str(viewer.url).partition("?")[0]
            for name in FILES:
                (partial / name).write_bytes(_fetched(page + name))
            text = _fetched(page).decode("utf-8")
        finally:
            viewer.close()
        policy = f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}" />'
        text = _ELSEWHERE.sub("", text).replace("<html>", f"<html>\n  {policy}", 1)
        (partial / "viewer.html").write_text(text, encoding="utf-8")
        title = html.escape(", ".join(run_names(runs)))
        (partial / "index.html").write_text(_PAGE.format(title=title), encoding="utf-8")
        folder.mkdir(exist_ok=True)
        for path in partial.iterdir():
            path.replace(folder / path.name)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _fetched(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return answer.read()
