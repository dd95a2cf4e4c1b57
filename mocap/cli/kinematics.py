"""``mocap kinematics``."""

from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import errors, progress, say
from mocap.cli.offered import offered
from mocap.cli.options import Force


def kinematics(
    run: Annotated[Path, typer.Argument(help="Folder that track or demo wrote.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; if not given, the folder kinematics within the run.")
    ] = None,
    skeleton: Annotated[
        Path | None,
        typer.Option(help="Another skeleton of the same markers, with other joints, axes, outlines or masses."),
    ] = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            help="Also for another program: xlsx, mat, mot, sto, bvh, mjcf or osim (the animal for MuJoCo, OpenSim), "
            "deeplabcut, sleap or nwb (filled points, and their pixels in each camera), xmalab (rigid bodies); give "
            "the option once for each.",
            autocompletion=offered("exports"),
        ),
    ] = None,
    scale_osim: Annotated[
        Path | None,
        typer.Option(
            help="A generic OpenSim model, to be scaled to the animal by the distances of markers that both have: "
            "scaled.osim, and scale_factors.csv. Needs OpenSim (pip install opensim)."
        ),
    ] = None,
    moments: Annotated[
        bool,
        typer.Option(
            "--moments",
            help="Also net joint forces and moments by inverse dynamics (moments.csv, .nc), of joints beyond which all "
            "masses are stated and no unknown force acts.",
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Angles, velocities, accelerations, lengths, areas and strokes of a tracked run, each with its SD."""
    import mocap
    from mocap.errors import MocapError
    from mocap.io.output import result_folder
    from mocap.results.exports import EXPORTS
    from mocap.skeleton_files import read_skeleton

    unknown = sorted(set(export or ()) - set(EXPORTS))
    if unknown:
        raise MocapError(f"--export {unknown[0]}: give {', '.join(EXPORTS)}")
    result = mocap.load(run)
    if skeleton is not None:
        result = result.with_skeleton(read_skeleton(skeleton))
    place = run / "kinematics" if out is None else out
    inputs = [run, skeleton, scale_osim]
    with result_folder(place, "kinematics", replace=force, inputs=inputs, tell=say) as folder, progress() as tell:
        refused = result.write_kinematics(folder, exports=export or (), progress=tell)
        if scale_osim is not None:
            scaled = result.write_scaled_osim(scale_osim, folder)
            factors = ", ".join(f"{body} {one.factor:.3g}" for body, one in scaled.items() if one.pairs)
            rest = "; others by their median" if any(not one.pairs for one in scaled.values()) else ""
            say(f"{scale_osim.name}: {len(scaled)} bodies scaled: {factors}{rest}")
        if moments:
            result.write_moments(folder)
    for note in (*result.why_no_cycles, *result.kinematics.notes, *(result.moments.notes if moments else ())):
        say(f"note: {note}")
    errors.print(f"Wrote {place}/: {', '.join(sorted(p.name for p in place.iterdir() if p.name[0] != '.'))}")
    for reason in refused:
        say(f"not written: {reason}")
    if refused:
        raise typer.Exit(1)
