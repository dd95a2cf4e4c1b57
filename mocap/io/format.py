"""A format: how to know it, read it and write it; and what a file begins with, by which it is known."""

import csv
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

from mocap.documents import check_regular, open_regular
from mocap.errors import FormatError, beside, shown_elsewhere
from mocap.io.apart import CLASSIC_NETCDF, classic_names, root_names, variables
from mocap.io.contents import FileContents
from mocap.io.lines import one_kind

LENGTH = 1 << 16  # bytes by which files are told
Zero = Literal["position", "missing"]
"""What a sample at exactly (0, 0, 0) is."""


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

    @property
    def is_classic_netcdf(self) -> bool:
        """Whether it is NetCDF of before HDF5 (versions 1 and 2), which xarray writes where it has no other library."""
        return self.start[:4] in CLASSIC_NETCDF

    @cached_property
    def netcdf(self) -> frozenset[str]:
        """Names of the variables of a NetCDF file of either kind, or at the root of any HDF5 file."""
        return classic_names(self.path) if self.is_classic_netcdf else self.hdf5

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
        advice = f": {shown_elsewhere(error)}check that you may read it" if isinstance(error, PermissionError) else ""
        advice = beside(path) if isinstance(error, FileNotFoundError) else advice
        raise FormatError(f"{path}: cannot be read: {error.strerror}{advice}") from None
    if not start.strip():
        raise FormatError(f"{path.name}: the file is empty: export it again")
    return Head(path, start)


@dataclass(frozen=True, kw_only=True)
class Hints:
    """What the user states where a file does not say it.

    Attributes:
        cameras: Number of cameras of sparse pixel files.
        columns: For plain CSV files: marker to its columns, e.g. {"tip": ("x1", "y1", "z1")}.
        format: Name of the format; None: found by content.
        sheet: Of a workbook (.xlsx) with several sheets, the one to read: its name, or its number from 1.
        zero: What samples at exactly (0, 0, 0) are; None: judged by evidence (``mocap.io.plausible``).
        individual: Of a file with several animals the one whose markers are meant.
        fps: Frames a second; times of the file that are too coarse for it are not used.
    """

    cameras: int | None = None
    columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    format: str | None = None
    sheet: str | None = None
    zero: Zero | None = None
    individual: str | None = None
    fps: float | None = None


@dataclass(frozen=True, kw_only=True)
class Format:
    """A file format.

    Attributes:
        name: Unique.
        title: For people.
        knows: Whether a file begins as this format does.
        read: Reader.
        write: Writer, which returns remarks for its user; None: only read.
        holds: What a file that ``write`` writes can hold: ``pixels``, ``points``, ``cameras``, ``fps``, ``unit``,
            ``origin`` (of samples), ``sd``, ``score``, ``animals``, ``first_frame``, ``frame_numbers``, names of
            tables, and ``pixel_origin`` where its pixel rows count from the upper left.
        both: Whether pixels and points go together; else only points are written where there are both.
        needs: Of what it holds, what a recording must have to be written: ``fps``, ``unit``.
        zero_is_missing: Whether readers of this format take (0, 0, 0) as not seen.
        suffixes: Ends of names that mean this format for writing.
        files: The files that ``write`` writes, where that is not the one of the name.
        signs: Words of files of this kind, by which it comes nearest to a file that no format knows; none: those of its
            name and title.
        any_names: Whether its columns may have any names, so that knowing a table tells little.
        beside: Whether its reader looks at the file's place: what lies beside it, or its folder's name.
        of_words: Whether its tables hold words that mean something: laid out anew they would lose them.
        is_set: Whether it is several files, each of a format of its own, and is only written.
    """

    name: str
    title: str
    knows: Callable[[Head], bool]
    read: Callable[[Path, Hints], FileContents]
    write: Callable[[Path, FileContents], list[str] | None] | None = None
    holds: frozenset[str] = frozenset()
    both: bool = False
    needs: frozenset[str] = frozenset()
    zero_is_missing: bool = False
    suffixes: tuple[str, ...] = ()
    files: Callable[[Path, FileContents], list[Path]] = lambda path, _: [path]
    signs: str = ""
    any_names: bool = False
    beside: bool = False
    of_words: bool = False
    is_set: bool = False

    def __call__(self, path: Path, hints: Hints | None = None) -> FileContents:
        """What a file holds, by its reader; ``mocap.io.registry.read_as`` adds what every file is checked for."""
        return self.read(path, hints or Hints())


def file_format(
    name: str,
    title: str,
    knows: Callable[[Head], bool],
    *,
    signs: str = "",
    any_names: bool = False,
    beside: bool = False,
    of_words: bool = False,
) -> Callable[[Callable[[Path, Hints], FileContents]], Format]:
    """Stands above a reader, and makes it the format that it reads; for formats that are not written."""
    return lambda read: Format(
        name=name,
        title=title,
        knows=knows,
        read=read,
        signs=signs,
        any_names=any_names,
        beside=beside,
        of_words=of_words,
    )
