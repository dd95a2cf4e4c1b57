"""Packages that only some parts need, installed as extras."""

from importlib.util import find_spec


class MissingPackageError(ImportError):
    """A package of an extra is not installed."""

    @classmethod
    def of(cls, what: str, extra: str, *packages: str) -> "MissingPackageError":
        """What needs which packages, and how to install them."""
        return cls(f"{what} needs {', '.join(packages)}, not installed here: run pip install 'eal-mocap[{extra}]'")


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
