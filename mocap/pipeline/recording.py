"""A recording: one Dataset of all that is known of it over time, and what no array can hold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from eal.arrays import Array
from eal.over_time import OverTime, at_frames
from mocap import audit
from mocap.calls import check_stated
from mocap.cameras.camera import Camera, stacked
from mocap.cameras.lens_of_tracks import TrackLens
from mocap.cameras.origin import PixelOrigin
from mocap.cleaning.camera_health import BadTime
from mocap.cleaning.click_noise import USUAL_DOF, ClickNoise
from mocap.cleaning.swaps import Swap
from mocap.errors import MocapError
from mocap.filters.observations import Observations, PixelObservations, PositionObservations
from mocap.filters.records import Limb
from mocap.filters.velocities import Motion, RatePoints
from mocap.findings import Finding
from mocap.io.contents import Bodies, FileContents
from mocap.io.movies import Movie
from mocap.kinematics.compute import kinematics
from mocap.kinematics.points import rate_points_for
from mocap.kinematics.records import Kinematics
from mocap.pipeline.potentials import JointPotential
from mocap.pipeline.variables import VARIABLES, Values
from mocap.records import MarkerTracks, PixelTracks, Plane
from mocap.skeleton import Skeleton

AXES = {"pixel": ["u", "v"], "space": ["x", "y", "z"], "space_to": ["x", "y", "z"]}


MOTION = {
    "point_position": "xyz_m",
    "velocity": "velocity_m_s",
    "point_covariance": "own",
    "pairs": "pairs",
    "pair_covariance": "cross",
    "velocity_change": "kept",
    "measured": "measured",
    "acceleration": "acceleration_m_s2",
    "acceleration_covariance": "acceleration_cov",
}
"""Variables of the fields of ``Motion``; the last two where a model has accelerations."""
TOGETHER = {"point": ("pair",), "angle": ("energy",), "limb": ("x", "y", "sample")}
"""Dimensions that are renewed with another one."""


def with_variables(data: xr.Dataset, values: Mapping[str, Values], **names: Sequence[str]) -> xr.Dataset:
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


def limb_variables(limbs: Mapping[str, Limb]) -> dict[str, Values]:
    """Potentials that held limbs, as variables; of the map and of pulls in single precision."""
    most = max(len(limb["samples"]) for limb in limbs.values())
    values: dict[str, Values] = {}
    for name, one in VARIABLES.items():
        if "limb" in one.dims:
            parts = [limb[name.removeprefix("limb_")] for limb in limbs.values()]
            if "sample" in one.dims:
                parts = [np.pad(part, ((0, most - len(part)), (0, 0)), constant_values=np.nan) for part in parts]
            values[name] = np.stack(parts, axis=one.dims.index("limb"))
    return {**values, **{name: values[name].astype(np.float32) for name in ("limb_value", "limb_pull")}}


@dataclass(frozen=True, eq=False, kw_only=True)
class Footage:
    """The movie of one camera.

    Attributes:
        movie: The movie.
        frames: (T,) its frame, from 0, for each frame of the recording; outside of the movie there is no image.
        straight: True where its pixels are ideal ones already: no lens, or undistorted before.
    """

    movie: Movie
    frames: OverTime[NDArray[np.int64]]
    straight: bool

    @property
    def there(self) -> NDArray[np.bool_]:
        """(T,) frames of the recording that have an image."""
        return (self.frames >= 0) & (self.frames < self.movie.n_frames)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Recording:
    """A recording, from ``mocap.read`` and ``mocap.from_arrays`` on; ``mocap.clean`` and ``mocap.track`` add to it.

    What is known at each time is in ``data``, whose variables are declared in ``mocap.pipeline.variables``; properties
    give them as plain arrays. T frames, M markers, C cameras.

    Attributes:
        name: Of the recording.
        data: Every frame from first to last, markers named as in the skeleton.
        skeleton: What is known of the animal, at least the markers.
        cameras: The C calibrated cameras with their lenses; empty: none are known.
        calibration: What messages call the calibration, where it is given beside the tracks; None: it is not.
        findings: How the files were read where they leave that open, and frames that they leave out; of one that was
            cleaned all findings, those that ask for something to be done (``alarm``) worst first.
        readings: How the calibration and the pixels were read.
        unusual: What is unusual of the file, or not in it.
        bodies: Rigid bodies that the file states, with the places of their markers in their axes, in metres.
        file: The file of the tracks; None: they were never in one.
        inputs: All files that the user named.
        stored: Positions of a file that are compared with those of the pixels; None: there are none.
        unit: Unit of lengths, as the user states it.
        pixel_sd: Standard deviation of a pixel; None: estimated.
        mm_per_px: Millimetres a pixel of one video without a calibration; None: its positions are pixels.
        cleaned: Whether ``clean`` has made it; all that follows is known only then.
        rows: Where pixel rows are counted from, as decided when it was read; None: without two cameras that see
            something, or where its pixels cannot tell (``clean`` says so).
        lens: What was estimated of the lenses from the pixels themselves, and taken out; None: nothing.
        plane: The image of one video, in which positions are; None: they are in space.
        jitter_px: Standard deviation of a coordinate of a pixel, from frame to frame; NaN without cameras.
        bias_px: Standard deviation of the slow ray errors that were removed.
        stated_over_shown: Factor by which all deviations were multiplied, so that they are what the user states of a
            pixel; 1: nothing is stated.
        noise: Relative scales of cameras and markers, and degrees of freedom of cameras, by which rays were weighed;
            None without cameras.
        bad_cameras: Runs of frames in which a camera was bad; contained in ``ray_sd_px``.
        swaps: Runs of frames in which two markers bore each other's names; undone.
        stale: Stored positions that do not follow from the pixels; None where there was no file to compare.
        jumps: Markers that jump.
        audited: What pixels and cameras tell of each other, and of faults of the programs that wrote them.
        potentials: One empirical potential a joint, by joint name, in the planes of its limb.
        spatial_potentials: The same in three coordinates in the body.
        report: What ``report.json`` holds, of one that was tracked.
        report_text: The same as markdown.
        footage: The movie of each camera; empty where none were given.
        folder: Where it was saved or loaded from; None: nowhere yet.
    """

    name: str
    data: xr.Dataset
    skeleton: Skeleton
    cameras: tuple[Camera, ...] = ()
    calibration: str | None = None
    findings: tuple[Finding, ...] = ()
    readings: tuple[Finding, ...] = ()
    unusual: tuple[str, ...] = ()
    bodies: Bodies = field(default_factory=dict)
    file: Path | None = None
    inputs: tuple[Path, ...] = ()
    stored: FileContents | None = None
    unit: str | None = None
    pixel_sd: float | None = None
    mm_per_px: float | None = None
    cleaned: bool = False
    rows: PixelOrigin | None = None
    lens: TrackLens | None = None
    plane: Plane | None = None
    jitter_px: float = np.nan
    bias_px: float = 0.0
    stated_over_shown: float = 1.0
    noise: ClickNoise | None = None
    bad_cameras: tuple[BadTime, ...] = ()
    swaps: tuple[Swap, ...] = ()
    stale: tuple[audit.StalePoint, ...] | None = None
    jumps: tuple[audit.Jump, ...] = ()
    audited: tuple[Finding, ...] = ()
    potentials: Mapping[str, JointPotential] = field(default_factory=dict)
    spatial_potentials: Mapping[str, JointPotential] = field(default_factory=dict)
    report: Mapping[str, object] = field(default_factory=dict)
    report_text: str = ""
    footage: tuple[Footage, ...] = ()
    folder: Path | None = None

    def __post_init__(self) -> None:
        """Check what is stated."""
        for name in ("pixel_sd", "mm_per_px"):
            check_stated(name, getattr(self, name))
        if self.mm_per_px is not None and not self.planar:
            raise MocapError("`mm_per_px` is the scale of one video without a calibration: leave it out")

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
    def matrices(self) -> Array:
        """(C, 3, 4) projections."""
        return stacked(self.cameras)

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
    def reprojected_px(self) -> Array:
        """(C, T, M, 2) ideal pixels of the smoothed positions; C = 0 where only positions were tracked."""
        return self._of_rays("reprojected", 2)

    @property
    def innovation_px(self) -> Array:
        """(C, T, M, 2) measured minus predicted ideal pixel, before the update; NaN where nothing was seen."""
        return self._of_rays("innovation", 2)

    @property
    def used(self) -> NDArray[np.bool_]:
        """(C, T, M) True where a pixel took part in the estimate."""
        return self._of_rays("used").astype(bool)

    @property
    def nis(self) -> Array:
        """(T,) normalised innovation squared of each frame; NaN without rows."""
        return self.values("nis")

    @property
    def n_rows(self) -> NDArray[np.int64]:
        """(T,) scalar observations used in each frame."""
        return self.values("n_rows")

    @property
    def log_likelihood(self) -> Array:
        """(T,) log density of each frame's observations given those before."""
        return self.values("log_likelihood")

    @property
    def repaired(self) -> NDArray[np.int8]:
        """(T, M) 1 where a sample bore another marker's name in the file, 2 where a person corrected it; else 0."""
        return self.values("repaired")

    @cached_property
    def motion(self) -> Motion:
        """Markers, the body and the centre of mass, with velocities and joint covariances."""
        parts = {of: self.data[name].values for name, of in MOTION.items() if name in self.data}
        return Motion(names=tuple(self.data["point"].values.tolist()), t_s=self.t_s, **parts)

    def with_motion(self, motion: Motion) -> "Recording":
        """The same with these points, their velocities and covariances, in place of others."""
        values = {name: getattr(motion, of) for name, of in MOTION.items()}
        return self.having({"point": motion.names}, **{name: of for name, of in values.items() if of is not None})

    @property
    def angles(self) -> xr.Dataset | None:
        """Joint angles that were the filter's state, lengths of segments, energies; None: they were not."""
        own = [name for name, one in VARIABLES.items() if {"angle", "segment", "energy"} & set(one.dims)]
        return self.data[[name for name in own if name in self.data]] if "angle_rad" in self.data else None

    def joints_m(self, frame: str) -> dict[str, Array]:
        """(T, d) coordinates of each joint in a frame of reference (``mocap.joints``); empty where none are known."""
        if f"joint_{frame}" not in self.data:
            return {}
        coordinates = np.moveaxis(self.data[f"joint_{frame}"].values, 1, 0)
        return dict(zip(self.data["joint"].values.tolist(), coordinates, strict=True))

    @property
    def limbs(self) -> dict[str, Limb]:
        """What potentials said of limbs that they held: the variables ``limb_...`` of each, of its own samples.

        ``marker`` is (J,) its markers along the limb, ``pull`` (T, J, 3) on these.
        """
        out = {}
        for i, name in enumerate(self.data["limb"].values.tolist() if "limb" in self.data.coords else ()):
            own = [of for of, one in VARIABLES.items() if "limb" in one.dims]
            limb = {of.removeprefix("limb_"): self.data[of].isel(limb=i).values for of in own}
            index = np.argsort(limb["marker"], kind="stable")[int((limb["marker"] < 0).sum()) :]
            samples = limb["samples"][np.isfinite(limb["samples"][:, 0])]
            out[name] = {**limb, "samples": samples, "marker": index, "pull": limb["pull"][:, index]}
        return out

    @property
    def edited(self) -> NDArray[np.bool_]:
        """(T, M) samples that a person corrected (``mocap.pipeline.edits``)."""
        shape = self.data.sizes["time"], self.data.sizes["keypoint"]
        return self.data["edited"].values if "edited" in self.data else np.zeros(shape, dtype=bool)

    @property
    def by_hand(self) -> NDArray[np.bool_]:
        """(C, T, M) pixels that a person placed; C = 0 without cameras."""
        sizes = self.data.sizes
        none = np.zeros((sizes.get("view", 0), sizes["time"], sizes["keypoint"]), dtype=bool)
        return self.data["by_hand"].values if "by_hand" in self.data else none

    @cached_property
    def rate_points(self) -> RatePoints:
        """The points and pairs of points whose velocities and covariances its kinematics need."""
        return rate_points_for(self.names, self.skeleton, n_frames=len(self.t_s))

    def having(
        self,
        names: Mapping[str, Sequence[str]] | None = None,
        /,
        *,
        rejected: Mapping[str, NDArray[np.bool_]] | None = None,
        **values: Values,
    ) -> "Recording":
        """The same with some variables, new or in place of others (``mocap.pipeline.variables``).

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

    def at(self, frames: slice) -> "Recording":
        """Some of its frames."""
        return replace(
            self, data=self.data.isel(time=frames), footage=tuple(at_frames(f, frames) for f in self.footage)
        )

    def only(self, markers: NDArray[np.int64]) -> "Recording":
        """Some of its markers; the skeleton is that of all."""
        noise = None if self.noise is None else replace(self.noise, marker=self.noise.marker[markers])
        return replace(self, data=self.data.isel(keypoint=markers), noise=noise)

    def place(self, part: "Recording") -> tuple[slice, NDArray[np.int64]]:
        """Frames and markers of a part of it (``at``, ``only``)."""
        start = int(np.searchsorted(self.t_s, part.t_s[0]))
        return slice(start, start + len(part.t_s)), np.array([self.names.index(name) for name in part.names])

    @cached_property
    def kinematics(self) -> Kinematics:
        """Angles, velocities, accelerations, lengths, areas, strokes, each with its standard deviation.

        Raises:
            MocapError: the recording is one video, in the plane of its image.
        """
        self.in_space("kinematics")
        return kinematics(self.motion, self.skeleton, recording=self.name)

    def in_space(self, what: str) -> "Recording":
        """The same, refused where it is of one video.

        Raises:
            MocapError: positions are in the plane of an image.
        """
        if self.plane is not None:
            raise MocapError(f"{self.name}: one video without a calibration: {what} needs positions in space")
        return self

    def observations(self, *, hidden: NDArray[np.bool_] | None = None) -> Observations:
        """Rows for a tracker, of a recording that was cleaned, without (T, M) samples that are hidden."""
        keep = np.ones(self.xyz_m.shape[:2], dtype=bool) if hidden is None else ~hidden
        xyz, cov = np.where(keep[..., None], self.xyz_m, np.nan), self.cov_m2
        if not self.cameras:
            return PositionObservations(xyz_m=xyz, sd_m=np.sqrt(np.trace(cov, axis1=-2, axis2=-1) / 3))
        uv = np.where(keep[None, ..., None], self.uv_px, np.nan)
        middle = np.nanmedian(self.xyz_m.reshape(-1, 3), axis=0)
        depth = np.median(np.abs(self.matrices[:, 2, :3] @ middle + self.matrices[:, 2, 3]))
        return PixelObservations(
            matrices=self.matrices,
            uv_px=uv,
            sd_px=self.ray_scale_px,
            dof=np.full(len(uv), USUAL_DOF) if self.noise is None else self.noise.dof,
            xyz_m=xyz,
            cov_m2=cov,
            wide_m=0.05 * float(depth),  # vaguer ones: no sigma points
            by_hand=self.by_hand,
        )

    def without_needless_calibration(self) -> "Recording":
        """The same, without the calibration where it holds positions and no pixels."""
        return self if "pixels" in self.data else replace(self, calibration=None, cameras=())

    def summary(self) -> dict[str, str]:
        """What it holds, as a table of words: frames, markers, cameras, the share seen, what is unusual."""
        n_frames, rate = len(self.t_s), self.fps or 0.0
        there = {
            "file": f"{self.where} ({self.format})",
            "frames": f"{n_frames} ({n_frames / rate:.4g} s at {rate:g} a second)" if rate else str(n_frames),
            "markers": f"{len(self.names)}: {', '.join(self.names)}",
            "cameras": f"{len(self.camera_names)}" if "pixels" in self.data else "none: positions",
            "seen": f"{100 * self.seen.mean():.1f} % of samples" if self.seen.size else "nothing",
            "unit": self.unit or self.data.attrs.get("space_unit") or "not stated",
        }
        there |= {} if self.calibration is None else {"calibration": self.calibration}
        there |= {"skeleton": self.skeleton.name} if self.skeleton.bones or self.skeleton.joints else {}
        if self.cleaned:
            there |= {"believed": f"{100 * np.isfinite(self.xyz_m[..., 0]).mean():.1f} % of positions"}
        findings = (*self.findings, *self.readings, *self.unusual)
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
) -> xr.Dataset:
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
    return with_variables(xr.Dataset(coords=coords, attrs=attrs), values)


def dataset_of(contents: FileContents) -> xr.Dataset:
    """What files hold, as a Dataset: pixels, or positions where there are none."""
    tracks = contents.points if contents.pixels is None else contents.pixels
    return dataset(
        contents.names,
        np.zeros(0) if tracks is None else tracks.t_s,
        pixels=contents.pixels,
        points=contents.points,
        score=contents.score,
        frames=contents.frames if tracks is not None else None,
        format=contents.format,
        **({} if contents.fps is None else {"fps": contents.fps}),
        **({} if contents.unit is None else {"space_unit": contents.unit}),
    )


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
