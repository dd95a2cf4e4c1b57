"""Bundle adjustment: cameras, and the bodies that they see, moved together until the pixels fit (Triggs et al. 2000).

A body is a board with known points, whose pose is sought, or a single point, which is a body without orientation.
Bodies come first among the unknowns and cameras last, so that solving in that order is the Schur complement.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from eal.arrays import Array, skew
from mocap.calibration.scene import NO_LENGTHS, Adjusted, Free, KnownLengths, RigCamera, RigScene, Sightings, turn
from mocap.cameras.lens import Lens

State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class Minimum(Generic[State]):
    """Where a search ended.

    Attributes:
        state: The unknowns.
        cost: Half the sum of the robust losses.
        weight: (g,) weight of each group of residuals, 1 where it is believed wholly.
        normal: Weighted normal matrix J^T W J.
        steps: Steps taken.
        converged: False where the steps ran out.
    """

    state: State
    cost: float
    weight: Array
    normal: sparse.csc_array
    steps: int
    converged: bool


def minimise(
    state: State,
    *,
    residuals: Callable[[State], Array],
    normal: Callable[[State, Array, Array], tuple[sparse.csc_array, Array]],
    retract: Callable[[State, Array], State],
    groups: NDArray[np.int64],
    robust: float | None = 3.0,
    most_steps: int = 100,
    tolerance: float = 1e-8,
) -> Minimum[State]:
    """Minimise the sum over groups of rho(|r_g|^2), rho(s) = c^2 log(1 + s / c^2) (Cauchy's loss).

    Each step solves the weighted normal equations (iterated reweighting) with Marquardt's damping, in the given order
    of the unknowns: put those that meet few others first, and the factorisation fills in only where the last ones meet.

    Args:
        state: Where to start.
        residuals: State to (n,) residuals in standard deviations.
        normal: State, (n,) weights W and residuals r to J^T W J, whose whole diagonal is stored, and J^T W r; J is the
            (n, p) derivatives of the residuals by a step.
        retract: State and (p,) step to the next state.
        groups: (n,) number of the group of each residual, from 0; a group (u and v of a pixel) is believed as a whole.
        robust: c; None: plain least squares.
        most_steps: At most so many steps.
        tolerance: Relative decrease of the cost at which to stop.
    """
    n_groups = int(groups.max()) + 1
    error = residuals(state)
    cost, weight = _loss(error, groups, n_groups, robust)
    damping, steps = 1e-4, 0
    while steps < most_steps:
        squared, gradient = normal(state, weight[groups], error)
        size = squared.diagonal()
        size = np.maximum(size, 1e-12 * size.max())
        better = False
        while not better and damping < 1e12:
            trial = retract(state, -factorised(squared, damping * size).solve(gradient))
            new_error = residuals(trial)
            new_cost, new_weight = _loss(new_error, groups, n_groups, robust)
            better = bool(new_cost < cost)
            damping = max(damping / 10, 1e-12) if better else damping * 10
        if not better:
            return Minimum(state, cost, weight, squared, steps, True)
        steps += 1
        settled = cost - new_cost <= tolerance * (cost + 1e-300)
        state, error, cost, weight = trial, new_error, new_cost, new_weight
        if settled:
            return Minimum(state, cost, weight, squared, steps, True)
    return Minimum(state, cost, weight, squared, steps, False)


def factorised(normal: sparse.csc_array, more: Array) -> SuperLU:
    """LU factors of a symmetric positive definite matrix with more on its diagonal, in its own order."""
    added, columns = normal.copy(), np.repeat(np.arange(len(more)), np.diff(normal.indptr))
    added.data[added.indices == columns] += more
    return splu(added, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _loss(error: Array, groups: NDArray[np.int64], n_groups: int, robust: float | None) -> tuple[float, Array]:
    squares = np.bincount(groups, weights=error**2, minlength=n_groups)
    if not np.isfinite(squares).all():
        return np.inf, np.ones(n_groups)
    if robust is None:
        return float(squares.sum() / 2), np.ones(n_groups)
    return float(robust**2 * np.log1p(squares / robust**2).sum() / 2), 1 / (1 + squares / robust**2)


def adjust(
    scene: RigScene,
    sightings: Sightings,
    *,
    free: Free,
    lengths: KnownLengths = NO_LENGTHS,
    robust: float | None = 3.0,
) -> Adjusted:
    """Bundle adjustment with an analytic sparse Jacobian and Cauchy's loss.

    The scale of a pixel error is not known beforehand: each round takes it from the median of the round before.

    Args:
        scene: Where to start; every point in front of its cameras.
        sightings: Pixels.
        free: What may move.
        lengths: Known distances.
        robust: Errors of so many standard deviations get half weight; None: least squares.
    """
    problem = _Problem(scene, sightings, free, lengths)
    n, unknowns = problem.groups.size, int(problem.start[-1])
    taken_up = np.sqrt(n / max(n - unknowns, 1))
    sd, minimum = median_sd(problem.error_px(scene)), None
    for _ in range(3 if robust is not None else 1):  # the scale is taken anew
        minimum = problem.solve(scene, sd, robust)
        scene, last = minimum.state, sd
        sd = taken_up * median_sd(problem.error_px(scene))
        if abs(sd - last) < 0.02 * last:
            break
    assert minimum is not None
    error = problem.error_px(scene)
    return Adjusted(
        scene=scene,
        error_px=error,
        weight=minimum.weight[: len(error)],
        length_weight=minimum.weight[len(error) :],
        sd_px=sd,
        converged=minimum.converged,
        lens_cov=(covariance := problem.lens_covariance(scene, sd, minimum)),
        f_sd_px=np.array([np.sqrt(c[0, 0]) if free.focal != "none" else 0.0 for c in covariance]),
    )


def median_sd(error_px: Array) -> float:
    """Standard deviation of a pixel coordinate from the median length of (N, 2) errors (Rayleigh: sqrt(2 ln 2))."""
    return max(float(np.median(np.hypot(*error_px.T))) / np.sqrt(2 * np.log(2)), 1e-6)


class _Problem:
    """One adjustment: the layout of its unknowns, its residuals and their derivatives."""

    def __init__(self, scene: RigScene, sightings: Sightings, free: Free, lengths: KnownLengths) -> None:
        self.seen, self.free, self.lengths = sightings, free, lengths
        self.n_bodies = len(scene.position_m)
        self.body_size = 6 if free.orientation else 3
        n_cameras = self.n_cameras = len(scene.cameras)
        self.coefficients = [np.flatnonzero(c) for c in free.coefficients or [()] * n_cameras]
        self.n_focal = {"none": 0, "one": 1, "two": 2}[free.focal]
        self.pose = [6 if i != free.fixed else 0 for i in range(n_cameras)]
        lens = [self.n_focal + 2 * free.centre + len(c) for c in self.coefficients]
        self.start = self.n_bodies * self.body_size + np.cumsum([0, *np.add(self.pose, lens)])
        by_body = np.argsort(sightings.body, kind="stable")
        self.mine = [by_body[sightings.camera[by_body] == i] for i in range(n_cameras)]
        n = len(sightings.camera)
        self.groups = np.concatenate([np.repeat(np.arange(n), 2), n + np.arange(len(lengths.first))])
        self._lay_out()

    def _lay_out(self) -> None:
        """Where the blocks of the normal matrix go: its pattern, and the place in it of each number of each block."""
        size, last, rows, columns = self.body_size, int(self.start[-1]), [], []

        def put(row: NDArray, column: NDArray) -> None:
            for store, what in ((rows, row[..., :, None]), (columns, column[..., None, :])):
                store.append(np.broadcast_to(what, (*row.shape, column.shape[-1])).ravel())

        self.first = []
        for i, at in enumerate(self.mine):
            body = self.seen.body[at]
            self.first.append(np.flatnonzero(np.diff(body, prepend=-1)))
            if not len(at):
                continue
            bodies = size * body[self.first[i], None] + np.arange(size)
            own = np.arange(self.start[i], self.start[i + 1])
            camera = np.broadcast_to(own, (len(bodies), len(own)))
            for row, column in ((bodies, bodies), (bodies, camera), (camera, bodies), (own, own)):
                put(row, column)
        self.ends = size * np.stack([self.lengths.first, self.lengths.second], axis=-1)[..., None] + size - 3
        ends = (self.ends + np.arange(3)).reshape(-1, 6)
        put(ends, ends)
        every = np.concatenate(
            [*(last * c + r for r, c in zip(rows, columns, strict=True)), np.arange(last) * (last + 1)]
        )
        found, self.place = np.unique(every, return_inverse=True)
        self.indices = found % last
        self.indptr = np.searchsorted(found, last * np.arange(last + 1))

    def solve(self, scene: RigScene, sd: float, robust: float | None) -> Minimum[RigScene]:
        return minimise(
            scene,
            residuals=lambda s: self.residuals(s, sd),
            normal=lambda s, weight, error: self.normal(s, sd, weight, error),
            retract=self.retract,
            groups=self.groups,
            robust=robust,
            most_steps=60,
        )

    def world(self, scene: RigScene, at: NDArray) -> Array:
        body, local = self.seen.body[at], self.seen.local_m[at]
        return np.einsum("nij,nj->ni", scene.rotation[body], local) + scene.position_m[body]

    def error_px(self, scene: RigScene) -> Array:
        out = np.empty((len(self.seen.camera), 2))
        for camera, at in zip(scene.cameras, self.mine, strict=True):
            out[at] = self.seen.uv_px[at] - camera.record(self.world(scene, at))
        return out

    def residuals(self, scene: RigScene, sd: float) -> Array:
        with np.errstate(all="ignore"):
            return np.concatenate([self.error_px(scene).ravel() / sd, self._length_error(scene)])

    def _length_error(self, scene: RigScene) -> Array:
        apart = np.linalg.norm(scene.position_m[self.lengths.first] - scene.position_m[self.lengths.second], axis=-1)
        return (self.lengths.length_m - apart) / self.lengths.sd_m

    def slopes(self, scene: RigScene, sd: float, i: int) -> tuple[Array, Array]:
        """(n, 2, .) derivatives of the residuals of a camera's sightings by their bodies and by the camera."""
        camera, at = scene.cameras[i], self.mine[i]
        world = self.world(scene, at)
        by_axes, by_lens, axes = self._camera_slopes(i, camera, world)
        by_world = by_axes @ camera.rotation
        body = [by_world]
        if self.free.orientation:
            body.insert(0, -by_world @ skew(world - scene.position_m[self.seen.body[at]]))
        own = [-by_axes @ skew(axes - camera.translation_m), by_axes] if self.pose[i] else []
        return -np.concatenate(body, axis=-1) / sd, -np.concatenate([*own, by_lens], axis=-1) / sd

    def _length_slopes(self, scene: RigScene) -> Array:
        """(K, 6) derivatives of the errors of known distances by the places of their first and second end."""
        apart = scene.position_m[self.lengths.first] - scene.position_m[self.lengths.second]
        along = apart / (np.linalg.norm(apart, axis=-1) * self.lengths.sd_m)[:, None]
        return np.concatenate([-along, along], axis=-1)

    def normal(self, scene: RigScene, sd: float, weight: Array, error: Array) -> tuple[sparse.csc_array, Array]:
        """J^T W J, and J^T W r, added up over each body's sightings by each camera."""
        gradient, blocks, pixels = np.zeros(int(self.start[-1])), [], 2 * len(self.seen.camera)
        for i, (at, first) in enumerate(zip(self.mine, self.first, strict=True)):
            if not len(at):
                continue
            body, own = self.slopes(scene, sd, i)
            heavy, off = weight[:pixels].reshape(-1, 2)[at], error[:pixels].reshape(-1, 2)[at]
            by_body, by_own = body * heavy[..., None], own * heavy[..., None]
            inside = np.add.reduceat(by_body.swapaxes(1, 2) @ body, first)
            across = np.add.reduceat(by_body.swapaxes(1, 2) @ own, first)
            flat = own.reshape(2 * len(own), own.shape[-1])
            blocks += [inside, across, across.swapaxes(1, 2), flat.T @ by_own.reshape(flat.shape)]
            bodies = gradient[: self.n_bodies * self.body_size].reshape(self.n_bodies, -1)
            bodies[self.seen.body[at[first]]] += np.add.reduceat(np.einsum("nki,nk->ni", by_body, off), first)
            gradient[self.start[i] : self.start[i + 1]] = np.einsum("nki,nk->i", by_own, off)
        along = self._length_slopes(scene)
        by_length = along * weight[pixels:, None]
        blocks.append(by_length[:, :, None] * along[:, None, :])
        for end, part in enumerate((slice(3), slice(3, 6))):
            np.add.at(gradient, self.ends[:, end] + np.arange(3), by_length[:, part] * error[pixels:, None])
        values = np.concatenate([block.ravel() for block in blocks])
        data = np.bincount(self.place[: len(values)], weights=values, minlength=len(self.indices))
        shape = (len(gradient), len(gradient))
        return sparse.csc_array((data, self.indices, self.indptr), shape=shape), gradient

    def _camera_slopes(self, i: int, camera: RigCamera, world: Array) -> tuple[Array, Array, Array]:
        """Derivatives of the pixels (n, 2, .) by camera coordinates and by the free numbers of the lens."""
        axes = world @ camera.rotation.T + camera.translation_m
        z = axes[:, 2:]
        xy = axes[:, :2] / z
        by_axes = np.zeros((len(axes), 2, 3))
        by_axes[:, 0, 0] = by_axes[:, 1, 1] = 1 / z[:, 0]
        by_axes[:, :, 2] = -xy / z
        by_axes[:, 0] += camera.shear * by_axes[:, 1]
        xy[:, 0] += camera.shear * xy[:, 1]
        f, bent = np.asarray(camera.lens.f_px), camera.lens.bend(xy)
        by_axes = f[:, None] * (camera.lens.by_xy(xy) @ by_axes)
        parts = []
        if self.n_focal == 1:
            parts.append((f * bent)[:, :, None] / f[0])  # both grow by the same share
        elif self.n_focal == 2:
            parts.append(bent[:, :, None] * np.eye(2))
        if self.free.centre:
            parts.append(np.broadcast_to(np.eye(2), (len(axes), 2, 2)))
        if len(self.coefficients[i]):
            parts.append(f[:, None] * camera.lens.by_coefficients(xy)[..., self.coefficients[i]])
        return by_axes, np.concatenate(parts, axis=-1) if parts else np.zeros((len(axes), 2, 0)), axes

    def retract(self, scene: RigScene, step: Array) -> RigScene:
        bodies = step[: self.n_bodies * self.body_size].reshape(self.n_bodies, self.body_size)
        cameras = []
        for i, camera in enumerate(scene.cameras):
            own = step[self.start[i] : self.start[i + 1]]
            pose, lens = own[: self.pose[i]], own[self.pose[i] :]
            if len(pose):
                camera = replace(
                    camera,
                    rotation=turn(pose[:3]) @ camera.rotation,
                    translation_m=camera.translation_m + pose[3:],
                )
            cameras.append(replace(camera, lens=self._lens(i, camera.lens, lens)) if len(lens) else camera)
        rotation = turn(bodies[:, :3]) @ scene.rotation if self.free.orientation else scene.rotation
        return RigScene(cameras=tuple(cameras), rotation=rotation, position_m=scene.position_m + bodies[:, -3:])

    def _lens(self, i: int, lens: Lens, step: Array) -> Lens:
        f, centre, coefficients = np.array(lens.f_px), np.array(lens.centre_px), lens.coefficients.copy()
        focal, rest = step[: self.n_focal], step[self.n_focal :]
        f = f * (1 + focal[0] / f[0]) if self.n_focal == 1 else f + focal if self.n_focal else f
        if self.free.centre:
            centre, rest = centre + rest[:2], rest[2:]
        coefficients[self.coefficients[i]] += rest
        return type(lens).of(tuple(f), tuple(centre), coefficients)

    def lens_covariance(self, scene: RigScene, sd: float, minimum: Minimum[RigScene]) -> tuple[Array, ...]:
        """Covariance of the free numbers of each lens, from the inverse normal matrix.

        Errors of one image of a board are not independent (a board bends, its corners are blurred alike). With one
        camera C is therefore widened by one factor for all its numbers, tr(C sum_b g_b g_b^T) over what that is for
        independent errors, where it is above 1 (the sandwich of Liang & Zeger 1986, without the bias of few images,
        as Bell & McCaffrey 2002): g_b = L_b^T W r_b is the score of image b (that of its pose is 0 at the minimum),
        and of independent errors g_b has covariance A_b - A_b C A_b, A_b what the image tells of the lens.
        """
        numbers = [np.arange(a + p, b) for a, b, p in zip(self.start[:-1], self.start[1:], self.pose, strict=True)]
        every = np.concatenate(numbers)
        if not len(every):
            return tuple(np.zeros((0, 0)) for _ in numbers)
        size = minimum.normal.diagonal()
        factor = factorised(minimum.normal, 1e-12 * size + 1e-300)
        unit = np.zeros((int(self.start[-1]), len(every)))
        unit[every, np.arange(len(every))] = 1.0
        solved = factor.solve(unit)
        found, done = [], 0
        for at in numbers:
            block = solved[at, done : done + len(at)]
            found.append((block + block.T) / 2)
            done += len(at)
        if self.n_cameras == 1 and self.free.orientation and self.n_bodies > 1:
            found[0] *= max(1.0, self._dispersion(scene, sd, minimum, found[0]))
        return tuple(found)

    def _dispersion(self, scene: RigScene, sd: float, minimum: Minimum[RigScene], covariance: Array) -> float:
        (by_body, by_own), at_body = self.slopes(scene, sd, 0), self.seen.body[self.mine[0]]
        residual = self.residuals(scene, sd).reshape(-1, 2)[self.mine[0]]
        root = np.sqrt(minimum.weight[self.mine[0]])
        found = expected = 0.0
        for rows in np.split(np.arange(len(at_body)), self.first[0][1:]):
            pose, lens = (
                (part[rows] * root[rows, None, None]).reshape(2 * len(rows), -1) for part in (by_body, by_own)
            )
            lens = lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0]
            score, information = lens.T @ (root[rows, None] * residual[rows]).ravel(), lens.T @ lens
            found += float(score @ covariance @ score)
            expected += float(
                np.trace(covariance @ information) - np.trace(covariance @ information @ covariance @ information)
            )
        return found / expected


def camera_rms(adjusted: Adjusted, sightings: Sightings, n_cameras: int) -> Sequence[float]:
    """Root mean square length of the pixel errors of each camera, everything counted."""
    squares = np.sum(adjusted.error_px**2, axis=-1)
    return [float(np.sqrt(squares[sightings.camera == i].mean())) for i in range(n_cameras)]
