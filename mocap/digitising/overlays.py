"""What is drawn over pictures of cameras, and asked of them: the page of clicks and the desk share it."""

from base64 import b64encode
from collections.abc import Callable, Sequence
from hashlib import sha256
from http import HTTPStatus
from importlib.resources import files
from typing import Annotated, Any, Literal, Self

import cv2
import numpy as np
from pydantic import ValidationInfo, model_validator
from starlette.responses import Response
from starlette.routing import Route

from eal.arrays import Array
from mocap.digitising.naming import seen_from
from mocap.web import Nothing, Query, below, limits_of, task

_POLICY = (
    "default-src 'none'; connect-src 'self'; frame-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; script-src 'sha256-{}'"
)
_VIEWER_POLICY = "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'self'"
_REACH = 2.4477  # root of the chi-square of two degrees of freedom that 95 % stay below

Shown = Callable[[int, Array], Array]
"""(N, 2) ideal pixels of a camera as its picture shows them."""


class SeenAt(Query):
    """A camera's picture."""

    camera: Annotated[int, below("cameras")]
    frame: Annotated[int, below("frames")]


class ShownAt(Query):
    """A frame with a marker chosen."""

    frame: Annotated[int, below("frames")]
    marker: Annotated[int, below("markers")]


class RangeOf(Query):
    """Frames of a marker, ends included."""

    marker: Annotated[int, below("markers")]
    first: Annotated[int, below("frames")]
    last: Annotated[int, below("frames")]


class ExchangeOf(RangeOf):
    """Frames in which two markers bear each other's names."""

    other: Annotated[int, below("markers")]


class ClickAt(SeenAt):
    """A place in a picture; None: not to be seen there."""

    marker: Annotated[int, below("markers")]
    uv_px: tuple[float, float] | None

    @model_validator(mode="after")
    def _in_the_picture(self, info: ValidationInfo) -> Self:
        size = limits_of(info)["sizes"][self.camera]
        # the centre of the first pixel is at (1, 1)
        if self.uv_px is not None and not all(0.5 <= x <= n + 0.5 for x, n in zip(self.uv_px, size, strict=True)):
            raise ValueError(f"expected a place in the picture of {size[0]:g} x {size[1]:g} px")
        return self


def ellipses(matrices: Array, xyz_m: Array, cov_m2: Array, shown: Shown, *, y_up: bool = False) -> Array:
    """(C, M, 5) centre, half axes and angle of the 95 % ellipses of where pictures show markers.

    Args:
        matrices: (C, 3, 4) projections.
        xyz_m: (M, 3) positions.
        cov_m2: (M, 3, 3) their covariances.
        shown: Ideal pixels as pictures show them.
        y_up: Whether ideal pixels are counted from the lower left.
    """
    uv, jacobian = seen_from(matrices, xyz_m)
    jacobian = jacobian * np.array([1.0, -1.0 if y_up else 1.0])[:, None]
    s = jacobian @ cov_m2 @ np.swapaxes(jacobian, -1, -2)
    out = np.full((*uv.shape[:2], 5), np.nan)
    for c, m in np.argwhere(np.isfinite(s).all(axis=(-1, -2))):
        values, vectors = np.linalg.eigh(s[c, m])
        axes = _REACH * np.sqrt(np.maximum(values[::-1], 0))
        out[c, m, 2:] = *axes, np.arctan2(vectors[1, 1], vectors[0, 1])
    for c in range(len(matrices)):
        out[c, :, :2] = shown(c, uv[c])
    return out


def epipolar_lines(
    matrices: Array, ideal_px: Array, sizes_px: Sequence[Sequence[float]], shown: Shown
) -> list[list[list[list[float]]]]:
    """For each camera the lines on which a marker lies by its place in each of the others, as pictures bend them.

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, 2) ideal pixels of the marker; NaN where it was not digitised.
        sizes_px: Width and height of each picture.
        shown: Ideal pixels as pictures show them.
    """
    out: list[list[list[list[float]]]] = [[] for _ in matrices]
    for a in np.flatnonzero(np.isfinite(ideal_px[:, 0])).tolist():
        inverse = np.linalg.inv(matrices[a, :, :3])
        eye, along = -inverse @ matrices[a, :, 3], inverse @ np.append(ideal_px[a], 1.0)
        # depths of one camera's ray from near to far
        reach = max(float(np.linalg.norm(eye)), 1e-3)
        points = eye + np.geomspace(0.05, 20, 200)[:, None] * reach * along / np.linalg.norm(along)
        uv, _ = seen_from(matrices, points)
        for b, (width, height) in enumerate(sizes_px):
            near = (np.abs(uv[b] - (width / 2, height / 2)) < (width, height)).all(axis=1)
            line = shown(b, uv[b][near])
            if b != a and len(line) > 1:
                out[b].append(np.round(line, 2).tolist())
    return out


def listed(values: Array) -> list[float] | None:
    """Numbers for a script; None: there are none."""
    return np.round(values, 3).tolist() if np.isfinite(values).all() else None


def png(picture: Any) -> bytes:
    """Grey levels as PNG of 8 bits."""
    if picture.dtype == np.uint16:
        picture = cv2.normalize(picture, np.empty(0), 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    return cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


def shell(room: str, name: str) -> Route:
    """The route to a page of ours whose ``<script>`` begins with the common one (``views.js``), and that alone runs.

    Args:
        room: Package that holds it.
        name: Its file.
    """
    common = files("mocap.digitising").joinpath("views.js").read_bytes()
    html = files(room).joinpath(name).read_bytes().replace(b"<script>", b"<script>" + common)
    script = html.partition(b"<script>")[2].partition(b"</script>")[0]
    policy = _POLICY.format(b64encode(sha256(script).digest()).decode())
    headers = {"Content-Security-Policy": policy}
    return Route("/", lambda _: Response(html, media_type="text/html", headers=headers))


def picture_route(find: Callable[[int, int], Any]) -> Route:
    """The route to pictures of films.

    Args:
        find: The picture of a camera in a frame; None: there is none.
    """

    def work(seen: SeenAt) -> Response:
        found = find(seen.camera, seen.frame)
        if found is None:
            return Response(status_code=HTTPStatus.NOT_FOUND)
        return Response(png(found), media_type="image/png")

    return task("/picture", SeenAt, work)


class _File(Query):
    renderer: Literal["webgl", "webgpu"] = "webgpu"


def scene_routes(recording: Callable[[], bytes]) -> list[Route]:
    """Routes to rerun's web viewer, which our page frames and whose page may ask this server alone.

    Args:
        recording: Gives what it shows, as a file of rerun.
    """

    def viewer(name: str, kind: str) -> Route:
        def work(_: _File) -> Response:
            from mocap.rerun.points import viewer_files

            headers = {"Content-Security-Policy": _VIEWER_POLICY, "X-Frame-Options": "SAMEORIGIN"}
            return Response(viewer_files("points.rrd")[name], media_type=kind, headers=headers)

        return task(f"/scene/{name}", _File, work)

    return [
        task("/scene/points.rrd", Nothing, lambda _: Response(recording())),
        viewer("", "text/html"),
        viewer("re_viewer.js", "text/javascript"),
        viewer("re_viewer_bg.wasm", "application/wasm"),
    ]
