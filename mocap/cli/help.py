"""``mocap help``."""

import re
from typing import Annotated

import typer

from mocap.cli.console import show
from mocap.cli.offered import offered
from mocap.errors import MocapError
from mocap.manual import topics

_OF_THE_SITE = re.compile(r"^(`{3,})\{(image|toctree|eval-rst)\}.*?^\1$\n?", re.MULTILINE | re.DOTALL)
"""What only the site shows: images, lists of pages, signatures."""


def help_(
    topic: Annotated[
        str | None,
        typer.Argument(help="Page, as errors name it; none: a list of them.", autocompletion=offered("pages")),
    ] = None,
) -> None:
    """Print a page of the manual.

    Raises:
        MocapError: there is no such page.
    """
    found = topics()
    if topic is None:
        show("\n".join(f"- {name}: {_title(text)}" for name, text in found.items()))
    elif topic in found:
        show(_OF_THE_SITE.sub("", found[topic]))
    else:
        raise MocapError(f"`topic` {topic}: there is no such page: mocap help lists them")


def _title(text: str) -> str:
    return next(line for line in text.splitlines() if line.startswith("# "))[2:]
