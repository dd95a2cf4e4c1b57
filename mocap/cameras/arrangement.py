"""Pixels that were mirrored, shifted or given to the wrong cameras: found by how near the rays meet once it is undone.

Programs count columns from the right or rows from below, write cameras in another order than they were calibrated in,
and stack the videos of several cameras above or beside one another. Each of these leaves rays that miss by tens or
hundreds of pixels; each is tried, for every camera alone and for sets of cameras, and the one that fits is named.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import Camera, picture_size, stacked, undistorted
from mocap.cameras.triangulate import linear, residual_px
from mocap.errors import CalibrationError
from mocap.findings import Kind

LOOKED_AT_PX = 3.0
"""Rays that meet as near as that are not suspected: careless clicks miss by as much. Chosen."""
BETTER = 3.0
"""A residual falls at least by that factor where the right change is undone, and not by that for any other change.
Chosen: with it all planted changes are named and no clean recording (docs/experiments/audit_measured.md)."""
FEWEST_SHARED = 8
"""Points that two cameras share at least if one is judged by or calibrated to the other: five determine an essential
matrix (Nister 2004), three more tell whether they agree on it. Chosen."""
STEP, MOST = 1.25, 10.0
"""Heights that were guessed are refined by up to 15 %, so that steps of 25 % leave none out; guesses that differ by
more than the other factor are none."""
MIRRORS = ("u", "v", "uv")
SHIFTS = ("+H", "-H", "+W", "-W")


@dataclass(frozen=True, kw_only=True)
class Arrangement:
    """What was done to the pixels, and how well they fit without it.

    Attributes:
        kind: Mirrored pixels, shifted pixels or swapped cameras.
        cameras: Cameras concerned.
        change: What undoes it, in words.
        residual_px: Median triangulation residual as the files are.
        undone_px: The same where it is undone.
        others: Other changes that undo it as well, in words: in a symmetric rig rays cannot tell.
        belongs: Of swapped cameras: of each view by its camera's name, the camera whose calibration it belongs to.
    """

    kind: Kind
    cameras: tuple[str, ...]
    change: str
    residual_px: float
    undone_px: float
    others: tuple[str, ...] = ()
    belongs: Mapping[str, str] = field(default_factory=dict)

    def describe(self) -> str:
        """One sentence for people."""
        alike = "; it fits as well that " + ", or that ".join(self.others) if self.others else ""
        return (
            f"{self.change}: the median triangulation residual is {self.residual_px:.1f} px as the files are, "
            f"{self.undone_px:.2f} px with that{alike}: correct the files"
        )


class ArrangementError(CalibrationError):
    """Pixels that fit only mirrored, shifted or in another order of cameras.

    Attributes:
        arrangement: The change that makes them fit.
    """

    page = "audit"

    def __init__(self, arrangement: Arrangement) -> None:
        """With what fits."""
        super().__init__(arrangement.describe())
        self.arrangement = arrangement


@dataclass(frozen=True)
class _Arranging:
    """One change to try: what happens to each view's pixels, and whose calibration each view has."""

    kinds: tuple[str, ...]
    order: tuple[int, ...]

    def plain(self) -> bool:
        return set(self.kinds) <= {""} and list(self.order) == sorted(self.order)


def find_arrangement(cameras: Sequence[Camera], uv_px: Array, *, height_px: float | None = None) -> Arrangement | None:
    """The change of pixels that makes rays meet, where they do not meet as they are.

    For up to six cameras every combination of mirrored axes (u, v, both), every set of cameras shifted by the height or
    the width of an image, and every order of the cameras is tried; groups of cameras that share no points (left and
    right pairs) are judged apart. Where image sizes are not known they are taken
    from the principal point, and then found by the residual; where principal points of coefficients disagree on the
    height, one height for all is looked for between them.

    Args:
        cameras: The C cameras, lenses from the upper left.
        uv_px: (C, T, M, 2) or (C, K, 2) pixels as in the file.
        height_px: Image height, if stated.

    Returns:
        The change, or None: rays meet as they are, or no change makes them meet.
    """
    found = _arranged(cameras, uv_px, height_px)
    between = guessed_heights(cameras) if found is None and height_px is None else None
    if between is None:
        return found
    low, high = between
    tries = np.geomspace(low, high, 1 + int(np.ceil(np.log(high / low) / np.log(STEP))))
    some = [one for height in tries if (one := _arranged(cameras, uv_px, float(height))) is not None]
    if not some:
        return None
    best = min(some, key=lambda one: one.undone_px)
    why = f"(that height was found: principal points put it at {low:.0f} to {high:.0f}; state `image_height_px`)"
    return replace(best, change=f"{best.change} {why}")


def guessed_heights(cameras: Sequence[Camera]) -> tuple[float, float] | None:
    """Least and greatest image height that principal points suggest; None: a file states it, or they nearly agree."""
    if any(camera.size_px is not None for camera in cameras):
        return None
    low, high = (float(most(_sizes(cameras, None)[:, 1])) for most in (np.min, np.max))
    return (low, high) if 0 < STEP * low < high < MOST * low else None


def _arranged(cameras: Sequence[Camera], uv_px: Array, height_px: float | None) -> Arrangement | None:
    """The same with one image height, or with those of the principal points."""
    flat = uv_px.reshape(len(uv_px), -1, 2)
    parts = [
        _Part.of([cameras[c] for c in group], flat[group], height_px) for group in groups(np.isfinite(flat[..., 0]))
    ]
    parts = [part for part in parts if part.uv.shape[1] >= FEWEST_SHARED]
    if not parts:
        return None
    down = min(("", "v"), key=lambda kind: max(part.all_alike(kind) for part in parts))  # rows count alike in all
    found = [one for part in parts if (one := part.arrangement(down, alone=len(parts) == 1)) is not None]
    if not found:
        return None
    worst = max(found, key=lambda one: one.residual_px)
    swapped = {view: camera for one in found for view, camera in one.belongs.items()}
    return replace(
        worst,
        cameras=tuple(name for one in found for name in one.cameras),
        change=", and ".join(one.change for one in found),
        belongs={c.name: swapped.get(c.name, c.name) for c in cameras} if swapped else {},
        undone_px=max(one.undone_px for one in found),
    )


def groups(seen: NDArray[np.bool_]) -> list[list[int]]:
    """Cameras that share points, directly or through others, and are judged together: left and right pairs are apart.

    Args:
        seen: (C, K) which camera sees which point.
    """
    from scipy.sparse.csgraph import connected_components

    often = seen[:, seen.sum(axis=0) >= 2].astype(int)
    _, label = connected_components(often @ often.T >= FEWEST_SHARED, directed=False)
    return [[int(c) for c in np.flatnonzero(label == k)] for k in np.unique(label) if (label == k).sum() > 1]


def by_camera(residual: Array, seen: NDArray[np.bool_]) -> Array:
    """(C, ...) median residual of the points that each camera sees; NaN where it sees none.

    Args:
        residual: (..., K) pixels; NaN without a point.
        seen: (C, ..., K) which camera sees which point.
    """
    if not residual.shape[-1]:
        return np.full(seen.shape[:-1], np.nan)
    own = np.sort(np.where(seen & np.isfinite(residual), residual, np.nan), axis=-1)  # NaN last
    n = np.isfinite(own).sum(axis=-1, keepdims=True)
    middle = [np.take_along_axis(own, at, axis=-1)[..., 0] for at in (np.maximum(n - 1, 0) // 2, n // 2 * (n > 0))]
    return (middle[0] + middle[1]) / 2


@dataclass(frozen=True, eq=False)
class _Part:
    """Cameras that share points, and the points that they are judged by.

    A camera is judged by its points of three rays or more, which leave less room for chance; by those of two if it has
    few of three. What counts is the camera whose points fit worst: good ones do not outvote it.

    Attributes:
        cameras: The C cameras.
        uv: (C, K, 2) pixels.
        sizes: (C, 2) image widths and heights.
    """

    cameras: tuple[Camera, ...]
    uv: Array
    sizes: Array

    @classmethod
    def of(cls, cameras: Sequence[Camera], uv: Array, height_px: float | None) -> "_Part":
        """Of (C, K, 2) pixels, at most 250 of their points, spread over the recording."""
        seen = np.isfinite(uv[..., 0])
        count = seen.sum(axis=0)
        many = count >= min(3, len(cameras))
        lonely = (seen & many).sum(axis=1) < FEWEST_SHARED
        uv = uv[:, many | ((count >= 2) & seen[lonely].any(axis=0))]
        some = np.linspace(0, uv.shape[1] - 1, min(uv.shape[1], 250)).astype(int)
        return cls(tuple(cameras), uv[:, some], _sizes(cameras, height_px))

    @cached_property
    def _matrices(self) -> Array:
        return stacked(self.cameras)

    @cached_property
    def _views(self) -> dict[tuple, Array]:
        return {}

    def _view(self, index: int, kind: str, to: int, wide: float, high: float, step: int) -> Array:
        key = (index, kind, to, wide, high, step)
        if key not in self._views:
            pixels = _changed(self.uv[index, ::step], kind, self.sizes[to] * (wide, high))
            self._views[key] = undistorted([self.cameras[to]], pixels[None])[0]
        return self._views[key]

    def medians(self, changes: Sequence[_Arranging], stretch: Array, step: int = 1) -> Array:
        """(n,) median residual of the worst camera with each of n changes, every ``step``-th point."""
        n_cameras, points = self.uv[:, ::step].shape[:2]
        ideal = np.empty((n_cameras, len(changes), points, 2))
        for at, change in enumerate(changes):
            for i, (kind, to) in enumerate(zip(change.kinds, change.order, strict=True)):
                wide, high = stretch if kind else np.ones(2)
                ideal[to, at] = self._view(i, kind, to, float(wide), float(high), step)
        with np.errstate(all="ignore"):
            miss = residual_px(self._matrices, ideal, linear(self._matrices, ideal))
        worst = np.fmax.reduce(by_camera(miss, np.isfinite(ideal[..., 0])), axis=0)
        return np.where(np.isfinite(miss).mean(axis=-1) > 0.5, worst, np.inf)

    def median(self, change: _Arranging, stretch: Array, step: int = 1) -> float:
        """The same with one change."""
        return float(self.medians([change], stretch, step)[0])

    def all_alike(self, kind: str) -> float:
        """The same with one change of the pixels in all cameras."""
        n = len(self.cameras)
        return self.median(_Arranging((kind,) * n, tuple(range(n))), np.ones(2))

    def arrangement(self, down: str, *, alone: bool) -> Arrangement | None:
        """The change that makes these rays meet, where they do not meet as they are.

        Args:
            down: ``v`` where rows are counted from below in all cameras.
            alone: Whether these are all cameras, so that rows from below in all of them are no fault.
        """
        n, few = len(self.cameras), max(1, self.uv.shape[1] // 50)  # all changes on 50 points, the best of them on all
        as_is = self.all_alike(down)
        if as_is < LOOKED_AT_PX:
            return None
        changes = list(_changes(n))
        tried = [changes[i] for i in np.argsort(self.medians(changes, np.ones(2), few), kind="stable")[:6]]
        sized = all(c.size_px is not None for c in self.cameras)
        refined = [(*_refined(self.median, change, sized, few), change) for change in tried]
        fit = min(residual for residual, _, _ in refined)
        alike = sorted((t for t in refined if t[0] < 1.5 * fit), key=lambda t: (_count(t[2]), t[0]))
        best, stretch, change = alike[0]
        extent = float(np.nanmax(self.uv) - np.nanmin(self.uv))
        # rays meet below 4 px, or half a percent of the pixels' extent
        if best > max(4.0, 0.005 * extent) or not best * BETTER < as_is or change.plain():
            return None

        def named(change: _Arranging, stretch: Array) -> Arrangement:
            return _named(self.cameras, change, self.sizes * stretch, as_is, best, fewer=alone)

        found = named(change, stretch)
        others = [named(c, s).change for _, s, c in alike[1:] if not (alone and _alike(c, change))]
        return replace(found, others=tuple(o for o in dict.fromkeys(others) if o != found.change))


def _count(change: _Arranging) -> int:
    """How many cameras a change concerns: of two that fit alike, the smaller is meant."""
    return sum(kind != "" for kind in change.kinds) + sum(i != to for i, to in enumerate(change.order))


def _alike(a: _Arranging, b: _Arranging) -> bool:
    """Whether two changes differ only in rows counted from below in all cameras, which gives the same points."""
    return a.order == b.order and {_toggled(x) == y for x, y in zip(a.kinds, b.kinds, strict=True)} == {True}


def _toggled(kind: str) -> str:
    return {"": "v", "v": "", "u": "uv", "uv": "u"}.get(kind, kind)


def _sizes(cameras: Sequence[Camera], height_px: float | None) -> Array:
    """(C, 2) image widths and heights: stated, or twice the principal point."""
    sizes = np.array([picture_size(camera) for camera in cameras])
    if height_px is not None:
        sizes[:, 1] = height_px
    return sizes


def _changes(n: int) -> Iterator[_Arranging]:
    """All changes to try for n cameras, without repeats."""
    own, found = tuple(range(n)), set()
    if n <= 6:  # of more cameras only sets of one, of two (up to 10 cameras) and of all, and pairs exchanged
        sets = [s for k in range(1, n + 1) for s in combinations(range(n), k)]
        mirrored = product(("", *MIRRORS), repeat=n) if n <= 4 else _sets(n, sets, MIRRORS)
        orders = permutations(range(n)) if n <= 5 else _exchanged(n)
    else:
        sets = [s for k in ((1, 2, n) if n <= 10 else (1, n)) for s in combinations(range(n), k)]
        mirrored, orders = _sets(n, sets, MIRRORS), _exchanged(n)
    for kinds in (*mirrored, *_sets(n, sets, SHIFTS)):
        found.add((kinds, own))
    for order in orders:
        found |= {(("",) * n, order), (("v",) * n, order)}
    for kinds, order in sorted(found):
        yield _Arranging(kinds, order)


def _sets(n: int, sets: Sequence[tuple[int, ...]], kinds: Sequence[str]) -> Iterator[tuple[str, ...]]:
    for chosen in sets:
        for kind in kinds:
            yield tuple(kind if c in chosen else "" for c in range(n))


def _exchanged(n: int) -> Iterator[tuple[int, ...]]:
    """Orders with one pair of cameras exchanged, and those moved round by some places."""
    for a, b in combinations(range(n), 2):
        order = list(range(n))
        order[a], order[b] = b, a
        yield tuple(order)
    for k in range(1, n):
        yield tuple((i + k) % n for i in range(n))


def _changed(uv: Array, kind: str, size: Array) -> Array:
    """(K, 2) pixels changed in one way."""
    out = uv.copy()
    if "u" in kind:
        out[:, 0] = size[0] - uv[:, 0]
    if "v" in kind:
        out[:, 1] = size[1] - uv[:, 1]
    if kind in SHIFTS:
        out[:, int(kind[1] == "H")] += float(f"{kind[0]}1") * size[int(kind[1] == "H")]
    return out


def _refined(median: Callable[..., float], change: _Arranging, sized: bool, step: int) -> tuple[float, Array]:
    """The residual of a change at the best image size near the one assumed, and that size's factors (2,)."""
    from scipy.optimize import minimize_scalar

    stretch = np.ones(2)
    if sized:
        return median(change, stretch), stretch
    used = "".join(change.kinds)
    for axis, names in enumerate((("u", "W"), ("v", "H"))):
        if not any(name in used for name in names):
            continue

        def at(factor: float, axis: int = axis) -> float:
            trial = stretch.copy()
            trial[axis] = factor
            return median(change, trial, step)

        grid = np.linspace(0.85, 1.15, 7)
        start = grid[int(np.argmin([at(f) for f in grid]))]
        stretch[axis] = minimize_scalar(
            at, bounds=(start - 0.05, start + 0.05), method="bounded", options={"xatol": 2e-4}
        ).x
    return median(change, stretch), stretch


def _named(
    cameras: Sequence[Camera], change: _Arranging, sizes: Array, as_is: float, undone: float, *, fewer: bool
) -> Arrangement:
    names = [c.name for c in cameras]
    moved = [i for i, to in enumerate(change.order) if i != to]
    if moved:
        belongs = {names[i]: names[change.order[i]] for i in moved}
        pairs = ", ".join(f"pixels of {view!r} with the calibration of {own!r}" for view, own in belongs.items())
        return Arrangement(
            kind=Kind.SWAPPED_CAMERAS,
            cameras=tuple(names[i] for i in moved),
            change=f"the cameras are in another order than their calibration; these belong together: {pairs}",
            residual_px=as_is,
            undone_px=undone,
            belongs=belongs,
        )
    if (
        fewer and change.kinds.count("v") + change.kinds.count("uv") > len(names) / 2
    ):  # the fewer, of two that are the same
        change = _Arranging(tuple(_toggled(kind) for kind in change.kinds), change.order)
    words = []
    for kind in dict.fromkeys(k for k in change.kinds if k):
        which = [i for i, k in enumerate(change.kinds) if k == kind]
        width, height = sizes[which].mean(axis=0)
        formula = {
            "u": f"u mirrored (u -> {width:.0f} - u)",
            "v": f"v flipped (v -> {height:.0f} - v)",
            "uv": f"rotated by 180 degrees (u -> {width:.0f} - u, v -> {height:.0f} - v)",
            "+H": f"v shifted by the image's height (v -> v + {height:.0f})",
            "-H": f"v shifted by the image's height (v -> v - {height:.0f})",
            "+W": f"u shifted by the image's width (u -> u + {width:.0f})",
            "-W": f"u shifted by the image's width (u -> u - {width:.0f})",
        }[kind]
        words.append(f"{formula} in {', '.join(repr(names[i]) for i in which)}")
    return Arrangement(
        kind=Kind.SHIFTED_PIXELS if set(change.kinds) & set(SHIFTS) else Kind.MIRRORED_PIXELS,
        cameras=tuple(name for name, kind in zip(names, change.kinds, strict=True) if kind),
        change="the pixels belong to their calibration with " + " and ".join(words),
        residual_px=as_is,
        undone_px=undone,
    )
