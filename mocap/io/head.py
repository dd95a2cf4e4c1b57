"""What a file begins with, for the sniffers of the registry: content, not its name."""

import csv
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mocap.documents import check_regular, open_regular
from mocap.errors import FormatError, beside, shown_elsewhere
from mocap.io.apart import root_names, variables
from mocap.io.lines import one_kind

LENGTH = 1 << 16


@dataclass(frozen=True)
class Head:
    """The first bytes of a file, and what they say.

    Attributes:
        path: The file.
        start: Its first 64 KiB.
    """

    path: Path
    start: bytes

    @property
    def name(self) -> str:
        """The file's name in lower case; only to tell formats apart whose content is the same."""
        return self.path.name.lower()

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Whole lines of a text file; none of a binary one."""
        if b"\0" in self.start:
            return ()
        lines = one_kind(self.start.decode("utf-8-sig", "replace")).split("\n")
        if len(self.start) == LENGTH:
            lines = lines[:-1] or lines  # the last one is not whole
        return tuple(lines)

    @property
    def first(self) -> str:
        """The first line."""
        return self.lines[0] if self.lines else ""

    def cells(self) -> tuple[str, ...]:
        """The cells of the first line of a CSV file; none where tabs, blanks or bars separate them."""
        if "," not in self.first and any(len(re.split(r"[\s|]+", row.strip())) > 1 for row in self.lines[1:2]):
            return ()
        try:
            row = next(csv.reader([self.first], skipinitialspace=True), [])
        except csv.Error:
            return ()
        while row and not row[-1].strip():
            row.pop()
        cells = tuple(cell.strip() for cell in row)
        return () if any("\t" in cell for cell in cells) else cells

    @cached_property
    def is_hdf5(self) -> bool:
        """Whether the signature of HDF5 is where it may be (after a user block, as in MATLAB 7.3)."""
        return any(self.start[at : at + 8] == b"\x89HDF\r\n\x1a\n" for at in (0, 512, 1024, 2048))

    @cached_property
    def hdf5(self) -> frozenset[str]:
        """Names at the root of an HDF5 file; empty of others."""
        return root_names(self.path) if self.is_hdf5 else frozenset()

    @cached_property
    def mat(self) -> frozenset[str]:
        """Names of the variables of a MATLAB file of version 5 or later; empty of others."""
        if self.start.startswith(b"MATLAB 7.3"):
            return frozenset(name for name in self.hdf5 if not name.startswith("#"))
        if not self.start.startswith(b"MATLAB 5.0"):
            return frozenset()
        return frozenset(name for name in variables(self.path) if name != "None" and not name.startswith("__"))


def head(path: Path) -> Head:
    """Read what a file begins with.

    Raises:
        FormatError: it cannot be read, or is empty.
    """
    check_regular(path)
    try:
        with open_regular(path, follow=True) as stream:
            start = stream.read(LENGTH)
    except OSError as error:
        told = f": {shown_elsewhere(error)}check that you may read it" if isinstance(error, PermissionError) else ""
        told = beside(path) if isinstance(error, FileNotFoundError) else told
        raise FormatError(f"{path}: cannot be read: {error.strerror}{told}") from None
    if not start.strip():
        raise FormatError(f"{path.name}: the file is empty: export it again")
    return Head(path, start)
