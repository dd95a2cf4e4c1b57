"""A recording: one Dataset of all that is known of it over time, what was given, and what each step found.

Steps add variables to the Dataset (``mocap.variables``), and a part of their own, of a class that lies with them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import Camera, stacked
from mocap.errors import MocapError
from mocap.findings import Finding, worst_first
from mocap.parts import Part
from mocap.records import MarkerTracks, PixelTracks, Plane
from mocap.skeleton import Skeleton
from mocap.variables import VARIABLES, Values

if TYPE_CHECKING:  # with pandas it takes 0.4 s, for which a recording that cannot be read need not wait
    import xarray as xr

AXES = {"pixel": ["u", "v"], "space": ["x", "y", "z"], "space_to": ["x", "y", "z"]}
TOGETHER = {"point": ("pair",), "angle": ("energy",), "limb": ("x", "y", "sample")}
"""Dimensions that are renewed with another one."""
BLOCK = 4000
"""Frames of a block; 34 markers then need half a GB, less than the program itself (docs/experiments/blocks.md)."""
LONG = 20_000
"""Recordings of more frames are tracked in blocks unless something else is asked for; 34 markers then need 3 GB."""


def with_variables(data: "xr.Dataset", values: Mapping[str, Values], **names: Sequence[str]) -> "xr.Dataset":
    """The Dataset with some variables, new or in place of others, read-only.

    Args:
        data: The Dataset.
        values: Arrays by their names in ``VARIABLES``, in its order of dimensions.
        **names: Entries along some dimensions, in place of others, and of all variables that had these dimensions.

    Raises:
        KeyError: there is no such variable.
        ValueError: an array has another shape than the Dataset's dimensions.
    """
    gone = {dim for name in names for dim in (name, *TOGETHER.get(name, ())) if dim in data.dims}
    data = data.drop_dims(gone).assign_coords({dim: np.array(of, dtype=object) for dim, of in names.items()})
    made = {}
    for name, array in values.items():
        variable = VARIABLES[name]
        frozen = np.asarray(array).view()
        frozen.setflags(write=False)
        made[name] = (variable.dims, frozen, {"units": variable.unit} if variable.unit else {})
    axes = {axis for name in values for axis in VARIABLES[name].dims if axis in AXES and axis not in data.coords}
    return data.assign_coords({axis: AXES[axis] for axis in axes}).assign(made)


P = TypeVar("P")


@dataclass(frozen=True, eq=False, kw_only=True)
class Source:
    """What the user gave.

    Attributes:
        file: The file of the tracks; None: they were never in one.
        inputs: All files that were named.
        calibration: What messages call the calibration, where it is given beside the tracks; None: it is not.
        unit: Unit of lengths, as stated.
        pixel_sd: Standard deviation of a pixel, as stated; None: estimated.
        point_sd_mm: Standard deviation of a coordinate of a position, as stated; None: estimated, or as the file says.
        mm_per_px: Millimetres a pixel of one video without a calibration; None: its positions are pixels.
        unusual: What is unusual of the file, or not in it.
        bodies: Rigid bodies that the file states, with the places of their markers in their axes, in metres.
        folder: Where the result was saved or loaded from; None: nowhere yet.
    """

    file: Path | None = None
    inputs: tuple[Path, ...] = ()
    calibration: str | None = None
    unit: str | None = None
    pixel_sd: float | None = None
    point_sd_mm: float | None = None
    mm_per_px: float | None = None
    unusual: tuple[str, ...] = ()
    bodies: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    folder: Path | None = None

    def by_names(self) -> "Source":
        """The same, files by their names alone: a result does not depend on where files lie, nor tell others."""
        file = None if self.file is None else Path(self.file.name)
        return replace(self, file=file, inputs=tuple(Path(path.name) for path in self.inputs), folder=None)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Recording:
    """A recording, from ``mocap.read`` and ``mocap.from_arrays`` on; ``mocap.clean`` and ``mocap.track`` add to it.

    What is known at each time is in ``data``; properties give its variables as plain arrays. T frames, M markers, C
    cameras.

    Attributes:
        name: Of the recording.
        data: Every frame from first to last, markers named as in the skeleton.
        skeleton: What is known of the animal, at least the markers.
        cameras: The C calibrated cameras with their lenses; empty: none are known.
        source: What the user gave.
        parts: What each step found, by the class of the part; ``recording[Cleaned]`` gives one.
    """

    name: str
    data: "xr.Dataset"
    skeleton: Skeleton
    cameras: tuple[Camera, ...] = ()
    source: Source = field(default_factory=Source)
    parts: Mapping[type, Part] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check what is stated."""
        if self.source.mm_per_px is not None and not self.planar:
            raise MocapError("`mm_per_px` is the scale of one video without a calibration: leave it out")
        if self.source.point_sd_mm is not None and self.pixels is not None:
            raise MocapError("`point_sd_mm` is the noise of 3D positions, but pixels are given: state `pixel_sd`")

    def __getitem__(self, kind: type[P]) -> P:
        """What a step found.

        Raises:
            MocapError: it is not known yet.
        """
        if kind not in self.parts:
            step = getattr(kind, "step", "track")
            raise MocapError(f"{self.name}: what {kind.__name__} holds is not known before mocap.{step}")
        return self.parts[kind]  # type: ignore[return-value]

    def get(self, kind: type[P]) -> P | None:
        """What a step found; None: it is not known yet."""
        return self.parts.get(kind)  # type: ignore[return-value]

    def __contains__(self, kind: type) -> bool:
        """Whether the step that finds this has been taken."""
        return kind in self.parts

    def with_part(self, *found: Part) -> Self:
        """The same with what steps found, in place of what they found before and what rested on it."""
        parts = dict(self.parts)
        for one in found:
            gone = {type(one).__name__}
            while more := {kind.__name__ for kind, part in parts.items() if gone & {*part.depends_on}} - gone:
                gone |= more
            parts = {kind: part for kind, part in parts.items() if kind is type(one) or kind.__name__ not in gone}
            parts[type(one)] = one
        return replace(self, parts=parts)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All that was found, or decided: what is wrong, worst first, then the rest step by step."""
        return tuple(worst_first(finding for part in self.parts.values() for finding in part.findings()))

    @property
    def cleaned(self) -> bool:
        """Whether ``clean`` has made it."""
        return any(part.step == "clean" for part in self.parts.values())

    @property
    def file(self) -> Path | None:
        """The file of the tracks; None: they were never in one."""
        return self.source.file

    @property
    def inputs(self) -> tuple[Path, ...]:
        """All files that the user named."""
        return self.source.inputs

    @property
    def folder(self) -> Path | None:
        """Where it was saved or loaded from; None: nowhere yet."""
        return self.source.folder

    @property
    def calibration(self) -> str | None:
        """What messages call the calibration, where it is given beside the tracks; None: it is not."""
        return self.source.calibration

    @property
    def where(self) -> str:
        """What messages call it: its file, or its name."""
        return self.name if self.file is None else self.file.name

    @property
    def names(self) -> tuple[str, ...]:
        """The M markers."""
        return tuple(self.data["keypoint"].values.tolist())

    @property
    def t_s(self) -> Array:
        """(T,) times in seconds."""
        return self.data["time"].values

    def values(self, name: str) -> Values:
        """A variable as a plain array.

        Raises:
            MocapError: it is not known yet.
        """
        if name not in self.data:
            raise MocapError(f"{self.name}: {name} is not known before mocap.{VARIABLES[name].since}")
        return self.data[name].values

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0

    @property
    def fps(self) -> float | None:
        """Frames a second."""
        return self.data.attrs.get("fps")

    @property
    def format(self) -> str:
        """Of the file, in the registry."""
        return self.data.attrs.get("format", "array")

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The C cameras of the pixels, calibrated or not."""
        return tuple(self.data["view"].values.tolist()) if "view" in self.data.coords else ()

    @property
    def filmed(self) -> bool:
        """Whether there are cameras, calibrated or not."""
        return self.calibration is not None or "pixels" in self.data

    @property
    def planar(self) -> bool:
        """Whether this is one video without a calibration."""
        return len(self.camera_names) == 1 and not self.cameras and self.calibration is None

    @property
    def plane(self) -> Plane | None:
        """The image of one video, in which positions are; None: they are in space."""
        return Plane(mm_per_px=self.source.mm_per_px) if self.planar else None

    @property
    def matrices(self) -> Array:
        """(C, 3, 4) projections; C = 0 without cameras."""
        return stacked(self.cameras) if self.cameras else np.zeros((0, 3, 4))

    @property
    def pixels(self) -> PixelTracks | None:
        """Where each camera saw each marker, as in the file; None: there are positions."""
        if "pixels" not in self.data:
            return None
        uv_px = self.data["pixels"].values
        return PixelTracks(names=self.names, cameras=self.camera_names, t_s=self.t_s, uv_px=uv_px)

    @property
    def points(self) -> MarkerTracks | None:
        """Positions of a file, or of the pixels since ``clean``; None: not known yet."""
        return self.tracks if "position" in self.data else None

    @cached_property
    def tracks(self) -> MarkerTracks:
        """Positions with covariance and status, of a file, cleaned, or (since ``track``) smoothed."""
        status = self.data["status"].values
        return MarkerTracks(names=self.names, t_s=self.t_s, xyz_m=self.xyz_m, cov_m2=self.cov_m2, status=status)

    @property
    def score(self) -> Array | None:
        """(C, T, M) likelihoods of clicks, or (T, M) confidence of positions; None: there are none."""
        name = next((name for name in ("likelihood", "confidence") if name in self.data), None)
        return None if name is None else self.data[name].values

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(C, T, M) True where a camera saw a marker; of positions (T, M)."""
        return np.isfinite(self.data["pixels" if "pixels" in self.data else "position"].values[..., 0])

    @property
    def xyz_m(self) -> Array:
        """(T, M, 3) positions; since ``clean`` of believed samples, corrected for slow ray errors, NaN else.

        Since ``track`` those that were smoothed.
        """
        return self.values("position")

    @property
    def cov_m2(self) -> Array:
        """(T, M, 3, 3) covariance of positions, since ``clean`` of their jitter."""
        return self.values("covariance")

    @property
    def ideal_px(self) -> Array:
        """(C, T, M, 2) undistorted pixels in the convention of the coefficients."""
        return self.values("ideal")

    @property
    def late_frames(self) -> Array | None:
        """(C,) offsets that were taken out of ``ideal_px``; None: none was asked to be."""
        return self.data["late"].values if "late" in self.data else None

    def _of_rays(self, name: str, *shape: int) -> Array:
        """A variable of cameras; without cameras an empty array."""
        sizes = self.data.sizes
        return self.data[name].values if name in self.data else np.zeros((0, sizes["time"], sizes["keypoint"], *shape))

    @property
    def uv_px(self) -> Array:
        """(C, T, M, 2) believed ideal pixels, corrected; C = 0 without cameras.

        Where a sample has two and no position, they do not meet: one of them may be right.
        """
        return self._of_rays("believed", 2)

    @property
    def ray_sd_px(self) -> Array:
        """(C, T, M) deviation of a coordinate of each corrected pixel, weighed by how the rays of its marker meet."""
        return self._of_rays("ray_sd")

    @property
    def ray_scale_px(self) -> Array:
        """(C, T, M) scale of Student's t that its error follows before anything is known of the others."""
        return self._of_rays("ray_scale")

    @property
    def rays_rejected(self) -> NDArray[np.bool_]:
        """(C, T, M) rays that miss."""
        return self._of_rays("ray_rejected").astype(bool)

    @property
    def residual_px(self) -> Array:
        """(T, M) residuals of triangulation before correction; NaN without cameras."""
        return self.data["residual"].values if "residual" in self.data else np.full(self.xyz_m.shape[:2], np.nan)

    @property
    def max_speed_m_s(self) -> Array:
        """(M,) speed limits that jumps were judged by."""
        return self.values("most_speed")

    @property
    def rejected(self) -> dict[str, NDArray[np.bool_]]:
        """(T, M) masks by reason."""
        if "rejected" not in self.data:
            return {}
        return dict(zip(self.data["reason"].values.tolist(), self.data["rejected"].values, strict=True))

    @property
    def tracked(self) -> bool:
        """Whether ``track`` has made it; all that follows is known only then."""
        return "model" in self.data.attrs

    @property
    def model(self) -> str:
        """Name of the motion model."""
        return self.data.attrs["model"]

    @property
    def y_up(self) -> bool:
        """Whether the pixel y axis of the file points up (lower-left origin)."""
        return bool(self.data.attrs.get("y_up", False))

    @property
    def repaired(self) -> NDArray[np.int8]:
        """(T, M) 1 where a sample bore another marker's name in the file, 2 where a person corrected it; else 0."""
        return self.values("repaired")

    @property
    def edited(self) -> NDArray[np.bool_]:
        """(T, M) samples that a person corrected (``mocap.reading.edits``)."""
        shape = self.data.sizes["time"], self.data.sizes["keypoint"]
        return self.data["edited"].values if "edited" in self.data else np.zeros(shape, dtype=bool)

    @property
    def by_hand(self) -> NDArray[np.bool_]:
        """(C, T, M) pixels that a person placed; C = 0 without cameras."""
        sizes = self.data.sizes
        none = np.zeros((sizes.get("view", 0), sizes["time"], sizes["keypoint"]), dtype=bool)
        return self.data["by_hand"].values if "by_hand" in self.data else none

    def having(
        self,
        names: Mapping[str, Sequence[str]] | None = None,
        /,
        *,
        rejected: Mapping[str, NDArray[np.bool_]] | None = None,
        **values: Values,
    ) -> Self:
        """The same with some variables, new or in place of others (``mocap.variables``).

        Args:
            names: Entries along some dimensions, in place of others, and of all variables that had these dimensions.
            rejected: Masks (T, M) by reason, in place of all others; None: as they are.
            **values: Arrays by the names of their variables.
        """
        names = dict(names or {})
        if rejected is not None:
            shape = (len(rejected), self.data.sizes["time"], self.data.sizes["keypoint"])
            values["rejected"] = np.array(list(rejected.values()), dtype=bool).reshape(shape)
            names["reason"] = list(rejected)
        return replace(self, data=with_variables(self.data, values, **names))

    def at(self, frames: slice) -> Self:
        """Some of its frames."""
        kept = np.arange(self.data.sizes["time"])[frames]
        parts = {kind: part.at(kept) for kind, part in self.parts.items()}
        return replace(self, data=self.data.isel(time=frames), parts=parts)

    def only(self, markers: NDArray[np.int64]) -> Self:
        """Some of its markers; the skeleton is that of all."""
        parts = {kind: part.only(markers) for kind, part in self.parts.items()}
        return replace(self, data=self.data.isel(keypoint=markers), parts=parts)

    def place(self, part: "Recording") -> tuple[slice, NDArray[np.int64]]:
        """Frames and markers of a part of it (``at``, ``only``)."""
        start = int(np.searchsorted(self.t_s, part.t_s[0]))
        return slice(start, start + len(part.t_s)), np.array([self.names.index(name) for name in part.names])

    def in_space(self, what: str) -> Self:
        """The same, refused where it is of one video.

        Raises:
            MocapError: positions are in the plane of an image.
        """
        if self.plane is not None:
            raise MocapError(f"{self.name}: one video without a calibration: {what} needs positions in space")
        return self

    def without_needless_calibration(self) -> Self:
        """The same, without the calibration where it holds positions and no pixels."""
        if "pixels" in self.data:
            return self
        return replace(self, source=replace(self.source, calibration=None), cameras=())

    def summary(self) -> dict[str, str]:
        """What it holds, as a table of words: frames, markers, cameras, the share seen, what is unusual."""
        n_frames, rate = len(self.t_s), self.fps or 0.0
        there = {
            "file": f"{self.where} ({self.format})",
            "frames": f"{n_frames} ({n_frames / rate:.4g} s at {rate:g} a second)" if rate else str(n_frames),
            "markers": f"{len(self.names)}: {', '.join(self.names)}",
            "cameras": f"{len(self.camera_names)}" if "pixels" in self.data else "none: positions",
            "seen": f"{100 * self.seen.mean():.1f} % of samples" if self.seen.size else "nothing",
            "unit": self.source.unit or self.data.attrs.get("space_unit") or "not stated",
        }
        there |= {} if self.calibration is None else {"calibration": self.calibration}
        there |= {"skeleton": self.skeleton.name} if self.skeleton.bones or self.skeleton.joints else {}
        if self.cleaned:
            there |= {"believed": f"{100 * np.isfinite(self.xyz_m[..., 0]).mean():.1f} % of positions"}
        findings = (*self.findings, *self.source.unusual)
        return there | ({"findings": "; ".join(map(str, findings))} if findings else {})

    def __repr__(self) -> str:
        """A line for each entry of the summary."""
        rows = self.summary()
        width = max(map(len, rows))
        return "\n".join([f"<Recording {self.name!r}>", *(f"  {key:{width}}  {text}" for key, text in rows.items())])

    def _repr_html_(self) -> str:
        cells = (f"<tr><th>{escape(key)}</th><td>{escape(text)}</td></tr>" for key, text in self.summary().items())
        return f"<table><caption>{escape(self.name)}</caption>{''.join(cells)}</table>"


def dataset(
    names: Sequence[str],
    t_s: Values,
    *,
    pixels: PixelTracks | None = None,
    points: MarkerTracks | None = None,
    score: Values | None = None,
    frames: NDArray[np.int64] | None = None,
    **attrs: str | float,
) -> "xr.Dataset":
    """A new Dataset of pixels or positions.

    Args:
        names: The M markers.
        t_s: (T,) times in seconds.
        pixels: Of C cameras.
        points: Positions; left out where there are pixels, which give them.
        score: (C, T, M) of pixels or (T, M) of positions.
        frames: (T,) numbers of the frames; None: from 1.
        **attrs: ``fps``, ``space_unit``, ``format``.
    """
    from xarray import Dataset

    coords = {
        "time": ("time", t_s, {"units": "s"}),
        "frame": ("time", 1 + np.arange(len(t_s)) if frames is None else frames),
        "keypoint": np.array(names, dtype=object),
    }
    values: dict[str, Values] = {}
    if pixels is not None:
        coords["view"] = np.array(pixels.cameras, dtype=object)
        values = {"pixels": pixels.uv_px}
        values |= {} if score is None else {"likelihood": score}
    elif points is not None:
        values = {"position": points.xyz_m, "covariance": points.cov_m2, "status": points.status}
        values |= {} if score is None else {"confidence": score}
    return with_variables(Dataset(coords=coords, attrs=attrs), values)


def of_points(tracks: MarkerTracks, skeleton: Skeleton, *, name: str) -> Recording:
    """A recording of positions in metres that are in memory, named as the skeleton names them."""
    data = dataset(tracks.names, tracks.t_s, points=tracks, space_unit="m")
    return Recording(name=name, data=data, skeleton=skeleton)


def as_recording(given: Any, verb: str) -> Recording:
    """What a verb takes.

    Raises:
        MocapError: it is no recording; the message says how to make one of what came.
    """
    if isinstance(given, Recording):
        return given
    if isinstance(given, str | PathLike):
        how = f"read the file first: mocap.{verb}(mocap.read({str(given)!r}, ...))"
    elif type(given).__name__ in ("ndarray", "DataFrame", "Dataset", "DataArray"):
        how = f"make one of it first: mocap.{verb}(mocap.from_arrays(...))"
    else:
        how = "mocap.read and mocap.from_arrays give one"
    raise MocapError(f"mocap.{verb} takes a recording, not {type(given).__name__}: {how}")
