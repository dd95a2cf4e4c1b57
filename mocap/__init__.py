"""Motion capture of animals: clean marker tracks, gaps filled with honest uncertainty, empirical potentials.

``read`` a recording (or take one ``from_arrays``), ``track`` it, look at ``markers``, ``joints`` and potentials,
``save`` and ``load``; ``learn`` a model from several recordings. What is heavy is imported when it is first used.
"""

from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mocap.batches.run import Batch, batch, load_batch
    from mocap.digitising.digitised import Digitised, digitise
    from mocap.digitising.labelled import LabelledRecording, label
    from mocap.errors import MocapError
    from mocap.findings import Finding
    from mocap.io.format import Hints
    from mocap.pipeline.arrays import from_arrays, from_pixels
    from mocap.pipeline.cleaning import clean
    from mocap.pipeline.learning import Model, learn, load_model
    from mocap.pipeline.propose_skeleton import propose_skeleton
    from mocap.pipeline.reading import read
    from mocap.pipeline.recording import Recording
    from mocap.results.joint_comparison import compare_joints
    from mocap.results.many import learn_joints
    from mocap.results.tracked import Tracked, load, track
    from mocap.side_by_side import processes
    from mocap.skeleton import Skeleton

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
    "processes",
    "propose_skeleton",
    "read",
    "track",
]

_PLACES = {
    "Batch": "mocap.batches.run",
    "Digitised": "mocap.digitising.digitised",
    "Finding": "mocap.findings",
    "Hints": "mocap.io.format",
    "LabelledRecording": "mocap.digitising.labelled",
    "MocapError": "mocap.errors",
    "Model": "mocap.pipeline.learning",
    "Recording": "mocap.pipeline.recording",
    "Skeleton": "mocap.skeleton",
    "Tracked": "mocap.results.tracked",
    "batch": "mocap.batches.run",
    "clean": "mocap.pipeline.cleaning",
    "compare_joints": "mocap.results.joint_comparison",
    "digitise": "mocap.digitising.digitised",
    "from_arrays": "mocap.pipeline.arrays",
    "from_pixels": "mocap.pipeline.arrays",
    "label": "mocap.digitising.labelled",
    "learn": "mocap.pipeline.learning",
    "learn_joints": "mocap.results.many",
    "load": "mocap.results.tracked",
    "load_batch": "mocap.batches.run",
    "processes": "mocap.side_by_side",
    "load_model": "mocap.pipeline.learning",
    "propose_skeleton": "mocap.pipeline.propose_skeleton",
    "read": "mocap.pipeline.reading",
    "track": "mocap.results.tracked",
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
