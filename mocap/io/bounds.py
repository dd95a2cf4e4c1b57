"""How much a file of a size may hold: what is more is refused before it is unpacked."""

from pathlib import Path

from mocap.errors import FormatError

LEAST = 1 << 29
"""Bytes that any file may hold: an hour of 20 markers at 250 Hz, with their covariances."""
TIMES = 100
"""Times its own size that a larger file may hold; compressed recordings of noise hold 1 to 3 times, empty ones 50."""


def most_bytes(path: Path) -> int:
    """Bytes that what a file holds may take unpacked."""
    return max(LEAST, TIMES * path.stat().st_size)


def check_bytes(path: Path, announced: int, what: str) -> None:
    """Refuse what is announced by a head, before it is unpacked.

    Raises:
        FormatError: a file of its size cannot hold as many bytes.
    """
    size = path.stat().st_size
    if announced > most_bytes(path):
        raise FormatError(
            f"{path.name}: {what} would take {announced / 1e9:.3g} GB of memory, but the file has only "
            f"{size / 1e6:.3g} MB: it was made to fill the memory, or is almost empty: export it without what is empty"
        )
