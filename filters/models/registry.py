"""The motion models by the names that model files have for them."""

from mocap.filters.models.articulated import ArticulatedSettings
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.models.singer import LastingSettings

MODELS: dict[str, type[TrajectoryModel]] = {
    "articulated": ArticulatedSettings,
    "constant velocity": MarkerSettings,
    "lasting acceleration": LastingSettings,
    "pose": PoseSettings,
}
