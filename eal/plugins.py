"""What other installed packages offer: entry points of a group, by name."""

import warnings
from importlib.metadata import EntryPoint, entry_points
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
        try:
            one = point.load()
            fits = isinstance(one, kind)
        except KeyboardInterrupt:  # a person's, not the package's
            raise
        except BaseException as error:  # whatever the package does, sys.exit included: the others, and ours, still work
            _left_out(point, f"which cannot be imported: {described(error)}")
            continue
        if fits:
            found[point.name] = one
        else:
            _left_out(point, f"but it is {type(one).__name__}, expected {kind.__name__}")
    return found


def left_out(group: str, name: str, why: str) -> None:
    """Warn that what another package offers by a name is not used, and why, in one line."""
    for point in entry_points(group=group, name=name):
        _left_out(point, why)


def described(error: BaseException) -> str:
    """The kind of an error and what it says, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")


def _left_out(point: EntryPoint, why: str) -> None:
    package = "" if point.dist is None else point.dist.name
    text = f"the package {package!r} offers {point.name!r} to {point.group}, {why}: it is left out"
    # in the name of its module, of which no line is shown: the warning is one line
    warnings.warn_explicit(text, UserWarning, filename=point.module, lineno=1)
