"""What a person corrected of a recording: a log to which lines are added, and which is replayed on the raw files."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError, MocapError
from mocap.pipeline.decided import decided
from mocap.pipeline.ideal_pixels import straightened, without_hand, without_lens
from mocap.recording import Recording
from mocap.records import Status

What = Literal["place", "unseen", "exchange", "delete", "undo"]


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
            numbers = isinstance(uv, list | tuple) and len(uv) == 2 and all(isinstance(x, int | float) for x in uv)
            wrong += [] if numbers and np.isfinite(uv).all() else ["uv_px"]
            object.__setattr__(self, "uv_px", tuple(map(float, uv)) if numbers else None)
        needs = {
            "place": ("frame", "marker", "camera", "uv_px"),
            "unseen": ("frame", "marker", "camera"),
            "exchange": ("frame", "marker", "other"),
            "delete": ("frame", "marker"),
            "undo": (),
        }
        wrong += [name for name in needs.get(self.what, ()) if getattr(self, name) is None]
        if wrong:
            raise FormatError(
                f"an edit needs {wrong[0]} to be stated, in its own type: see `mocap.pipeline.edits.Edit`"
            )

    def line(self) -> bytes:
        """As it stands in a log."""
        values = {name: value for name, value in asdict(self).items() if value is not None}
        return (json.dumps(values, ensure_ascii=False, allow_nan=False) + "\n").encode()


def read_edits(path: str | PathLike[str]) -> list[Edit]:
    """The edits of a log (``edits.jsonl``: a line of JSON each), those that were undone among them.

    A last line without its end was being written when the program was killed, and was never said to be kept: it is
    left out.

    Raises:
        FormatError: a line is no edit.
    """
    path = Path(path)
    *lines, _ = regular_bytes(path).split(b"\n")
    found = []
    for number, line in enumerate(lines, start=1):
        try:
            values = from_json(line, path.name)
            found.append(Edit(**values))
        except (TypeError, FormatError) as error:
            raise FormatError(f"{path.name}: line {number} is no edit ({error}): take it out") from None
    return found


def append_edit(path: Path, edit: Edit) -> None:
    """Add an edit to a log; when this returns it is on the disk, whatever happens to the program.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o644)
    try:
        end = os.lseek(handle, 0, os.SEEK_END)
        while end and os.lseek(handle, end - 1, os.SEEK_SET) >= 0 and os.read(handle, 1) != b"\n":
            end -= 1  # of a line that was being written at a kill
        os.ftruncate(handle, end)
        os.lseek(handle, end, os.SEEK_SET)
        line = edit.line()
        while line:
            line = line[os.write(handle, line) :]
        os.fsync(handle)
    finally:
        os.close(handle)
    if end == 0 and os.name == "posix":  # the name of a new file is on the disk with its folder
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def standing(edits: Sequence[Edit]) -> list[Edit]:
    """Edits that were not undone, in their order."""
    kept: list[Edit] = []
    for edit in edits:
        if edit.what == "undo":
            del kept[-1:]
        else:
            kept.append(edit)
    return kept


def edited(recording: Recording, edits: Sequence[Edit], *, where: str = "edits") -> Recording:
    """A recording as it was read, with edits replayed on its pixels, or on its positions where it has no pixels.

    Samples that were changed are marked (``data["edited"]``); what their program stated of them is replaced: a place
    that a person gives has the likelihood 1.

    Args:
        recording: Not cleaned yet.
        edits: A log's, in their order.
        where: What messages call them.

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
    for edit in standing(edits):
        try:
            apply(edit, values, score, placed, mask, recording)
        except MocapError as error:
            raise FormatError(f"{where}: {edit.what} of {edit.marker}, frame {edit.frame}: {error}") from None
    if not mask.any():
        return recording
    changed: dict[str, Any] = {"edited": mask}
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
        c = whole if edit.camera is None else _index("camera", edit.camera, recording.camera_names)
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
