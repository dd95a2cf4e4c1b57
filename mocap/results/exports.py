"""Results for other programs: Excel, MATLAB, OpenSim, MuJoCo, XMALab, those for animation and of key points."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from mocap.errors import MocapError
from mocap.filters.velocities import Motion
from mocap.io.csv_table import as_workbook_cell
from mocap.io.workbook import write_sheets
from mocap.io.xmalab import BODY_ENTRIES
from mocap.kinematics.bodies import with_places
from mocap.kinematics.cycles import Cycle, cycles_table
from mocap.kinematics.functional import pose_of
from mocap.kinematics.records import WORDS, Kinematics, Quantity
from mocap.results.bvh import write_bvh
from mocap.results.keypoints import KEYPOINTS, write_keypoints
from mocap.results.mjcf import mjcf_text
from mocap.results.osim import osim_text
from mocap.skeleton import Skeleton, write_skeleton
from mocap.tracking.result import Result

AXES_FILE = "axes.toml"


def write_axes(motion: Motion, skeleton: Skeleton, folder: Path) -> None:
    """Write the skeleton with the axes of joints between bodies as places of markers, if it has such joints.

    It serves other recordings of the same markers: axes of a functional trial, of a mean pose. Where a functional
    joint does not show its axes there is none; ``Kinematics.notes`` says so.
    """
    if skeleton.body_joints:
        with suppress(MocapError):
            write_skeleton(folder / AXES_FILE, with_places(motion, skeleton))


def write_rigid_bodies(motion: Motion, skeleton: Skeleton, path: Path) -> None:
    """Write where each body of the skeleton is: world from body, column by column of a 4 x 4 matrix, in metres.

    A body's axes are those of the world as it lies on average, its origin is the centre of its markers.

    Raises:
        MocapError: the skeleton states no bodies.
    """
    bodies = skeleton.bodies
    if not bodies:
        raise MocapError("the skeleton states no rigid bodies: name their markers under [bodies]")
    matrices = np.zeros((len(motion.t_s), len(bodies), 4, 4))
    matrices[..., 3, 3] = 1.0
    for n, members in enumerate(bodies.values()):
        pose = pose_of(motion, members)
        matrices[:, n, :3, :3], matrices[:, n, :3, 3] = pose.rotation, pose.position_m
    matrices[np.isnan(matrices).any(axis=(2, 3))] = np.nan
    rows = np.swapaxes(matrices, 2, 3).reshape(len(matrices), -1).tolist()
    header = ",".join(f"{name}_{entry}" for name in bodies for entry in BODY_ENTRIES)
    lines = (",".join("NaN" if np.isnan(v) else f"{v:.12g}" for v in row) for row in rows)
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8", newline="")


Export = Callable[[Result, Kinematics, Sequence[Cycle], Path], None]
"""Writes a recording, its kinematics and cycles into a file."""


def write_xlsx(found: Kinematics, rows: Sequence[Cycle], path: Path) -> None:
    """Excel: the sheets value, sd, status (a row a frame), cycles, and quantities with their units and meanings.

    Raises:
        MocapError: openpyxl is not installed, or there are more quantities than a sheet has columns.
    """
    table, header = cycles_table(rows), ["frame", "t_s", *map(as_workbook_cell, found)]

    def over_time(column: Callable[[Quantity], list[Any]]) -> tuple[list[str], Iterable[Sequence[Any]]]:
        columns = [range(1, len(found.t_s) + 1), found.t_s.tolist(), *map(column, found.quantities)]
        return header, zip(*columns, strict=True)

    about = ((q.name, q.unit, q.kind, q.what, " ".join(q.markers)) for q in found.quantities)
    sheets = {
        "value": over_time(lambda q: q.value.tolist()),
        "sd": over_time(lambda q: q.sd.tolist()),
        "status": over_time(lambda q: [WORDS[code] for code in q.rests]),
        "cycles": (list(table.columns), table.itertuples(index=False)),
        "quantities": (
            ["quantity", "unit", "kind", "meaning", "markers"],
            (map(as_workbook_cell, one) for one in about),
        ),
    }
    write_sheets(path, sheets)


def write_mat(found: Kinematics, rows: Sequence[Cycle], path: Path) -> None:
    """MATLAB (version 5): ``t_s``, ``value``, ``sd``, ``status`` (T x Q), cells ``names``, ``units``; ``cycles``."""
    from scipy.io import savemat

    def cell(texts: Sequence[str]) -> np.ndarray:
        out = np.empty(len(texts), dtype=object)
        out[:] = texts
        return out

    table = cycles_table(rows)
    cycles = {
        str(c): cell(table[c].tolist()) if table[c].dtype.kind not in "fi" else table[c].to_numpy()
        for c in table.columns
    }
    savemat(
        path,
        {
            "recording": found.recording,
            "t_s": found.t_s[:, None],
            "names": cell(list(found)),
            "units": cell([q.unit for q in found.quantities]),
            "value": found.stacked("value"),
            "sd": found.stacked("sd"),
            "status": found.stacked("rests"),
            "status_words": cell(list(WORDS)),
            "cycles": cycles,
        },
        long_field_names=True,
    )


def write_mot(found: Kinematics, path: Path) -> None:
    """OpenSim motion: the angles of joints and of the body, in degrees, a column each; NaN where there is none."""
    angles = [q for q in found.quantities if q.unit == "deg" and q.kind in ("joint", "body", "stroke")]
    _storage(found, [(q.name.removesuffix("_deg"), q.value) for q in angles], path, title="Coordinates")


def write_sto(found: Kinematics, path: Path) -> None:
    """OpenSim storage: every quantity, followed by its standard deviation."""
    columns = [pair for q in found.quantities for pair in ((q.name, q.value), (f"{q.name}_sd", q.sd))]
    _storage(found, columns, path, title="kinematics")


def _storage(found: Kinematics, columns: Sequence[tuple[str, np.ndarray]], path: Path, *, title: str) -> None:
    head = [title, "version=1", f"nRows={len(found.t_s)}", f"nColumns={len(columns) + 1}", "inDegrees=yes"]
    head += ["endheader", "\t".join(["time", *(name for name, _ in columns)])]
    table = np.column_stack([found.t_s, *(values for _, values in columns)])
    form = "\t".join(["%.9g"] * table.shape[1])
    _write_text(path, "\n".join(head + [form % tuple(row) for row in table.tolist()]) + "\n")


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


TABLES: dict[str, Export] = {
    "xlsx": lambda _, found, rows, path: write_xlsx(found, rows, path),
    "mat": lambda _, found, rows, path: write_mat(found, rows, path),
    "mot": lambda _, found, rows, path: write_mot(found, path),  # noqa: ARG005
    "sto": lambda _, found, rows, path: write_sto(found, path),  # noqa: ARG005
    "bvh": lambda run, found, rows, path: write_bvh(run.tracks, run.skeleton, path),  # noqa: ARG005
}
"""Writers of kinematics by the end of the file's name."""
EXPORTS: dict[str, tuple[str, Export]] = {
    **{kind: (f"kinematics.{kind}", write) for kind, write in TABLES.items()},
    "mjcf": ("skeleton.mjcf.xml", lambda run, found, rows, path: _write_text(path, mjcf_text(run))),  # noqa: ARG005
    "osim": ("skeleton.osim", lambda run, found, rows, path: _write_text(path, osim_text(run))),  # noqa: ARG005
    "xmalab": ("rigid_bodies.csv", lambda run, found, rows, path: write_rigid_bodies(run.motion, run.skeleton, path)),  # noqa: ARG005
    **{
        program: ("", lambda run, found, rows, folder, files=files: write_keypoints(run, files, folder))  # noqa: ARG005
        for program, files in KEYPOINTS.items()
    },
}
"""What a result is written as for other programs (``--export``): name of the file in its folder, and the writer."""
