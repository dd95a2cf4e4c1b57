"""Joint angles of the articulated model beside those of the synthetic animals: ``python -m benchmarks.joint_angles``.

``mocap track --model articulated`` of the built-in bat (8 cameras) and lizard (4), each alone. The truth are the
angles at which the model's own segments fit the true markers; an angle is measured where the true ends of its segment
are seen, else filled. Prints root mean square errors in degrees and the share inside 95 % intervals, the error of the
segments' lengths, and positions beside the pose filter's (``--model eal``).
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from mocap.datasets import SyntheticRecording, make_bat, make_lizard
from mocap.filters.models.pose import PoseSettings
from mocap.filters.motion.articulated import ArticulatedMotion
from mocap.filters.poses import pose_trial
from mocap.filters.records import Estimate
from mocap.filters.tree import fit_poses

from eal.arrays import Z95, Array
from mocap.pipeline.prepare import prepare_pixels
from mocap.pipeline.tracking import learn_motion, seen_part, track


def angles_of(film: SyntheticRecording) -> None:
    """Print the rows of one recording."""
    prepared = prepare_pixels(film.pixels, film.cameras, film.skeleton, name=film.name)
    part = seen_part(prepared)
    found, seconds, models = {}, {}, {}
    for name in ("eal", "articulated"):
        start = time.process_time()
        models[name] = learn_motion(prepared, part, name, settings=PoseSettings())
        begun = time.process_time()
        found[name] = track(prepared, part, models[name])
        seconds[name] = (begun - start, time.process_time() - begun)
    truth = film.truth.xyz_m[part.frames][:, part.markers]
    seen = np.isfinite(prepared.xyz_m[part.frames][:, part.markers, 0])
    motion = models["articulated"].motion
    assert isinstance(motion, ArticulatedMotion)
    print(f"{film.name}: {len(truth)} frames, {truth.shape[1]} markers, {len(film.cameras)} cameras")
    print(f"  coordinates a joint: {np.bincount(motion.tree.joint).tolist()}")
    print_angles(motion, found["articulated"], truth, seen, prepared.t_s[part.frames])
    length = np.nanmedian(np.linalg.norm(truth[:, motion.ends[:, 1]] - truth[:, motion.ends[:, 0]], axis=-1), axis=0)
    off = motion.length_m / length - 1
    print(f"  lengths: {100 * np.sqrt(np.mean(off**2)):.2f} % rms, {100 * np.abs(off).max():.2f} % at most")
    for name, one in found.items():
        learned, filtered = seconds[name]
        print(
            f"  {name}: positions filled {miss(one, truth, ~seen)}, measured {miss(one, truth, seen)}; learned in "
            f"{learned:.1f} s, {1e3 * filtered / len(truth):.1f} ms a frame, {models[name].motion.size} states"
        )


def print_angles(motion: ArticulatedMotion, found: Estimate, truth: Array, seen: np.ndarray, t_s: Array) -> None:
    """Errors of angles, measured and filled apart."""
    inside = pose_trial(t_s, truth, motion.path.frames).y.reshape(truth.shape)
    fitted = fit_poses(motion.tree, inside, np.full(truth.shape[:2], 1e-5))
    assert found.angles is not None
    angle, sd = found.angles
    off = (angle - fitted.angles + np.pi) % (2 * np.pi) - np.pi
    both = np.all(seen[:, motion.ends], axis=2)[:, motion.tree.joint]
    for word, where in (("measured", both), ("filled", ~both)):
        rms = np.degrees(np.sqrt(np.mean(off[where] ** 2)))
        held = 100 * np.mean(np.abs(off[where]) < Z95 * sd[where])
        middle = np.degrees(np.median(np.abs(off[where])))
        print(f"  angles {word}: {rms:.2f} degrees rms, {middle:.2f} median, {held:.1f} % inside, {int(where.sum())}")


def miss(found: Estimate, truth: Array, where: np.ndarray) -> str:
    """Root mean square error of a coordinate, and share inside."""
    off = (found.xyz_m - truth)[where]
    sd = np.sqrt(np.diagonal(found.cov_m2, axis1=-2, axis2=-1)[where])
    return f"{1e3 * np.sqrt(np.mean(off**2)):.2f} mm ({100 * np.mean(np.abs(off) < Z95 * sd):.0f} % inside)"


def main() -> None:
    """Both animals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    makers: tuple[Callable[..., SyntheticRecording], ...] = (make_bat, make_lizard)
    for make in makers:
        angles_of(make(seed=options.seed, n_frames=options.frames))


if __name__ == "__main__":
    main()
