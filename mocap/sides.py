"""Left, right or trunk: on which side of the body a name says that something is."""

import re
from collections.abc import Iterable, Mapping

LEFT, RIGHT, TRUNK = "left", "right", "trunk"
SIDES = (LEFT, RIGHT, TRUNK)
_WORDS = {"l": LEFT, "left": LEFT, "r": RIGHT, "right": RIGHT}
_PARTS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")


def side_of(name: str) -> str:
    """``left`` or ``right`` where the name says so (``elbow_l``, ``L_elbow``, ``leftKnee``), else ``trunk``."""
    found = {_WORDS[part.lower()] for part in _PARTS.findall(name) if part.lower() in _WORDS}
    return found.pop() if len(found) == 1 else TRUNK


def by_side(names: Iterable[str]) -> Mapping[str, list[str]]:
    """Names in the order given, by their side; sides without any are left out."""
    names = list(names)
    groups = {side: [name for name in names if side_of(name) == side] for side in SIDES}
    return {side: group for side, group in groups.items() if group}


def without_side(name: str) -> str:
    """A name without the word for its side: ``elbow`` of ``elbow_l`` and ``elbow``; its words joined by ``_``."""
    return "_".join(part for part in _PARTS.findall(name) if part.lower() not in _WORDS)


def other_side(name: str) -> str:
    """The name of the same on the other side: ``elbow_r`` of ``elbow_l``; one that says no side as it is."""

    def across(part: re.Match[str]) -> str:
        of = {"l": "r", "r": "l", "left": "right", "right": "left"}.get(part[0].lower(), part[0])
        like = str.upper if part[0].isupper() else str.title if part[0][0].isupper() else str
        return part[0] if of == part[0] else like(of)

    return name if side_of(name) == TRUNK else _PARTS.sub(across, name)


def words(name: str) -> str:
    """A name as people say it, its side first: ``elbow_l`` is ``left elbow``."""
    side, parts = side_of(name), name.split("_")
    kept = [part for part in parts if part.lower() not in _WORDS]
    return " ".join([side, *kept] if side != TRUNK and kept and len(kept) < len(parts) else parts)
