"""What a shell offers after Tab, beside commands and options: joints, markers, sheets, recordings, pages, formats.

Each function takes what typer gives: the words before, read as far as they go, and the beginning of the word at the
cursor. A file that cannot be read offers nothing: a shell has no place for errors.
"""

import tomllib
from collections.abc import Callable, Iterable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any

import typer

Offers = Callable[[typer.Context, str], Iterable[str]]
DEPTH = 3
"""Folders below a folder of results in which a skeleton is looked for."""


def _quiet(offers: Offers) -> Callable[[typer.Context, str], list[str]]:
    """Those that begin as the word at the cursor does; none where anything goes wrong."""

    @wraps(offers)
    def offered(ctx: typer.Context, incomplete: str) -> list[str]:
        try:
            return [name for name in offers(ctx, incomplete) if name.startswith(incomplete)]
        except Exception:  # whatever a file holds
            return []

    return offered


def _arguments(ctx: typer.Context) -> list[Path]:
    """Words that are no options: typer has not read them yet where the last option still wants its value."""
    return [Path(word) for word in ctx.args]


def _skeletons(ctx: typer.Context) -> Iterator[dict[str, Any]]:
    """Of the options, else of the folders of results among the arguments."""
    given = ctx.params.get("skeleton")
    if given is not None:
        yield tomllib.loads(Path(given).read_text(encoding="utf-8"))
        return
    for place in _arguments(ctx):
        levels = (place.glob("*/" * depth + "skeleton.toml") for depth in range(DEPTH + 1))
        found = next((path for level in levels for path in level), None)
        if found is not None:
            yield tomllib.loads(found.read_text(encoding="utf-8"))


@_quiet
def joints(ctx: typer.Context, incomplete: str) -> Iterator[str]:
    """Of the results; after a comma the second one; of a model, which has no joints, three markers."""
    before = incomplete[: incomplete.rfind(",") + 1]
    for skeleton in _skeletons(ctx):
        yield from (before + name for name in skeleton.get("joints", {}))
    for model in _arguments(ctx):
        if model.suffix == ".npz":
            yield from _markers(model, before)


def _markers(model: Path, before: str) -> Iterator[str]:
    """Those that are not named yet, after what is typed."""
    import numpy as np

    with np.load(model, allow_pickle=False) as stored:
        names = stored["names"].tolist()
    yield from (f"{before}{name}" for name in names if name not in before.split(","))


@_quiet
def sheets(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Tabs of the Excel files among the arguments."""
    from openpyxl import load_workbook

    for path in _arguments(ctx):
        if path.suffix in (".xlsx", ".xlsm"):
            book = load_workbook(path, read_only=True)
            yield from book.sheetnames
            book.close()


@_quiet
def made(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Simulated animals, and what else ``mocap data make`` makes."""
    from mocap.datasets.catalogue import ENTRIES

    yield from (entry.name for entry in ENTRIES)


@_quiet
def real(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Real recordings that are there."""
    from mocap.datasets.real import REAL, folder

    yield from (one.name for one in REAL if (folder() / one.name).is_dir())


@_quiet
def pages(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Of the manual."""
    from mocap.manual import topics

    yield from topics()


@_quiet
def models(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Models of motion by name, and files of models."""
    from mocap.tracking.track_part import MODELS

    yield from MODELS
    start = Path(incomplete)
    folder = start if incomplete.endswith("/") else start.parent
    yield from (str(path) for path in sorted(folder.glob("*.npz")))


@_quiet
def read_formats(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Formats that are read."""
    from mocap.io.registry import formats

    yield from (one.name for one in formats())


@_quiet
def exports(ctx: typer.Context, incomplete: str) -> Iterator[str]:  # noqa: ARG001
    """Programs that a result is written for."""
    from mocap.results.exports import EXPORTS

    yield from EXPORTS
