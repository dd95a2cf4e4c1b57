"""A format: how to know it, read it and write it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mocap.io.contents import FileContents
from mocap.io.head import Head


@dataclass(frozen=True, kw_only=True)
class Hints:
    """What the user states where a file does not say it.

    Attributes:
        cameras: Number of cameras of sparse pixel files.
        columns: For plain CSV files: marker to its columns, e.g. {"tip": ("x1", "y1", "z1")}.
        format: Name of the format; None: found by content.
        sheet: Of a workbook (.xlsx) with several sheets, the one to read: its name, or its number from 1.
    """

    cameras: int | None = None
    columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    format: str | None = None
    sheet: str | None = None


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
