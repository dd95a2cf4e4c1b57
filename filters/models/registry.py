"""The motion models by name: what ``--model`` takes, what reports call them, what model files have.

A new one is a file beside this one and a line here, or an entry point ``mocap.models`` of another installed package.
"""

from typing import NamedTuple

from mocap.filters.models.articulated import LAGRANGIAN, ArticulatedSettings
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.constant_velocity import LastingSettings, MarkerSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.models.smooth_acceleration import SmoothSettings

from eal.plugins import offered


class NamedModel(NamedTuple):
    """A model that people name, which learns from the recording that it tracks.

    Attributes:
        settings: The model.
        title: What tables call it.
        about: What it is, in a few words.
        posed: Whether it learns poses: of four markers and more, that are seen together.
        beside: Models that hidden samples are filled with, too, to be compared.
    """

    settings: TrajectoryModel
    title: str
    about: str
    posed: bool = True
    beside: tuple[str, ...] = ()


ELSEWHERE: dict[str, NamedModel] = offered("mocap.models", NamedModel)
"""Those of other packages."""
NAMED: dict[str, NamedModel] = {
    "eal": NamedModel(PoseSettings(), "pose model", "Kalman smoother of the whole pose with its joint potentials"),
    "articulated": NamedModel(
        ArticulatedSettings(), "joint angles", "Kalman smoother of joint angles, segments of constant length",
        beside=("eal",),
    ),
    "lagrangian": NamedModel(
        ArticulatedSettings(pose=LAGRANGIAN, mechanics="lagrangian"), "Lagrangian",
        "joint angles moved by the forces of the animal's masses", beside=("eal", "articulated"),
    ),
    "smooth_acceleration": NamedModel(
        SmoothSettings(), "smooth acceleration",
        "Kalman smoother of each marker alone, as smooth, quick and noisy as the recording shows", posed=False,
        beside=("constant_velocity",),
    ),
    "constant_velocity": NamedModel(
        MarkerSettings(), "constant velocity", "Kalman smoother of each marker alone", posed=False
    ),
    **ELSEWHERE,
}  # fmt: skip
MODELS: dict[str, type[TrajectoryModel]] = {
    "articulated": ArticulatedSettings,
    "constant velocity": MarkerSettings,
    "lasting acceleration": LastingSettings,
    "pose": PoseSettings,
    "smooth acceleration": SmoothSettings,
    **{name: type(one.settings) for name, one in ELSEWHERE.items()},
}
"""By the names that model files have for them."""
