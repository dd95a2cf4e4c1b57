"""What tracking adds to the Dataset of a recording, as the records that formulas and views take, and back."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from mocap.filters.records import HeldLimb
from mocap.filters.velocities import Motion
from mocap.joint_angles import JointAngles
from mocap.joints import FRAMES
from mocap.pipeline.variables import with_variables
from mocap.records import JointTracks

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


def _named(data: xr.Dataset, *, without: Sequence[str] = (), **names: Sequence[str]) -> xr.Dataset:
    """The Dataset with other entries along some dimensions, and so without all that had these dimensions."""
    gone = [dim for dim in (*names, *without) if dim in data.dims]
    return data.drop_dims(gone).assign_coords({dim: np.array(of, dtype=object) for dim, of in names.items()})


def with_motion(data: xr.Dataset, motion: Motion) -> xr.Dataset:
    """The Dataset with these points, their velocities and covariances, in place of others."""
    return with_variables(
        _named(data, without=["pair"], point=motion.names), {name: getattr(motion, of) for name, of in _MOTION.items()}
    )


def motion_of_data(data: xr.Dataset) -> Motion:
    """Markers, the body and the centre of mass, with velocities and joint covariances."""
    parts = {of: data[name].values for name, of in _MOTION.items()}
    return Motion(names=tuple(data["point"].values.tolist()), t_s=data["time"].values, **parts)


def with_joints(data: xr.Dataset, joints: Mapping[str, JointTracks]) -> xr.Dataset:
    """The Dataset with joints by frame of reference, in place of others."""
    first = next(iter(joints.values()), None)
    if first is None or not first.names:
        return _named(data, without=["joint"])
    values = {f"joint_{frame}": tracks.q_m for frame, tracks in joints.items()}
    return with_variables(_named(data, joint=first.names), {**values, "joint_sd": first.sd_m})


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


def with_angles(data: xr.Dataset, angles: JointAngles) -> xr.Dataset:
    """The Dataset with joint angles that were the state of the filter."""
    values = {name: getattr(angles, of) for name, of in _ANGLES.items()}
    values |= {"energies": angles.energies} if angles.energies.size else {}
    return with_variables(_named(data, without=["energy"], angle=angles.names, segment=angles.segments), values)


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
    bare = _named(data, without=["x", "y", "sample"], limb=[limb.name for limb in limbs])
    if not limbs:
        return bare.drop_dims("limb")
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
    return with_variables(bare, {**values, "limb_samples": samples, "limb_marker": place, "limb_pull": pull})


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
