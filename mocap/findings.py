"""What was found in a recording, or decided about it: data, each with the one sentence that people read."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import IntEnum, StrEnum
from functools import partial
from typing import Any

from mocap.text import number_of


class Harm(IntEnum):
    """What an alarm of a kind says of the results; the order in which people read them."""

    NOTHING = 0  # a decision, or a count
    INTERVALS = 1  # intervals, or what is left unused
    SAMPLES = 2  # some samples, markers or frames
    ALL = 3  # all results


class Kind(StrEnum):
    """What a finding is about; its value are the words that files keep.

    Attributes:
        harm: What is wrong where it is an alarm.
        mends: Arguments of ``mocap.read`` (or of ``mocap.track``) by which its user can mend it.
    """

    harm: Harm
    mends: tuple[str, ...]

    def __new__(cls, words: str, harm: Harm = Harm.NOTHING, *mends: str) -> "Kind":
        """A kind by its words."""
        one = str.__new__(cls, words)
        one._value_, one.harm, one.mends = words, harm, mends
        return one

    # how files were read
    READING = "reading"
    ASSUMED_UNIT = "assumed unit", Harm.ALL, "unit"
    UNITS = "units", Harm.ALL, "unit"
    FRAME_RATE = "frame rate", Harm.ALL, "fps"
    REFUSED = "refused", Harm.ALL
    PIXEL_ORIGIN = "pixel origin", Harm.ALL, "origin"
    PLANE = "plane"
    MEASURES_IN_A_PLANE = "measures in a plane"
    # cameras and their pixels
    SWAPPED_CAMERAS = "swapped cameras", Harm.ALL, "tracks"
    MIRRORED_PIXELS = "mirrored pixels", Harm.ALL
    SHIFTED_PIXELS = "shifted pixels", Harm.ALL
    MIRRORED_WORLD = "mirrored world", Harm.ALL, "calibration"
    MIRRORED_CAMERA = "mirrored camera", Harm.ALL
    COPIED_CAMERAS = "copied cameras", Harm.ALL
    COPIED_PIXELS = "copied pixels", Harm.ALL
    FOREIGN_CAMERA = "foreign camera", Harm.ALL
    FOREIGN_CALIBRATION = "foreign calibration", Harm.ALL
    LARGE_RESIDUAL = "large residual", Harm.ALL
    UNEVEN_CAMERAS = "uneven cameras", Harm.ALL
    DISTORTION = "distortion", Harm.ALL, "profile", "fit_lens"
    LENS = "lens", Harm.ALL, "profile", "fit_lens"
    CAMERA_OFFSETS = "camera offsets", Harm.ALL, "correct_lag"
    CAMERA_OFFSET = "camera offset"
    BAD_CAMERA = "bad camera", Harm.SAMPLES
    # stored points
    STORED_POINTS = "stored points"
    STALE_POINTS = "stale points", Harm.SAMPLES
    ANOTHER_WORLD = "another world", Harm.SAMPLES
    WRONG_COLUMNS = "wrong columns", Harm.SAMPLES
    TIME_SHIFT = "time shift", Harm.SAMPLES
    ONE_V_ROW = "one v row", Harm.SAMPLES
    # markers and samples
    JUMP = "jump", Harm.SAMPLES
    REPEATED_FRAMES = "repeated frames", Harm.SAMPLES
    EXCHANGED_FRAMES = "exchanged frames", Harm.SAMPLES
    SINGLE_SAMPLES = "single samples", Harm.SAMPLES
    NEGATIVE_PIXELS = "negative pixels", Harm.SAMPLES
    BY_HAND = "corrections by hand", Harm.SAMPLES
    CORRECTIONS = "corrections", Harm.SAMPLES, "edits_anyway"
    NEVER_SEEN = "never seen", Harm.SAMPLES
    NEVER_TOGETHER = "never together", Harm.ALL
    EXCHANGED_NAMES = "exchanged names", Harm.SAMPLES
    IDENTITY_SWITCH = "identity switch"
    SHORT_SWITCHES = "short identity switches"
    AMBIGUOUS_CLICKS = "ambiguous clicks"
    REJECTED_RAYS_MISS = "rejected: rays_miss"
    REJECTED_LIKELIHOOD = "rejected: likelihood"
    REJECTED_JUMP = "rejected: jump"
    REJECTED_DUPLICATE = "rejected: duplicate"
    REJECTED_BONE_LENGTH = "rejected: bone_length"
    REJECTED_CONTRADICTED = "rejected: contradicted"
    REJECTED_DOUBTFUL_NAME = "rejected: doubtful_name"
    REJECTED_RAYS = "rejected: rays"
    UNLIKE_SIBLINGS = "unlike the other trials", Harm.ALL
    # noise and intervals
    QUANTISED_PIXELS = "quantised pixels", Harm.INTERVALS
    PIXEL_NOISE = "pixel noise", Harm.ALL, "pixel_sd"  # intervals, and what is rejected
    INTERVALS = "intervals", Harm.INTERVALS
    SLOW_ERRORS = "slow errors"
    POSITION_NOISE = "position noise"
    LIKELIHOODS = "likelihoods"
    # models
    JOINTS = "joints", Harm.INTERVALS, "skeleton"
    ONE_CAMERA = "one camera"
    MIRROR_IMAGE = "mirror image"
    UNLIKE_POSES = "unlike poses"
    POOR_VIEW = "poor view"
    MISFIT = "misfit"
    WIDER_INTERVALS = "wider intervals"
    UNKNOWN_POSITIONS = "unknown positions"
    ONE_TRIAL = "one trial"
    BONES_NOT_KEPT = "bones not kept"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check, or a decision.

    Attributes:
        kind: What was checked.
        text: One sentence: what was found, what that means, what to do.
        alarm: Whether something is wrong; otherwise a decision is stated, with the evidence for it.
        numbers: The evidence, by name, with units in the names.
        cameras: Cameras concerned.
        markers: Markers concerned.
        frames: Rows concerned, from 1; of many only the first.
        mends: Arguments by which its user can mend it; None: of an alarm those of its kind, else none.
        same_as: Kinds of findings that tell of the same fault by other evidence: both are told as one.
    """

    kind: Kind
    text: str
    alarm: bool = False
    numbers: Mapping[str, float] = field(default_factory=dict)
    cameras: tuple[str, ...] = ()
    markers: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()
    mends: tuple[str, ...] | None = None
    same_as: tuple[Kind, ...] = ()

    def __post_init__(self) -> None:
        """Look its kind up, also by its words, and what mends it."""
        object.__setattr__(self, "kind", Kind(self.kind))
        if self.mends is None:
            object.__setattr__(self, "mends", self.kind.mends if self.alarm else ())

    @property
    def asks(self) -> bool:
        """Whether somebody is to do something: it is an alarm, or leaves open what its user can state."""
        return self.alarm or bool(self.mends)

    def __str__(self) -> str:
        """The sentence."""
        return self.text

    def as_json(self) -> dict[str, Any]:
        """For reports."""
        same = [kind.value for kind in self.same_as]
        return {**asdict(self), "kind": self.kind.value, "numbers": dict(self.numbers), "same_as": same}


alarm = partial(Finding, alarm=True)
"""One that says that something is wrong."""

MOST = 20
"""Frames that a finding lists."""


def alarms(findings: Iterable[Finding]) -> list[Finding]:
    """Those that say that something is wrong, worst first."""
    return sorted((f for f in _as_one(list(findings)) if f.alarm), key=lambda f: -f.kind.harm)


def worst_first(findings: Iterable[Finding]) -> list[Finding]:
    """The order in which all commands tell them: alarms, worst first; what can be stated; the rest. None twice."""
    once: dict[str, Finding] = {}
    for one in sorted(_as_one(list(findings)), key=lambda f: not f.alarm):
        once.setdefault(one.text, one)
    rest = [f for f in once.values() if not f.alarm]
    return [*alarms(once.values()), *(f for f in rest if f.asks), *(f for f in rest if not f.asks)]


def _as_one(findings: list[Finding]) -> list[Finding]:
    """The findings, what tells of one fault by two pieces of evidence (``same_as``) as one that has both."""
    for further in [one for one in findings if one.same_as and one.asks]:
        own = next((f for f in findings if f.asks and f.kind in further.same_as), None)
        if own is not None:
            rest = [one for one in findings if one is not own and one is not further]
            findings = [_both(own, further), *rest]
    return findings


def _both(own: Finding, further: Finding) -> Finding:
    return replace(
        own if own.kind.harm >= further.kind.harm else further,
        text=f"{own.text}. Beside the others: {further.text}",
        alarm=own.alarm or further.alarm,
        numbers={**further.numbers, **own.numbers},
        mends=tuple(dict.fromkeys([*(further.mends or ()), *(own.mends or ())])),
        same_as=(),
    )


def readings(texts: Iterable[str], *, where: str = "") -> tuple[Finding, ...]:
    """How a file (``where``) was read where it leaves that open, by the sentences of its reader."""
    return tuple(Finding(kind=Kind.READING, text=f"{where}: {text}" if where else text) for text in texts)


def over_blocks(blocks: Iterable[Iterable[Finding]]) -> list[Finding]:
    """The 40 commonest findings of a recording's blocks.

    Those of one kind and markers are one, where the cameras of one are among those of the other. Markers that a block
    never sees are told of the recording where no block sees them, and that markers are never seen together where
    most blocks say so.
    """
    blocks = _never_seen_in_any([list(block) for block in blocks])
    apart = sum(any(f.kind is Kind.NEVER_TOGETHER for f in block) for block in blocks)
    if 2 * apart <= len(blocks):
        blocks = [[f for f in block if f.kind is not Kind.NEVER_TOGETHER] for block in blocks]
    found: list[list[Finding]] = []
    for one in (finding for block in blocks for finding in block):
        alike = [same for same in found if _alike(same[0], one)]
        if alike:
            alike[0].append(one)
        else:
            found.append([one])
    commonest = sorted(found, key=len, reverse=True)[:40]
    return [same[0] if len(set(map(str, same))) == 1 else _of_several(same) for same in commonest]


def _never_seen_in_any(blocks: list[list[Finding]]) -> list[list[Finding]]:
    """The findings of blocks, those on markers that are never seen of such alone that no block sees."""
    unseen = [{m for f in block if f.kind is Kind.NEVER_SEEN for m in f.markers} for block in blocks]
    always = set.intersection(*unseen) if unseen else set()

    def of_all(one: Finding) -> Finding | None:
        if one.kind is not Kind.NEVER_SEEN or not one.markers:
            return one
        kept = tuple(marker for marker in one.markers if marker in always)
        text = f"{one.text.partition(': ')[0]}: {', '.join(kept)}"
        return replace(one, text=text, markers=kept) if kept else None

    return [[kept for one in block if (kept := of_all(one)) is not None] for block in blocks]


def _alike(one: Finding, other: Finding) -> bool:
    fewer, more = sorted((set(one.cameras), set(other.cameras)), key=len)
    return (one.kind, one.markers, not fewer) == (other.kind, other.markers, not more) and fewer <= more


def _of_several(same: list[Finding]) -> Finding:
    first = same[0]
    others = number_of(len(same) - 1, "other block")
    text = f"{first.text} (and in {others}, with their own numbers)"
    return replace(first, text=text, numbers={}, frames=())


def listed(findings: Sequence[Finding], *, indent: str = "  ") -> list[str]:
    """The list as lines of text: what is wrong, worst first, what is left open, and what was decided."""
    wrong, left, rest = ([f.text for f in findings if _class(f) == k] for k in range(3))
    lines = ["What is wrong, worst first"] if wrong else ["Nothing is wrong" + (", as far as is known" if left else "")]
    lines += [f"  {number}. {text}" for number, text in enumerate(wrong, start=1)]
    for title, texts in (("Left open, to be stated", left), ("Decided", rest)):
        lines += [title, *(f"  - {text}" for text in texts)] if texts else []
    return [indent + line for line in lines]


def _class(finding: Finding) -> int:
    return 0 if finding.alarm else 1 if finding.asks else 2
