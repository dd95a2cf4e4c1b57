"""What a recording tells of itself, and what the others of its session tell of it (``mocap.audit.across``)."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mocap.audit.across import TrialFacts, median_lengths
from mocap.audit.geometry import handedness, jitter_px
from mocap.audit.offsets import estimate_offsets
from mocap.cameras.arrangement import by_camera
from mocap.cameras.triangulate import linear, residual_px
from mocap.findings import Finding, worst_first
from mocap.io.unstated_unit import length
from mocap.json_records import plain, record
from mocap.parts import of_the_whole
from mocap.reading.decided import decided
from mocap.recording import Recording


@dataclass(frozen=True, eq=False, kw_only=True)
class Siblings:
    """What the other trials of its session tell of a recording.

    Attributes:
        told: How it differs from them.
    """

    told: tuple[Finding, ...] = ()

    step: ClassVar[str] = "read"
    depends_on: ClassVar[tuple[str, ...]] = ()

    at = only = of_the_whole

    def findings(self) -> tuple[Finding, ...]:
        """What they tell."""
        return self.told

    def to_file(self, folder: Path) -> dict[str, Any]:  # noqa: ARG002
        """All of it."""
        return plain(self)

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:  # noqa: ARG003
        """Read back."""
        return record(cls, entries, where)


def own_findings(recording: Recording) -> tuple[Finding, ...]:
    """What is found in a recording's own files, without what other trials tell of it."""
    parts = (part for part in recording.parts.values() if not isinstance(part, Siblings))
    return tuple(worst_first(finding for part in parts for finding in part.findings()))


FRAMES = 200
"""Frames that are looked at, evenly taken: medians of 200 are known to 9 % of their spread."""


def facts_of(
    recording: Recording, *, session: str = "", animal: str = "", stated: tuple[str, ...] = (), name: str = ""
) -> TrialFacts:
    """The facts of one recording, read and not cleaned; of one camera and in a plane those that can be had.

    Args:
        recording: As ``mocap.read`` gives it.
        session: What its siblings have in common with it.
        animal: Whose it is.
        stated: Arguments that were stated for it alone.
        name: Of the trial; empty: the recording's.
    """
    if not {"pixels", "position"} & {*recording.data}:  # bodies alone
        return TrialFacts(name=name or recording.name, session=session, animal=animal, stated=stated)
    seen: NDArray[np.bool_] = recording.seen
    if "pixels" in recording.data:
        seen = np.asarray(seen.any(axis=0))
    frames, ever = np.flatnonzero(seen.any(axis=1)), np.asarray(seen.any(axis=0))
    facts: dict[str, Any] = {
        "name": name or recording.name,
        "session": session,
        "animal": animal,
        "fps": float(recording.fps or np.nan),
        "markers": tuple(name for name, shown in zip(recording.names, ever, strict=True) if shown),
        "cameras": recording.camera_names if "pixels" in recording.data else (),
        "rig": _rig(recording),
        "unit": recording.source.unit or recording.data.attrs.get("space_unit") or "",
        "stated": stated,
        "samples": int(seen.sum()),
    }
    if not len(frames):
        return TrialFacts(**facts, seen=0.0)
    within = slice(int(frames[0]), int(frames[-1]) + 1)
    facts["seen"] = float(recording.seen[..., within, :].mean())
    some = frames[np.unique(np.linspace(0, len(frames) - 1, min(FRAMES, len(frames))).astype(int))]
    after = np.minimum(some + 1, len(seen) - 1)
    if "pixels" in recording.data:
        facts["noise_px"] = float(jitter_px(recording.data["pixels"].values))
        if not (recording.cameras and "ideal" in recording.data and len(recording.cameras) > 1):
            return TrialFacts(**facts)
        ideal, matrices = recording.ideal_px, recording.matrices
        xyz, later = (linear(matrices, ideal[:, index]) for index in (some, after))
        miss = residual_px(matrices, ideal[:, some], xyz)
        if np.isfinite(miss).any():
            facts["residual_px"] = float(np.nanmedian(miss))
            looked = np.isfinite(ideal[:, some, :, 0]).reshape(len(ideal), -1)
            facts["camera_px"] = tuple(map(float, by_camera(miss.ravel(), looked)))
        if (lags := estimate_offsets(matrices, ideal)) is not None:
            facts["lag_frames"] = tuple(map(float, lags.offset_frames))
        if (rows := decided(recording).rows) is not None:
            facts["mirrored"] = handedness(recording.cameras, y_up=rows.coefficients == "lower-left")
    else:
        xyz, later = (recording.xyz_m[index] for index in (some, after))
    lengths = median_lengths(recording.names, xyz)
    steps = np.linalg.norm(later - xyz, axis=-1)[after > some]
    steps = steps[np.isfinite(steps)]
    if lengths and len(steps):
        facts["step"] = float(np.median(steps) / np.median(list(lengths.values())))
    return TrialFacts(**facts, lengths_m=lengths, long_m=length(xyz))


def _rig(recording: Recording) -> str:
    """A word that recordings of one calibration share: of its projections to six digits."""
    if not recording.cameras:
        return ""
    scaled = recording.matrices / np.abs(recording.matrices).max(axis=(1, 2), keepdims=True)
    return sha256(np.round(scaled, 6).tobytes()).hexdigest()[:12]
