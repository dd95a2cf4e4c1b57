"""A whole recording as few cameras see it: pose, place, orientation and what lasts, together, by a learned prior."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mocap.filters.pose_prior import PosePrior
from mocap.filters.trajectory import Quadratic, covariance, factor_at_all
from mocap.filters.tree import left_jacobian
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array, skew


@dataclass(frozen=True, eq=False, kw_only=True)
class Views:
    """What cameras saw.

    Attributes:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        sd_px: (C, T, M) scale of Student's t that their errors follow.
        dof: Its degrees of freedom.
        lasting: Share of their variance that lasts from frame to frame as what shapes leave of poses does.
    """

    matrices: Array
    uv_px: Array
    sd_px: Array
    dof: float = 5.0
    lasting: float = 0.0

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """(C, T, M)."""
        return np.isfinite(self.uv_px[..., 0])

    @property
    def main(self) -> int:
        """The camera that sees most."""
        return int(np.argmax(self.seen.sum(axis=(1, 2))))

    def frames(self, index: NDArray[np.int64]) -> "Views":
        """These frames."""
        return replace(self, uv_px=self.uv_px[:, index], sd_px=self.sd_px[:, index])

    def missed(self, xyz_m: Array) -> Array:
        """(C, T, M, 2) observed minus projected, in scales; 0 where not seen."""
        h = self._projected(xyz_m)
        return np.where(self.seen[..., None], (self.uv_px - h[..., :2] / h[..., 2:]) / self.sd_px[..., None], 0.0)

    def _projected(self, xyz_m: Array) -> Array:
        """(C, T, M, 3) homogeneous pixels."""
        return xyz_m @ np.swapaxes(self.matrices[:, None, :, :3], -1, -2) + self.matrices[:, None, None, :, 3]

    def seen_from(self, xyz_m: Array) -> tuple[Array, Array]:
        """(C, T, M, 2) observed minus projected, px, and (C, T, M, 2, 3) slope of the projection; 0 where not seen."""
        h = self._projected(xyz_m)
        at = h[..., :2] / h[..., 2:]
        slope = self.matrices[:, None, None, :2, :3] - at[..., None] * self.matrices[:, None, None, 2:, :3]
        seen = self.seen[..., None]
        return np.where(seen, self.uv_px - at, 0.0), np.where(seen[..., None], slope / h[..., 2, None, None], 0.0)

    def px_per_m(self, position_m: Array) -> Array:
        """(C,) pixels of a metre across the line of sight, at a place (3,)."""
        m = self.matrices
        size = np.linalg.norm(m[:, 2, :3], axis=1)
        across = np.linalg.norm(np.cross(m[:, :2, :3], m[:, 2:, :3]), axis=-1)
        return np.sqrt(across.prod(axis=1)) / size / np.abs(m[:, 2, :3] @ position_m + m[:, 2, 3])

    @property
    def fair(self) -> float:
        """Mean cost of a ray whose deviation is right: log(1 + r^2 / dof) is then exponential with mean 2 / dof."""
        return (self.dof + 2) / self.dof

    def _rays(self, xyz_m: Array) -> Array:
        """(C, T, M) minus log of the likelihood of each ray; 0 where not seen."""
        return 0.5 * (self.dof + 2) * np.log1p(np.sum(self.missed(xyz_m) ** 2, axis=-1) / self.dof)

    def cost(self, xyz_m: Array) -> Array:
        """(T,) minus log of the likelihood."""
        return self._rays(xyz_m).sum(axis=(0, 2))

    def misfit(self, xyz_m: Array) -> Array:
        """(T,) the same, each ray as the median of it and its neighbours in time: one wrong click is no pose."""
        rays, seen = (np.pad(one, ((0, 0), (1, 1), (0, 0))) for one in (self._rays(xyz_m), self.seen))
        own = rays[:, 1:-1]
        sides = [np.where(seen[:, at], rays[:, at], own) for at in (slice(None, -2), slice(2, None))]
        return np.where(self.seen, np.median([own, *sides], axis=0), 0.0).sum(axis=(0, 2))

    def pulled(self, xyz_m: Array) -> tuple[Array, Array]:
        """Gradient (T, M, 3) of the cost by the markers, and its second derivatives (T, M, 3, 3) by Gauss-Newton.

        Student's t is a normal of uncertain width: each ray counts by w = (dof + 2) / (dof + r^2) (Lange, Little &
        Taylor 1989).
        """
        miss, slope = self.seen_from(xyz_m)
        miss, slope = miss / self.sd_px[..., None], slope / self.sd_px[..., None, None]
        weight = (self.dof + 2) / (self.dof + np.sum(miss**2, axis=-1))
        gradient = -np.einsum("ctm,ctmai,ctma->tmi", weight, slope, miss)
        return gradient, np.einsum("ctm,ctmai,ctmaj->tmij", weight, slope, slope)


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """Poses of T frames.

    Attributes:
        position_m: (T, 3) of the body.
        rotation: (T, 3, 3) body axes to world.
        z: (T, r) shapes.
    """

    position_m: Array
    rotation: Array
    z: Array

    def of(self, index: NDArray[np.int64]) -> "Poses":
        """Those of some frames."""
        return Poses(position_m=self.position_m[index], rotation=self.rotation[index], z=self.z[index])


@dataclass(frozen=True, eq=False, kw_only=True)
class Recorded:
    """The posterior of the poses of a recording (``trajectory.Problem``); a step is [p, w, z], R <- R exp(w).

    Attributes:
        prior: What is known of the animal.
        views: What was seen; deviations contain what shapes leave of poses.
    """

    prior: PosePrior
    views: Views

    @cached_property
    def _noise(self) -> Array:
        """(6 + r, 6 + r) precision of the second differences of p and w, and of what the shapes' motion leaves."""
        return _blocks(np.diag(1 / self.prior.body_noise), np.linalg.inv(self.prior.shape_noise))

    @cached_property
    def _first(self) -> Array:
        """(6 + r, 6 + r) precision of the first step."""
        return _blocks(np.diag(1 / self.prior.body_step), np.linalg.inv(self.prior.step))

    def body(self, at: Poses) -> Array:
        """(T, M, 3) markers in body axes."""
        p = self.prior
        return (p.mean + at.z @ p.basis.T).reshape(len(at.z), -1, 3)

    def markers(self, at: Poses) -> Array:
        """(T, M, 3) markers in the world."""
        return self.body(at) @ np.swapaxes(at.rotation, 1, 2) + at.position_m[:, None]

    def _motion(self, at: Poses) -> tuple[Array, Array, Array]:
        """(T - 2, n) noise of the motion, (T - 1, n) changes, (T - 1, 3) turns from frame to frame in body axes."""
        turns = Rotation.from_matrix(np.swapaxes(at.rotation[:-1], 1, 2) @ at.rotation[1:]).as_rotvec()
        change = np.concatenate([np.diff(at.position_m, axis=0), turns, np.diff(at.z, axis=0)], axis=1)
        p = self.prior
        noise = np.diff(change, axis=0)
        noise[:, 6:] = at.z[2:] - at.z[1:-1] @ p.now.T - at.z[:-2] @ p.before.T - p.constant
        return noise, change, turns

    def cost(self, at: Poses) -> float:
        """See ``trajectory.Problem``."""
        noise, change, _ = self._motion(at)
        value = 0.5 * np.sum((noise @ self._noise) * noise)
        if len(change):
            value += 0.5 * change[0] @ self._first @ change[0]
        return float(value + self.apart(at).sum())

    def apart(self, at: Poses) -> Array:
        """(T,) what each frame costs by itself."""
        return self.prior.hold.value(at.z) + self.views.cost(self.markers(at))

    def local(self, at: Poses) -> tuple[Array, Array]:
        """(T, n + 1) gradient of that by the states and the size, and (T, n + 1, n + 1) second derivatives."""
        p, steps = self.prior, len(at.z)
        pulled, stiff = self.views.pulled(self.markers(at))
        rows, turn = self.rows(at), at.rotation
        force = (pulled @ turn).reshape(steps, -1)
        inner = np.swapaxes(turn, 1, 2)[:, None] @ stiff @ turn[:, None]
        weighted = (inner @ rows.reshape(steps, -1, 3, rows.shape[-1])).reshape(rows.shape)
        form = np.swapaxes(rows, 1, 2) @ weighted
        slope = np.einsum("tik,ti->tk", rows, force)
        slope[:, 6:-1] += p.hold.gradient(at.z)
        form[:, 6:-1, 6:-1] += positive(p.hold.hessian(at.z))
        return slope, form

    def quadratic(self, at: Poses) -> Quadratic:
        """See ``trajectory.Problem``."""
        r, steps = self.prior.rank, len(at.z)
        n = 6 + r
        gradient = np.zeros((steps, n))
        band = tuple(np.zeros((max(steps - lag, 0), n, n)) for lag in range(3))
        noise, change, turns = self._motion(at)
        if steps > 1:
            after, before = turned(turns[0])
            ahead, behind = np.eye(n), -np.eye(n)
            ahead[3:6, 3:6], behind[3:6, 3:6] = after, before
            pull = self._first @ change[0]
            gradient[0] += behind.T @ pull
            gradient[1] += ahead.T @ pull
            band[0][0] += behind.T @ self._first @ behind
            band[0][1] += ahead.T @ self._first @ ahead
            band[1][0] += ahead.T @ self._first @ behind
        if steps > 2:
            pull = noise @ self._noise
            slopes = self._slopes(turns)
            for i, a in enumerate(slopes):
                gradient[2 - i : steps - i] += np.einsum("tij,ti->tj", a, pull)
                for j, b in enumerate(slopes[i:], start=i):
                    band[j - i][2 - j : steps - j] += np.swapaxes(a, 1, 2) @ self._noise @ b
        slope, form = self.local(at)
        gradient += slope[:, :n]
        band[0][:] += form[:, :n, :n]
        return Quadratic(gradient=gradient, band=band)

    def _slopes(self, turns: Array) -> tuple[Array, Array, Array]:
        """(T - 2, n, n) change of the noise of the motion with the states of its frame and of the two before."""
        p, r, steps = self.prior, self.prior.rank, len(turns) - 1
        ahead, behind = turned(turns)
        here = np.tile(np.eye(6 + r), (steps, 1, 1))
        before, earlier = np.zeros(here.shape), np.zeros(here.shape)
        here[:, 3:6, 3:6] = ahead[1:]
        before[:, :3, :3], earlier[:, :3, :3] = -2 * np.eye(3), np.eye(3)
        before[:, 3:6, 3:6], earlier[:, 3:6, 3:6] = behind[1:] - ahead[:-1], -behind[:-1]
        before[:, 6:, 6:], earlier[:, 6:, 6:] = -p.now, -p.before
        return here, before, earlier

    def rows(self, at: Poses) -> Array:
        """(T, 3M, 6 + r + 1) how markers change in body axes with p, w, z and the size."""
        body, r = self.body(at), self.prior.rank
        rows = np.zeros((*body.shape, 7 + r))
        rows[..., :3] = np.swapaxes(at.rotation, 1, 2)[:, None]
        rows[..., 3:6] = -skew(body)
        rows[..., 6 : 6 + r] = self.prior.basis.reshape(-1, 3, r)
        rows[..., 6 + r] = body
        return rows.reshape(len(body), -1, 7 + r)

    def moved(self, at: Poses, step: Array) -> Poses:
        """See ``trajectory.Problem``."""
        return Poses(
            position_m=at.position_m + step[:, :3],
            rotation=at.rotation @ Rotation.from_rotvec(step[:, 3:6]).as_matrix(),
            z=at.z + step[:, 6:],
        )


def turned(turns: Array) -> tuple[Array, Array]:
    """(..., 3, 3) change of turns (..., 3) from R to S = R exp(turn), by small turns of S and of R in their own axes.

    The inverse right Jacobian of rotations (Chirikjian 2012, equation 10.86), and minus its transpose.
    """
    ahead = np.linalg.inv(left_jacobian(-turns))
    return ahead, -np.swapaxes(ahead, -1, -2)


def _blocks(a: Array, b: Array) -> Array:
    out = np.zeros((len(a) + len(b),) * 2)
    out[: len(a), : len(a)], out[len(a) :, len(a) :] = a, b
    return out


def positive(matrices: Array) -> Array:
    """(..., r, r) symmetric matrices without their negative eigenvalues."""
    values, vectors = np.linalg.eigh(matrices)
    return (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def counted_once(recorded: Recorded, at: Poses) -> list[Array]:
    """(T - l, 3M, 3M) covariances of markers of frames t + l and t, for l = 0, 1, 2, by their poses alone.

    What shapes leave of poses errs alike for some frames and is counted once in these. The size is not estimated: what
    it may differ by moves all else as if it were known to differ so (considered, Schmidt 1966).

    Args:
        recorded: What was minimised.
        at: Where.
    """
    n = 6 + recorded.prior.rank
    rows = recorded.rows(at).reshape(len(at.z), -1, 3, n + 1)  # how markers change with the states and the size
    rows = (at.rotation[:, None] @ rows).reshape(len(at.z), -1, n + 1)
    form, (_, local) = recorded.quadratic(at), recorded.local(at)
    less = (1 - 1 / recorded.prior.lasts) * local[:, :n, :n]
    found = factor_at_all(replace(form, band=(form.band[0] - less, *form.band[1:])))
    moved = found.solve(-local[:, :n, n] / recorded.prior.lasts)
    grown = recorded.prior.size_sd * (rows[..., :n] @ moved[..., None] + rows[..., n:])
    lags = covariance(found)
    return [
        rows[lag:, :, :n] @ part @ np.swapaxes(rows[: len(part), :, :n], 1, 2)
        + grown[lag:] @ np.swapaxes(grown[: len(part)], 1, 2)
        for lag, part in enumerate(lags)
    ]
