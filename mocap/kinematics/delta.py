"""Functions of uncertain positions and velocities: their values, rates, and standard deviations to first order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.filters.velocities import Motion
from mocap.kinematics.records import Quantity, Rests

Function = Callable[[Array], Array]
"""(T, k, 3) positions (or velocities) of k points to (T,) values."""


@dataclass(frozen=True, eq=False)
class Points:
    """Some points of a motion, with their joint covariance.

    Attributes:
        motion: The motion.
        names: The k points.
        x: (T, k, 3) positions.
        v: (T, k, 3) velocities.
        cov: (T, 6k, 6k) covariance, point by point, position before velocity.
        known: Whether all their covariances with each other are known; if not they are taken for independent.
    """

    motion: Motion
    names: tuple[str, ...]
    x: Array
    v: Array
    cov: Array
    known: bool

    @classmethod
    def of(cls, motion: Motion, names: Sequence[str]) -> "Points":
        """Points by name."""
        index = [motion.index(name) for name in names]
        cov, joint_known = motion.joint(index)
        return cls(motion, tuple(names), motion.xyz_m[:, index], motion.velocity_m_s[:, index], cov, joint_known)

    @cached_property
    def rests(self) -> NDArray[np.int8]:
        """(T,) what values of these points rest on."""
        index = [self.motion.index(name) for name in self.names]
        there = np.isfinite(self.x).all(axis=(1, 2))
        measured = self.motion.measured[:, index].all(axis=1)
        return np.where(there, np.where(measured, Rests.MEASURED, Rests.FILLED), Rests.MISSING).astype(np.int8)

    @cached_property
    def kept(self) -> Array:
        """(T,) share of the variances of neighbouring velocities that they do not have in common."""
        index = [self.motion.index(name) for name in self.names]
        return self.motion.kept[:, index].mean(axis=(1, 2))


def _apart(a: Array, b: Array, *, angle: bool) -> Array:
    """Difference a - b; of angles in radians it is between -pi and pi."""
    return (a - b + np.pi) % (2 * np.pi) - np.pi if angle else a - b


STEP = 1e-4
"""Steps of numerical slopes, as a share of the distances between the points. Slopes of slopes err by its square and by
rounding over its square: least near the fourth root of 2e-16, 1.2e-4."""


def slopes(function: Function, x: Array, step: float, *, angle: bool) -> Array:
    """(T, 3k) slopes of a function of k points (T, k, 3), by central differences; all in one call."""
    count, points = x.shape[:2]
    size = 3 * points
    at_once = max(1, 200_000 // (2 * size**2))  # coordinates that a processor's cache holds
    if count > at_once:
        parts = [slopes(function, x[i : i + at_once], step, angle=angle) for i in range(0, count, at_once)]
        return np.concatenate(parts)
    shift = (step * np.eye(size)).reshape(points, 3, size, 1)
    middle = np.ascontiguousarray(np.moveaxis(x, 0, -1))[:, :, None]
    both = np.stack([middle + shift, middle - shift], axis=2)  # frames last: long runs of memory
    value = function(np.moveaxis(both.reshape(points, 3, -1), -1, 0)).reshape(2, size, count)
    return (_apart(value[0], value[1], angle=angle) / (2 * step)).T


def quadratic(g: Array, cov: Array) -> Array:
    """(T,) square roots of g' P g for slopes (T, n) and covariances (T, n, n)."""
    return np.sqrt(np.maximum((g[:, None] @ cov @ g[:, :, None])[:, 0, 0], 0.0))


def length_sd(w: Array, cov: Array) -> Array:
    """(T,) standard deviations of the lengths of vectors (T, k) of two or three parts with covariances (T, k, k).

    To first order it is that along the vector. Where this may be 0 (w' P^-1 w below the 95 % point of chi squared) its
    length is no linear function of it: of a vector that is 0 it errs by the root of the trace of P, root mean
    square, and 95 % of the vectors found there lie so near. Beyond, what it has of that falls with the eighth power of
    the length, so that neighbouring frames have no steps.
    """
    size, trace = np.linalg.norm(w, axis=1), np.trace(cov, axis1=1, axis2=2)
    along = quadratic(w / np.where(size > 0, size, np.nan)[:, None], cov) ** 2
    known = np.isfinite(size) & np.isfinite(cov).all(axis=(1, 2)) & (trace > 0)
    unit_cov = cov[known] / trace[known, None, None] + 1e-9 * np.eye(w.shape[1])  # of markers in a plane it is singular
    share = np.zeros(len(w))
    squares = np.einsum("ti,ti->t", w[known], np.linalg.solve(unit_cov, w[known, :, None])[..., 0]) / trace[known]
    share[known] = np.minimum(1.0, CHI2_95[w.shape[1]] / np.maximum(squares, 1e-12)) ** 4
    return np.sqrt(np.where(size == 0, trace, along + share * np.maximum(trace - along, 0.0)))


CHI2_95 = {2: 5.991, 3: 7.815}
"""95 % points of chi squared."""


def extent(x: Array) -> float:
    """Root mean square distance of points (T, k, 3) from their mean; 1 m where there is none."""
    there = x[np.isfinite(x).all(axis=(1, 2))]
    if not len(there):
        return 1.0
    return max(float(np.sqrt(np.mean((there - there.mean(axis=1, keepdims=True)) ** 2))), 1e-6)


def neighbours(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The frames before and after each of so many, at the ends the frame itself."""
    return np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)


def central(t_s: Array, y: Array, *, angle: bool = False) -> Array:
    """(T,) central difference of a series, at the ends one-sided."""
    if len(t_s) < 2:
        return np.full(len(t_s), np.nan)
    before, after = neighbours(len(t_s))
    return _apart(y[after], y[before], angle=angle) / (t_s[after] - t_s[before])


def change_sd(t_s: Array, sd: Array, kept: Array) -> Array:
    """(T,) standard deviation of the central difference of a rate, with what neighbours share taken off."""
    if len(t_s) < 2:
        return np.full(len(t_s), np.nan)
    before, after = neighbours(len(t_s))
    return np.sqrt(kept * (sd[before] ** 2 + sd[after] ** 2)) / (t_s[after] - t_s[before])


def edges(rests: NDArray[np.int8]) -> NDArray[np.int8]:
    """What a change over neighbouring frames rests on: the worst of the three frames."""
    before, after = neighbours(len(rests))
    three = np.stack([rests[before], rests, rests[after]])
    worst = np.where((three == Rests.FILLED).any(axis=0), Rests.FILLED, rests)
    return np.where((three == Rests.MISSING).any(axis=0), Rests.MISSING, worst).astype(np.int8)


@dataclass(frozen=True)
class Naming:
    """How a quantity and its rates are called.

    Attributes:
        name: Without unit: ``elbow_l_flexion``.
        unit: ``deg``, ``m``, ``m2``, ...
        what: In words.
        kind: See ``Quantity``.
    """

    name: str
    unit: str
    what: str
    kind: str


def made(points: Points, naming: Naming, value: Array, sd: Array, rests: NDArray[np.int8]) -> Quantity:
    """A quantity in its unit (angles come in radians), where it has a value."""
    scale = 180 / np.pi if naming.unit.startswith("deg") else 1.0
    return called(naming, points.names, scale * value, scale * sd, rests)


def called(naming: Naming, markers: tuple[str, ...], value: Array, sd: Array, rests: NDArray[np.int8]) -> Quantity:
    """A quantity by its name, of (T,) values and deviations in its unit; NaN where it rests on nothing."""
    there = np.isfinite(value) & (rests != Rests.MISSING)
    return Quantity(
        name=f"{naming.name}_{naming.unit}",
        unit=naming.unit,
        what=naming.what,
        kind=naming.kind,
        markers=markers,
        value=np.where(there, value, np.nan),
        sd=np.where(there, sd, np.nan),
        rests=np.where(there, rests, Rests.MISSING),
    )


def of_velocity(points: Points, function: Function, naming: Naming) -> Quantity:
    """A function of the velocities of points, (T, k, 3) to (T,)."""
    angle = naming.unit == "deg"
    k = len(points.names)
    moving = np.arange(6 * k).reshape(k, 6)[:, 3:].ravel()
    with np.errstate(invalid="ignore", divide="ignore"):
        g = slopes(function, points.v, 1e-6, angle=angle)
        return made(points, naming, function(points.v), quadratic(g, points.cov[:, moving][:, :, moving]), points.rests)


def of_motion(points: Points, function: Callable[[Array, Array], Array], naming: Naming) -> Quantity:
    """A function of the positions and velocities of points, twice (T, k, 3) to (T,), linear in the velocities."""
    x, v, k = points.x, points.v, points.x.shape[1]
    speed = max(float(np.nanmax(np.abs(v), initial=0.0)), 1e-9)
    size = extent(x)
    order = np.arange(6 * k).reshape(k, 2, 3).swapaxes(0, 1).ravel()

    def of_both(both: Array) -> Array:
        return function(both[:, :k], both[:, k:] * (speed / size))

    with np.errstate(invalid="ignore", divide="ignore"):
        g = slopes(of_both, np.concatenate([x, v * (size / speed)], axis=1), STEP * size, angle=False)
        g[:, 3 * k :] *= size / speed
        sd = quadratic(g, points.cov[:, order][:, :, order])
    return made(points, naming, function(x, v), sd, points.rests)


def with_rates(points: Points, function: Function, naming: Naming, *, rates: bool = True) -> list[Quantity]:
    """A quantity f(x) of positions, its rate f' v, and the rate of that.

    With slopes g of f at x, the value has the variance g' P g. The rate g' v depends on the positions with the slopes
    h = (g(x + e v) - g(x - e v)) / 2 e and on the velocities with g. Steps e and those of slopes are numerical, not in
    time.

    Args:
        points: The points.
        function: Of their positions (T, k, 3).
        naming: Of the value; rates are called after it.
        rates: Whether rates are wanted.
    """
    angle, k = naming.unit == "deg", points.x.shape[1]
    size = extent(points.x) if k > 1 else 1e-2
    order = np.arange(6 * k).reshape(k, 6)
    place, moving = order[:, :3].ravel(), order[:, 3:].ravel()
    x, v, step = points.x, points.v, STEP * size
    with np.errstate(invalid="ignore", divide="ignore"):
        fastest = np.abs(v).max(axis=(1, 2))
        far = (step / np.maximum(fastest, 1e-9))[:, None, None]
        spread = np.concatenate([x, x + far * v, x - far * v]) if rates else x
        g, *around = np.split(slopes(function, spread, step, angle=angle), 3 if rates else 1)
        rests = points.rests
        out = [made(points, naming, function(x), quadratic(g, points.cov[:, place][:, :, place]), rests)]
        if not rates:
            return out
        both = np.empty((len(x), 6 * k))
        both[:, place], both[:, moving] = (around[0] - around[1]) / (2 * far[:, 0]), g
        rate = Naming(f"{naming.name}_rate", f"{naming.unit}_s", f"rate of change of {naming.what}", naming.kind)
        value = np.sum(g * v.reshape(len(x), -1), axis=1)
        out.append(made(points, rate, value, quadratic(both, points.cov), rests))
    second = Naming(
        f"{naming.name}_acceleration", f"{naming.unit}_s2", f"second rate of change of {naming.what}", naming.kind
    )
    return [*out, change(out[1], points, second)]


def change(rate: Quantity, points: Points, naming: Naming) -> Quantity:
    """How a rate changes over the frames before and after, by lag-one covariances (``Motion.kept``)."""
    t_s = points.motion.t_s
    sd = change_sd(t_s, rate.sd, points.kept)
    return called(naming, rate.markers, central(t_s, rate.value), sd, edges(rate.rests))


def acceleration(points: Points, axis: int, naming: Naming, velocity: Quantity) -> Quantity:
    """Of one point along an axis: the state's own, where the model has it; else how its velocity changes."""
    motion, index = points.motion, points.motion.index(points.names[0])
    if motion.acceleration_m_s2 is None or motion.acceleration_cov is None:
        return change(velocity, points, naming)
    variance = motion.acceleration_cov[:, index, axis, axis].astype(float)
    value, sd = motion.acceleration_m_s2[:, index, axis], np.sqrt(np.maximum(variance, 0.0))
    return called(naming, points.names, value, sd, points.rests)
