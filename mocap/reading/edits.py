"""What a person corrected of a recording: a log to which lines are added, and which is replayed on the raw files.

The first line of a log says which recording it corrects (``Samples``); each of the others is one ``Edit``.
"""

import json
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError, MocapError
from mocap.findings import Finding, Kind
from mocap.reading.decided import decided
from mocap.reading.ideal_pixels import straightened, without_hand, without_lens
from mocap.recording import Recording
from mocap.records import Status
from mocap.text import number_of

What = Literal["place", "unseen", "exchange", "delete", "undo"]
FARTHEST_PX = 1e5
"""No image is as wide: the largest sensors of cameras have 20,000 px, and a place may lie a few images off."""


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One correction; names are those of the recording, frames its rows, from 1.

    Attributes:
        what: ``place``: the marker is at ``uv_px`` in a camera; ``unseen``: it is not to be seen there; ``exchange``:
            two markers bear each other's names; ``delete``: it is not to be seen in a range of frames; ``undo``: the
            last edit that stands is taken back.
        who: User of the computer.
        when: Time, ISO 8601.
        frame: The frame, or the first of a range.
        last: The last of a range; None: ``frame``.
        marker: Which; None only of ``undo``.
        other: The marker that it is exchanged with.
        camera: In which camera; None: in all.
        uv_px: Place in pixels as the file of the camera counts them.
    """

    what: What
    who: str
    when: str
    frame: int | None = None
    last: int | None = None
    marker: str | None = None
    other: str | None = None
    camera: str | None = None
    uv_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check what it says by itself."""
        kinds: dict[str, tuple[type, ...]] = {"who": (str,), "when": (str,)}
        kinds |= dict.fromkeys(("marker", "other", "camera"), (str, type(None)))
        kinds |= dict.fromkeys(("frame", "last"), (int, type(None)))
        wrong = [name for name, kind in kinds.items() if type(getattr(self, name)) not in kind]  # True is no number
        wrong += [] if self.what in get_args(What) else ["what"]
        uv = self.uv_px
        if uv is not None:
            numbers = isinstance(uv, list | tuple) and len(uv) == 2 and all(type(x) in (int, float) for x in uv)
            near = numbers and all(abs(x) <= FARTHEST_PX for x in uv)  # NaN is not
            wrong += [] if near else ["uv_px"]
            object.__setattr__(self, "uv_px", tuple(map(float, uv)) if near else None)
        needs = {
            "place": ("frame", "marker", "camera", "uv_px"),
            "unseen": ("frame", "marker", "camera"),
            "exchange": ("frame", "marker", "other"),
            "delete": ("frame", "marker"),
            "undo": (),
        }
        wrong += [name for name in needs.get(self.what, ()) if getattr(self, name) is None]
        if "uv_px" in wrong:
            raise FormatError(f"uv_px is {uv!r}"[:80] + f", expected two numbers of pixels within {FARTHEST_PX:,.0f}")
        if wrong:
            raise FormatError(f"an edit needs {wrong[0]} to be stated, in its own type: see `mocap.reading.edits.Edit`")
        if self.what == "exchange" and self.marker == self.other:
            raise FormatError(f"{self.marker!r} is exchanged with itself, expected two markers")

    def line(self) -> bytes:
        """As it stands in a log."""
        values = {name: value for name, value in asdict(self).items() if value is not None}
        return (json.dumps(values, ensure_ascii=False, allow_nan=False) + "\n").encode()


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Which recording a log corrects: its samples, not the bytes of its file.

    Attributes:
        names: The M markers, as the recording called them then.
        cameras: Its cameras; of positions none.
        frames: How many frames it has.
        samples: SHA-256 of each marker's samples (``samples_of``), shortened to 16 digits.
    """

    names: tuple[str, ...]
    cameras: tuple[str, ...]
    frames: int
    samples: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check that it is what ``line`` wrote."""
        for name in ("names", "cameras", "samples"):
            texts = getattr(self, name)
            if not isinstance(texts, list | tuple) or not all(isinstance(text, str) for text in texts):
                raise FormatError(f"{name} are no list of texts")
            object.__setattr__(self, name, tuple(texts))
        if type(self.frames) is not int or len(self.names) != len(self.samples):
            raise FormatError("frames is no number, or names and samples are not as many")

    def line(self) -> bytes:
        """As it stands first in a log."""
        return (json.dumps(asdict(self), ensure_ascii=False) + "\n").encode()

    def difference(self, here: "Samples", edits: Sequence[Edit]) -> str:
        """What is otherwise in the recording at hand, in words; empty: these edits are of it.

        Markers and cameras may have been given other names, and another order, as far as no edit names them.
        """
        if len(self.cameras) != len(here.cameras) or self.frames != here.frames:
            of = [
                f"{number_of(one.frames, 'frame')} of {number_of(len(one.cameras), 'camera') if one.cameras else '3D'}"
                for one in (self, here)
            ]
            return f"they were made on {of[0]}, and here are {of[1]}"
        left = list(here.samples)
        gone = []
        for name, digest in zip(self.names, self.samples, strict=True):
            if digest in left:
                left.remove(digest)
            else:
                gone.append(name)
        if gone or left:
            which = ", ".join(gone[:4]) + (", ..." if len(gone) > 4 else "")
            return f"the samples of {which} have changed since" if gone else "there are more markers here"
        before, now = (dict(zip(one.names, one.samples, strict=True)) for one in (self, here))
        stands = standing(edits)
        used = {name for edit in stands for name in (edit.marker, edit.other) if name is not None}
        if other := sorted(name for name in used & before.keys() & now.keys() if before[name] != now[name]):
            return f"{', '.join(other)} is the name of another marker here"
        seen = {edit.camera for edit in stands if edit.camera is not None}
        if other := [
            a for a, b in zip(self.cameras, here.cameras, strict=True) if a != b and a in seen & {*here.cameras}
        ]:
            return f"{', '.join(other)} is the name of another camera here"
        return ""


GRID_PX, GRID = 1e-4, 1e-7
"""Pixels, and positions as a share of the largest coordinate, are rounded to these before they are compared: nobody
digitises a hundredth of a pixel, and programs that save the same table again change 15th digits (Excel's are 15)."""


def samples_of(recording: Recording) -> Samples:
    """Which samples a recording has, as it was read without edits.

    The same of the same table that another program saved, with its columns in another order, or in another unit of
    length.
    """
    filmed = "pixels" in recording.data
    values = recording.data["pixels" if filmed else "position"].values
    # of a recording without samples, or at the origin alone, any scale does
    step = GRID_PX if filmed else GRID * (np.nanmax(np.abs(values), initial=0.0) or 1.0)
    whole = np.round(values / step) + 0.0  # -0 is 0
    whole[np.isnan(whole)] = np.nan  # one of many
    digests = [sha256(own.astype("<f8").tobytes()).hexdigest()[:16] for own in np.moveaxis(whole, -2, 0)]
    cameras, frames = recording.camera_names if filmed else (), len(recording.t_s)
    return Samples(names=recording.names, cameras=cameras, frames=frames, samples=tuple(digests))


@dataclass(frozen=True, kw_only=True)
class Log:
    """A file of edits.

    Attributes:
        name: Of the file.
        edits: In their order, those that were undone among them.
        of: What they are corrections of; None: it was written before logs said so.
    """

    name: str
    edits: list[Edit]
    of: Samples | None = None

    def replayed(self, recording: Recording, *, anyway: bool = False) -> Recording:
        """A recording with the edits, and findings where they may not be its own.

        Args:
            recording: As it was read, without edits.
            anyway: Whether they are replayed also where they were made on another one.

        Raises:
            OtherRecording: they were made on another recording.
            FormatError: an edit names what is not there.
        """
        found = edited(recording, self.edits, where=self.name, first=1 + (self.of is not None))
        how = decided(found)
        return found.with_part(replace(how, of_files=(*how.of_files, *self.checked(recording, anyway=anyway))))

    def checked(self, recording: Recording, *, anyway: bool = False) -> list[Finding]:
        """What is to be said of replaying the edits on a recording; arguments and errors as of ``replayed``."""
        if not self.edits:
            return []
        if self.of is None:
            text = (
                f"{self.name} does not say which recording it corrects (it was written before corrections did): check "
                "that it belongs to these files"
            )
            return [Finding(kind=Kind.CORRECTIONS, text=text)]
        difference = self.of.difference(samples_of(recording), self.edits)
        if not difference:
            return []
        if not anyway:
            raise OtherRecording(
                f"{self.name}: these corrections are of another recording, or it was changed: {difference}; take the "
                "files that were corrected, or give `edits_anyway` to replay them all the same"
            )
        text = f"{self.name}: corrections of another, or a changed, recording were replayed as asked: {difference}"
        return [Finding(kind=Kind.CORRECTIONS, alarm=True, text=text)]


class OtherRecording(FormatError):
    """Corrections were made on another recording than the one at hand."""

    mends = ("edits_anyway",)


def read_log(path: str | PathLike[str]) -> Log:
    """A log (``edits.jsonl``: a line of JSON each).

    A last line that was being written when the program was killed, and was never said to be kept, is left out; one that
    is whole but for its line end, as editors leave it, counts.

    Raises:
        FormatError: a line is no edit.
    """
    path = Path(path)
    *lines, last = regular_bytes(path).split(b"\n")
    lines += [last] if _is_whole(last) else []
    of, found = None, []
    for number, line in enumerate(lines, start=1):
        try:
            values = from_json(line, path.name, once=True)
            if number == 1 and isinstance(values, dict) and "samples" in values:
                of = Samples(**values)
            else:
                found.append(Edit(**values))
        except (TypeError, FormatError) as error:
            raise FormatError(f"{path.name}: line {number} is no edit ({error}): take it out") from None
    return Log(name=path.name, edits=found, of=of)


def read_edits(path: str | PathLike[str]) -> list[Edit]:
    """The edits of a log, as ``read_log`` has them."""
    return read_log(path).edits


def _is_whole(line: bytes) -> bool:
    """Whether a line without its end was written whole: as every line ends with a brace, none is by its beginning."""
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        return False
    return True


def append_edit(path: Path, edit: Edit, of: Samples | None = None) -> None:
    """Add an edit to a log; when this returns it is on the disk, whatever happens to the program.

    Args:
        path: The log.
        edit: The edit.
        of: What a new log is said to correct.

    Raises:
        OSError: it cannot be written, and names the log; there the edit is not, either.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
        try:
            _append(handle, path, edit, of)
        finally:
            os.close(handle)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _append(handle: int, path: Path, edit: Edit, of: Samples | None) -> None:
    before = end = os.lseek(handle, 0, os.SEEK_END)
    while end and os.lseek(handle, end - 1, os.SEEK_SET) >= 0 and os.read(handle, 1) != b"\n":
        end -= 1  # of a line that was being written at a kill
    os.lseek(handle, end, os.SEEK_SET)
    last = os.read(handle, before - end)
    line = edit.line()
    if _is_whole(last):
        end, line = before, b"\n" + line
    elif end == 0 and of is not None:
        line = of.line() + line
    os.ftruncate(handle, end)
    try:
        os.lseek(handle, end, os.SEEK_SET)
        while line:
            line = line[os.write(handle, line) :]
        os.fsync(handle)
        if end == 0 and os.name == "posix":  # the name of a new file is on the disk with its folder
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except BaseException:  # what is refused is not replayed, either
        with suppress(OSError):
            os.ftruncate(handle, end)
            os.fsync(handle)
        if end == 0:
            with suppress(OSError):
                path.unlink()
        raise


def standing(edits: Sequence[Edit]) -> list[Edit]:
    """Edits that were not undone, in their order."""
    kept: list[Edit] = []
    for edit in edits:
        if edit.what == "undo":
            del kept[-1:]
        else:
            kept.append(edit)
    return kept


def edited(recording: Recording, edits: Sequence[Edit], *, where: str = "edits", first: int | None = None) -> Recording:
    """A recording as it was read, with edits replayed on its pixels, or on its positions where it has no pixels.

    Samples that were changed are marked (``data["edited"]``); what their program stated of them is replaced: a place
    that a person gives has the likelihood 1.

    Args:
        recording: Not cleaned yet.
        edits: A log's, in their order.
        where: What messages call them.
        first: Line of the first of them, for messages; None: they are in no file.

    Raises:
        MocapError: the recording was cleaned, or an edit names what it does not hold.
    """
    if recording.cleaned:
        raise MocapError("edits are replayed on a recording as it was read: not after `mocap.clean`")
    filmed = "pixels" in recording.data
    values = np.array(recording.data["pixels" if filmed else "position"].values)
    score = None if recording.score is None else np.array(recording.score)
    placed = np.full_like(values, np.nan)
    mask = np.zeros(values.shape[-3:-1], dtype=bool)
    lines = {} if first is None else {id(edit): f" line {n}:" for n, edit in enumerate(edits, start=first)}
    for edit in standing(edits):
        try:
            apply(edit, values, score, placed, mask, recording)
        except MocapError as error:
            line = lines.get(id(edit), "")
            raise FormatError(f"{where}:{line} {edit.what} of {edit.marker}, frame {edit.frame}: {error}") from None
    if not mask.any():
        return recording
    changed: dict[str, Any] = {"edited": mask | recording.edited}
    changed |= {} if score is None else {"likelihood" if filmed else "confidence": score}
    if filmed:
        by_hand = np.isfinite(placed[..., 0])
        if by_hand.any():
            changed |= {"by_hand": by_hand, "overruled": np.where(by_hand[..., None], values, np.nan)}
        return _with_ideal(recording.having(pixels=np.where(by_hand[..., None], placed, values), **changed), mask)
    gone = ~np.isfinite(values[..., 0])
    cov = np.where((mask | gone)[..., None, None], np.nan, recording.cov_m2)
    status = np.where(gone, Status.MISSING, Status.MEASURED).astype(np.int8)
    return recording.having(position=values, covariance=cov, status=status, **changed)


def _with_ideal(recording: Recording, mask: NDArray[np.bool_]) -> Recording:
    """The recording with ideal pixels of samples that were changed, where these were decided before."""
    if decided(recording).rows is None:
        return recording
    own, ideal = without_hand(recording), np.array(recording.ideal_px)
    pixels = own.data["pixels"].values
    if recording.late_frames is None:
        ideal[:, mask] = without_lens(own, pixels[:, mask])
    else:
        ideal = straightened(own, pixels)
    return recording.having(ideal=ideal)


def apply(
    edit: Edit,
    values: Array,
    score: Array | None,
    placed: Array,
    mask: NDArray[np.bool_],
    recording: Recording,
) -> None:
    """Write one edit into arrays.

    Args:
        edit: Which; not ``undo``.
        values: (C, T, M, 2) pixels, or (T, M, 3) positions, but for what a person placed.
        score: (C, T, M) or (T, M), the program's own of each sample; None: it states none.
        placed: Shaped as ``values``, what a person placed; NaN elsewhere.
        mask: (T, M) set where samples were changed.
        recording: Whose names and cameras they are.

    Raises:
        MocapError: it names a frame, marker or camera that is not there.
    """
    n_frames, names = mask.shape[0], recording.names
    first, last = edit.frame or 0, edit.frame if edit.last is None else edit.last
    if last is None or not 1 <= first <= last <= n_frames:
        raise MocapError(f"expected frames from 1 to {n_frames}, the first before the last")
    frames = slice(first - 1, last)
    m = _index("marker", edit.marker, names)
    filmed = values.ndim == 4
    if not filmed and edit.camera is not None:
        raise MocapError("the recording holds positions and no cameras")
    if filmed:
        whole = slice(None)
        c: Any = whole if edit.camera is None else _index("camera", edit.camera, recording.camera_names)
        size = recording.cameras[c].size_px if edit.what == "place" and recording.cameras else None
        if (
            edit.uv_px is not None
            and size is not None
            and any(abs(x) > 2 * n for x, n in zip(edit.uv_px, size, strict=True))
        ):
            raise MocapError(f"{edit.uv_px} is far out of the image of {size[0]:g} x {size[1]:g} px")
        at: tuple = (c, frames, m)
    else:
        at = (frames, m)
    if edit.what == "exchange":
        n = _index("marker", edit.other, names)
        to = (*at[:-1], n)
        for array in (values, score, placed):
            if array is not None:
                array[at], array[to] = array[to].copy(), array[at].copy()
        mask[frames, n] = True
    else:
        placed[at] = np.nan if edit.what != "place" else edit.uv_px
        if edit.what != "place":
            values[at] = np.nan
        if score is not None:
            score[at] = 1.0 if edit.what == "place" else np.nan
    mask[frames, m] = True


def _index(kind: str, name: str | None, names: Sequence[str]) -> int:
    if name is None or name not in names:
        raise MocapError(f"there is no {kind} {name!r}: there are {', '.join(names)}")
    return list(names).index(name)
