"""The skeleton of a trial as it is drawn: points named, bones and joints chosen, in the file that tracking reads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.batches.trial import Trial
from mocap.cameras.camera import stacked
from mocap.cameras.triangulate import linear
from mocap.desk.pictures import Pictures, listed, pictures_of
from mocap.documents import from_toml
from mocap.errors import MocapError
from mocap.io.output import result_file
from mocap.proposing.propose_measures import with_measures
from mocap.proposing.propose_skeleton import propose_skeleton
from mocap.reading.ideal_pixels import of_one_camera
from mocap.recording import Recording
from mocap.skeleton import Bone, Joint, Skeleton, mirrored, read_skeleton, skeleton_text, write_skeleton
from mocap.text import number_of

_NO_MARKER = ("up", "ground", "sequence", "functional")
"""Entries of ``[measures]`` whose texts are no markers."""
_LINES = ("forward", "left")
"""Those that are one direction."""


@dataclass(eq=False, kw_only=True)
class Draft:
    """A skeleton that is being drawn; its points are those of the files, by their number.

    Attributes:
        trial: Name of the trial that shows them.
        recording: Its files, without a skeleton.
        skeleton: As it is now.
        path: Where it is written.
        pictures: Videos that show the points; None: none.
    """

    trial: str
    recording: Recording
    skeleton: Skeleton
    path: Path
    pictures: Pictures | None = None

    @property
    def called(self) -> list[str]:
        """What the points of the files are called; empty: left out."""
        markers = self.skeleton.renamed(self.recording.names)
        return [name if name in self.skeleton.markers else "" for name in markers]

    @cached_property
    def xyz(self) -> Array:
        """(T, M, 3) where they are: in metres, or in pixels of the first camera where no two see them."""
        recording = self.recording
        if recording.pixels is None:
            return recording.xyz_m
        if recording.cameras and not of_one_camera(recording):
            return linear(stacked(recording.cameras), recording.ideal_px)
        u, v = np.moveaxis(recording.pixels.uv_px[0], -1, 0)
        return np.stack([u, np.zeros_like(u), -v], axis=-1)

    def info(self) -> dict[str, Any]:
        """All of it, points by number."""
        called = self.called
        number = {name: i for i, name in enumerate(called) if name}

        def of(*names: str) -> list[int] | None:
            return [number[name] for name in names] if set(names) <= set(number) else None

        ends = ((joint.name, of(joint.parent, joint.centre, joint.child)) for joint in self.skeleton.joints)
        seen = np.isfinite(self.xyz[..., 0])
        table = from_toml(skeleton_text(self.skeleton), self.skeleton.name).get("measures", {})
        measures = ((kind, entry) for kind, entry in table.items() if kind != "axes" and not isinstance(entry, str))
        return {
            "trial": self.trial,
            "points": list(self.recording.names),
            "names": called,
            "bones": [[*pair, bone.rigid] for bone in self.skeleton.bones if (pair := of(bone.a, bone.b))],
            "trunk": [number[name] for name in self.skeleton.trunk if name in number],
            "joints": {name: three for name, three in ends if three},
            "bodies": {name: list(members) for name, members in self.skeleton.bodies.items()},
            "measures": [row for kind, entry in measures for row in _rows_of(kind, entry)],
            "dropped": [],
            "cameras": [] if self.pictures is None else list(self.recording.camera_names),
            "frame": int(seen.sum(axis=1).argmax()),
            "n_frames": len(seen),
            "path": str(self.path),
        }

    def places(self, frame: int, camera: int | None = None) -> list[list[float] | None]:
        """Where the points are in a frame: in a camera's image, or in space.

        In space as a share of how far they lie apart, about their middle.
        """
        if camera is not None and self.pictures is not None:
            uv_px = self.pictures.upright(self.recording.data["pixels"].values[camera, frame])
            return [listed(at) for at in uv_px]
        now = self.xyz[frame]
        middle = np.nanmedian(now, axis=0) if np.isfinite(now).any() else np.zeros(3)
        size = np.nanmax(np.abs(now - middle), initial=1e-12)
        return [listed((at - middle) / size) for at in now]

    def propose(self, **drawn: Any) -> str:
        """Propose bones, trunk and joints in place of those that were drawn; names stay."""
        names = self.changed(**drawn).renamed(self.recording.names)
        self.skeleton = propose_skeleton(self.recording, names=names).skeleton
        return f"proposed: {self._counts}: check and correct them"

    def measure(self, **drawn: Any) -> str:
        """Add the strokes, feet, spans and axes of the trunk that the drawn limbs show; what is stated stays.

        Raises:
            MocapError: no trunk or no limbs are drawn, or points are in an image.
        """
        skeleton = self.changed(**drawn)
        if self.recording.plane is not None or of_one_camera(self.recording):
            raise MocapError("measures are proposed of positions in space: state them in the skeleton's file")
        if not skeleton.trunk or not skeleton.bones:
            raise MocapError("measures are of limbs that leave the trunk: draw its points (t) and bones (b) first")
        points = [i for i, name in enumerate(drawn["names"]) if name]
        self.skeleton = with_measures(skeleton, self.recording.t_s, self.xyz[:, points])
        known, new = skeleton.measures, self.skeleton.measures
        added = [name for name in vars(new) if getattr(new, name) != getattr(known, name)]
        lacks = [name for name in _LINES if new.strokes and not getattr(new, name)]
        said = f"added {', '.join(added)}: check them" if added else "no limb moves in cycles: nothing was added"
        return said + (f"; strokes need {' and '.join(lacks)} of the trunk, in the skeleton's file" if lacks else "")

    def mirror(self, **drawn: Any) -> str:
        """Give both sides what one of them has."""
        self.skeleton = mirrored(self.changed(**drawn))
        return f"on both sides: {self._counts}"

    @property
    def _counts(self) -> str:
        return ", ".join(number_of(len(getattr(self.skeleton, f"{part}s")), part) for part in ("bone", "joint"))

    def save(self, skeleton: Skeleton) -> None:
        """Write what was drawn, as ``changed`` makes it."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with result_file(self.path, replace=True) as file:
            write_skeleton(file, skeleton)
        self.skeleton = skeleton

    def changed(
        self,
        names: Sequence[str],
        bones: Sequence[tuple[int, int, bool]],
        trunk: Sequence[int],
        joints: Mapping[str, tuple[int, int, int]],
        dropped: Sequence[tuple[str, str]] = (),
    ) -> Skeleton:
        """The skeleton with what was drawn in place of its own; measures and bodies follow the names.

        Args:
            names: What each point of the files is called; empty: it is left out.
            bones: Two points each, and whether their distance is one length.
            trunk: Points that move as one body.
            joints: Parent, centre and child by name.
            dropped: Measures that are left out: their kind, and their name or (feet) marker, as of before.

        Raises:
            MocapError: it is no skeleton.
        """
        files, old = self.recording.names, self.called
        if len(names) != len(files):
            raise MocapError(f"{len(names)} names came for {len(files)} points: open the skeleton again")
        names = [name.strip() for name in names]
        new = {before: now for before, now in zip(old, names, strict=True) if before}
        table = from_toml(skeleton_text(self.skeleton), self.skeleton.name)
        # measures but for some
        out = {}
        for kind, entry in table.get("measures", {}).items():
            gone = {name for of, name in dropped if of == kind}
            if kind in _LINES and kind in gone:
                continue
            if isinstance(entry, Mapping):
                out[kind] = {name: value for name, value in entry.items() if name not in gone}
            else:
                out[kind] = [one for one in entry if str(one) not in gone] if isinstance(entry, list) else entry
        measures = _renamed(out, new)
        called = _joint_names(joints, old, names)
        there = called | {joint.name: joint.name for joint in self.skeleton.body_joints}
        axes = measures.get("axes", {}).items()
        measures["axes"] = {there[name]: axes for name, axes in axes if name in there}
        return replace(
            self.skeleton,
            markers=tuple(name for name in names if name),
            bones=tuple(Bone(a=names[a], b=names[b], rigid=rigid) for a, b, rigid in bones),
            trunk=tuple(names[m] for m in trunk),
            joints=tuple(
                Joint(name=called[k], parent=names[a], centre=names[b], child=names[c])
                for k, (a, b, c) in joints.items()
            ),
            bodies=_renamed(table.get("bodies", {}), new),
            aliases={of: name for of, name in zip(files, names, strict=True) if name and name != of},
            measures=measures,
        )


def _joint_names(joints: Mapping[str, tuple[int, int, int]], old: Sequence[str], new: Sequence[str]) -> dict[str, str]:
    """What joints are called whose points are called otherwise: those that are named after their points follow them."""
    out: dict[str, str] = {}
    for name, (a, b, c) in joints.items():
        after = {old[b]: new[b]} | {f"{old[b]}_{old[end]}": f"{new[b]}_{new[end]}" for end in (a, c)}
        found = after.get(name, name)
        out[name] = name if found in {*joints, *out.values()} else found
    return out


def _rows_of(kind: str, entry: Any) -> list[list[str]]:
    """Kind, name and markers of what can be left out."""
    if kind in _LINES:
        return [[kind, kind, ", ".join(entry)]]
    texts = {name: entry[name] if isinstance(entry, Mapping) else "" for name in entry}
    return [
        [kind, str(name), ", ".join(map(str, value)) if isinstance(value, list) else ""]
        for name, value in texts.items()
    ]


def _renamed(entry: Any, names: Mapping[str, str], key: str = "") -> Any:
    """A part of a skeleton file with its markers called otherwise."""
    if isinstance(entry, Mapping):  # its keys are markers where they have places
        place = {name: isinstance(at, list) and not isinstance(at[0], str | list) for name, at in entry.items() if at}
        return {names.get(k, k) if place.get(k) else k: _renamed(value, names, k) for k, value in entry.items()}
    if isinstance(entry, list):
        return [_renamed(one, names, key) for one in entry]
    return names.get(entry, entry) if isinstance(entry, str) and key not in _NO_MARKER else entry


def open_draft(trial: Trial, path: Path) -> Draft:
    """The skeleton of a trial, to be drawn: that which is stated of it, else its markers alone.

    Raises:
        MocapError: its files, or its skeleton, cannot be read.
    """
    arguments = {key: value for key, value in trial.arguments.items() if key not in ("skeleton", "edits")}
    recording = replace(trial, arguments=arguments).recording()
    skeleton_file = trial.arguments.get("skeleton")
    skeleton = (
        replace(recording.skeleton, name=trial.name) if skeleton_file is None else read_skeleton(Path(skeleton_file))
    )
    pictures = pictures_of(recording)
    filmed = None if pictures.videos is None else pictures
    return Draft(trial=trial.name, recording=recording, skeleton=skeleton, path=path, pictures=filmed)
