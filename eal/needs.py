"""Packages that only some parts need, installed as extras."""

import json
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit


class MissingPackageError(ImportError):
    """A package of an extra is not installed."""

    @classmethod
    def of(cls, what: str, extra: str, *packages: str) -> "MissingPackageError":
        """What needs which packages, and how to install them."""
        return cls(f"{what} needs {', '.join(packages)}, not installed here: run {installing(extra)}")


@cache
def installing(extra: str) -> str:
    """The command that installs an extra: from the clone or wheel that this program came from, else from an index.

    As pip notes it (PEP 610, ``direct_url.json``).
    """
    from urllib.request import url2pathname  # 35 ms, for a message

    try:
        told = json.loads(distribution("eal-mocap").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):  # on a search path alone; damaged
        told = {}
    url = urlsplit(told.get("url", ""))
    source = Path(url2pathname(url.path)) if url.scheme == "file" else None
    editable = "--editable " if told.get("dir_info", {}).get("editable") else ""
    if source is None or not source.exists():
        return f"pip install 'eal-mocap[{extra}]'"
    return f"pip install {editable}'{source}[{extra}]'"


def needs(what: str, extra: str, *packages: str) -> None:
    """Say clearly what to install before a part that needs it is imported.

    Args:
        what: Needs it.
        extra: Of this project.
        packages: As they are imported.

    Raises:
        MissingPackageError: one of them is not installed.
    """
    absent = [package for package in packages if find_spec(package) is None]
    if absent:
        raise MissingPackageError.of(what, extra, *absent)
