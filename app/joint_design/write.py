"""A designed joint as files: all there or none."""

import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold

from app.joint_design.drawing import drawing, rest_point
from app.joint_design.pictures import figure_7_and_9, motion
from app.joint_design.report import members, readable, report
from app.joint_design.run import JointDesign
from app.joint_design.solid import Kit, assembled, overlaps
from app.tables import check_target
from eal.arrays import Array
from mocap.errors import MocapError

DPI = 110
FINEST_MM = 2e-3
"""Edges shorter than this are taken out of a mesh."""


def write_design(
    design: JointDesign, folder: Path, *, write_recording: Callable[[JointDesign, Path], None], force: bool = False
) -> None:
    """Write ``report.json``, ``report.md``, ``recording.rrd``; of planar trusses pictures, of printed ones the parts.

    ``potential_and_energy.png``, ``motion.png``, ``drawing.png`` and ``.svg``; ``parts/*.stl`` and ``assembly.3mf``. To
    a temporary folder beside the target, renamed when whole.

    Raises:
        MocapError: the folder exists and ``force`` is not given, or it cannot be written.
    """
    check_target(folder, force=force)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise MocapError(f"{folder}: cannot be written: {error.strerror}; give another --out") from None
    try:
        (temporary / "report.json").write_text(json.dumps(report(design), indent=1), encoding="utf-8")
        (temporary / "report.md").write_text(readable(design) + members(design), encoding="utf-8")
        if design.truss.dimension == 2:
            plan = drawing(design)
            plan.savefig(temporary / "drawing.png", dpi=DPI)
            plan.savefig(temporary / "drawing.svg")
            figure_7_and_9(design).savefig(temporary / "potential_and_energy.png", dpi=DPI)
            motion(design).savefig(temporary / "motion.png", dpi=DPI)
        if design.kit is not None:
            _write_parts(design.kit, rest_point(design), temporary)
        write_recording(design, temporary / "recording.rrd")
        temporary.chmod(0o755)
        if folder.exists():
            shutil.rmtree(folder)
        temporary.replace(folder)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _write_parts(kit: Kit, q_m: Array, folder: Path) -> None:
    (folder / "parts").mkdir()
    for part in kit.parts:
        mesh(part.solid).export(folder / "parts" / f"{part.name}.stl")
    placed = assembled(kit, q_m)
    clash = overlaps(placed)
    if clash:
        a, b, volume = clash[0]
        raise MocapError(f"parts {a} and {b} overlap by {volume:.2f} mm^3 when assembled: give another --seed")
    scene = trimesh.Scene()
    for name, solid in placed:
        scene.add_geometry(mesh(solid), node_name=name, geom_name=name)
    scene.export(folder / "assembly.3mf")


def mesh(solid: Manifold) -> trimesh.Trimesh:
    """A solid as a mesh of triangles without edges that single precision, the files' own, could close up."""
    raw = solid.simplify(FINEST_MM).to_mesh()
    return trimesh.Trimesh(np.asarray(raw.vert_properties)[:, :3], np.asarray(raw.tri_verts), process=False)
