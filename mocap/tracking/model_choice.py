"""By which model a recording was tracked, why, and how it fills gaps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

from mocap.filters.score import Score
from mocap.findings import Finding
from mocap.json_records import plain, record
from mocap.parts import of_the_whole


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelChoice:
    """The choice of a model; ``data.attrs["model"]`` is its name.

    Attributes:
        why: Why it was tracked by that model.
        scores: How gaps that were hidden in it were filled, by method.
        told: Whether its intervals are what errors are.
    """

    why: str
    scores: Mapping[str, Score] = field(default_factory=dict)
    told: tuple[Finding, ...] = ()

    step: ClassVar[str] = "track"
    depends_on: ClassVar[tuple[str, ...]] = ("Cleaned",)

    at = only = of_the_whole

    def findings(self) -> tuple[Finding, ...]:
        """What is told."""
        return self.told

    def to_file(self, folder: Path) -> dict[str, Any]:  # noqa: ARG002
        """All of it."""
        return plain(self)

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:  # noqa: ARG003
        """Read back."""
        return record(cls, entries, where)
