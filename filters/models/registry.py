"""The motion models by name: what ``--model`` takes, what reports call them, what model files have.

A new one is a file beside this one, a line here and one in ``mocap.filters.models.named``, or an entry point
``mocap.models`` of another installed package.
"""

from mocap.filters.models.about import NamedModel  # before plugins are loaded, which take it from here
from mocap.filters.models.articulated import ArticulatedSettings
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.constant_velocity import LastingSettings, MarkerSettings
from mocap.filters.models.lagrangian import LagrangianSettings
from mocap.filters.models.named import ELSEWHERE, OURS
from mocap.filters.models.pose import PoseSettings
from mocap.filters.models.smooth_acceleration import SmoothSettings

__all__ = ["MODELS", "NAMED", "NamedModel"]

_SETTINGS: dict[str, TrajectoryModel] = {
    "eal": PoseSettings(),
    "articulated": ArticulatedSettings(),
    "lagrangian": LagrangianSettings(),
    "smooth_acceleration": SmoothSettings(),
    "constant_velocity": MarkerSettings(),
}
NAMED: dict[str, NamedModel[TrajectoryModel]] = {
    **{name: NamedModel(_SETTINGS[name], *one[1:]) for name, one in OURS.items()},
    **ELSEWHERE,
}
MODELS: dict[str, type[TrajectoryModel]] = {
    "articulated": ArticulatedSettings,
    "constant velocity": MarkerSettings,
    "lagrangian": LagrangianSettings,
    "lasting acceleration": LastingSettings,
    "pose": PoseSettings,
    "smooth acceleration": SmoothSettings,
    **{name: type(one.settings) for name, one in ELSEWHERE.items()},
}
"""By the names that model files have for them."""
