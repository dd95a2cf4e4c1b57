"""The motion models by the names that model files have for them."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from mocap.filters.models.articulated import ArticulatedSettings
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.models.delayed_poses import DelaySettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.models.singer import LastingSettings

MODELS: dict[str, type[TrajectoryModel]] = {
    "articulated": ArticulatedSettings,
    "constant velocity": MarkerSettings,
    "delayed poses": DelaySettings,
    "lasting acceleration": LastingSettings,
    "pose": PoseSettings,
}


def written(model: TrajectoryModel) -> dict[str, Any]:
    """A model as JSON: its name and its settings.

    Raises:
        KeyError: it is not in ``MODELS``.
    """
    names = {kind: name for name, kind in MODELS.items()}
    settings = {f.name: getattr(model, f.name) for f in fields(model)}
    return {"model": names[type(model)], **{key: _written(value) for key, value in settings.items()}}


def _written(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_written(one) for one in value]
    return written(value) if isinstance(value, TrajectoryModel) else value


def read(settings: Mapping[str, Any]) -> TrajectoryModel:
    """A model as ``written`` wrote it.

    Raises:
        KeyError: it has another name.
        TypeError: it has other settings.
    """
    values = {key: _read(value) for key, value in settings.items() if key != "model"}
    return MODELS[settings["model"]](**values)


def _read(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_read(one) for one in value)
    return read(value) if isinstance(value, dict) else value
