"""Proof-reading of one tracked trial: where a correction would settle most, and what each one settles at once."""

import getpass
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import stacked
from mocap.cameras.triangulate import linear, project
from mocap.cleaning.by_hand import errors_left, with_hand
from mocap.cleaning.cleaning import clean
from mocap.desk.fills import fills
from mocap.desk.label_qc import LABEL_QC, read_label_qc
from mocap.desk.pictures import Pictures, drawn, ellipses, epipolar_lines, listed, pictures_of, snapped
from mocap.desk.places import Place, places, unsettled
from mocap.errors import MocapError
from mocap.kinematics.records import DOUBTFUL, Rests
from mocap.reading.decided import decided
from mocap.reading.edits import Edit, Log, Samples, append_edit, edited, read_log, samples_of, standing
from mocap.reading.ideal_pixels import of_one_camera, straightened
from mocap.recording import Recording
from mocap.records import MarkerTracks, Status
from mocap.results.tracked import Tracked
from mocap.sides import side_of, without_side, words
from mocap.skeleton import Bone
from mocap.tracking.joint_map import map_picture
from mocap.tracking.potentials import JointPotential
from mocap.tracking.retrack import AROUND, tracked_again


@dataclass(eq=False, kw_only=True)
class Proof(Pictures):
    """A trial that is proof-read.

    Attributes:
        name: Of the trial.
        result: What was tracked.
        log: The file of the edits.
        edits: All lines of the log.
        ahead: The recording being cleaned while a person looks; None: that is done at the first correction.
        pending: Edits that nothing was solved with yet, and whether they were taken back.
        settled: What each edit changed in the tracks, of those that were solved since this was opened, in their order.
        recording: ``raw`` with the edits.
        tracks: The result, with what the corrections since have settled.
    """

    name: str
    result: Tracked
    log: Path
    ahead: Future | None = None
    edits: list[Edit] = field(default_factory=list)
    pending: list[tuple[Edit, bool]] = field(default_factory=list)
    settled: list[tuple[Edit, "_Change"]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Replay the log."""
        self.recording = edited(self.raw, self.edits, where=self.log.name)
        self.tracks = self.result.tracks
        self.pending += [(edit, False) for edit in standing(self.edits) if not self._tracked_with(edit)]

    def _tracked_with(self, edit: Edit) -> bool:
        """Whether the result was made with an edit; it says of each sample whether a person corrected it."""
        frames = slice((edit.frame or 1) - 1, edit.last or edit.frame)
        return bool((self.result.repaired[frames, self.raw.names.index(edit.marker or "")] == 2).all())

    def info(self) -> dict[str, Any]:
        """What does not change while it is open."""
        return {
            "trial": self.name,
            "names": list(self.raw.names),
            "cameras": list(self.raw.camera_names),
            "sizes": self.sizes_px,
            "films": self.videos is not None,
            "bones": [ends for bone in self.raw.skeleton.bones if (ends := self._ends(bone)) is not None],
            "n_frames": len(self.raw.t_s),
            "fps": self.raw.fps,
            "quantities": [] if self.result.plane is not None else self._quantities(),
            "potentials": []
            if self.result.plane is not None
            else [[one, words(one)] for one in self.result.potentials],
        }

    def _ends(self, bone: Bone) -> tuple[int, int] | None:
        """The numbers of a bone's markers; None: one was not recorded."""
        names = self.raw.names
        return (names.index(bone.a), names.index(bone.b)) if {bone.a, bone.b} <= set(names) else None

    def _quantities(self) -> list[dict[str, str]]:
        """What can be plotted: its column, what people call it, that without its side, its unit and what it is of."""
        out = []
        for name in self.result.kinematics:
            found = self.result.kinematics[name]
            short = name.removesuffix(f"_{found.unit}")
            unit = found.unit.replace("deg", "°").replace("_s2", "/s²").replace("_s", "/s").replace("2", "²")
            either = without_side(short).replace("_", " ")
            one = {"name": name, "title": words(short), "either": either, "side": side_of(short)}
            out.append({**one, "unit": unit, "kind": found.kind})
        return out

    def frame(self, frame: int, marker: int) -> dict[str, Any]:
        """What is drawn over the images of a frame, and what is known of the marker there."""
        recording, markers = self.recording, self.tracks
        status = Status(int(markers.status[frame, marker])).name.lower()
        changed = recording.edited[frame]
        shown = {
            "status": "edited" if changed[marker] and status == "measured" else status,
            "sd_mm": listed(1e3 * np.sqrt(np.trace(markers.cov_m2[frame, [marker]], axis1=1, axis2=2) / 3)),
        }
        if "pixels" not in recording.data:
            return shown | {"cameras": []}
        pixels = recording.data["pixels"].values
        clicked = self.upright(pixels[:, frame])
        shapes, lines = np.full((*clicked.shape[:2], 5), np.nan), [[] for _ in clicked]
        if recording.cameras:
            matrices = stacked(recording.cameras)
            up = recording.y_up
            shapes = ellipses(matrices, markers.xyz_m[frame], markers.cov_m2[frame], self.shown, y_up=up)
            first = max(0, frame - AROUND)  # cameras that run late are read between their frames
            near = recording.at(slice(first, frame + AROUND))
            ideal = straightened(near, pixels[:, first : frame + AROUND, [marker]])[:, frame - first, 0]
            lines = epipolar_lines(matrices, ideal, self.sizes_px, self.shown)
        marks = {
            "click": clicked,
            "ellipse": shapes,
            "edited": np.broadcast_to(changed.astype(float), clicked.shape[:2]),
        }
        return shown | {"cameras": drawn(marks, lines)}

    def scene(self) -> bytes:
        """The result as a recording of rerun."""
        with TemporaryDirectory() as place:
            self.result.write_recording(Path(place))
            return (Path(place) / "recording.rrd").read_bytes()

    @cached_property
    def _measured(self) -> Array:
        """(T, M, 3) what the files say, believed or not."""
        if decided(self.raw).rows is None:
            return np.full_like(self.tracks.xyz_m, np.nan) if self.raw.points is None else self.raw.xyz_m
        return linear(stacked(self.raw.cameras), self.raw.ideal_px)

    @cached_property
    def _samples(self) -> Samples:
        return samples_of(self.raw)

    @cached_property
    def _cleaned(self) -> tuple[Recording, float]:
        return _cleaned(self.raw) if self.ahead is None else self.ahead.result()

    def places(self) -> list[Place]:
        """What is to be looked at next, by how much a correction would settle.

        What SLEAP flagged, in a table beside the log, stands among them by the same measure; what both name is one.
        """
        done, flagged = self.recording.edited, self.log.with_name(LABEL_QC)
        ours = places(self.tracks, self._measured, done)
        if not flagged.is_file():
            return ours
        worth = unsettled(self.tracks, self._measured)
        theirs = read_label_qc(flagged, worth, cameras=len(self.raw.camera_names))
        theirs = [one for one in theirs if not done[one.frame, one.marker]]
        both = {(one.frame, one.marker): one for one in theirs}
        ours = [
            replace(one, why=f"{one.why}; {two.why}") if (two := both.pop((one.frame, one.marker), None)) else one
            for one in ours
        ]
        return sorted([*ours, *both.values()], key=lambda one: -one.worth_m2)

    def place(
        self, camera: int, frame: int, marker: int, uv_px: tuple[float, float] | None, *, snap: bool = False
    ) -> str:
        """A marker is at a place of an image, or not to be seen there (None); with ``snap`` at the dot beside it."""
        image = self.picture(camera, frame) if snap and uv_px is not None else None
        if uv_px is not None and image is not None:
            uv_px = snapped(image, uv_px)
        what = {"what": "unseen"} if uv_px is None else {"what": "place", "uv_px": uv_px}
        at = {"camera": self.raw.camera_names[camera], "marker": self.raw.names[marker]}
        return self.edit(**what, **at, frame=frame + 1)

    def exchange(self, marker: int, other: int, first: int, last: int) -> str:
        """Exchange the names of two markers in a range of frames."""
        names = self.raw.names
        return self.edit(what="exchange", marker=names[marker], other=names[other], frame=first + 1, last=last + 1)

    def delete(self, marker: int, first: int, last: int) -> str:
        """A marker is not to be seen in a range of frames."""
        return self.edit(what="delete", marker=self.raw.names[marker], frame=first + 1, last=last + 1)

    def undo(self) -> str:
        """Take the last correction back."""
        return self.edit(what="undo")

    def edit(self, **what: Any) -> str:
        """Add a correction to the log; it is on the disk when this returns. ``settle`` solves what it touches.

        Args:
            **what: Fields of ``mocap.reading.edits.Edit``, ``uv_px`` as the image counts.

        Raises:
            MocapError: it names what is not there; nothing was kept then.
            OSError: it cannot be saved; nothing was kept then, either.
        """
        if what.get("uv_px") is not None:
            what["uv_px"] = tuple(self.upright(np.array(what["uv_px"], dtype=float)).tolist())
        edit = Edit(who=_user(), when=datetime.now(UTC).isoformat(timespec="seconds"), **what)
        kept = standing(self.edits)
        if edit.what == "undo" and not kept:
            return "there is no correction to take back"
        recording = edited(self.raw, [*self.edits, edit], where="the correction")
        append_edit(self.log, edit, self._samples)
        self.edits.append(edit)
        self.recording = recording
        self.pending.append((kept[-1], True) if edit.what == "undo" else (edit, False))
        n = len(standing(self.edits))
        return f"{n} correction{'s' * (n != 1)} kept"

    def settle(self) -> str:
        """Solve again what the corrections touch that were made since this was called last."""
        message = "nothing to solve"
        while self.pending:
            edit, back = self.pending.pop(0)
            if back and self.settled and self.settled[-1][0] is edit:
                self.tracks = self.settled.pop()[1].taken_back(self.tracks)
                message = f"{edit.marker} is as it was before"
                continue
            before = self.tracks
            try:
                message = self._settle(edit, back)
            finally:  # also where it cannot be solved, which changes nothing
                if not back:
                    self.settled.append((edit, _Change.of(before, self.tracks)))
        return message

    def _settle(self, edit: Edit, back: bool) -> str:
        """Solve again what an edit touches: around it, or around both ends of a range, whose middle is as it says.

        An edit that is taken back here is one that the result was tracked with.
        """
        first, last = (edit.frame or 1) - 1, (edit.last or edit.frame or 1) - 1
        which = np.array([self.raw.names.index(name) for name in (edit.marker, edit.other) if name is not None])
        spans = [(first, last)] if last - first <= 2 * AROUND else [(first, first), (last, last)]
        tracks, whole = self.tracks, self.result.tracks
        xyz, cov, status = (np.array(a) for a in (tracks.xyz_m, tracks.cov_m2, tracks.status))
        run = slice(first, last + 1)
        if edit.what == "exchange" and (not back or self._tracked_with(edit)):
            for array in (xyz, cov, status):
                array[run, which] = array[run, which[::-1]]
        elif back:
            run = slice(max(0, first - AROUND), last + 1 + AROUND)
            for array, old in zip((xyz, cov, status), (whole.xyz_m, whole.cov_m2, whole.status), strict=True):
                array[run, which] = old[run][:, which]
        elif len(spans) > 1:
            xyz[run, which], cov[run, which], status[run, which] = np.nan, np.nan, Status.MISSING
        changed = self.recording.edited
        # names that the program put right stand otherwise in the files: there the result stays as it is
        named = (self.result.repaired == 1) & ~changed
        recording, cleaned, moved = self.recording, None, np.zeros(changed.shape, dtype=bool)
        alone = bool(recording.cameras) and of_one_camera(self.raw)
        if decided(self.raw).rows is not None and not alone:
            bare, left = self._cleaned
            cleaned = with_hand(bare, recording, left=left)
            moved = (cleaned.xyz_m != bare.xyz_m).any(axis=-1)
        note = "; the model solves it when the trial is tracked again" if alone else ""
        for span in [] if alone else spans:
            try:
                window, found = tracked_again(
                    recording,
                    tracks,
                    sd_px=self._sd_px,
                    markers=which.tolist(),
                    first=span[0],
                    last=span[1],
                    cleaned=cleaned,
                )
            except MocapError as error:  # one ray alone: it is kept, and settles something with the next
                note = f"; {error}"
                continue
            frames = np.arange(len(status))[window]
            near = (frames[:, None] >= span[0]) & (frames[:, None] <= span[1])
            # measured samples beside it that it says nothing of stay as all markers together have them
            new = near | (changed | moved)[window][:, which] | (status[window][:, which] != Status.MEASURED)
            # where nothing is found, what was extrapolated stays; what was measured is not any more
            gone = near & (status[window][:, which] == Status.MEASURED)
            new &= (np.isfinite(found.xyz_m[..., 0]) | gone) & ~named[window][:, which]
            for array, value in zip((xyz, cov, status), (found.xyz_m, found.cov_m2, found.status), strict=True):
                old = array[np.ix_(frames, which)]
                array[np.ix_(frames, which)] = np.where(new.reshape(*new.shape, *(1,) * (old.ndim - 2)), value, old)
        self.tracks = replace(tracks, xyz_m=xyz, cov_m2=cov, status=status)
        sd = self.tracks.sd_m[first, which[0]]
        accuracy = "is not known" if np.isnan(sd) else f"is known to {1e3 * sd:.2g} mm"
        return (
            f"{edit.marker} in frame {first + 1} {accuracy}{note}{'' if back else self._missed(edit, first, which[0])}"
        )

    def _missed(self, edit: Edit, frame: int, marker: int) -> str:
        """That a place is not where the track is: the other cameras or the motion contradict it."""
        if edit.what != "place" or not self.raw.cameras or edit.camera is None or edit.uv_px is None:
            return ""
        at = project(stacked(self.raw.cameras), self.tracks.xyz_m[frame, marker])
        c = self.raw.camera_names.index(edit.camera)
        off = float(np.linalg.norm(self.shown(c, at[c][None])[0] - self.upright(np.array(edit.uv_px))))
        believed = not off > 5 * self._sd_px  # as rays are (``mocap.cameras.triangulate.robust``)
        return (
            ""
            if believed
            else f"; reprojection error in {edit.camera}: {off:.0f} px: digitise it in another camera, too"
        )

    @property
    def _sd_px(self) -> float:
        noise = self.result.report.get("pixel_noise_px")
        jitter = noise.get("jitter") if isinstance(noise, Mapping) else None
        return float(jitter or 1.0)

    def curve(self, name: str, points: int = 2000) -> dict[str, Any]:
        """A quantity over time with its 95 % interval, of a long recording at so many frames, and the cycles.

        Cycles are from when to when (s), by what they are of; of doubtful ones, by their number from 0, why they are.

        Raises:
            MocapError: there is none of that name.
        """
        found = self.result.kinematics[name]
        frames = np.unique(np.linspace(0, len(found.value) - 1, min(points, len(found.value))).astype(int))

        def numbers(values: Array) -> list[float | None]:
            return [None if np.isnan(x) else round(float(x), 5) for x in values[frames]]

        cycles: dict[str, list[list[float]]] = {}
        doubtful: dict[str, dict[int, str]] = {}
        columns = ("kind", "of", "start_s", "end_s", "status", "reason")
        for kind, of, start_s, end_s, status, why in zip(*(self.result.cycles[c] for c in columns), strict=True):
            title = f"{words(of)}, {kind}".replace("_", " ")
            those = cycles.setdefault(title, [])
            if status == DOUBTFUL:
                doubtful.setdefault(title, {})[len(those)] = str(why)
            those.append([float(start_s), float(end_s)])
        return {
            "frames": frames.tolist(),
            "seconds": numbers(self.raw.t_s),
            "filled": (found.rests == Rests.FILLED)[frames].tolist(),
            "value": numbers(found.value),
            "low": numbers(found.low),
            "high": numbers(found.high),
            "cycles": cycles,
            "doubtful": doubtful,
        }

    def around(self, frame: int, marker: int) -> dict[str, Any]:
        """A marker about a frame, in millimetres by coordinate: as it was tracked, and with the corrections since.

        And the frames about it that were not measured as a person would fill them by hand (``mocap.desk.fills``).
        """
        n = len(self.raw.t_s)
        rows = np.arange(max(0, frame - AROUND), min(n, frame + AROUND + 1))
        now, measured = self.tracks.xyz_m[rows], self.tracks.status[rows] == Status.MEASURED
        at = frame - int(rows[0])
        found = fills(self.raw.t_s[rows], now, measured, at, marker, self.raw.names, self.raw.skeleton)

        def each(xyz_m: Array) -> list[list[float | None]]:
            return [[None if np.isnan(x) else round(1e3 * float(x), 3) for x in one] for one in xyz_m.T]

        before = self.result.tracks.xyz_m[rows, marker]
        lines = {"after": now[:, marker], "spline": found.spline_m, "neighbours": found.neighbours_m}
        told = {"frames": rows.tolist(), "before": each(before), "said": found.said}
        return told | {name: each(line) for name, line in lines.items()}

    def potential(self, joint: str) -> bytes:
        """The map of a joint's potential, as a square PNG.

        Raises:
            MocapError: there is none, or too few samples were measured.
        """
        found = self.result.potential(joint)
        if isinstance(found, JointPotential):
            return map_picture(found.map, pixels=1000)
        from matplotlib import pyplot

        figure, ax = pyplot.subplots(figsize=(7, 7), layout="constrained")
        try:
            found.plot(ax)
            picture = BytesIO()
            figure.savefig(picture, format="png", dpi=120)
        finally:
            pyplot.close(figure)
        return picture.getvalue()

    def way(self, joint: str) -> dict[str, Any]:
        """Where a joint is on its map in each frame, and where its centre is: shares of the width and of the height.

        Raises:
            MocapError: there is no potential of it; of a joint between bodies there are no places.
        """
        found = self.result.potential(joint)
        if not isinstance(found, JointPotential):
            return {"name": words(joint), "centre": None, "places": []}
        left, right, bottom, top = found.map.bounds_mm
        size = np.array([right - left, bottom - top])
        corner = np.array([left, top])
        at = (1e3 * self.result.joints_m(found.frame)[joint][:, :2] - corner) / size
        return {"name": words(joint), "centre": listed(-corner / size), "places": [listed(one) for one in at]}


@dataclass(frozen=True, eq=False)
class _Change:
    """What was in tracks before an edit was solved, where that changed them.

    Attributes:
        at: (T, M) True where a bit of a sample changed.
        before: The N samples of ``xyz_m``, ``cov_m2`` and ``status`` there.
    """

    at: NDArray[np.bool_]
    before: tuple[Array, Array, NDArray[np.int8]]

    @classmethod
    def of(cls, before: MarkerTracks, after: MarkerTracks) -> "_Change":
        """Of tracks before and after."""
        at = before.status != after.status
        for old, new in ((before.xyz_m, after.xyz_m), (before.cov_m2, after.cov_m2)):
            same = (old == new) | (np.isnan(old) & np.isnan(new))
            at |= ~same.reshape(*at.shape, -1).all(axis=-1)
        return cls(at, (before.xyz_m[at], before.cov_m2[at], before.status[at]))

    def taken_back(self, tracks: MarkerTracks) -> MarkerTracks:
        """The tracks with these samples as they were."""
        new = [np.array(a) for a in (tracks.xyz_m, tracks.cov_m2, tracks.status)]
        for array, old in zip(new, self.before, strict=True):
            array[self.at] = old
        return replace(tracks, xyz_m=new[0], cov_m2=new[1], status=new[2])


def _cleaned(raw: Recording) -> tuple[Recording, float]:
    """A recording without edits, cleaned as for tracking, and how long errors of its rays last."""
    found = clean(raw)
    return found, errors_left(found)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # of a computer that has no name for it
        return "unknown"


def open_proof(
    name: str, recording: Recording, result: Tracked, log: Path, *, anyway: bool = False, ahead: bool = True
) -> Proof:
    """Open a trial for proof-reading, with its videos where they lie beside its tracks.

    Args:
        name: Of the trial.
        recording: Its files, as read without corrections.
        result: What was tracked of them.
        log: The corrections.
        anyway: Whether corrections are taken also where they were made on another recording.
        ahead: Whether it is cleaned while a person looks.

    Raises:
        OtherRecording: they were, and are not to be.
    """
    found = read_log(log) if log.is_file() else Log(name=log.name, edits=[])
    found.checked(recording, anyway=anyway)
    pictures = pictures_of(recording)
    solves = decided(pictures.raw).rows is not None and not of_one_camera(pictures.raw)
    cleaning = ThreadPoolExecutor(1).submit(_cleaned, pictures.raw) if solves and ahead else None
    return Proof(name=name, **vars(pictures), result=result, log=log, edits=found.edits, ahead=cleaning)
