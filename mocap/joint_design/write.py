"""A designed joint as files."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold

from eal.arrays import Array
from mocap.errors import MocapError
from mocap.joint_design.design import JointDesign
from mocap.joint_design.drawing import drawing, rest_point
from mocap.joint_design.pictures import figure_7_and_9, motion
from mocap.joint_design.report import members, readable, report
from mocap.joint_design.solid import Kit, assembled, overlaps

DPI = 110
FINEST_MM = 2e-3
"""Edges shorter than this are taken out of a mesh."""


def write_design(design: JointDesign, folder: Path, *, write_recording: Callable[[JointDesign, Path], None]) -> None:
    """Write ``report.json``, ``report.md``, ``recording.rrd``; of planar trusses pictures, of printed ones the parts.

    ``potential_and_energy.png``, ``motion.png``, ``drawing.png`` and ``.svg``; ``parts/*.stl`` and ``assembly.3mf``.

    Args:
        design: What to write.
        folder: Where to, as ``mocap.io.output.result_folder`` gives it.
        write_recording: Writes what is to be looked at.

    Raises:
        MocapError: parts overlap when assembled.
    """
    (folder / "report.json").write_text(json.dumps(report(design), indent=1), encoding="utf-8")
    (folder / "report.md").write_text(readable(design) + members(design), encoding="utf-8")
    if design.truss.dimension == 2:
        plan = drawing(design)
        plan.savefig(folder / "drawing.png", dpi=DPI)
        plan.savefig(folder / "drawing.svg")
        figure_7_and_9(design).savefig(folder / "potential_and_energy.png", dpi=DPI)
        motion(design).savefig(folder / "motion.png", dpi=DPI)
    if design.kit is not None:
        _write_parts(design.kit, rest_point(design), folder)
    write_recording(design, folder / "recording.rrd")


def _write_parts(kit: Kit, q_m: Array, folder: Path) -> None:
    (folder / "parts").mkdir()
    for part in kit.parts:
        mesh(part.solid).export(folder / "parts" / f"{part.name}.stl")
    placed = assembled(kit, q_m)
    clash = overlaps(placed)
    if clash:
        a, b, volume = clash[0]
        raise MocapError(f"parts {a} and {b} overlap by {volume:.2f} mm^3 when assembled: give another `seed`")
    scene = trimesh.Scene()
    for name, solid in placed:
        scene.add_geometry(mesh(solid), node_name=name, geom_name=name)
    scene.export(folder / "assembly.3mf")


def mesh(solid: Manifold) -> trimesh.Trimesh:
    """A solid as a mesh of triangles without edges that single precision, the files' own, could close up."""
    raw = solid.simplify(FINEST_MM).to_mesh()
    return trimesh.Trimesh(np.asarray(raw.vert_properties)[:, :3], np.asarray(raw.tri_verts), process=False)
