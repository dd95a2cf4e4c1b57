"""The packages installed beside ``mocap``: ``eal``, ``filters`` and ``datasets``, whose names others use too."""

from importlib.util import find_spec
from pathlib import Path

MARK = "eal-mocap"
"""Stands in the first lines of each of them."""
PACKAGES = ("eal", "filters", "datasets")


class NeighbourError(ImportError):
    """Another distribution's package stands where ours should."""


def check_neighbours(packages: tuple[str, ...] = PACKAGES) -> None:
    """Make sure that Python finds our packages and not another distribution's of the same name.

    Raises:
        NeighbourError: it does not; with what to do.
    """
    for name in packages:
        spec = find_spec(name)
        origin = None if spec is None else spec.origin
        if origin is None or not Path(origin).is_file() or MARK not in Path(origin).read_text(encoding="utf-8")[:200]:
            raise NeighbourError(
                f"the package {name!r} that Python finds ({origin or 'none'}) is not eal-mocap's: another "
                "distribution uses that name, or the current folder contains a folder of that name; install "
                "eal-mocap in its own environment (python -m venv), or start in another folder"
            )
