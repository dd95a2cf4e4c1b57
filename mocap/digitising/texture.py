"""Points of skin, fur or scales with nothing painted: followed by their texture, in one video.

From the frame before by Lucas-Kanade (pyramids; a point that does not return to where it came from is dropped), then
onto a template. The template is what was clicked, and follows the appearance: where it fits no more, what is there now
takes its place, with the error that this place has. So drift adds up in the standard deviation that is stated.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.digitising.dots import Grey

HALF_PX = 7
"""Half the width of a template, less half a pixel. Chosen, not measured."""
_ROOM_PX = 13  # about it; chosen, not measured
_ALIKE, _APART = 0.7, 0.1  # least correlation with a template, and by how much the next place has less; chosen
TEXTURE_CLICK_PX = 0.5
"""Standard deviation of a coordinate of a click, on texture. Chosen, not measured."""
MOST_REACH_PX = 60.0
"""A point moves by no more from frame to frame, where nothing else tells. Chosen, not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Template:
    """What a point looks like.

    Attributes:
        patch: Grey levels about it, ``HALF_PX + _ROOM_PX`` pixels on each side.
        sd_px: Standard deviation of its place in the patch's middle.
    """

    patch: NDArray[np.uint8]
    sd_px: float


@dataclass(frozen=True, eq=False, kw_only=True)
class FollowedTexture:
    """A point in an image.

    Attributes:
        uv: (2,) place, counted from 0.
        sd_px: Standard deviation of a coordinate.
        template: What it is compared with.
        before: What it looks like here; None: it was not found here.
    """

    uv: Array
    sd_px: float
    template: Template
    before: NDArray[np.uint8] | None


def begun(picture: Grey, uv: Array) -> FollowedTexture:
    """A point where it was clicked."""
    patch = _patch(picture, uv)
    return FollowedTexture(
        uv=uv, sd_px=TEXTURE_CLICK_PX, template=Template(patch=patch, sd_px=TEXTURE_CLICK_PX), before=patch
    )


def followed(last: FollowedTexture, picture: Grey, guess: Array, reach_px: float) -> FollowedTexture:
    """The point in the next image; where it is not found ``before`` is None, and ``uv`` the guess.

    Args:
        last: The point in the image before.
        picture: The next one.
        guess: (2,) place that is expected.
        reach_px: So far from it the point may be.
    """
    if last.before is not None:
        middle = guess if reach_px < _ROOM_PX else last.uv
        flow = _aligned(last.before, last.template, picture, middle)
        if flow is not None:
            fits = _aligned(last.template.patch, last.template, picture, flow)
            if fits is not None and np.linalg.norm(fits - flow) < 2.0 + 3 * last.sd_px:
                return _found(last.template, picture, fits)
            sd_px = float(np.hypot(last.sd_px, 0.6))  # that each change of template adds
            patch = _patch(picture, flow)
            return FollowedTexture(uv=flow, sd_px=sd_px, template=Template(patch=patch, sd_px=sd_px), before=patch)
    place = _searched(last.template, picture, guess, min(max(reach_px, 3.0), MOST_REACH_PX))
    if place is not None:
        fits = _aligned(last.template.patch, last.template, picture, place)
        if fits is not None:
            return _found(last.template, picture, fits)
    return FollowedTexture(uv=guess, sd_px=last.sd_px, template=last.template, before=None)


def _found(template: Template, picture: Grey, uv: Array) -> FollowedTexture:
    sd_px = float(np.hypot(template.sd_px, 0.2))  # of a match
    return FollowedTexture(uv=uv, sd_px=sd_px, template=template, before=_patch(picture, uv))


def _patch(picture: Grey, uv: Array, half: int = HALF_PX + _ROOM_PX) -> NDArray[np.uint8]:
    grey = picture if picture.dtype == np.uint8 else np.asarray(picture // 256, dtype=np.uint8)
    u, v = np.rint(uv).astype(int)
    height, width = grey.shape
    if half < u < width - half - 1 and half < v < height - half - 1:
        grey = grey[v - half - 1 : v + half + 2, u - half - 1 : u + half + 2]
        uv = uv - [u - half - 1, v - half - 1]
    at = (float(uv[0]), float(uv[1]))
    return np.asarray(cv2.getRectSubPix(grey, (2 * half + 1, 2 * half + 1), at), dtype=np.uint8)


def _aligned(patch: NDArray[np.uint8], template: Template, picture: Grey, guess: Array) -> Array | None:
    """(2,) place in an image near a guess that looks like the middle of a patch; None: nothing does, or it is covered.

    What is brighter or darker than the middle of the template, as a dot that passes by, would pull the flow.
    """
    if not np.isfinite(guess).all():
        return None
    here = _patch(picture, guess)
    near = template.patch[_ROOM_PX + 3 : -_ROOM_PX - 3, _ROOM_PX + 3 : -_ROOM_PX - 3]
    low, high = int(near.min()), int(near.max())
    patch, here = np.clip(patch, low, high), np.clip(here, low, high)
    middle = np.full((1, 1, 2), HALF_PX + _ROOM_PX, dtype=np.float32)
    size = (2 * HALF_PX + 1, 2 * HALF_PX + 1)
    there, ok, _ = cv2.calcOpticalFlowPyrLK(patch, here, middle, np.empty(0), winSize=size, maxLevel=2)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(here, patch, there, np.empty(0), winSize=size, maxLevel=2)
    if not (ok[0, 0] and ok_back[0, 0] and np.linalg.norm(back - middle) < 0.5):
        return None
    uv = guess + (there - middle)[0, 0].astype(np.float64)
    now, first = np.clip(_patch(picture, uv, HALF_PX), low, high), _middle(template.patch)
    covered = np.mean((now == low) | (now == high)) - np.mean((first <= low) | (first >= high))
    alike = cv2.matchTemplate(now, _middle(patch), cv2.TM_CCOEFF_NORMED)
    return uv if float(alike[0, 0]) > _ALIKE and covered < 0.05 else None


def _middle(patch: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(patch[_ROOM_PX:-_ROOM_PX, _ROOM_PX:-_ROOM_PX])


def _searched(template: Template, picture: Grey, guess: Array, reach_px: float) -> Array | None:
    """(2,) the place about a guess that looks like a template, to a pixel; None: none does, or several do."""
    if not np.isfinite(guess).all():
        return None
    reach = int(np.ceil(reach_px))
    middle = np.rint(guess)
    score = cv2.matchTemplate(_patch(picture, middle, HALF_PX + reach), _middle(template.patch), cv2.TM_CCOEFF_NORMED)
    _, best, _, (u, v) = cv2.minMaxLoc(score)
    score[max(v - 4, 0) : v + 5, max(u - 4, 0) : u + 5] = -1
    if best < _ALIKE or float(score.max()) > best - _APART:
        return None
    return middle + np.array([u - reach, v - reach])
