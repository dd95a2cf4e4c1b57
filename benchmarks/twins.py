"""The twins beside real recordings: who is seen how often, gaps, joint angles; laws that they keep; time to make them.

Distances are those of ``datasets.visibility``; beside each is that of one real flight from the others, which is as near
as one can come. The clicks of the
wind-tunnel twin (``datasets.observe.WIND_TUNNEL``) were chosen on three flights and seeds 0 to 2; here are other seeds.
"""

import argparse
import time
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from scipy.stats import wasserstein_distance

from benchmarks import twins_published
from datasets import PERFECT, Digitiser, make_bat, make_lizard
from datasets.bat_flight import laps
from datasets.bats import make_bat_wind_tunnel
from datasets.linkage import turn
from datasets.lizards import SLOPE_RAD
from datasets.real import folder
from datasets.visibility import Visibility, distances, merged, pooled, visibility
from mocap.arrays import Array
from mocap.cameras.camera import decompose, record, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.io.dvproject import DvProject, read_project
from mocap.io.registry import read
from mocap.records import Status

POINTS = {
    **{"t3L": "d3_tip_l", "wstL": "wrist_l", "t5L": "d5_tip_l", "elbL": "elbow_l", "shdL": "shoulder_l"},
    **{"ankL": "ankle_l", "nl": "snout", "str": "sternum", "lmb": "pelvis", "shdR": "shoulder_r", "ankR": "ankle_r"},
    **{"elbR": "elbow_r", "wstR": "wrist_r", "t5R": "d5_tip_r", "t3R": "d3_tip_r"},
}
"""What pt1, pt2, ... of the wind-tunnel projects are, and the twin's markers nearest to them."""

FLIGHTS = ("078A3/F2", "078A3/F3", "078A3/F5")
OTHER_FLIGHTS = ("078A3/F1", "078A3/F4", "FE404/F2")
"""One wing only, half of the markers left unclicked, one wing only."""

ANGLES = {
    "elbow (shoulder, elbow, wrist)": ("shoulder", "elbow", "wrist"),
    "wrist (elbow, wrist, tip of digit III)": ("elbow", "wrist", "d3_tip"),
    "wrist (elbow, wrist, tip of digit V)": ("elbow", "wrist", "d5_tip"),
}


def line(name: str, seen: Visibility, far: Mapping[str, float] | None = None) -> str:
    """One row of the table."""
    q = np.quantile(seen.gaps_3d, [0.5, 0.9, 1]) if len(seen.gaps_3d) else np.zeros(3)
    low, high = seen.solid.min(), seen.solid.max()
    text = f"{name:34}{seen.view.mean():6.2f}{seen.solid.mean():6.2f}{low:6.2f}{high:6.2f}{seen.rate_hz:7.1f}"
    text += "".join(f"{x:6.0f}" for x in q)
    return text + ("" if far is None else "   " + "  ".join(f"{k} {v:.2f}" for k, v in far.items()))


HEAD = f"{'':34}{'view':>6}{'3D':>6}{'least':>6}{'most':>6}{'gaps/s':>7}{'median':>6}{'90 %':>6}{'max':>6}"


def wind_tunnel(seeds: Sequence[int]) -> None:
    """Visibility, gaps and joint angles of the bat in the wind tunnel and of its twin."""
    projects = {}
    for flight in FLIGHTS + OTHER_FLIGHTS:
        (path,) = sorted((folder() / "bat_windtunnel_dltdv8" / flight).glob("*dvProject.mat"))
        projects[flight] = read_project(path, fps=700)
    real = {flight: visibility(project.pixels.seen, fps=700.0) for flight, project in projects.items()}
    twins = [make_bat_wind_tunnel(seed=seed) for seed in seeds]
    chosen = [twins[0].truth.names.index(name) for name in POINTS.values()]
    twin = [visibility(t.pixels.seen[:, :, chosen], fps=700.0) for t in twins]
    whole = pooled([real[flight] for flight in FLIGHTS])

    print(f"\nBat in a wind tunnel, 4 cameras at 700 Hz, gaps in 3D in frames; distances from F2 + F3 + F5\n{HEAD}")
    for flight in FLIGHTS:
        print(line(flight, real[flight], distances(pooled([real[f] for f in FLIGHTS if f != flight]), real[flight])))
    for flight in OTHER_FLIGHTS:
        far = distances(whole, real[flight]) if flight == "078A3/F4" else None
        print(line(flight + " (partly clicked)", real[flight], far))
    for seed, one in zip(seeds, twin, strict=True):
        print(line(f"twin, seed {seed}", one, distances(whole, one)))
    print(line("twins together", pooled(twin), distances(whole, pooled(twin))))
    human = [make_bat_wind_tunnel(seed=seed, digitiser=Digitiser()) for seed in seeds]
    careless = pooled([visibility(t.pixels.seen[:, :, chosen], fps=700.0) for t in human])
    print(line("the demo's clicks in this rig", careless, distances(whole, careless)))

    heads = "".join(f"{head:>7}" for head in ("cam1", "cam2", "cam3", "cam4", "3D", "gaps/s", "frames"))
    print("\nEach marker: views, 3D, gaps in 3D a second, median gap in one camera in frames: real (F2, F3, F5) | twin")
    print(f"{'':18}{heads}  |{heads}")
    flown, played = [projects[f].pixels.seen for f in FLIGHTS], [t.pixels.seen[:, :, chosen] for t in twins]
    for m, (real_name, name) in enumerate(POINTS.items()):
        left, right = (_row(pooled([visibility(s[:, :, [m]], fps=700.0) for s in part])) for part in (flown, played))
        print(f"{real_name:6}{name:12}{left}  |{right}")
    correlation = np.corrcoef(whole.view.ravel(), pooled(twin).view.ravel())[0, 1]
    print(f"correlation of views over cameras and markers {correlation:.2f}")

    print("\nJoint angles in degrees, 2 %, median, 98 %: real (F2, F3, F5, both sides) | twin (exact)")
    measured = [triangulated(projects[flight]) for flight in FLIGHTS]
    truth = [(twins[0].truth.names, t.truth.xyz_m) for t in twins]
    for joint, names in ANGLES.items():
        left, right = (np.nanquantile(wing_angles(found, names), [0.02, 0.5, 0.98]) for found in (measured, truth))
        print(f"{joint:40}" + "".join(f"{x:6.0f}" for x in left) + "  |" + "".join(f"{x:6.0f}" for x in right))


def _row(one: Visibility) -> str:
    shares = "".join(f"{x:7.2f}" for x in (*one.view[:, 0], one.solid[0]))
    return f"{shares}{one.rate_hz:7.1f}{np.median(one.gaps) if len(one.gaps) else 0:7.0f}"


def triangulated(project: DvProject) -> tuple[tuple[str, ...], Array]:
    """Markers of a wind-tunnel project as the twin names them, and where their rays meet: (T, 15, 3) in metres."""
    uv = undistorted(project.cameras, project.pixels.uv_px, iterations=project.undistort_iterations)
    return tuple(POINTS.values()), linear(stacked(project.cameras), uv)


def wing_angles(found: Sequence[tuple[Sequence[str], Array]], names: Sequence[str]) -> Array:
    """Angles at the second of three markers in degrees, both sides, all frames."""
    values = []
    for markers, xyz_m in found:
        for side in "lr":
            a, b, c = (xyz_m[:, list(markers).index(f"{name}_{side}")] for name in names)
            u, v = a - b, c - b
            cosine = np.sum(u * v, axis=-1) / np.linalg.norm(u, axis=-1) / np.linalg.norm(v, axis=-1)
            values.append(np.degrees(np.arccos(cosine)))
    return np.concatenate(values)


def optical(seeds: Sequence[int]) -> None:
    """Gaps of the lizard beside those of optical systems on other animals."""
    data, groups = folder(), {}
    mouse = read(data / "mouse_mocap_qtm" / "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat").points
    assert mouse is not None
    groups["mouse, Qualisys, 300 Hz"] = [visibility((mouse.status == Status.MEASURED)[None], fps=300.0)]
    glides = [read(path).points for path in sorted((data / "snake_glide_qualisys").glob("*_[0-9][0-9].tsv"))]
    groups["snakes gliding, Qualisys, 179 Hz"] = [visibility(t.seen[None], fps=179.0) for t in glides if t is not None]
    gaps = [read(path).points for path in sorted((data / "snake_gap_vicon").glob("*.csv"))]
    snakes = [t.seen[:, [n.lower().startswith("snake") for n in t.names]] for t in gaps if t is not None]
    groups["snakes crossing, Vicon, 150 Hz"] = [visibility(seen[None], fps=150.0) for seen in snakes]
    lizards = [make_lizard(seed=seed) for seed in seeds]
    groups["twin: lizard, 4 cameras, 250 Hz"] = [
        visibility((t.pixels.seen.sum(axis=0) >= 2)[None], fps=250.0) for t in lizards
    ]
    bats = [make_bat(seed=seed) for seed in seeds]
    groups["twin: bat, 8 cameras, 240 Hz"] = [
        visibility((t.pixels.seen.sum(axis=0) >= 2)[None], fps=240.0) for t in bats
    ]
    print(f"\nOther animals, in 3D; distances of gap lengths in octaves of frames\n{HEAD}")
    for name, parts in groups.items():
        together = merged(parts)
        far = {
            other.split(",")[0]: float(wasserstein_distance(np.log2(together.gaps_3d), np.log2(merged(there).gaps_3d)))
            for other, there in groups.items()
            if other != name and not other.startswith("twin")
        }
        print(line(name, together, far))


def published(seeds: Sequence[int]) -> None:
    """Numbers that abstracts of papers state, beside the twins'."""
    bat = make_bat(seed=seeds[0], n_frames=960, skin_m=0)
    index = {name: m for m, name in enumerate(bat.truth.names)}
    height = bat.truth.xyz_m[:, index["d3_tip_l"], 2] - bat.truth.xyz_m[:, index["shoulder_l"], 2]
    beat_hz = np.abs(np.fft.rfft(height - height.mean())).argmax() * bat.fps / len(height)
    path = laps(np.linspace(0, 1.3, 2000))
    bank = np.degrees(np.arctan(path.speed_m_s * path.turning_rad_s / 9.81))
    lizard = make_lizard(seed=seeds[0], skin_m=0)
    index = {name: m for m, name in enumerate(lizard.truth.names)}
    feet = lizard.contact.any(axis=0)
    across = lizard.truth.xyz_m[:, index["hip_l"]] - lizard.truth.xyz_m[:, index["hip_r"]]
    yaw = np.degrees(np.arctan2(across @ turn(1, -SLOPE_RAD)[:, 0], across[:, 1]))
    print("\nPublished | twin")
    for what, theirs, ours in (
        ("wing beat of Hipposideros armiger, Hz (Windes 2020)", "8.7", f"{beat_hz:.1f}"),
        ("its speed in a U-turn, m/s", "2.0 to 0.5", f"{path.speed_m_s.max():.1f} to {path.speed_m_s.min():.1f}"),
        ("its bank, degrees", "20 to 40", f"{bank.min():.0f} to {bank.max():.0f}"),
        ("height it gains, m", "0.2", f"{np.ptp(path.position_m[:, 2]):.2f}"),
        ("duty of Dipsosaurus at 0.5 m/s (Fieler & Jayne 1998)", "0.63", f"{lizard.contact[:, feet].mean():.2f}"),
        ("its pelvic rotation, degrees", "36", f"{np.ptp(yaw):.0f}"),
    ):
        print(f"{what:56}{theirs:>12}  |  {ours}")
    twins_published.show(make_lizard(seed=seeds[0], n_frames=1000, skin_m=0))


def laws() -> None:
    """The numbers that the tests bound."""
    bat = make_bat(n_cameras=30, n_frames=200, lens="fisheye", skin_m=0)
    brown = make_bat(n_cameras=30, n_frames=200, skin_m=0)
    worst = {"fisheye": 0.0, "brown": 0.0}
    for recording, kind in ((bat, "fisheye"), (brown, "brown")):
        got = record(recording.cameras, recording.truth.xyz_m)
        for c, camera in enumerate(recording.cameras):
            eye = decompose(camera)
            assert camera.lens is not None
            project = cv2.fisheye.projectPoints if kind == "fisheye" else cv2.projectPoints
            points, rotation = recording.truth.xyz_m.reshape(-1, 1, 3), cv2.Rodrigues(eye.rotation)[0]
            expected, _ = project(points, rotation, eye.translation_m, eye.intrinsic, camera.lens.coefficients)
            worst[kind] = max(worst[kind], float(np.abs(got[c].reshape(-1, 2) - expected.reshape(-1, 2)).max()))
    index = {name: m for m, name in enumerate(brown.truth.names)}
    ends = np.array([(index[b.a], index[b.b]) for b in brown.skeleton.bones if b.rigid])
    length = np.linalg.norm(brown.truth.xyz_m[:, ends[:, 0]] - brown.truth.xyz_m[:, ends[:, 1]], axis=-1)
    lizard = make_lizard(digitiser=PERFECT)
    slip = 0.0
    for m in np.flatnonzero(lizard.contact.any(axis=0)):
        stance = lizard.contact[:, m]
        for run in np.split(np.arange(len(stance)), np.flatnonzero(np.diff(stance.astype(int))) + 1):
            if stance[run[0]]:
                slip = max(slip, float(np.linalg.norm(np.ptp(lizard.truth.xyz_m[run, m], axis=0))))
    print("\nLaws")
    print(
        f"projection beside OpenCV: Brown {worst['brown']:.1e} px, fisheye {worst['fisheye']:.1e} px, 30 cameras each"
    )
    print(f"rigid bones change by {np.ptp(length, axis=0).max():.1e} m; feet slip {1e3 * slip:.1e} mm")


def speed() -> None:
    """Time to make 1000 frames of 34 markers in 30 cameras, hidden by geometry."""
    print("\n1000 frames x 34 markers x 30 cameras, seconds by the clock, of the processor")
    for what, options in {
        "Brown": {},
        "fisheye, turning": {"lens": "fisheye", "manoeuvre": "turn"},
        "cameras start between frames": {"start_spread_frames": 0.9},
    }.items():
        start, used = time.perf_counter(), time.process_time()
        make_bat(n_frames=1000, n_cameras=30, **options)
        print(f"{what:34}{time.perf_counter() - start:6.2f}{time.process_time() - used:6.2f}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two seeds")
    seeds = range(10, 12 if parser.parse_args().quick else 16)
    wind_tunnel(seeds)
    optical(seeds)
    published(seeds)
    laws()
    speed()


if __name__ == "__main__":
    main()
