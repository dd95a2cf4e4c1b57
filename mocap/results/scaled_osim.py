"""A generic OpenSim model scaled to the animal: by OpenSim itself, with factors measured between markers."""

from collections.abc import Mapping
from csv import writer
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from eal.needs import MissingPackageError
from mocap.errors import MocapError
from mocap.records import MarkerTracks, Status
from mocap.results.mjcf import plain_name
from mocap.tracking.result import Result

FILE, TABLE = "scaled.osim", "scale_factors.csv"

Places = Mapping[str, Mapping[str, Array]]
"""For each body (3,) places of markers in its frame, m."""


@dataclass(frozen=True, kw_only=True)
class BodyScale:
    """By what a body is scaled.

    Attributes:
        factor: Measured over generic length.
        pairs: Pairs of markers that tell; 0: none, and the factor is the median of the other bodies.
        spread: Standard deviation of the pairs' own factors; NaN of fewer than two.
    """

    factor: float
    pairs: int
    spread: float


def write_scaled_osim(run: Result, generic: Path, folder: Path) -> dict[str, BodyScale]:
    """Write ``scaled.osim`` and ``scale_factors.csv``.

    A body is scaled alike in all directions, by f = sum(m d) / sum(d d) over pairs of its markers, where d is their
    distance in the generic model and m the median measured one. A marker at the centre of a joint belongs to the bodies
    on both sides. OpenSim scales all that hangs on bodies (joints, meshes, muscles), and masses by f cubed.

    Args:
        run: A tracked recording; markers of the same name as in the model, upper or lower case, are the same.
        generic: A model of OpenSim (.osim).
        folder: Where to.

    Raises:
        MissingPackageError: OpenSim is not installed.
        MocapError: the file is no model, or no body of it has two markers of the recording.
    """
    if find_spec("opensim") is None:
        raise MissingPackageError("--scale-osim needs the package opensim, not installed here: run pip install opensim")
    opensim = import_module("opensim")
    opensim.Logger.removeFileSink()  # it would write a file beside the user's own
    opensim.Logger.setLevelString("Off")
    try:
        model = opensim.Model(str(generic))
        state = model.initSystem()
    except RuntimeError as error:
        why = " ".join(str(error).split())[:200]
        raise MocapError(f"{generic}: OpenSim does not read it as a model: {why}") from None
    found = factors(_places(model, state), run.tracks, name=generic.name)
    scales = opensim.ScaleSet()
    for body, one in found.items():
        scale = opensim.Scale()
        scale.setSegmentName(body)
        scale.setScaleFactors(opensim.Vec3(one.factor, one.factor, one.factor))
        scale.setApply(True)
        scales.cloneAndAppend(scale)
    if not model.scale(state, scales, False):
        raise MocapError(f"{generic}: OpenSim refuses to scale it")
    model.setName(f"{model.getName()}_{plain_name(run.name)}")
    model.printToXML(str(folder / FILE))
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as stream:
        rows = writer(stream, lineterminator="\n")
        rows.writerow(["body", "factor", "pairs", "spread"])
        for body, one in found.items():
            rows.writerow([body, f"{one.factor:.6g}", one.pairs, "" if np.isnan(one.spread) else f"{one.spread:.3g}"])
    return found


def factors(places: Places, markers: MarkerTracks, *, name: str) -> dict[str, BodyScale]:
    """By what each body is scaled; see ``write_scaled_osim``.

    Raises:
        MocapError: no body has two markers of the recording.
    """
    index = {plain_name(marker).lower(): i for i, marker in enumerate(markers.names)}
    xyz = np.where((markers.status == Status.MEASURED)[..., None], markers.xyz_m, np.nan)
    found: dict[str, tuple[Array, Array]] = {}
    for body, own in places.items():
        placed = [(place, index[marker.lower()]) for marker, place in own.items() if marker.lower() in index]
        pairs = []
        for (a, i), (b, j) in combinations(placed, 2):
            measured = np.linalg.norm(xyz[:, i] - xyz[:, j], axis=-1)
            length = float(np.linalg.norm(a - b))
            if np.isfinite(measured).sum() >= 5 and length > 0:
                pairs.append((length, float(np.nanmedian(measured))))
        if pairs:
            found[body] = tuple(np.array(pairs).T)
    if not found:
        there = sorted({marker for own in places.values() for marker in own})
        raise MocapError(
            f"{name}: no body of this model has two markers of the recording, by which it could be scaled: its markers "
            f"are {', '.join(there[:8]) or 'none'}; those of the recording {', '.join(markers.names[:8])}: give them "
            "the same names"
        )
    out = {}
    for body, (generic, measured) in found.items():
        ratio = measured / generic
        spread = float(ratio.std(ddof=1)) if len(ratio) > 1 else float("nan")
        out[body] = BodyScale(factor=float(measured @ generic / (generic @ generic)), pairs=len(ratio), spread=spread)
    middle = float(np.median([one.factor for one in out.values()]))
    return {body: out.get(body, BodyScale(factor=middle, pairs=0, spread=float("nan"))) for body in places}


def _places(model: Any, state: Any) -> Places:
    """Markers in the frames of the bodies that they belong to."""
    out: dict[str, dict[str, Array]] = {body.getName(): {} for body in model.getBodySet()}
    ground = []
    for marker in model.getMarkerSet():
        frame = marker.getParentFrame()
        holder, base = frame.findBaseFrame().getName(), frame.findTransformInBaseFrame()
        ground.append(_vector(marker.getLocationInGround(state)))
        if holder in out:
            out[holder][marker.getName()] = _vector(base.shiftFrameStationToBase(marker.get_location()))
    extent = float(np.ptp(np.array(ground), axis=0).max()) if ground else 0.0
    for joint in model.getJointSet():
        ends = []
        for frame in (joint.getParentFrame(), joint.getChildFrame()):
            ends.append((frame.findBaseFrame().getName(), _vector(frame.findTransformInBaseFrame().p())))
        if any(body not in out for body, _ in ends):
            continue  # the ground
        for (here, centre), (there, seen_there) in (ends, ends[::-1]):
            # markers so near to a joint belong to both bodies
            near = [m for m, at in out[here].items() if np.linalg.norm(at - centre) <= 0.02 * extent]
            for marker in near:
                out[there].setdefault(marker, seen_there)
    return out


def _vector(v: Any) -> Array:
    return np.array([v.get(k) for k in range(3)])
