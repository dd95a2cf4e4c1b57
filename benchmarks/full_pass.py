"""The full pass on the twins: pictures of a board -> mocap calibrate -> mocap track -> joints, against the truth.

Pictures are rendered through the true lenses, corners found and cameras calibrated by ``mocap calibrate images``; the
animal is tracked with those cameras, and beside that with the true ones. The calibration's world is that of a board:
the rigid motion between both worlds is taken off. Shares are those of coordinates inside the
95 % intervals that are reported, which should be 90 to 98 %.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mocap.datasets import SyntheticRecording, make_bat, make_lizard, write_recording
from mocap.datasets.catalogue import make
from mocap.filters.hide import interior_gaps
from mocap.filters.score import compared

from eal.arrays import Array
from mocap.cameras.camera import Camera, decompose, record, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.io.anipose import read_calibration
from mocap.pipeline.job import run_job
from mocap.pipeline.reading import read
from mocap.pipeline.run import Run
from mocap.stages import Stages

CASES = {
    "lizard": ("calibration_tank", lambda seed: make_lizard(seed=seed)),
    "bat": ("calibration_tunnel", lambda seed: make_bat(seed=seed)),
    "bat, fisheyes": ("calibration_fisheye", lambda seed: make_bat(seed=seed, lens="fisheye")),
}


def calibrated(session: str, folder: Path, seed: int) -> tuple[Path, float]:
    """``calibration.toml`` of a rendered session, and the seconds that its calibration took."""
    make(session, folder / "session", seed=seed)
    card = json.loads((folder / "session" / "card.json").read_text(encoding="utf-8"))
    program = "from mocap.cli.main import main; main()"
    command = [
        sys.executable,
        "-c",
        program,
        "calibrate",
        "images",
        str(folder / "session" / "images"),
        *card["options"].split(),
    ]
    start = time.perf_counter()
    subprocess.run([*command, "--out", str(folder / "rig")], check=True, capture_output=True)
    return folder / "rig" / "calibration.toml", time.perf_counter() - start


def between(ours: tuple[Camera, ...], true: tuple[Camera, ...]) -> tuple[Array, Array]:
    """Rotation and shift from the world of ``true`` to that of ``ours``.

    A box of points in the middle is recorded by the true cameras and triangulated with ours (Kabsch 1976). Places of
    the cameras would not do: a place moves with its principal point, and hardly a picture changes.
    """
    size = 0.1 * np.mean([np.linalg.norm(decompose(camera).position_m) for camera in true])
    box = size * np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, 3)]), axis=-1).reshape(-1, 3)
    found = linear(stacked(ours), undistorted(ours, record(true, box)))
    u, _, vt = np.linalg.svd((found - found.mean(axis=0)).T @ box)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return rotation, found.mean(axis=0)


def joint_share(run: Run, truth_m: Array) -> tuple[float, float]:
    """Error in mm, and per cent inside the intervals, of the joints' children about their centres in the world."""
    joints, names = run.joints["world"], list(run.tracked.markers.names)
    ends = np.array([[names.index(j.centre), names.index(j.child)] for j in run.skeleton.joints])
    error = joints.q_m - (truth_m[:, ends[:, 1]] - truth_m[:, ends[:, 0]])
    known = np.isfinite(error[..., 0]) & np.isfinite(joints.sd_m)
    inside = np.abs(error[known]) <= 1.959964 * joints.sd_m[known][:, None]
    return float(1e3 * np.sqrt(np.mean(np.sum(error[known] ** 2, axis=-1)))), float(100 * inside.mean())


def measure(name: str, seed: int) -> None:
    """One animal, with calibrated and with true cameras."""
    session, film = CASES[name]
    recording: SyntheticRecording = film(seed)
    with TemporaryDirectory() as scratch:
        toml, seconds = calibrated(session, Path(scratch), seed)
        rig = read_calibration(toml)
        rotation, shift = between(rig, recording.cameras)
        truth = recording.truth.xyz_m @ rotation.T + shift
        moved = record(rig, truth) - record(recording.cameras, recording.truth.xyz_m)
        off = np.linalg.norm(moved, axis=-1)
        print(
            f"{name}, seed {seed}: calibrated in {seconds:.0f} s; true markers in calibrated cameras off by "
            f"{np.median(off):.3f} px (median), {np.quantile(off, 0.95):.3f} px (95 %)"
        )
        files = write_recording(recording, Path(scratch) / "recording", others=True)
        cases = {"calibrated": (toml, truth), "true": (files["calibration"], recording.truth.xyz_m)}
        for cameras, (coefficients, truth_m) in cases.items():
            source = read(files["pixels"], fps=recording.fps, calibration=coefficients, skeleton=files["skeleton"])
            run, prepared = run_job(source, model="eal", stages=Stages(), validated=False)
            seen = np.isfinite(prepared.xyz_m[..., 0])
            markers, parts = run.tracked.markers, {"seen": seen, "gaps": interior_gaps(seen)}
            found = {
                part: compared(markers.xyz_m, markers.cov_m2, truth_m, where).as_json() for part, where in parts.items()
            }
            text = "".join(f"{s['rmse_mm']:9.3f}{s['coverage95']:7.1f} %" for s in found.values())
            error, share = joint_share(run, truth_m)
            print(f"  {cameras + ' cameras':22}{text}{error:9.3f}{share:7.1f} %", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the lizard alone")
    parser.add_argument("--seeds", type=int, default=1)
    arguments = parser.parse_args()
    print(f"{'RMSE in mm, inside 95 % intervals':24}{'seen':>9}{'':9}{'in gaps':>9}{'':9}{'joints':>9}")
    for name in ["lizard"] if arguments.quick else CASES:
        for seed in range(10, 10 + arguments.seeds):
            measure(name, seed)


if __name__ == "__main__":
    main()
