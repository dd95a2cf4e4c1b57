"""Where a search for poses begins: poses of trials, and their mirror images, that look like what a camera saw."""

from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.errors import FilterError
from mocap.filters.one_view import Poses, Recorded, Views
from mocap.filters.pose_prior import LEAST_MARKERS, PosePrior
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from eal.arrays import Array


def looks_like(prior: PosePrior, views: Views, camera: int, frame: int) -> Poses | None:
    """The starts of one frame: trial poses by scaled orthography, and their mirror images; None: too little is seen.

    Seen from afar a pose Y is at q = s R Y + t in the plane of the image. s R is the affine map that fits best,
    brought to the nearest rotation (as Bregler, Hertzmann & Biermann 2000). Turned about to lie as far behind the
    plane as it was before it, and reflected in its own flat side, a pose looks almost the same (Necker's reversal).
    """
    seen = np.flatnonzero(views.seen[camera, frame])
    if len(seen) < LEAST_MARKERS:
        return None
    inverse = np.linalg.inv(views.matrices[camera, :, :3])
    centre = -inverse @ views.matrices[camera, :, 3]
    rays = np.column_stack([views.uv_px[camera, frame, seen], np.ones(len(seen))]) @ inverse.T
    axis = rays.mean(axis=0)
    axis /= np.linalg.norm(axis)
    across = np.linalg.svd(axis[None])[2][1:]
    ahead = rays @ axis
    q = rays @ across.T / ahead[:, None]
    # 200 poses of the trials are tried in each frame
    chosen = prior.shapes[np.linspace(0, len(prior.shapes) - 1, min(200, len(prior.shapes))).astype(int)]
    pose = (prior.mean + chosen @ prior.basis.T).reshape(len(chosen), -1, 3)[:, seen]
    middle = pose.mean(axis=1, keepdims=True)
    flat, target = pose - middle, q - q.mean(axis=0)
    spread = np.swapaxes(flat, 1, 2) @ flat
    ridge = 1e-3 * np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    affine = np.swapaxes(np.linalg.solve(spread + ridge, np.swapaxes(flat, 1, 2) @ target), 1, 2)
    u, _, vt = np.linalg.svd(affine, full_matrices=False)
    rows = u @ vt
    turned = flat @ np.swapaxes(rows, 1, 2)
    scale = np.maximum(np.sum(turned * target, axis=(1, 2)) / np.sum(turned**2, axis=(1, 2)), 1e-9)
    missed = np.sum((target - scale[:, None, None] * turned) ** 2, axis=(1, 2)) / scale**2
    best = _apart(chosen, missed)
    frame_axes = np.concatenate([across, axis[None]])
    third = np.cross(rows[:, 0], rows[:, 1]) * np.linalg.det(frame_axes)
    own = np.concatenate([rows, third[:, None]], axis=1)[best]
    normal = np.linalg.svd(flat[best])[2][:, -1]
    about = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]
    both = np.concatenate([own, np.diag([1.0, 1.0, -1.0]) @ own @ about])
    rotation = frame_axes.T @ both
    twice = np.concatenate([best, best])
    depth = 1 / scale[twice]
    seat = centre + depth[:, None] * (axis + q.mean(axis=0) @ across)
    position = seat - np.einsum("sij,sj->si", rotation, middle[twice, 0])
    return Poses(position_m=position, rotation=rotation, z=chosen[twice])


def _apart(shapes: Array, missed: Array) -> NDArray[np.int64]:
    """Shapes that fit best and differ from each other by a third of what shapes differ by."""
    least = np.sqrt(np.sum(shapes.var(axis=0))) / 3
    kept: list[int] = []
    for k in np.argsort(missed):
        if all(np.linalg.norm(shapes[k] - shapes[other]) > least for other in kept):
            kept.append(int(k))
        if len(kept) == 4:  # so many go on, with their mirror images
            break
    return np.array(kept)


def settled(recorded: Recorded, at: Poses, *, placed: bool = False) -> tuple[Poses, Array]:
    """Starts that each fit their frame, by damped Newton steps with the Gaussian of poses; and what each costs.

    Args:
        recorded: What was seen, a frame for each start.
        at: The starts.
        placed: Their shapes stay as they are.
    """
    usual = replace(recorded, prior=replace(recorded.prior, hold=recorded.prior.gaussian()))
    n = 6 if placed else 6 + recorded.prior.rank
    damping = np.full(len(at.z), 1e-2)
    cost = usual.apart(at)
    for _ in range(20):  # the trajectory goes on from there
        slope, form = usual.local(at)
        slope, form = slope[:, :n], form[:, :n, :n]
        diagonal = np.einsum("tii->ti", form)
        damped = form + (damping[:, None] * diagonal + 1e-9)[:, :, None] * np.eye(n)
        step = -np.linalg.solve(damped, slope[..., None])[..., 0]
        there = usual.moved(at, np.pad(step, ((0, 0), (0, 6 + recorded.prior.rank - n))))
        new = usual.apart(there)
        better = new < cost
        at = Poses(
            position_m=np.where(better[:, None], there.position_m, at.position_m),
            rotation=np.where(better[:, None, None], there.rotation, at.rotation),
            z=np.where(better[:, None], there.z, at.z),
        )
        cost = np.where(better, new, cost)
        damping = np.where(better, 0.2 * damping, 10 * damping).clip(1e-6, 1e6)
    return at, recorded.apart(at)


@dataclass(frozen=True, eq=False)
class Starts:
    """Starts of some frames.

    Attributes:
        frames: (F,) which.
        poses: Those of each.
    """

    frames: NDArray[np.int64]
    poses: list[Poses]

    @property
    def position_m(self) -> Array:
        """(3,) the median place of all."""
        return np.median(np.concatenate([p.position_m for p in self.poses]), axis=0)


def starts_of(prior: PosePrior, views: Views, *, every: int) -> Starts:
    """Starts of every so many frames, as the camera that sees most has them.

    Raises:
        FilterError: no frame shows enough markers.
    """
    camera = views.main
    found = {frame: looks_like(prior, views, camera, frame) for frame in range(0, views.uv_px.shape[1], every)}
    some = {frame: one for frame, one in found.items() if one is not None}
    if not some:
        raise FilterError(
            f"no frame shows {LEAST_MARKERS} markers of the model to one camera: its pose cannot be found"
        )
    return Starts(np.array(list(some)), list(some.values()))


def first_poses(recorded: Recorded, found: Starts) -> tuple[Poses, Poses]:
    """The likeliest path through starts of some frames, and the likeliest through those that are turned over from it.

    All starts of a frame are kept until the path through all frames decides among them (Viterbi 1967), by what each
    costs and by how far trials move in that time.
    """
    prior, views, frames = recorded.prior, recorded.views, found.frames
    count = np.array([len(one.z) for one in found.poses])
    there = replace(recorded, views=views.frames(np.repeat(frames, count)))
    starts, cost = settled(there, _joined(found.poses))
    cuts = np.cumsum(count)
    vague = _vague(there, starts)
    path = _path(prior, starts, vague, cost, cuts, frames)
    twin = np.concatenate([(np.arange(k) + k // 2) % k for k in count]) + np.repeat(cuts - count, count)
    mirrored = _turned_over(recorded, starts, starts.of(np.repeat(path, count)))
    mirrored[twin[path]] = True  # so that each frame has one
    other = _path(prior, starts, vague, np.where(mirrored, cost, np.inf), cuts, frames)
    steps = views.uv_px.shape[1]
    return between(starts.of(path), frames, steps), between(starts.of(other), frames, steps)


def _vague(there: Recorded, at: Poses) -> Array:
    """(S, 3, 3) how uncertain the place is that each start has in its own frame: metres along the line of sight."""
    form = there.local(at)[1][:, :-1, :-1]
    scale = np.sqrt(np.maximum(np.einsum("sii->si", form), 1e-300))
    unit = form / scale[:, :, None] / scale[:, None] + 1e-9 * np.eye(form.shape[1])
    return np.linalg.inv(unit)[:, :3, :3] / scale[:, :3, None] / scale[:, None, :3]


def _turned_over(recorded: Recorded, at: Poses, path: Poses) -> NDArray[np.bool_]:
    """(S,) whether each pose is turned nearer to the mirror image of its pose of the path than to that.

    The mirror image is as the camera that sees most has it: reflected along the line of sight, and in the flat side of
    the mean body. A wing that is raised is lowered there: starts of all shapes are asked.
    """
    matrix = recorded.views.matrices[recorded.views.main]
    axis = path.position_m + np.linalg.solve(matrix[:, :3], matrix[:, 3])
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    mean = recorded.prior.mean.reshape(-1, 3)
    normal = np.linalg.svd(mean - mean.mean(axis=0))[2][-1]
    behind = np.eye(3) - 2 * axis[:, :, None] * axis[:, None, :]
    image = behind @ path.rotation @ (np.eye(3) - 2 * np.outer(normal, normal))
    # the trace of R S^T falls with the angle between R and S
    return np.einsum("sij,sij->s", at.rotation, image - path.rotation) > 0


def _joined(parts: list[Poses]) -> Poses:
    return Poses(
        position_m=np.concatenate([p.position_m for p in parts]),
        rotation=np.concatenate([p.rotation for p in parts]),
        z=np.concatenate([p.z for p in parts]),
    )


def _path(
    prior: PosePrior, at: Poses, vague: Array, cost: Array, cuts: NDArray[np.int64], frames: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The starts, one of each frame, that cost least together with the ways between them.

    Places are as uncertain as each frame alone leaves them: depths that scatter by metres say nothing of which
    orientations follow each other.
    """
    parts = np.split(np.arange(len(cost)), cuts[:-1])
    stiff = np.linalg.inv(prior.step)
    total, came = cost[parts[0]], []
    for before, here, lag in zip(parts[:-1], parts[1:], np.diff(frames), strict=True):
        turn = np.swapaxes(at.rotation[before], 1, 2)[:, None] @ at.rotation[here][None]
        turn = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec().reshape(len(before), len(here), 3)
        moved = at.position_m[here][None] - at.position_m[before][:, None]
        change = at.z[here][None] - at.z[before][:, None]
        way = np.sum(turn**2 / prior.body_step[3:], axis=-1)
        way = 0.5 * (way + np.einsum("abi,ij,abj->ab", change, stiff, change, optimize=True)) / lag**2
        spread = vague[before][:, None] + vague[here] + lag**2 * np.diag(prior.body_step[:3])
        way += 0.5 * np.einsum("abi,abi->ab", moved, np.linalg.solve(spread, moved[..., None])[..., 0])
        way += 0.5 * np.linalg.slogdet(spread)[1]
        every = total[:, None] + way
        came.append(every.argmin(axis=0))
        total = every.min(axis=0) + cost[here]
    best = [int(total.argmin())]
    for back in came[::-1]:
        best.append(int(back[best[-1]]))
    return np.array([part[k] for part, k in zip(parts, best[::-1], strict=True)])


def between(at: Poses, frames: NDArray[np.int64], steps: int) -> Poses:
    """All frames, so many, from poses of some of them."""
    if len(frames) == 1:
        return at.of(np.zeros(steps, dtype=np.int64))
    when = np.clip(np.arange(steps), frames[0], frames[-1])

    def line(values: Array) -> Array:
        return np.column_stack([np.interp(when, frames, column) for column in values.T])

    turned = Slerp(frames, Rotation.from_matrix(at.rotation))(when).as_matrix()
    return Poses(position_m=line(at.position_m), rotation=turned, z=line(at.z))
