"""What was found in a recording, or decided about it: data, each with the one sentence that people read."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

from mocap.text import number_of


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check, or a decision.

    Attributes:
        kind: What was checked, in one or two words, the same for every recording.
        text: One sentence: what was found, what that means, what to do.
        alarm: Whether something is wrong; otherwise a decision is stated, with the evidence for it.
        numbers: The evidence, by name, with units in the names.
        cameras: Cameras concerned.
        markers: Markers concerned.
        frames: Rows concerned, from 1; of many only the first.
    """

    kind: str
    text: str
    alarm: bool = False
    numbers: Mapping[str, float] = field(default_factory=dict)
    cameras: tuple[str, ...] = ()
    markers: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()

    def __str__(self) -> str:
        """The sentence."""
        return self.text

    def as_json(self) -> dict[str, Any]:
        """For reports."""
        return {**asdict(self), "numbers": dict(self.numbers)}


alarm = partial(Finding, alarm=True)
"""One that says that something is wrong."""

MOST = 20
"""Frames that a finding lists."""


def alarms(findings: Iterable[Finding]) -> list[Finding]:
    """Those that say that something is wrong."""
    return [f for f in findings if f.alarm]


def readings(texts: Iterable[str], *, where: str = "") -> tuple[Finding, ...]:
    """How a file (``where``) was read where it leaves that open, by the sentences of its reader."""
    return tuple(Finding(kind="reading", text=f"{where}: {text}" if where else text) for text in texts)


def over_blocks(blocks: Iterable[Iterable[Finding]]) -> list[Finding]:
    """The 40 commonest findings of a recording's blocks.

    Those of one kind and markers are one, where the cameras of one are among those of the other.
    """
    found: list[list[Finding]] = []
    for one in (finding for block in blocks for finding in block):
        alike = [same for same in found if _alike(same[0], one)]
        if alike:
            alike[0].append(one)
        else:
            found.append([one])
    commonest = sorted(found, key=len, reverse=True)[:40]
    return [same[0] if len(set(map(str, same))) == 1 else _of_several(same) for same in commonest]


def _alike(one: Finding, other: Finding) -> bool:
    fewer, more = sorted((set(one.cameras), set(other.cameras)), key=len)
    return (one.kind, one.markers, not fewer) == (other.kind, other.markers, not more) and fewer <= more


def _of_several(same: list[Finding]) -> Finding:
    first = same[0]
    others = number_of(len(same) - 1, "other block")
    text = f"{first.text} (and in {others}, with their own numbers)"
    return Finding(kind=first.kind, text=text, alarm=first.alarm, cameras=first.cameras, markers=first.markers)
