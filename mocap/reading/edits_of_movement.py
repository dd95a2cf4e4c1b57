"""Corrections as the list of committed edits that the package movement has proposed: swaps and drops of keypoints.

movement has proposed this list (a file of JSON, in its issue 993) and does not write it yet: what it keeps of edits is
a flag of each sample, ``edited`` in its NetCDF files, which ``mocap.io.movement`` reads and writes. A place in one
camera's image is in neither.
"""

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError
from mocap.reading.edits import Edit, Log, read_log, standing

SUFFIX = ".json"
TYPES = {"exchange": "swap", "delete": "drop"}
"""What both state, by ``Edit.what``: markers bear each other's names, or are not to be seen, in a range of frames."""
INDIVIDUAL = "id_0"
"""The only animal of a recording, as movement names it."""


def any_log(path: str | PathLike[str]) -> Log:
    """A log of ours (``edits.jsonl``), or movement's list (a file that ends with ``.json``).

    Raises:
        FormatError: it is neither.
    """
    path = Path(path)
    return Log(name=path.name, edits=_of_list(path)) if path.suffix.lower() == SUFFIX else read_log(path)


def committed(edits: Sequence[Edit], *, fps: float) -> tuple[list[dict[str, Any]], int]:
    """Edits that stand as movement lists them, and how many of them it cannot state.

    Frames count from 0, the last belongs to the range. ``a`` and ``b`` are what is swapped; ``individuals`` and
    ``keypoints`` are what an edit affects. ``who`` and ``when`` are added to what movement has proposed.

    Args:
        edits: Of a log, in their order.
        fps: Frames a second, of ``t0`` and ``t1``.
    """
    stands, listed = standing(edits), []
    for edit in stands:
        if edit.what not in TYPES or edit.camera is not None or edit.frame is None:
            continue
        first, last = edit.frame - 1, (edit.last or edit.frame) - 1
        names = [name for name in (edit.marker, edit.other) if name is not None]
        listed.append(
            {
                "type": TYPES[edit.what],
                "t0_frame": first,
                "t1_frame": last,
                "t0": _clock(first / fps),
                "t1": _clock(last / fps),
                **dict(zip("ab", names, strict=False)),
                "individuals": [INDIVIDUAL],
                "keypoints": names,
                "who": edit.who,
                "when": edit.when,
            }
        )
    return listed, len(stands) - len(listed)


def write_committed(path: Path, edits: Sequence[Edit], *, fps: float) -> str:
    """Write ``committed`` edits; what was written, in words."""
    listed, left = committed(edits, fps=fps)
    path.write_text(json.dumps(listed, ensure_ascii=False, indent=2) + "\n", encoding="utf-8")
    without = f"; {left} in one camera's image left out, which movement cannot state" if left else ""
    return f"{len(listed)} of {len(listed) + left} corrections{without}"


def _clock(seconds: float) -> str:
    """Minutes and seconds, to the millisecond."""
    whole = round(1000 * seconds)
    return f"{whole // 60000:02d}:{whole % 60000 / 1000:06.3f}"


def _of_list(path: Path) -> list[Edit]:
    listed = from_json(regular_bytes(path), path.name)
    if not isinstance(listed, list):
        raise FormatError(f"{path.name}: no list of edits: expected edits.jsonl of mocap desk, or movement's list")
    found = []
    for number, one in enumerate(listed, start=1):
        try:
            found += _edits(one)
        except (TypeError, FormatError) as error:
            raise FormatError(f"{path.name}: edit {number}: {error}: take it out") from None
    return found


def _edits(one: Any) -> list[Edit]:
    """One entry of movement's list: an edit of ours for each marker that is dropped."""
    if not isinstance(one, Mapping) or one.get("type") not in TYPES.values():
        kind = one.get("type") if isinstance(one, Mapping) else one
        raise FormatError(f"expected a swap or a drop, got {kind!r}"[:120])
    first, last = one.get("t0_frame"), one.get("t1_frame", one.get("t0_frame"))
    if type(first) is not int or type(last) is not int or not 0 <= first <= last:
        raise FormatError("t0_frame and t1_frame are no frames from 0, the first before the last")
    stated: dict[str, Any] = {"who": str(one.get("who", "movement")), "when": str(one.get("when", ""))}
    stated |= {"frame": first + 1, "last": last + 1}
    if one["type"] == "swap":
        return [Edit(what="exchange", marker=one.get("a"), other=one.get("b"), **stated)]
    names = one.get("keypoints") or [one.get("a")]
    if not isinstance(names, list):
        raise FormatError("keypoints are no list of names")
    return [Edit(what="delete", marker=name, **stated) for name in names]
