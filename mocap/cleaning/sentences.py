"""What is found while a recording is cleaned, as findings.

Those of the audit are made where it finds them (``mocap.audit``), those of a reader where it reads (``mocap.io``).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.audit.stored import StalePoint
from mocap.cleaning.bias import RayBias
from mocap.cleaning.camera_health import CameraHealth
from mocap.cleaning.likelihoods import FAR, LikelihoodNoise
from mocap.cleaning.positions import POSE_MARKERS, REASONS, shows_a_pose
from mocap.cleaning.swaps import DOUBTFUL, Swap
from mocap.findings import MOST, Finding, Kind
from mocap.records import Plane
from mocap.text import number_of

FAR_OFF = 2.0
"""A standard deviation so many times another contradicts it. Chosen, not measured."""


def contradiction(stated_px: float | None, *, low_px: float, high_px: float) -> list[Finding]:
    """Where ``--pixel-sd`` is not what the pixels show, to a factor of ``FAR_OFF``.

    Args:
        stated_px: As stated; None: not.
        low_px: Noise that rays show once their slow errors are taken out.
        high_px: Noise that rays show with all their errors.
    """
    if stated_px is None:
        return []
    narrow, wide = stated_px * FAR_OFF < low_px, stated_px > FAR_OFF * high_px
    if not narrow and not wide:
        return []
    shown = low_px if narrow else high_px
    what = (
        f"Outliers are rejected by the residuals; intervals use the stated value and are {shown / stated_px:.0f} times "
        "too narrow for the residuals"
        if narrow
        else f"Intervals use the stated value and are {stated_px / shown:.0f} times as wide as the residuals justify, "
        "and fewer outliers are rejected"
    )
    text = (
        f"`pixel_sd` {stated_px:g} contradicts the pixels, whose triangulation residuals correspond to {shown:.2g} px. "
        f"{what}: leave it out, or check it"
    )
    return [Finding(kind=Kind.PIXEL_NOISE, alarm=True, text=text, numbers={"stated_px": stated_px, "shown_px": shown})]


def lens_left(far_mm: Array) -> Finding:
    """By how many millimetres a lens that is not corrected moves (N,) points."""
    median, most = np.median(far_mm), np.quantile(far_mm, 0.9)
    return Finding(
        kind=Kind.LENS,
        alarm=True,
        text=f"the lens that is not corrected moves positions by {median:.2f} mm (median), {most:.2f} mm (90 %); their "
        "standard deviations are widened by as much: give `profile`, or have it estimated with `fit_lens`",
        numbers={"median_mm": float(median), "90%_mm": float(most)},
    )


def slow_errors(bias: RayBias, *, lens_stays: bool) -> list[Finding]:
    """Slowly varying ray errors that were removed; of a lens that nobody corrected some stays in the points."""
    if not bias.sd_px:
        return []
    rest = "; what the lens does to all cameras alike stays in the points" if lens_stays else ""
    text = (
        f"slowly varying errors of {bias.sd_px:.2f} px (lens, calibration) were estimated and removed before "
        f"tracking; {bias.jitter_px:.2f} px of jitter remain{rest}"
    )
    return [Finding(kind=Kind.SLOW_ERRORS, text=text, numbers={"slow_px": bias.sd_px, "jitter_px": bias.jitter_px})]


def late_cameras(cameras: Sequence[str], late_frames: Array | None) -> list[Finding]:
    """Cameras that were read between their frames."""
    return [
        Finding(
            kind=Kind.CAMERA_OFFSET,
            text=f"camera {name!r}: pixels were interpolated to correct its offset of {late:+.2f} frames, as asked",
            numbers={"late_frames": float(late)},
            cameras=(name,),
        )
        for name, late in zip(cameras, [] if late_frames is None else late_frames, strict=late_frames is not None)
        if late
    ]


def stored_points(text: str) -> Finding:
    """What became of stored points."""
    return Finding(kind=Kind.STORED_POINTS, text=text)


def compared_points(where: str, stale: Sequence[StalePoint], total: int) -> Finding:
    """Whether the points of a file, so many in all, follow from the pixels."""
    if not stale:
        return stored_points(f"{where}: all {total} stored points agree with the triangulation of the pixels")
    worst = max((s.off_m for s in stale if s.off_m is not None), default=0.0)
    why = (
        "out of date"
        if 2 * len(stale) < total
        else "of another calibration or lens than this one, of other pixels, or smoothed"
    )
    return stored_points(
        f"{where}: {len(stale)} of {total} stored points differ from the triangulation of the pixels (by up to "
        f"{worst * 1e3:.1f} mm): they are {why}, and were computed again"
    )


def position_noise(sd_m: Array, plane: Plane | None, *, stated: bool = False) -> Finding:
    """The (N,) standard deviations of positions that no camera explains, in space or in the plane of an image."""
    unit, of = ("mm", "positions without cameras: their") if plane is None else (plane.length, "their")
    median = 1e3 * float(np.median(sd_m))
    from_where = "as stated" if stated else "taken from the file or estimated"
    text = f"{of} noise is {from_where}, {median:.3g} {unit} (median)"
    return Finding(kind=Kind.POSITION_NOISE, text=text, numbers={f"median_{unit}": median})


def in_plane(plane: Plane, *, measures: bool) -> list[Finding]:
    """How one video without a calibration was read; ``measures``: bones, joints or measures were given, in vain."""
    if plane.mm_per_px is None:
        sentence = "one video without a calibration: positions are pixels of its image"
    else:
        sentence = (
            f"one video without a calibration: positions are in the plane of its image, {plane.mm_per_px:g} mm per "
            "pixel as stated; what moves nearer to the camera or away from it, or turns out of the plane, is wrong in "
            "proportion"
        )
    unused = "bones, joints and measures were not used: lengths and angles in an image change as they turn"
    found = [Finding(kind=Kind.PLANE, text=f"{sentence}; x and y are those of the file, and the lens is not corrected")]
    return [*found, *([Finding(kind=Kind.MEASURES_IN_A_PLANE, text=unused)] if measures else [])]


def unlikely_clicks(unlikely: NDArray[np.bool_], seen: NDArray[np.bool_], least: float) -> list[Finding]:
    """Clicks of one video with a likelihood below ``least``, of all that were seen."""
    if not unlikely.any():
        return []
    count = int(unlikely.sum())
    low = f"({count / seen.sum():.1%}) {{}} a likelihood below {least:g} and {{}} not used"
    text = number_of(count, f"click {low.format('has', 'was')}", f"clicks {low.format('have', 'were')}")
    return [Finding(kind=Kind.LIKELIHOODS, text=text, numbers={"clicks": count})]


def never_together(xyz_m: Array) -> list[Finding]:
    """Points (T, M, 3) of which no frame shows as many as a pose needs: they may be of several animals.

    Points that are never seen are not counted: they are named by themselves.
    """
    seen = np.isfinite(xyz_m[..., 0])
    seen = seen[:, seen.any(axis=0)]
    if seen.shape[1] < POSE_MARKERS or shows_a_pose(seen).any():
        return []
    most = int(seen.sum(axis=1).max())
    text = (
        f"no frame shows more than {most} of the {seen.shape[1]} points: if they are separate animals, track each by "
        "itself; lengths, poses and the path of the body mean nothing of all of them"
    )
    return [Finding(kind=Kind.NEVER_TOGETHER, alarm=True, text=text, numbers={"most": most})]


def rejected(reason: str, mask: NDArray[np.bool_], names: Sequence[str] = ()) -> list[Finding]:
    """Samples (T, M) that were rejected for a reason (``REASONS``, ``DOUBTFUL``), by the names of their markers."""
    if not mask.any():
        return []
    count, which = int(mask.sum()), np.flatnonzero(mask.any(axis=0)).tolist() if names else []
    by_marker = f": {', '.join(f'{names[m]} ({mask[:, m].sum()})' for m in which)}" if names else ""
    return [
        Finding(
            kind=Kind(f"rejected: {reason}"),
            text=f"{count} sample{'' if count == 1 else 's'} rejected ({(REASONS | DOUBTFUL)[reason]}){by_marker}",
            numbers={"samples": count},
            markers=tuple(names[m] for m in which),
        )
    ]


def hand_findings(apart: NDArray[np.int64], names: Sequence[str], *, first: int = 0) -> list[Finding]:
    """Frames and markers (n, 2) at which places that a person gives in several cameras contradict each other."""
    if not len(apart):
        return []
    where = [(first + int(t) + 1, names[int(m)]) for t, m in apart]
    places = ", ".join(f"{name} in frame {frame}" for frame, name in where[:MOST])
    return [
        Finding(
            kind=Kind.BY_HAND,
            alarm=True,
            text=f"points digitised by hand disagree between cameras ({places}{', ...' if len(where) > MOST else ''}): "
            "the marker was put between them; check these images",
            numbers={"samples": len(where)},
            markers=tuple(dict.fromkeys(name for _, name in where)),
            frames=tuple(frame for frame, _ in where[:MOST]),
        )
    ]


def exchange_findings(
    swaps: Sequence[Swap],
    doubtful: NDArray[np.bool_],
    names: Sequence[str],
    cameras: Sequence[str],
    *,
    clicks: int = 0,
    first: int = 0,
) -> list[Finding]:
    """One for every identity switch, one for all that are shorter than three frames, one on what is ambiguous.

    Args:
        swaps: Identity switches that were undone.
        doubtful: (T, M) samples of ambiguous identity.
        names: The M markers.
        cameras: The C cameras.
        clicks: Clicks of ambiguous identity that were left out.
        first: Frames of the recording before these.
    """
    out, short = [], 0
    for swap in swaps:
        if len(swap.frames) < 3:
            short += 1
            continue
        seen_by = () if swap.camera is None else (cameras[swap.camera],)
        where = f" in camera {seen_by[0]}" if seen_by else ""
        a, b, start, end = names[swap.a], names[swap.b], *(first + 1 + int(swap.frames[k]) for k in (0, -1))
        out.append(
            Finding(
                kind=Kind.IDENTITY_SWITCH,
                text=f"identity switch: {a} and {b} have each other's names{where} from frame {start} to {end}: "
                f"swapped back in {number_of(len(swap.frames), 'frame')}",
                cameras=seen_by,
                markers=(a, b),
                frames=(start, end),
            )
        )
    if short:
        text = f"{short} identity switches of one or two frames: the names were swapped back"
        out.append(Finding(kind=Kind.SHORT_SWITCHES, text=text, numbers={"switches": short}))
    if clicks:
        text = (
            f"{clicks} digitised points left out: in their frames cameras disagree on which of two markers is which, "
            "and neither the rays nor the paths decide it"
        )
        out.append(Finding(kind=Kind.AMBIGUOUS_CLICKS, text=text, numbers={"clicks": clicks}))
    return [*out, *rejected("doubtful_name", doubtful)]


def likelihood_findings(
    found: LikelihoodNoise | None, has_likelihoods: bool, left_out: int, lost: int
) -> list[Finding]:
    """What likelihoods were worth, where clicks have any.

    Args:
        found: What was learned of them.
        has_likelihoods: Whether clicks have likelihoods.
        left_out: Clicks that were not believed.
        lost: Samples that therefore have no point.
    """
    if not has_likelihoods:
        return []
    if found is None:
        text = "too few points are seen by two cameras of higher likelihood to learn what likelihoods mean"
        return [Finding(kind=Kind.LIKELIHOODS, text=f"likelihoods were not used: {text}")]
    weak = found.factor > 1.05
    sentence = "errors do not depend on the likelihood"
    if weak.any():
        sentence = f"from likelihood {found.at[weak][-1]:.2f} down errors grow, up to {found.factor[0]:.1f} times"
    if found.least > 0:
        sentence += (
            f"; left out: {number_of(left_out, 'point')} with a likelihood below {found.least:.2f} "
            f"({found.wrong[0]:.0%} of the least likely have errors above {FAR:g} standard deviations), which leaves "
            f"{number_of(lost, 'sample')} without a point"
        )
    text = f"points are weighted by likelihood, as learned from reprojection errors: {sentence}"
    return [Finding(kind=Kind.LIKELIHOODS, text=text, numbers={"clicks": left_out, "samples": lost})]


def never_seen(xyz_m: Array, names: Sequence[str], plane: Plane | None = None) -> list[Finding]:
    """The markers that no frame of (T, M, 3) points has, if there are any."""
    never = tuple(names[int(m)] for m in np.flatnonzero(~np.isfinite(xyz_m[..., 0]).any(axis=0)))
    text = f"never seen{' in 3D' if plane is None else ''}, and left empty: {', '.join(never)}"
    return [Finding(kind=Kind.NEVER_SEEN, alarm=True, text=text, markers=never)] if never else []


def camera_findings(health: CameraHealth, names: Sequence[str], *, first: int = 0) -> list[Finding]:
    """One for every camera that goes bad; frames are told from 1, and ``first`` of the recording are before."""
    n_frames = health.factor.shape[1]
    out = []
    for bad in health.bad:
        until = "the end" if bad.stop == n_frames else f"frame {first + bad.stop}"
        times = float(np.median(health.factor[bad.camera, bad.start : bad.stop]))
        sentence = (
            f"camera {names[bad.camera]} from frame {first + bad.start + 1} to {until}: residual {bad.level_px:.1f} px "
            f"instead of {bad.good_px:.1f} px: its standard deviation was multiplied by {times:.3g}"
        )
        if bad.moved:
            sentence += (
                f"; it looks as if it had been knocked: a constant shift of ({bad.offset_px[0]:+.1f}, "
                f"{bad.offset_px[1]:+.1f}) px was subtracted"
            )
        if len(names) == 3:
            sentence += " (with three cameras it may also be another one: two cameras alone hardly check each other)"
        frames = (first + bad.start + 1, first + bad.stop)
        out.append(
            Finding(kind=Kind.BAD_CAMERA, alarm=True, text=sentence, cameras=(names[bad.camera],), frames=frames)
        )
    return out
