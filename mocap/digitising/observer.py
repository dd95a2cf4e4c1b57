"""One frame: dots named about a prediction, by windows, by rays that meet, by bones and by the pose."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.digitising.meeting import Lengths, meetings, name_points, reaches, violated
from mocap.digitising.motion import State, positioned
from mocap.digitising.naming import NAME_GATE, Named, away2, name_dots, seen_from, window_cov
from mocap.digitising.pose import PoseGaussian

APART_RADII = 2.2
"""Two dots closer than so many radii are one: discs touch at two. Chosen, not measured."""


@dataclass(eq=False)
class Observer:
    """How the dots of a frame are named.

    Attributes:
        matrices: (C, 3, 4) projections.
        lengths: Lengths of the rigid bones, as far as they are known.
        measured: (B,) frames that each was measured in.
        textured: (M,) True for markers without a dot.
        length_m: Length of the animal.
        sd_px: Standard deviation of a dot's coordinate.
        radius_px: Radius of a dot.
        poses: How the animal moves; None: not known.
    """

    matrices: Array
    lengths: Lengths
    measured: NDArray[np.int64]
    textured: NDArray[np.bool_]
    length_m: float = 1.0
    sd_px: float = 0.4
    radius_px: float = 3.0
    poses: PoseGaussian | None = None

    def observed(
        self,
        ideal: Array,
        sd_px: Array,
        clicked: Array,
        state: State,
        *,
        owner: NDArray[np.int64],
        barred: NDArray[np.bool_] | None = None,
        faint: Array | None = None,
    ) -> tuple[Named, State]:
        """Name the dots of a frame about a prediction.

        Args:
            ideal: (C, K, 2) ideal pixels of its dots; NaN: fewer.
            sd_px: (C, K) standard deviations of their coordinates.
            clicked: (C, M, 2) ideal pixels of its clicks; NaN: none.
            state: Prediction.
            owner: (C, K) marker whose texture was followed there; -1: a dot.
            barred: (C, M) True where a person said that the marker is not to be seen; None: nowhere.
            faint: (C, K) what the strength of a dot's response costs; None: nothing.

        Returns:
            What it shows, and the state after it.
        """
        dots = np.where((owner < 0)[..., None], ideal, np.nan)
        clicked_dots, clicks = self.dots_of_clicks(dots, clicked)
        naming = partial(
            name_dots,
            self.matrices,
            ideal,
            sd_px=sd_px,
            reach_px=APART_RADII * self.radius_px,
            clicks=clicks,
            barred=barred,
            owner=owner,
            textured=self.textured,
            faint=faint,
        )
        named = naming(state.xyz_m, state.cov_m2, clicked_dots=clicked_dots, guessed=clicked_dots < 0)
        clicked_here = np.asarray(np.isfinite(clicked[..., 0]).any(axis=0))
        named = self._by_bones(named, state, clicked_here)
        guess = None
        lost = named.rays == 0
        if lost.any() and self.poses is not None:
            guess = self.poses.given(named.xyz_m, (named.rays >= 2) & ~self.textured)
        if guess is not None:
            better = lost & (np.trace(guess[1], axis1=1, axis2=2) < 4 * np.trace(state.cov_m2, axis1=1, axis2=2))
            # what the other markers tell of one that is not seen errs alike for about six frames
            xyz, cov = _weighted(state.xyz_m, state.cov_m2, guess[0], guess[1] / (1 / 6), better)
            state = positioned(state, xyz, cov, better)
        if lost.any():
            state = self._within_bones(state, named)
        if (named.rays < 2).any():
            found = self._meeting(dots, state, named, faint)
            if found is not None:
                if barred is not None:
                    found[barred] = -1
                guessed = clicked_dots < 0
                clicked_dots = np.where(guessed, found, clicked_dots)
                named = naming(state.xyz_m, state.cov_m2, clicked_dots=clicked_dots, guessed=guessed)
                named = self._by_bones(named, state, clicked_here)
        return named, positioned(state, named.xyz_m, named.cov_m2, named.rays > 0)

    def _meeting(self, ideal: Array, state: State, named: Named, faint: Array | None) -> NDArray[np.int64] | None:
        """(C, M) dots of markers that were found where rays of unnamed dots meet; None: there are none."""
        wanted = np.flatnonzero((named.rays < 2) & ~self.textured)
        if not len(wanted):
            return None
        free = np.isfinite(ideal[..., 0])
        if faint is not None:
            free &= faint < 9.0  # three standard deviations fainter
        for c in range(len(free)):
            dots = named.dot[c][named.rays >= 2]
            free[c, dots[dots >= 0]] = False
        uv, jacobian = seen_from(self.matrices, state.xyz_m[wanted])
        d2, _ = away2(window_cov(jacobian, state.cov_m2[wanted], self.sd_px), ideal, uv)
        with np.errstate(invalid="ignore"):
            free &= (d2 < NAME_GATE).any(axis=1)
            # a dot where a marker is that is known belongs to that one, though it may be unsure in this camera
            taken, _ = seen_from(self.matrices, named.xyz_m[named.rays >= 2])
            gap = ideal[:, :, None] - taken[:, None]
            reach = max(2.0, 5 * self.sd_px)
            free &= ~(gap[..., 0] ** 2 + gap[..., 1] ** 2 < reach**2).any(axis=2)
        points, made = meetings(self.matrices, ideal, free, sd_px=self.sd_px)
        if not len(points):
            return None
        error_m = self.sd_px / float(np.nanmedian(np.linalg.norm(jacobian, axis=(-2, -1))) / np.sqrt(2))
        pairs = name_points(
            points, made, wanted, state.xyz_m, state.cov_m2, named.rays >= 2, self.lengths, error_m=error_m, faint=faint
        )
        if not pairs:
            return None
        found = named.dot.copy()
        found[:, (named.rays < 2) | self.textured] = -1
        for marker, point in pairs:
            found[:, marker] = made[point]
        return found

    def _by_bones(self, named: Named, state: State, clicked: NDArray[np.bool_]) -> Named:
        """Without the names of markers at impossible distances: the one that contradicts most others loses its first.

        Of equal ones the one that moved by more, a texture before a dot; a name that was clicked (M,) is kept.
        """
        wrong = np.zeros(len(named.rays), dtype=bool)
        pairs = violated(named.xyz_m, named.cov_m2, self.lengths, reaches(self.lengths, len(wrong)))
        pairs = pairs[(named.rays[pairs] >= 1).all(axis=1)]
        moved = np.nan_to_num(named.surprise, nan=50.0) / np.maximum(named.rays, 1) + 1e9 * self.textured
        while True:
            count = np.where(clicked, 0, np.bincount(pairs.ravel(), minlength=len(wrong)))
            if not count.any():
                break
            # one wrong name contradicts several neighbours, each of which contradicts it alone
            worst = int(np.argmax(np.where(count == count.max(), moved, -1.0)))
            wrong[worst] = True
            pairs = pairs[(pairs != worst).all(axis=1)]
        if not wrong.any():
            return named
        dot, rays = named.dot.copy(), named.rays.copy()
        dot[:, wrong], rays[wrong] = -1, 0
        xyz, cov = named.xyz_m.copy(), named.cov_m2.copy()
        xyz[wrong], cov[wrong] = state.xyz_m[wrong], state.cov_m2[wrong]
        surprise = np.where(wrong, np.nan, named.surprise)
        return Named(dot, xyz, cov, named.doubtful | wrong, surprise, rays, named.merged & ~wrong)

    def _within_bones(self, state: State, named: Named) -> State:
        """A marker that is not found is no farther from its neighbours than their bones are long."""
        xyz, cov = state.xyz_m.copy(), state.cov_m2.copy()
        changed = np.zeros(len(xyz), dtype=bool)
        found = named.rays >= 1
        for (a, b), long in zip(self.lengths.ends, self.lengths.length_m, strict=True):
            for lost, other in ((a, b), (b, a)):
                if found[lost] or not found[other] or not np.isfinite(long) or changed[lost]:
                    continue
                if np.trace(cov[lost]) > long**2:
                    out = xyz[lost] - named.xyz_m[other]
                    size = max(float(np.linalg.norm(out)), 1e-9)
                    xyz[lost] = named.xyz_m[other] + out * min(1.0, long / size)
                    cov[lost] = named.cov_m2[other] + np.eye(3) * long**2 / 3
                    changed[lost] = True
        return positioned(state, xyz, cov, changed) if changed.any() else state

    def measure_bones(self, named: Named) -> None:
        """Running mean of the lengths of the rigid bones whose ends are named."""
        a, b = self.lengths.ends.T
        both = (named.rays[a] >= 2) & (named.rays[b] >= 2)
        long = np.linalg.norm(named.xyz_m[a] - named.xyz_m[b], axis=1)
        self.measured = self.measured + both
        share = 1 / np.clip(self.measured, 1, 100)
        mean = np.where(np.isnan(self.lengths.length_m), long, self.lengths.length_m)
        error = np.where(both, long - mean, 0.0)
        # 3 % at first, as if from five measurements
        sd = np.where(np.isnan(self.lengths.sd_m), 0.03 * long, self.lengths.sd_m)
        # a wrong name is not to teach a wrong length
        error = np.clip(error, -3.0 * sd, 3.0 * sd)
        share_sd = 1 / np.clip(self.measured + 5, 6, 100)
        sd = np.where(both, np.sqrt(np.maximum(sd**2 + (error**2 - sd**2) * share_sd, 0.0)), sd)
        mean = mean + error * share
        measured = self.measured > 0
        least = 2e-3 * self.length_m
        self.lengths = Lengths(
            self.lengths.ends, np.where(measured, mean, np.nan), np.maximum(np.nan_to_num(sd), least)
        )

    def dots_of_clicks(self, ideal: Array, clicked: Array) -> tuple[NDArray[np.int64], Array]:
        """Dots that clicks name (C, M), and ideal places of clicks where there is no dot (C, M, 2)."""
        dots, at = np.full(clicked.shape[:2], -1), clicked.copy()
        reach = max(4.0, 1.5 * self.radius_px)
        for c, m in np.argwhere(np.isfinite(at[..., 0]) & ~self.textured):
            away = np.linalg.norm(ideal[c] - at[c, m], axis=-1)
            if len(away) and np.nanmin(away, initial=np.inf) < reach:
                k = int(np.nanargmin(away))
                if k not in dots[c]:
                    dots[c, m] = k
                    at[c, m] = np.nan
        return dots, at


def crowding(ideal: Array, radius_px: float) -> Array:
    """(C, K) factors of the standard deviations of dots (C, K, 2): those near each other pull each other."""
    if ideal.shape[1] < 2:
        return np.ones(ideal.shape[:2])
    gap = ideal[:, :, None] - ideal[:, None]
    away2 = np.nan_to_num(gap[..., 0] ** 2 + gap[..., 1] ** 2, nan=np.inf)
    i = np.arange(ideal.shape[1])
    away2[:, i, i] = np.inf
    nearest = away2.min(axis=2) / radius_px**2
    return np.where(nearest < 9, 3.0, np.where(nearest < 16, 2.0, 1.0))


def _weighted(a: Array, a_cov: Array, b: Array, b_cov: Array, which: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Two opinions on positions as one, for some markers; the others stay."""
    xyz, cov = a.copy(), a_cov.copy()
    gain = np.swapaxes(np.linalg.solve(a_cov[which] + b_cov[which], a_cov[which]), 1, 2)
    xyz[which] += np.einsum("mij,mj->mi", gain, b[which] - a[which])
    cov[which] -= gain @ a_cov[which]
    return xyz, 0.5 * (cov + np.swapaxes(cov, 1, 2))
