"""The page of the desk: each request has a schema, and is one call of the desk."""

from base64 import b64encode
from collections.abc import Callable
from hashlib import sha256
from http import HTTPStatus
from importlib.resources import files
from typing import Annotated, Any, Literal, Self

import cv2
import numpy as np
from pydantic import Field, ValidationInfo, model_validator
from starlette.applications import Starlette
from starlette.responses import Response
from starlette.routing import Route

from mocap.desk.desk import MEND, PASSED, Desk
from mocap.web.tasks import Nothing, Query, below, changes, limits_of, page, reads, task

_POLICY = (
    "default-src 'none'; connect-src 'self'; frame-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; script-src 'sha256-{}'"
)
_VIEWER_POLICY = "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'self'"

_Text = Annotated[str, Field(max_length=500)]
_Frame = Annotated[int, below("frames")]
_Marker = Annotated[int, below("markers")]
_Point = Annotated[int, below("points")]
_STATED = {(key, value) for key, ways in MEND.items() for _, value in ways}


class _Trial(Query):
    trial: _Text


class _Answer(_Trial):
    name: _Text
    value: bool | _Text

    @model_validator(mode="after")
    def _is_one_of_ours(self) -> Self:
        if self.name != "skip" and (self.name, self.value) not in _STATED:
            raise ValueError(f"expected one of {sorted({key for key, _ in _STATED})} or skip, with a value of theirs")
        return self


class _Passed(_Trial):
    kind: Literal[*PASSED]  # pyright: ignore[reportInvalidTypeForm]


class _Named(Query):
    name: _Text


class _Picture(Query):
    camera: Annotated[int, below("cameras")]
    frame: _Frame


class _Shown(Query):
    frame: _Frame
    marker: _Marker


class _Range(Query):
    marker: _Marker
    first: _Frame
    last: _Frame


class _Exchange(_Range):
    other: _Marker


class _Click(_Picture):
    marker: _Marker
    uv_px: tuple[float, float] | None

    @model_validator(mode="after")
    def _in_the_picture(self, info: ValidationInfo) -> Self:
        size = limits_of(info)["sizes"][self.camera]
        # the centre of the first pixel is at (1, 1)
        if self.uv_px is not None and not all(0.5 <= x <= n + 0.5 for x, n in zip(self.uv_px, size, strict=True)):
            raise ValueError(f"expected a place in the image of {size[0]:g} x {size[1]:g} px")
        return self


class _Seen(Query):
    frame: Annotated[int, below("drawn_frames")]
    camera: Annotated[int, below("drawn_cameras")] | None = None


class _Drawn(Query):
    names: list[_Text]
    bones: list[tuple[_Point, _Point, bool]]
    trunk: list[_Point]
    joints: dict[_Text, tuple[_Point, _Point, _Point]]
    dropped: list[tuple[_Text, _Text]]


class _File(Query):
    renderer: Literal["webgl", "webgpu"] = "webgpu"


def desk_page(desk: Desk) -> Starlette:
    """The page of a desk, for ``mocap.web.served``."""
    counts = ("cameras", "frames", "markers", "points", "drawn_frames", "drawn_cameras")
    limits: dict[str, Any] = {**dict.fromkeys(counts, 0), "sizes": []}

    def opened(given: _Trial) -> dict[str, Any]:
        info = desk.open(given.trial)
        limits.update(
            cameras=len(info["cameras"]), frames=info["n_frames"], markers=len(info["names"]), sizes=info["sizes"]
        )
        return info

    def picture(at: _Picture) -> Response:
        found = desk.opened().picture(at.camera, at.frame)
        return Response(status_code=HTTPStatus.NOT_FOUND) if found is None else _png(found)

    def sketched(at: _Seen) -> Response:
        pictures = desk.drawing().pictures
        found = None if pictures is None or at.camera is None else pictures.picture(at.camera, at.frame)
        return Response(status_code=HTTPStatus.NOT_FOUND) if found is None else _png(found)

    def draft(given: _Trial) -> dict[str, Any]:
        info = desk.draw(given.trial)
        limits.update(points=len(info["points"]), drawn_frames=info["n_frames"], drawn_cameras=len(info["cameras"]))
        return info

    def places(_: Nothing) -> list[dict[str, Any]]:
        return [{**vars(place), "worth_mm2": round(1e6 * place.worth_m2, 3)} for place in desk.opened().places()]

    if desk.proof is not None:
        opened(_Trial(trial=""))
    return page(
        [
            _shell(),
            reads("/overview", Nothing, lambda _: desk.overview()),
            reads("/audit", _Trial, lambda given: desk.audit(given.trial)),
            reads("/open", _Trial, opened),
            reads("/progress", Nothing, lambda _: desk.progress()),
            reads("/frame", _Shown, lambda at: desk.opened().frame(at.frame, at.marker)),
            reads("/places", Nothing, places),
            reads("/curve", _Named, lambda given: desk.tracked().curve(given.name)),
            task(
                "/potential",
                _Named,
                lambda given: Response(desk.tracked().potential(given.name), 200, None, "image/png"),
            ),
            task("/picture", _Picture, picture),
            *_scene_routes(lambda: desk.opened().scene()),
            reads("/draft", _Trial, draft),
            reads("/drawn", Nothing, lambda _: desk.drawn()),
            reads("/points", _Seen, lambda at: desk.drawing().places(at.frame, at.camera)),
            task("/sketch", _Seen, sketched),
            changes("/propose", _Drawn, lambda given: desk.drawing().propose(**dict(given))),
            changes("/mirror", _Drawn, lambda given: desk.drawing().mirror(**dict(given))),
            changes("/skeleton", _Drawn, lambda given: desk.keep_skeleton(**dict(given))),
            changes("/state", _Answer, lambda given: desk.state(given.trial, given.name, given.value)),
            changes("/track", Nothing, lambda _: desk.track()),
            changes("/stop", Nothing, lambda _: desk.stop()),
            changes("/find", Nothing, lambda _: desk.session().run()),
            changes("/place", _Click, lambda at: desk.opened().place(**dict(at))),
            changes("/exchange", _Exchange, lambda at: desk.opened().exchange(**dict(at))),
            changes("/delete", _Range, lambda at: desk.opened().delete(**dict(at))),
            changes("/undo", Nothing, lambda _: desk.opened().undo()),
            changes("/settle", Nothing, lambda _: desk.opened().settle()),
            changes("/pass", _Passed, lambda given: desk.pass_on(given.trial, given.kind)),
        ],
        limits=limits,
    )


def _shell() -> Route:
    """The page itself, whose one script begins with that of images (``views.js``), and alone runs."""
    room = files("mocap.desk")
    html = (
        room.joinpath("desk.html")
        .read_bytes()
        .replace(b"<script>", b"<script>" + room.joinpath("views.js").read_bytes())
    )
    script = html.partition(b"<script>")[2].partition(b"</script>")[0]
    headers = {"Content-Security-Policy": _POLICY.format(b64encode(sha256(script).digest()).decode())}
    return Route("/", lambda _: Response(html, media_type="text/html", headers=headers))


def _png(picture: Any) -> Response:
    """Grey levels as PNG of 8 bits."""
    if picture.dtype == np.uint16:
        picture = cv2.normalize(picture, np.empty(0), 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    content = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    return Response(content, media_type="image/png")


def _scene_routes(recording: Callable[[], bytes]) -> list[Route]:
    """Routes to rerun's web viewer, which our page frames and whose page may ask this server alone."""

    def viewer(name: str, kind: str) -> Route:
        def work(_: _File) -> Response:
            from mocap.rerun.record import viewer_files

            headers = {"Content-Security-Policy": _VIEWER_POLICY, "X-Frame-Options": "SAMEORIGIN"}
            return Response(viewer_files("points.rrd")[name], media_type=kind, headers=headers)

        return task(f"/scene/{name}", _File, work)

    return [
        task("/scene/points.rrd", Nothing, lambda _: Response(recording())),
        viewer("", "text/html"),
        viewer("re_viewer.js", "text/javascript"),
        viewer("re_viewer_bg.wasm", "application/wasm"),
    ]
