"""Identity switches of two markers in one camera: residuals there are large, and small once the names are swapped back.

Both assignments of a frame are scored by the likelihood of the robustly triangulated points; over frames
a run of exchanged names is found by dynamic programming, as for positions (``mocap.cleaning.swaps``). With two
cameras a run in one is a run in the other with the points exchanged as well: which it was is for the positions to tell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.cameras.triangulate import Triangulation, project, robust
from mocap.cleaning.click_noise import USUAL_DOF
from mocap.cleaning.swaps import CHANGE, MARGIN, Swap, clearest, exchange, student_log

Mask = NDArray[np.bool_]
Key = tuple[int, int, int]

OUTLIERS = 0.01
"""Share of clicks that land anywhere. Of 0.01 and 0.05 chosen on three flights (docs/experiments/arena.md)."""
SUSPECTED = 4.0
"""A ray that misses its point by so many deviations is suspected: of normal errors one in 3000 (exp(-8))."""


def exchanged_rays(matrices: Array, uv_px: Array, found: Triangulation, *, relative: Array | None = None) -> list[Swap]:
    """Runs of frames in which two markers had each other's names in one camera.

    The clearest runs are undone first, no two of them of one marker in one frame; then the rest is scored again.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        found: What ``robust`` made of them.
        relative: (C, T, M) deviations of rays relative to ``found.sd_px``; None: 1.
    """
    relative = np.ones(uv_px.shape[:3]) if relative is None else relative
    uv, chosen = uv_px, []
    for _ in range(6):
        runs = _clearest(_Rays(matrices, uv, found, relative))
        if not runs:
            break
        chosen += runs
        uv, relative = exchange_rays(uv, runs), exchange_rays(relative, runs)
        again = np.unique(np.concatenate([run.frames for run in runs]))
        part = robust(matrices, uv[:, again], sd_px=found.sd_px, relative=relative[:, again])
        xyz, rejected = found.xyz_m.copy(), found.rejected.copy()
        xyz[again], rejected[:, again] = part.xyz_m, part.rejected
        found = replace(found, xyz_m=xyz, rejected=rejected)
    return chosen


def _clearest(rays: "_Rays") -> list[Swap]:
    """Runs that win, the clearest first, no two of one marker in one frame."""
    gain: dict[Key, dict[int, float]] = {}
    camera, frame, a, b = rays.suspected_pairs()
    for c, t, i, j, value in zip(camera, frame, a, b, rays.gains(camera, frame, a, b), strict=True):
        gain.setdefault((int(c), int(i), int(j)), {})[int(t)] = float(value)
    clear = {key: frames for key, frames in gain.items() if sum(v for v in frames.values() if v > 0) > CHANGE + MARGIN}
    runs = [run for key, all_of in rays.completed(clear).items() for run in _runs(key, all_of, rays.seen[key[0]])]
    return clearest(runs, rays.seen.shape[1:])[0]


def exchange_rays(uv_px: NDArray[Any], swaps: Sequence[Swap]) -> NDArray[Any]:
    """A copy of (C, T, M, ...) values of rays with the swaps undone, in their camera or in all."""
    out = uv_px.copy()
    for swap in swaps:
        for camera in range(len(uv_px)) if swap.camera is None else [swap.camera]:
            out[camera] = exchange(out[camera], [swap])
    return out


def agreement(matrices: Array, uv: Array, spread: Array, *, sd_px: float, detail: float) -> tuple[Array, Array]:
    """(K,) log likelihood of rays of two markers, but for terms that their names do not change; (K, 2, 3) their points.

    A click is of its marker, with a density of 1 / (sqrt(2 pi) sd) in each of the 2 n - 3 directions that n rays leave
    over, or anywhere in the animal's extent.

    Args:
        matrices: (C, 3, 4) projections.
        uv: (C, K, 2, 2) ideal pixels; NaN where not seen.
        spread: (C, K, 2) deviations of rays relative to ``sd_px``.
        sd_px: Standard deviation of a pixel coordinate.
        detail: Logarithm of the animal's extent over sqrt(2 pi) sd.
    """
    found = robust(matrices, uv, sd_px=sd_px, relative=spread)
    kept = np.isfinite(uv[..., 0]) & ~found.rejected & np.isfinite(found.xyz_m[..., 0])
    n, lost = kept.sum(axis=0), found.rejected.sum(axis=0)
    wrong = np.where(n >= 2, lost, np.minimum(lost, 1))  # of two rays that disagree one is right
    miss = np.linalg.norm(uv - project(matrices, found.xyz_m), axis=-1) / (
        spread * sd_px * np.sqrt((USUAL_DOF - 2) / USUAL_DOF)
    )
    fit = np.where(kept, student_log(np.nan_to_num(miss) ** 2, 2), 0.0).sum(axis=0)
    return (fit + detail * np.maximum(2 * n - 3, 0) + np.log(OUTLIERS) * wrong).sum(axis=1), found.xyz_m


class _Rays:
    """The observations of a recording, and the evidence for swapping two of them."""

    def __init__(self, matrices: Array, uv_px: Array, found: Triangulation, relative: Array) -> None:
        self.matrices, self.uv, self.found, self.relative = matrices, uv_px, found, relative
        self.sd = max(found.sd_px, 1e-9)
        self.seen: Mask = np.isfinite(uv_px[..., 0])
        self.at = project(matrices, found.xyz_m)
        self.miss = np.linalg.norm(uv_px - self.at, axis=-1) / relative
        few = found.rejected.any(axis=0) & (self.seen.sum(axis=0) <= 3)
        far = np.nan_to_num(self.miss) > SUSPECTED * self.sd
        self.suspect: Mask = self.seen & (found.rejected | far | few)
        self.detail = max(float(np.log(extent_px(uv_px) / (np.sqrt(2 * np.pi) * self.sd))), 0.0)

    def suspected_pairs(self) -> tuple[NDArray[np.int64], ...]:
        """Camera, frame and two markers (a < b), both suspected, or one and the other not seen there.

        Where the points of both are known without these rays, each ray must be nearer to the other's point.
        """
        out = []
        for camera in range(len(self.uv)):
            many = np.count_nonzero(self.suspect[camera], axis=1)
            for frame in np.flatnonzero(many):
                who = np.flatnonzero(self.suspect[camera, frame])
                uv, at = self.uv[camera, frame], self.at[camera, frame]
                finite = np.isfinite(at[:, 0])
                to_other = np.linalg.norm(uv[who, None] - at, axis=-1)  # (ray, point)
                own = self.miss[camera, frame, who] * self.relative[camera, frame, who]
                fits = ~(to_other > 0.5 * own[:, None])  # NaN: not known, may fit
                for i, marker in enumerate(who):
                    both = [int(m) for k, m in enumerate(who) if m > marker and fits[i, m] and fits[k, marker]]
                    alone = np.flatnonzero(
                        ~self.seen[camera, frame] & finite & (to_other[i] < 2 * SUSPECTED * self.sd) & fits[i]
                    )
                    for other in [*both, *alone.tolist()]:
                        out.append((camera, frame, min(marker, other), max(marker, other)))
        columns = np.array(out, dtype=np.int64).reshape(-1, 4).T
        return tuple(columns)

    def gains(
        self, camera: NDArray[np.int64], frame: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]
    ) -> Array:
        """(K,) log likelihood of exchanging a and b in a camera and frame, less that of leaving them.

        Nothing speaks for giving a ray to a marker that is not seen there and whose point is not known.
        """
        if not len(camera):
            return np.zeros(0)
        uv = np.stack([self.uv[:, frame, a], self.uv[:, frame, b]], axis=2)  # (C, K, 2, 2)
        spread = np.stack([self.relative[:, frame, a], self.relative[:, frame, b]], axis=2)  # (C, K, 2)
        other, other_spread, k = uv.copy(), spread.copy(), np.arange(len(camera))
        other[camera, k], other_spread[camera, k] = uv[camera, k, ::-1], spread[camera, k, ::-1]
        gain = self._score(other, other_spread) - self._score(uv, spread)
        known, seen = np.isfinite(self.found.xyz_m[..., 0]), self.seen
        moves_a = seen[camera, frame, a] & ~seen[camera, frame, b] & ~known[frame, b]
        moves_b = seen[camera, frame, b] & ~seen[camera, frame, a] & ~known[frame, a]
        return np.where(moves_a | moves_b, np.minimum(gain, 0.0), gain)

    def _score(self, uv: Array, spread: Array) -> Array:
        return agreement(self.matrices, uv, spread, sd_px=self.sd, detail=self.detail)[0]

    @property
    def _scale(self) -> float:
        return self.sd * float(np.sqrt((USUAL_DOF - 2) / USUAL_DOF))

    def completed(self, gains: Mapping[Key, dict[int, float]]) -> dict[Key, Array]:
        """(T,) gains of each pair in its camera; in frames that were not suspected what the exchange would spoil."""
        out, todo = {}, {}
        for key, gain in gains.items():
            out[key], near = self._spoiled(key)
            near[list(gain)] = False
            todo[key] = np.flatnonzero(near)
        rows = [np.full((len(frames), 4), (c, 0, a, b)) for (c, a, b), frames in todo.items()]
        camera, frame, a, b = np.concatenate([*rows, np.zeros((0, 4), dtype=np.int64)]).T
        frame[:] = np.concatenate([*todo.values(), np.zeros(0, dtype=np.int64)])
        found = self.gains(camera, frame, a, b)
        for key, values in zip(todo, np.split(found, np.cumsum([len(f) for f in todo.values()])), strict=False):
            out[key][todo[key]] = values
            out[key][list(gains[key])] = list(gains[key].values())
        return out

    def _spoiled(self, key: Key) -> tuple[Array, Mask]:
        """(T,) what an exchange would spoil by how far apart the rays are, and where that is to be looked at closer."""
        camera, a, b = key
        uv, at = self.uv[camera], self.at[camera]
        seen_a, seen_b = self.seen[camera, :, a], self.seen[camera, :, b]
        apart = np.where(seen_a & seen_b, np.linalg.norm(uv[:, a] - uv[:, b], axis=-1), np.nan)
        apart = np.where(seen_a & ~seen_b, np.linalg.norm(uv[:, a] - at[:, b], axis=-1), apart)
        apart = np.where(seen_b & ~seen_a, np.linalg.norm(uv[:, b] - at[:, a], axis=-1), apart)
        most = 2 * self.detail - np.log(OUTLIERS)
        spoiled = np.minimum(-student_log((np.nan_to_num(apart) / self._scale) ** 2, 2), most)
        either = self.suspect[camera, :, a] | self.suspect[camera, :, b]
        # so near to each other rays are exchanged and tried, suspected or not
        near = np.nan_to_num(apart, nan=np.inf) < 40.0 * self.sd
        return -spoiled * (seen_a.astype(int) + seen_b), either | near


def extent_px(uv_px: Array) -> float:
    """Width in pixels of the region in which clicks lie: twice the median spread of the markers of a frame."""
    seen = np.isfinite(uv_px[..., 0])
    n = np.maximum(seen.sum(axis=2), 1)[..., None]
    mean = np.nansum(uv_px, axis=2) / n
    spread = np.nansum((uv_px - mean[:, :, None]) ** 2, axis=(2, 3)) / n[..., 0] / 2
    many = seen.sum(axis=2) >= 3
    return 2 * float(np.sqrt(np.median(spread[many]))) if many.any() else 100.0


def _runs(key: Key, gain: Array, seen: Mask) -> list[Swap]:
    """The most likely runs of exchanged frames, at a cost of ``CHANGE`` each, that win by ``MARGIN``."""
    camera, a, b = key
    inside, outside = -np.inf, 0.0
    entered = np.zeros(len(gain), dtype=bool)
    left = np.zeros(len(gain), dtype=bool)
    for t, value in enumerate(gain):
        entered[t] = outside - CHANGE >= inside  # as late as may be
        left[t] = inside > outside
        inside, outside = max(inside, outside - CHANGE) + value, max(outside, inside)
    state = np.zeros(len(gain), dtype=bool)
    on = inside > outside
    for t in range(len(gain) - 1, -1, -1):
        state[t] = on
        on = not entered[t] if on else bool(left[t])
    found = []
    for start, stop in true_runs(state):
        total = float(gain[start:stop].sum()) - CHANGE
        frames = np.arange(start, stop)
        frames = frames[seen[frames][:, [a, b]].any(axis=1)]
        if total > MARGIN and len(frames):
            found.append(Swap(a=a, b=b, frames=frames, camera=camera, gain=total))
    return found
