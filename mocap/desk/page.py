"""The page of the desk: each request has a schema, and is one call of the desk."""

import json
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import cv2
import numpy as np
from pydantic import Field, ValidationInfo, model_validator
from starlette.applications import Starlette
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from mocap.desk.desk import MEND, PASSED, Desk
from mocap.desk.shell import shell
from mocap.web.tasks import Elsewhere, Nothing, Query, below, changes, limits_of, page, reads, task

_VIEWER_POLICY = "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; frame-ancestors 'self'"

_Text = Annotated[str, Field(max_length=500)]
_Frame = Annotated[int, below("frames")]
_Marker = Annotated[int, below("markers")]
_Point = Annotated[int, below("points")]
_STATED = {(key, value) for key, ways in MEND.items() for _, value in ways if value is not None}
_TYPED = {key for key, ways in MEND.items() if any(value is None for _, value in ways)}


W = TypeVar("W", bound="_Writes")


class _Trial(Query):
    trial: _Text


class _Of(Query):
    """What a page asks of a trial that it shows: it shows what is open here (``Desk.is_seen``).

    That comes before anything else, as numbers of another trial's markers and frames mean something else.
    """

    trial: _Text | None = None
    _place: ClassVar[str] = "proof"
    _writes: ClassVar[bool] = False

    @classmethod
    def look(cls, given: bytes | dict[str, str], limits: Mapping[str, Any]) -> None:
        """Refuse a request of a page that does not show what is open here."""
        try:
            of = json.loads(given) if isinstance(given, bytes) else given
        except (ValueError, RecursionError):  # which its schema refuses
            return
        trial, edits = (of.get("trial"), of.get("edits")) if isinstance(of, dict) else (None, None)
        if not isinstance(trial, str | None) or type(edits) not in (int, type(None)):
            return
        if cls._writes and (trial is None or edits is None):
            raise Elsewhere
        if trial is not None and not limits["is_seen"](cls._place, trial, edits if cls._writes else None):
            raise Elsewhere


class _Writes(_Of):
    """What a page changes of it: it has seen all edits."""

    edits: int | None = None
    _writes: ClassVar[bool] = True


class _WritesTrial(_Writes):
    _place: ClassVar[str] = "trials"


class _Answer(_WritesTrial):
    name: _Text
    value: bool | _Text | Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)]

    @model_validator(mode="after")
    def _is_one_of_ours(self) -> Self:
        typed = isinstance(self.value, float)
        known = self.name in _TYPED if typed else self.name == "skip" or (self.name, self.value) in _STATED
        if not known:
            names = sorted({*_TYPED, *(key for key, _ in _STATED)})
            raise ValueError(f"expected one of {names} or skip, with a value of theirs")
        return self


class _Passed(_WritesTrial):
    kind: Literal[*PASSED]  # pyright: ignore[reportInvalidTypeForm]


class _Stopped(Query):
    trial: _Text = ""


class _Named(_Of):
    name: _Text


class _Picture(_Of):
    camera: Annotated[int, below("cameras")]
    frame: _Frame


class _Shown(_Of):
    frame: _Frame
    marker: _Marker


class _Range(_Writes):
    marker: _Marker
    first: _Frame
    last: _Frame


class _Exchange(_Range):
    other: _Marker


class _Click(_Writes):
    camera: Annotated[int, below("cameras")]
    frame: _Frame
    marker: _Marker
    uv_px: tuple[float, float] | None
    snap: bool = False

    @model_validator(mode="after")
    def _in_the_picture(self, info: ValidationInfo) -> Self:
        size = limits_of(info)["sizes"][self.camera]
        # the centre of the first pixel is at (1, 1)
        if self.uv_px is not None and not all(0.5 <= x <= n + 0.5 for x, n in zip(self.uv_px, size, strict=True)):
            raise ValueError(f"expected a place in the image of {size[0]:g} x {size[1]:g} px")
        return self


class _Seen(_Of):
    _place: ClassVar[str] = "draft"
    frame: Annotated[int, below("drawn_frames")]
    camera: Annotated[int, below("drawn_cameras")] | None = None


class _Drawn(_Writes):
    _place: ClassVar[str] = "draft"
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
    limits: dict[str, Any] = {**dict.fromkeys(counts, 0), "sizes": [], "is_seen": desk.is_seen}

    def opened(given: _Trial) -> dict[str, Any]:
        info = desk.open(given.trial)
        limits.update(
            cameras=len(info["cameras"]), frames=info["n_frames"], markers=len(info["names"]), sizes=info["sizes"]
        )
        return info | {"seen": desk.seen(info["trial"])}

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
        return info | {"seen": desk.seen(given.trial)}

    def drawing(work: Callable[..., str]) -> Callable[[_Drawn], str]:
        def drawn(given: _Drawn) -> str:
            said = work(**_own(given))
            desk.stated(desk.drawing().trial)
            return said

        return drawn

    def writes(path: str, query: type[W], work: Callable[[W], str]) -> Route:
        def answered(given: W) -> Response:
            said, trial = work(given), given.trial or ""
            return JSONResponse({"said": said, "seen": {name: desk.seen(name) for name in ("", trial)}})

        return task(path, query, answered, changes=True)

    def places(_: _Of) -> list[dict[str, Any]]:
        return [{**vars(place), "worth_mm2": round(1e6 * place.worth_m2, 3)} for place in desk.opened().places()]

    if desk.proof is not None:
        opened(_Trial(trial=""))
    return page(
        [
            shell(),
            reads("/overview", Nothing, lambda _: desk.overview()),
            reads("/audit", _Trial, lambda given: desk.audit(given.trial)),
            reads("/open", _Trial, opened),
            reads("/progress", Nothing, lambda _: desk.progress()),
            reads("/frame", _Shown, lambda at: desk.opened().frame(at.frame, at.marker)),
            reads("/around", _Shown, lambda at: desk.tracked().around(at.frame, at.marker)),
            reads("/places", _Of, places),
            reads("/curve", _Named, lambda given: desk.tracked().curve(given.name)),
            reads("/way", _Named, lambda given: desk.tracked().way(given.name)),
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
            writes("/propose", _Drawn, drawing(lambda **drawn: desk.drawing().propose(**drawn))),
            writes("/measure", _Drawn, drawing(lambda **drawn: desk.drawing().measure(**drawn))),
            writes("/mirror", _Drawn, drawing(lambda **drawn: desk.drawing().mirror(**drawn))),
            writes("/skeleton", _Drawn, lambda given: desk.keep_skeleton(**_own(given))),
            writes("/state", _Answer, lambda given: desk.state(given.trial or "", given.name, given.value)),
            writes("/track", _WritesTrial, lambda _: desk.track()),
            changes("/stop", _Stopped, lambda given: desk.stop_one(given.trial) if given.trial else desk.stop()),
            writes("/find", _Writes, lambda _: desk.session().run()),
            writes("/place", _Click, lambda at: desk.opened().place(**_own(at))),
            writes("/exchange", _Exchange, lambda at: desk.opened().exchange(**_own(at))),
            writes("/delete", _Range, lambda at: desk.opened().delete(**_own(at))),
            writes("/undo", _Writes, lambda _: desk.opened().undo()),
            writes("/settle", _Writes, lambda _: desk.opened().settle()),
            writes("/pass", _Passed, lambda given: desk.pass_on(given.trial or "", given.kind)),
        ],
        limits=limits,
    )


def _own(given: _Writes) -> dict[str, Any]:
    """What a request says but of what the page has seen."""
    return {name: value for name, value in given if name not in ("trial", "edits")}


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
