"""What a page may ask for: each request has a schema, and every trouble is one line of JSON."""

import os
import reprlib
import traceback
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

Q = TypeVar("Q", bound="Query")


class Query(BaseModel):
    """What a request says: the names that are listed and no others, numbers as numbers, all of them finite."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


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

    async def endpoint(request: Request) -> Response:
        limits = request.app.state.limits
        if changes:
            given = query.model_validate_json(await request.body(), context=limits)
        else:
            given = query.model_validate_strings(dict(request.query_params), context=limits)
        return await run_sync(partial(work, given), limiter=request.app.state.limiter)

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


def _error_response(_: Request, error: Exception) -> Response:
    match error:
        case HTTPException():
            return JSONResponse({"said": error.detail}, error.status_code, headers=error.headers)
        case ValidationError():
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "request"
            expected = f"{where[:80]}: {first['msg']}, got {reprlib.repr(first['input'])}"
            return JSONResponse({"said": expected}, 400)
        case MocapError():
            return JSONResponse({"said": str(error)}, 409)
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{type(error).__name__} at {os.path.basename(last.filename)}:{last.lineno}"
    message = f"{where}: {str(error)[:300]}: this is an error in mocap, not in your data"
    return JSONResponse({"said": message}, 500)
