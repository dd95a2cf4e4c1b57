"""Which click to ask for next: the one that removes most variance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.digitising.clicks import places
from mocap.digitising.engine import CLICK_SD_PX, Engine
from mocap.digitising.naming import seen_from


@dataclass(frozen=True, kw_only=True)
class Question:
    """A click that is asked for.

    Attributes:
        camera: Number of the camera, from 0.
        frame: Frame, from 0.
        marker: Number of the marker.
        uv_px: Where it is predicted, as recorded, the first pixel at (1, 1).
        cov_px2: (2, 2) covariance of that place.
        removes_m2: Variance that the click is expected to remove, summed over frames.
    """

    camera: int
    frame: int
    marker: int
    uv_px: tuple[float, float]
    cov_px2: Array
    removes_m2: float


def pixel_sd(engine: Engine) -> Array:
    """(T, M) standard deviation of a coordinate of each marker in the image that knows it least, in pixels.

    Of each camera it is the root of half the trace of the covariance; infinite where nothing is known.
    """
    tracks = engine.tracks
    n_frames, n_markers = tracks.rays.shape
    _, jacobian = seen_from(engine.matrices, tracks.xyz_m.reshape(-1, 3))
    s = np.einsum("cnij,njk,cnlk->cnil", jacobian, tracks.cov_m2.reshape(-1, 3, 3), jacobian)
    sd = np.sqrt(0.5 * np.einsum("cnii->cn", s))
    sd = np.where(np.isfinite(sd), sd, np.inf).max(axis=0)
    return sd.reshape(n_frames, n_markers)


def questions(engine: Engine, *, error_px: float, most: int) -> list[Question]:
    """The next clicks, the most useful first; at most one in each stretch of a marker that is not known well enough.

    A click at time t with the gain k leaves (1 - k) of the variance there; within a stretch, positions at t and t' are
    taken to be correlated by min(s, s') / max(s, s') of their deviations, as between two ends that are known. What a
    click removes counts by how likely the video shows the marker there. No place is asked about twice.

    Args:
        engine: What is known.
        error_px: Stated error: standard deviations above it are asked about.
        most: Greatest number of questions.
    """
    tracks = engine.tracks
    sd_px = pixel_sd(engine)
    begun = np.asarray(np.isfinite(tracks.xyz_m).all(axis=(1, 2)))
    clicked = places(engine.clicks, tracks.dot.shape)
    answered = np.zeros(tracks.dot.shape, dtype=bool)
    for click in engine.clicks:
        answered[click.camera, click.frame, click.marker] = True
    shown = (tracks.dot >= 0) | np.isfinite(clicked[..., 0])
    hidden = ~shown & (answered | (tracks.rays >= 2))
    found = []
    runs = [(m, run) for m in range(sd_px.shape[1]) for run in true_runs((sd_px[:, m] > error_px) & begun)]
    for marker, run in runs:
        frames = np.arange(*run)
        variance = np.trace(tracks.cov_m2[frames, marker], axis1=1, axis2=2)
        # a position known worse counts as if it were known so well
        variance = variance * np.minimum(1.0, 5.0 * error_px / sd_px[frames, marker]) ** 2
        sd = np.sqrt(np.maximum(variance, 1e-18))
        share = (np.minimum(sd[:, None], sd) / np.maximum(sd[:, None], sd)) ** 2
        gains = share @ variance
        # of equal gains the middle: it halves what is left
        gains = gains * (1 - 1e-3 * np.abs(frames - frames.mean()) / max(len(frames), 1))
        tried = np.unique([int(np.argmax(gains)), *np.linspace(0, len(frames) - 1, 7).astype(int)])
        seen, gone = shown[:, :, marker], hidden[:, :, marker]
        candidates = []
        for at in tried:
            frame = int(frames[at])
            likely = in_sight(seen, gone, frame)
            question = _in_best_camera(engine, frame, marker, float(gains[at]), answered, likely)
            candidates += [] if question is None else [question]
        if candidates:
            found.append(max(candidates, key=lambda question: question.removes_m2))
    return sorted(found, key=lambda q: -q.removes_m2)[:most]


def in_sight(shown: NDArray[np.bool_], hidden: NDArray[np.bool_], frame: int) -> Array:
    """(C,) how likely each camera shows a marker in a frame, by when it last or next did, or did not.

    Args:
        shown: (C, T) True where it does.
        hidden: (C, T) True where it does not, as a person said, or as others do.
        frame: The frame.
    """
    # frames for which a camera goes on to show a marker, or not to
    near = np.exp(-np.abs(np.arange(shown.shape[1]) - frame) / 5.0)
    yes, no = (np.max(near * where, axis=1) for where in (shown, hidden))
    return (yes + 0.02) / (yes + no + 0.04)


def _in_best_camera(
    engine: Engine, frame: int, marker: int, gain: float, answered: NDArray[np.bool_], likely: Array
) -> Question | None:
    """The camera in which a click tells most: that shows the marker, with a dot in the window rather than without."""
    tracks = engine.tracks
    xyz, cov = tracks.xyz_m[frame, marker], tracks.cov_m2[frame, marker]
    uv, jacobian = seen_from(engine.matrices, xyz[None])
    best: tuple[float, int, Array] | None = None
    for camera, (width, height) in enumerate(engine.sizes):
        j, at = jacobian[camera, 0], uv[camera, 0]
        if (
            answered[camera, frame, marker]
            or not ((at > 0) & (at < (width, height))).all()
            or tracks.dot[camera, frame, marker] >= 0
        ):
            continue
        s = j @ cov @ j.T + CLICK_SD_PX**2 * np.eye(2)
        removed = float(np.trace(cov @ j.T @ np.linalg.solve(s, j @ cov)))
        dots = tracks.ideal[frame][camera]
        away = dots - at
        with np.errstate(invalid="ignore"):
            inside = np.einsum("ki,ij,kj->k", away, np.linalg.inv(s), away) < 9
        free = inside & ~np.isin(np.arange(len(dots)), tracks.dot[camera, frame])
        worth = removed * float(likely[camera]) * (1.0 if free.any() else 0.5)
        if best is None or worth > best[0]:
            best = worth, camera, s
    if best is None:
        return None
    camera = best[1]
    lens = engine.cameras[camera].lens
    at = uv[camera, 0] if lens is None else lens.distort(uv[camera, 0])
    share = best[0] / max(float(np.trace(cov)), 1e-18)
    return Question(
        camera=camera,
        frame=frame,
        marker=marker,
        uv_px=(float(at[0]), float(at[1])),
        cov_px2=best[2],
        removes_m2=share * gain,
    )
