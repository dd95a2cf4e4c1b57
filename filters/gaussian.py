"""One Gaussian filter and smoother in covariance form, of states with declared structure.

A state of n components is a block that everything shares (s of them), then chains: D coordinates that are independent
of each other given that block, of k states each, in the order [e (D), its rate (D), ...]. Leading axes, where there are
any, are parts that have nothing to do with each other (each marker by itself).

Forward, an observation of rows H with unit noise and the innovation y takes the gains G = H P and leaves

    S = 1 + G H^T = L L^T,   W = L^-1 G,   z = L^-1 y,   x + W^T z,   P - W^T W.

Backward, the modified Bryson-Frazier smoother (Bierman 1977, Factorization Methods, section 10.4) carries a vector and
a matrix with x_s = x - P lambda and P_s = P - P Lambda P. They pass observations and steps without any inverse.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mocap.filters.factors import cholesky
from numpy.typing import NDArray
from scipy.linalg.blas import dtrsm  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array

MOST_AT_ONCE = float(np.finfo(float).eps) ** -0.5
"""No observation makes anything known better by more than this factor in variance at once: of a sharper one a share of
its information is taken first, and then the rest. 1 + H P H^T keeps half of its digits, whatever the noise."""
SUBTRACTS_TO = 1e4
"""Up to so large a factor in variance P - W^T W is taken as it stands: of sixteen digits it loses as many as the factor
has, and keeps twelve. Of a larger one, as where a gap leaves metres and one ray a millimetre of them, a sum of squares
(Joseph) loses none, and takes an inverse."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean (..., n) and covariance (..., n, n) of a state. Arrays are never written to."""

    mean: Array
    cov: Array


@dataclass(frozen=True, eq=False)
class Adjoint:
    """What all that comes later says of a state: (..., n) vector lambda and (..., n, n) matrix Lambda."""

    vector: Array
    matrix: Array

    def smoothed(self, state: Moments) -> "Smoothed":
        """The filtered state, smoothed."""
        return Smoothed(state.mean - _times(state.cov, self.vector), state.cov, self.matrix)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoothed state of covariance P - P Lambda P, which is formed only where it is asked for.

    Attributes:
        mean: (..., n).
        filtered: (..., n, n) P.
        matrix: (..., n, n) Lambda.
    """

    mean: Array
    filtered: Array
    matrix: Array

    @property
    def cov(self) -> Array:
        """(..., n, n) covariance."""
        gains = self.filtered @ self.matrix
        return self.filtered - _symmetric(gains @ self.filtered)

    def markers(self, view: "View") -> Array:
        """(M, 3, 3) covariances of markers in the world."""
        before = Markers(Moments(self.mean, self.filtered), view)
        each = before.gains.reshape(-1, 3, before.gains.shape[-1])
        later = (before.gains @ self.matrix).reshape(each.shape) @ _t(each)
        cov = _symmetric(before.own - later)
        return cov if view.turn is None else view.turn @ cov @ view.turn.T

    def of(self, rows: Array, gains: Array | None = None) -> Array:
        """(..., m, m) covariance of rows (..., m, r) of the first r components; ``gains`` (..., m, n) is rows P."""
        reads = rows.shape[-1]
        gains = rows @ self.filtered[..., :reads, :] if gains is None else gains
        return _symmetric(gains[..., :reads] @ _t(rows) - (gains @ self.matrix) @ _t(gains))


@dataclass(frozen=True, eq=False)
class Move:
    """One step of time, x -> F x + shift + noise.

    Attributes:
        shared: (s, s) what F does to the shared block.
        chain: (k, k) what it does to the k states of each coordinate of the chains.
        noise: (..., n, n) covariance of the noise.
        shift: (n,) constant; None: 0.
        decay: (D,) what the states of each coordinate are multiplied by, besides; None: 1.
    """

    shared: Array
    chain: Array
    noise: Array
    shift: Array | None = None
    decay: Array | None = None

    @cached_property
    def dense(self) -> Array | None:
        """(n, n) F of a few numbers, where it is faster as one; None: it has a shared block, or coordinates differ."""
        if len(self.shared) or self.decay is not None:
            return None
        return np.kron(self.chain, np.eye(self.noise.shape[-1] // len(self.chain)))

    def ahead(self, state: Moments) -> Moments:
        """The state after the step."""
        mean, dense = self.forward(state.mean), self.dense
        cov = self._both(state.cov) if dense is None else dense @ state.cov @ dense.T
        cov += self.noise
        return Moments(mean if self.shift is None else mean + self.shift, cov)

    def forward(self, rows: Array) -> Array:
        """(..., n) states, or rows that are to be carried on: rows F^T."""
        if self.dense is not None:
            return rows @ self.dense.T
        return self._times(rows.T).T

    def _times(self, columns: Array) -> Array:
        """F times (n,) or (n, c)."""
        s, k = len(self.shared), len(self.chain)
        out = np.empty(columns.shape)
        np.matmul(self.shared, columns[:s], out=out[:s])
        if k:
            chains = out[s:].reshape(k, -1)
            np.matmul(self.chain, columns[s:].reshape(k, -1), out=chains)
            if self.decay is not None:
                chains.reshape(k, len(self.decay), -1)[...] *= self.decay[:, None]
        return out

    def _both(self, matrix: Array) -> Array:
        """F C F^T of a symmetric matrix C (n, n).

        What rounding leaves unsymmetric grows with the square of an unstable mode of F, which the shared block may
        have: what is of that block is made symmetric in each step.
        """
        out, s = self._times(self._times(matrix).T), len(self.shared)
        out[:s, :s], out[s:, :s] = _symmetric(out[:s, :s]), out[:s, s:].T
        return out

    @property
    def turned(self) -> "Move":
        """F^T."""
        return Move(self.shared.T, self.chain.T, self.noise, decay=self.decay)

    def back(self, adjoint: Adjoint) -> Adjoint:
        """What later frames say of the state before the step."""
        turned, dense = self.turned, self.dense
        if dense is not None:
            return Adjoint(adjoint.vector @ dense, dense.T @ adjoint.matrix @ dense)
        return Adjoint(turned.forward(adjoint.vector), turned._both(adjoint.matrix))

    def smoothed_cov(self, cov: Array, later: Array) -> Array:
        """Smoothed covariance of a state of filtered covariance P, given that of the state after the step.

        D P D^T + K Q K^T + K P_s K^T with D = 1 - K F, a sum of squares (Rauch, Tung & Striebel 1965, as Joseph writes
        it): where nothing is seen for long, P - P Lambda P cancels to nothing.
        """
        ahead = self.ahead(Moments(np.zeros(cov.shape[:-1]), cov)).cov
        gain = _t(np.linalg.solve(ahead, _t(self.forward(cov))))
        rest = np.eye(cov.shape[-1]) - self.turned.forward(gain)
        return _symmetric(rest @ cov @ _t(rest) + gain @ (self.noise + later) @ _t(gain))


@dataclass(frozen=True, eq=False)
class View:
    """Markers as linear functions of a state near some mean.

    In axes of their own they move by rows dx + de, where de is the change of the first states of the chains, if these
    are coordinates of the markers.

    Attributes:
        mean: (M, 3) where they are, in the world.
        rows: (..., 3m, s) change with the first s components of the state, in the axes; M is m times the parts.
        chains: Where the chains begin; None: they are no coordinates of markers, or are in the rows.
        turn: (3, 3) the axes in the world; None: they are the world's.
    """

    mean: Array
    rows: Array
    chains: int | None = None
    turn: Array | None = None

    @property
    def reads(self) -> int:
        """The first so many components of the state move the markers."""
        return self.rows.shape[-1] if self.chains is None else self.chains + self.rows.shape[-2]

    def times(self, columns: Array) -> Array:
        """(..., 3m, c) of (..., n, c)."""
        out = self.rows @ columns[..., : self.rows.shape[-1], :]
        if self.chains is not None:
            out += columns[..., self.chains : self.reads, :]
        return out

    def moved(self, change: Array) -> Array:
        """(M, 3) by how much the markers move in the world for a change (..., n) of the state."""
        moved = self.times(change[..., None]).reshape(-1, 3)
        return moved if self.turn is None else moved @ self.turn.T

    def of_markers(self, along: Array, which: slice | NDArray[np.int64]) -> Array:
        """(m, q, reads) rows of combinations (m, q, 3) of the coordinates of each of some markers, of one part."""
        count, s = len(self.rows) // 3, self.rows.shape[-1]
        out = np.zeros((*along.shape[:2], self.reads))
        out[..., :s] = along @ self.rows.reshape(count, 3, s)[which]
        if self.chains is not None:
            chains = np.zeros((*along.shape[:2], count, 3))
            chains[np.arange(len(along)), :, np.arange(count)[which]] = along
            out[..., self.chains :] = chains.reshape(*along.shape[:2], -1)
        return out

    def combined(self, along: Array) -> Array:
        """(..., q, reads) rows of q combinations (..., q, 3m) of the coordinates of all markers of a part."""
        out = np.zeros((*along.shape[:-1], self.reads))
        out[..., : self.rows.shape[-1]] = along @ self.rows
        if self.chains is not None:
            out[..., self.chains :] = along
        return out


@dataclass(frozen=True, eq=False)
class Markers:
    """The markers of a state.

    Attributes:
        state: Mean and covariance.
        view: How they depend on it.
    """

    state: Moments
    view: View

    @cached_property
    def gains(self) -> Array:
        """(..., 3m, n) their covariance with the state, in their axes."""
        return self.view.times(self.state.cov)

    @cached_property
    def spread(self) -> Array:
        """(..., 3m, 3m) covariance of all of a part, in their axes."""
        return _t(self.view.times(_t(self.gains)))

    @cached_property
    def own(self) -> Array:
        """(M, 3, 3) covariance of each in their axes."""
        return diagonal_blocks(self.spread)

    @property
    def cov(self) -> Array:
        """(M, 3, 3) covariance of each in the world."""
        turn = self.view.turn
        return self.own if turn is None else turn @ self.own @ turn.T

    def condition(
        self, along: Array, innovation: Array, known: NDArray[np.bool_], which: NDArray[np.int64] | None = None
    ) -> tuple[Moments, "Update"]:
        """Condition the state on combinations of the coordinates of each marker.

        Args:
            along: (M, q, 3) combinations, of unit noise, in the axes of the view.
            innovation: (M, q) observed minus predicted.
            known: (M, q) those that were observed; the others are 0.
            which: (M,) markers that these are of; None: all.
        """
        parts = self.state.mean.shape[:-1]
        if parts:  # of one marker each
            target, every = innovation.reshape(*parts, -1), along.reshape(*parts, -1, 3)
            return condition(self.state, self.view.combined(every), every @ self.gains, target)
        each = slice(None) if which is None else which
        gains = along @ self.gains.reshape(-1, 3, self.gains.shape[-1])[each]
        return condition(self.state, self.view.of_markers(along, each)[known], gains[known], innovation[known])


@dataclass(frozen=True, eq=False)
class Update:
    """What an observation did to a state.

    Attributes:
        rows: (..., m, r) L^-1 H, of the first r components of the state; it does not read the others.
        gains: (..., m, n) W.
        innovation: (..., m) z.
        log_det: log det S, of all parts together.
        force: (r,) b, a force that moved the state by P b after it; None: there was none.
        left: (..., n, n) 1 - W^T Y, where it is known to more digits than the difference has; None: it is not.
        first: A part of the same information that was conditioned on before; None: this is all of it. The determinant
            is of both.
    """

    rows: Array
    gains: Array
    innovation: Array
    log_det: float
    force: Array | None = None
    left: Array | None = None
    first: "Update | None" = None

    @property
    def explained(self) -> float:
        """|z|^2."""
        return float(np.sum(self.innovation**2)) + (0.0 if self.first is None else self.first.explained)

    def back(self, adjoint: Adjoint) -> Adjoint:
        """What it and all that comes later say of the state before it."""
        adjoint = self._back(adjoint)
        return adjoint if self.first is None else self.first.back(adjoint)

    def _back(self, adjoint: Adjoint) -> Adjoint:
        reads = self.rows.shape[-1]
        if self.left is not None:
            vector, matrix = _times(_t(self.left), adjoint.vector), _t(self.left) @ adjoint.matrix @ self.left
            vector[..., :reads] -= _times(_t(self.rows), self.innovation)
            matrix[..., :reads, :reads] += _t(self.rows) @ self.rows
            return Adjoint(vector, matrix)
        vector = adjoint.vector.copy()
        if self.force is not None:
            vector[..., :reads] -= self.force
        pull = _times(self.gains, vector) + self.innovation
        vector[..., :reads] -= _times(_t(self.rows), pull)
        along = self.gains @ adjoint.matrix
        across = along @ _t(self.gains)
        diagonal(across)[...] += 1
        along[..., :reads] -= 0.5 * across @ self.rows
        half = 0.5 * adjoint.matrix
        half[..., :reads, :] -= _t(self.rows) @ along
        # what is not symmetric would be taken from both sides in the same sense, and grow by a factor a frame
        return Adjoint(vector, half + _t(half))

    def carry(self, rows: Array) -> Array:
        """(..., n) rows of covariances with the state before it: with the state after it."""
        rows = rows if self.first is None else self.first.carry(rows)
        return rows - (rows[..., : self.rows.shape[-1]] @ _t(self.rows)) @ self.gains


def condition(state: Moments, rows: Array, gains: Array, innovation: Array) -> tuple[Moments, Update]:
    """Condition a state on an observation.

    Args:
        state: Prior.
        rows: (..., m, r) H, of unit noise, on the first r components of the state.
        gains: (..., m, n) H P.
        innovation: (..., m) observed minus predicted.

    Raises:
        np.linalg.LinAlgError: 1 + H P H^T is not positive definite, as P is not.
    """
    reads, n = rows.shape[-1], state.mean.shape[-1]
    spread = gains[..., :reads] @ _t(rows)
    widest = float(diagonal(spread).max(initial=0.0))
    if widest > MOST_AT_ONCE:
        share = 0.5 * MOST_AT_ONCE / widest
        before, first = condition(state, share**0.5 * rows, share**0.5 * gains, share**0.5 * innovation)
        rest, moved = (1 - share) ** 0.5, (before.mean - state.mean)[..., :reads]
        rows = rest * rows
        gains = rows @ before.cov[..., :reads, :]
        after, last = condition(before, rows, gains, rest * innovation - _times(rows, moved))
        return after, replace(last, first=first, log_det=first.log_det + last.log_det)
    solved, log_det = whitened(spread, np.concatenate([gains, rows, innovation[..., None]], axis=-1))
    w, y, z = solved[..., :n], solved[..., n:-1], solved[..., -1]
    mean = state.mean + _times(_t(w), z)
    if state.mean.ndim == 1 and widest < SUBTRACTS_TO:  # markers by themselves are small: always a sum of squares
        return Moments(mean, state.cov - _t(w) @ w), Update(y, w, z, log_det)
    near = state.cov[..., :, :reads] @ (_t(rows) @ rows)
    left = np.zeros(state.cov.shape)
    left[..., np.arange(reads, n), np.arange(reads, n)] = 1
    left[..., :reads, :reads] = np.linalg.inv(np.eye(reads) + near[..., :reads, :])
    left[..., reads:, :reads] = -near[..., reads:, :] @ left[..., :reads, :reads]
    moved = left @ state.cov
    gain = moved[..., :, :reads] @ _t(rows)
    cov = _symmetric(moved @ _t(left)) + gain @ _t(gain)
    return Moments(mean, cov), Update(y, w, z, log_det, left=left)


def pushed(state: Moments, update: Update, force: Array, farthest: float) -> tuple[Moments, Update]:
    """A state after a force (r,) on its first components too, by at most so many of its deviations (x + P b)."""
    move = state.cov[:, : len(force)] @ force
    size = np.sqrt(max(float(force @ move[: len(force)]), 0.0))
    share = min(1.0, farthest / size) if size > 0 else 1.0
    moved = Moments(state.mean + share * move, state.cov)
    return moved, replace(update, force=share * force)


def whitened(spread: Array, right: Array) -> tuple[Array, float]:
    """L^-1 times (..., m, c), with L L^T = 1 + spread (..., m, m), and log det of that; both are overwritten.

    Raises:
        np.linalg.LinAlgError: it is not positive definite.
    """
    diagonal(spread)[...] += 1
    if spread.ndim == 2:
        factor = cholesky(spread.T)  # symmetric: as LAPACK has it in memory
        solved = dtrsm(1.0, factor, right.T, side=1, lower=1, trans_a=1, overwrite_b=1).T
    else:
        factor = np.linalg.cholesky(spread)
        solved = np.linalg.solve(factor, right)
    return solved, 2 * float(np.log(diagonal(factor)).sum())


def _t(matrix: Array) -> Array:
    return matrix.swapaxes(-1, -2)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def diagonal(matrix: Array) -> Array:
    """(..., n) of (..., n, n): a view that may be written to."""
    view = matrix.diagonal(axis1=-2, axis2=-1)
    view.flags.writeable = True
    return view


def diagonal_blocks(spread: Array) -> Array:
    """(M, 3, 3) blocks on the diagonals of (..., 3m, 3m)."""
    count = spread.shape[-1] // 3
    return np.einsum("...iaib->...iab", spread.reshape(*spread.shape[:-2], count, 3, count, 3)).reshape(-1, 3, 3)


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + _t(matrix))
