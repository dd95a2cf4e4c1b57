"""Audit: whether pixels, cameras and stored points agree, and faults that programs leave in files.

Pixels with their cameras, or positions, come in; files only where ``inspect`` tells of them one by one. Findings and
camera offsets go out: nothing is corrected here. It touches no file but those to be inspected.
"""

from mocap.audit.audit import Audit, audited
from mocap.audit.geometry import HiddenLens, fit_findings
from mocap.audit.offsets import Offsets, estimate_offsets, in_step, late_cameras, moved, start_offsets
from mocap.audit.rate import rate_findings
from mocap.audit.samples import Jump, jump_findings, jumps, of_jumps, pixel_findings, point_findings
from mocap.audit.sides import side_findings
from mocap.audit.stored import StalePoint, other_world, stale_points
from mocap.findings import Finding, alarms

__all__ = [
    "Audit",
    "Finding",
    "HiddenLens",
    "Jump",
    "Offsets",
    "StalePoint",
    "alarms",
    "audited",
    "estimate_offsets",
    "fit_findings",
    "in_step",
    "jump_findings",
    "jumps",
    "late_cameras",
    "moved",
    "of_jumps",
    "other_world",
    "pixel_findings",
    "point_findings",
    "rate_findings",
    "side_findings",
    "stale_points",
    "start_offsets",
]
