"""The movies of a recording's cameras."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from eal.over_time import OverTime, at_frames
from mocap.findings import Finding
from mocap.io.movies import Movie
from mocap.parts import of_the_whole
from mocap.recording import Recording


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraFootage:
    """The movie of one camera.

    Attributes:
        movie: The movie.
        frames: (T,) its frame, from 0, for each frame of the recording; outside of the movie there is no image.
        straight: True where its pixels are ideal ones already: no lens, or undistorted before.
    """

    movie: Movie
    frames: OverTime[NDArray[np.int64]]
    straight: bool

    @property
    def there(self) -> NDArray[np.bool_]:
        """(T,) frames of the recording that have an image."""
        return (self.frames >= 0) & (self.frames < self.movie.n_frames)


@dataclass(frozen=True, eq=False, kw_only=True)
class Footage:
    """The movies of all cameras.

    Attributes:
        cameras: One of each camera.
    """

    cameras: tuple[CameraFootage, ...]

    step: ClassVar[str] = "track"
    depends_on: ClassVar[tuple[str, ...]] = ()

    def at(self, frames: NDArray[np.int64]) -> Self:
        """Of these frames."""
        return replace(self, cameras=tuple(at_frames(one, frames) for one in self.cameras))

    only = of_the_whole

    def findings(self) -> tuple[Finding, ...]:
        """None: the report says what is shown."""
        return ()

    def to_file(self, folder: Path) -> dict[str, Any]:  # noqa: ARG002
        """Nothing: movies are open files, and stay where they are."""
        return {}

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:  # noqa: ARG003
        """No movie."""
        return cls(cameras=())


def footage(run: Recording) -> tuple[CameraFootage, ...]:
    """The movie of each camera; empty where none were given."""
    found = run.get(Footage)
    return () if found is None else found.cameras
