"""A made-up flight, rich in all that a view can show, from closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from mocap.filters.velocities import without_rates

from eal.arrays import Array
from eal.kernels import GaussianKernel
from eal.potential import fit_potential
from mocap.cameras.camera import Camera, pinhole_camera, project, stacked
from mocap.recording import of_points
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Bone, Joint, Skeleton
from mocap.tracking.model_choice import ModelChoice
from mocap.tracking.potentials import SPACE, JointPotential, Potentials, joint_potentials
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result

SIZE_PX = (1280, 800)
NOISE_PX = 0.7
_WING = ("shoulder", "elbow", "wrist", "thumb", "tip3", "tip4", "tip5")
_BODY = ("head", "neck", "back", "rump")


def skeleton(*, n_extra: int = 0) -> Skeleton:
    """Four markers along the trunk, seven on each wing, and some more on the skin."""
    wings = [f"{side}_{m}" for side in "LR" for m in _WING]
    pairs = [("head", "neck"), ("neck", "back"), ("back", "rump")]
    for s in "LR":
        arm = ["neck", f"{s}_shoulder", f"{s}_elbow", f"{s}_wrist", f"{s}_thumb"]
        pairs += list(pairwise(arm))
        pairs += [(f"{s}_wrist", f"{s}_{m}") for m in ("tip3", "tip4", "tip5")] + [(f"{s}_tip5", "rump")]
    joints = [
        Joint(name=f"{s}_{c}", parent=f"{s}_{p}", centre=f"{s}_{c}", child=f"{s}_{d}")
        for s in "LR"
        for p, c, d in (("shoulder", "elbow", "wrist"), ("elbow", "wrist", "tip3"))
    ]
    return Skeleton(
        name="flapper",
        markers=(*_BODY, *wings, *(f"skin{i}" for i in range(n_extra))),
        bones=tuple(Bone(a=a, b=b) for a, b in pairs),
        joints=tuple(joints),
        trunk=_BODY,
    )


def flight_m(t_s: Array) -> Array:
    """(T, 18, 3) positions in metres: flight to and fro along x, the wings beating at 9 Hz, left is +y."""
    phase = 2 * np.pi * 9 * t_s
    trunk = np.array([(0.06, 0, 0.01), (0.035, 0, 0), (0, 0, 0), (-0.04, 0, -0.005)])
    along = (0.03, 0.015, 0.05, 0.06, 0.03, -0.03, -0.05)
    across = (0.02, 0.06, 0.10, 0.11, 0.2, 0.17, 0.11)
    wing = np.column_stack([along, across, np.zeros(7)])
    beat = 0.75 * np.sin(phase)[:, None] * (0.6 + 4 * (wing[:, 1] - 0.02))
    fold = 1 - 0.25 * np.clip(np.cos(phase), 0, 1)[:, None] * (wing[:, 1] > 0.05)
    reach = (wing[:, 1] - 0.02) * fold
    sweep = wing[:, 0] - 0.03 * np.cos(phase)[:, None] * reach / 0.2
    left = np.stack([sweep, 0.02 + reach * np.cos(beat), reach * np.sin(beat)], axis=-1)
    right = left * (1, -1, 1)
    body = np.concatenate([np.broadcast_to(trunk, (len(t_s), 4, 3)), left, right], axis=1)
    along = 0.4 * np.sin(1.3 * t_s - 0.9)
    path = np.column_stack([along, 0.05 * np.sin(3 * t_s), 0.6 + 0.012 * np.cos(phase) + 0.1 * along])
    return body + path[:, None]


def ring(n_cameras: int, *, handed: float = 1.0, y_up: bool = False, skew: float = 0.0) -> tuple[Camera, ...]:
    """Cameras round the flight, looking at its middle.

    Args:
        n_cameras: How many.
        handed: -1 for cameras of a left-handed world, the mirror image in x.
        y_up: Pixels that run up.
        skew: Of the sensor, in pixels; the two focal lengths then differ too.
    """
    centre = np.array([0.0, 0.0, 0.65])
    out = []
    for i in range(n_cameras):
        angle = 2 * np.pi * i / max(n_cameras, 1) + 0.6
        position = centre + np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.25 + 0.3 * (i % 3)])
        forward = (centre - position) / np.linalg.norm(centre - position)
        right = np.cross(forward, (0, 0, 1.0)) / np.linalg.norm(np.cross(forward, (0, 0, 1.0)))
        rotation = np.stack([right, np.cross(forward, right), forward])
        intrinsic = np.array([[1100.0, skew, 650.0], [0, 1100.0 + 2 * skew, 385.0], [0, 0, 1]])
        camera = pinhole_camera(
            f"cam{i + 1}", intrinsic=intrinsic, rotation=rotation, translation_m=-rotation @ position, size_px=SIZE_PX
        )
        flip = np.array([[1, 0, 0], [0, -1, SIZE_PX[1]], [0, 0, 1.0]]) if y_up else np.eye(3)
        matrix = flip @ camera.matrix @ np.diag([handed, 1, 1, 1])
        out.append(Camera(name=camera.name, matrix=matrix, size_px=SIZE_PX))
    return tuple(out)


def make_run(
    *,
    n_frames: int = 200,
    n_cameras: int = 4,
    n_joints: int = 2,
    handed: float = 1.0,
    y_up: bool = False,
    skew: float = 0.0,
    n_extra: int = 0,
    seed: int = 7,
) -> Result:
    """A run as the main job would hand it over: gaps in bursts, rejected samples, innovations, potentials."""
    rng = np.random.default_rng(seed)
    body = skeleton(n_extra=n_extra)
    t_s = np.arange(n_frames) / 250.0
    truth = flight_m(t_s) * (handed, 1, 1)
    truth = np.concatenate([truth, truth[:, :n_extra] + 0.01], axis=1)
    n_markers = len(body.markers)
    cameras = ring(n_cameras, handed=handed, y_up=y_up, skew=skew)
    lost = np.zeros((n_frames, n_markers), dtype=bool)
    for m in range(4, n_markers):
        for start in rng.integers(0, n_frames, size=1 + m % 3):
            lost[start : start + rng.integers(6, 26), m] = True
    rejected = (rng.random((n_frames, n_markers)) < 0.006) & ~lost
    origin = np.where(lost, Status.SMOOTHED, np.where(rejected, Status.REJECTED, Status.MEASURED))
    origin[: min(5, n_frames), -1] = Status.MISSING
    sd_m = np.where(lost, 0.006, 0.0012)[..., None] * (1.0, 0.7, 1.6)
    xyz = truth + rng.normal(size=truth.shape) * 0.3 * sd_m
    xyz[origin == Status.MISSING] = np.nan
    cov = np.where(np.isnan(xyz[..., :1, None]), np.nan, sd_m[..., None] ** 2 * np.eye(3))
    markers = MarkerTracks(names=body.markers, t_s=t_s, xyz_m=xyz, cov_m2=cov, status=origin)
    rays = _pixels(cameras, truth, markers, lost, rejected, rng)
    joints, potentials = _joints(body, truth, t_s, n_joints, rng)
    motion = without_rates(markers.names, t_s, xyz, cov, origin == Status.MEASURED)
    known = {"status": markers.status, "repaired": np.zeros(origin.shape, dtype=np.int8), **rays}
    found = Result.of(of_points(markers, body, name="flapper-demo"))
    if cameras:
        found = replace(found, data=found.data.assign_coords(view=np.array([c.name for c in cameras], dtype=object)))
    named = {"joint": [joint.name for joint in body.joints[:n_joints]]} if joints else {}
    found = found.having(named, **known, **joints).with_motion(motion)
    return replace(
        found,
        data=found.data.assign_attrs(model="stand-in", y_up=int(y_up)),
        cameras=cameras,
    ).with_part(
        ModelChoice(why="a stand-in"),
        Potentials(planar=potentials, spatial=joint_potentials(found.joints_m(SPACE), SPACE, markers, body)),
        Report(numbers={}, text=_REPORT),
    )


def _pixels(
    cameras: tuple[Camera, ...],
    truth: Array,
    markers: MarkerTracks,
    lost: Array,
    rejected: Array,
    rng: np.random.Generator,
) -> dict[str, Array]:
    shape = (len(cameras), *markers.status.shape)
    seen = (rng.random(shape) < 0.9) & ~lost
    exact = project(stacked(cameras), truth) if cameras else np.empty((*shape, 2))
    smoothed = project(stacked(cameras), markers.xyz_m) if cameras else np.empty((*shape, 2))
    noise = NOISE_PX * rng.normal(size=exact.shape)
    wrong = seen & rejected & (rng.random(shape) < 0.5)
    noise[wrong] += 40.0
    uv = np.where(seen[..., None], exact + noise, np.nan)
    used = seen & ~wrong & markers.seen
    innovation = np.where(seen[..., None], 1.5 * noise, np.nan)
    n_rows = 2 * used.sum(axis=(0, 2)) if cameras else 3 * (~lost).sum(axis=1)
    nis = rng.chisquare(np.maximum(n_rows, 1))
    over_time = {
        "nis": np.where(n_rows > 0, nis, np.nan),
        "n_rows": n_rows,
        "log_likelihood": -0.5 * nis - 1.2 * n_rows,
    }
    rays = {"ideal": uv, "reprojected": smoothed, "innovation": innovation, "used": used}
    return {**over_time, **(rays if cameras else {})}


def _joints(
    body: Skeleton, truth: Array, t_s: Array, n_joints: int, rng: np.random.Generator
) -> tuple[dict[str, Array], dict[str, JointPotential]]:
    index = {name: i for i, name in enumerate(body.markers)}
    chosen = body.joints[:n_joints]
    q = np.empty((len(t_s), len(chosen), 2))
    potentials = {}
    for j, joint in enumerate(chosen):
        q[:, j] = (truth[:, index[joint.child]] - truth[:, index[joint.centre]])[:, 1:]
        samples = q[:, j] + 0.001 * rng.normal(size=(len(t_s), 2))
        if j < 3:
            learned = fit_potential(samples / 0.05, kernel=GaussianKernel(beta=8.0), lam=1e-3)
            potentials[joint.name] = JointPotential(
                joint=joint.name, frame="plane", samples_m=samples, potential=learned, scale_m=0.05
            )
    q[len(q) // 3 : len(q) // 3 + 3] = np.nan
    sd_m = np.full(q.shape[:2], 0.001)
    if not chosen:
        return {}, potentials
    space = np.stack([truth[:, index[j.child]] - truth[:, index[j.centre]] for j in chosen], axis=1)
    return {"joint_plane": q, "joint_body": space, "joint_sd": sd_m}, potentials


_REPORT = """# flapper-demo

| | |
|---|---|
| frames | 200 |
| markers | 18 |
| seen | 93.1 % |
| filled | 6.4 % |
| residual, median | 0.61 px |

## Findings

- `R_tip5` has no position in the first 5 frames.
- 20 samples were rejected: they missed the rays of the other cameras.
"""
