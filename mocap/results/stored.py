"""A run as files from which it can be restored exactly: ``markers.nc``, ``run.nc``, ``skeleton.toml``, potentials."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from eal import load_potential
from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.errors import FormatError
from mocap.filters.records import HeldLimb
from mocap.filters.velocities import Motion
from mocap.io.netcdf import as_netcdf
from mocap.joint_angles import JointAngles
from mocap.pipeline.run import JointPotential, Run
from mocap.records import JointTracks, MarkerTracks, PixelTracks, TrackedMotion
from mocap.results.dataset import INDIVIDUAL, markers_dataset
from mocap.skeleton import read_skeleton, write_skeleton

FORMAT = "eal-mocap run 2"
MARKERS, REST, MOTION, SKELETON = "markers.nc", "run.nc", "motion.nc", "skeleton.toml"
PLANAR, SPATIAL = "potentials", "spatial_potentials"
"""Folders of potentials in the planes of limbs, and in the three coordinates of the body."""


def write_arrays(run: Run, folder: Path) -> None:
    """Write what ``read_run`` needs beside ``report.json`` and ``report.md``.

    Of cameras the projection and the picture's size are kept: the pixels that are kept are ideal ones.

    Args:
        run: What to write.
        folder: Where to, as ``mocap.io.output.result_folder`` gives it.
    """
    (folder / MARKERS).write_bytes(as_netcdf(markers_dataset(run.tracked, run.repaired), packed=True))
    (folder / REST).write_bytes(as_netcdf(_rest(run), packed=True))
    (folder / MOTION).write_bytes(as_netcdf(_motion(run.motion)))
    write_skeleton(folder / SKELETON, run.skeleton)
    for kind, potentials in _potentials(run).items():
        for name, potential in potentials.items():
            (folder / kind).mkdir(exist_ok=True)
            potential.potential.save(folder / kind / f"{name}.npz")


def _potentials(run: Run) -> dict[str, Mapping[str, JointPotential]]:
    return {PLANAR: run.potentials, SPATIAL: run.spatial_potentials}


def _motion(motion: Motion) -> xr.Dataset:
    """Velocities and joint covariances of points; covariances are float32 and hardly pack, so they are not packed."""
    own, cross = ("time", "point", "row", "column"), ("time", "pair", "row", "column")
    return xr.Dataset(
        {
            "position": (("time", "point", "space"), motion.xyz_m, {"units": "m"}),
            "velocity": (("time", "point", "space"), motion.velocity_m_s, {"units": "m/s"}),
            "covariance": (own, motion.own),
            "pairs": (("pair", "two"), motion.pairs),
            "pair_covariance": (cross, motion.cross),
            "velocity_change": (("time", "point", "space"), motion.kept.astype(np.float32)),
            "measured": (("time", "point"), motion.measured.astype(np.int8)),
        },
        coords={"time": ("time", motion.t_s, {"units": "s"}), "point": list(motion.names), "space": list("xyz")},
        attrs={"header": json.dumps({"format": FORMAT})},
    )


def read_motion(folder: Path) -> Motion:
    """Velocities and joint covariances that ``write_arrays`` wrote.

    Raises:
        FormatError: there are none, or they cannot be read.
    """
    found, _ = _opened(folder / MOTION)
    return Motion(
        names=tuple(map(str, found["point"].values)),
        t_s=found["time"].values,
        xyz_m=found["position"].values,
        velocity_m_s=found["velocity"].values,
        own=found["covariance"].values,
        pairs=found["pairs"].values,
        cross=found["pair_covariance"].values,
        kept=found["velocity_change"].values,
        measured=found["measured"].values.astype(bool),
    )


def _rest(run: Run) -> xr.Dataset:
    tracked, seen = run.tracked, ("view", "time", "keypoint")
    table: dict[str, tuple] = {
        "reprojected_px": ((*seen, "uv"), tracked.reprojected_px),
        "innovation_px": ((*seen, "uv"), tracked.innovation_px),
        "used": (seen, tracked.used.astype(np.int8)),
        "nis": ("time", tracked.nis),
        "n_rows": ("time", tracked.n_rows),
        "log_likelihood": ("time", tracked.log_likelihood),
    }
    if run.ideal_px is not None:
        table["ideal_px"] = ((*seen, "uv"), run.ideal_px.uv_px)
    if run.cameras:
        table["projection"] = (("view", "row", "column"), np.stack([c.matrix for c in run.cameras]))
    for frame, joints in run.joints.items():
        table[f"joint_{frame}_m"] = (("time", "joint", f"axis_{joints.q_m.shape[2]}"), joints.q_m)
        table[f"joint_{frame}_sd_m"] = (("time", "joint"), joints.sd_m)
    for kind, potentials in _potentials(run).items():
        if potentials:
            samples = np.concatenate([p.samples_m for p in potentials.values()])
            table[f"{kind}_samples_m"] = ((f"{kind}_sample", f"axis_{samples.shape[1]}"), samples)
    for i, limb in enumerate(run.limbs):
        table |= {
            f"limb_{i}_x": (f"limb_{i}_x", limb.x),
            f"limb_{i}_y": (f"limb_{i}_y", limb.y),
            f"limb_{i}_value": ((f"limb_{i}_y", f"limb_{i}_x"), limb.value.astype(np.float32)),
            f"limb_{i}_samples": ((f"limb_{i}_sample", "axis_2"), limb.samples),
            f"limb_{i}_state": (("time", "axis_2"), limb.state),
            f"limb_{i}_cov": (("time", "axis_2", "axis_2b"), limb.cov),
            f"limb_{i}_at_state": ("time", limb.at_state),
            f"limb_{i}_pull": (("time", f"limb_{i}_marker", "axis_3"), limb.pull.astype(np.float32)),
        }
    if run.angles is not None:
        table |= {f"angle_{part}": (("time", "angle"), getattr(run.angles, part)) for part in ("angle_rad", "sd_rad")}
        table["angle_energies"] = (("time", f"energy_{run.angles.energies.shape[1]}"), run.angles.energies)
        table |= {f"angle_{part}": ("segment", getattr(run.angles, part)) for part in ("length_m", "length_sd_m")}
    header = {
        "format": FORMAT,
        "angles": None if run.angles is None else {"names": run.angles.names, "segments": run.angles.segments},
        "limbs": [{"name": limb.name, "markers": limb.markers} for limb in run.limbs],
        "name": run.name,
        "model": tracked.model,
        "y_up": run.y_up,
        "cameras": [{"name": c.name, "size_px": c.size_px} for c in run.cameras],
        "frames": list(run.joints),
        "joints": [joint.name for joint in run.skeleton.joints],
        "potentials": {
            kind: {
                name: {"frame": p.frame, "scale_m": p.scale_m, "samples": len(p.samples_m)}
                for name, p in potentials.items()
            }
            for kind, potentials in _potentials(run).items()
        },
    }
    return xr.Dataset(table, attrs={"header": json.dumps(header)})


def read_run(folder: Path) -> Run:
    """Read what ``write_run`` wrote; all but movies, which stay in ``recording.rrd``.

    Raises:
        FormatError: the folder holds no run, or one of another version.
    """
    for name in (MARKERS, REST, MOTION, SKELETON, "report.json", "report.md"):
        if not (folder / name).is_file():
            raise FormatError(
                f"{folder}: contains no {name}: expected a folder that `mocap track` or save() of this version wrote"
            )
    rest, header = _opened(folder / REST)
    table, _ = _opened(folder / MARKERS)
    names = tuple(map(str, table["keypoint"].values))
    t_s = table["time"].values
    one = table.sel(individual=INDIVIDUAL)
    markers = MarkerTracks(
        names=names,
        t_s=t_s,
        xyz_m=one["position"].transpose("time", "keypoint", "space").values,
        cov_m2=one["covariance"].transpose("time", "keypoint", "space", "space_to").values,
        status=one["status"].transpose("time", "keypoint").values,
    )
    tracked = TrackedMotion(
        model=header["model"],
        markers=markers,
        used=rest["used"].values.astype(bool),
        **{name: rest[name].values for name in ("reprojected_px", "innovation_px", "nis", "n_rows", "log_likelihood")},
    )
    cameras = tuple(
        Camera(name=c["name"], matrix=matrix, size_px=None if c["size_px"] is None else tuple(c["size_px"]))
        for c, matrix in zip(header["cameras"], rest["projection"].values if header["cameras"] else (), strict=True)
    )
    ideal = None
    if "ideal_px" in rest:
        ideal = PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=rest["ideal_px"].values)
    joints = {
        frame: JointTracks(
            names=tuple(header["joints"]),
            frame=frame,
            t_s=t_s,
            q_m=rest[f"joint_{frame}_m"].values,
            sd_m=rest[f"joint_{frame}_sd_m"].values,
        )
        for frame in header["frames"]
    }
    potentials = {
        kind: {
            name: JointPotential(
                joint=name,
                frame=one["frame"],
                scale_m=one["scale_m"],
                samples_m=samples,
                potential=load_potential(folder / kind / f"{name}.npz"),
            )
            for (name, one), samples in zip(found.items(), _samples(rest, kind, found), strict=True)
        }
        for kind, found in header["potentials"].items()
    }
    return Run(
        name=header["name"],
        skeleton=read_skeleton(folder / SKELETON),
        cameras=cameras,
        ideal_px=ideal,
        y_up=header["y_up"],
        tracked=tracked,
        motion=read_motion(folder),
        joints=joints,
        potentials=potentials[PLANAR],
        spatial_potentials=potentials[SPATIAL],
        repaired=one["repaired"].transpose("time", "keypoint").values.astype(bool),
        limbs=tuple(
            HeldLimb(
                name=limb["name"],
                markers=tuple(limb["markers"]),
                **{
                    part: rest[f"limb_{i}_{part}"].values
                    for part in ("x", "y", "value", "samples", "state", "cov", "at_state", "pull")
                },
            )
            for i, limb in enumerate(header.get("limbs", ()))
        ),
        angles=_angles(rest, header.get("angles")),
        report=json.loads((folder / "report.json").read_text(encoding="utf-8")),
        report_text=(folder / "report.md").read_text(encoding="utf-8"),
    )


def _samples(rest: xr.Dataset, kind: str, found: Mapping[str, Mapping[str, Any]]) -> list[Array]:
    """The samples of each potential, which are stored one after the other."""
    ends = np.cumsum([one["samples"] for one in found.values()])
    return np.split(rest[f"{kind}_samples_m"].values, ends[:-1]) if found else []


def _angles(rest: xr.Dataset, header: dict | None) -> JointAngles | None:
    """The joint angles of a run, if it has any."""
    if header is None:
        return None
    parts = {part: rest[f"angle_{part}"].values for part in ("angle_rad", "sd_rad", "length_m", "length_sd_m")}
    nothing = np.zeros((len(parts["angle_rad"]), 0))  # runs that were stored before there were energies
    parts["energies"] = rest["angle_energies"].values if "angle_energies" in rest else nothing
    return JointAngles(names=tuple(header["names"]), segments=tuple(header["segments"]), **parts)


def _opened(path: Path) -> tuple[xr.Dataset, dict]:
    """A dataset in memory, and its header.

    Raises:
        FormatError: it cannot be read, or is of another version.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as file:
            found = file.load()
    except Exception as error:  # xarray, h5netcdf and HDF5 each raise their own
        raise FormatError(
            f"{path}: cannot be read ({type(error).__name__}): it is cut or damaged: track again"
        ) from None
    header = json.loads(found.attrs.get("header", "{}"))
    if header and header.get("format") != FORMAT:
        raise FormatError(f"{path}: is {header.get('format')}, expected {FORMAT}: track again with this version")
    return found, header
