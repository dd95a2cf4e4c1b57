"""Peak, trough, range and mean of each quantity in each cycle, with intervals that contain where the peak is."""

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Z95, Array
from mocap.kinematics.records import DOUBTFUL, Cycle, Kinematics, Quantity, Rests
from mocap.sides import TRUNK, side_of

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "trial", "animal", "kind", "of", "cycle", "side", "quantity", "statistic", "value", "sd", "low", "high", "unit",
    "status",
)  # fmt: skip
STATISTICS = ("peak", "trough", "range", "mean", "peak_time_s", "peak_phase")
"""Of a quantity in a cycle, in the order of their rows."""
DRAWS = 200
"""Curves that are drawn: their standard deviation is known to 5 %."""
TAKEN = 0.2
"""Share of what the highest points of drawn curves lie above that of the estimated one which the estimated one lies
above the true one: 1 where it is the truth and noise, 0 where it is the mean of what may be. On 12 simulated bats 0.14
to 0.23 for angles of joints and the body, -0.1 for speeds of markers, all +- 0.2 (docs/experiments/peaks.md)."""
LEAST = 4
"""Frames that a cycle needs."""
MOST = 4_000_000
"""Numbers in the curves that are drawn at a time: 32 MiB."""


def cycle_statistics(
    found: Kinematics, rows: Sequence[Cycle], quantity: str | None = None, *, animal: str = ""
) -> "pd.DataFrame":
    """A row for each cycle, quantity and statistic: what a paper compares.

    Statistics are ``peak``, ``trough``, ``range``, ``mean``, in the quantity's unit, and ``peak_time_s`` (from the
    start of the cycle) and ``peak_phase`` (its share of the cycle). Curves are drawn from a Gaussian process about the
    estimated one, with its standard deviation s and an autocorrelation exp(-d^2 / 2), where d counts the frames
    between in the lengths s / s', s' the standard deviation of the rate: of a process with that autocorrelation they
    are the deviations of value and rate (Rice 1944). A statistic's deviation is that over the curves, so that it
    contains which frame is the highest; of the highest point, the lowest and the range the bias of the estimated curve
    is taken off (``TAKEN``).

    A quantity of a side is taken in the cycles of that side's limbs, another in those of all. Left out are cycles in
    which a frame has no value.

    Args:
        found: The quantities.
        rows: The cycles; of doubtful ones the ``status`` says so.
        quantity: Only this one, with its side (``elbow_l_flexion_deg``) or without, of both (``elbow_flexion_deg``);
            None: all angles, speeds, stated distances and areas.
        animal: What the column ``animal`` says.

    Raises:
        MocapError: there is no such quantity.
    """
    if quantity is None:
        some = [q for q in found.quantities if is_summarised(q, found)]
    else:
        some = [q for q in found.quantities if without_side(q.name) == quantity] or [found[quantity]]
    return statistics_of(some, found, rows, animal=animal)


def statistics_of(
    some: Sequence[Quantity], found: Kinematics, rows: Sequence[Cycle], *, animal: str = ""
) -> "pd.DataFrame":
    """The same of some of the quantities, all of them at once in each cycle."""
    import pandas as pd

    sides, names = [side_of(q.name) for q in some], [without_side(q.name) for q in some]
    none = np.zeros(len(found.t_s))
    rate_sd = [found[name].sd if (name := rate_name(q)) in found else none for q in some]
    curves = np.array([(q.value, q.sd, rate) for q, rate in zip(some, rate_sd, strict=True)])
    turns = np.array([q.unit == "deg" for q in some])
    lines: dict[tuple[int, int], list[tuple]] = {}  # by quantity and cycle
    for k, row in enumerate(rows):
        frames = np.flatnonzero((found.t_s >= row.start_s) & (found.t_s <= row.end_s))
        own = [i for i, side in enumerate(sides) if TRUNK in (side, side_of(row.of)) or side == side_of(row.of)]
        own = [i for i in own if len(frames) >= LEAST and np.isfinite(curves[i, :2, frames]).all()]
        size = max(1, MOST // max(1, len(frames) * max(len(frames), DRAWS)))
        for part in (own[first : first + size] for first in range(0, len(own), size)):
            told = _statistics(curves[np.ix_(part, range(3), frames.tolist())], turns[part], found.t_s[frames], row)
            for i, values, sds in zip(part, *told, strict=True):
                filled = (some[i].rests[frames] != Rests.MEASURED).any()
                status = DOUBTFUL if row.status == DOUBTFUL else "filled" if filled else "measured"
                which = found.recording, animal, row.kind, row.of, row.number, sides[i], names[i]
                units = *[some[i].unit] * 4, "s", "1"
                ends = values - Z95 * sds, values + Z95 * sds
                each = zip(STATISTICS, values, sds, *ends, units, strict=True)
                lines[i, k] = [(*which, *one, status) for one in each]
    return pd.DataFrame([line for at in sorted(lines) for line in lines[at]], columns=list(COLUMNS))


def is_summarised(q: Quantity, found: Kinematics) -> bool:
    """Whether a quantity is an angle (but one that only grows or names a direction), a speed, a distance or an area."""
    if q.name.endswith("_speed_m_s"):
        return True
    if q.kind in ("length", "area"):  # not bones, whose lengths have no rates
        return q.unit in ("m", "m2") and rate_name(q) in found
    return q.unit == "deg" and not q.name.endswith(("_phase_deg", "_heading_deg", "_climb_deg", "_angle_deg"))


def without_side(name: str) -> str:
    """The column's name without the word for its side: ``elbow_flexion_deg`` of ``elbow_l_flexion_deg``."""
    if side_of(name) == TRUNK:
        return name
    return "_".join(part for part in name.split("_") if part.lower() not in ("l", "r", "left", "right"))


def rate_name(q: Quantity) -> str:
    """The name of the rate of a quantity; of a speed that of the acceleration, of a deviation that of the stroke."""
    if q.name.endswith("_deviation_deg"):
        return q.name.replace("_deviation_deg", "_stroke_rate_deg_s")
    if q.name.endswith("_speed_m_s"):
        return q.name.removesuffix("speed_m_s") + "acceleration_m_s2"
    return f"{q.name.removesuffix(q.unit)}rate_{q.unit}_s"


def _statistics(curves: Array, turns: NDArray[np.bool_], time: Array, row: Cycle) -> tuple[Array, Array]:
    """``STATISTICS`` of quantities in a cycle, and their standard deviations.

    Args:
        curves: (Q, 3, n) value, its standard deviation, and that of the rate.
        turns: (Q,) which are angles.
        time: (n,) times.
        row: The cycle.

    Returns:
        (Q, 6) each.
    """
    value, sd, rate_sd = np.moveaxis(curves, 1, 0)
    curve = np.where(turns[:, None], np.degrees(np.unwrap(np.radians(value))), value)
    drawn = curve[:, None] + sd[:, None] * _errors(time, sd, rate_sd)
    tops, bottoms, top, bottom = drawn.max(axis=-1), drawn.min(axis=-1), curve.max(axis=-1), curve.min(axis=-1)
    above, below = TAKEN * (tops.mean(axis=-1) - top), TAKEN * (bottoms.mean(axis=-1) - bottom)
    step = (time[-1] - time[0]) / (len(time) - 1)
    at = time[curve.argmax(axis=-1)] - row.start_s
    spread = np.hypot(time[drawn.argmax(axis=-1)].std(axis=-1), step / np.sqrt(12))  # and between frames
    found = top - above, bottom - below, top - bottom - above + below, curve.mean(axis=-1), at, at / row.duration_s
    of = tops, bottoms, tops - bottoms, drawn.mean(axis=-1)
    deviations = *(one.std(axis=-1) for one in of), spread, spread / row.duration_s
    return np.stack(found, axis=-1), np.stack(deviations, axis=-1)


def _errors(t_s: Array, sd: Array, rate_sd: Array) -> Array:
    """(Q, DRAWS, n) errors over their standard deviations, (Q, n).

    Where no rate is known an error lasts for the whole cycle.
    """
    per_s = np.divide(rate_sd, sd, out=np.zeros(sd.shape), where=(sd > 0) & np.isfinite(rate_sd))
    passed = np.cumsum(0.5 * np.diff(t_s, prepend=t_s[0]) * (per_s + np.roll(per_s, 1, axis=-1)), axis=-1)
    cov = np.exp(-0.5 * (passed[:, :, None] - passed[:, None, :]) ** 2)
    every = np.arange(len(t_s))
    cov[:, every, every] += 1e-6  # equal neighbours: the matrix must have a root
    return _normal(len(t_s)) @ np.linalg.cholesky(cov).swapaxes(1, 2)


@cache
def _normal(count: int) -> Array:
    """(DRAWS, n) standard normal numbers, the same in each run."""
    half = np.random.default_rng(0).standard_normal((DRAWS // 2, count))
    return np.concatenate([half, -half])  # means of them are exact
