"""The variables of a recording: one Dataset of xarray, to which each step adds."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from numpy.typing import NDArray

from mocap.records import Status
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
    "edited": Variable(SAMPLE, "", "read", "samples that a person corrected (`mocap.reading.edits`)", TRUTH),
    "by_hand": Variable(RAY, "", "read", "pixels that a person placed; since `clean` where `believed` has them", TRUTH),
    "overruled": Variable((*RAY, "pixel"), "px", "read", "what the file has where a person placed a marker"),
    "ideal": Variable((*RAY, "pixel"), "px", "read", "pixels without lens, in step, in the coefficients' convention"),
    "late": Variable(("view",), "frames", "read", "by which a camera starts or runs late; taken out of `ideal`"),
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
    "unknown": Variable(
        SAMPLE, "", "track", "left empty: the 95 % interval is as wide as the animal is long (`unknown_samples`)", TRUTH
    ),
    "departure": Variable(
        ("keypoint",),
        "m",
        "track",
        "RMS of what the track leaves positions by above their noise, in `covariance`",
        FULL,
    ),
    "nis": Variable(("time",), "", "track", "normalised innovation squared of each frame", {"least": 0.0}),
    "n_rows": Variable(("time",), "", "track", "scalar observations used in each frame", codes(2**31)),
    "log_likelihood": Variable(("time",), "", "track", "log density of a frame's observations given those before"),
    "repaired": Variable(
        SAMPLE, "", "clean", "1: bore another marker's name in the file, 2: corrected by a person", codes(2)
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
    "acceleration": Variable((*POINT, "space"), "m/s2", "track", "of the same points, where the model has it"),
    "acceleration_covariance": Variable((*POINT, "space", "space_to"), "", "track", "of each acceleration"),
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
