"""What an audit says of a recording."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was checked and is worth saying.

    Attributes:
        kind: What was checked; one word or two, the same for every recording.
        alarm: Whether something is wrong; otherwise a decision is stated, with what speaks for it.
        text: One sentence.
        numbers: What it rests on, by name, with units in the names.
        cameras: Cameras that it is about.
        markers: Markers that it is about.
        frames: Rows that it is about, from 1; the first of many.
    """

    kind: str
    alarm: bool
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    cameras: tuple[str, ...] = ()
    markers: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """For reports."""
        return {**asdict(self), "numbers": dict(self.numbers)}


MOST = 20
"""Frames that a finding lists."""


def alarms(findings: "list[Finding] | tuple[Finding, ...]") -> list[Finding]:
    """Those that say that something is wrong."""
    return [f for f in findings if f.alarm]
