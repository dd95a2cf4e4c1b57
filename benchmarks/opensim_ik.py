"""Inverse kinematics of OpenSim beside the tracker, on the same markers of the lizard twin.

    python -m benchmarks.opensim_ik --python ENV/bin/python [--frames 240] [--seed 0]

ENV has OpenSim (``python -m venv ENV; ENV/bin/pip install opensim``). The twin is filmed, clicked and tracked as
``mocap demo`` does. OpenSim gets the triangulated markers, gaps left open, and the animal that the tracker fitted
(``mocap kinematics --export osim``); all its markers weigh the same. Both are compared with the truth: positions of the
markers that the model has, and flexion of joints, in samples that were measured and those that were not.
"""

import argparse
import re
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from eal.arrays import Array
from mocap.kinematics import angles
from mocap.pipeline.demo import measured_demo
from mocap.results.osim import write_osim
from mocap.stages import Stages

WORKER = """
import sys, time, opensim as o
o.Logger.removeFileSink()
o.Logger.setLevelString("Error")
folder = sys.argv[1]
tool = o.InverseKinematicsTool()
model = o.Model(folder + "/animal.osim")
model.initSystem()
tool.setModel(model)
tool.setMarkerDataFileName(folder + "/markers.trc")
tool.setOutputMotionFileName(folder + "/ik.mot")
tool.setResultsDir(folder)
tool.set_report_marker_locations(True)
start = time.process_time()
tool.run()
print(o.GetVersion(), model.getNumCoordinates(), model.getNumMarkers(), time.process_time() - start)
"""


def write_trc(path: Path, names: list[str], t_s: Array, xyz_m: Array) -> None:
    """Markers (T, M, 3) in metres; NaN where not seen, which OpenSim leaves out."""
    rate = 1 / (t_s[1] - t_s[0])
    head = ["PathFileType\t4\t(X/Y/Z)\tmarkers.trc"]
    head.append("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames")
    head.append(f"{rate:g}\t{rate:g}\t{len(t_s)}\t{len(names)}\tm\t{rate:g}\t1\t{len(t_s)}")
    head.append("Frame#\tTime\t" + "\t\t\t".join(names))
    head.append("\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(len(names)) for axis in "XYZ"))
    rows = [
        f"{i + 1}\t{t:.6f}\t" + "\t".join("NaN" if np.isnan(v) else f"{v:.7f}" for v in x.ravel())
        for i, (t, x) in enumerate(zip(t_s, xyz_m, strict=True))
    ]
    path.write_text("\n".join([*head, "", *rows]) + "\n")


def read_locations(path: Path) -> tuple[list[str], Array]:
    """Names and (T, M, 3) positions of the model's markers."""
    lines = path.read_text().splitlines()
    start = next(i for i, one in enumerate(lines) if one.startswith("endheader")) + 1
    columns = lines[start].split("\t")[1:]
    values = np.array([[float(v) for v in one.split("\t")[1:]] for one in lines[start + 1 :] if one.strip()])
    names = [c.rpartition("_")[0] for c in columns[::3]]
    return names, values.reshape(len(values), -1, 3)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=sys.executable, help="a Python that has OpenSim")
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if subprocess.run([given.python, "-c", "import opensim"], capture_output=True, check=False).returncode:
        print(
            "OpenSim is not installed there: python -m venv ENV; ENV/bin/pip install opensim; --python ENV/bin/python"
        )
        return
    start = time.process_time()
    run, prepared, true = measured_demo("lizard", stages=Stages(), seed=given.seed, n_frames=given.frames)
    ours_s = time.process_time() - start
    names = list(prepared.names)
    answers: dict[str, Array] = {}
    found: list[str] = []
    for label, free in (("OpenSim", False), ("OpenSim, all balls", True)):
        with TemporaryDirectory() as temporary:
            folder = Path(temporary)
            write_osim(run, folder / "animal.osim")
            if free:
                text = (folder / "animal.osim").read_text()
                (folder / "animal.osim").write_text(re.sub("(Pin|Universal|Weld)Joint", "BallJoint", text))
            write_trc(folder / "markers.trc", names, prepared.t_s, prepared.xyz_m)
            done = subprocess.run([given.python, "-c", WORKER, temporary], capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(done.stdout[-2000:] + done.stderr[-2000:])
            print(f"{label}: version, coordinates, markers, seconds: {done.stdout.strip().splitlines()[-1]}")
            found, answers[label] = read_locations(next(folder.glob("*marker_locations.sto")))
    print(f"this program, the whole demo with all it compares: {ours_s:.0f} s of processor time")
    index = [names.index(name) for name in found]
    ours, truth = run.tracked.markers.xyz_m[:, index], true[:, index]
    seen = np.isfinite(prepared.xyz_m[:, index, 0])
    print(f"{'':22}{'markers mm':>22}{'flexion deg':>24}{'from ours deg':>16}")
    print(f"{'':22}{'measured':>12}{'filled':>10}{'measured':>14}{'filled':>10}{'measured':>16}")
    joints = [j for j in run.skeleton.joints if {j.parent, j.centre, j.child} <= set(found)]
    three = [[found.index(m) for m in (j.parent, j.centre, j.child)] for j in joints]
    known = np.stack([seen[:, k].all(axis=1) for k in three], axis=1)

    def flexion(x: Array) -> Array:
        return np.stack([np.degrees(angles.flexion(x[:, k])) for k in three], axis=1)

    for label, x in (("this program", ours), *answers.items()):
        away = 1e3 * np.linalg.norm(x - truth, axis=2)
        off, apart = flexion(x) - flexion(truth), flexion(x) - flexion(ours)
        where = ((away, seen), (away, ~seen), (off, known), (off, ~known), (apart, known))
        cells = [np.sqrt(np.mean(one[mask] ** 2)) for one, mask in where]
        print(f"{label:22}{cells[0]:12.2f}{cells[1]:10.2f}{cells[2]:14.2f}{cells[3]:10.2f}{cells[4]:16.2f}")


if __name__ == "__main__":
    main()
