"""What every part of a recording says of itself, and what parts of the whole have in common."""

from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from mocap.findings import Finding

P = TypeVar("P")


class Part(Protocol):
    """What one step found, or decided, beside the variables that it wrote: a frozen record in the step's own room.

    Attributes:
        step: The verb that adds it: ``read``, ``clean`` or ``track``.
        depends_on: Names of the classes of parts that it rests on: where one of them is replaced, it goes.
    """

    step: ClassVar[str]
    depends_on: ClassVar[tuple[str, ...]]

    def at(self, frames: NDArray[np.int64], /) -> Self:
        """Of these frames, by their indices."""
        ...

    def only(self, markers: NDArray[np.int64], /) -> Self:
        """Of these markers, by their indices."""
        ...

    def findings(self) -> tuple[Finding, ...]:
        """What is to be told of it."""
        ...

    def to_file(self, folder: Path) -> dict[str, Any]:
        """What a file holds of it, as JSON has it; what is too large for that is written into the folder."""
        ...

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:
        """Read back; a FormatError that begins with ``where`` if it is not as it was written."""
        ...


def of_the_whole(part: P, _which: NDArray[np.int64], /) -> P:
    """``at`` or ``only`` of a part that says nothing of single frames or markers: the part as it is."""
    return part
