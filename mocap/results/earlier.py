"""Results of the format before, whose header had all findings in one list, as those of this one; goes with the next."""

from pathlib import Path
from typing import Any

from mocap.documents import from_json, regular_bytes

WITHOUT_PARTS = "eal-mocap recording 1"
"""The format of a result whose header says nothing else of what steps found."""


def earlier_parts(header: dict[str, Any], folder: Path) -> dict[str, Any]:
    """What the header of an earlier result tells of its parts, not checked yet: findings, potentials, the report."""
    report = from_json(regular_bytes(folder / "report.json").decode("utf-8", "replace"), str(folder / "report.json"))
    model = report.get("model") if isinstance(report, dict) else None
    parts = {
        "cleaned": {"told": header.get("findings", [])},
        "model": {"why": str(model.get("why", "")) if isinstance(model, dict) else ""},
        "potentials": header.get("potentials"),
        "report": {},
    }
    return {"source": {}, "parts": parts}
