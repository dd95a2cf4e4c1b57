"""Corrected identity switches, rejected samples and bad cameras as sentences for reports."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cleaning.camera_health import CameraHealth
from mocap.cleaning.clean import REASONS, Cleaning
from mocap.cleaning.likelihoods import FAR, LikelihoodNoise
from mocap.cleaning.swaps import DOUBTFUL, Swap


def exchange_findings(
    swaps: Sequence[Swap],
    doubtful: NDArray[np.bool_],
    names: Sequence[str],
    cameras: Sequence[str],
    *,
    clicks: int = 0,
    first: int = 0,
) -> list[str]:
    """A sentence for every identity switch, one for all that are shorter than three frames, one on what is ambiguous.

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
        where = "" if swap.camera is None else f" in camera {cameras[swap.camera]}"
        out.append(
            f"identity switch: {names[swap.a]} and {names[swap.b]} have each other's names{where} from frame "
            f"{first + swap.frames[0] + 1} to {first + swap.frames[-1] + 1}: swapped back in {len(swap.frames)} frames"
        )
    if short:
        out.append(f"{short} identity switches of one or two frames: the names were swapped back")
    if clicks:
        out.append(
            f"{clicks} clicks left out: in their frames cameras disagree on which of two markers is which, and neither "
            "the rays nor the paths of the clicks decide it"
        )
    if doubtful.any():
        out.append(f"{_samples(doubtful)} rejected ({DOUBTFUL['doubtful_name']})")
    return out


def _samples(mask: NDArray[np.bool_]) -> str:
    """How many samples a mask has."""
    count = int(mask.sum())
    return f"{count} sample{'' if count == 1 else 's'}"


def cleaning_findings(cleaning: Cleaning, names: Sequence[str]) -> list[str]:
    """A sentence for each reason that samples were rejected by."""
    out = []
    for reason, mask in cleaning.rejected.items():
        if mask.any():
            markers = [f"{names[int(m)]} ({mask[:, m].sum()})" for m in np.flatnonzero(mask.any(axis=0))]
            out.append(f"{_samples(mask)} rejected ({REASONS[reason]}): {', '.join(markers)}")
    return out


def likelihood_findings(found: LikelihoodNoise | None, stated: bool, left_out: int, lost: int) -> list[str]:
    """What likelihoods were worth, where clicks have any.

    Args:
        found: What was learned of them.
        stated: Whether clicks have likelihoods.
        left_out: Clicks that were not believed.
        lost: Samples that therefore have no point.
    """
    if not stated:
        return []
    if found is None:
        return [
            "likelihoods were not used: too few clicks are seen by two surer cameras to learn from what they are worth"
        ]
    weak = found.factor > 1.05
    sentence = "errors do not depend on the likelihood"
    if weak.any():
        sentence = f"from likelihood {found.at[weak][-1]:.2f} down errors grow, up to {found.factor[0]:.1f} times"
    if found.least > 0:
        sentence += (
            f"; {left_out} clicks with a likelihood below {found.least:.2f} were not believed ({found.wrong[0]:.0%} of "
            f"the least likely miss by more than {FAR:g} standard deviations), which leaves {lost} samples without a "
            "point"
        )
    return [f"likelihoods weigh the clicks, as far as rays show what they are worth: {sentence}"]


def never_seen(xyz_m: Array, names: Sequence[str]) -> list[str]:
    """A sentence on the markers that no frame of (T, M, 3) points has, if there are any."""
    never = [names[int(m)] for m in np.flatnonzero(~np.isfinite(xyz_m[..., 0]).any(axis=0))]
    return [f"never seen in 3D, and left empty: {', '.join(never)}"] if never else []


def camera_findings(health: CameraHealth, names: Sequence[str], *, first: int = 0) -> list[str]:
    """A sentence for every camera that goes bad; frames are told from 1, and ``first`` of the recording are before."""
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
        out.append(sentence)
    return out
