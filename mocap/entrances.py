"""Which kinds of recordings each command takes, and why it refuses the others: the same reason wherever it is one."""

from collections.abc import Mapping

ENTRANCES = ("info", "track", "kinematics", "convert", "learn", "batch", "desk", "python")
"""Commands, and Python's ``mocap.track``; ``kinematics`` of what ``track`` made."""
TAKEN = ""
_TRACKED = ("track", "kinematics", "learn", "batch", "desk", "python")
"""Those that need a recording which can be tracked."""


def _refused(why: str) -> Mapping[str, str]:
    """Described and converted, and refused where it would be tracked."""
    return {name: why if name in _TRACKED else TAKEN for name in ENTRANCES}


TABLE: Mapping[str, Mapping[str, str]] = {
    "pixels of several cameras, calibrated": dict.fromkeys(ENTRANCES, TAKEN),
    "pixels of several cameras, without a calibration": _refused("without a calibration"),
    "pixels of one video": dict.fromkeys(ENTRANCES, TAKEN)
    | {
        "learn": "learning needs positions in space",
        "kinematics": "contains no recording.nc",
    },
    "positions": dict.fromkeys(ENTRANCES, TAKEN),
    "rigid bodies alone": {
        **_refused("contains no tracks"),
        **dict.fromkeys(("batch", "desk"), "no trial was found"),
        "convert": "cannot store",  # but in formats of bodies
    },
    "angles alone": dict.fromkeys(ENTRANCES, "state what the columns are"),
    "labels of several animals": _refused("give `individual`"),
}
"""By kind of recording and entrance: why it is refused (a part of the message); empty: it is taken."""

_BESIDE = "give this file as one more of FILES, which are combined"
_AS_IT_IS = "mocap convert writes what files hold and decides nothing of it: mocap track does"
UNASKED: Mapping[str, Mapping[str, str]] = {
    "convert": {
        **dict.fromkeys(("calibration", "profile"), _BESIDE),
        **dict.fromkeys(("skeleton", "origin", "calibration_origin", "image_height_px", "mm_per_px"), _AS_IT_IS),
        **dict.fromkeys(("pixel_sd", "point_sd_mm", "correct_lag", "fit_lens"), _AS_IT_IS),
        **dict.fromkeys(("stored_points", "edits", "edits_anyway"), _AS_IT_IS),
    }
}
"""Options of a recording (``mocap.options.ReadOptions``) that a command which reads it does not take, and why."""


def as_markdown() -> str:
    """The table for pages: a row a kind, a column an entrance."""
    lines = ["| | " + " | ".join(ENTRANCES) + " |", "|---" * (len(ENTRANCES) + 1) + "|"]
    lines += [
        f"| {kind} | " + " | ".join(row[name] or "yes" for name in ENTRANCES) + " |" for kind, row in TABLE.items()
    ]
    return "\n".join(lines)
