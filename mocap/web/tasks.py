"""What a page may ask for: each request has a schema, and every trouble is one line of JSON."""

import reprlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError, ValidationInfo
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from mocap.errors import MocapError
from mocap.trouble import trouble_of

Q = TypeVar("Q", bound="Query")


class Query(BaseModel):
    """What a request says: the names that are listed and no others, numbers as numbers, all of them finite."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def look(cls, given: bytes | dict[str, str], limits: Any) -> None:
        """Refuse, before the schema does, what makes all that a request says mean something else; here nothing does.

        Args:
            given: The JSON that came, or parameters.
            limits: What the page was given as ``limits``.
        """


class Elsewhere(MocapError):
    """A request of a page that shows what is no longer so: something else was opened, or changed, in another one."""

    def __init__(self) -> None:
        """With what to do."""
        super().__init__("opened elsewhere: reload")


class Nothing(Query):
    """Of what is asked for without anything else."""


def limits_of(info: ValidationInfo) -> Mapping[str, Any]:
    """What the page was given as ``limits``."""
    return info.context or {}


def below(name: str) -> AfterValidator:
    """A number from 0 to below the limit of that name."""

    def check(value: int, info: ValidationInfo) -> int:
        limit = limits_of(info)[name]
        if not 0 <= value < limit:
            raise ValueError(f"expected a number of the {limit} {name}, from 0")
        return value

    return AfterValidator(check)


def task(path: str, query: type[Q], work: Callable[[Q], Response], *, changes: bool = False) -> Route:
    """A route to what a page can do; in a thread, one after the other.

    Args:
        path: Below the address of the page.
        query: Schema of the request: of the address's parameters, or of the JSON of what ``changes`` something.
        work: Answers.
        changes: Taken as POST, otherwise as GET.
    """

    def answered(given: bytes | dict[str, str], limits: Any) -> Response:
        # beside the work, as what is checked here is as the work finds it
        check = query.model_validate_json if isinstance(given, bytes) else query.model_validate_strings
        try:
            query.look(given, limits)
            return work(check(given, context=limits))  # type: ignore[arg-type]
        except SystemExit as stop:  # of a plug-in; it would end the server, and not the program
            return _error_response(None, stop)

    async def endpoint(request: Request) -> Response:
        given = await request.body() if changes else dict(request.query_params)
        state = request.app.state
        return await run_sync(partial(answered, given, state.limits), limiter=state.limiter)

    return Route(path, endpoint, methods=["POST" if changes else "GET"])


def reads(path: str, query: type[Q], work: Callable[[Q], Any]) -> Route:
    """A route to something that is looked at, as JSON."""
    return task(path, query, lambda given: JSONResponse(work(given)))


def changes(path: str, query: type[Q], work: Callable[[Q], str]) -> Route:
    """A route to something that changes, and says in a line what it did."""
    return task(path, query, lambda given: JSONResponse({"said": work(given)}), changes=True)


def page(routes: Sequence[Route], *, limits: Mapping[str, Any] | None = None) -> Starlette:
    """An application whose errors are one line each.

    Args:
        routes: Of its tasks.
        limits: What ``below`` and other validators look up, as it is at each request.
    """
    kinds = (ValidationError, MocapError, HTTPException, Exception)
    app = Starlette(routes=routes, exception_handlers=dict.fromkeys(kinds, _error_response))
    app.router.redirect_slashes = False
    app.state.limiter, app.state.limits = CapacityLimiter(1), limits
    return app


def _error_response(_: Request | None, error: BaseException) -> Response:
    match error:
        case HTTPException():
            return JSONResponse({"said": error.detail}, error.status_code, headers=error.headers)
        case ValidationError():
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "request"
            expected = f"{where[:80]}: {first['msg']}, got {reprlib.repr(first['input'])}"
            return JSONResponse({"said": expected}, 400)
        case Elsewhere():
            return JSONResponse({"said": str(error), "reload": True}, 409)
    trouble = trouble_of(error)
    return JSONResponse({"said": trouble.text}, 500 if trouble.fault else 409)
