"""The desk's page itself, which is there before what answers it: nothing of this file waits for numpy."""

from base64 import b64encode
from hashlib import sha256
from importlib.resources import files

from starlette.responses import Response
from starlette.routing import Route

SCRIPTS = ("uPlot.iife.min.js", "views.js", "trials.js", "angles.js", "trace.js")
"""In this order before the page's own; the first is uPlot 1.6.32 (MIT), as its authors publish it."""
SHEETS = ("uPlot.min.css", "desk.css")
_POLICY = (
    "default-src 'none'; connect-src 'self'; frame-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; script-src 'sha256-{}'"
)


def shell() -> Route:
    """The page itself with all of its style and its one script, which alone runs: nothing is loaded from elsewhere."""
    room = files("mocap.desk")
    html = room.joinpath("desk.html").read_bytes()
    for mark, names in ((b"<style>", SHEETS), (b"<script>", SCRIPTS)):
        html = html.replace(mark, mark + b"\n".join(room.joinpath(name).read_bytes() for name in names), 1)
    script = html.partition(b"<script>")[2].partition(b"</script>")[0]
    headers = {"Content-Security-Policy": _POLICY.format(b64encode(sha256(script).digest()).decode())}
    return Route("/", lambda _: Response(html, media_type="text/html", headers=headers))
