"""What a shell is offered for an option or an argument, by name; ``mocap.cli.complete`` is loaded where one asks."""

from collections.abc import Callable
from importlib import import_module

import typer


def offered(name: str) -> Callable[[typer.Context, str], list[str]]:
    """The completion of that name in ``mocap.cli.complete``, which reads files and loads much."""

    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        return getattr(import_module("mocap.cli.complete"), name)(ctx, incomplete)

    return complete
