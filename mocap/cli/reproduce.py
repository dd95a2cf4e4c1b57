"""``mocap reproduce``."""

from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import errors, say
from mocap.cli.options import Force, Out
from mocap.errors import MocapError


def reproduce(
    figures: Annotated[list[str] | None, typer.Argument(help="Figures of the paper, such as 14a; none: all.")] = None,
    out: Out = Path("out/reproduce"),
    quick: Annotated[bool, typer.Option("--quick", help="Faster: coarser grids and fewer seeds.")] = False,
    real: Annotated[
        Path | None,
        typer.Option(
            envvar="MOCAP_REAL_DATA",
            help="Folder of real recordings: figure 7 is also drawn for one of them, figure 8 compares all its bats.",
        ),
    ] = None,
    span: Annotated[
        list[float] | None,
        typer.Option(
            "--span-s", help="Seconds over which the samples of figure 19a are taken; may be repeated; none: 1 and 10."
        ),
    ] = None,
    recordings: Annotated[
        bool | None,
        typer.Option(
            "--recordings/--no-recordings",
            help="Also film the pendulums and the lizard's wrist, convert the markers to joint coordinates, learn V_z "
            "and track them with the Lagrangian it makes; minutes. If not given: where all figures are made, and not "
            "quickly.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Reproduce the figures of the EAL paper: images, tables, and a verdict on every claim."""
    from mocap.io.output import result_folder
    from mocap.reproduce import FIGURES
    from mocap.reproduce import reproduce as make_figures
    from mocap.reproduce.fig_penalty import SPANS_S
    from mocap.reproduce.samples import elbow_flights, real_bat_samples

    if any(seconds <= 0 for seconds in span or []):
        raise MocapError(f"--span-s must be above 0, but is {min(span or []):g}")
    for name in figures or []:
        if name.lower().removeprefix("fig") not in FIGURES:
            raise MocapError(f"there is no figure {name!r}: the figures are {', '.join(FIGURES)}")
    with result_folder(out, "reproduce", replace=force, tell=say) as folder:
        verdicts = make_figures(
            figures or None,
            folder,
            quick,
            say,
            real_bat_m=None if real is None else real_bat_samples(real),
            flights_deg=elbow_flights(real) if real is not None and (not figures or "8" in figures) else None,
            spans_s=span or SPANS_S,
            recordings=not (quick or figures) if recordings is None else recordings,
        )
    errors.print(
        f"\nWrote {out}/: the figures with their numbers, and {len(verdicts)} verdicts in verdicts.json",
        highlight=False,
    )
