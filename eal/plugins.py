"""What other installed packages offer: entry points of a group, by name."""

import warnings
from importlib.metadata import entry_points
from typing import TypeVar

T = TypeVar("T")


def offered(group: str, kind: type[T]) -> dict[str, T]:
    """What is offered, by name; what cannot be imported, or is no such thing, is left out with a warning.

    Args:
        group: ``mocap.formats``, ``mocap.models``, ``mocap.views`` or ``eal.kernels``, as the package's pyproject.toml
            has them below ``[project.entry-points]``.
        kind: What each must be.
    """
    found = {}
    for point in entry_points(group=group):
        where = f"the package {'' if point.dist is None else point.dist.name!r} offers {point.name!r} to {group}"
        try:
            one = point.load()
        except Exception as error:  # whatever the package does: the others, and ours, still work
            warnings.warn(f"{where}, which cannot be imported: {type(error).__name__}: {error}", stacklevel=2)
            continue
        if isinstance(one, kind):
            found[point.name] = one
        else:
            warnings.warn(f"{where}, but it is {type(one).__name__}, expected {kind.__name__}", stacklevel=2)
    return found
