"""What errors in the input cost: the main job on built-in recordings, clean and with faults whose truth is known.

Printed are the root mean square errors of the tracked markers over all samples and over those that nobody saw (the gaps
of the clean recording), and their ratio to the clean recording's, mean (range) over seeds on which nothing was tuned.
The same samples are compared in all rows. ``--stage prepare`` stops at triangulated points, without a tracker;
``--stage names`` counts swapped names there that are neither put right nor marked, over six seeds.

    python -m benchmarks.robustness [--quick] [--animal bat] [--stage prepare | names]
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mocap.datasets import make_bat, make_lizard, write_recording
from mocap.datasets.recording import SyntheticRecording
from mocap.filters.hide import interior_gaps
from mocap.filters.score import compared

from eal.arrays import Array
from mocap.cleaning.swapped_rays import exchange_rays
from mocap.cleaning.swaps import Swap, exchange
from mocap.pipeline.job import run_job
from mocap.pipeline.prepare import prepare
from mocap.pipeline.reading import read

Fault = Callable[[SyntheticRecording, np.random.Generator], Array]
SEEDS = range(80, 83)
MORE_SEEDS = range(80, 86)


def clean(recording: SyntheticRecording, _rng: np.random.Generator) -> Array:
    """(C, T, M, 2) pixels as they are; all faults return the same."""
    return np.array(recording.pixels.uv_px)


def outliers(recording: SyntheticRecording, rng: np.random.Generator) -> Array:
    """5 % of all clicks 80 px off, in any direction."""
    uv = clean(recording, rng)
    wrong = rng.random(uv.shape[:3]) < 0.05
    angle = rng.uniform(0, 2 * np.pi, uv.shape[:3])
    uv[wrong] += 80 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[wrong]
    return uv


def runs(recording: SyntheticRecording, rng: np.random.Generator, *, one_camera: bool) -> list[Swap]:
    """Eight runs of 1 to 60 frames in which a left marker and its like on the right are exchanged."""
    names, n_frames = recording.skeleton.markers, len(recording.truth.t_s)
    left = [name for name in names if name.endswith("_l")]
    out = []
    for name in rng.permutation(left)[:8]:
        length = round(np.exp(rng.uniform(0, np.log(60))))
        start = int(rng.integers(0, n_frames - length))
        camera = int(rng.integers(len(recording.cameras))) if one_camera else None
        pair = names.index(name), names.index(f"{name[:-2]}_r")
        out.append(Swap(a=pair[0], b=pair[1], frames=np.arange(start, start + length), camera=camera, gain=0.0))
    return out


def swapped_in_one(recording: SyntheticRecording, rng: np.random.Generator) -> Array:
    """Eight runs of exchanged names, each in one camera."""
    return exchange_rays(clean(recording, rng), runs(recording, rng, one_camera=True))


def swapped_in_all(recording: SyntheticRecording, rng: np.random.Generator) -> Array:
    """Eight runs of exchanged names in all cameras."""
    swaps = runs(recording, rng, one_camera=False)
    return np.stack([exchange(camera, swaps) for camera in clean(recording, rng)])


def bumped(recording: SyntheticRecording, rng: np.random.Generator) -> Array:
    """One camera moved by 10 px after 40 % of the recording."""
    uv, angle = clean(recording, rng), rng.uniform(0, 2 * np.pi)
    uv[rng.integers(len(uv)), round(0.4 * uv.shape[1]) :] += 10 * np.array([np.cos(angle), np.sin(angle)])
    return uv


def noisy(recording: SyntheticRecording, rng: np.random.Generator) -> Array:
    """One camera with four times the noise after 40 % of the recording."""
    uv = clean(recording, rng)
    part = uv[rng.integers(len(uv)), round(0.4 * uv.shape[1]) :]
    part += np.sqrt(15) * 1.2 * rng.standard_normal(part.shape)
    return uv


def one_eye(recording: SyntheticRecording, rng: np.random.Generator) -> Array:
    """All cameras but one blind for 25 frames."""
    uv = clean(recording, rng)
    start, keep = round(0.6 * uv.shape[1]), rng.integers(len(uv))
    uv[np.arange(len(uv)) != keep, start : start + 25] = np.nan
    return uv


FAULTS: dict[str, Fault] = {
    "clean": clean,
    "5 % of clicks off by 80 px": outliers,
    "names swapped in one camera": swapped_in_one,
    "names swapped in all cameras": swapped_in_all,
    "one camera moved by 10 px": bumped,
    "one camera 4 times as noisy": noisy,
    "one camera alone, 25 frames": one_eye,
}


def tracked(recording: SyntheticRecording, uv_px: Array, *, stage: str) -> tuple[Array, np.ndarray]:
    """(T, M, 3) estimates, and (T, M) which samples were seen in 3D."""
    changed = replace(recording, pixels=replace(recording.pixels, uv_px=uv_px))
    with TemporaryDirectory() as folder:
        files = write_recording(changed, Path(folder))
        source = read(
            files["pixels"],
            fps=recording.fps,
            calibration=files["coefficients"],
            profile=files["profile"],
            skeleton=files["skeleton"],
        )
        if stage == "prepare":
            xyz = prepare(source).xyz_m
            return xyz, np.isfinite(xyz[..., 0])
        run, prepared = run_job(source, model="eal", validated=False)
    return run.tracked.markers.xyz_m, np.isfinite(prepared.xyz_m[..., 0])


def measure(animal: str, seed: int, *, stage: str) -> dict[str, tuple[float, float]]:
    """Errors in mm over all samples and over hidden ones, by fault."""
    recording = (make_bat if animal == "bat" else make_lizard)(seed=seed)
    estimates, hidden = {}, None
    for k, (name, fault) in enumerate(FAULTS.items()):
        estimates[name], seen = tracked(recording, fault(recording, np.random.default_rng([seed, k])), stage=stage)
        hidden = interior_gaps(seen) if hidden is None else hidden
    common = np.all([np.isfinite(xyz[..., 0]) for xyz in estimates.values()], axis=0)
    truth = recording.truth.xyz_m
    out = {}
    for name, xyz in estimates.items():
        scores = [compared(xyz, None, truth, where).rmse_mm for where in (common, common & hidden)]
        out[name] = (scores[0] or np.nan, scores[1] or np.nan)
    return out


def left_wrong(animal: str, seed: int) -> tuple[int, int]:
    """Samples whose names were swapped in all cameras, and how many of them are neither put right nor rejected.

    A sample is not put right if it is further from its marker than half of the way to the other one.
    """
    recording = (make_bat if animal == "bat" else make_lizard)(seed=seed)
    fault = [seed, list(FAULTS).index("names swapped in all cameras")]
    swaps = runs(recording, np.random.default_rng(fault), one_camera=False)
    xyz, _ = tracked(recording, swapped_in_all(recording, np.random.default_rng(fault)), stage="prepare")
    truth, seen = recording.truth.xyz_m, np.isfinite(clean(recording, np.random.default_rng())[..., 0]).sum(axis=0) >= 2
    count = wrong = 0
    for swap in swaps:
        apart = np.linalg.norm(truth[swap.frames, swap.a] - truth[swap.frames, swap.b], axis=-1)
        for marker in (swap.a, swap.b):
            count += int(seen[swap.frames, marker].sum())
            off = np.linalg.norm(xyz[swap.frames, marker] - truth[swap.frames, marker], axis=-1)
            wrong += int((off > 0.5 * apart).sum())
    return count, wrong


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one seed")
    parser.add_argument("--animal", choices=("bat", "lizard"), help="one of the two")
    parser.add_argument("--stage", choices=("prepare", "names", "track"), default="track")
    options = parser.parse_args()
    seeds = SEEDS[:1] if options.quick else SEEDS
    if options.stage == "names":
        for animal in [options.animal] if options.animal else ["bat", "lizard"]:
            found = np.array([left_wrong(animal, seed) for seed in (seeds if options.quick else MORE_SEEDS)])
            count, wrong = found.sum(axis=0)
            print(
                f"{animal}: {count} samples under the other's name in all cameras, {wrong} neither put right nor marked"
            )
        return
    print(f"{'':8}{'input':32}{'all, mm':>9}{'x clean':>9}{'spread':>14}{'hidden, mm':>12}{'x clean':>9}{'spread':>14}")
    for animal in [options.animal] if options.animal else ["bat", "lizard"]:
        scores = [measure(animal, seed, stage=options.stage) for seed in seeds]
        for name in FAULTS:
            line = f"{animal:8}{name:32}"
            for which, width in ((0, 9), (1, 12)):
                error = np.array([s[name][which] for s in scores])
                ratio = error / np.array([s["clean"][which] for s in scores])
                spread = f"{ratio.min():.2f}-{ratio.max():.2f}"
                line += f"{error.mean():{width}.3f}{ratio.mean():9.2f}{spread:>14}"
            print(line, flush=True)


if __name__ == "__main__":
    main()
