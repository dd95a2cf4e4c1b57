"""What an audit finds in a recording."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check.

    Attributes:
        kind: What was checked, in one or two words, the same for every recording.
        alarm: Whether something is wrong; otherwise a decision is stated, with the evidence for it.
        text: One sentence.
        numbers: The evidence, by name, with units in the names.
        cameras: Cameras concerned.
        markers: Markers concerned.
        frames: Rows concerned, from 1; of many only the first.
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
