"""The page of the desk: each request has a schema, and is one call of the desk."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator
from starlette.applications import Starlette

from mocap.desk.desk import MEND, PASSED, Desk
from mocap.digitising.overlays import ClickAt, ExchangeOf, RangeOf, ShownAt, picture_route, scene_routes, shell
from mocap.web import Nothing, Query, below, changes, page, reads

_Text = Annotated[str, Field(max_length=500)]
_STATED = {(key, value) for key, ways in MEND.items() for _, value in ways}


class _Trial(Query):
    trial: _Text


class _Stated(_Trial):
    name: _Text
    value: bool | _Text

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.name != "skip" and (self.name, self.value) not in _STATED:
            raise ValueError(f"expected one of {sorted({key for key, _ in _STATED})} or skip, with a value of theirs")
        return self


class _Passed(_Trial):
    kind: Literal[*PASSED]  # pyright: ignore[reportInvalidTypeForm]


class _Curve(Query):
    name: _Text


class _Seen(Query):
    frame: Annotated[int, below("drawn_frames")]


_Point = Annotated[int, below("points")]


class _Drawn(Query):
    names: list[_Text]
    bones: list[tuple[_Point, _Point, bool]]
    trunk: list[_Point]
    joints: dict[_Text, tuple[_Point, _Point, _Point]]


def desk_page(desk: Desk) -> Starlette:
    """The page of a desk, for ``mocap.web.served``."""
    limits: dict[str, Any] = {"cameras": 0, "frames": 0, "markers": 0, "sizes": [], "points": 0, "drawn_frames": 0}

    def opened(given: _Trial) -> dict[str, Any]:
        info = desk.open(given.trial)
        limits.update(
            cameras=len(info["cameras"]), frames=info["n_frames"], markers=len(info["names"]), sizes=info["sizes"]
        )
        return info

    def picture(camera: int, frame: int) -> Any:
        films = desk.opened().films
        return None if films is None else films.picture(camera, frame)

    def draft(given: _Trial) -> dict[str, Any]:
        info = desk.draw(given.trial)
        limits.update(points=len(info["points"]), drawn_frames=info["n_frames"])
        return info

    def places(_: Nothing) -> list[dict[str, Any]]:
        return [{**vars(place), "worth_mm2": round(1e6 * place.worth_m2, 3)} for place in desk.opened().places()]

    def name(marker: int) -> str:
        return desk.opened().raw.names[marker]

    def place(at: ClickAt) -> str:
        where = {"camera": desk.opened().raw.camera_names[at.camera], "frame": at.frame + 1, "marker": name(at.marker)}
        what = {"what": "unseen"} if at.uv_px is None else {"what": "place", "uv_px": at.uv_px}
        return desk.opened().edit(**where, **what)

    def over(at: RangeOf, **what: str) -> str:
        return desk.opened().edit(marker=name(at.marker), frame=at.first + 1, last=at.last + 1, **what)

    return page(
        [
            shell("mocap.desk", "desk.html"),
            reads("/overview", Nothing, lambda _: desk.overview()),
            reads("/audit", _Trial, lambda given: desk.audit(given.trial)),
            reads("/open", _Trial, opened),
            reads("/progress", Nothing, lambda _: desk.progress()),
            reads("/frame", ShownAt, lambda at: desk.opened().frame(at.frame, at.marker)),
            reads("/places", Nothing, places),
            reads("/curve", _Curve, lambda given: desk.opened().curve(given.name)),
            picture_route(picture),
            *scene_routes(desk.scene),
            reads("/draft", _Trial, draft),
            reads("/drawn", Nothing, lambda _: desk.drawn()),
            reads("/points", _Seen, lambda at: desk.drawing().places(at.frame)),
            changes("/propose", _Drawn, lambda given: desk.drawing().propose(**dict(given))),
            changes("/mirror", _Drawn, lambda given: desk.drawing().mirror(**dict(given))),
            changes("/skeleton", _Drawn, lambda given: desk.keep_skeleton(**dict(given))),
            changes("/state", _Stated, lambda given: desk.state(given.trial, given.name, given.value)),
            changes("/track", Nothing, lambda _: desk.track()),
            changes("/stop", Nothing, lambda _: desk.stop()),
            changes("/place", ClickAt, place),
            changes("/exchange", ExchangeOf, lambda at: over(at, what="exchange", other=name(at.other))),
            changes("/delete", RangeOf, lambda at: over(at, what="delete")),
            changes("/undo", Nothing, lambda _: desk.opened().edit(what="undo")),
            changes("/settle", Nothing, lambda _: desk.opened().settle()),
            changes("/pass", _Passed, lambda given: desk.pass_on(given.trial, given.kind)),
        ],
        limits=limits,
    )
