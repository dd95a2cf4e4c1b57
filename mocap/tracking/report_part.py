"""The report of a result, as numbers and as text."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError
from mocap.findings import Finding
from mocap.json_records import AGAIN
from mocap.parts import of_the_whole


@dataclass(frozen=True, eq=False, kw_only=True)
class Report:
    """A report.

    Attributes:
        numbers: What ``report.json`` holds.
        text: The same as markdown.
    """

    numbers: Mapping[str, Any]
    text: str

    step: ClassVar[str] = "track"
    depends_on: ClassVar[tuple[str, ...]] = ("ModelChoice", "Potentials")

    at = only = of_the_whole

    def findings(self) -> tuple[Finding, ...]:
        """None of its own: it tells those of the other parts."""
        return ()

    def to_file(self, folder: Path) -> dict[str, Any]:  # noqa: ARG002
        """Nothing: ``report.json`` and ``report.md`` hold it, with the seconds that no other file depends on."""
        return {}

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:  # noqa: ARG003
        """Read back from ``report.json`` and ``report.md``; the text names options as the file does."""
        path = folder / "report.json"
        numbers = from_json(_text(path), str(path))
        if not isinstance(numbers, dict):
            raise FormatError(f"{path}: is no report, which is a table: {AGAIN}")
        return cls(numbers=numbers, text=_text(folder / "report.md"))


def _text(path: Path) -> str:
    try:
        return regular_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is no text ({error}): {AGAIN}") from None
