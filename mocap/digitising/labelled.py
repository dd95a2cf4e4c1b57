"""Names for unlabelled trajectories of an optical system."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from mocap.digitising.label import Labelled
from mocap.digitising.label import label as label_segments
from mocap.digitising.pose import fit_poses
from mocap.errors import FormatError
from mocap.filters.model import LearnedModel
from mocap.io.contents import FileContents
from mocap.io.format import Hints
from mocap.io.output import result_file
from mocap.io.registry import read, write, writer
from mocap.io.unstated_unit import in_metres
from mocap.pipeline.learning import Model, load_model
from mocap.records import marker_tracks

PathText = str | PathLike[str]


@dataclass(frozen=True, eq=False)
class LabelledRecording:
    """A recording whose trajectories were named.

    Attributes:
        contents: The named markers, and what stays unnamed as ``U_1``, ``U_2``, ...
        found: Segments of trajectories and their names.
        names: The M markers of the model.
    """

    contents: FileContents
    found: Labelled
    names: tuple[str, ...]

    @property
    def summary(self) -> Mapping[str, int]:
        """Numbers of samples and segments that were named and that were not."""
        size = np.array([s.last - s.first + 1 for s in self.found.segments], dtype=np.int64)
        named = self.found.marker >= 0
        return {
            "named_samples": int(size[named].sum()),
            "unnamed_samples": int(size[~named].sum()),
            "named_segments": int(named.sum()),
            "unnamed_segments": int((~named).sum()),
        }

    def save(self, path: PathText, *, overwrite: bool = False) -> list[str]:
        """Write it in the format that the end of the name says; returns what that format does not hold.

        Raises:
            OutputError: it cannot be written there.
            FormatError: no format has such a name.
        """
        out = Path(path)
        with result_file(out, replace=overwrite, inputs=self.contents.paths) as file:
            return self.write(file)

    def write(self, file: Path) -> list[str]:
        """Write the file of ``save``, as ``mocap.io.output.result_file`` gives it."""
        return write(self.contents, file, writer(file, None).name)


def label(
    tracks: PathText,
    *,
    model: PathText | Model,
    unit: str | None = None,
    fps: float | None = None,
    hints: Hints | None = None,
) -> LabelledRecording:
    """Name the trajectories of a recording (C3D with ``*1``, ``U_5``, ...; Qualisys, Vicon) by a learned model.

    Whatever names the file has are not read: all trajectories are named anew. They are cut at gaps and jumps; in
    frames with many points the animal is recognised by distances between markers that hardly change, and the other
    pieces follow from where the pose puts each marker and from how pieces go on in each other. A name is given where
    every other one, and that the point is no marker at all, is less likely by exp(6); all else stays unnamed.

    Args:
        tracks: Positions in any format that mocap knows.
        model: A file of ``mocap learn``, or a model: its trials hold poses of this kind of animal with these markers.
        unit: Unit of lengths, where the file does not state it.
        fps: Frames a second, where the file does not state it.
        hints: How the file is to be read where it does not say so itself.

    Raises:
        FormatError: the file holds no positions, or cannot be read.
        MocapError: the animal is not recognised in any frame, or the model has too few poses.
    """
    contents, _ = in_metres(read(Path(tracks), hints or Hints()), unit)
    contents = contents if fps is None else contents.with_rate(fps)
    if contents.points is None:
        raise FormatError(f"{Path(tracks).name}: contains no positions ({contents.format}): give trajectories in space")
    learned: LearnedModel = (model if isinstance(model, Model) else load_model(model)).learned
    trunk = [learned.names.index(name) for name in learned.trunk if name in learned.names]
    poses = fit_poses(np.concatenate([trial.xyz_m for trial in learned.trials]), trunk, rank=12)
    if poses is None:
        raise FormatError("`model`: its trials hold too few poses that show half of the markers: learn it from more")
    found = label_segments(contents.points.xyz_m, poses)
    named, left = found.tracks(contents.points.xyz_m, len(learned.names))
    left = packed(left)
    count = left.shape[1]
    extra, number = [], 0
    while len(extra) < count:
        number += 1
        if f"U_{number}" not in learned.names:
            extra.append(f"U_{number}")
    points = marker_tracks((*learned.names, *extra), contents.points.t_s, np.concatenate([named, left], axis=1))
    clean = replace(contents, names=points.names, points=points, animals=(), score=None, tables={})
    return LabelledRecording(clean, found, learned.names)


def packed(left: np.ndarray) -> np.ndarray:
    """(T, K, 3) of trajectories (T, N, 3) in as few columns as they need, none joined within five frames."""
    columns: list[np.ndarray] = []
    for column in left.transpose(1, 0, 2):
        seen = np.flatnonzero(np.isfinite(column[:, 0]))
        if not len(seen):
            continue
        first, last = max(int(seen[0]) - 5, 0), int(seen[-1]) + 6
        for other in columns:
            if np.isnan(other[first:last]).all():
                other[seen] = column[seen]
                break
        else:
            columns.append(column.copy())
    return np.stack(columns, axis=1) if columns else np.zeros((len(left), 0, 3))
