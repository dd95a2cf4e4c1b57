"""Peak, trough, range and mean of each quantity in each cycle, with intervals that contain where the peak is."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

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
    import pandas as pd

    if quantity is None:
        some = [q for q in found.quantities if is_summarised(q, found)]
    else:
        some = [q for q in found.quantities if without_side(q.name) == quantity] or [found[quantity]]
    lines = [
        (found.recording, animal, row.kind, row.of, row.number, side_of(q.name), without_side(q.name), *line)
        for q in some
        for row in rows
        if TRUNK in (side_of(q.name), side_of(row.of)) or side_of(q.name) == side_of(row.of)
        for line in _statistics(q, found, row)
    ]
    return pd.DataFrame(lines, columns=list(COLUMNS))


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


def _statistics(
    q: Quantity, found: Kinematics, row: Cycle
) -> Iterator[tuple[str, float, float, float, float, str, str]]:
    t_s = found.t_s
    frames = np.flatnonzero((t_s >= row.start_s) & (t_s <= row.end_s))
    if len(frames) < LEAST or not (np.isfinite(q.value[frames]) & np.isfinite(q.sd[frames])).all():
        return
    time = t_s[frames]
    curve = np.degrees(np.unwrap(np.radians(q.value[frames]))) if q.unit == "deg" else q.value[frames]
    rate = found[rate_name(q)].sd[frames] if rate_name(q) in found else np.zeros(len(frames))
    drawn = curve + q.sd[frames] * _errors(time, q.sd[frames], rate)
    status = "filled" if (q.rests[frames] != Rests.MEASURED).any() else "measured"
    status = DOUBTFUL if row.status == DOUBTFUL else status

    def line(
        name: str, value: float, sd: float, unit: str = q.unit
    ) -> tuple[str, float, float, float, float, str, str]:
        return name, value, sd, value - Z95 * sd, value + Z95 * sd, unit, status

    tops, bottoms = drawn.max(axis=1), drawn.min(axis=1)
    above, below = TAKEN * (tops.mean() - curve.max()), TAKEN * (bottoms.mean() - curve.min())
    yield line("peak", curve.max() - above, tops.std())
    yield line("trough", curve.min() - below, bottoms.std())
    yield line("range", np.ptp(curve) - above + below, (tops - bottoms).std())
    yield line("mean", curve.mean(), drawn.mean(axis=1).std())
    step = (time[-1] - time[0]) / (len(time) - 1)
    at = float(time[curve.argmax()] - row.start_s)
    spread = float(np.hypot(time[drawn.argmax(axis=1)].std(), step / np.sqrt(12)))  # and between frames
    yield line("peak_time_s", at, spread, "s")
    yield line("peak_phase", at / row.duration_s, spread / row.duration_s, "1")


def _errors(t_s: Array, sd: Array, rate_sd: Array) -> Array:
    """(DRAWS, n) errors over their standard deviations; where no rate is known an error lasts for the whole cycle."""
    per_s = np.divide(rate_sd, sd, out=np.zeros(len(sd)), where=(sd > 0) & np.isfinite(rate_sd))
    passed = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t_s) * (per_s[1:] + per_s[:-1]))])
    cov = np.exp(-0.5 * np.subtract.outer(passed, passed) ** 2)
    cov[np.diag_indices_from(cov)] += 1e-6  # equal neighbours: the matrix must have a root
    return _normal(len(t_s)) @ np.linalg.cholesky(cov).T


@cache
def _normal(count: int) -> Array:
    """(DRAWS, n) standard normal numbers, the same in each run."""
    half = np.random.default_rng(0).standard_normal((DRAWS // 2, count))
    return np.concatenate([half, -half])  # means of them are exact
