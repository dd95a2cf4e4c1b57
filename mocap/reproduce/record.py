"""What a reproduced figure is: numbers, verdicts, and how to draw it."""

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from matplotlib.figure import Figure as Canvas

from eal.arrays import Array


def label(figure: str) -> str:
    """``fig 14a``, ``theorem 1``."""
    return figure.replace("theorem", "theorem ") if figure.startswith("theorem") else f"fig {figure}"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One claim about a figure, and whether the numbers bear it out.

    Attributes:
        figure: Figure of the paper, ``14a``, or ``theorem1``: whose it is once the figure is written.
        sentence: The paper's words, or words close to them.
        claim: What was checked, with the expected number.
        measured: What came out.
        holds: Whether the claim holds.
        control: What must not pass: the same numbers as a fault would have made them.
        refused: Whether it does not.
    """

    figure: str = ""
    sentence: str
    claim: str
    measured: str
    holds: bool
    control: str
    refused: bool

    def line(self) -> str:
        """One line for a terminal."""
        found = "holds" if self.holds else "DOES NOT HOLD"
        check = "" if self.refused else f" (BUT SO IT DOES FOR {self.control})"
        return f"{label(self.figure)}: {self.claim}: {self.measured}, {found}{check}"


T = TypeVar("T")


def judged(
    sentence: str,
    claim: str,
    measured: str,
    test: Callable[[T], Any],
    found: T,
    *,
    control: str,
    faulty: T,
) -> Verdict:
    """A verdict by a test that is also put to what it must refuse.

    Args:
        sentence: As in ``Verdict``; so are the next two.
        claim: See there.
        measured: See there.
        test: Whether numbers bear the claim out.
        found: The numbers.
        control: What the faulty numbers are.
        faulty: Numbers for which the claim is false, whatever ``found`` is.
    """
    return Verdict(
        sentence=sentence,
        claim=claim,
        measured=measured,
        holds=bool(test(found)),
        control=control,
        refused=not test(faulty),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Figure:
    """One figure of the paper, reproduced.

    Attributes:
        name: ``14a``.
        table: Columns of equal length; 1/eps^2 is called ``penalty``.
        verdicts: The claims.
        draw: Draws it on an empty canvas.
    """

    name: str
    table: Mapping[str, Array]
    verdicts: tuple[Verdict, ...]
    draw: Callable[[Canvas], None]

    @property
    def stem(self) -> str:
        """Of its files: ``fig14a``, ``theorem1``."""
        return self.name if self.name.startswith("theorem") else f"fig{self.name}"

    def csv_text(self) -> str:
        """The table as CSV, numbers to ten digits."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.table)
        for row in zip(*self.table.values(), strict=True):
            writer.writerow(format(float(x), ".10g") for x in row)
        return stream.getvalue()


def long_table(axes: Mapping[str, Array], **values: Array) -> dict[str, Array]:
    """Arrays over a grid as columns, one row a grid point.

    Args:
        axes: Name to the values along each axis, in the order of the axes.
        values: Name to an array over the grid.

    Returns:
        Columns of equal length.
    """
    grid = np.meshgrid(*(np.asarray(a, dtype=np.float64) for a in axes.values()), indexing="ij")
    columns: dict[str, Array] = {name: g.reshape(-1) for name, g in zip(axes, grid, strict=True)}
    return columns | {name: np.asarray(v, dtype=np.float64).reshape(-1) for name, v in values.items()}
