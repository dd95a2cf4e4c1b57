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
from mocap.calibration.rig import RigCamera, turn
from mocap.calibration.scene import NO_LENGTHS, Adjusted, Free, Lengths, Scene, Sightings
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
    jacobian: Callable[[State], sparse.csr_array],
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
        jacobian: State to their (n, p) derivatives by a step.
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
        rows = jacobian(state)
        heavy = rows.multiply(weight[groups, None]).tocsr()
        normal = (rows.T @ heavy).tocsc()
        gradient = heavy.T @ error
        size = normal.diagonal()
        size = np.maximum(size, 1e-12 * size.max())
        better = False
        while not better and damping < 1e12:
            factor = factorised(normal + sparse.diags_array(damping * size).tocsc())
            trial = retract(state, -factor.solve(gradient))
            new_error = residuals(trial)
            new_cost, new_weight = _loss(new_error, groups, n_groups, robust)
            better = bool(new_cost < cost)
            damping = max(damping / 10, 1e-12) if better else damping * 10
        if not better:
            return Minimum(state, cost, weight, normal, steps, True)
        steps += 1
        settled = cost - new_cost <= tolerance * (cost + 1e-300)
        state, error, cost, weight = trial, new_error, new_cost, new_weight
        if settled:
            return Minimum(state, cost, weight, normal, steps, True)
    return Minimum(state, cost, weight, normal, steps, False)


def factorised(normal: sparse.csc_array) -> SuperLU:
    """LU factors of a symmetric positive definite matrix, in its own order."""
    return splu(normal, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _loss(error: Array, groups: NDArray[np.int64], n_groups: int, robust: float | None) -> tuple[float, Array]:
    squares = np.bincount(groups, weights=error**2, minlength=n_groups)
    if not np.isfinite(squares).all():
        return np.inf, np.ones(n_groups)
    if robust is None:
        return float(squares.sum() / 2), np.ones(n_groups)
    return float(robust**2 * np.log1p(squares / robust**2).sum() / 2), 1 / (1 + squares / robust**2)


def adjust(
    scene: Scene,
    sightings: Sightings,
    *,
    free: Free,
    lengths: Lengths = NO_LENGTHS,
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

    def __init__(self, scene: Scene, sightings: Sightings, free: Free, lengths: Lengths) -> None:
        self.seen, self.free, self.lengths = sightings, free, lengths
        self.n_bodies = len(scene.position_m)
        self.body_size = 6 if free.orientation else 3
        n_cameras = self.n_cameras = len(scene.cameras)
        self.coefficients = [np.flatnonzero(c) for c in free.coefficients or [()] * n_cameras]
        self.n_focal = {"none": 0, "one": 1, "two": 2}[free.focal]
        self.pose = [6 if i != free.fixed else 0 for i in range(n_cameras)]
        lens = [self.n_focal + 2 * free.centre + len(c) for c in self.coefficients]
        self.start = self.n_bodies * self.body_size + np.cumsum([0, *np.add(self.pose, lens)])
        self.mine = [np.flatnonzero(sightings.camera == i) for i in range(n_cameras)]
        n = len(sightings.camera)
        self.groups = np.concatenate([np.repeat(np.arange(n), 2), n + np.arange(len(lengths.first))])

    def solve(self, scene: Scene, sd: float, robust: float | None) -> Minimum[Scene]:
        return minimise(
            scene,
            residuals=lambda s: self.residuals(s, sd),
            jacobian=lambda s: self.jacobian(s, sd),
            retract=self.retract,
            groups=self.groups,
            robust=robust,
            most_steps=60,
        )

    def world(self, scene: Scene, at: NDArray) -> Array:
        body, local = self.seen.body[at], self.seen.local_m[at]
        return np.einsum("nij,nj->ni", scene.rotation[body], local) + scene.position_m[body]

    def error_px(self, scene: Scene) -> Array:
        out = np.empty((len(self.seen.camera), 2))
        for camera, at in zip(scene.cameras, self.mine, strict=True):
            out[at] = self.seen.uv_px[at] - camera.record(self.world(scene, at))
        return out

    def residuals(self, scene: Scene, sd: float) -> Array:
        with np.errstate(all="ignore"):
            return np.concatenate([self.error_px(scene).ravel() / sd, self._length_error(scene)])

    def _length_error(self, scene: Scene) -> Array:
        apart = np.linalg.norm(scene.position_m[self.lengths.first] - scene.position_m[self.lengths.second], axis=-1)
        return (self.lengths.length_m - apart) / self.lengths.sd_m

    def jacobian(self, scene: Scene, sd: float) -> sparse.csr_array:
        rows, columns, values = [], [], []

        def put(row: NDArray, column: NDArray, block: Array) -> None:
            shape = np.broadcast_shapes(row.shape, column.shape, block.shape)
            for store, what in ((rows, row), (columns, column), (values, block)):
                store.append(np.broadcast_to(what, shape).ravel())

        for i, (camera, at) in enumerate(zip(scene.cameras, self.mine, strict=True)):
            if not len(at):
                continue
            row = (2 * at[:, None] + np.arange(2))[:, :, None]
            by_axes, by_lens, axes = self._camera_slopes(i, camera, self.world(scene, at))
            by_world = by_axes @ camera.rotation
            body = [by_world]
            if self.free.orientation:
                arm = self.world(scene, at) - scene.position_m[self.seen.body[at]]
                body.insert(0, -by_world @ skew(arm))
            column = (self.body_size * self.seen.body[at][:, None] + np.arange(self.body_size))[:, None, :]
            put(row, column, -np.concatenate(body, axis=-1) / sd)
            own = [-by_axes @ skew(axes - camera.translation_m), by_axes] if self.pose[i] else []
            block = np.concatenate([*own, by_lens], axis=-1)
            put(row, (self.start[i] + np.arange(block.shape[-1]))[None, None, :], -block / sd)
        if len(self.lengths.first):
            apart = scene.position_m[self.lengths.first] - scene.position_m[self.lengths.second]
            along = apart / np.linalg.norm(apart, axis=-1)[:, None] / self.lengths.sd_m[:, None]
            row = (2 * len(self.seen.camera) + np.arange(len(along)))[:, None]
            shift = self.body_size - 3 + np.arange(3)
            put(row, self.body_size * self.lengths.first[:, None] + shift, -along)
            put(row, self.body_size * self.lengths.second[:, None] + shift, along)
        shape = (2 * len(self.seen.camera) + len(self.lengths.first), int(self.start[-1]))
        return sparse.coo_array(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape
        ).tocsr()

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

    def retract(self, scene: Scene, step: Array) -> Scene:
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
        return Scene(cameras=tuple(cameras), rotation=rotation, position_m=scene.position_m + bodies[:, -3:])

    def _lens(self, i: int, lens: Lens, step: Array) -> Lens:
        f, centre, coefficients = np.array(lens.f_px), np.array(lens.centre_px), lens.coefficients.copy()
        focal, rest = step[: self.n_focal], step[self.n_focal :]
        f = f * (1 + focal[0] / f[0]) if self.n_focal == 1 else f + focal if self.n_focal else f
        if self.free.centre:
            centre, rest = centre + rest[:2], rest[2:]
        coefficients[self.coefficients[i]] += rest
        return type(lens).of(tuple(f), tuple(centre), coefficients)

    def lens_covariance(self, scene: Scene, sd: float, minimum: Minimum[Scene]) -> tuple[Array, ...]:
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
        factor = factorised(minimum.normal + sparse.diags_array(1e-12 * size + 1e-300).tocsc())
        unit = np.zeros((int(self.start[-1]), len(every)))
        unit[every, np.arange(len(every))] = 1.0
        solved = factor.solve(unit)
        found, done = [], 0
        for at in numbers:
            block = solved[at, done : done + len(at)]
            found.append((block + block.T) / 2)
            done += len(at)
        if self.n_cameras == 1 and self.free.orientation and self.n_bodies > 1:
            found[0] *= max(1.0, self._dispersion(scene, sd, minimum, found[0], numbers[0]))
        return tuple(found)

    def _dispersion(
        self, scene: Scene, sd: float, minimum: Minimum[Scene], covariance: Array, at: NDArray[np.int64]
    ) -> float:
        slopes, residual = self.jacobian(scene, sd), self.residuals(scene, sd)
        root = np.sqrt(minimum.weight[self.groups])
        found = expected = 0.0
        for body in range(self.n_bodies):
            rows = np.flatnonzero(np.repeat(self.seen.body == body, 2))
            scaled = slopes[rows].toarray() * root[rows, None]
            lens, pose = scaled[:, at], scaled[:, self.body_size * body : self.body_size * (body + 1)]
            lens = lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0]
            score, information = lens.T @ (root[rows] * residual[rows]), lens.T @ lens
            found += float(score @ covariance @ score)
            expected += float(
                np.trace(covariance @ information) - np.trace(covariance @ information @ covariance @ information)
            )
        return found / expected


def camera_rms(adjusted: Adjusted, sightings: Sightings, n_cameras: int) -> Sequence[float]:
    """Root mean square length of the pixel errors of each camera, everything counted."""
    squares = np.sum(adjusted.error_px**2, axis=-1)
    return [float(np.sqrt(squares[sightings.camera == i].mean())) for i in range(n_cameras)]
