"""``mocap design-joint``."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from mocap.cli.console import program, progress, say, show, typed
from mocap.cli.offered import offered
from mocap.cli.options import AsJson, Force, Out, with_records
from mocap.errors import MocapError

if TYPE_CHECKING:
    from eal.joint_design import Limits, Tolerance
    from mocap.joint_design.flexure import Printing

MM = 1e-3


@dataclass(frozen=True, kw_only=True)
class TrussOptions:
    """Which members a truss may have."""

    level: Annotated[float, typer.Option(help="The design region is where V_z is below this.")] = 0.9
    members: Annotated[int, typer.Option(min=2, help="Largest number of members.")] = 12
    laws: Annotated[str, typer.Option(help="Of members: linear, cable, strut, neo_hookean, tape.")] = (
        "linear,cable,strut"
    )
    internal: Annotated[
        int, typer.Option(min=0, help="Number of internal nodes; parts cannot be made of such trusses.")
    ] = 0
    symmetric: Annotated[bool, typer.Option("--symmetric", help="Members in mirrored pairs.")] = False
    crossing: Annotated[bool, typer.Option(help="Members that share no node must not cross.")] = True
    starts: Annotated[int, typer.Option(min=1, help="Number of random ground structures to start from.")] = 4
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same truss.")] = 0


@dataclass(frozen=True, kw_only=True)
class SizeOptions:
    """How large it is printed, and what its members bear."""

    size_mm: Annotated[float, typer.Option(help="Printed distance from the joint to its farthest sample.")] = 80.0
    shortest_mm: Annotated[float, typer.Option(help="Smallest length of a member, as printed.")] = 20.0
    longest_mm: Annotated[
        float | None, typer.Option(help="Largest length of a member; if not given, 2.2 times the size.")
    ] = None
    reach_mm: Annotated[
        float | None, typer.Option(help="Largest distance of a post from the joint; if not given, 1.25 times the size.")
    ] = None
    contraction: Annotated[float, typer.Option(help="Largest shortening of a spring, relative to its rest length.")] = (
        0.65
    )
    extension: Annotated[float, typer.Option(help="Largest stretch of a member, relative to its rest length.")] = 1.5

    def limits(self, truss: TrussOptions) -> "Limits":
        """Of members, in metres.

        Raises:
            MocapError: they contradict each other.
        """
        from eal.joint_design import DesignError, Law, Limits

        laws = tuple(part.strip() for part in truss.laws.split(","))
        if not set(laws) <= set(get_args(Law)):
            raise MocapError(f"`laws` {truss.laws}: give some of {', '.join(get_args(Law))}, with commas between")
        try:
            return Limits(
                members=truss.members,
                shortest=self.shortest_mm * MM,
                longest=(self.longest_mm or 2.2 * self.size_mm) * MM,
                reach=(self.reach_mm or 1.25 * self.size_mm) * MM,
                spacing=14.0 * MM,
                contraction=self.contraction,
                extension=self.extension,
                laws=cast(tuple[Law, ...], laws),
            )
        except DesignError as error:
            raise MocapError(str(error)) from None


@dataclass(frozen=True, kw_only=True)
class PartOptions:
    """What its parts are made of, and how well."""

    solid: Annotated[bool, typer.Option(help="Make no parts for 3D printing.")] = True
    material: Annotated[str, typer.Option(help="pa12, petg, pla or tpu95a.")] = "pa12"
    young_mpa: Annotated[
        float | None, typer.Option(help="Young's modulus, if it differs from the material's usual one.")
    ] = None
    strain: Annotated[
        float | None, typer.Option(help="Allowable strain, if it differs from the material's usual one.")
    ] = None
    wall_mm: Annotated[float, typer.Option(help="Smallest wall thickness.")] = 0.8
    width_mm: Annotated[float, typer.Option(help="Largest width of a spring.")] = 20.0
    energy_mj: Annotated[
        float | None, typer.Option(help="Strain energy at V = 1; if not given, the middle of the feasible range.")
    ] = None
    error_mm: Annotated[
        float, typer.Option(help="Manufacturing error (standard deviation) of post positions and lengths.")
    ] = 0.1
    error_stiffness: Annotated[float, typer.Option(help="Manufacturing error of stiffnesses, relative.")] = 0.1

    def printing(self) -> "Printing":
        """Material and walls, in metres.

        Raises:
            MakeError: there is no such material.
        """
        from mocap.joint_design.flexure import Printing, material

        found = material(self.material, young_mpa=self.young_mpa, strain=self.strain)
        return Printing(material=found, wall_m=self.wall_mm * MM, width_m=self.width_mm * MM)

    def tolerance(self) -> "Tolerance":
        """Errors of manufacture, in metres."""
        from eal.joint_design import Tolerance

        return Tolerance(position=self.error_mm * MM, length=self.error_mm * MM, stiffness=self.error_stiffness)


@with_records
def design_joint(
    source: Annotated[Path, typer.Argument(help="Run folder, potential of a joint (.npz), or model of mocap learn.")],
    out: Out,
    truss: TrussOptions,
    size: SizeOptions,
    parts: PartOptions,
    joint: Annotated[
        str | None,
        typer.Option(
            help="Name of the joint; for a model without a skeleton its three markers parent,centre,child.",
            autocompletion=offered("joints"),
        ),
    ] = None,
    skeleton: Annotated[Path | None, typer.Option(help="For a model: skeleton file that defines the joint.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Design a truss whose strain energy is a joint's empirical potential; check it, draw it, make parts to print."""
    from mocap.io.output import result_folder
    from mocap.joint_design.design import Wish
    from mocap.joint_design.design import design_joint as shape_joint
    from mocap.joint_design.log_truss import write_truss_recording
    from mocap.joint_design.report import readable, report, write_design
    from mocap.joint_design.source import read_source
    from mocap.progress import Stages

    limits = size.limits(truss)
    found = read_source(source, joint, skeleton)
    solid = parts.solid and not truss.internal and found.potential.dimension == 2
    printing = parts.printing()
    wish = Wish(
        size_m=size.size_mm * MM,
        level=truss.level,
        limits=limits,
        starts=truss.starts,
        internal=truss.internal,
        symmetric=truss.symmetric,
        may_cross=truss.crossing,
        seed=truss.seed,
        printing=printing if solid else None,
        energy_j=None if parts.energy_mj is None else parts.energy_mj * MM,
        tolerance=parts.tolerance(),
    )
    with (
        result_folder(out, "design-joint", replace=force, inputs=[source, skeleton], tell=say) as folder,
        progress() as tell,
    ):
        design = shape_joint(found, wish, stage=lambda name: lambda share: tell(name, share))
        with Stages(tell=tell).stage("write"):
            write_design(design, folder, write_recording=write_truss_recording)
    if as_json:
        print(json.dumps(report(design)))  # noqa: T201
        return
    show(readable(design))
    say(
        "",
        f"Wrote {out}/: report, drawing, images{', parts/*.stl, assembly.3mf' if solid else ''}, recording.rrd",
        f"Look at it: {typed(*program(), 'view', out)}",
    )
