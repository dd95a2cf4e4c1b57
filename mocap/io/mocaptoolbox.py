"""Motion-capture structures of the MoCap Toolbox for MATLAB (Burger & Toiviainen 2013), saved as MATLAB files."""

from pathlib import Path
from typing import Any

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording
from mocap.io.format import Format
from mocap.io.head import Head
from mocap.io.matlab import variables
from mocap.io.optical import rate, told_apart

_FIELDS = {"type", "nMarkers", "freq", "markerName", "data"}


def _structures(path: Path) -> dict[str, Any]:
    """The variables that are such structures, by name."""
    found = variables(path).items()
    return {name: own for name, own in found if isinstance(own, dict) and own.keys() >= _FIELDS}


def _read(path: Path) -> FileContents:
    """Positions of ``data``, frames x (x, y, z of each marker); the structure states no unit.

    Raises:
        FormatError: there are several structures, or one holds derivatives or norms, or contradicts itself.
    """
    own, *others = _structures(path).items()
    if others:
        names = ", ".join(name for name, _ in (own, *others))
        raise FormatError(f"{path.name}: has the structures {names}; expected one: save one alone")
    name, table = own
    if str(table["type"]) != "MoCap data" or np.any(table.get("timederOrder", 0)):
        raise FormatError(
            f"{path.name}: {name} is of type {str(table['type'])!r} and order {table.get('timederOrder', 0)} of "
            "derivatives; expected 'MoCap data' and 0, positions of markers"
        )
    data = np.atleast_2d(np.asarray(table["data"], dtype=np.float64))
    names = [str(name) for name in np.ravel(np.asarray(table["markerName"], dtype=object))]
    if data.ndim != 2 or data.shape[1] != 3 * len(names) or np.any(table["nMarkers"] != len(names)):
        raise FormatError(
            f"{path.name}: {name}.data has shape {data.shape}, nMarkers is {table['nMarkers']}, for {len(names)} "
            "names; expected x, y, z of each marker: save it again"
        )
    names, findings = told_apart(names)
    return point_recording(
        path,
        "mocaptoolbox",
        names=names,
        xyz=data.reshape(len(data), -1, 3),
        unit=None,
        fps=rate(path, table["freq"]),
        findings=tuple(findings),
    )


def _knows(head: Head) -> bool:
    return bool(head.mat) and not head.mat & {"easyWandData", "camud"} and bool(_structures(head.path))


FORMATS = (
    Format(
        name="mocaptoolbox",
        title="structure of the MoCap Toolbox (MATLAB)",
        knows=_knows,
        read=lambda path, _: _read(path),
    ),
)
