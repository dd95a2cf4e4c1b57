"""``mocap help``."""

import re
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.complete import pages
from mocap.cli.console import show
from mocap.errors import MocapError

ROOMS = ("tutorials", "howto", "howto/programs", "explanation", "reference")
_OF_THE_SITE = re.compile(r"^(`{3,})\{(image|toctree|eval-rst)\}.*?^\1$\n?", re.MULTILINE | re.DOTALL)
"""What only the site shows: images, lists of pages, signatures."""


def help_(
    topic: Annotated[
        str | None, typer.Argument(help="Page, as errors name it; none: a list of them.", autocompletion=pages)
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


def topics() -> dict[str, str]:
    """The pages of the manual, in Markdown, by name."""
    package = Path(__file__).parents[1]
    pages = package / "pages"
    folder = pages if pages.is_dir() else package.parent / "docs"  # installed, or in the repository
    files = [file for room in ROOMS for file in sorted((folder / room).glob("*.md")) if file.stem != "index"]
    return {file.stem: file.read_text(encoding="utf-8") for file in files}


def _title(text: str) -> str:
    return next(line for line in text.splitlines() if line.startswith("# "))[2:]
