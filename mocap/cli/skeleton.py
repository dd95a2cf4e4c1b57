"""``mocap skeleton``."""

import json
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mocap.cli.console import progress, say
from mocap.cli.options import AsJson, Force, RecordingOptions, Views, with_records
from mocap.progress import Stages

if TYPE_CHECKING:
    from mocap.recording import Recording


@with_records
def skeleton(
    tracks: Views,
    options: RecordingOptions,
    names: Annotated[
        Path | None,
        typer.Option(help="What the points are called: a list (DLTdv's pointnames.txt), or any table that has them."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Skeleton file to write; if not given, it is printed.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Propose a skeleton from a recording: its markers, bones, rigid bodies, trunk and joints, in a file to correct.

    From a model (.osim, .bioMod, .urdf, MJCF's .xml) it writes the skeleton that the model describes.

    Example: mocap skeleton trial.csv > bat.toml

    Then: mocap track trial.csv --skeleton bat.toml --out out/trial
    """
    from mocap.io.output import result_file
    from mocap.proposing.propose_skeleton import Proposal, propose_skeleton
    from mocap.skeleton_files import is_model, read_model
    from mocap.text import number_of

    recording = None
    if len(tracks) > 1 or not is_model(tracks[0]):
        with progress() as tell, Stages(tell=tell).stage(options.stage):
            recording = _read(tracks, options)
    inputs = tuple(tracks) if recording is None else recording.inputs
    with nullcontext() if out is None else result_file(out, replace=force, inputs=inputs, tell=say) as file:
        if recording is None:
            model, text = read_model(tracks[0])
            found = Proposal(skeleton=model, text=text)
        else:
            with progress() as tell, Stages(tell=tell).stage("clean, propose a skeleton"):
                found = propose_skeleton(recording, names=names)
        if file is not None:
            file.write_text(found.text, encoding="utf-8", newline="")
    counts = {
        "markers": len(found.skeleton.markers),
        "bones": len(found.skeleton.bones),
        "trunk": len(found.skeleton.trunk),
        "bodies": len(found.skeleton.bodies),
        "joints": len(found.skeleton.joints) + len(found.skeleton.body_joints),
        "cycles": len(found.skeleton.measures.strokes) + len(found.skeleton.measures.feet),
    }
    if as_json:
        print(json.dumps({"out": None if out is None else str(out), **counts, "text": found.text}))  # noqa: T201
    elif out is None:
        sys.stdout.buffer.write(found.text.encode("utf-8"))  # whatever the encoding of the terminal: it becomes a file
        sys.stdout.flush()
    parts = [number_of(counts["markers"], "marker"), number_of(counts["bones"], "bone")]
    parts += [number_of(counts["bodies"], "rigid body", "rigid bodies")] if counts["bodies"] else []
    parts += [number_of(counts["joints"], "joint")]
    parts += [f"a trunk of {number_of(counts['trunk'], 'marker')}" if counts["trunk"] else "no trunk"]
    still = ["no limb moves in cycles: cycles.csv stays empty unless [measures] names one"]
    say(
        *map(str, recording.findings if recording else ()),
        f"proposed: {', '.join(parts)}; check and correct it",
        *([] if counts["cycles"] or recording is None else still),
    )


def _read(tracks: list[Path], options: RecordingOptions) -> "Recording":
    """The recording, with any frame rate where none is known: distances, angles and cycles do not depend on it."""
    from mocap.errors import NoRateError

    try:
        return options.read(tracks)
    except NoRateError:
        return replace(options, fps=100.0).read(tracks)
