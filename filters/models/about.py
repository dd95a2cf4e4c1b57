"""What a motion model that people name says of itself."""

from typing import Generic, NamedTuple, TypeVar

Settings = TypeVar("Settings")


class NamedModel(NamedTuple, Generic[Settings]):
    """A model that people name, which learns from the recording that it tracks.

    Attributes:
        settings: The model, a ``mocap.filters.models.base.TrajectoryModel``.
        title: What tables call it.
        about: What it is, in a few words.
        posed: Whether it learns poses: of four markers and more, that are seen together.
        beside: Models that hidden samples are filled with, too, to be compared.
    """

    settings: Settings
    title: str
    about: str
    posed: bool = True
    beside: tuple[str, ...] = ()
