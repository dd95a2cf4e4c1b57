"""Every entity path of a recording, in one place."""

from rerun import escape_entity_path_part

WORLD = "/world"
SKELETON = "/world/skeleton"
FRAMED = "/world/framed"
MARKERS = "/world/markers"
UNCERTAINTY = "/world/uncertainty"
TRAILS = "/world/trails"
PATH = "/world/path"
AXES = "/world/axes"
CAMERAS = "/world/cameras"
JOINTS = "/joints"
LIMBS = "/limbs"
PULL = "/world/pull"
INNOVATION = "/health/innovation"
RESIDUAL = "/health/residual"
INNOVATION_MAP = "/health/innovation_map"
RESIDUAL_MAP = "/health/residual_map"
NIS = "/health/nis"
ROWS = "/health/rows"
LOG_LIKELIHOOD = "/health/log_likelihood"
GAPS = "/gaps"
GAP_MAP = "/gap_map"
REPORT = "/report"
ANGLES = "/angles"
CYCLES = "/cycles"
ENERGY = "/lagrangian/energy"
VALLEY = "/lagrangian/valley"

ORIGINS = ("measured", "filled", "rejected")
"""Classes of samples; each has its own entity under ``MARKERS`` and ``UNCERTAINTY``, so that it can be toggled."""


def child(parent: str, name: str) -> str:
    """The path of ``name`` below ``parent``; any name is allowed."""
    return f"{parent}/{escape_entity_path_part(name)}"


def image(name: str) -> str:
    """Image plane of a camera, below its pose; what lies below it is in its pixels."""
    return f"{child(CAMERAS, name)}/image"


def joint(name: str, part: str) -> str:
    """Of a joint its potential as a ``surface``, from above (``map``), as a ``volume``; ``spectrum``, ``series``."""
    return f"{child(JOINTS, name)}/{part}"


def quantity(group: str, name: str) -> str:
    """A quantity over time, in its group."""
    return child(f"{ANGLES}/{group}", name)


def cycles(kind: str, of: str) -> str:
    """The cycles of one limb."""
    return child(CYCLES, f"{of}_{kind}")
