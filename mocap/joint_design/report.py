"""What a designed joint is, as JSON and as markdown."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from manifold3d import Manifold

from eal.joint_design import GOAL, LEVELS, Truss
from mocap.errors import MocapError
from mocap.joint_design.design import ENERGY, JointDesign
from mocap.joint_design.drawing import drawing, figure_7_and_9, member_rows, motion, rest_point
from mocap.joint_design.flexure import MM
from mocap.joint_design.solid import PLATE_MM, assembled, keeps_wall, overlaps
from mocap.text import plain

DPI = 110  # of images on a screen


def write_design(design: JointDesign, folder: Path, *, write_recording: Callable[[JointDesign, Path], None]) -> None:
    """Write ``report.json``, ``report.md``, ``recording.rrd``; of planar trusses images, of printed ones the parts.

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
        (folder / "parts").mkdir()
        for part in design.kit.parts:
            mesh(part.solid).export(folder / "parts" / f"{part.name}.stl")
        placed = assembled(design.kit, rest_point(design))
        clash = overlaps(placed)
        if clash:
            a, b, volume = clash[0]
            raise MocapError(f"parts {a} and {b} overlap by {volume:.2f} mm^3 when assembled: give another `seed`")
        scene = trimesh.Scene()
        for name, solid in placed:
            scene.add_geometry(mesh(solid), node_name=name, geom_name=name)
        scene.export(folder / "assembly.3mf")
    write_recording(design, folder / "recording.rrd")


def mesh(solid: Manifold) -> trimesh.Trimesh:
    """A solid as a mesh of triangles without edges that single precision, the files' own, could close up."""
    raw = solid.simplify(2e-3).to_mesh()  # shorter edges are taken out
    return trimesh.Trimesh(np.asarray(raw.vert_properties)[:, :3], np.asarray(raw.tri_verts), process=False)


Json = dict[str, object]


def report(design: JointDesign) -> Json:
    """All numbers, in SI units unless a name says otherwise."""
    fit, release, by_v = design.fit, design.release, design.release_in_v
    return {
        "joint": design.source.name,
        "frame": design.source.frame,
        "samples": len(design.source.potential.samples),
        "level": design.wish.level,
        "seed": design.wish.seed,
        "fit": {
            "rms": fit.rms,
            "r2": fit.r2,
            "iou": dict(zip(map(str, LEVELS), fit.iou, strict=True)),
            "lowest_outside": fit.lowest_outside,
            "stored_over_unit": design.design.stored,
            "stiffness_error_worst": fit.stiffness_worst,
            "stiffness_error_median": fit.stiffness_median,
            "unstable_points": fit.unstable,
        },
        "potential_doubt": {"rms": design.doubt[0], "iou_half": design.doubt[1]},
        "as_built": {
            "position_sd_m": design.wish.tolerance.position,
            "length_sd_m": design.wish.tolerance.length,
            "stiffness_sd": design.wish.tolerance.stiffness,
            "rms_median": float(np.median(design.built_rms)),
            "rms_95": float(np.quantile(design.built_rms, 0.95)),
            "iou_half_05": float(np.quantile(design.built_iou, 0.05)),
        },
        "release": {
            "kinetic_energy_over_unit": ENERGY,
            "masses": release.q.shape[1],
            "truss": {"inside": release.inside, "inside_half": release.inside_half, "energy_drift": release.drift},
            "eal": {"inside": by_v.inside, "inside_half": by_v.inside_half, "energy_drift": by_v.drift},
        },
        "snaps": [{"at": snap.at, "released_over_unit": snap.released_j} for snap in design.way.snaps],
        "tries": [{"rms": rms, "members": members, "taken": taken} for rms, members, taken in design.tries],
        "truss_as_printed": truss_json(design.truss),
        "printed_over_animal": design.metre_per_unit / design.source.unit_m,
        "energy_at_v_1_j": design.energy_j,
        "parts": parts_json(design),
    }


def truss_json(truss: Truss) -> Json:
    """A truss in metres and newtons a metre; nodes numbered as in ``Truss``."""
    return {
        "fixed_m": truss.fixed_m.tolist(),
        "moving_node": truss.moving,
        "internal_start_m": truss.internal_m.tolist(),
        "members": [
            {"ends": ends, "law": law, "rest_m": rest, "stiffness_n_m": stiffness}
            for ends, law, rest, stiffness in zip(
                truss.ends.tolist(), truss.laws, truss.rest_m.tolist(), truss.stiffness_n_m.tolist(), strict=True
            )
        ],
    }


def parts_json(design: JointDesign) -> dict[str, Any] | None:
    """Volume and mass of each part, and whether its walls hold."""
    kit = design.kit
    if kit is None:
        return None
    volumes = {part.name: float(part.solid.volume()) for part in kit.parts}
    wall = kit.printing.wall_m / MM
    return {
        "material": kit.printing.material.name,
        "volumes_mm3": volumes,
        "volume_mm3": sum(volumes.values()),
        "mass_g": sum(volumes.values()) * 1e-6 * kit.printing.material.density_kg_m3,
        "height_mm": kit.top_mm + PLATE_MM,
        "walls_hold": all(part.outline is None or keeps_wall(part.outline, wall) for part in kit.parts),
        "largest_strain": max(flexure.strain for flexure in kit.flexures),
        "layers_from_below": [i + 1 for i in kit.stack.order],
        "hanging_posts": sorted(i + 1 for i in kit.stack.hanging),
    }


def readable(design: JointDesign) -> str:
    """The report to read, without the table of members."""
    fit, release, by_v, wish = design.fit, design.release, design.release_in_v, design.wish
    low, half, high = fit.iou
    missed = [] if fit.rms <= GOAL else [f"RMS {fit.rms:.3f} is above {GOAL:g}"]
    missed += [] if half >= 0.8 else [f"half-level overlap {half:.2f} is below 0.8"]
    lines = [
        f"# {plain(design.source.name)}: a truss with the energy of its potential",
        "",
        f"{len(design.truss.rest_m)} members; {'; '.join(missed) or 'RMS and overlap are within the goals'}.",
        "",
        "| | |",
        "|---|---|",
        f"| difference of U from V_z where V_z < {wish.level:g} | RMS {fit.rms:.3f}, R^2 {fit.r2:.3f} |",
        f"| overlap of level sets at 0.25, 0.5, 0.75 | {low:.2f}, {half:.2f}, {high:.2f} |",
        f"| smallest U outside the region | {fit.lowest_outside * wish.level:.2f} (its edge is at {wish.level:g}) |",
        f"| error of the stiffness against that of V_z where V_z < 0.5 | {100 * fit.stiffness_worst:.0f} % of the "
        f"greatest at worst, {100 * fit.stiffness_median:.0f} % in the median |",
        f"| energy stored at V = 0 | {design.design.stored:.2f} of U(V = 1) |",
        f"| built with manufacturing errors ({wish.tolerance.position / MM:g} mm, "
        f"{100 * wish.tolerance.stiffness:g} % stiffness) | "
        f"RMS {np.median(design.built_rms):.3f} in the median, {np.quantile(design.built_rms, 0.95):.3f} at 95 % |",
        "| uncertainty of V_z itself (learned again from resampled blocks of the recording) | RMS "
        f"{design.doubt[0]:.3f}, "
        f"overlap {design.doubt[1]:.2f} with itself |",
        f"| mass released with {ENERGY:g} of U(V = 1) | {100 * release.inside:.1f} % of time inside the region, "
        f"{100 * release.inside_half:.1f} % where V_z < 0.5; EAL model {100 * by_v.inside:.1f} %, "
        f"{100 * by_v.inside_half:.1f} % |",
        f"| numerical energy drift of the two | {release.drift:.1e}, {by_v.drift:.1e} of U(V = 1) |",
        f"| snap-throughs along the recorded motion | {len(design.way.snaps)} |",
    ]
    parts = parts_json(design)
    if parts is not None:
        lines += [
            f"| printed | {design.metre_per_unit / design.source.unit_m:.3g} times the animal's size, U(V = 1) = "
            f"{design.energy_j / MM:.3g} mJ |",
            f"| parts in {parts['material']} | {parts['volume_mm3'] / 1e3:.1f} cm^3, {parts['mass_g']:.0f} g, "
            f"{parts['height_mm']:.0f} mm high, strain up to {100 * parts['largest_strain']:.1f} % |",
        ]
    return "\n".join(lines) + "\n"


def members(design: JointDesign) -> str:
    """The table of members."""
    heads, rows = member_rows(design.truss, design.kit)
    lines = ["", "Members, lengths in mm as printed:", "", "| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
