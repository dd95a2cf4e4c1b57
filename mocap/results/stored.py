"""A run as files from which it can be restored exactly: ``markers.nc``, ``run.nc``, ``skeleton.toml``, potentials."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from eal import load_potential
from eal.archive import ArchiveError
from mocap.cameras.camera import Camera
from mocap.cameras.lens import MODELS, Lens
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError
from mocap.filters.records import HeldLimb
from mocap.filters.velocities import Motion
from mocap.io.netcdf import as_netcdf, read_netcdf, variables
from mocap.joint_angles import JointAngles
from mocap.joints import FRAMES
from mocap.pipeline.run import JointPotential, Run
from mocap.records import JointTracks, MarkerTracks, PixelTracks, Status, TrackedMotion
from mocap.results.dataset import INDIVIDUAL, markers_dataset
from mocap.schema import POSITIVE, Entry, Schema, checked, names, tables
from mocap.skeleton import read_skeleton, write_skeleton
from mocap.text import file_names

FORMAT = "eal-mocap run 2"
MARKERS, REST, MOTION, SKELETON = "markers.nc", "run.nc", "motion.nc", "skeleton.toml"
PLANAR, SPATIAL = "potentials", "spatial_potentials"
"""Folders of potentials in the planes of limbs, and in the three coordinates of the body."""


def write_arrays(run: Run, folder: Path) -> None:
    """Write what ``read_run`` needs beside ``report.json`` and ``report.md``.

    Pixels that are kept are ideal ones.

    Args:
        run: What to write.
        folder: Where to, as ``mocap.io.output.result_folder`` gives it.
    """
    (folder / MARKERS).write_bytes(as_netcdf(markers_dataset(run.tracked, run.repaired), packed=True))
    (folder / REST).write_bytes(as_netcdf(_rest(run), packed=True))
    (folder / MOTION).write_bytes(as_netcdf(_motion(run.motion)))
    write_skeleton(folder / SKELETON, run.skeleton)
    for kind, potentials in _potentials(run).items():
        for name, potential in zip(file_names(potentials), potentials.values(), strict=True):
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


_AGAIN = "track again"
_MOTION: Schema = {
    "time": Entry(shape=("time",), rising=True),
    "point": names("point", filled=True),
    "position": Entry(shape=("time", "point", "space"), missing=1),
    "velocity": Entry(shape=("time", "point", "space"), missing=1),
    "covariance": Entry(shape=("time", "point", "row", "column"), missing=0, covariance=True),
    "pairs": Entry(kind="i", shape=("pair", "two"), least=0, most="point"),
    "pair_covariance": Entry(shape=("time", "pair", "row", "column"), missing=0),
    "velocity_change": Entry(shape=("time", "point", "space"), missing=1),
    "measured": Entry(kind="i", shape=("time", "point"), least=0, most=1),
}
_MARKERS: Schema = {
    "time": Entry(shape=("time",), rising=True, filled=True),
    "keypoint": names("keypoint", filled=True),
    "individual": Entry(kind="s", shape=("individual",), words=(INDIVIDUAL,)),
    "position": Entry(shape=("time", "individual", "keypoint", "space"), missing=1),
    "covariance": Entry(
        shape=("time", "individual", "keypoint", "space", "space_to"), missing=2, covariance=True, there="position"
    ),
    "status": Entry(kind="i", shape=("time", "individual", "keypoint"), least=0, most=int(max(Status))),
    "repaired": Entry(kind="i", shape=("time", "individual", "keypoint"), least=0, most=2),
}
_SEEN = ("view", "time", "keypoint")
_TRACKED: Schema = {
    "reprojected_px": Entry(shape=(*_SEEN, "uv"), missing=1),
    "innovation_px": Entry(shape=(*_SEEN, "uv"), missing=1),
    "used": Entry(kind="i", shape=_SEEN, least=0, most=1),
    "nis": Entry(shape=("time",), least=0.0, missing=0),
    "n_rows": Entry(kind="i", shape=("time",), least=0),
    "log_likelihood": Entry(shape=("time",), missing=0),
}
_IDEAL: Schema = {"ideal_px": Entry(shape=(*_SEEN, "uv"), missing=1, needed=False)}
_PROJECTION: Schema = {"projection": Entry(shape=("view", "row", "column"))}
_ANGLES: Schema = {
    "angle_angle_rad": Entry(shape=("time", "angle"), missing=0),
    "angle_sd_rad": Entry(shape=("time", "angle"), least=0.0, missing=0, there="angle_angle_rad"),
    "angle_length_m": Entry(shape=("segment",), least=0.0, missing=0),
    "angle_length_sd_m": Entry(shape=("segment",), least=0.0, missing=0),
}
_HEADER: Schema = {
    "name": Entry(kind="s"),
    "model": Entry(kind="s"),
    "y_up": Entry(kind="b"),
    "frames": Entry(kind="s", shape=(None,), unique=True, words=FRAMES),
    "joints": names("joint"),
}
_CAMERA: Schema = {
    "name": Entry(kind="s"),
    "size_px": Entry(kind="i", shape=(2,), least=1, needed=False),
    "lens": Entry(kind="s", words=tuple(MODELS), needed=False),
    "f_px": Entry(shape=(2,), least=POSITIVE, needed=False),
    "centre_px": Entry(shape=(2,), needed=False),
    "coefficients": Entry(shape=(None,), needed=False),
}
_LIMB: Schema = {"name": Entry(kind="s"), "markers": names("markers")}
_NAMES: Schema = {"names": names("angle"), "segments": names("segment")}
_POTENTIAL: Schema = {
    "frame": Entry(kind="s", words=FRAMES),
    "scale_m": Entry(least=POSITIVE),
    "samples": Entry(kind="i", least=1),
}
_AXES = {f"axis_{n}": n for n in (2, 3)} | {"axis_2b": 2, "uv": 2, "two": 2, "space": 3, "space_to": 3, "individual": 1}


def _joint(frame: str) -> Schema:
    axis = "axis_3" if frame in ("world", "body") else "axis_2"
    coordinates = f"joint_{frame}_m"
    return {
        coordinates: Entry(shape=("time", "joint", axis), missing=1),
        f"joint_{frame}_sd_m": Entry(shape=("time", "joint"), least=0.0, missing=0),
    }


def _limb(i: int) -> Schema:
    """Entries of a limb by their attributes' names in ``HeldLimb``, after ``limb_<i>_``."""
    name = f"limb_{i}_"
    return {
        f"{name}x": Entry(shape=(f"{name}x",), rising=True),
        f"{name}y": Entry(shape=(f"{name}y",), rising=True),
        f"{name}value": Entry(shape=(f"{name}y", f"{name}x")),
        f"{name}samples": Entry(shape=(f"{name}sample", "axis_2")),
        f"{name}state": Entry(shape=("time", "axis_2"), missing=1),
        f"{name}cov": Entry(shape=("time", "axis_2", "axis_2b"), missing=2, covariance=True, there=f"{name}state"),
        f"{name}at_state": Entry(shape=("time",), missing=0),
        f"{name}pull": Entry(shape=("time", f"{name}marker", "axis_3"), missing=1),
    }


def _motion_of(path: Path, n_frames: int) -> Motion:
    data, _ = _opened(path)
    found = variables(str(path), data, _MOTION, sizes={**_AXES, "row": 6, "column": 6, "time": n_frames}, again=_AGAIN)
    for name in ("covariance", "pair_covariance"):  # velocities may be unknown where positions are not
        parts = {f"{name}[{i}, {j}]": found[name][..., i : i + 3, j : j + 3] for i in (0, 3) for j in (0, 3)}
        checked(str(path), parts, dict.fromkeys(parts, Entry(shape=(None, None, 3, 3), missing=2)), again=_AGAIN)
    return Motion(
        names=tuple(found["point"]),
        t_s=found["time"],
        xyz_m=found["position"],
        velocity_m_s=found["velocity"],
        own=found["covariance"],
        pairs=found["pairs"],
        cross=found["pair_covariance"],
        kept=found["velocity_change"],
        measured=found["measured"].astype(bool),
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
        "cameras": [{"name": c.name, "size_px": c.size_px} | _lens(c.lens) for c in run.cameras],
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
    sizes = dict(_AXES)
    one = variables(str(folder / MARKERS), table, _MARKERS, sizes=sizes, again=_AGAIN)
    where = f"{folder / REST}: header"
    told = checked(where, header, _HEADER, sizes=sizes, again=_AGAIN)
    cameras = tables(f"{where}: cameras", header.get("cameras"), _CAMERA, again=_AGAIN)
    limbs = tables(f"{where}: limbs", header.get("limbs", []), _LIMB, again=_AGAIN)
    sizes |= {"view": len(cameras), "row": 3, "column": 4}
    sizes |= {f"limb_{i}_marker": len(limb["markers"]) for i, limb in enumerate(limbs)}
    potentials = {kind: _potentials_of(folder, kind, rest, header, told["joints"]) for kind in (PLANAR, SPATIAL)}
    angles = None
    if header.get("angles") is not None:
        angles = checked(f"{where}: angles", header["angles"], _NAMES, sizes=sizes, again=_AGAIN)

    def rest_of(*schemas: Schema) -> dict[str, Any]:
        whole = {name: entry for schema in schemas for name, entry in schema.items()}
        return variables(str(folder / REST), rest, whole, sizes=sizes, again=_AGAIN)

    tracked = rest_of(_TRACKED, _IDEAL)
    t_s, markers, ideal = one["time"], tuple(one["keypoint"]), tracked.pop("ideal_px", None)
    projections = rest_of(_PROJECTION)["projection"] if cameras else ()
    rig = tuple(
        Camera(
            name=c["name"][()],
            matrix=matrix,
            lens=_lens_of(c, where),
            size_px=tuple(c["size_px"].tolist()) if "size_px" in c else None,
        )
        for c, matrix in zip(cameras, projections, strict=True)
    )
    skeleton = read_skeleton(folder / SKELETON).for_markers(markers, source=MARKERS)
    if [joint.name for joint in skeleton.joints] != told["joints"].tolist():
        raise FormatError(f"{folder / SKELETON}: has other joints than {REST}: {_AGAIN}")
    return Run(
        name=told["name"][()],
        skeleton=skeleton,
        cameras=rig,
        ideal_px=None
        if ideal is None
        else PixelTracks(names=markers, cameras=tuple(c.name for c in rig), t_s=t_s, uv_px=ideal),
        y_up=bool(told["y_up"]),
        tracked=TrackedMotion(
            model=told["model"][()],
            markers=MarkerTracks(
                names=markers,
                t_s=t_s,
                xyz_m=one["position"][:, 0],
                cov_m2=one["covariance"][:, 0],
                status=one["status"][:, 0],
            ),
            **tracked,
        ),
        motion=_motion_of(folder / MOTION, len(t_s)),
        joints={
            frame: JointTracks(
                names=tuple(told["joints"]),
                frame=frame,
                t_s=t_s,
                **dict(zip(("q_m", "sd_m"), rest_of(_joint(frame)).values(), strict=True)),
            )
            for frame in told["frames"]
        },
        potentials=potentials[PLANAR],
        spatial_potentials=potentials[SPATIAL],
        repaired=one["repaired"][:, 0].astype(np.int8),
        limbs=tuple(
            HeldLimb(
                name=limb["name"][()],
                markers=tuple(limb["markers"]),
                **{name.removeprefix(f"limb_{i}_"): value for name, value in rest_of(_limb(i)).items()},
            )
            for i, limb in enumerate(limbs)
        ),
        angles=None if angles is None else _angles(angles, rest_of(_ANGLES), rest, sizes, folder / REST),
        report=_report(folder / "report.json"),
        report_text=_text(folder / "report.md"),
    )


def _lens(lens: Lens | None) -> dict[str, Any]:
    if lens is None:
        return {}
    return {
        "lens": lens.model,
        "f_px": lens.f_px,
        "centre_px": lens.centre_px,
        "coefficients": lens.coefficients.tolist(),
    }


def _lens_of(told: Mapping[str, Any], where: str) -> Lens | None:
    """The lens of a camera's record; None: it has none."""
    parts = [told.get(name) for name in ("f_px", "centre_px", "coefficients")]
    if "lens" not in told:
        return None
    model = MODELS[told["lens"][()]]
    if any(part is None for part in parts) or len(parts[2]) != model.n_coefficients:  # type: ignore[arg-type]
        raise FormatError(
            f"{where}: cameras: a {model.model} lens has not its {model.n_coefficients} numbers: {_AGAIN}"
        )
    f_px, centre_px, coefficients = (part.tolist() for part in parts)  # type: ignore[union-attr]
    return model.of(f_px, centre_px, coefficients)


def _potentials_of(
    folder: Path, kind: str, rest: xr.Dataset, header: Mapping[str, Any], joints: Sequence[str]
) -> dict[str, JointPotential]:
    """The potentials of a kind, whose samples are stored one after the other."""
    where, path = f"{folder / REST}: header: potentials: {kind}", folder / REST
    every = header.get("potentials")
    found = every.get(kind) if isinstance(every, dict) else None
    if not isinstance(found, dict) or not found.keys() <= set(joints):
        raise FormatError(f"{where}: expected a table by names of joints: {_AGAIN}")
    if not found:
        return {}
    told = {name: checked(f"{where}: {name}", one, _POTENTIAL, again=_AGAIN) for name, one in found.items()}
    ends = np.cumsum([int(one["samples"]) for one in told.values()])
    sizes = {**_AXES, f"{kind}_sample": int(ends[-1])}
    axis = "axis_2" if kind == PLANAR else "axis_3"
    stored = {f"{kind}_samples_m": Entry(shape=(f"{kind}_sample", axis))}
    samples = variables(str(path), rest, stored, sizes=sizes, again=_AGAIN)[f"{kind}_samples_m"]
    out = {}
    files = file_names(told)
    for (name, one), own, file in zip(told.items(), np.split(samples, ends[:-1]), files, strict=True):
        try:
            potential = load_potential(folder / kind / f"{file}.npz")
        except ArchiveError as error:
            raise FormatError(f"{error}: {_AGAIN}") from None
        if potential.dimension != own.shape[1]:
            raise FormatError(
                f"{folder / kind / file}.npz: has {potential.dimension} coordinates, expected {own.shape[1]}: {_AGAIN}"
            )
        out[name] = JointPotential(
            joint=name,
            frame=one["frame"][()],
            scale_m=float(one["scale_m"]),
            samples_m=own,
            potential=potential,
        )
    return out


def _angles(
    told: Mapping[str, Any], found: dict[str, Any], rest: xr.Dataset, sizes: Mapping[str, int], path: Path
) -> JointAngles:
    parts = {name.removeprefix("angle_"): value for name, value in found.items()}
    n = rest["angle_energies"].shape[-1] if "angle_energies" in rest else 0  # earlier runs have none
    wanted = {"angle_energies": Entry(shape=("time", f"energy_{n}"), missing=0)} if n else {}
    energies = variables(str(path), rest, wanted, sizes={**sizes, f"energy_{n}": 3}, again=_AGAIN)
    parts["energies"] = energies.get("angle_energies", np.zeros((sizes["time"], 0)))
    return JointAngles(names=tuple(told["names"]), segments=tuple(told["segments"]), **parts)


def _text(path: Path) -> str:
    try:
        return regular_bytes(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is no text ({error}): {_AGAIN}") from None


def _report(path: Path) -> dict[str, Any]:
    found = from_json(_text(path), str(path))
    if not isinstance(found, dict):
        raise FormatError(f"{path}: is no report, which is a table: {_AGAIN}")
    return found


def _opened(path: Path) -> tuple[xr.Dataset, dict[str, Any]]:
    """A dataset in memory, and its header.

    Raises:
        FormatError: it cannot be read, or is of another version.
    """
    found = read_netcdf(path, again=_AGAIN)
    header = from_json(str(found.attrs.get("header", "{}")), str(path))
    if not isinstance(header, dict) or (header and header.get("format") != FORMAT):
        told = header.get("format") if isinstance(header, dict) else header
        raise FormatError(f"{path}: is {told}, expected {FORMAT}: track again with this version")
    return found, header
