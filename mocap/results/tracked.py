"""Track a recording; its markers, joints and potentials as objects for a notebook."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
import pandas as pd
import xarray as xr

from eal.arrays import Array, short_repr
from mocap.errors import MocapError
from mocap.filters.velocities import with_means
from mocap.io.movies import Movie, open_movies
from mocap.io.output import result_file, result_folder
from mocap.joints import FRAMES
from mocap.kinematics.cycles import Cycle, Footfalls, cycles, footfalls, why_none
from mocap.kinematics.frequency import Frequency, frequencies
from mocap.kinematics.moments import moments
from mocap.kinematics.records import Kinematics
from mocap.measures import JointAxes
from mocap.options import TrackOptions
from mocap.plots.kinematics import plot_coordinates
from mocap.plots.page import tracked_html, write_page
from mocap.progress import Stages, Tell, bars, silent
from mocap.reading.reading import animal
from mocap.recording import Recording, as_recording
from mocap.records import Status
from mocap.report.job import run_job
from mocap.results.blocks import is_long, load_range
from mocap.results.cycle_table import CycleTable, cycle_table
from mocap.results.exports import EXPORTS, TABLES, write_axes
from mocap.results.stored import markers_dataset, plane_dataset, read_recording
from mocap.results.tables import write_cycles, write_kinematics, write_plane, write_run
from mocap.side_by_side import call_all
from mocap.skeleton import Skeleton
from mocap.text import number_of
from mocap.tracking.body_potential import BodyPotential, body_potential
from mocap.tracking.learning import Model, load_model
from mocap.tracking.potentials import JointPotential
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result, rate_points
from mocap.tracking.track_part import MODELS, existing_model

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mocap.plots.notebook import Plots
    from mocap.rerun.viewer import Viewer
    from mocap.results.scaled_osim import BodyScale

LIMB = "limb"
"""Frame of reference of a plot: the plane of the limb, its joint at the origin."""


@dataclass(frozen=True, eq=False)
class JointOverTime:
    """A joint over time: where its child marker is, as its centre sees it (``mocap.joints``).

    Attributes:
        name: Its name in the skeleton.
        t_s: (T,) times.
        q_m: Coordinates (T, d) in metres by frame of reference: world, body (d = 3), plane, limb (d = 2).
        sd_m: (T,) standard deviation of a coordinate.
        filled: (T,) frames with coordinates in which one of its three markers was not measured.
    """

    name: str
    t_s: Array
    q_m: Mapping[str, Array]
    sd_m: Array
    filled: np.ndarray

    __repr__ = short_repr

    def to_dataframe(self) -> pd.DataFrame:
        """A row a frame, by time in seconds: ``<frame>_x_m``, ..., ``sd_m``, and ``filled``."""
        columns: dict[str, np.ndarray] = {
            f"{frame}_{'xyz'[k]}_m": q[:, k] for frame, q in self.q_m.items() for k in range(q.shape[1])
        }
        columns |= {"sd_m": self.sd_m, "filled": self.filled}
        return pd.DataFrame(columns, index=pd.Index(self.t_s, name="t_s"))

    def plot(self, frame: str = LIMB, *, ax: "Axes | None" = None) -> "Axes":
        """Coordinates in a frame of reference over time, with their 95 % intervals.

        Raises:
            MocapError: there is no such frame of reference.
        """
        if frame not in self.q_m:
            raise MocapError(f"there is no frame of reference {frame!r}: give one of {', '.join(self.q_m)}")
        q = self.q_m[frame]
        labels = ("along", "across") if q.shape[1] == 2 else ("x", "y", "z")
        title = f"{self.name}, {frame}"
        return plot_coordinates(self.t_s, q, self.sd_m, self.filled, labels=labels, title=title, ax=ax)


def _write_run(result: "Tracked", folder: Path, pictures: bool, *, progress: object = None) -> None:  # noqa: ARG001
    from mocap.rerun.record import write_recording

    write_run(result, folder, write_recording=write_recording if pictures else None)


def _write_kinematics(result: "Tracked", folder: Path, pictures: bool, *, progress: object = None) -> None:  # noqa: ARG001
    result.write_kinematics(folder, pictures=pictures)


@dataclass(frozen=True, eq=False, repr=False)
class Tracked(Result):
    """A recording that was tracked: the same record, with what is computed of it, drawn, and written."""

    @cached_property
    def markers(self) -> xr.Dataset:
        """Markers with covariance and status, laid out as the package movement does (``mocap.results.stored``)."""
        return markers_dataset(self) if self.plane is None else plane_dataset(self)

    @cached_property
    def joints(self) -> Mapping[str, JointOverTime]:
        """The joints of the skeleton that were tracked; none where no skeleton was given."""
        tracked = self.data["joint"].values.tolist() if "joint" in self.data.coords else []
        return {joint.name: self._joint(joint.name) for joint in self.skeleton.joints if joint.name in tracked}

    @cached_property
    def moments(self) -> Kinematics:
        """Net joint forces (N) and moments (N m) by inverse dynamics, each with its standard deviation.

        Of joints beyond which every part has a mass (``[measures.segments]``) and no unknown force acts: not of wings,
        nor while a foot stands; ``notes`` says which joints were left out and why (``mocap.kinematics.moments``).

        Raises:
            MocapError: the recording is one video, in the plane of its image.
        """
        self.in_space("moments")
        return moments(self.motion, self.skeleton, steps=self.footfalls, recording=self.name)

    def _joint(self, name: str) -> JointOverTime:
        markers = self.tracks
        q_m = {frame: of[name] for frame in FRAMES if (of := self.joints_m(frame))}
        joint = next(j for j in self.skeleton.joints if j.name == name)
        there = np.isfinite(next(iter(q_m.values()))[:, 0])
        three = [markers.names.index(m) for m in (joint.parent, joint.centre, joint.child)]
        return JointOverTime(
            name=name,
            t_s=self.t_s,
            q_m=q_m,
            sd_m=self.data["joint_sd"].sel(joint=name).values,
            filled=there & (markers.status[:, three] != Status.MEASURED).any(axis=1),
        )

    @overload
    def potential(self) -> tuple[str, ...]: ...
    @overload
    def potential(self, joint: str, *, translations: bool = False) -> JointPotential | BodyPotential: ...
    def potential(
        self, joint: str | None = None, *, translations: bool = False
    ) -> JointPotential | BodyPotential | tuple[str, ...]:
        """The empirical potential of a joint, with ``value``, ``at``, ``gradient`` and ``plot``.

        Args:
            joint: Its name; of a joint between bodies V_z is on its rotation. None: the names of those that there are.
            translations: Of a joint between bodies: on all its six coordinates.

        Raises:
            MocapError: there is none of that name, or too few samples were measured.
        """
        bodies = tuple(one.name for one in self.skeleton.body_joints)
        if joint is None:
            return (*self.potentials, *bodies)
        if joint in bodies:
            axes = self.skeleton.measures.axes.get(joint, JointAxes())
            return body_potential(self.kinematics, joint, axes.sequence, translations=translations)
        found = self.potentials.get(joint)
        if found is None:
            joints = ", ".join(self.potentials) or "none: give a skeleton with joints"
            raise MocapError(f"there is no potential of a joint {joint!r}: there are {joints}")
        return found

    def save(self, folder: str | PathLike[str], *, overwrite: bool = False) -> "Tracked":
        """Write all of it into a folder: tables, datasets, report, potentials, and a recording for rerun.

        Args:
            folder: Where to; other files in it are left as they are.
            overwrite: Whether an earlier result in it may be replaced.

        Returns:
            The same, which knows its folder.

        Raises:
            OutputError: it cannot be written there.
        """
        with result_folder(Path(folder), "track", replace=overwrite) as stage:
            self.write(stage)
        return replace(self, source=replace(self.source, folder=Path(folder)))

    def write(self, folder: Path, *, progress: Tell = silent, pictures: bool = True) -> None:
        """Write the files of ``save`` into an empty folder, as ``mocap.io.output.result_folder`` gives it.

        Args:
            folder: Where to.
            progress: Called with the name of the stage and the share of it that is done.
            pictures: Whether ``figures/``, ``report.html`` and ``recording.rrd`` are written, too: all that is there
                to be looked at, and can be made again from the rest.
        """
        from mocap.plots.figures import write_plane_figures

        if self.plane is not None:
            with Stages(tell=progress).stage("write"):
                write_plane(self, folder)
                if pictures:
                    write_plane_figures(self, folder)
            return
        with Stages(tell=progress).stage("write") as tell:
            parts = _write_run, _write_kinematics
            call_all([partial(part, self, folder, pictures) for part in parts], tell)

    def write_recording(self, folder: Path) -> None:
        """Write ``recording.rrd`` alone into a folder, which is made if need be."""
        from mocap.rerun.record import write_recording

        folder.mkdir(parents=True, exist_ok=True)
        write_recording(self, folder / "recording.rrd")

    @property
    def recording_id(self) -> str:
        """Of its recording in rerun."""
        from mocap.rerun.record import recording_id

        return recording_id(self)

    def write_kinematics(
        self, folder: Path, *, exports: Sequence[str] = (), progress: Tell = silent, pictures: bool = True
    ) -> list[str]:
        """Write tables (``kinematics``, ``cycles``, ``angles``), ``figures/`` and ``report.html`` into a folder.

        Args:
            folder: Where to, as ``mocap.io.output.result_folder`` gives it.
            exports: Of ``mocap.results.exports.EXPORTS``, written as well.
            progress: Called with the name of the stage and the share of it that is done.
            pictures: Whether figures and the page with them are written, too.

        Returns:
            A sentence for each export that could not be written; all else is.
        """
        with Stages(tell=progress).stage("kinematics and figures"):
            write_kinematics(self.kinematics, folder)
            write_cycles(self.kinematics, self._cycles, folder)
            write_axes(self.motion, self.skeleton, folder)
            refused = []
            for kind in exports:
                name, write = EXPORTS[kind]
                try:
                    write(self, self.kinematics, self._cycles, folder / name)
                except MocapError as error:
                    refused.append(f"{kind}: {error}")
            if pictures:
                write_page(self, self.kinematics, self._cycles, self.footfalls, folder)
        return refused

    def write_scaled_osim(self, generic: str | PathLike[str], folder: Path) -> "dict[str, BodyScale]":
        """Scale a generic OpenSim model to the animal: ``scaled.osim``, ``scale_factors.csv`` (needs OpenSim).

        Returns:
            By what each body was scaled (``mocap.results.scaled_osim``).

        Raises:
            MocapError: the file is no model, or no body of it has two markers of the recording.
        """
        from mocap.results.scaled_osim import write_scaled_osim

        return write_scaled_osim(self, Path(generic), folder)

    def write_moments(self, folder: Path) -> None:
        """Write ``moments.csv`` and ``moments.nc``.

        Raises:
            MocapError: there is no joint of which they can be known; the message says why.
        """
        if not len(self.moments):
            raise MocapError(f"{self.name}: no joint moment can be known: " + "; ".join(self.moments.notes))
        write_kinematics(self.moments, folder, stem="moments")

    def export_kinematics(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the kinematics for another program, by the end of the name: .xlsx, .mat, .mot, .sto, .bvh.

        Args:
            path: The file.
            overwrite: Whether an earlier file of ours may be replaced.

        Raises:
            MocapError: the name ends otherwise, or the file cannot be written so.
        """
        kind = Path(path).suffix.removeprefix(".")
        if kind not in TABLES:
            raise MocapError(f"{path}: kinematics are exported as .{', .'.join(TABLES)}")
        with result_file(Path(path), replace=overwrite) as stage:
            TABLES[kind](self, self.kinematics, self._cycles, stage)

    @cached_property
    def footfalls(self) -> Footfalls | None:
        """When the stated feet stand; None where none are stated or none stands."""
        return footfalls(self.motion, self.skeleton)

    @cached_property
    def _cycles(self) -> list[Cycle]:
        return cycles(self.kinematics, self.motion, self.skeleton)

    @property
    def cycles(self) -> CycleTable:
        """Wing beats, strides and waves: a row a cycle, as ``cycles.csv`` has them.

        ``res.cycles.peaks("elbow_flexion_deg")`` is the peak, the trough, the range and the mean of a quantity in each.
        """
        return cycle_table(self._cycles, self.kinematics)

    @property
    def why_no_cycles(self) -> list[str]:
        """Why no cycle was found or can be believed: a sentence for each cause, with what mends it; else empty."""
        return why_none(self.skeleton, self.kinematics, self._cycles)

    @property
    def frequencies(self) -> list[Frequency]:
        """The mean frequency of each kind of cycle, with its interval, of the phase of all limbs together."""
        return frequencies(self._cycles)

    @property
    def plot(self) -> "Plots":
        """Figures: ``res.plot.over_time("elbow_l_flexion_deg")``, ``by_phase``, ``gait``, ``stroke``, ``gaps``, ..."""
        from mocap.plots.notebook import Plots

        return Plots(self, self.kinematics, self._cycles, self.footfalls)

    def with_skeleton(self, skeleton: Skeleton) -> "Tracked":
        """The same markers, with what another skeleton states of names, joints, axes, outlines and masses.

        Its aliases rename the markers, as where a file is read. Covariances between markers are those that were kept
        when the recording was tracked: of quantities that need others ``kinematics.notes`` says so.

        Raises:
            SkeletonError: it uses a marker that the recording lacks, or gives two of them one name.
        """
        checked, called = animal(skeleton, self.names)
        renamed = dict(zip(self.names, called, strict=True))
        points = [renamed.get(name, name) for name in self.motion.names]
        names = {dim: np.array(of, dtype=object) for dim, of in (("keypoint", called), ("point", points))}
        found = replace(self, skeleton=checked, data=self.data.assign_coords(names))
        return found.with_motion(with_means(found.motion, rate_points(found)))

    def with_report(self, text: str) -> "Tracked":
        """The same, with more at the end of its report."""
        return self.with_part(replace(self[Report], text=self.report_text + text))

    def with_video(
        self,
        movies: Sequence[str | PathLike[str] | Movie],
        *,
        offset_frames: Sequence[int] | None = None,
        undistorted: bool = False,
    ) -> "Tracked":
        """The same, with movies to be shown under its tracks.

        Args:
            movies: A movie or a folder of images a camera, in the order of the cameras; or one folder that holds
                them, sorted by name; or movies that are open.
            offset_frames: Frame of the movie minus frame of the tracks: one for all, or one a camera; None: as the
                project, or the offsets file beside the tracks, says.
            undistorted: Whether the movies are free of the lens' distortion already.

        Raises:
            MocapError: not one movie a camera, or of another size.
        """
        from mocap.rerun.log_video import offsets_of, with_footage

        offsets = offsets_of(self.file, offset_frames)
        opened = [movie for movie in movies if isinstance(movie, Movie)]
        opened += open_movies([Path(movie) for movie in movies if not isinstance(movie, Movie)])
        return Tracked.of(with_footage(self, opened, offsets=offsets, straight=undistorted))

    def view(self, *, web: bool = False) -> "Viewer":
        """Open it in rerun, on this computer only; the viewer ends with this Python, or by its ``close()``.

        Args:
            web: In the browser, at the ``url`` of what is returned, instead of a window.
        """
        self.in_space("the viewer")
        from tempfile import TemporaryDirectory
        from weakref import finalize

        from mocap.rerun.viewer import open_viewer

        if self.folder is not None and (self.folder / "recording.rrd").is_file():
            return open_viewer(self.folder / "recording.rrd", web=web)
        folder = TemporaryDirectory(prefix="mocap-")
        self.write_recording(Path(folder.name))
        viewer = open_viewer(Path(folder.name) / "recording.rrd", web=web)
        finalize(viewer, folder.cleanup)
        return viewer

    def __repr__(self) -> str:
        """One line."""
        n_joints = len(self.skeleton.joints) + len(self.skeleton.body_joints)
        counts = (len(self.t_s), "frame"), (len(self.names), "marker"), (n_joints, "joint")
        return f"<Tracked {self.name!r}: {', '.join(number_of(*one) for one in counts)}>"

    def _repr_html_(self) -> str:
        return tracked_html(self)


def track(
    recording: Recording,
    *,
    model: Model | str | PathLike[str] = "auto",
    validate: bool = True,
    seed: int = 0,
    progress: Tell | None = None,
) -> Tracked:
    """Clean a recording, fill its gaps and smooth it by an unscented Kalman filter, with intervals; learn potentials.

    Args:
        recording: As ``mocap.read`` or ``mocap.from_arrays`` gives it.
        model: What ``mocap.learn`` gave, or its file; or ``mixture``, ``eal``, ``articulated`` (the skeleton's
            segments and joints), ``lagrangian`` (the same, moved by the forces of its masses), or each marker by
            itself by ``smooth_acceleration`` or ``constant_velocity``; ``auto``: the mixture, unless constant velocity
            fills hidden samples of the recording better; of one to three markers ``smooth_acceleration``.
        validate: Whether to hide samples and measure how they are filled.
        seed: Which samples are hidden.
        progress: Called with the name of a stage and the share of it that is done; None: bars, where errors go to a
            terminal.

    Raises:
        MocapError: what makes it impossible, with what to do.
    """
    recording = as_recording(recording, "track")
    TrackOptions(validate=validate, seed=seed)
    if recording.tracked:
        raise MocapError(f"{recording.name}: was tracked already: give what mocap.read or mocap.clean returned")
    name = "auto"
    if isinstance(model, str) and model in MODELS:
        name, model = model, None  # type: ignore[assignment]
    elif not isinstance(model, Model):
        model = load_model(existing_model(model))
    learned = model.learned if isinstance(model, Model) else None
    with bars() if progress is None else nullcontext(progress) as tell:
        stages = Stages(tell=tell)
        run, _ = run_job(recording, model=name, learned=learned, stages=stages, validated=validate, seed=seed)
    return Tracked.of(run)


def load(folder: str | PathLike[str], *, frames: range | None = None) -> Tracked:
    """What ``mocap track`` or ``Tracked.save`` wrote into a folder.

    Args:
        folder: The folder.
        frames: Frames, from 0, of a recording that was tracked in blocks (docs/howto/long_recordings.md): all of these,
            without pixels and velocities; None: the whole, of such a recording its overview.

    Raises:
        FormatError: the folder holds no result, or one of another version.
        MocapError: a range is asked for of what was not tracked in blocks, or it has no such frames.
    """
    folder = Path(folder)
    if frames is None:
        return Tracked.of(read_recording(folder))
    if not is_long(folder):
        raise MocapError(f"{folder}: was tracked at once: load it without `frames`")
    return Tracked.of(load_range(folder, frames))
