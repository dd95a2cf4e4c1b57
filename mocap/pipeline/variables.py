"""The variables of a recording: one Dataset of xarray, to which each step adds, and what views take of it."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mocap.filters.records import HeldLimb
from mocap.filters.velocities import Motion
from mocap.io.contents import FileContents
from mocap.joints import FRAMES
from mocap.records import JointAngles, JointTracks, MarkerTracks, PixelTracks, Status
from mocap.schema import Entry

Values = NDArray[Any]
"""Numbers, codes or masks."""

RAY, SAMPLE = ("view", "time", "keypoint"), ("time", "keypoint")
POINT, LIMB = ("time", "point"), ("time", "limb")


class Variable(NamedTuple):
    """One variable.

    Attributes:
        dims: Its dimensions, in the order in which it is stored.
        unit: Its unit.
        since: The step that adds it: ``read``, ``clean`` or ``track``.
        meaning: What it is.
        entry: What else a file must hold (``mocap.schema``): numbers are real and may be missing, all components of a
            vector together, where nothing else is said.
    """

    dims: tuple[str, ...]
    unit: str
    since: str
    meaning: str
    entry: Mapping[str, Any] = {}


def codes(most: int | str) -> dict[str, Any]:
    """What whole numbers from 0 must be: at most so much; the name of a dimension: an index of it."""
    return {"kind": "i", "least": 0, "most": most}


TRUTH: Mapping[str, Any] = {"kind": "b", "missing": None}
FULL: Mapping[str, Any] = {"missing": None}
VECTORS, MATRICES = {"pixel", "space", "axis"}, {("space", "space_to"), ("axis", "axis_to")}
SIZES = {"pixel": 2, "space": 3, "space_to": 3, "axis": 2, "axis_to": 2, "row": 6, "column": 6, "end": 2, "energy": 3}
"""Of dimensions that are the same of every recording."""

VARIABLES: Mapping[str, Variable] = {
    "pixels": Variable((*RAY, "pixel"), "px", "read", "where each camera saw each marker, as in the file"),
    "likelihood": Variable(RAY, "", "read", "of each point, as the digitising program states it, 0 to 1"),
    "confidence": Variable(SAMPLE, "", "read", "of each position, as the file states it, 0 to 1"),
    "position": Variable(
        (*SAMPLE, "space"), "m", "read", "of each marker: of a file, (of pixels) since `clean`; smoothed since `track`"
    ),
    "covariance": Variable(
        (*SAMPLE, "space", "space_to"), "m2", "read", "of each position; NaN: not known", {"there": "position"}
    ),
    "status": Variable(
        SAMPLE, "", "read", "codes of `mocap.records.Status`: missing, measured, rejected, ...", codes(max(Status))
    ),
    "edited": Variable(SAMPLE, "", "read", "samples that a person corrected (`mocap.pipeline.edits`)", TRUTH),
    "by_hand": Variable(RAY, "", "read", "pixels that a person placed; since `clean` where `believed` has them", TRUTH),
    "overruled": Variable((*RAY, "pixel"), "px", "read", "what the file has where a person placed a marker"),
    "ideal": Variable((*RAY, "pixel"), "px", "clean", "pixels without lens, in step, in the coefficients' convention"),
    "late": Variable(("view",), "frames", "clean", "by which a camera starts or runs late; taken out of `ideal`"),
    "believed": Variable((*RAY, "pixel"), "px", "clean", "`ideal` that is believed, without slowly varying errors"),
    "ray_sd": Variable(RAY, "px", "clean", "standard deviation of a coordinate of `believed`"),
    "ray_scale": Variable(RAY, "px", "clean", "scale of Student's t that its error follows"),
    "ray_rejected": Variable(RAY, "", "clean", "points that contradict the other cameras", TRUTH),
    "residual": Variable(SAMPLE, "px", "clean", "of the triangulation, before slow errors are taken out"),
    "rejected": Variable(("reason", *SAMPLE), "", "clean", "samples that are not believed, by reason", TRUTH),
    "most_speed": Variable(("keypoint",), "m/s", "clean", "above which a marker jumped"),
    "persistent": Variable(("keypoint",), "px", "clean", "standard deviation of errors that no filter averages out"),
    "camera_factor": Variable(("view", "time"), "", "clean", "how much worse a camera is than in its good time"),
    "lens_covariance": Variable(
        (*SAMPLE, "space", "space_to"), "m2", "clean", "of positions, from a lens that was estimated or is missing"
    ),
    "reprojected": Variable((*RAY, "pixel"), "px", "track", "smoothed positions in each camera, as `ideal`"),
    "innovation": Variable((*RAY, "pixel"), "px", "track", "measured minus predicted, before the update"),
    "used": Variable(RAY, "", "track", "pixels that took part in the estimate", TRUTH),
    "nis": Variable(("time",), "", "track", "normalised innovation squared of each frame", {"least": 0.0}),
    "n_rows": Variable(("time",), "", "track", "scalar observations used in each frame", codes(2**31)),
    "log_likelihood": Variable(("time",), "", "track", "log density of a frame's observations given those before"),
    "repaired": Variable(
        SAMPLE, "", "track", "1: bore another marker's name in the file, 2: corrected by a person", codes(2)
    ),
    "point_position": Variable((*POINT, "space"), "m", "track", "of markers, of the body and the centre of mass"),
    "velocity": Variable((*POINT, "space"), "m/s", "track", "of the same points"),
    "point_covariance": Variable(
        (*POINT, "row", "column"), "", "track", "of [position, velocity] of a point", {"covariance": True}
    ),
    "pairs": Variable(("pair", "end"), "", "track", "two points whose covariance is kept", codes("point")),
    "pair_covariance": Variable(
        ("time", "pair", "row", "column"), "", "track", "of the first's [position, velocity] with the second's"
    ),
    "velocity_change": Variable(
        (*POINT, "space"), "", "track", "variance of v(t+1) - v(t-1) over the sum of the variances of both"
    ),
    "measured": Variable(POINT, "", "track", "points of which all that they rest on was measured", TRUTH),
    "joint_world": Variable(("time", "joint", "space"), "m", "track", "child of a joint from its centre"),
    "joint_body": Variable(("time", "joint", "space"), "m", "track", "the same in the axes of the trunk"),
    "joint_plane": Variable(("time", "joint", "axis"), "m", "track", "the same in the mean plane of its limb"),
    "joint_limb": Variable(
        ("time", "joint", "axis"), "m", "track", "the same in the plane of its limb at each instant"
    ),
    "joint_sd": Variable(("time", "joint"), "m", "track", "standard deviation of a coordinate", {"least": 0.0}),
    "angle_rad": Variable(("time", "angle"), "rad", "track", "joint angles that were the state of the filter"),
    "angle_sd_rad": Variable(
        ("time", "angle"), "rad", "track", "their standard deviations", {"least": 0.0, "there": "angle_rad"}
    ),
    "energies": Variable(("time", "energy"), "", "track", "energy (J), V_z and its bound of a Lagrangian"),
    "segment_length": Variable(("segment",), "m", "track", "of segments between these joints", {"least": 0.0}),
    "segment_length_sd": Variable(("segment",), "m", "track", "their standard errors", {"least": 0.0}),
    "limb_x": Variable(("limb", "x"), "", "track", "first coordinate of a map of the potential that held a limb", FULL),
    "limb_y": Variable(("limb", "y"), "", "track", "its second coordinate", FULL),
    "limb_value": Variable(("limb", "y", "x"), "", "track", "V_z on that map", FULL),
    "limb_samples": Variable(("limb", "sample", "axis"), "", "track", "what that potential was learned from"),
    "limb_marker": Variable(
        ("limb", "keypoint"),
        "",
        "track",
        "place of a marker along the limb; -1: not of it",
        {"kind": "i", "least": -1, "most": "keypoint"},
    ),
    "limb_state": Variable((*LIMB, "axis"), "", "track", "the limb on the map"),
    "limb_covariance": Variable((*LIMB, "axis", "axis_to"), "", "track", "its covariance", {"there": "limb_state"}),
    "limb_at_state": Variable(LIMB, "", "track", "V_z at the limb"),
    "limb_pull": Variable((*LIMB, "keypoint", "space"), "1/(m s)", "track", "of the potential on each marker"),
}
"""By name. Dimensions are called as in the package movement (``view`` is a camera, ``keypoint`` a marker)."""


def entry_of(name: str) -> Entry:
    """What a file must hold as a variable."""
    one = VARIABLES[name]
    matrix = one.dims[-2:] in MATRICES
    missing = 2 if matrix else int(one.dims[-1] in VECTORS)
    return Entry(**{"shape": one.dims, "missing": missing, "covariance": matrix, **one.entry})


AXES = {"pixel": ["u", "v"], "space": ["x", "y", "z"], "space_to": ["x", "y", "z"]}


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
    return with_variables(data, {"rejected": masks}, reason=list(rejected))


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


_MOTION = {
    "point_position": "xyz_m",
    "velocity": "velocity_m_s",
    "point_covariance": "own",
    "pairs": "pairs",
    "pair_covariance": "cross",
    "velocity_change": "kept",
    "measured": "measured",
}
_ANGLES = {
    "angle_rad": "angle_rad",
    "angle_sd_rad": "sd_rad",
    "segment_length": "length_m",
    "segment_length_sd": "length_sd_m",
}
_LIMB = {"state": "state", "covariance": "cov", "at_state": "at_state"}


def with_motion(data: xr.Dataset, motion: Motion) -> xr.Dataset:
    """The Dataset with these points, their velocities and covariances, in place of others."""
    return with_variables(data, {name: getattr(motion, of) for name, of in _MOTION.items()}, point=motion.names)


def motion_of_data(data: xr.Dataset) -> Motion:
    """Markers, the body and the centre of mass, with velocities and joint covariances."""
    parts = {of: data[name].values for name, of in _MOTION.items()}
    return Motion(names=tuple(data["point"].values.tolist()), t_s=data["time"].values, **parts)


def with_joints(data: xr.Dataset, joints: Mapping[str, JointTracks]) -> xr.Dataset:
    """The Dataset with joints by frame of reference, in place of others."""
    first = next(iter(joints.values()), None)
    if first is None or not first.names:
        return data
    values = {f"joint_{frame}": tracks.q_m for frame, tracks in joints.items()}
    return with_variables(data, {**values, "joint_sd": first.sd_m}, joint=first.names)


def joints_of_data(data: xr.Dataset) -> dict[str, JointTracks]:
    """Joints by frame of reference; none without joints."""
    out, t_s = {}, data["time"].values
    for frame in FRAMES:
        if f"joint_{frame}" in data:
            q_m = data[f"joint_{frame}"].values
            sd_m = np.where(np.isfinite(q_m[..., 0]), data["joint_sd"].values, np.nan)
            names = tuple(data["joint"].values.tolist())
            out[frame] = JointTracks(names=names, frame=frame, t_s=t_s, q_m=q_m, sd_m=sd_m)
    return out


def angles_of_data(data: xr.Dataset) -> JointAngles | None:
    """Joint angles; None where they were not the state."""
    if "angle_rad" not in data:
        return None
    parts = {of: data[name].values for name, of in _ANGLES.items()}
    energies = data["energies"].values if "energies" in data else np.zeros((data.sizes["time"], 0))
    names, segments = (tuple(data[dim].values.tolist()) for dim in ("angle", "segment"))
    return JointAngles(names=names, segments=segments, energies=energies, **parts)


def with_limbs(data: xr.Dataset, limbs: Sequence[HeldLimb]) -> xr.Dataset:
    """The Dataset with the potentials that held limbs; of the map and of pulls in single precision."""
    if not limbs:
        return data
    markers = data["keypoint"].values.tolist()
    most = max(len(limb.samples) for limb in limbs)
    place = np.full((len(limbs), len(markers)), -1)
    pull = np.full((data.sizes["time"], len(limbs), len(markers), 3), np.nan, dtype=np.float32)
    samples = np.full((len(limbs), most, 2), np.nan)
    for i, limb in enumerate(limbs):
        index = [markers.index(name) for name in limb.markers]
        place[i, index], pull[:, i, index] = np.arange(len(index)), limb.pull
        samples[i, : len(limb.samples)] = limb.samples
    values = {f"limb_{name}": np.stack([getattr(limb, of) for limb in limbs], axis=1) for name, of in _LIMB.items()}
    for name in ("x", "y", "value"):
        values[f"limb_{name}"] = np.stack([getattr(limb, name) for limb in limbs])
    values["limb_value"] = values["limb_value"].astype(np.float32)
    values |= {"limb_samples": samples, "limb_marker": place, "limb_pull": pull}
    return with_variables(data, values, limb=[limb.name for limb in limbs])


def limbs_of_data(data: xr.Dataset) -> tuple[HeldLimb, ...]:
    """Limbs on the potentials that held them."""
    out = []
    for i, name in enumerate(data["limb"].values.tolist() if "limb" in data.coords else ()):
        one = data.isel(limb=i)
        place = one["limb_marker"].values
        index = np.argsort(place, kind="stable")[int((place < 0).sum()) :]
        samples = one["limb_samples"].values
        out.append(
            HeldLimb(
                name=name,
                markers=tuple(data["keypoint"].values[index].tolist()),
                samples=samples[np.isfinite(samples[:, 0])],
                pull=one["limb_pull"].values[:, index],
                **{part: one[f"limb_{part}"].values for part in ("x", "y", "value")},
                **{of: one[f"limb_{part}"].values for part, of in _LIMB.items()},
            )
        )
    return tuple(out)
