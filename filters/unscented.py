"""An unscented Kalman filter for any model, with filterpy's names and the arithmetic of ``mocap.filters.ensemble``."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from mocap.filters.ensemble import Gaussian, Prediction, predict, smooth_step, update
from mocap.filters.factors import triangular
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrsm  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array

if TYPE_CHECKING:
    from filterpy.kalman import MerweScaledSigmaPoints

Function = Callable[..., Any]


class UnscentedKalmanFilter:
    """Filter and smooth with a model of your own; a drop-in for ``filterpy.kalman.UnscentedKalmanFilter``.

    The same scaled unscented transform (van der Merwe 2004) with the covariance as a sum of squares: it never turns
    indefinite. A step takes as long as filterpy's for 4 states, and a seventh of that for 204 states and 600 rows
    (``docs/experiments/benchmarks.md``). Results agree to rounding. Rows of ``z`` that are NaN are missing: the others
    are used.

    Attributes:
        x: (n,) mean.
        P: (n, n) covariance; set it, or leave the unit matrix.
        Q: (n, n) process noise of one step.
        R: (m, m) noise of an observation.
        y: (m,) innovation of the last update; NaN where a row was missing.
        log_likelihood: Log density of the rows of the last update given those before.
        nis: Their normalised innovation squared.
    """

    def __init__(
        self,
        dim_x: int,
        dim_z: int,
        dt: float,
        hx: Function,
        fx: Function,
        points: "MerweScaledSigmaPoints",
        *,
        vectorised: bool = False,
    ) -> None:
        """A filter at rest in 0 with unit covariances.

        Args:
            dim_x: Size n of the state.
            dim_z: Size m of an observation.
            dt: Time step in seconds.
            hx: ``hx(x)``: state to observation.
            fx: ``fx(x, dt)``: state to the state ``dt`` later.
            points: Sigma points with beta >= alpha^2.
            vectorised: Whether ``fx`` and ``hx`` take all sigma points at once, (S, n) to (S, n) and (S, m): much
                faster.

        Raises:
            ValueError: the points are for another size.
        """
        if points.n != dim_x:
            raise ValueError(f"points are for states of size {points.n}, but dim_x = {dim_x}: make them for {dim_x}")
        self.dt, self.hx, self.fx, self.points, self.vectorised = dt, hx, fx, points, vectorised
        self.dim_z = dim_z
        self._state = Gaussian(np.zeros(dim_x), np.eye(dim_x))
        self.Q, self.R = np.eye(dim_x), np.eye(dim_z)
        self.y = np.full(dim_z, np.nan)
        self.log_likelihood, self.nis = 0.0, np.nan

    @property
    def x(self) -> Array:
        """(n,) mean."""
        return self._state.mean

    @x.setter
    def x(self, mean: ArrayLike) -> None:
        self._state = Gaussian(np.array(mean, dtype=np.float64), self._state.factor)

    @property
    def P(self) -> Array:
        """(n, n) covariance."""
        return self._state.cov

    @P.setter
    def P(self, cov: ArrayLike) -> None:
        self._state = Gaussian(self._state.mean, _factor("P", cov, len(self._state.mean)))

    def predict(self, dt: float | None = None, **fx_args: Any) -> None:
        """Move the state on by a step.

        Args:
            dt: Its length; None: as given at the start.
            **fx_args: Passed on to ``fx``.
        """
        self._state = self._predicted(self._state, self.Q, self.dt if dt is None else dt, fx_args).state

    def _predicted(self, state: Gaussian, noise: ArrayLike, dt: float, fx_args: dict[str, Any]) -> Prediction:
        n = len(state.mean)

        def step(states: Array) -> Array:
            return self._called(self.fx, states, n, dt, **fx_args)

        return predict(state, step, _factor("Q", noise, n), self.points)

    def update(self, z: ArrayLike | None, R: ArrayLike | None = None, **hx_args: Any) -> None:
        """Condition the state on an observation.

        Args:
            z: (m,) observation; NaN in rows that are missing; None: all are.
            R: (m, m) noise, or a variance of all rows, of this observation alone; None: ``self.R``.
            **hx_args: Passed on to ``hx``.

        Raises:
            ValueError: z or R is of another size, or R of the rows that are there is not positive definite.
        """
        z = np.full(self.dim_z, np.nan) if z is None else np.atleast_1d(np.array(z, dtype=np.float64))
        if z.shape != (self.dim_z,):
            raise ValueError(f"z has shape {z.shape}, expected ({self.dim_z},)")
        noise = np.asarray(self.R if R is None else R, dtype=np.float64)
        noise = noise * np.eye(self.dim_z) if noise.ndim == 0 else noise
        if noise.shape != (self.dim_z, self.dim_z):
            raise ValueError(f"R has shape {noise.shape}, expected ({self.dim_z}, {self.dim_z})")
        there = ~np.isnan(z)
        self.y, self.log_likelihood, self.nis = np.full(self.dim_z, np.nan), 0.0, np.nan
        if not there.any():
            return
        noise = noise[np.ix_(there, there)]
        variance, factor = np.diag(noise), None
        if (variance > 0).all() and np.count_nonzero(noise) == len(noise):  # rows are independent
            sd = np.sqrt(variance)
        else:
            factor, sd = _factor("R", noise, len(noise), definite=True), np.ones(len(noise))

        def white(states: Array) -> Array:
            seen = self._called(self.hx, states, self.dim_z, **hx_args)[:, there]
            return seen if factor is None else solve_triangular(factor, seen.T, lower=True).T

        target = z[there] if factor is None else solve_triangular(factor, z[there], lower=True)
        found = update(self._state, white, target, sd, self.points)
        self._state = found.state
        self.y[there] = found.innovation if factor is None else factor @ found.innovation
        scale = 0.0 if factor is None else float(np.log(np.diag(factor)).sum())
        self.log_likelihood = found.log_likelihood - scale
        self.nis = found.nis

    def batch_filter(
        self, zs: Sequence[ArrayLike | None], Rs: Sequence[ArrayLike | None] | None = None, dts: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Predict and update for each of T observations.

        Args:
            zs: T observations.
            Rs: Their noise, each as in ``update``.
            dts: Length of the step to each; one or T.

        Returns:
            Means (T, n) and covariances (T, n, n).
        """
        steps = np.broadcast_to(np.asarray(self.dt if dts is None else dts, dtype=np.float64), len(zs))
        means, covs = [], []
        for i, z in enumerate(zs):
            self.predict(dt=float(steps[i]))
            self.update(z, R=None if Rs is None else Rs[i])
            means.append(self.x)
            covs.append(self.P)
        return np.array(means), np.array(covs)

    def rts_smoother(
        self, Xs: ArrayLike, Ps: ArrayLike, Qs: ArrayLike | None = None, dts: ArrayLike | None = None
    ) -> tuple[Array, Array, Array]:
        """Rauch-Tung-Striebel smoothing of what ``batch_filter`` returned.

        Args:
            Xs: (T, n) filtered means.
            Ps: (T, n, n) filtered covariances.
            Qs: (T, n, n) process noise of the step from each; None: ``self.Q``.
            dts: Length of the step from each; one or T.

        Returns:
            Smoothed means (T, n) and covariances (T, n, n), and gains (T, n, n), that of the last being 0.
        """
        means, covs = np.array(Xs, dtype=np.float64), np.array(Ps, dtype=np.float64)
        n = means.shape[1]
        noise = np.broadcast_to(np.asarray(self.Q if Qs is None else Qs, dtype=np.float64), (len(means), n, n))
        steps = np.broadcast_to(np.asarray(self.dt if dts is None else dts, dtype=np.float64), len(means))
        smoothed, gains = Gaussian(means[-1], _factor("Ps", covs[-1], n)), np.zeros((len(means), n, n))
        out_means, out_covs = means.copy(), covs.copy()
        for i in range(len(means) - 2, -1, -1):
            state = Gaussian(means[i], _factor("Ps", covs[i], n))
            ahead = self._predicted(state, noise[i], float(steps[i]), {})
            w = dtrsm(1.0, ahead.state.factor, ahead.rows[:n].T, lower=1)
            gains[i] = state.factor @ dtrsm(1.0, ahead.state.factor, w, lower=1, trans_a=1).T
            smoothed = smooth_step(state, ahead, smoothed)
            out_means[i], out_covs[i] = smoothed.mean, smoothed.cov
        return out_means, out_covs, gains

    def _called(self, function: Function, states: Array, size: int, *args: Any, **more: Any) -> Array:
        """(S, size) of a function of the person's own."""
        if self.vectorised:
            out = np.asarray(function(states, *args, **more), dtype=np.float64)
        else:
            out = np.array([np.atleast_1d(function(state, *args, **more)) for state in states], dtype=np.float64)
        if out.shape != (len(states), size):
            raise ValueError(
                f"{getattr(function, '__name__', 'the function')} returned shape {out.shape} for {len(states)} states, "
                f"expected ({len(states)}, {size})"
            )
        return out


def _factor(name: str, cov: ArrayLike, n: int, *, definite: bool = False) -> Array:
    """Lower triangular factor of a covariance, which may be singular unless ``definite``.

    Raises:
        ValueError: it is no covariance of that size.
    """
    cov = np.asarray(cov, dtype=np.float64)
    cov = cov * np.eye(n) if cov.ndim == 0 else cov
    if cov.shape != (n, n):
        raise ValueError(f"{name} has shape {cov.shape}, expected ({n}, {n})")
    try:
        return np.asfortranarray(np.linalg.cholesky(cov))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (cov + cov.T))
        if definite or values.min() < -1e-9 * max(values.max(), 0.0) or not np.isfinite(values).all():
            raise ValueError(
                f"{name} is no covariance: its least eigenvalue is {values.min():.3g}, the greatest {values.max():.3g}"
            ) from None
        return np.asfortranarray(triangular(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T))
