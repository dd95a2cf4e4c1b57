"""Motion capture of animals: clean marker tracks, gaps filled with honest uncertainty, empirical potentials.

``read`` a recording (or take one ``from_arrays``), ``track`` it, look at ``markers``, ``joints`` and potentials,
``save`` and ``load``; ``learn`` a model from several recordings. What is heavy is imported when it is first used.
"""

from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mocap.batches.run import Batch, batch, load_batch
    from mocap.cleaning.cleaning import clean
    from mocap.digitising.digitised import Digitised, digitise
    from mocap.digitising.labelled import LabelledRecording, label
    from mocap.errors import MocapError
    from mocap.findings import Finding
    from mocap.io.format import Hints
    from mocap.proposing.propose_skeleton import propose_skeleton
    from mocap.reading.arrays import from_arrays, from_pixels
    from mocap.reading.reading import read
    from mocap.recording import Recording
    from mocap.results.joint_comparison import compare_joints
    from mocap.results.joint_mobility import mobility
    from mocap.results.many import learn_joints
    from mocap.results.tracked import Tracked, load, track
    from mocap.side_by_side import processes
    from mocap.skeleton import Skeleton
    from mocap.tracking.learning import Model, learn, load_model

__all__ = [
    "Batch",
    "Digitised",
    "Finding",
    "Hints",
    "LabelledRecording",
    "MocapError",
    "Model",
    "Recording",
    "Skeleton",
    "Tracked",
    "batch",
    "clean",
    "compare_joints",
    "digitise",
    "from_arrays",
    "from_pixels",
    "label",
    "learn",
    "learn_joints",
    "load",
    "load_batch",
    "load_model",
    "mobility",
    "processes",
    "propose_skeleton",
    "read",
    "track",
]

_PLACES = {  # the module of each public name
    name: module
    for module, names in {
        "mocap.batches.run": "Batch batch load_batch",
        "mocap.digitising.digitised": "Digitised digitise",
        "mocap.digitising.labelled": "LabelledRecording label",
        "mocap.errors": "MocapError",
        "mocap.findings": "Finding",
        "mocap.io.format": "Hints",
        "mocap.reading.arrays": "from_arrays from_pixels",
        "mocap.cleaning.cleaning": "clean",
        "mocap.tracking.learning": "Model learn load_model",
        "mocap.proposing.propose_skeleton": "propose_skeleton",
        "mocap.reading.reading": "read",
        "mocap.recording": "Recording",
        "mocap.results.joint_comparison": "compare_joints",
        "mocap.results.joint_mobility": "mobility",
        "mocap.results.many": "learn_joints",
        "mocap.results.tracked": "Tracked load track",
        "mocap.side_by_side": "processes",
        "mocap.skeleton": "Skeleton",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _PLACES:
        raise AttributeError(f"module 'mocap' has no attribute {name!r}")
    from importlib import import_module
    from inspect import isfunction

    from mocap.calls import with_advice

    found = getattr(import_module(_PLACES[name]), name)
    if isfunction(found) and not hasattr(found, "__wrapped__"):  # `processes` is a context manager
        found = with_advice(found, {one: partial(__getattr__, one) for one in _PLACES})
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
