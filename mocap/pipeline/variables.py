"""The variables of a recording: one Dataset of xarray, to which each step adds."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mocap.io.contents import FileContents
from mocap.records import MarkerTracks, PixelTracks

Values = NDArray[Any]
"""Numbers, codes or masks."""

RAY, SAMPLE = ("view", "time", "keypoint"), ("time", "keypoint")


class Variable(NamedTuple):
    """One variable.

    Attributes:
        dims: Its dimensions, in the order in which it is stored.
        unit: Its unit.
        since: The step that adds it: ``read`` or ``clean``.
        meaning: What it is.
    """

    dims: tuple[str, ...]
    unit: str
    since: str
    meaning: str


VARIABLES: Mapping[str, Variable] = {
    "pixels": Variable((*RAY, "pixel"), "px", "read", "where each camera saw each marker, as in the file"),
    "likelihood": Variable(RAY, "", "read", "of each click, as the clicking program states it, 0 to 1"),
    "confidence": Variable(SAMPLE, "", "read", "of each position, as the file states it, 0 to 1"),
    "position": Variable((*SAMPLE, "space"), "m", "read", "of each marker: of a file, or (of pixels) since `clean`"),
    "covariance": Variable((*SAMPLE, "space", "space_to"), "m2", "read", "of each position; NaN: not known"),
    "status": Variable(SAMPLE, "", "read", "codes of `mocap.records.Status`: missing, measured, rejected, ..."),
    "edited": Variable(SAMPLE, "", "read", "samples that a person corrected (`mocap.pipeline.edits`)"),
    "ideal": Variable((*RAY, "pixel"), "px", "clean", "pixels without lens, in step, in the coefficients' convention"),
    "late": Variable(("view",), "frames", "clean", "by which a camera starts or runs late; taken out of `ideal`"),
    "believed": Variable((*RAY, "pixel"), "px", "clean", "`ideal` that is believed, without slowly varying errors"),
    "ray_sd": Variable(RAY, "px", "clean", "standard deviation of a coordinate of `believed`"),
    "ray_scale": Variable(RAY, "px", "clean", "scale of Student's t that its error follows"),
    "ray_rejected": Variable(RAY, "", "clean", "clicks that miss the others of their marker"),
    "residual": Variable(SAMPLE, "px", "clean", "of the triangulation, before slow errors are taken out"),
    "rejected": Variable(("reason", *SAMPLE), "", "clean", "samples that are not believed, by reason"),
    "most_speed": Variable(("keypoint",), "m/s", "clean", "above which a marker jumped"),
    "persistent": Variable(("keypoint",), "px", "clean", "standard deviation of errors that no filter averages out"),
    "camera_factor": Variable(("view", "time"), "", "clean", "how much worse a camera is than in its good time"),
    "lens_covariance": Variable(
        (*SAMPLE, "space", "space_to"), "m2", "clean", "of positions, from a lens that was estimated or is missing"
    ),
}
"""By name. Dimensions are called as in the package movement (``view`` is a camera, ``keypoint`` a marker)."""

AXES = {"pixel": ["u", "v"], "space": ["x", "y", "z"], "space_to": ["x", "y", "z"]}


def with_variables(data: xr.Dataset, values: Mapping[str, Values]) -> xr.Dataset:
    """The Dataset with some variables, new or in place of others, read-only.

    Args:
        data: The Dataset.
        values: Arrays by their names in ``VARIABLES``, in its order of dimensions.

    Raises:
        KeyError: there is no such variable.
        ValueError: an array has another shape than the Dataset's dimensions.
    """
    made = {}
    for name, array in values.items():
        told = VARIABLES[name]
        frozen = np.asarray(array).view()
        frozen.setflags(write=False)
        made[name] = (told.dims, frozen, {"units": told.unit} if told.unit else {})
    axes = {axis for name in values for axis in VARIABLES[name].dims if axis in AXES and axis not in data.coords}
    return data.assign_coords({axis: AXES[axis] for axis in axes}).assign(made)


def with_reasons(data: xr.Dataset, rejected: Mapping[str, NDArray[np.bool_]]) -> xr.Dataset:
    """The Dataset with (T, M) masks of rejected samples by reason, in place of those that it has."""
    shape = (len(rejected), data.sizes["time"], data.sizes["keypoint"])
    masks = np.array(list(rejected.values()), dtype=bool).reshape(shape)
    bare = data.drop_dims("reason", errors="ignore").drop_vars("reason", errors="ignore")
    bare = bare.assign_coords(reason=np.array(list(rejected), dtype=object))
    return with_variables(bare, {"rejected": masks})


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
