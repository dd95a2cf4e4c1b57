"""Is the tracked motion of one digitiser closer to a second one than the first one's own points are?

``python -m benchmarks.two_digitisers [--quick]``. No recording at hand was digitised twice by hand, so the built-in bat
and lizard are: the same motion, cameras and occlusion, with the clicks, losses and mistakes of two humans. Of every
sample that both measured, the distance from the second one's triangulated point is taken to: the first one's
triangulated point; that track smoothed by a Butterworth filter (fourth order, both ways, 30 Hz: what people do); ours
with constant velocity; ours with V_z. And the same for the truth. Printed: root mean square in mm, and the ratio to the
first digitiser's own points.

Both digitisers share the calibration and what hides a marker, so nothing is said of errors that these have in common.
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.signal import butter, sosfiltfilt

from datasets import Digitiser, SyntheticRecording, make_bat, make_lizard, write_recording
from datasets.bats import bat_motion
from datasets.film import film
from datasets.lizards import lizard_motion
from filters.models.pose import PoseSettings
from filters.subspace import bridge
from mocap.arrays import Array
from mocap.pipeline.prepare import Prepared, prepare
from mocap.pipeline.recording import Recording
from mocap.pipeline.tracking import ALONE, learn_motion, seen_part, track, tracked_motion

CUTOFF_HZ = 30.0


def digitised(animal: str, seed: int) -> tuple[SyntheticRecording, SyntheticRecording]:
    """The same motion by two digitisers."""
    make, motion = (make_bat, bat_motion) if animal == "bat" else (make_lizard, lizard_motion)
    first = make(seed=seed)
    second = film(
        motion(seed),
        first.pixels.t_s,
        first.cameras,
        name="second",
        fps=first.fps,
        start_s=first.start_s,
        digitiser=Digitiser(),
        rng=np.random.default_rng([seed, 2]),
        card={},
    )
    return first, second


def prepared(recording: SyntheticRecording) -> Prepared:
    """As ``mocap track`` prepares its files."""
    with TemporaryDirectory() as folder:
        files = write_recording(recording, Path(folder))
        return prepare(
            Recording(
                tracks=files["pixels"],
                fps=recording.fps,
                calibration=files["coefficients"],
                profile=files["profile"],
                skeleton=files["skeleton"],
            )
        )


def butterworth(xyz_m: Array, fps: float) -> Array:
    """(T, M, 3) tracks, bridged and filtered; NaN where a marker was not measured."""
    sos = butter(2, CUTOFF_HZ, fs=fps, output="sos")
    out = np.full(xyz_m.shape, np.nan)
    for m in range(xyz_m.shape[1]):
        seen = np.isfinite(xyz_m[:, m, 0])
        if seen.sum() > 20:
            smooth = sosfiltfilt(sos, bridge(xyz_m[:, m]), axis=0)
            out[seen, m] = smooth[seen]
    return out


def measure(animal: str, seed: int) -> dict[str, tuple[float, float]]:
    """Distance of each track of the first digitiser to the second one's points, and to the truth, in mm."""
    first, second = digitised(animal, seed)
    one, other = prepared(first), prepared(second)
    part = seen_part(one)
    tracks = {"first digitiser": one.xyz_m, "Butterworth": butterworth(one.xyz_m, first.fps)}
    for name in ALONE:
        model = learn_motion(one, part, name, settings=PoseSettings())
        tracks[name] = tracked_motion(one, part, name, track(one, part, model)).markers.xyz_m
    both = np.all([np.isfinite(x[..., 0]) for x in (*tracks.values(), other.xyz_m)], axis=0)
    distances = {}
    for name, xyz in tracks.items():
        off = [np.linalg.norm((xyz - to)[both], axis=-1) for to in (other.xyz_m, first.truth.xyz_m)]
        distances[name] = tuple(1e3 * float(np.sqrt(np.mean(d**2))) for d in off)
    return distances


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one seed")
    seeds = range(20, 21 if parser.parse_args().quick else 23)
    print(f"{'':8}{'track':20}{'to the second, mm':>20}{'ratio':>8}{'to the truth, mm':>20}{'ratio':>8}")
    for animal in ("bat", "lizard"):
        runs = [measure(animal, seed) for seed in seeds]
        own = np.array([run["first digitiser"] for run in runs])
        for name in runs[0]:
            found = np.array([run[name] for run in runs])
            cells = "".join(f"{found[:, k].mean():20.3f}{np.mean(found[:, k] / own[:, k]):8.2f}" for k in range(2))
            print(f"{animal:8}{name:20}{cells}")


if __name__ == "__main__":
    main()
