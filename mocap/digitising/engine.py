"""The passes over a video: forward while it is decoded, backward over the dots that were kept, and again after clicks.

Forward, each frame's windows follow from the frames before; dots are looked for in these windows only. Backward, they
follow from the frames before and after, so that what a crossing left open is decided by what came after it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras import triangulate
from mocap.cameras.camera import Camera, stacked
from mocap.digitising.clicks import Click, places
from mocap.digitising.dots import DotLook, Grey, Strength, find_dots, look_of, strength_of
from mocap.digitising.errors import RayErrors, lasting_covariance, ray_errors
from mocap.digitising.meeting import Lengths
from mocap.digitising.motion import State, fused, jerk_density, positioned, predicted
from mocap.digitising.naming import MERGED, Named, seen_from, update, window_cov
from mocap.digitising.observer import APART_RADII, Observer, crowding
from mocap.digitising.pose import PoseGaussian, fit_poses
from mocap.digitising.straight import Straightening, straightening_of
from mocap.digitising.texture import MOST_REACH_PX, FollowedTexture, begun, followed
from mocap.digitising.videos import Videos, grey_levels
from mocap.errors import MocapError
from mocap.filters.anatomy import ends_among
from mocap.io.movies import FIRST_PIXEL
from mocap.skeleton import Skeleton

CLICK_SD_PX = 1.0
"""Of a coordinate of a click, where no dot shows it. Chosen, not measured."""
_FIRST_SPEEDS = (0.004, 0.015, 0.05, 0.12)
"""Speeds that are tried at the start, in lengths of the animal a frame: a grid. Chosen, not measured."""
_TRIAL_FRAMES = 3  # for each of them; chosen
_WIDE_PX = 60.0  # chosen, not measured
_PIECES, _PIECE = 10, 20  # that show what dots err by, and the frames of each; chosen
_LEARN_AT = (30, 60, 120, 240, 480, 960)  # frames after which the pose is learned again, twice as many each time

Progress = Callable[[str, float], None]


@dataclass(eq=False)
class Tracks:
    """What is known of T frames of M markers in C cameras; grows while a video is decoded and is mended by clicks.

    Attributes:
        dots: Of each frame (C, K, 3): recorded column and row counted as DLTdv does, and response; NaN: fewer dots.
        ideal: The same places without distortion (C, K, 2).
        crowding: Factors of the dots' standard deviations (C, K): ``observer.crowding``; of textures their own, px.
        owner: (C, K) marker whose texture was followed there; -1: a dot, which may be any marker's.
        dot: (C, T, M) number of the dot that is the marker's; -1: none.
        merged: (C, T, M) True where that dot may be two markers' in one.
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
    owner: list[NDArray[np.int64]]
    dot: NDArray[np.int64]
    merged: NDArray[np.bool_]
    xyz_m: Array
    cov_m2: Array
    rays: NDArray[np.int64]
    doubtful: NDArray[np.bool_]
    forward: NDArray[np.float32]
    backward: NDArray[np.float32]
    density: Array


@dataclass(eq=False)
class Engine:
    """Videos, cameras and clicks, and what follows from them.

    Attributes:
        videos: Opened videos.
        cameras: C cameras of them.
        skeleton: The animal; its M markers are named.
        poses: How the animal moves; None: learned from the film itself as far as it is named.
        clicks: All clicks.
        tracks: What is known so far; empty before ``decode``.
    """

    videos: Videos
    cameras: Sequence[Camera]
    skeleton: Skeleton
    poses: PoseGaussian | None = None
    clicks: list[Click] = field(default_factory=list)
    look: DotLook | None = None

    def __post_init__(self) -> None:
        """Prepare what does not change."""
        self.names = self.skeleton.markers
        self.matrices = stacked(self.cameras)
        sizes = [movie.size_px for movie in self.videos.movies]
        self.straight: list[Straightening] = [
            straightening_of(camera, size) for camera, size in zip(self.cameras, sizes, strict=True)
        ]
        self.sizes = sizes
        shape = (self.videos.n_frames, len(self.names))
        n_cameras = len(self.cameras)
        self.tracks = Tracks(
            dots=[np.full((n_cameras, 0, 3), np.nan)] * shape[0],
            ideal=[np.full((n_cameras, 0, 2), np.nan)] * shape[0],
            crowding=[np.ones((n_cameras, 0))] * shape[0],
            owner=[np.zeros((n_cameras, 0), dtype=np.int64)] * shape[0],
            dot=np.full((n_cameras, *shape), -1),
            merged=np.zeros((n_cameras, *shape), dtype=bool),
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
        self.strength: Strength | None = None
        self.own_poses = self.poses is None
        trunk = [self.names.index(name) for name in self.skeleton.trunk]
        self.trunk = trunk
        ends = np.array(ends_among(self.names, self.skeleton.rigid), dtype=int).reshape(-1, 2)
        lengths = Lengths(ends, np.full(len(ends), np.nan), np.full(len(ends), np.nan))
        self._sort_clicks()
        none = np.zeros(shape[1], dtype=bool)
        self.observer = Observer(self.matrices, lengths, np.zeros(len(ends), dtype=np.int64), none, poses=self.poses)
        self.points: dict[tuple[int, int], FollowedTexture] = {}

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
                "`start`: no marker is clicked in two cameras in one frame: click each marker in two or more videos of "
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
        clicks = [replace(click, frame=0) for click in self.by_frame.get(frame, ())]
        return places(clicks, (len(self.cameras), 1, len(self.names)))[:, 0]

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
        self.by_frame: dict[int, list[Click]] = {}
        for click in self.clicks:
            self.by_frame.setdefault(click.frame, []).append(click)

    def _ideal(self, uv_px: Array) -> Array:
        """(C, ..., 2) ideal pixels of recorded ones."""
        return np.stack([straight(uv) for straight, uv in zip(self.straight, uv_px, strict=True)])

    def _dots(self, pictures: "list[Grey | None]", windows: "Sequence[tuple[int, int, int, int] | None]") -> Array:
        """(C, K, 3) dots of a frame in a window (left, top, right, bottom) of each image; None: in all of it."""
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
        self.tracks.owner[frame] = np.full(dots.shape[:2], -1)

    def _keep_texture(
        self, frame: int, camera: int, marker: int, point: FollowedTexture, *, corrects: bool = False
    ) -> None:
        """Take where a texture was found as a dot that is its marker's alone, in place of one that was less sure.

        ``corrects``: in place of any.
        """
        t = self.tracks
        column = np.flatnonzero(t.owner[frame][camera] == marker)
        if not len(column):
            column = np.flatnonzero((t.owner[frame] == marker).any(axis=0))
        if not len(column):
            ones = ((0, 0), (0, 1))
            t.dots[frame] = np.pad(t.dots[frame], (*ones, (0, 0)), constant_values=np.nan)
            t.ideal[frame] = np.pad(t.ideal[frame], (*ones, (0, 0)), constant_values=np.nan)
            t.crowding[frame] = np.pad(t.crowding[frame], ones, constant_values=np.inf)
            t.owner[frame] = np.pad(t.owner[frame], ones, constant_values=marker)
            column = np.array([t.owner[frame].shape[1] - 1])
        k = int(column[0])
        if corrects or point.sd_px < t.crowding[frame][camera, k]:
            uv = point.uv + FIRST_PIXEL
            t.dots[frame][camera, k] = *uv, 0.0
            t.ideal[frame][camera, k] = self.straight[camera](uv)
            t.crowding[frame][camera, k] = point.sd_px

    def _forget_texture(self, camera: int, marker: int) -> list[int]:
        """Drop where a marker's texture was found in a video; the frames that it was found in."""
        t, out = self.tracks, []
        for frame in range(self.videos.n_frames):
            k = t.owner[frame][camera] == marker
            if np.isfinite(t.dots[frame][camera, k, 0]).any():
                t.dots[frame][camera, k], t.ideal[frame][camera, k] = np.nan, np.nan
                t.crowding[frame][camera, k] = np.inf
                out.append(frame)
        return out

    def _sd_px(self, frame: int) -> Array:
        """(C, K) standard deviations of the coordinates of dots and textures."""
        factor = self.tracks.crowding[frame]
        return np.where(self.tracks.owner[frame] < 0, self.observer.sd_px * factor, factor)

    def _windows(self, state: State) -> "list[tuple[int, int, int, int] | None]":
        """The part of each image in which markers are expected; None: anywhere."""
        uv, jacobian = seen_from(self.matrices, state.xyz_m)
        s = window_cov(jacobian, state.cov_m2, self.observer.sd_px)
        reach = 4.0 * np.sqrt(np.maximum(s[..., 0, 0], s[..., 1, 1]))
        margin = 12.0 + (4.0 * self.look.radius_px if self.look else 0.0)
        out: list[tuple[int, int, int, int] | None] = []
        for c, (width, height) in enumerate(self.sizes):
            predicted = np.isfinite(uv[c, :, 0]) & (reach[c] < 4 * _WIDE_PX)
            if predicted.sum() < 0.5 * len(predicted):
                out.append(None)
                continue
            lens = self.cameras[c].lens
            # what is lost is near the others
            seen = np.isfinite(uv[c, :, 0])
            at = uv[c, seen] if lens is None else lens.distort(uv[c, seen])
            at = at - FIRST_PIXEL
            r = np.minimum(reach[c, seen], 4 * _WIDE_PX)[:, None] + margin
            low, high = (at - r).min(axis=0), (at + r).max(axis=0)
            left, top = (int(np.clip(x, 0, n - 1)) for x, n in zip(low, (width, height), strict=True))
            right, bottom = (int(np.clip(x, 1, n)) for x, n in zip(high, (width, height), strict=True))
            out.append((left, top, max(right, left + 1), max(bottom, top + 1)))
        return out

    def _observed(self, frame: int, state: State) -> tuple[Named, State]:
        """Name the dots of a frame about a prediction; the state after it."""
        t = self.tracks
        clicked, barred = self._ideal(self._clicked(frame)), self._barred(frame)
        return self.observer.observed(
            t.ideal[frame],
            self._sd_px(frame),
            clicked,
            state,
            owner=t.owner[frame],
            barred=barred,
            faint=self._faint(frame),
        )

    def _faint(self, frame: int) -> Array | None:
        """(C, K) what the strengths of dots cost that are weaker than those of markers; of textures nothing."""
        if self.strength is None:
            return None
        found = self.tracks.dots[frame][..., 2].astype(np.float64)
        return np.where(self.tracks.owner[frame] < 0, self.strength.faintness(found), 0.0)

    def decode(self, *, progress: Progress = lambda _stage, _share: None) -> None:
        """Decode the videos once: forward pass and dots; then the backward pass.

        Raises:
            MocapError: there are no clicks to begin with.
        """
        start, xyz, cov = self.first_points()
        n = self.videos.n_frames
        if self.look is None:
            self.look = self._look(start)
        if self.look is not None:
            self.observer.radius_px = self.look.radius_px
            n_cameras = len(self.cameras)
            usual = np.full(n_cameras, np.log(4 * self.look.least))
            self.strength = Strength(log_median=usual, log_sd=np.full(n_cameras, 0.25))  # before it is measured
        state: State | None = None
        waiting: list[int] = []
        for frame, pictures in enumerate(self.videos.pictures()):
            progress("finding and naming dots", frame / n)
            if state is None:
                self._keep(frame, self._dots(pictures, [None] * len(pictures)))
                self._follow(frame, pictures, None)
                if frame >= start:
                    waiting.append(frame)
                if len(waiting) > _TRIAL_FRAMES or (waiting and frame == n - 1):
                    state = self._started(start, xyz, cov)
                    for late in waiting:
                        state = self._forward(late, state)
                continue
            ahead = self._ahead(state)
            self._keep(frame, self._dots(pictures, self._windows(ahead)))
            self._follow(frame, pictures, ahead)
            state = self._forward(frame, state)
        progress("finding and naming dots", 1.0)
        # frames before the first clicks are named backward only, with the noise as it was found after these
        self.tracks.density[:start] = np.max(self.tracks.density[start : start + 30], axis=0)
        self._estimate_sd(start)
        if start and self.observer.textured.any():
            self._follow_from([c for c in self.by_frame[start] if self.observer.textured[c.marker]], ahead=False)
        self._backward(n - 1, 0, None, progress=progress)
        # once more over the dots, with the poses of the whole video and the noise as it was found
        self._estimate_sd(start)
        if self.own_poses:
            self.learn_poses()
        self._limit_density()
        self.again(progress=progress)

    def _look(self, start: int) -> DotLook | None:
        """What dots look like where markers were clicked; markers whose clicks mostly show none are textures."""
        pictures, places, markers = [], [], []
        for frame in (start, *sorted(set(self.by_frame) - {start})[:8]):
            uv = self._clicked(frame)
            for c in range(len(self.cameras)):
                there = np.flatnonzero(np.isfinite(uv[c, :, 0]))
                picture = self.videos.picture(c, frame) if len(there) else None
                if picture is not None:
                    pictures.append(picture)
                    places.append(uv[c, there] - FIRST_PIXEL)
                    markers.append(there)
        n = len(self.names)
        dots, clicks = np.zeros(n), np.zeros(n)
        found = look_of(pictures, places)
        for picture, uv, which in zip(pictures, places, markers, strict=True):
            clicks[which] += 1
            if found is not None:
                strong = find_dots(picture, replace(found, least=2 * found.least))
                away = np.linalg.norm(strong[:, None, :2] - uv, axis=-1)
                dots[which] += (away < max(2.5, found.radius_px)).any(axis=0)
        self.observer.textured = (clicks > 0) & (dots < 0.5 * clicks)
        return found

    def _follow(self, frame: int, pictures: "list[Grey | None]", ahead: State | None) -> None:
        """Follow textures into a frame from the one before, or begin with its clicks."""
        textured = self.observer.textured
        if not textured.any():
            return
        for click in self.by_frame.get(frame, ()):
            picture = pictures[click.camera]
            if textured[click.marker] and click.uv_px is not None and picture is not None:
                self.points[click.camera, click.marker] = begun(picture, np.array(click.uv_px) - FIRST_PIXEL)
        if ahead is not None:
            uv, jacobian = seen_from(self.matrices, ahead.xyz_m)
            reach = 3 * np.sqrt(np.max(np.einsum("cmii->cmi", window_cov(jacobian, ahead.cov_m2, 0.0)), axis=2))
            uv = self._recorded(uv) - FIRST_PIXEL
        for (c, m), last in self.points.items():
            picture = pictures[c]
            clicked = any((k.camera, k.marker) == (c, m) and k.uv_px is not None for k in self.by_frame.get(frame, ()))
            if picture is None:
                continue
            point = last
            if not clicked:
                guess, far = (last.uv, MOST_REACH_PX) if ahead is None else (uv[c, m], float(reach[c, m]))
                point = followed(last, picture, guess, far)
            self.points[c, m] = point
            if point.before is not None:
                self._keep_texture(frame, c, m, point)

    def _recorded(self, uv: Array) -> Array:
        """(C, M, 2) pixels as recorded of ideal ones."""
        return np.stack(
            [
                at if camera.lens is None else camera.lens.distort(at)
                for camera, at in zip(self.cameras, uv, strict=True)
            ]
        )

    def _follow_from(self, clicks: Sequence[Click], *, ahead: bool) -> list[int]:
        """Follow textures from clicks into the frames after them (or before), while they are found; these frames."""
        t, out = self.tracks, []
        for click in clicks:
            if click.uv_px is None or not self.observer.textured[click.marker]:
                continue
            picture = self.videos.picture(click.camera, click.frame)
            if picture is None:
                continue
            c, m = click.camera, click.marker
            corrects = sum((k.camera, k.frame, k.marker) == (c, click.frame, m) for k in self.clicks) > 1
            point, lost = begun(picture, np.array(click.uv_px) - FIRST_PIXEL), 0
            for frame, picture in self._one_film(c, click.frame, ahead):
                guess, far = point.uv, MOST_REACH_PX
                if np.isfinite(t.xyz_m[frame, m]).all():
                    uv, jacobian = seen_from(self.matrices, t.xyz_m[frame, m][None])
                    spread = window_cov(jacobian, t.cov_m2[frame, m][None], 0.0)[c, 0]
                    guess = self._recorded(uv)[c, 0] - FIRST_PIXEL
                    far = 3 * float(np.sqrt(max(spread[0, 0], spread[1, 1])))
                point = followed(point, picture, guess, far)
                lost = 0 if point.before is not None else lost + 1
                # not found in more frames than these, a texture is not looked for any more
                if lost > 10 or any((k.camera, k.marker) == (c, m) for k in self.by_frame.get(frame, ())):
                    break
                if point.before is not None:
                    self._keep_texture(frame, c, m, point, corrects=corrects)
                    out.append(frame)
        return out

    def _one_film(self, camera: int, frame: int, ahead: bool) -> "Iterator[tuple[int, Grey]]":
        """Frames and images of one video after a frame, or before it from the last to the first; a few in memory."""
        offset = self.videos.offset_frames[camera]
        step = _PIECE if ahead else -_PIECE
        begin = frame + 1 if ahead else frame
        while 0 < begin <= self.videos.n_frames - ahead:
            block = np.arange(*sorted((begin, np.clip(begin + step, 0, self.videos.n_frames))))
            found = self.videos.movies[camera].frames(block + offset)
            pictures = [(int(at), grey_levels(x)) for at, x in zip(block, found, strict=True) if x is not None]
            yield from pictures if ahead else pictures[::-1]
            begin += step

    def _started(self, start: int, xyz: Array, cov: Array) -> State:
        """The state before the first clicked frame's dots, at the speed with which most can be named."""
        best: tuple[float, State, Array] | None = None
        for share in _FIRST_SPEEDS:
            speed = share * self.observer.length_m
            density = np.full(len(xyz), (0.3 * speed) ** 2)
            state = first_state(xyz, cov, speed)
            self.density = density
            trial, rays = state, 0.0
            for frame in range(start, min(start + _TRIAL_FRAMES, self.videos.n_frames)):
                if frame > start:
                    trial = self._ahead(trial)
                named, trial = self._observed(frame, trial)
                rays += float(np.sum(named.rays >= 2)) if frame > start else 0.0
            if best is None or rays > 1.02 * best[0]:
                best = rays, state, density
        if best is None:
            raise MocapError("the videos have no frame in step: check `offset_frames`")
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
        # follow how much markers surprise the model: fast up, slowly down, and up while a marker is not found
        finite = np.isfinite(named.surprise)
        ratio = named.surprise[finite]
        self.density[finite] *= np.minimum(1 + np.where(ratio > 1, 0.15, 0.04) * (ratio - 1), 3.0)
        self.density[named.rays == 0] *= 1.3
        self.most = np.maximum(self.most, np.where(finite, self.density, 0.0))
        floor = 0.05 * np.maximum(self.most, 0.3 * np.quantile(self.most, 0.9))
        self.density = np.clip(self.density, np.maximum(floor, (1e-5 * self.observer.length_m) ** 2), self.fastest)
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
        x, cov = ahead.mean.copy(), ahead.cov.copy()
        middle = x[~lost, :3].mean(axis=0) if not lost.all() else np.nan_to_num(x[:, :3]).mean(axis=0)
        near = np.linalg.norm(x[:, :3] - middle, axis=1) < self.observer.length_m
        x[lost & ~near, :3], x[lost, 3:] = middle, 0.0
        spread = self.observer.length_m * np.repeat([0.25, 0.05, 0.02], 3)
        cov[lost] = np.diag(spread**2)
        return State(x, cov)

    def _limit_density(self) -> None:
        """Limit the density of the jerk by what the named positions show: a marker that was lost leaves no trace."""
        t = self.tracks
        xyz = np.where((t.rays >= 2)[..., None], t.xyz_m, np.nan)
        found = jerk_density(xyz, np.trace(t.cov_m2, axis1=2, axis2=3))
        if np.isfinite(found).any():
            found = np.where(np.isfinite(found), found, np.nanmedian(found))
            # feet are at rest and then swing: the jerk of a marker's fast times counts at all times
            # jerk is not white: its density is at most a hundred times that which third differences have
            t.density[:] = np.minimum(t.density, 100.0 * np.maximum(found, np.quantile(found, 0.9, axis=0)))

    def _take(self, frame: int, named: Named) -> None:
        t = self.tracks
        t.dot[:, frame], t.xyz_m[frame], t.cov_m2[frame] = named.dot, named.xyz_m, named.cov_m2
        t.merged[:, frame] = named.merged
        t.rays[frame], t.doubtful[frame] = named.rays, named.doubtful

    def _backward(
        self,
        last: int,
        first: int,
        state: State | None,
        *,
        settled: int = 0,
        progress: Progress = lambda _stage, _share: None,
    ) -> int:
        """From ``last`` to ``first``, windows of the frames on both sides; ``state``: of the frame after ``last``.

        Before frame ``settled`` it ends where it comes to what it was; returns the frame that it ended with.
        """
        for frame in range(last, first - 1, -1):
            progress("naming dots again with what came after", (last - frame) / max(last - first + 1, 1))
            self.density = self.tracks.density[min(frame + 1, last)]
            ahead = None if state is None else self._ahead(state)
            forward = self.tracks.forward[frame]
            complete = np.isfinite(forward[:, 0]).all()
            if ahead is None:
                if not complete:
                    continue
                ahead = unpacked(forward).turned().looser(1e4)
            if frame < settled and _alike(ahead, unpacked(self.tracks.backward[frame])):
                return frame + 1
            self.tracks.backward[frame] = packed(ahead)
            both = fused(unpacked(forward), ahead.turned()) if complete else ahead.turned()
            named, _ = self._observed(frame, both)
            # the dots that both sides named, seen from the frames after alone
            seen = self._places(frame, named)
            prior = np.linalg.inv(ahead.cov_m2)
            sd = self._deviations(frame, named)
            self._take(frame, named)
            self._state(frame, named, both, seen, sd)
            xyz, cov = update(self.matrices, seen, sd, ahead.xyz_m, ahead.cov_m2, prior)
            state = positioned(ahead, xyz, cov, named.rays > 0)
        progress("naming dots again with what came after", 1.0)
        return first

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
        cov[met] = lasting_covariance(self.errors, used, sd_px, named.cov_m2)[met]

    def _places(self, frame: int, named: Named) -> Array:
        """(C, M, 2) ideal pixels of named dots and clicks; NaN: none."""
        ideal = self.tracks.ideal[frame]
        camera = np.arange(len(self.cameras))[:, None]
        if not ideal.shape[1]:
            out = np.full((*named.dot.shape, 2), np.nan)
        else:
            out = np.where((named.dot >= 0)[..., None], ideal[camera, np.maximum(named.dot, 0)], np.nan)
        _, clicks = self.observer.dots_of_clicks(ideal, self._ideal(self._clicked(frame)))
        return np.where(np.isfinite(clicks), clicks, out)

    def _deviations(self, frame: int, named: Named) -> Array:
        """(C, M) standard deviations of the places of named dots."""
        sd = self._sd_px(frame)
        if not sd.shape[1]:
            return np.ones(named.dot.shape)
        camera = np.arange(len(self.cameras))[:, None]
        sd = np.where(named.dot >= 0, sd[camera, np.maximum(named.dot, 0)], CLICK_SD_PX)
        return np.where(named.merged, np.maximum(sd, MERGED * APART_RADII * self.observer.radius_px), sd)

    def rerun(self, clicks: Iterable[Click], *, within: bool = False) -> tuple[int, int]:
        """Take more clicks; only frames that they change are named again. Returns the first and last of these.

        ``within``: only the frames of the clicks, from the first to the last.
        """
        new = list(clicks)
        self.clicks += new
        self._sort_clicks()
        changed = {click.frame for click in new}
        if not within and any(self.observer.textured[click.marker] for click in new):
            self._all_about(sorted(changed), within)  # a wrong click is not to lead the search
            for ahead in (True, False):
                changed.update(self._follow_from(new, ahead=ahead))
        return self._all_about(sorted(changed), within)

    def undo(self, count: int = 1) -> list[Click]:
        """Take the last clicks back; the frames that they changed are named again."""
        kept = max(len(self.clicks) - count, 0)
        taken = self.clicks[kept:]
        del self.clicks[kept:]
        self._sort_clicks()
        if taken:
            changed = {click.frame for click in taken}
            for camera, marker in {(k.camera, k.marker) for k in taken if self.observer.textured[k.marker]}:
                changed.update(self._forget_texture(camera, marker))
                left = [k for k in self.clicks if (k.camera, k.marker) == (camera, marker)]
                for ahead in (True, False):
                    changed.update(self._follow_from(left, ahead=ahead))
            self._all_about(sorted(changed), False)
        return taken

    def _all_about(self, changed: Sequence[int], within: bool) -> tuple[int, int]:
        """Name frames again that were changed, and what that changes, each group of neighbours on its own."""
        frames = np.asarray(changed)
        # clicks farther apart are named one after the other
        groups = [frames] if within else np.split(frames, np.flatnonzero(np.diff(frames) > 20) + 1)
        ranges = [self._about(int(group[0]), int(group[-1]), within) for group in groups]
        return min(first for first, _ in ranges), max(last for _, last in ranges)

    def _about(self, first: int, last: int, within: bool) -> tuple[int, int]:
        """Both passes from a range of frames on, until they come to what they were."""
        t, n = self.tracks, self.videos.n_frames
        begun = np.flatnonzero(np.isfinite(np.asarray(t.forward)[:, 0, 0]))
        begin = max(first, int(begun[0])) if len(begun) else n
        state = unpacked(t.forward[begin]) if begin < n else None
        end = last
        for frame in range(begin, n):
            if state is None:
                break
            self.density = t.density[frame]
            ahead = state if frame == begin else self._ahead(state)
            if frame > last and (within or _alike(ahead, unpacked(t.forward[frame]))):
                break
            t.forward[frame] = packed(ahead)
            _, state = self._observed(frame, ahead)
            end = max(frame, end)
        after = None
        if end + 1 < n:
            ahead = unpacked(t.backward[end + 1])
            after_rays, merged = t.rays[end + 1], t.merged[:, end + 1]
            dots = Named(
                t.dot[:, end + 1], ahead.xyz_m, ahead.cov_m2, t.doubtful[end + 1], ahead.mean[:, 0], after_rays, merged
            )
            seen = self._places(end + 1, dots)
            sd = self._deviations(end + 1, dots)
            xyz, cov = update(self.matrices, seen, sd, ahead.xyz_m, ahead.cov_m2, np.linalg.inv(ahead.cov_m2))
            after = positioned(ahead, xyz, cov, t.rays[end + 1] > 0)
        return self._backward(end, first if within else 0, after, settled=first), end

    def again(self, *, progress: Progress = lambda _stage, _share: None) -> None:
        """Both passes over the dots that were kept, with the poses and the noise as they are known now."""
        begun = np.isfinite(np.asarray(self.tracks.forward)[:, 0, 0])
        if not begun.any():
            return
        start = int(np.argmax(begun))
        state = unpacked(self.tracks.forward[start])
        n, stage = self.videos.n_frames, "once more with all poses"
        for frame in range(start, n):
            progress(stage, 0.5 * (frame - start) / (n - start))
            self.density = self.tracks.density[frame]
            ahead = state if frame == start else self._ahead(state)
            self.tracks.forward[frame] = packed(ahead)
            named, state = self._observed(frame, ahead)
            self._take(frame, named)
        self._backward(n - 1, 0, None, progress=lambda _, share: progress(stage, 0.5 + 0.5 * share))

    def learn_poses(self, end: int | None = None) -> None:
        """Learn the pose from the frames that are named so far."""
        t = self.tracks
        measured = np.where((t.rays[:end] >= 2)[..., None], t.xyz_m[:end], np.nan)
        found = fit_poses(measured, self.trunk, least_sd_m=1e-3 * self.observer.length_m)
        self.poses = self.observer.poses = found or self.poses

    def _estimate_sd(self, first: int) -> None:
        """Standard deviation of a dot, from how the rays of named dots meet, and what of their errors lasts."""
        camera = np.arange(len(self.cameras))[:, None]
        n = self.videos.n_frames
        # pieces of frames that follow one another
        begins = np.unique(np.linspace(first, max(first, n - _PIECE), _PIECES).astype(int))
        frames = np.unique(np.minimum(begins[:, None] + np.arange(_PIECE), n - 1))
        uv = np.full((len(self.cameras), len(frames), len(self.names), 2), np.nan)
        found = np.full(uv.shape[:3], np.nan)
        for row, frame in enumerate(frames.tolist()):
            dot, ideal = self.tracks.dot[:, frame], self.tracks.ideal[frame]
            if ideal.shape[1]:
                uv[:, row] = np.where((dot >= 0)[..., None], ideal[camera, np.maximum(dot, 0)], np.nan)
                strength = self.tracks.dots[frame][camera, np.maximum(dot, 0), 2]
                found[:, row] = np.where((dot >= 0) & ~self.observer.textured, strength, np.nan)
        if self.strength is not None:
            self.strength = strength_of(found.reshape(len(found), -1), self.strength)
        textured = self.observer.textured
        skin = uv[:, :, textured]
        uv[:, :, textured] = np.nan
        with suppress(ValueError):  # no marker with a dot is seen by two cameras
            found = triangulate.apparent_sd(self.matrices, uv)
            if np.isfinite(found):
                self.observer.sd_px = float(np.clip(found, 0.15, 2.0))
                self.errors = ray_errors(self.matrices, uv, sd_px=self.observer.sd_px)
        if textured.any():
            self._texture_errors(skin, frames)

    def _texture_errors(self, uv: Array, frames: NDArray[np.int64]) -> None:
        """Errors of textures last: what a template misses by is missed again.

        Their size is that of how rays meet, but at least 1.5 of what is stated of each: what passes by
        pulls a point in all videos alike.
        """
        textured, n = self.observer.textured, len(self.names)
        own = [self._sd_px(frame)[(self.tracks.owner[frame] >= 0)] for frame in frames.tolist()]
        own_sd = np.concatenate(own)
        scale = 1.5
        with suppress(ValueError):  # no texture is seen by two cameras
            usual = float(np.median(own_sd[np.isfinite(own_sd)])) if np.isfinite(own_sd).any() else np.nan
            found = triangulate.apparent_sd(self.matrices, uv) / usual
            scale = max(found, scale) if np.isfinite(found) else scale
        errors = self.errors or RayErrors(sd_px=self.observer.sd_px, variance=np.ones(n), lasting=np.zeros(n))
        self.errors = replace(
            errors,
            variance=np.where(textured, scale**2, errors.variance),
            lasting=np.where(textured, 1.0, errors.lasting),
        )


def first_state(xyz_m: Array, cov_m2: Array, speed_m: float) -> State:
    """A state whose velocities are not known, up to a speed in metres a frame."""
    n = len(xyz_m)
    x, cov = np.zeros((n, 9)), np.zeros((n, 9, 9))
    x[:, :3], cov[:, :3, :3] = xyz_m, cov_m2
    cov[:, 3:6, 3:6] = np.eye(3) * speed_m**2
    cov[:, 6:, 6:] = np.eye(3) * (0.5 * speed_m) ** 2
    return State(x, cov)


def _alike(a: State, b: State) -> bool:
    """Whether two states of all markers are the same, to a twentieth of their standard deviations."""
    sd_a, sd_b = (np.sqrt(np.einsum("mii->mi", state.cov)) for state in (a, b))
    return bool((np.abs(a.mean - b.mean) < 0.05 * sd_b).all() and (np.abs(sd_a - sd_b) < 0.05 * sd_b).all())


def packed(state: State) -> NDArray[np.float32]:
    """(M, 90) of a state."""
    return np.concatenate([state.mean, state.cov.reshape(len(state.mean), 81)], axis=1).astype(np.float32)


def unpacked(row: NDArray[np.float32]) -> State:
    """The state of (M, 90)."""
    full = row.astype(np.float64)
    cov = full[:, 9:].reshape(-1, 9, 9)
    cov = 0.5 * (cov + np.swapaxes(cov, 1, 2))
    # single precision leaves a covariance whose smallest values are rounding
    scale = np.einsum("mii->mi", cov)
    return State(full[:, :9], cov + 1e-6 * scale[:, :, None] * np.eye(9))
