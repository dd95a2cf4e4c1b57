"""Digitising beside what people use: clicks that are needed until 99 % of positions are right.

``python -m benchmarks.digitise [--quick] --out DIR`` films the twins, digitises the films by each method, and writes
``table.csv``.

A person is simulated who clicks within 0.3 px (standard deviation of a coordinate). Of the peers, which follow each
marker in each film on its own, the person watches every frame and clicks wherever a track is off by more than 1 px, but
for one position in a hundred; frames in which the film does not show the marker cost nothing, its return costs a click.
Of ours, the person clicks two cameras of one frame and then answers the program's questions, ten at a time, with places
or "not to be seen", which counts as a click too. Where no more is asked, the stated error is lowered by a quarter, as
with ``--error-px``. That ends when 99 % of what the films show is within 1 px and 99 % of what two cameras show within
0.3 mm; where 0.3 mm is out of reach of a person who clicks every place that every film shows (``by_hand_0.3mm``), when
as many are as of that person's; or when the budget is spent (``reached`` 0).
"""

import argparse
import csv
import shutil
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from mocap.datasets.bats import bat_motion, make_bat
from mocap.datasets.disturbances import ALL, CLEAN, TEXTURE, Disturbances
from mocap.datasets.film import SyntheticRecording
from mocap.datasets.lizards import lizard_motion, make_lizard
from mocap.datasets.movie import shown_pixels, write_movies

from eal.arrays import Array
from mocap.cameras import triangulate
from mocap.cameras.camera import record, stacked, undistorted
from mocap.digitising.clicks import Click
from mocap.digitising.digitised import digitise
from mocap.digitising.dots import find_dots, look_of
from mocap.digitising.videos import Videos, open_videos
from mocap.io.anipose import write_calibration

CLICK_SD_PX, RIGHT_PX, RIGHT_M, WRONG_PX, ENOUGH = 0.3, 1.0, 3e-4, 5.0, 0.99
AT_A_TIME, LEAST_ERROR_PX = 10, 0.15
COLUMNS = (
    "twin", "seed", "cameras", "disturbance", "method", "clicks_per_100", "within_1px", "wrong_names_per_1000",
    "frames_per_s", "reached", "within_0.3mm", "by_hand_0.3mm", "inside_95", "clicks_to_1px", "seconds_per_answer",
)  # fmt: skip
DISTURBANCES = {"clean": CLEAN, "all": ALL, "texture": TEXTURE}


@dataclass(frozen=True, eq=False, kw_only=True)
class Filmed:
    """Videos of a twin with their truth.

    Attributes:
        recording: The twin.
        folder: Holds ``films``.
        shown_px: (C, T, M, 2) where the films show markers; NaN where they do not.
        exact_px: The same, also where they are hidden.
        unpainted: Markers without a dot.
    """

    recording: SyntheticRecording
    folder: Path
    shown_px: Array
    exact_px: Array
    unpainted: tuple[str, ...] = ()

    @property
    def films(self) -> Videos:
        """Opened."""
        return open_videos([self.folder / "films"], self.recording.cameras)


@dataclass(frozen=True, eq=False, kw_only=True)
class Result:
    """What a method made of films.

    Attributes:
        clicks: Number of clicks.
        clicks_to_1px: Number of clicks when 99 % were within 1 px in the pictures; NaN: they never were.
        uv_px: (C, T, M, 2) its positions in the pictures.
        named: (C, T, M) True where it says that the film shows the marker there.
        xyz_m: (T, M, 3) positions.
        inside: Share of coordinates inside 95 % intervals; NaN: it has none.
        seconds: That it took, decoding included, clicks not.
        per_answer_s: That each answer took; NaN: there were none.
    """

    clicks: int
    clicks_to_1px: float
    uv_px: Array
    named: Array
    xyz_m: Array
    inside: float
    seconds: float
    per_answer_s: float = np.nan


def filmed(twin: str, seed: int, cameras: int, disturbance: str, n_frames: int, folder: Path) -> Filmed:
    """Film a twin."""
    sizes: Disturbances = DISTURBANCES[disturbance]
    make, motion = (make_bat, bat_motion) if twin == "bat" else (make_lizard, lizard_motion)
    recording = make(seed=seed, n_cameras=cameras, n_frames=n_frames)
    (folder / "films").mkdir(parents=True)
    t_s, rig = recording.truth.t_s, recording.cameras
    spoilt = {"start_s": recording.start_s, "disturbances": sizes, "seed": seed}
    write_movies(motion(seed), t_s, rig, folder / "films", fps=recording.fps, **spoilt)
    write_calibration(folder / "calibration.toml", rig)
    return Filmed(
        recording=recording,
        folder=folder,
        shown_px=shown_pixels(motion(seed), t_s, rig, **spoilt).uv_px,
        exact_px=record(rig, recording.truth.xyz_m),
        unpainted=sizes.unpainted,
    )


def ours(film: Filmed, *, budget_per_100: float) -> Result:
    """``mocap.digitise``, with a person who answers."""
    shown, rng = film.shown_px, np.random.default_rng(0)
    n_frames, n_markers = shown.shape[1:3]
    seen = np.isfinite(shown[..., 0])

    def answer(camera: int, frame: int, marker: int) -> tuple[float, float] | None:
        if not seen[camera, frame, marker]:
            return None
        u, v = shown[camera, frame, marker] + CLICK_SD_PX * rng.standard_normal(2)
        return float(u), float(v)

    # a person begins where most is to be seen, and clicks what has no dot in all films
    start = int(np.argmax((seen.sum(axis=0) >= 2).sum(axis=1)))
    clicks = [
        Click(camera=int(c), frame=start, marker=m, uv_px=answer(int(c), start, m))
        for m in range(n_markers)
        for c in np.flatnonzero(seen[:, start, m])[
            : None if film.recording.skeleton.markers[m] in film.unpainted else 2
        ]
    ]
    skeleton, begun = film.recording.skeleton, time.perf_counter()
    found = digitise(
        film.folder / "films", calibration=film.folder / "calibration.toml", skeleton=skeleton, start=clicks
    )
    seconds = time.perf_counter() - begun
    most = int(budget_per_100 * n_frames * n_markers / 100)
    made, first, answering = len(clicks), np.nan, 0.0
    goal = min(ENOUGH, by_hand(film))
    while True:
        pixels, points = found.pixels, found.points
        sd = np.sqrt(np.einsum("tmii->tmi", points.cov_m2))
        inside = np.abs(points.xyz_m - film.recording.truth.xyz_m) < 1.96 * sd
        result = Result(
            clicks=made,
            clicks_to_1px=first,
            uv_px=record(film.recording.cameras, points.xyz_m),
            named=pixels.seen,
            xyz_m=points.xyz_m,
            inside=float(inside.mean()),
            seconds=seconds,
            per_answer_s=answering / (made - len(clicks)) if made > len(clicks) else np.nan,
        )
        in_pixels, in_space = shares(film, result)
        if np.isnan(first) and in_pixels >= ENOUGH:
            first = float(made)
            result = replace(result, clicks_to_1px=first)
        if made >= most or (in_pixels >= ENOUGH and in_space >= goal):
            return result
        while not (todo := found.questions(min(AT_A_TIME, most - made))):
            if found.error_px < LEAST_ERROR_PX:
                return result
            found.error_px *= 0.75
        answers = [
            Click(camera=q.camera, frame=q.frame, marker=q.marker, uv_px=answer(q.camera, q.frame, q.marker))
            for q in todo
        ]
        begun = time.perf_counter()
        found.click(answers)
        answering += time.perf_counter() - begun
        made += len(answers)


def by_hand(film: Filmed) -> float:
    """Share within 0.3 mm of what two cameras show, if a person clicked every place that every film shows."""
    cameras, rng = film.recording.cameras, np.random.default_rng(1)
    ideal = undistorted(cameras, film.shown_px + CLICK_SD_PX * rng.standard_normal(film.shown_px.shape))
    matrices = stacked(cameras)
    xyz, _ = triangulate.refine(matrices, ideal, triangulate.linear(matrices, ideal), sd_px=CLICK_SD_PX)
    off = np.linalg.norm(xyz - film.recording.truth.xyz_m, axis=-1)
    return float((off[np.isfinite(off)] < RIGHT_M).mean())


def shares(film: Filmed, result: Result) -> tuple[float, float]:
    """Share of what the films show within 1 px, and of what two films show within 0.3 mm."""
    seen = np.isfinite(film.shown_px[..., 0])
    off = np.linalg.norm(result.uv_px - film.exact_px, axis=-1)
    two = seen.sum(axis=0) >= 2
    off_m = np.linalg.norm(result.xyz_m - film.recording.truth.xyz_m, axis=-1)
    return float((off[seen] < RIGHT_PX).mean()), float((off_m[two] < RIGHT_M).mean())


def followed(film: Filmed, step: "Callable[[int], Stepper]") -> Result:
    """A method that follows markers in each film on its own, with a person who corrects it."""
    shown, rng = film.shown_px - 1, np.random.default_rng(0)
    uv = np.full(shown.shape, np.nan)
    clicks, bad, total, seconds = 0, 0, 0, 0.0
    films, n_cameras = film.films, shown.shape[0]
    steppers = [step(c) for c in range(n_cameras)]
    for frame, pictures in enumerate(films.pictures()):
        for c, picture in enumerate(pictures):
            true = shown[c, frame]
            there = np.isfinite(true[:, 0])
            begun = time.perf_counter()
            now = steppers[c].next(picture)
            seconds += time.perf_counter() - begun
            off = np.linalg.norm(np.nan_to_num(now, nan=1e6) - np.nan_to_num(true), axis=-1) > RIGHT_PX
            for m in np.flatnonzero(there & off):
                total += 1
                if bad < (1 - ENOUGH) * total:
                    bad += 1
                    continue
                now[m] = true[m] + CLICK_SD_PX * rng.standard_normal(2)
                clicks += 1
            total += int((there & ~off).sum())
            now[~there] = np.nan
            steppers[c].put(picture, now)
            uv[c, frame] = now + 1
    ideal = undistorted(film.recording.cameras, uv)
    xyz = triangulate.linear(stacked(film.recording.cameras), ideal)
    return Result(
        clicks=clicks,
        clicks_to_1px=float(clicks),
        uv_px=uv,
        named=np.isfinite(uv[..., 0]),
        xyz_m=xyz,
        inside=np.nan,
        seconds=seconds,
    )


class Stepper(ABC):
    """One film: ``next`` proposes where markers are, ``put`` is told where they are."""

    def __init__(self, n_markers: int) -> None:
        """Nothing is known."""
        self.at = np.full((n_markers, 2), np.nan)
        self.before: Array | None = None

    def next(self, picture: Array) -> Array:
        """(M, 2) places in a picture."""
        known = np.isfinite(self.at[:, 0])
        out = np.full(self.at.shape, np.nan)
        if known.any() and self.before is not None:
            out[known] = self.moved(self.before, picture, self.at[known], np.flatnonzero(known))
        return out

    def put(self, picture: Array, at: Array) -> None:
        """Take the corrected places."""
        self.before, self.at = picture, at.copy()

    @abstractmethod
    def moved(self, before: Array, now: Array, at: Array, which: Array) -> Array:
        """(K, 2) places of the markers ``which`` that were ``at``."""


class LucasKanade(Stepper):
    """Pyramidal Lucas-Kanade (Bouguet 2001): windows of 15 px, four levels, forward-backward check within 1 px."""

    def moved(self, before: Array, now: Array, at: Array, which: Array) -> Array:
        """By the flow."""
        del which
        options = {"winSize": (15, 15), "maxLevel": 3}
        start = at.astype(np.float32)[:, None]
        there, ok, _ = cv2.calcOpticalFlowPyrLK(before, now, start, None, **options)
        back, ok_back, _ = cv2.calcOpticalFlowPyrLK(now, before, there, None, **options)
        good = (ok[:, 0] == 1) & (ok_back[:, 0] == 1) & (np.linalg.norm(back - start, axis=-1)[:, 0] < 1)
        return np.where(good[:, None], there[:, 0].astype(float), np.nan)


class Templates(Stepper):
    """Normalised cross-correlation with the 15 x 15 px about the marker in the frame before, within 25 px."""

    def moved(self, before: Array, now: Array, at: Array, which: Array) -> Array:
        """By the best match, to a fraction of a pixel by a parabola."""
        del which
        out = np.full(at.shape, np.nan)
        for k, (u, v) in enumerate(np.rint(at).astype(int)):
            half, reach = 7, 25
            height, width = now.shape
            if not (half <= u < width - half and half <= v < height - half):
                continue
            patch = cv2.getRectSubPix(before, (15, 15), tuple(map(float, at[k])))
            left, top = max(u - reach - half, 0), max(v - reach - half, 0)
            part = now[top : v + reach + half + 1, left : u + reach + half + 1]
            score = cv2.matchTemplate(part, patch, cv2.TM_CCOEFF_NORMED)
            _, best, _, (x, y) = cv2.minMaxLoc(score)
            if best < 0.5:
                continue
            dx = _peak(score[y, x - 1 : x + 2]) if 0 < x < score.shape[1] - 1 else 0.0
            dy = _peak(score[y - 1 : y + 2, x]) if 0 < y < score.shape[0] - 1 else 0.0
            out[k] = left + x + half + dx, top + y + half + dy
        return out


def _peak(three: Array) -> float:
    bend = float(three[0] - 2 * three[1] + three[2])
    return 0.5 * float(three[0] - three[2]) / bend if bend < 0 else 0.0


class NearestBlob(Stepper):
    """The nearest blob (our own finder of dots) within 25 px."""

    def moved(self, before: Array, now: Array, at: Array, which: Array) -> Array:
        """By distance alone."""
        del which
        look = look_of([before], [at])
        if look is None:
            return np.full(at.shape, np.nan)
        dots = find_dots(now, look)[:, :2]
        if not len(dots):
            return np.full(at.shape, np.nan)
        away = np.linalg.norm(at[:, None] - dots, axis=-1)
        return np.where((away.min(axis=1) < 25)[:, None], dots[away.argmin(axis=1)], np.nan)


class Csrt(Stepper):
    """OpenCV's CSRT (Lukezic et al. 2017), one tracker for each marker, begun anew at each click."""

    def __init__(self, n_markers: int) -> None:
        """Nothing is followed."""
        super().__init__(n_markers)
        self.trackers: dict[int, object] = {}
        self.proposed = self.at.copy()

    def moved(self, before: Array, now: Array, at: Array, which: Array) -> Array:
        """By each tracker; boxes of 17 px."""
        out = np.full(at.shape, np.nan)
        for k, m in enumerate(which.tolist()):
            if m not in self.trackers or not np.allclose(self.at[m], self.proposed[m]):
                tracker = cv2.TrackerCSRT_create()  # type: ignore[attr-defined]
                u, v = np.rint(at[k]).astype(int) - 8
                tracker.init(cv2.cvtColor(before, cv2.COLOR_GRAY2BGR), (int(u), int(v), 17, 17))
                self.trackers[m] = tracker
            ok, (x, y, w, h) = self.trackers[m].update(cv2.cvtColor(now, cv2.COLOR_GRAY2BGR))  # type: ignore[attr-defined]
            out[k] = (x + w / 2 - 0.5, y + h / 2 - 0.5) if ok else np.nan
            self.proposed[m] = out[k]
        return out


def methods(film: Filmed, budget_per_100: float) -> "Iterator[tuple[str, Callable[[], Result]]]":
    """All that can run here."""
    n = film.shown_px.shape[2]
    yield "mocap", lambda: ours(film, budget_per_100=budget_per_100)
    peers: dict[str, type[Stepper]] = {
        "lucas_kanade": LucasKanade,
        "templates": Templates,
        "nearest_blob": NearestBlob,
    }
    if hasattr(cv2, "TrackerCSRT_create"):
        peers["csrt"] = Csrt
    for name, kind in peers.items():
        yield name, lambda kind=kind: followed(film, lambda _camera: kind(n))


def row_of(film: Filmed, result: Result, possible: float) -> list[float]:
    """The columns after ``method``."""
    n_frames, n_markers = result.xyz_m.shape[:2]
    off = np.linalg.norm(result.uv_px - film.exact_px, axis=-1)
    wrong = (result.named & (off > WRONG_PX)).any(axis=0)
    pixels, space = shares(film, result)
    # of the peers' one position in a hundred is left as it is
    reached = pixels >= ENOUGH - 2e-3 and space >= min(ENOUGH, possible)
    return [
        100 * result.clicks / (n_frames * n_markers),
        pixels,
        1000 * float(wrong.mean()),
        n_frames / result.seconds,
        float(reached),
        space,
        possible,
        result.inside,
        100 * result.clicks_to_1px / (n_frames * n_markers),
        result.per_answer_s,
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, and write the table as rows are there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one seed, 4 cameras, 50 frames, without CSRT: minutes")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=None, help="frames of each film (240, --quick: 50)")
    parser.add_argument("--budget", type=float, default=6.0, help="most clicks a 100 marker-frames of ours")
    parser.add_argument("--twins", nargs="*", default=["lizard", "bat"])
    parser.add_argument("--seeds", type=int, nargs="*", default=None)
    parser.add_argument("--cameras", type=int, nargs="*", default=None)
    parser.add_argument("--disturbances", nargs="*", default=list(DISTURBANCES), choices=list(DISTURBANCES))
    parser.add_argument("--methods", nargs="*", default=None, help="only these")
    given = parser.parse_args(arguments)
    n_frames = given.frames or (50 if given.quick else 240)
    seeds = given.seeds if given.seeds is not None else range(1 if given.quick else 5)
    rigs = given.cameras if given.cameras is not None else ((4,) if given.quick else (4, 8))
    chosen = given.methods or (["mocap", "lucas_kanade", "templates", "nearest_blob"] if given.quick else None)
    if not hasattr(cv2, "TrackerCSRT_create"):
        print("CSRT is left out: this OpenCV was built without it (it is in opencv-contrib-python)")
    given.out.mkdir(parents=True, exist_ok=True)
    with (given.out / "table.csv").open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(COLUMNS)
        tasks = [(s, c, t, d) for s in seeds for c in rigs for t in given.twins for d in given.disturbances]
        for seed, cameras, twin, disturbance in tasks:
            folder = Path(tempfile.mkdtemp(dir=given.out, prefix=".films-"))
            try:
                film = filmed(twin, seed, cameras, disturbance, n_frames, folder / "twin")
                possible = by_hand(film)
                for method, run in methods(film, given.budget):
                    if chosen is None or method in chosen:
                        row = [f"{x:.4g}" for x in row_of(film, run(), possible)]
                        table.writerow([twin, seed, cameras, disturbance, method, *row])
                        stream.flush()
                        print(twin, seed, cameras, disturbance, method, *row, flush=True)
            finally:
                shutil.rmtree(folder)


if __name__ == "__main__":
    main()
