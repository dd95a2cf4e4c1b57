"""The trials in a folder, and the calibration, profile and skeleton of each: by folder and by name; their manifest."""

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any, Literal

from mocap.batches.trial import (
    Trial,
    check_name,
    is_manifest,
    read_manifest,
    size_bytes,
    some,
    why_failed,
)
from mocap.errors import MocapError, OutputError
from mocap.io.crop import has_crops
from mocap.io.format import Hints
from mocap.io.manifest import read_manifest as read_listing
from mocap.io.registry import identify, read
from mocap.side_by_side import Lost, Pool, opened
from mocap.skeleton import read_skeleton

Role = Literal["tracks", "view", "calibration", "profile", "skeleton", "none", "unknown"]
"""A view is pixels of one camera; ``none`` is known but no trial; ``unknown`` looks like data and is not known."""

CALIBRATIONS = (
    "dltdv-coefficients",
    "anipose-calibration",
    "easywand",
    "argus-sba-profile",
    "qualisys-calibration",
    "vicon-calibration",
    "optitrack-calibration",
)
"""Formats that hold all cameras of a rig; of several of one rig the first is taken."""
VIEWS = ("deeplabcut-csv", "deeplabcut-h5", "sleap-analysis", "sleap-csv")
PIXELS = ("dltdv-xypts", "argus-xypts", "typed-pixels", "xmalab-2d")
TRACKS = (
    *PIXELS,
    "dltdv-project",
    "dltdv-sparse",
    "argus-sparse",
    "movement",
    "c3d",
    "trc",
    "qualisys-tsv",
    "qualisys-mat",
    "mocaptoolbox",
    "vicon-csv",
    "optitrack-csv",
    "parquet",
    "csv-long",
    "csv-wide",
    "sleap-anipose-3d",
    "anipose-3d",
    "dltdv-xyzpts",
    "argus-xyzpts",
    "xmalab-3d",
    "csv",
)
"""Formats of trials; of several files of one trial the first is tracked, as the rawest; others go before all."""
SPARSE = ("dltdv-sparse", "argus-sparse")
DATA = (".csv", ".tsv", ".txt", ".c3d", ".trc", ".mat", ".h5", ".hdf5", ".nc", ".parquet", ".xlsx", ".toml", ".xcp")
DATA += (".cal", ".slp", ".nwb")
"""Ends of the names of files that are looked into."""
_WORDS = (
    "xypts|xyzpts|xyzres|xyzci|offsets|dltcoefs|dvproject|camera_?profiles?|profile|calibration|easywanddata|skeleton"
    "|pointnames|extrinsics?|analysis|proofread"
)
_ENDING = re.compile(rf"[-_. ]*({_WORDS})$", re.IGNORECASE)
_TRIAL = re.compile(r"(xypts|xyzpts)\.[ct]sv$|dvproject\.mat$|\.c3d$|\.trc$", re.IGNORECASE)
"""Names that only tracks have."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """What a file is.

    Attributes:
        role: To a batch.
        format: The name of its format; of ``unknown``, and of tracks that cannot be read, what is wrong with it.
        pixels: Whether it holds pixels that need a calibration beside them.
        cameras: Names of the cameras of a calibration; none where it cannot be read.
        one: Whether it holds pixels of one camera.
        lens: Whether its cameras have lenses.
    """

    role: Role
    format: str = ""
    pixels: bool = False
    cameras: tuple[str, ...] = ()
    one: bool = False
    lens: bool = False


NOTHING = Look(role="none")
LOOK_S, BYTES_A_S = 60.0, 200_000.0
"""A look at a file, or reading a trial, may take a minute, and a second for each 200 kB: of the text tables that were
measured the slowest is read at 2 MB/s, by one of two cores beside others' work at a tenth of that."""


def look(path: Path, hints: Hints, *, progress: object = None) -> Look:
    """Look at a file; whatever goes wrong is told of it, and stops no other."""
    del progress
    try:
        return _look(path, hints)
    except Exception as error:
        return Look(role="unknown", format=why_failed(error))


def looks(paths: Sequence[Path], hints: Hints, *, pool: Pool, limit_s: float | None) -> dict[Path, Look]:
    """Look at files in other processes: what one of them does to its reader is a finding about it.

    Args:
        paths: The files.
        hints: How they are to be read where they do not say so themselves.
        pool: The processes.
        limit_s: Seconds that a look may take at most; None: by the size of the file.
    """
    found = dict.fromkeys(paths, NOTHING)
    calls = {path: partial(look, path, hints) for path in paths if path.suffix.lower() in DATA}
    limit = partial(limit_of_look, limit_s=limit_s)
    for path, went in pool.each(calls, limit_s=limit):
        error = went.exception()
        if isinstance(error, Lost):
            found[path] = Look(role="unknown", format=f"{path.name}: {why_not_read(error, limit(path))}")
        else:
            found[path] = went.result()
    return found


def limit_of_look(*paths: Path, limit_s: float | None) -> float:
    """Seconds that a look at files may take."""
    return min(LOOK_S + size_bytes(paths) / BYTES_A_S, inf if limit_s is None else limit_s)


def why_not_read(lost: Lost, limit_s: float) -> str:
    """What is told of a file that was not read."""
    if lost.why == "time":
        return f"was not read within {limit_s:.0f} s, and was left out: if it only needs longer, give `limit_s`"
    return f"the process that reads it ended twice ({lost}): it is damaged, or what reads it has an error"


def _look(path: Path, hints: Hints) -> Look:
    try:
        name = identify(path, hints).name
    except MocapError as error:
        if path.suffix.lower() == ".toml":
            return Look(role="skeleton") if _is_skeleton(path) else NOTHING
        if _TRIAL.search(path.name):
            return Look(role="tracks", format=str(error))  # and its error is told when it is tracked
        quiet = path.suffix.lower() == ".txt" or has_crops(path)
        return NOTHING if quiet else Look(role="unknown", format=str(error))
    if name in CALIBRATIONS:
        return _calibration(path, name)
    if name in VIEWS:
        return Look(role="view", format=name, one=True)
    if name == "csv":
        return _by_content(path, name, hints)
    if name == "camera-profile":
        return Look(role="profile", format=name)
    if name in SPARSE and not re.search(r"xyz?pts\.tsv$", path.name, re.IGNORECASE):
        return Look(role="none", format=name)
    if name not in TRACKS:
        return _by_content(path, name, hints)
    pixels = name in (*PIXELS, "dltdv-project") or (name in SPARSE and "xypts" in path.name.lower())
    if not pixels:
        return Look(role="tracks", format=name)
    try:
        found = read(path, hints)
    except MocapError:  # which tracking tells
        return Look(role="tracks", format=name, pixels=name != "dltdv-project")
    alone, lens = len(found.camera_names) == 1, any(camera.lens is not None for camera in found.cameras)
    return Look(role="tracks", format=name, pixels=not found.cameras, one=alone, lens=lens)


def _calibration(path: Path, name: str) -> Look:
    try:
        found = read(path)
    except MocapError:  # which tracking tells
        return Look(role="calibration", format=name)
    lens = any(camera.lens is not None for camera in found.cameras)
    return Look(role="calibration", format=name, cameras=found.camera_names, lens=lens)


def _by_content(path: Path, name: str, hints: Hints) -> Look:
    """A file is to a batch what ``mocap track`` reads it as; a table whose columns are stated is a trial."""
    plain = name == "csv"
    try:
        found = read(path, hints)
    except MocapError as error:
        if hints.columns and plain:
            return Look(role="tracks", format=name)
        return Look(role="unknown" if plain else "none", format=str(error))
    if found.pixels is not None:
        one = len(found.camera_names) == 1
        return Look(role="view" if one else "tracks", format=name, pixels=not plain and not found.cameras, one=one)
    return Look(role="tracks" if found.points is not None else "none", format=name)


def _is_skeleton(path: Path) -> bool:
    try:
        read_skeleton(path)
    except MocapError:
        return False
    return True


def base(path: Path) -> str:
    """The name of a file without what says which part of a trial it is: ``bat_`` of ``bat_xypts.csv`` goes."""
    stem = path.stem
    while (shorter := _ENDING.sub("", stem)) != stem:
        stem = shorter
    return stem.rstrip("-_. ")


def camera_names(calibration: Path, *, progress: object = None) -> tuple[str, ...]:
    """Names of the cameras of a calibration; none where it cannot be read."""
    del progress
    try:
        return read(calibration).camera_names
    except MocapError:
        return ()


PLAN = "manifest.csv"
PRELOAD = "mocap.batches.find"
"""What a process that looks at files needs."""
WRITTEN = ("track", "batch")
"""Results of mocap in whose folders no trials are looked for."""
_WHEN_OR_HOW = (
    "batch|block|bout|cam|camera|clip|condition|d|data|date|day|exp|experiment|film|flight|group|level|month|part|"
    "position|rec|recording|rep|rig|round|run|s|sequence|series|session|set|setup|site|speed|step|t|take|test|"
    "treatment|trial|version|video|view|week|year"
)
"""Words before a number that number something else than animals."""
_ANIMAL = re.compile(rf"(?!({_WHEN_OR_HOW})[-_ ]?[0-9])[a-z]+[-_ ]?[0-9]{{1,3}}[a-z]?", re.IGNORECASE)
"""Another word and a number, as ``bat07``; four digits are a year or a time."""
_TAG = re.compile(r"[0-9]{2,}[a-z]{1,2}[0-9]+", re.IGNORECASE)
"""What rings and transponders are numbered by, as ``078A3``."""
_MONTH = "jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec"
_TIME = re.compile(rf"({_WHEN_OR_HOW})s?[-_ ]?[0-9]*|[-_. 0-9]*(({_MONTH})[a-z]*)?[-_. 0-9]+", re.IGNORECASE)
"""Folders of a day, a session or the like: an animal may be in several of them."""


def find_trials(
    sources: Sequence[str | Path],
    *,
    arguments: Mapping[str, Any] | None = None,
    out: Path | None = None,
    pool: Pool | None = None,
    limit_s: float | None = None,
) -> list[Trial]:
    """The trials of folders, patterns and manifests.

    In a folder and those below it every file is known by its content. Files of one folder whose names differ only in
    what they hold (``bat_xypts.csv``, ``bat_xyzpts.csv``, ``bat_dvProject.mat``) are one trial, of which the rawest
    is tracked; pixel files of one camera each are one trial where there are as many as cameras, else they are put
    together by what remains of their names without the camera's. The animal is the one that folders tell. A
    calibration, a camera profile and a skeleton are those of the same name, else the only one in the folder, or in a
    folder there that is called calibration, else the same in the folders above, up to the one that was named. Where
    several would do, the trial is skipped and says so.

    Args:
        sources: Folders, files, patterns (``**`` is any depth), and manifests (``mocap.batches.trial``).
        arguments: Arguments of ``mocap.read`` for every trial; what a manifest states of one goes before.
        out: The folder of results, in which no trials are looked for.
        pool: Processes that look at files; None: one that is started where there is a file to look at.
        limit_s: Seconds that a look at a file may take at most; None: by its size.

    Returns:
        The trials in the order of their names; those that cannot be tracked say why in ``skip``.

    Raises:
        MocapError: nothing was found; the message says what was looked for, and where.
    """
    if pool is None and not all(is_manifest(Path(source)) for source in sources):
        with opened(1, preload=PRELOAD) as pool:
            return find_trials(sources, arguments=arguments, out=out, pool=pool, limit_s=limit_s)
    nothing = (None, [], Hints())
    arguments = {key: value for key, value in (arguments or {}).items() if value not in nothing}
    found: list[Trial] = []
    for source in sources:
        path = Path(source)
        if is_manifest(path):
            found += [replace(trial, arguments={**arguments, **trial.arguments}) for trial in read_manifest(path)]
            continue
        assert pool is not None
        looked = _Looked(root=path, above=path, arguments=arguments, pool=pool, limit_s=limit_s)
        if path.is_dir():
            above = path.resolve().parent if len(sources) > 1 else path
            found += _in_folder(replace(looked, above=above), path, out)
        elif path.exists():
            found += _of_files(looked.below(path.parent), [path])
        else:
            found += _of_pattern(looked, str(source), out)
    if not found:
        where = ", ".join(map(str, sources)) or "nothing"
        raise MocapError(
            f"{where}: no trial was found: looked in all folders below for pixel tracks (DLTdv, Argus, XMALab, "
            "DeepLabCut, SLEAP, ...) and positions (C3D, TRC, QTM, Vicon, Anipose, ...) that mocap info knows; give "
            "the folder that holds them, or a manifest with the columns trial,path"
        )
    return _named_apart(found)


def _of_pattern(looked: "_Looked", source: str, out: Path | None) -> list[Trial]:
    """The trials of a pattern; its folder is the part before the first wildcard."""
    paths = sorted(map(Path, glob.glob(source, recursive=True)))
    if not paths:
        what = "no file or folder fits this pattern" if glob.has_magic(source) else "there is no such file or folder"
        raise MocapError(f"{source}: {what}: give a folder, a pattern in quotes ('data/**/*.c3d'), or a manifest.csv")
    fixed = Path(source).parts
    root = Path(*fixed[: next(i for i, part in enumerate(fixed) if glob.has_magic(part))] or ["."])
    looked = looked.below(root)
    files = [path for path in paths if path.is_file()]
    found = _of_files(looked, files) if files else []
    for folder in (path for path in paths if path.is_dir()):
        found += _in_folder(looked, folder, out)
    return found


def _in_folder(looked: "_Looked", folder: Path, out: Path | None) -> list[Trial]:
    return _of_files(looked, list(_walk(folder, None if out is None else out.resolve())))


def _walk(folder: Path, out: Path | None) -> Iterator[Path]:
    """The files below a folder, but for hidden ones and results of ours."""
    if folder.resolve() == out or _is_result(folder):
        return
    below = sorted(folder.iterdir(), key=lambda path: path.name)
    yield from (path for path in below if path.is_file() and not path.name.startswith("."))
    for path in below:
        if path.is_dir() and not path.name.startswith(".") and not path.is_symlink():
            yield from _walk(path, out)


def _is_result(folder: Path) -> bool:
    try:
        return any(name in WRITTEN for name in read_listing(folder).results)
    except OutputError:
        return False


def _of_files(looked: "_Looked", files: Sequence[Path]) -> list[Trial]:
    """The trials among files below a root."""
    by_folder: dict[Path, list[Path]] = {}
    for file in files:
        by_folder.setdefault(file.parent, []).append(file)
    if by_folder:
        looked.at(*by_folder)
    found = []
    for folder, own in sorted(by_folder.items()):
        there = looked.at(folder)
        tracks = {path: there["tracks"][path] for path in own if path in there["tracks"]}
        for name, (raw, *_) in _by_base(tracks).items():
            found.append(_trial(looked, folder, name, [raw], cameras=tracks[raw].pixels))
        for path in own:
            if path in there["unknown"]:
                named = _trial_name(looked.folders(folder), path.stem)
                skip = there["unknown"][path].format
                found.append(Trial(name=named, paths=(path,), arguments=looked.arguments, skip=skip))
    for folder, views in _view_folders(looked, by_folder).items():
        for name, paths in _views(looked, folder, views).items():
            found.append(_trial(looked, folder, name, paths, cameras=True))
    return _with_animals(found, [looked.folders(trial.paths[0].parent) for trial in found])


def _with_animals(trials: Sequence[Trial], folders: Sequence[Sequence[str]]) -> list[Trial]:
    """The trials with the animal that their folders tell.

    That is the uppermost folder called by a word and a number (``bat07``) or as a ring (``078A3``), but for words that
    number days, trials and the like, if such folders of one name hold several trials somewhere: else they are the
    trials' own. A name below several others that are no days (``F2`` of ``078A3`` and of ``FE404``) numbers trials.
    """
    above: dict[str, set[str]] = defaultdict(set)
    for names in folders:
        for over, name in pairwise(names):
            above[name.casefold()] |= set() if _TIME.fullmatch(over) else {over.casefold()}

    def of(name: str) -> bool:
        return bool(_ANIMAL.fullmatch(name) or _TAG.fullmatch(name)) and len(above[name.casefold()]) < 2

    animals = [next(filter(of, names), "") for names in folders]
    if max(Counter(name.casefold() for name in animals if name).values(), default=0) < 2:
        return list(trials)
    return [replace(trial, animal=name) for trial, name in zip(trials, animals, strict=True)]


def _view_folders(looked: "_Looked", by_folder: Mapping[Path, Sequence[Path]]) -> dict[Path, list[Path]]:
    """The pixel files of one camera each by folder; those in folders that are called as cameras by the folder above."""
    found: dict[Path, list[Path]] = {}
    for folder, own in sorted(by_folder.items()):
        views = [path for path in looked.at(folder)["view"] if path in own]
        if views:
            above = folder.name in _cameras(looked, folder)
            found.setdefault(folder.parent if above else folder, []).extend(views)
    return found


def _cameras(looked: "_Looked", folder: Path) -> tuple[str, ...]:
    calibration = looked.arguments.get("calibration") or looked.beside(folder, folder.name, "calibration")[0]
    return () if calibration is None else looked.cameras(Path(calibration))


def _by_base(tracks: Mapping[Path, Look]) -> dict[str, list[Path]]:
    """The files of each trial by its name, the rawest first."""
    groups: dict[str, list[Path]] = {}
    for path in tracks:
        groups.setdefault(base(path), []).append(path)
    order = {name: i for i, name in enumerate(TRACKS)}
    return {
        name: sorted(paths, key=lambda path: (order.get(tracks[path].format, 0), path.name))
        for name, paths in groups.items()
    }


def _views(looked: "_Looked", folder: Path, views: Sequence[Path]) -> dict[str, list[Path]]:
    """The pixel files of each trial that has one a camera."""
    cameras = _cameras(looked, folder)
    if len(views) in (1, len(cameras)):
        return {views[0].stem if len(views) == 1 else folder.name: list(views)}
    groups: dict[str, list[Path]] = {}
    for path in views:
        groups.setdefault(_without_camera(path.stem, cameras), []).append(path)
    if max(map(len, groups.values())) == 1:  # names do not say which belong together
        return {folder.name: list(views)}
    return groups


def _without_camera(stem: str, cameras: Sequence[str]) -> str:
    """A name without the camera's: what the views of one trial have in common."""
    for camera in sorted(cameras, key=len, reverse=True):
        if re.search(rf"(?<![a-zA-Z0-9]){re.escape(camera)}(?![0-9])", stem, re.IGNORECASE):
            return re.sub(rf"[-_. ]*(?<![a-zA-Z0-9]){re.escape(camera)}(?![0-9])", "", stem, flags=re.IGNORECASE)
    return re.sub(r"[-_. ]*cam(era)?[-_ ]?([0-9]+|[a-z](?![a-z]))", "", stem, flags=re.IGNORECASE).strip("-_. ")


def _trial(looked: "_Looked", folder: Path, name: str, paths: Sequence[Path], *, cameras: bool) -> Trial:
    """A trial with what lies beside it; what is stated for all goes before."""
    own, skip = dict(looked.arguments), ""
    for kind in ("calibration", "profile", "skeleton") if cameras else ("skeleton",):
        if kind in own or (kind == "profile" and "calibration" not in own):
            continue
        path, trouble = looked.beside(folder, base(paths[0]), kind)
        if path is not None:
            own[kind] = path
        skip = skip or trouble
    alone = len(paths) == 1 and looked.one_camera(paths[0])  # one video is tracked in the plane of its image
    if alone or "profile" in own or any(looked.has_lens(Path(file)) for file in (paths[0], own.get("calibration", ""))):
        own.pop("fit_lens", None)  # what is stated for all is for those without a lens
    if cameras and "calibration" not in own and not skip and not alone:
        skip = (
            "pixels without a calibration: none lies in its folder, in one called calibration, or above, up to "
            f"{looked.root.resolve().name}: state it in the manifest, or with `calibration`"
        )
    return Trial(
        name=_trial_name(looked.folders(folder), name or folder.name), paths=tuple(paths), arguments=own, skip=skip
    )


def _trial_name(folders: Sequence[str], name: str) -> str:
    """Folders, and the name; of ``bat7/trial3/bat7_trial3`` what folders say already is not said twice."""
    own = name
    for folder in folders:
        words = "[-_. ]".join(map(re.escape, re.split("[-_. ]", folder)))
        own = re.sub(rf"^{words}(?:[-_. ]+|$)", "", own, flags=re.IGNORECASE)
    parts = [*folders, own] if own else list(folders)
    found = "/".join(part.lstrip(".") or "trial" for part in parts)
    check_name(found)
    return found


def _named_apart(trials: Sequence[Trial]) -> list[Trial]:
    """Trials in the order of their names, no two of one name: those of one name get the end of their files' too."""
    count = Counter(trial.name.casefold() for trial in trials)
    found: dict[str, Trial] = {}
    for trial in trials:
        name = trial.name
        if count[name.casefold()] > 1:
            name = f"{name}{trial.paths[0].suffix.lower()}"
        number, plain = 1, name
        while name.casefold() in found:
            number += 1
            name = f"{plain}-{number}"
        found[name.casefold()] = replace(trial, name=name)
    return sorted(found.values(), key=lambda trial: trial.name)


@dataclass(frozen=True, kw_only=True)
class _Looked:
    """Folders that were looked into.

    Attributes:
        root: The highest of them.
        above: The folder below which folders are a part of trials' names.
        arguments: Arguments of ``mocap.read`` for every trial.
        pool: Processes that look.
        limit_s: Seconds that a look may take at most.
        seen: What each holds: its files by what they are.
        rigs: Names of the cameras of calibrations that lie elsewhere.
    """

    root: Path
    above: Path
    arguments: Mapping[str, Any]
    pool: Pool
    limit_s: float | None
    seen: dict[Path, dict[str, dict[Path, Look]]] = field(default_factory=dict)
    rigs: dict[Path, tuple[str, ...]] = field(default_factory=dict)

    def below(self, root: Path) -> "_Looked":
        """The same below another root, by which trials are named, too."""
        return replace(self, root=root, above=root)

    @property
    def hints(self) -> Hints:
        """How files are to be read where they do not say so themselves."""
        return self.arguments.get("hints") or Hints()

    def at(self, *folders: Path) -> dict[str, dict[Path, Look]]:
        """What a folder holds (of several: the first; at all of their files is looked at a time)."""
        new = {
            folder: [path for path in sorted(folder.iterdir()) if path.is_file() and not path.name.startswith(".")]
            for folder in folders
            if folder not in self.seen
        }
        files = [path for paths in new.values() for path in paths]
        found = looks(files, self.hints, pool=self.pool, limit_s=self.limit_s) if files else {}
        for folder, paths in new.items():
            self.seen[folder] = defaultdict(dict)
            for path in paths:
                self.seen[folder][found[path].role][path] = found[path]
        return self.seen[folders[0]]

    def cameras(self, calibration: Path) -> tuple[str, ...]:
        """Names of the cameras of a calibration, which may lie anywhere."""
        there = self.seen.get(calibration.parent, {}).get("calibration", {})
        if calibration in there:
            return there[calibration].cameras
        if calibration not in self.rigs:
            calls, limit = (
                {calibration: partial(camera_names, calibration)},
                partial(limit_of_look, limit_s=self.limit_s),
            )
            for path, went in self.pool.each(calls, limit_s=limit):
                self.rigs[path] = () if isinstance(went.exception(), Lost) else went.result()
        return self.rigs[calibration]

    def one_camera(self, path: Path) -> bool:
        """Whether a file holds pixels of one camera."""
        return any(path in there and there[path].one for there in self.at(path.parent).values())

    def has_lens(self, path: Path) -> bool:
        """Whether the cameras of a file that was looked at have lenses."""
        return any(path in there and there[path].lens for there in self.seen.get(path.parent, {}).values())

    def folders(self, folder: Path) -> tuple[str, ...]:
        """The folders that are a part of the names of a folder's trials."""
        try:
            return folder.resolve().relative_to(self.above.resolve()).parts
        except ValueError:  # a link that leads elsewhere
            return ()

    def beside(self, folder: Path, name: str, kind: str) -> tuple[Path | None, str]:
        """The calibration, profile or skeleton of a trial, or why none of several was taken."""
        for level in (folder, *self._above(folder)):
            places = [level] if level.is_dir() else []
            places += [path for path in sorted(level.iterdir()) if path.is_dir() and "calib" in path.name.lower()]
            for place in places:
                if candidates := self.at(place)[kind]:
                    return _chosen(candidates, name, kind)
        return None, ""

    def _above(self, folder: Path) -> list[Path]:
        root = self.root.resolve()
        above = []
        for path in folder.resolve().parents:
            if root not in (path, *path.parents):
                break
            above.append(path)
        return above


def _chosen(files: Mapping[Path, Look], name: str, kind: str) -> tuple[Path | None, str]:
    """The one whose name begins the trial's, the longest; else the only one of the format that goes first."""
    named = [path for path in files if base(path) and name.casefold().startswith(base(path).casefold())]
    longest = max((len(base(path)) for path in named), default=0)
    paths = [path for path in named if len(base(path)) == longest] or list(files)
    if kind == "calibration":
        first = min(CALIBRATIONS.index(files[path].format) for path in paths)
        paths = [path for path in paths if CALIBRATIONS.index(files[path].format) == first]
    if len(paths) == 1:
        return paths[0], ""
    names = some([path.name for path in paths])
    return None, f"{len(paths)} files could be its {kind} ({names}): state which in the manifest"
