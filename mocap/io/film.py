"""PyAV, which reads and codes films; an extra, as its wheel holds coders under the GPL: LICENCES.md."""

from types import ModuleType

from mocap.errors import MocapError


class FilmError(MocapError):
    """Films cannot be read or written here."""

    page = "installing"


def pyav() -> ModuleType:
    """The library, imported when a film is first asked for.

    Raises:
        FilmError: it is not installed.
    """
    try:
        import av
        import av.error
    except ImportError:
        raise FilmError(
            "films need PyAV, which is not installed: run pip install 'eal-mocap[film]', or leave the films out"
        ) from None
    return av
