"""The passes over a film: forward while it is decoded, backward over the dots that were kept, and again after clicks.

Forward, each frame's windows follow from the frames before; dots are looked for in these windows only. Backward, they
follow from the frames before and after, so that what a crossing left open is decided by what came after it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mocap.arrays import Array
from mocap.cameras import triangulate
from mocap.cameras.camera import Camera, stacked
from mocap.digitising.clicks import Click
from mocap.digitising.dots import DotLook, Grey, find_dots, look_of
from mocap.digitising.errors import SHARED, RayErrors, ray_errors, stated
from mocap.digitising.films import Films
from mocap.digitising.meeting import Lengths
from mocap.digitising.motion import State, fused, positioned, predicted
from mocap.digitising.naming import Named, seen_from, update, window_cov
from mocap.digitising.observer import Observer, crowding
from mocap.digitising.pose import PoseGaussian, fit_poses
from mocap.digitising.straight import Straightening, straightening_of
from mocap.errors import MocapError
from mocap.io.movies import FIRST_PIXEL
from mocap.skeleton import Skeleton, ends_among

CLICK_SD_PX = 1.0
_FIRST_SPEEDS = (0.004, 0.015, 0.05, 0.12)
"""Speeds that are tried at the start, in lengths of the animal a frame."""
_TRIAL_FRAMES = 3
_WIDE_PX = 60.0
_PIECES, _PIECE = 10, 20
_LEARN_AT = (30, 60, 120, 240, 480, 960)

Progress = Callable[[str, float], None]


@dataclass(eq=False)
class Tracks:
    """What is known of T frames of M markers in C cameras; grows while a film is decoded and is mended by clicks.

    Attributes:
        dots: Of each frame (C, K, 3): recorded column and row counted as DLTdv does, and response; NaN: fewer dots.
        ideal: The same places without distortion (C, K, 2).
        crowding: Factors of the dots' standard deviations (C, K): ``observer.crowding``.
        dot: (C, T, M) number of the dot that is the marker's; -1: none.
        xyz_m: (T, M, 3) positions.
        cov_m2: (T, M, 3, 3) their covariances.
        rays: (T, M) number of cameras that show a marker.
        doubtful: (T, M) True where a dot may be the marker's or another's.
        forward: (T, M, 90) states before the frame's own dots are seen, from the frames before.
        backward: The same from the frames after.
        density: (T, M) density of the jerk that each marker was predicted with.
    """

    dots: list[Array]
    ideal: list[Array]
    crowding: list[Array]
    dot: NDArray[np.int64]
    xyz_m: Array
    cov_m2: Array
    rays: NDArray[np.int64]
    doubtful: NDArray[np.bool_]
    forward: NDArray[np.float32]
    backward: NDArray[np.float32]
    density: Array


@dataclass(eq=False)
class Engine:
    """Films, cameras and clicks, and what follows from them.

    Attributes:
        films: Opened films.
        cameras: C cameras of them.
        skeleton: The animal; its M markers are named.
        poses: How the animal moves; None: learned from the film itself as far as it is named.
        clicks: All clicks.
        tracks: What is known so far; empty before ``decode``.
    """

    films: Films
    cameras: Sequence[Camera]
    skeleton: Skeleton
    poses: PoseGaussian | None = None
    clicks: list[Click] = field(default_factory=list)
    look: DotLook | None = None

    def __post_init__(self) -> None:
        """Prepare what does not change."""
        self.names = self.skeleton.markers
        self.matrices = stacked(self.cameras)
        sizes = [movie.size_px for movie in self.films.movies]
        self.straight: list[Straightening] = [
            straightening_of(camera, size) for camera, size in zip(self.cameras, sizes, strict=True)
        ]
        self.sizes = sizes
        shape = (self.films.n_frames, len(self.names))
        n_cameras = len(self.cameras)
        self.tracks = Tracks(
            dots=[np.full((n_cameras, 0, 3), np.nan)] * shape[0],
            ideal=[np.full((n_cameras, 0, 2), np.nan)] * shape[0],
            crowding=[np.ones((n_cameras, 0))] * shape[0],
            dot=np.full((n_cameras, *shape), -1),
            xyz_m=np.full((*shape, 3), np.nan),
            cov_m2=np.full((*shape, 3, 3), np.nan),
            rays=np.zeros(shape, dtype=np.int64),
            doubtful=np.zeros(shape, dtype=bool),
            forward=np.full((*shape, 90), np.nan, dtype=np.float32),
            backward=np.full((*shape, 90), np.nan, dtype=np.float32),
            density=np.ones(shape),
        )
        self.density = np.ones(shape[1])
        self.most = np.zeros(shape[1])
        self.errors: RayErrors | None = None
        self.own_poses = self.poses is None
        trunk = [self.names.index(name) for name in self.skeleton.trunk]
        self.trunk = trunk
        ends = np.array(ends_among(self.names, self.skeleton.rigid), dtype=int).reshape(-1, 2)
        lengths = Lengths(ends, np.full(len(ends), np.nan), np.full(len(ends), np.nan))
        self._sort_clicks()
        self.observer = Observer(self.matrices, lengths, np.zeros(len(ends), dtype=np.int64), poses=self.poses)

    def first_points(self) -> tuple[int, Array, Array]:
        """The first frame with clicks of enough markers: its number, positions (M, 3) and covariances (M, 3, 3).

        Raises:
            MocapError: no frame has a marker that was clicked in two cameras.
        """
        frames = sorted({click.frame for click in self.clicks})
        best: tuple[int, int] = (0, -1)
        for frame in frames:
            uv = self._clicked(frame)
            n = int((np.isfinite(uv[..., 0]).sum(axis=0) >= 2).sum())
            if n > best[0]:
                best = n, frame
        if best[0] < 1:
            raise MocapError(
                "`start`: no marker is clicked in two cameras in one frame: click each marker in two or more films of "
                "a frame that shows it"
            )
        frame = best[1]
        ideal = self._ideal(self._clicked(frame))
        xyz = triangulate.linear(self.matrices, ideal)
        there = np.isfinite(xyz[:, 0])
        self.observer.length_m = float(np.linalg.norm(np.ptp(xyz[there], axis=0))) if there.sum() > 1 else 0.1
        self.observer.length_m = max(self.observer.length_m, 1e-3)
        xyz, cov = triangulate.refine(self.matrices, ideal, xyz, sd_px=CLICK_SD_PX)
        guess = None if self.poses is None else self.poses.given(np.nan_to_num(xyz), there)
        for m in np.flatnonzero(~there):
            if guess is None:
                xyz[m], cov[m] = xyz[there].mean(axis=0), np.eye(3) * self.observer.length_m**2
            else:
                xyz[m], cov[m] = guess[0][m], 2 * guess[1][m]
        return frame, xyz, cov

    def _clicked(self, frame: int) -> Array:
        """(C, M, 2) places that were clicked in a frame; NaN: none."""
        out = np.full((len(self.cameras), len(self.names), 2), np.nan)
        for click in self.by_frame.get(frame, ()):
            out[click.camera, click.marker] = np.nan if click.uv_px is None else click.uv_px
        return out

    def _barred(self, frame: int) -> NDArray[np.bool_] | None:
        """(C, M) where a marker is not to be seen, as a person said; None: nowhere."""
        clicks = self.by_frame.get(frame, ())
        if all(click.uv_px is not None for click in clicks):
            return None
        out = np.zeros((len(self.cameras), len(self.names)), dtype=bool)
        for click in clicks:
            out[click.camera, click.marker] = click.uv_px is None
        return out

    def _sort_clicks(self) -> None:
        """Clicks by their frames, in their order."""
        self.by_frame: dict[int, list[Click]] = {}
        for click in self.clicks:
            self.by_frame.setdefault(click.frame, []).append(click)

    def _ideal(self, uv_px: Array) -> Array:
        """(C, ..., 2) ideal pixels of recorded ones."""
        return np.stack([straight(uv) for straight, uv in zip(self.straight, uv_px, strict=True)])

    def _dots(self, pictures: "list[Grey | None]", windows: "Sequence[tuple[int, int, int, int] | None]") -> Array:
        """(C, K, 3) dots of a frame in a window (left, top, right, bottom) of each picture; None: in all of it."""
        look = self.look
        found = []
        for picture, window in zip(pictures, windows, strict=True):
            if picture is None or look is None:
                found.append(np.zeros((0, 3)))
                continue
            left, top, right, bottom = window or (0, 0, picture.shape[1], picture.shape[0])
            part = picture[top:bottom, left:right]
            found.append(find_dots(part, look, corner=(left, top)) + np.array([FIRST_PIXEL, FIRST_PIXEL, 0.0]))
        most = max(map(len, found))
        out = np.full((len(found), most, 3), np.nan)
        for c, dots in enumerate(found):
            out[c, : len(dots)] = dots
        return out

    def _keep(self, frame: int, dots: Array) -> None:
        self.tracks.dots[frame] = dots.astype(np.float32)
        self.tracks.ideal[frame] = self._ideal(dots[..., :2])
        self.tracks.crowding[frame] = crowding(self.tracks.ideal[frame], self.observer.radius_px)

    def _windows(self, state: State) -> "list[tuple[int, int, int, int] | None]":
        """The part of each picture in which markers are expected; None: anywhere."""
        uv, jacobian = seen_from(self.matrices, state.xyz_m)
        s = window_cov(jacobian, state.cov_m2, self.observer.sd_px)
        reach = 4.0 * np.sqrt(np.maximum(s[..., 0, 0], s[..., 1, 1]))
        margin = 12.0 + (4.0 * self.look.radius_px if self.look else 0.0)
        out: list[tuple[int, int, int, int] | None] = []
        for c, (width, height) in enumerate(self.sizes):
            known = np.isfinite(uv[c, :, 0]) & (reach[c] < 4 * _WIDE_PX)
            if known.sum() < 0.5 * len(known):
                out.append(None)
                continue
            lens = self.cameras[c].lens
            at = uv[c, known] if lens is None else lens.distort(uv[c, known])
            at = at - FIRST_PIXEL
            r = reach[c, known][:, None] + margin
            low, high = (at - r).min(axis=0), (at + r).max(axis=0)
            left, top = (int(np.clip(x, 0, n - 1)) for x, n in zip(low, (width, height), strict=True))
            right, bottom = (int(np.clip(x, 1, n)) for x, n in zip(high, (width, height), strict=True))
            out.append((left, top, max(right, left + 1), max(bottom, top + 1)))
        return out

    def _observed(self, frame: int, state: State) -> tuple[Named, State]:
        """Name the dots of a frame about a prediction; the state after it."""
        t = self.tracks
        clicked, barred = self._ideal(self._clicked(frame)), self._barred(frame)
        return self.observer.observed(t.ideal[frame], t.crowding[frame], clicked, state, barred=barred)

    def decode(self, *, progress: Progress = lambda _stage, _share: None) -> None:
        """Decode the films once: forward pass and dots; then the backward pass.

        Raises:
            MocapError: there are no clicks to begin with.
        """
        start, xyz, cov = self.first_points()
        n = self.films.n_frames
        if self.look is None:
            self.look = self._look(start)
        self.observer.radius_px = self.look.radius_px
        state: State | None = None
        waiting: list[int] = []
        for frame, pictures in enumerate(self.films.pictures()):
            progress("finding and naming dots", frame / n)
            if state is None:
                self._keep(frame, self._dots(pictures, [None] * len(pictures)))
                if frame >= start:
                    waiting.append(frame)
                if len(waiting) > _TRIAL_FRAMES or (waiting and frame == n - 1):
                    state = self._started(start, xyz, cov)
                    for late in waiting:
                        state = self._forward(late, state)
                continue
            ahead = self._ahead(state)
            self._keep(frame, self._dots(pictures, self._windows(ahead)))
            state = self._forward(frame, state)
        # frames before the first clicks are named backward only, with the noise as it was found after these
        self.tracks.density[:start] = np.max(self.tracks.density[start : start + 30], axis=0)
        self._estimate_sd(start)
        self._backward(n - 1, 0, None, progress=progress)
        # once more over the dots, with the poses of the whole film and the noise as it was found
        self._estimate_sd(start)
        if self.own_poses:
            self.learn_poses()
        self.again(progress=progress)

    def _look(self, start: int) -> DotLook:
        uv = self._clicked(start)
        pictures, places = [], []
        for c in range(len(self.cameras)):
            there = np.isfinite(uv[c, :, 0])
            picture = self.films.picture(c, start) if there.any() else None
            if picture is not None:
                pictures.append(picture)
                places.append(uv[c, there] - FIRST_PIXEL)
        found = look_of(pictures, places)
        if found is None:
            raise MocapError(
                "there are no dots where markers were clicked: check that the clicks belong to these films, and that "
                "they count rows from the upper left corner"
            )
        return found

    def _started(self, start: int, xyz: Array, cov: Array) -> State:
        """The state before the first clicked frame's dots, at the speed with which most can be named."""
        best: tuple[float, State, Array] | None = None
        for share in _FIRST_SPEEDS:
            speed = share * self.observer.length_m
            density = np.full(len(xyz), (0.3 * speed) ** 2)
            state = first_state(xyz, cov, speed)
            self.density = density
            trial, rays = state, 0.0
            for frame in range(start, min(start + _TRIAL_FRAMES, self.films.n_frames)):
                if frame > start:
                    trial = self._ahead(trial)
                named, trial = self._observed(frame, trial)
                rays += float(np.sum(named.rays >= 2)) if frame > start else 0.0
            if best is None or rays > 1.02 * best[0]:
                best = rays, state, density
        if best is None:
            raise MocapError("the films have no frame in step: check `offset_frames`")
        self.density = best[2]
        return best[1]

    @property
    def fastest(self) -> float:
        """Greatest density of the jerk: a twentieth of the animal's length in a frame."""
        return (0.05 * self.observer.length_m) ** 2

    def _forward(self, frame: int, state: State) -> State:
        """One frame on: ``state`` is that after the frame before, or the first one."""
        first = bool(np.isnan(self.tracks.forward[:, 0, 0]).all())
        ahead = state if first else self._ahead(state)
        self.tracks.forward[frame] = packed(ahead)
        named, state = self._observed(frame, ahead)
        self._take(frame, named)
        self.tracks.density[frame] = self.density
        self._adapt(named)
        self.observer.measure_bones(named)
        if self.own_poses and frame + 1 in _LEARN_AT:
            self.learn_poses(frame + 1)
        return state

    def _ahead(self, state: State) -> State:
        """A frame later; a marker of which nothing is known any more is somewhere near the others."""
        ahead = predicted(state, self.density)
        sd = np.sqrt(np.trace(ahead.cov_m2, axis1=1, axis2=2))
        lost = ~(sd < 0.5 * self.observer.length_m)
        if not lost.any():
            return ahead
        x, cov = ahead.x.copy(), ahead.cov.copy()
        middle = x[~lost, :3].mean(axis=0) if not lost.all() else np.nan_to_num(x[:, :3]).mean(axis=0)
        near = np.linalg.norm(x[:, :3] - middle, axis=1) < self.observer.length_m
        x[lost & ~near, :3], x[lost, 3:] = middle, 0.0
        spread = self.observer.length_m * np.repeat([0.25, 0.05, 0.02], 3)
        cov[lost] = np.diag(spread**2)
        return State(x, cov)

    def _adapt(self, named: Named) -> None:
        """Follow how much markers surprise the model: fast up, slowly down, and up while a marker is not found."""
        known = np.isfinite(named.surprise)
        ratio = np.clip(named.surprise[known], 0.0, 30.0)
        self.density[known] *= np.clip(1 + np.where(ratio > 1, 0.15, 0.04) * (ratio - 1), 0.9, 3.0)
        self.density[named.rays == 0] *= 1.3
        self.most = np.maximum(self.most, np.where(known, self.density, 0.0))
        floor = 0.05 * np.maximum(self.most, 0.3 * np.quantile(self.most, 0.9))
        self.density = np.clip(self.density, np.maximum(floor, (1e-5 * self.observer.length_m) ** 2), self.fastest)

    def _take(self, frame: int, named: Named) -> None:
        t = self.tracks
        t.dot[:, frame], t.xyz_m[frame], t.cov_m2[frame] = named.dot, named.xyz_m, named.cov_m2
        t.rays[frame], t.doubtful[frame] = named.rays, named.doubtful

    def _backward(
        self, last: int, first: int, state: State | None, *, progress: Progress = lambda _stage, _share: None
    ) -> None:
        """From ``last`` to ``first``, windows of the frames on both sides; ``state``: of the frame after ``last``."""
        for frame in range(last, first - 1, -1):
            progress("naming dots again with what came after", (last - frame) / max(last - first, 1))
            self.density = self.tracks.density[min(frame + 1, last)]
            ahead = None if state is None else self._ahead(state)
            forward = self.tracks.forward[frame]
            known = np.isfinite(forward[:, 0]).all()
            if ahead is None:
                if not known:
                    continue
                ahead = unpacked(forward).turned().looser(1e4)
            self.tracks.backward[frame] = packed(ahead)
            both = fused(unpacked(forward), ahead.turned()) if known else ahead.turned()
            named, _ = self._observed(frame, both)
            # the dots that both sides named, seen from the frames after alone
            seen = self._places(frame, named)
            prior = np.linalg.inv(ahead.cov_m2)
            sd = self._deviations(frame, named)
            self._take(frame, named)
            self._state(frame, named, both, seen, sd)
            xyz, cov = update(self.matrices, seen, sd, ahead.xyz_m, ahead.cov_m2, prior)
            state = positioned(ahead, xyz, cov, named.rays > 0)

    def _state(self, frame: int, named: Named, both: State, seen: Array, sd_px: Array) -> None:
        """The covariances that are stated of a frame that was named from both sides."""
        clicked = np.isfinite(self._clicked(frame)[..., 0]).any(axis=0)
        cov = self.tracks.cov_m2[frame]
        # a ray that no other one checks leads the filter, but may be another marker's
        lone = (named.rays == 1) & ~clicked
        cov[lone] = both.cov_m2[lone]
        if self.errors is None:
            return
        met = named.rays >= 2
        _, jacobian = seen_from(self.matrices, named.xyz_m)
        used = np.where(np.isfinite(seen[..., 0])[..., None, None], jacobian, 0.0)
        shared = SHARED * self.observer.radius_px
        cov[met] = stated(self.errors, used, sd_px, named.cov_m2, shared_px=shared)[met]

    def _places(self, frame: int, named: Named) -> Array:
        """(C, M, 2) ideal pixels of named dots and clicks; NaN: none."""
        ideal = self.tracks.ideal[frame]
        camera = np.arange(len(self.cameras))[:, None]
        if not ideal.shape[1]:
            out = np.full((*named.dot.shape, 2), np.nan)
        else:
            out = np.where((named.dot >= 0)[..., None], ideal[camera, np.maximum(named.dot, 0)], np.nan)
        _, clicks = self.observer.known(ideal, self._ideal(self._clicked(frame)))
        return np.where(np.isfinite(clicks), clicks, out)

    def _deviations(self, frame: int, named: Named) -> Array:
        """(C, M) standard deviations of the places of named dots."""
        sd = self.observer.sd_px * self.tracks.crowding[frame]
        if not sd.shape[1]:
            return np.ones(named.dot.shape)
        camera = np.arange(len(self.cameras))[:, None]
        return np.where(named.dot >= 0, sd[camera, np.maximum(named.dot, 0)], CLICK_SD_PX)

    def rerun(self, clicks: Iterable[Click], *, margin: int = 20) -> tuple[int, int]:
        """Take more clicks; only the frames about them are named again. Returns the first and last of these."""
        new = list(clicks)
        self.clicks += new
        self._sort_clicks()
        return self._about(new, margin)

    def undo(self, count: int = 1, *, margin: int = 20) -> list[Click]:
        """Take the last clicks back; the frames about them are named again."""
        kept = max(len(self.clicks) - count, 0)
        taken = self.clicks[kept:]
        del self.clicks[kept:]
        self._sort_clicks()
        if taken:
            self._about(taken, margin)
        return taken

    def _about(self, changed: Sequence[Click], margin: int) -> tuple[int, int]:
        """Name the frames again that clicks may change."""
        markers = sorted({click.marker for click in changed})
        first, last = self._touched(sorted({click.frame for click in changed}), markers, margin)
        begun = np.flatnonzero(np.isfinite(np.asarray(self.tracks.forward)[:, 0, 0]))
        begin = max(first, int(begun[0])) if len(begun) else last + 1
        state = unpacked(self.tracks.forward[begin]) if begin <= last else None
        for frame in range(begin, last + 1):
            self.density = self.tracks.density[frame]
            ahead = state if frame == begin or state is None else self._ahead(state)
            if ahead is None:
                break
            self.tracks.forward[frame] = packed(ahead)
            named, state = self._observed(frame, ahead)
            self._take(frame, named)
        after = None
        if last + 1 < self.films.n_frames:
            ahead = unpacked(self.tracks.backward[last + 1])
            dots = Named(
                self.tracks.dot[:, last + 1], ahead.xyz_m, ahead.cov_m2, self.tracks.doubtful[last + 1],
                ahead.x[:, 0], self.tracks.rays[last + 1],
            )  # fmt: skip
            seen = self._places(last + 1, dots)
            sd = self._deviations(last + 1, dots)
            xyz, cov = update(self.matrices, seen, sd, ahead.xyz_m, ahead.cov_m2, np.linalg.inv(ahead.cov_m2))
            after = positioned(ahead, xyz, cov, self.tracks.rays[last + 1] > 0)
        self._backward(last, first, after)
        return first, last

    def _touched(self, frames: Sequence[int], markers: Sequence[int], margin: int) -> tuple[int, int]:
        """Frames that clicks may change: to where their markers are sure on both sides, and a margin."""
        sure = np.asarray((self.tracks.rays[:, list(markers)] >= 2).all(axis=1))
        first, last = frames[0], frames[-1]
        run = 0
        while first > 0 and run < margin:
            first -= 1
            run = run + 1 if sure[first] else 0
        run = 0
        while last < self.films.n_frames - 1 and run < margin:
            last += 1
            run = run + 1 if sure[last] else 0
        return first, last

    def again(self, *, progress: Progress = lambda _stage, _share: None) -> None:
        """Both passes over the dots that were kept, with the poses and the noise as they are known now."""
        begun = np.isfinite(np.asarray(self.tracks.forward)[:, 0, 0])
        if not begun.any():
            return
        start = int(np.argmax(begun))
        state = unpacked(self.tracks.forward[start])
        for frame in range(start, self.films.n_frames):
            self.density = self.tracks.density[frame]
            ahead = state if frame == start else self._ahead(state)
            self.tracks.forward[frame] = packed(ahead)
            named, state = self._observed(frame, ahead)
            self._take(frame, named)
        self._backward(self.films.n_frames - 1, 0, None, progress=progress)

    def learn_poses(self, end: int | None = None) -> None:
        """Learn the pose from the frames that are named so far."""
        t = self.tracks
        known = np.where((t.rays[:end] >= 2)[..., None], t.xyz_m[:end], np.nan)
        found = fit_poses(known, self.trunk, least_sd_m=1e-3 * self.observer.length_m)
        self.poses = self.observer.poses = found or self.poses

    def _estimate_sd(self, first: int) -> None:
        """Standard deviation of a dot, from how the rays of named dots meet, and what of their errors lasts."""
        camera = np.arange(len(self.cameras))[:, None]
        n = self.films.n_frames
        # pieces of frames that follow one another
        begins = np.unique(np.linspace(first, max(first, n - _PIECE), _PIECES).astype(int))
        frames = np.unique(np.minimum(begins[:, None] + np.arange(_PIECE), n - 1))
        uv = np.full((len(self.cameras), len(frames), len(self.names), 2), np.nan)
        for row, frame in enumerate(frames.tolist()):
            dot, ideal = self.tracks.dot[:, frame], self.tracks.ideal[frame]
            if ideal.shape[1]:
                uv[:, row] = np.where((dot >= 0)[..., None], ideal[camera, np.maximum(dot, 0)], np.nan)
        try:
            found = triangulate.apparent_sd(self.matrices, uv)
        except ValueError:
            return
        if np.isfinite(found):
            self.observer.sd_px = float(np.clip(found, 0.15, 2.0))
            self.errors = ray_errors(self.matrices, uv, sd_px=self.observer.sd_px)


def first_state(xyz_m: Array, cov_m2: Array, speed_m: float) -> State:
    """A state whose velocities are not known, up to a speed in metres a frame."""
    n = len(xyz_m)
    x, cov = np.zeros((n, 9)), np.zeros((n, 9, 9))
    x[:, :3], cov[:, :3, :3] = xyz_m, cov_m2
    cov[:, 3:6, 3:6] = np.eye(3) * speed_m**2
    cov[:, 6:, 6:] = np.eye(3) * (0.5 * speed_m) ** 2
    return State(x, cov)


def packed(state: State) -> NDArray[np.float32]:
    """(M, 90) of a state."""
    return np.concatenate([state.x, state.cov.reshape(len(state.x), 81)], axis=1).astype(np.float32)


def unpacked(row: NDArray[np.float32]) -> State:
    """The state of (M, 90)."""
    full = row.astype(np.float64)
    cov = full[:, 9:].reshape(-1, 9, 9)
    cov = 0.5 * (cov + np.swapaxes(cov, 1, 2))
    # single precision leaves a covariance whose smallest values are rounding
    scale = np.einsum("mii->mi", cov)
    return State(full[:, :9], cov + 1e-6 * scale[:, :, None] * np.eye(9))
