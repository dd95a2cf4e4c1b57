"""The flights: a network's clicks with likelihoods in every frame, and the points of two people in some frames."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mocap
from eal.arrays import Array
from mocap.cameras.triangulate import linear
from mocap.recording import Recording

FOLDER = "bat_arena_two_digitisers"
FPS = 800.0
NETWORKS = {"augmented": "LRSWAP", "plain": "NOLRSWAP"}
"""Networks by whether their training pictures were mirrored: folders begin so. The plain one swaps sides often."""
PAIRS = ((0, 14), (1, 12), (2, 13), (3, 11), (4, 9), (5, 10))
"""Left and right of the landmarks t3L wstL t5L elbL shdL ankL nl str lmb shdR ankR elbR wstR t5R t3R tail."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """One flight as a network digitised it, and what two people made of some of its frames.

    Attributes:
        name: Of the flight.
        recording: The network's files with calibration, lens and crop offsets.
        likelihood: (C, T, M) the network's own likelihood of each click.
        people: The two projects of the people, as recordings.
        people_px: (2, C, T, M, 2) their ideal pixels; NaN where they did not click.
        people_m: (2, T, M, 3) their points, by plain triangulation.
    """

    name: str
    recording: Recording
    likelihood: Array
    people: tuple[Recording, Recording]
    people_px: Array
    people_m: Array

    @property
    def truth_m(self) -> Array:
        """(T, M, 3) mean of both people; NaN where one of them has no point."""
        return self.people_m.mean(axis=0)

    @property
    def judged(self) -> NDArray[np.int64]:
        """Frames in which there is any truth."""
        return np.flatnonzero(np.isfinite(self.truth_m[..., 0]).any(axis=1))


def read_flights(data: Path, network: str, *, most: int | None = None) -> list[Flight]:
    """All flights of the folder.

    Args:
        data: Folder of the real recordings.
        network: A key of ``NETWORKS``.
        most: So many of them; None: all.
    """
    folder = data / FOLDER
    root = next(folder.glob(f"{NETWORKS[network]}_*"))
    return [_flight(folder, views) for views in sorted(root.iterdir())[:most]]


def _flight(folder: Path, views: Path) -> Flight:
    rig = {
        "calibration": next(folder.glob("*easyWandData.mat")),
        "profile": next(folder.glob("*Tforms.mat")),
        "fps": FPS,
        "crop": folder / "crop_files" / views.name,
        "origin": "upper-left",
    }
    by_camera = sorted(views.glob("*.csv"), key=lambda path: path.name[path.name.index("Cam") :])
    recording = mocap.read(by_camera, **rig)
    people = tuple(
        mocap.read(next((folder / f"validation_files_{n}").glob(f"{views.name}_*.mat")), **rig) for n in (1, 2)
    )
    people_px = np.full((2, *recording.ideal_px.shape), np.nan)
    for person, found in enumerate(people):
        row = np.rint(found.t_s * FPS).astype(np.int64)
        people_px[person][:, row] = found.ideal_px
    score = recording.score
    return Flight(
        name=views.name,
        recording=recording,
        likelihood=np.ones(recording.ideal_px.shape[:3]) if score is None else score,
        people=people,  # type: ignore[arg-type]
        people_px=people_px,
        people_m=np.stack([linear(recording.matrices, px) for px in people_px]),
    )
