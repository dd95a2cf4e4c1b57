"""Trials of one session, each against the others: the odd one out, with the others' value and what to state.

Facts are a few numbers of each trial, which a batch keeps with its results; nothing here opens a recording.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, isfinite, isnan, log
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.findings import Finding, Kind
from mocap.json_records import plain, record
from mocap.text import number_of

SAME_RATE = 1.02
"""Ratio up to which two frame rates are one: 23.976 and 24, 59.94 and 60 differ by a thousandth; 24 and 25 by 1.042."""
SAME_ANIMAL, ANOTHER_ANIMAL = 1.15, 1.5
"""Ratio of lengths up to which trials are of one size: of one animal (medians of a posture's distances differ by up to
1.1 between the shared flights of one bat), and where nobody says whose they are (adults of one species)."""
UNITS = {10.0: "cm for mm", 25.4: "in for mm", 100.0: "m for cm", 1000.0: "m for mm", 39.37: "m for in"}
"""Ratios of lengths that are units that were mixed up, and within 15 % of them."""
WORSE = 3.0
"""A residual or a noise so many times the others' is another one; less is a matter of which markers were seen."""
LEAST_PX = 1.0
"""Residuals below this are none to speak of, whatever the others have."""
FEW = 0.5
"""Share of what the others show of their samples, below which a trial is digitised in part."""


@dataclass(frozen=True, kw_only=True)
class TrialFacts:
    """What a trial tells of itself.

    Attributes:
        name: Of the trial.
        session: What its siblings have in common with it: a folder, a calibration.
        animal: Whose trial it is; empty: not stated.
        fps: Frames a second; NaN: not known.
        markers: Names of its markers that are ever seen.
        cameras: Names of its cameras, in their order.
        rig: What tells its calibration from others; empty: it has none.
        unit: Unit of lengths, as read.
        mirrored: Whether its world is left-handed; None: it cannot be told.
        lengths_m: Median distance between two markers, by ``a|b`` in the order of their names.
        long_m: Median over frames of the greatest distance between two markers, m; NaN: not known.
        step: Median way of a marker from frame to frame, over the median of ``lengths_m``.
        residual_px: Median reprojection error; NaN without cameras.
        camera_px: The same of each camera.
        lag_frames: By how much each camera runs late; empty: not known.
        noise_px: Standard deviation of a digitised point from frame to frame; NaN without pixels.
        seen: Share of the samples of its tracked range that were digitised.
        samples: Number of samples (a marker in a frame) that were digitised in any camera; 0: not known.
        stated: Arguments that were stated for this trial alone, as in a manifest: it may differ in these.
    """

    name: str
    session: str = ""
    animal: str = ""
    fps: float = float("nan")
    markers: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    rig: str = ""
    unit: str = ""
    mirrored: bool | None = None
    lengths_m: Mapping[str, float] = field(default_factory=dict)
    long_m: float = float("nan")
    step: float = float("nan")
    residual_px: float = float("nan")
    camera_px: tuple[float, ...] = ()
    lag_frames: tuple[float, ...] = ()
    noise_px: float = float("nan")
    seen: float = float("nan")
    samples: int = 0
    stated: tuple[str, ...] = ()

    @property
    def latest_frames(self) -> float:
        """By how much its latest, or earliest, camera is; NaN: not known."""
        return max(self.lag_frames, key=abs, default=float("nan"))

    @property
    def size_m(self) -> float:
        """Median distance between two markers, m."""
        return float(np.median(list(self.lengths_m.values()))) if self.lengths_m else float("nan")

    def as_json(self) -> dict[str, Any]:
        """For files; numbers that are not known are left out, or 0 among those of cameras."""
        known = {key: value for key, value in plain(self).items() if not (isinstance(value, float) and isnan(value))}
        return known | {"camera_px": [px if isfinite(px) else 0.0 for px in self.camera_px]}

    @classmethod
    def from_json(cls, data: Any) -> "TrialFacts":
        """From what ``as_json`` gave.

        Raises:
            FormatError: it is not that.
        """
        return record(cls, data, "facts")


def median_lengths(names: Sequence[str], xyz_m: Array, *, most: int = 30) -> dict[str, float]:
    """Median distance of each pair of markers (``most`` of them, evenly taken), as in ``TrialFacts.lengths_m``."""
    order = sorted(range(len(names)), key=lambda i: names[i])
    seen = [i for i in order if np.isfinite(xyz_m[:, i, 0]).sum() >= 3]
    some = [seen[i] for i in np.unique(np.linspace(0, len(seen) - 1, min(most, len(seen))).astype(int))] if seen else []
    found = {}
    for k, b in enumerate(some):
        for a in some[:k]:
            distance = np.linalg.norm(xyz_m[:, a] - xyz_m[:, b], axis=-1)
            distance = distance[np.isfinite(distance)]
            if len(distance) >= 3 and np.median(distance) > 0:
                found[f"{names[a]}|{names[b]}"] = float(np.median(distance))
    return found


def compared(trials: Sequence[TrialFacts]) -> dict[str, list[Finding]]:
    """What is odd of each trial beside the others of its session, by its name; worst first.

    A value is odd where more than half of all trials have another one together. Of two trials that differ both say so.
    What was stated for one trial alone is not held against it, nor what trials have that are of other things
    (``_of_one_kind``).
    """
    found: dict[str, list[Finding]] = {one.name: [] for one in trials}
    for session in dict.fromkeys(one.session for one in trials):
        some = [one for one in trials if one.session == session]
        if len(some) > 1:
            for one in some:
                others = [other for other in some if other is not one]
                alike = [other for other in others if _of_one_kind(one, other)]
                checks = (_rate, _hand, _size, _long, _cameras, _residual, _noise, _seen) if alike else ()
                found[one.name] += [finding for check in checks for finding in check(one, alike)]
                found[one.name] += _markers(one, others)
    return found


def _of_one_kind(one: TrialFacts, other: TrialFacts) -> bool:
    """Whether two trials may be of one rig or kind of animal: a marker, their number, or cameras in common."""
    a, b = set(one.markers), set(other.markers)
    return bool(a & b) or len(a) == len(b) or bool(set(one.cameras) & set(other.cameras))


def _siblings(others: Sequence[Any]) -> str:
    """Who they are."""
    return "the other trial has" if len(others) == 1 else f"the other {len(others)} trials of this session have"


def _most(count: int, others: int) -> bool:
    """Whether so many of the others are more than half of all trials, the one that is looked at among them."""
    return 2 * count > others + 1 or count == others == 1


def _agreed(values: Sequence[Hashable]) -> Hashable | None:
    """The value that most of the others have; None: there is none."""
    value, count = Counter(values).most_common(1)[0] if values else (None, 0)
    return value if _most(count, len(values)) else None


def _middle(values: Sequence[float], same: float) -> float:
    """The median of the others' values, if most of them agree with it within a ratio; NaN: they do not."""
    known = sorted(value for value in values if isfinite(value) and value > 0)
    if not known:
        return float("nan")
    middle = known[len(known) // 2]
    near = sum(abs(log(value / middle)) <= log(same) for value in known)
    return middle if _most(near, len(values)) else float("nan")


SAME_AS: Mapping[str, tuple[Kind, ...]] = {
    "frame rate": (Kind.FRAME_RATE,),
    "handedness": (Kind.MIRRORED_WORLD,),
    "lag of cameras": (Kind.CAMERA_OFFSETS,),
    "reprojection error": (
        Kind.SHIFTED_PIXELS,
        Kind.MIRRORED_PIXELS,
        Kind.CAMERA_OFFSETS,
        Kind.FOREIGN_CAMERA,
        Kind.FOREIGN_CALIBRATION,
        Kind.LARGE_RESIDUAL,
    ),
}
"""What a trial's own files tell of the same fault."""


def _odd(kind: str, text: str, *, alarm: bool, mends: tuple[str, ...] = (), **numbers: float) -> Finding:
    return Finding(
        kind=Kind.UNLIKE_SIBLINGS,
        text=f"{kind}: {text}",
        alarm=alarm,
        numbers={name: value for name, value in numbers.items() if isfinite(value)},
        mends=mends,
        same_as=SAME_AS.get(kind, ()),
    )


def _rate(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    """A frame rate that the others do not have; by how far markers move in a frame it is right or wrong."""
    theirs = _middle([other.fps for other in others], SAME_RATE)
    if "fps" in one.stated or not (isfinite(theirs) and isfinite(one.fps) and one.fps > 0):
        return []
    ratio = one.fps / theirs
    if abs(log(ratio)) <= log(SAME_RATE):
        return []
    text = f"{one.fps:g} frames a second, {_siblings(others)} {theirs:g}"
    moves = _middle([other.step for other in others], 4.0)
    if isfinite(moves) and isfinite(one.step) and one.step > 0:
        # a slower camera sees longer steps: with the true rates, steps are as the inverse of the rates
        as_far, as_stated = abs(log(one.step / moves)), abs(log(one.step / moves * ratio))
        if as_stated < as_far:
            return [_odd("frame rate", f"{text}; markers move accordingly, so that both may be right", alarm=False)]
        text += (
            f". Markers move as far from frame to frame as in {'that' if len(others) == 1 else 'those'}: it was filmed "
            f"at the same rate, and speeds are wrong by {max(ratio, 1 / ratio):.3g}"
        )
    return [_odd("frame rate", f"{text}: state `fps`", alarm=True, mends=("fps",), fps=one.fps, others=theirs)]


def _hand(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    theirs = _agreed([other.mirrored for other in others if other.mirrored is not None])
    if one.mirrored is None or theirs is None or theirs == one.mirrored or {"origin", "calibration"} & {*one.stated}:
        return []
    which = "is mirrored" if one.mirrored else "is not mirrored"
    text = (
        f"its world {which}, {_siblings(others)} {'one that is' if theirs else 'one that is not'}: left and right are "
        "exchanged in one of them; check the calibration, and state `origin`"
    )
    return [_odd("handedness", text, alarm=True, mends=("origin", "calibration"))]


def scale(one: TrialFacts, other: TrialFacts) -> float:
    """Lengths of one trial over those of another: the median ratio over the pairs of markers of both; NaN: none."""
    both = one.lengths_m.keys() & other.lengths_m.keys()
    return exp(float(np.median([log(one.lengths_m[k] / other.lengths_m[k]) for k in both]))) if both else float("nan")


def _size(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    """Lengths that differ from the others' by more than animals do, or by a unit."""
    named = [other for other in others if one.animal and other.animal == one.animal]
    relatives, most = (named, SAME_ANIMAL) if named else (others, ANOTHER_ANIMAL)
    if not named and one.animal and any(other.animal for other in others):
        most = 5.0  # stated to be another animal: only a unit is odd
    ratio = _middle([scale(one, other) for other in relatives], most)
    if not isfinite(ratio) or abs(log(ratio)) <= log(most):
        return []
    whose = f"of {one.animal} " if named else ""
    ends = f"{1e3 * one.size_m:.3g} mm between markers (median), {ratio:.3g} times what {_siblings(relatives)} {whose}"
    factor = max(ratio, 1 / ratio)
    unit = next((words for unit, words in UNITS.items() if abs(log(factor / unit)) < log(1.15)), None)
    if unit is not None and "unit" not in one.stated:
        text = f"{ends.rstrip()}: its unit is another one ({unit}): state `unit`"
        return [_odd("size", text, alarm=True, mends=("unit", "calibration"), ratio=ratio)]
    why = "its calibration or its unit is another one" if named else "another animal, calibration or unit"
    text = f"{ends.rstrip()}: {why}: state `animal`, `unit` or `calibration`"
    return [_odd("size", text, alarm=bool(named) or factor > 5.0, mends=("unit", "calibration"), ratio=ratio)]


def _long(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    """A length of the whole animal that the others do not have, though distances of the same markers agree."""
    theirs = _middle([other.long_m for other in others], SAME_ANIMAL)
    ratio = _middle([scale(one, other) for other in others], SAME_ANIMAL)
    if not (isfinite(theirs) and isfinite(one.long_m) and isfinite(ratio)):
        return []
    if abs(log(one.long_m / theirs)) <= log(SAME_ANIMAL) or abs(log(ratio)) > log(SAME_ANIMAL):
        return []
    text = (
        f"{1e3 * one.long_m:.3g} mm between its two most distant markers (median), {_siblings(others)} "
        f"{1e3 * theirs:.3g}; distances between the same markers agree ({ratio:.2f} times), so that others of them are "
        "seen together, as where a part of the animal is digitised: do not compare lengths of the whole"
    )
    return [_odd("length", text, alarm=False, long_m=one.long_m, others=theirs)]


def _cameras(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    theirs = _agreed([other.cameras for other in others])
    if not isinstance(theirs, tuple) or not (theirs and one.cameras):
        return []
    if theirs == one.cameras:
        rig = _agreed([other.rig for other in others])
        if not (rig and one.rig) or rig == one.rig:
            return []
        return [_odd("calibration", f"another one than {_siblings(others)}", alarm=False)]
    if sorted(theirs) == sorted(one.cameras):
        text = f"{', '.join(one.cameras)} in this order, {_siblings(others)} {', '.join(theirs)}"
        return [_odd("cameras", f"{text}: give its files in the same order", alarm=True, mends=("tracks",))]
    text = f"{number_of(len(one.cameras), 'camera')} ({', '.join(one.cameras)}), {_siblings(others)} "
    return [_odd("cameras", f"{text}{number_of(len(theirs), 'camera')} ({', '.join(theirs)})", alarm=False)]


def _residual(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    theirs = _middle([other.residual_px for other in others], WORSE)
    if not (isfinite(theirs) and isfinite(one.residual_px)):
        return []
    if one.residual_px < max(WORSE * theirs, theirs + LEAST_PX):
        return []
    lags = [abs(other.latest_frames) for other in others if other.lag_frames]
    if one.lag_frames and lags and abs(one.latest_frames) > float(np.median(lags)) + 1.0:
        which = one.cameras[max(range(len(one.lag_frames)), key=lambda c: abs(one.lag_frames[c]))]
        text = f"{which} by {one.latest_frames:+.2f} frames, {_siblings(others)} {np.median(lags):.2f} at most"
        return [_odd("lag of cameras", f"{text}: state `correct_lag`", alarm=False, mends=("correct_lag",))]
    pattern = ""
    if len(one.camera_px) == len(one.cameras) > 1:
        each = (f"{name} {px:.2g}" for name, px in zip(one.cameras, one.camera_px, strict=True))
        pattern = f" (by camera: {', '.join(each)})"
    text = (
        f"{one.residual_px:.2g} px{pattern}, {_siblings(others)} {theirs:.2g}: cameras exchanged or late, or another "
        "calibration: check `calibration` and the order of its files"
    )
    mends = ("calibration", "tracks", "correct_lag")
    return [_odd("reprojection error", text, alarm=True, mends=mends, residual_px=one.residual_px, others=theirs)]


def _ratio(words: str, value: Callable[[TrialFacts], float], unit: str) -> Callable[..., list[Finding]]:
    def check(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
        theirs = _middle([value(other) for other in others], WORSE)
        if not (isfinite(theirs) and isfinite(value(one))) or value(one) < WORSE * theirs:
            return []
        return [_odd(words, f"{value(one):.2g} {unit}, {_siblings(others)} {theirs:.2g}", alarm=False)]

    return check


_noise = _ratio("noise of digitised points", lambda one: one.noise_px, "px")


def _seen(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    theirs = float(np.median([other.seen for other in others if isfinite(other.seen)] or [np.nan]))
    if not (isfinite(theirs) and isfinite(one.seen)) or one.seen > FEW * theirs:
        return []
    text = f"{one.seen:.0%} of its samples were digitised, {_siblings(others)} {theirs:.0%}"
    return [_odd("share seen", text, alarm=False, seen=one.seen)]


def _markers(one: TrialFacts, others: Sequence[TrialFacts]) -> list[Finding]:
    """Markers that nearly all others have, or none of them; not judged where names differ as a whole."""
    have = Counter(marker for other in others for marker in other.markers)
    usual = {marker for marker, count in have.items() if count >= 0.75 * len(others)}
    own = set(one.markers)
    if not usual or not own or "skeleton" in one.stated:
        return []
    if not own & usual:
        text = f"{', '.join(sorted(own)[:6])}, {_siblings(others)} {', '.join(sorted(usual)[:6])}"
        if len(own) != len(usual):
            return [_odd("markers", f"{text}: other markers, or of another animal", alarm=False)]
        return [_odd("markers", f"{text}: give them the same names, by [aliases] of a skeleton", alarm=True)]
    lacks, more = sorted(usual - own), sorted(own - set(have))
    found = [f"lacks {', '.join(lacks[:8])}{', ...' if len(lacks) > 8 else ''}"] if lacks else []
    found += [f"has {', '.join(more[:8])}{', ...' if len(more) > 8 else ''}, which no other has"] if more else []
    return [_odd("markers", f"it {' and '.join(found)}", alarm=False)] if found else []


COLUMNS: Mapping[str, Callable[[TrialFacts], object]] = {
    "size_mm": lambda one: _digits(1e3 * one.size_m),
    "mirrored": lambda one: None if one.mirrored is None else ("yes" if one.mirrored else "no"),
    "unit": lambda one: one.unit or None,
    "camera_names": lambda one: " ".join(one.cameras) or None,
    "worst_camera_px": lambda one: _digits(max(one.camera_px, default=float("nan"))),
    "lag_frames": lambda one: _digits(one.latest_frames),
    "noise_px": lambda one: _digits(one.noise_px),
    "seen_percent": lambda one: _digits(100 * one.seen),
}
"""Columns of ``summary.csv`` beside those that a result has: what trials are compared by."""


def _digits(value: float) -> float | None:
    return float(f"{value:.4g}") if isfinite(value) else None
