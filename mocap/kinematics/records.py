"""Quantities over time, each with its standard deviation and whether it rests on measured samples."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import chndtrix

from eal.arrays import Z95, Array, frozen, short_repr, unique
from eal.over_time import OverTime
from mocap.errors import MocapError
from mocap.records import unknown
from mocap.text import number_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Rests(IntEnum):
    """What a value rests on."""

    MISSING = 0  # no value
    MEASURED = 1  # all its markers were measured in that frame
    FILLED = 2  # one of them at least was filled


WORDS = tuple(one.name.lower() for one in Rests)


@dataclass(frozen=True, eq=False, kw_only=True)
class Quantity:
    """One quantity over time.

    Attributes:
        name: Its column, with the unit at the end: ``elbow_l_flexion_deg``.
        unit: Its unit, ``1`` for a number.
        what: What it is, in words.
        kind: What it belongs to: ``joint``, ``marker``, ``body``, ``length``, ``area``, ``stroke``, ``mass``.
        markers: The points that it rests on.
        value: (T,) values; NaN where there is none.
        sd: (T,) their standard deviations; NaN where not known.
        rests: (T,) one ``Rests`` code a value.
    """

    name: str
    unit: str
    what: str
    kind: str
    markers: tuple[str, ...]
    value: OverTime[Array]
    sd: OverTime[Array]
    rests: OverTime[NDArray[np.int8]]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "value", frozen(f"{self.name}: value", self.value, (None,)))
        object.__setattr__(self, "sd", frozen(f"{self.name}: sd", self.sd, (len(self.value),)))
        object.__setattr__(self, "rests", frozen("rests", self.rests, (len(self.value),), dtype=np.int8))

    @property
    def low(self) -> Array:
        """(T,) lower end of the 95 % interval."""
        return self._end(0.025)

    @property
    def high(self) -> Array:
        """(T,) upper end of the 95 % interval."""
        return self._end(0.975)

    def _end(self, share: float) -> Array:
        """(T,) a quantile; of a speed that of the length of a vector, which is never below zero.

        The square of a vector's length, in variances of its components, is noncentral chi-squared. Far from zero the
        normal interval is within sd^2 / value of it.
        """
        end = self.value + np.sign(share - 0.5) * Z95 * self.sd
        near = self.value < 30.0 * self.sd  # above, the normal interval of a length is right within 1/30 SD
        if "speed" not in self.name.split("_") or not near.any():
            return end
        ratio = self.value[near] / self.sd[near]
        end[near] = self.sd[near] * np.sqrt(chndtrix(share, 3, ratio**2))
        return end


WIDEST_DEG = 180.0
"""All that a joint, a stroke or a pitch can be, degrees; of directions, which may be any of 360, twice as much."""
_DIRECTIONS = ("_heading_deg", "_yaw_deg", "_phase_deg", "_rotation_deg")


def without_unknown_angles(found: Sequence[Quantity]) -> tuple[list[Quantity], list[str]]:
    """Quantities without the angles, and rates of them, in frames in which nothing is known of the angle.

    Returns:
        The quantities, missing there; a sentence for the angles of which something was left out in the same frames.
    """
    holes: dict[str, NDArray[np.bool_]] = {}
    for one in found:
        if one.unit == "deg":
            hole = unknown(one.sd, WIDEST_DEG * (2 if one.name.endswith(_DIRECTIONS) else 1))
            if hole.any():
                holes[one.name.removesuffix("_deg")] = hole
    alike: dict[bytes, list[str]] = {}  # included angle and flexion of a joint, at least
    for name, hole in holes.items():
        alike.setdefault(hole.tobytes(), []).append(f"{name}_deg")
    notes = [
        f"unknown in {number_of(sum(frames), 'frame')}, and empty there, as the 95 % interval is as wide as all that "
        f"an angle can be: {', '.join(names)}"
        for frames, names in alike.items()
    ]
    out = []
    for one in found:
        stem = one.name.removesuffix(f"_{one.unit}").removesuffix("_rate").removesuffix("_acceleration")
        hole = holes.get(stem) if one.unit.startswith("deg") else None
        if hole is not None:
            one = replace(
                one,
                value=np.where(hole, np.nan, one.value),
                sd=np.where(hole, np.nan, one.sd),
                rests=np.where(hole, Rests.MISSING, one.rests),
            )
        out.append(one)
    return out, notes


@dataclass(frozen=True, eq=False, kw_only=True)
class Kinematics(Mapping[str, Quantity]):
    """All quantities of a recording, by name.

    Attributes:
        recording: Name of the recording.
        t_s: (T,) times in seconds.
        quantities: The quantities, in the order of their columns.
        notes: What a reader must know: which were left out and why, whose intervals are wider than they need be.
    """

    recording: str
    quantities: tuple[Quantity, ...]
    t_s: OverTime[Array]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check names."""
        unique("quantity", tuple(q.name for q in self.quantities))
        object.__setattr__(self, "_by_name", {q.name: q for q in self.quantities})

    def __getitem__(self, name: str) -> Quantity:
        """A quantity by its name.

        Raises:
            MocapError: there is none of that name.
        """
        found: dict[str, Quantity] = self._by_name  # type: ignore[attr-defined]
        if name not in found:
            parts = name.split("_")
            near = [one for one in found if all(part in one.split("_") for part in parts[:2])] or list(found)
            raise MocapError(f"there is no quantity {name!r}: there are {', '.join(near[:8])}, ...")
        return found[name]

    def __contains__(self, name: object) -> bool:
        """Whether there is a quantity of that name."""
        return name in self._by_name  # type: ignore[attr-defined]

    def __iter__(self) -> Iterator[str]:
        """Names."""
        return (q.name for q in self.quantities)

    def __len__(self) -> int:
        """Number of quantities."""
        return len(self.quantities)

    def __repr__(self) -> str:
        """How many there are of each kind."""
        counts = Counter(q.kind for q in self.quantities)
        kinds = ", ".join(f"{n} {kind}" for kind, n in counts.items())
        return f"<Kinematics of {self.recording!r}: {len(self)} quantities ({kinds}) in {len(self.t_s)} frames>"

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def of(self, kind: str, *, ends: str = "") -> list[Quantity]:
        """Quantities of a kind whose names end so."""
        return [q for q in self.quantities if q.kind == kind and q.name.endswith(ends)]

    def stacked(self, part: str) -> NDArray:
        """(T, Q) values (``value``, ``sd`` or ``rests``) of all quantities."""
        return np.stack([getattr(q, part) for q in self.quantities], axis=1)

    def to_dataframe(self, *, long: bool = False) -> "pd.DataFrame":
        """A row a frame, columns as in ``kinematics.csv``; or (``long``) a row for each quantity and frame."""
        import pandas as pd

        frames = np.arange(1, len(self.t_s) + 1)
        if long:
            titles = ("recording", "frame", "t_s", "quantity", "unit", "value", "sd", "status")
            rows = (
                (self.recording, frames, self.t_s, q.name, q.unit, q.value, q.sd, np.array(WORDS)[q.rests])
                for q in self.quantities
            )
            return pd.concat([pd.DataFrame(dict(zip(titles, row, strict=True))) for row in rows], ignore_index=True)
        columns: dict[str, object] = {"frame": frames}
        for q in self.quantities:
            columns |= {q.name: q.value, f"{q.name}_sd": q.sd, f"{q.name}_status": np.array(WORDS)[q.rests]}
        return pd.DataFrame(columns, index=pd.Index(self.t_s, name="t_s"))

    def to_dataset(self) -> "xr.Dataset":
        """As ``kinematics.nc``: ``value``, ``sd``, ``status`` (time, quantity), with unit, kind and meaning of each."""
        import xarray as xr

        flags = {"flag_values": np.array([int(o) for o in Rests], dtype=np.int8), "flag_meanings": " ".join(WORDS)}
        both = ("time", "quantity")
        return xr.Dataset(
            {
                "value": (both, self.stacked("value")),
                "sd": (both, self.stacked("sd")),
                "status": (both, self.stacked("rests"), flags),
                "unit": ("quantity", [q.unit for q in self.quantities]),
                "kind": ("quantity", [q.kind for q in self.quantities]),
                "meaning": ("quantity", [q.what for q in self.quantities]),
                "markers": ("quantity", [" ".join(q.markers) for q in self.quantities]),
            },
            coords={
                "time": ("time", self.t_s, {"units": "s"}),
                "frame": ("time", np.arange(1, len(self.t_s) + 1)),
                "quantity": list(self),
            },
            attrs={"source_software": "eal-mocap", "recording": self.recording, "notes": "\n".join(self.notes)},
        )


COUNTED, DOUBTFUL = "counted", "doubtful"
"""Whether a cycle is part of means, figures and comparisons (``mocap.kinematics.cycle_checks``)."""


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """One cycle; a row of ``cycles.csv``. NaN where a quantity does not belong to its kind.

    Attributes:
        recording: Name of the recording.
        kind: ``wing_beat``, ``stride`` or ``undulation``.
        of: Limb, foot or body that it is of.
        number: Count from 1.
        start_s: Upper turning point of a wing, footfall, or phase 0 of the wave at the head.
        start_sd_s: Its standard deviation (``turning_sd``).
        middle_sd_s: That of a wing's lower turning point.
        end_s: The next of these.
        end_sd_s: Its standard deviation.
        duration_s: Between them.
        frequency_hz: One over the duration.
        frequency_sd_hz: Its standard deviation.
        filled: Share of its frames in which a marker that says when the limb turns was filled: root or tip of a wing,
            the foot; of a wave the share of filled samples of the chain.
        status: ``counted``, or ``doubtful``: kept, and left out of means, figures and comparisons.
        reason: Why it is doubtful.
        amplitude_deg: Of a wing beat: from the upper to the lower turning point.
        amplitude_sd_deg: Its standard deviation.
        downstroke_fraction: Of a wing beat: share of the cycle from the upper to the lower turning point.
        contact_s: Of a stride: time for which the foot stands.
        duty_factor: That over the duration.
        stride_length_m: Way of the body in the stride.
        body_speed_m_s: That over the duration; for all kinds.
        wavelength_m: Of a wave: along the body.
        amplitude_m: Of a wave: half of the way from side to side, mean over the body.
        phase_lag_deg: Of a wave: by which the last marker's phase is behind the first one's.
    """

    recording: str
    kind: str
    of: str
    number: int
    start_s: float
    start_sd_s: float = np.nan
    end_s: float
    duration_s: float
    frequency_hz: float
    frequency_sd_hz: float = np.nan
    filled: float
    status: str = COUNTED
    reason: str = ""
    middle_sd_s: float = np.nan
    end_sd_s: float = np.nan
    amplitude_deg: float = np.nan
    amplitude_sd_deg: float = np.nan
    downstroke_fraction: float = np.nan
    contact_s: float = np.nan
    duty_factor: float = np.nan
    stride_length_m: float = np.nan
    body_speed_m_s: float = np.nan
    wavelength_m: float = np.nan
    amplitude_m: float = np.nan
    phase_lag_deg: float = np.nan
