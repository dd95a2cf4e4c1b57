"""Whether beats that are counted are right, where a wing was lost at a turning point.

    python -m benchmarks.lost_turns [--quick] [--first 0] [--count 500] --out DIR

In each simulated bat (four cameras, 216 frames at 240 a second) one wing, from shoulder to tip, is hidden from all
cameras about a true turning point, for 0.15 to 1.5 of a beat; in one recording of five it is lost from there to the
end. It is tracked as users track it. A found beat is *wrong* if one of its three turning points is further from every
true one of its kind than an eighth of a beat; *good* if it is not wrong and root and tip were measured at all three.
``DIR/beats.csv`` has a row for each found beat with what it is and its status, ``DIR/frequency.csv`` a row for each
recording: the frequency with its interval, and the true one, by the phase from the first to the last turning point that
counts. Turning points stray from the phase, by skin and strokes that differ: exact turning points in place of it would
stray alike, and what the interval holds for that would never be needed. Each recording has a file of its own; those
that are there are not tracked again.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from mocap.datasets import make_bat, write_recording
from mocap.datasets.bats import BEAT_HZ, bat_motion, beats_done
from mocap.datasets.film import SyntheticRecording
from mocap.filters.velocities import Motion, with_means, without_rates

from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycle_checks import gap_at, seen_samples, turning_times
from mocap.kinematics.cycles import cycles
from mocap.kinematics.frequency import frequencies
from mocap.kinematics.points import rate_points_for
from mocap.kinematics.records import COUNTED, Cycle
from mocap.reading.reading import read
from mocap.report.job import run_job
from mocap.skeleton import Skeleton

FRAMES, FPS = 216, 240.0
WRONG = 0.125
"""Share of a beat by which a turning point of a wrong beat is off: half way to a quarter of it."""


def hidden(film: SyntheticRecording, rows: Sequence[Cycle], rng: np.random.Generator) -> SyntheticRecording:
    """The recording without one wing about a turning point of true beats."""
    wing = str(rng.choice(list(dict.fromkeys(row.of for row in rows))))
    times = [time for row in rows if row.of == wing for _, time in turning_times(row)]
    centre = rng.choice(times) + rng.uniform(-0.15, 0.15) / BEAT_HZ
    half = 0.5 * rng.uniform(0.15, 1.5) / BEAT_HZ
    lost = np.abs(film.truth.t_s - centre) <= half
    if rng.uniform() < 0.2:
        lost = film.truth.t_s >= centre - half
    side = wing.removeprefix("wing")
    markers = [i for i, name in enumerate(film.skeleton.markers) if name.endswith(side)]
    uv = film.pixels.uv_px.copy()
    uv[:, lost[:, None] & np.isin(np.arange(uv.shape[2]), markers)] = np.nan
    return replace(film, pixels=replace(film.pixels, uv_px=uv))


def truth(seed: int, skeleton: Skeleton) -> list[Cycle]:
    """The beats of the true motion, with those that begin before the recording or end after it."""
    t_s = np.arange(-round(FPS / BEAT_HZ), FRAMES + round(FPS / BEAT_HZ)) / FPS
    scene, step = bat_motion(seed), 1e-4
    x, later, before = (scene(t).xyz_m for t in (t_s, t_s + step, t_s - step))
    own = np.broadcast_to(np.diag([1e-8] * 3 + [1e-6] * 3), (*x.shape[:2], 6, 6))
    measured = np.ones(x.shape[:2], dtype=bool)
    still = without_rates(skeleton.markers, t_s, x, own[..., :3, :3], measured)
    motion = replace(still, velocity_m_s=(later - before) / (2 * step), own=own, kept=np.ones(x.shape))
    points = rate_points_for(skeleton.markers, skeleton, n_frames=len(t_s))
    motion = with_means(motion, points)
    return cycles(kinematics(motion, skeleton), motion, skeleton)


def beats(rows: Sequence[Cycle], true: Sequence[Cycle], motion: Motion, skeleton: Skeleton) -> Iterator[dict]:
    """A row for each found beat: by how much it is off, in beats, whether its turning points were seen, its status."""
    for row in rows:
        upper = np.array([time for one in true if one.of == row.of for time in (one.start_s, one.end_s)])
        lower = np.array([turning_times(one)[1][1] for one in true if one.of == row.of])
        times = [time for _, time in turning_times(row)]
        off = max(np.abs(of - time).min() for of, time in zip((upper, lower, upper), times, strict=True)) * BEAT_HZ
        whole = round((row.end_s - row.start_s) * BEAT_HZ) == 1
        seen = seen_samples(row.kind, row.of, motion, skeleton)
        measured = all(gap_at(time, motion.t_s, seen) is None for time in times)
        yield dict(
            of=row.of, start_s=row.start_s, off=off, wrong=off > WRONG or not whole, measured=measured,
            status=row.status, reason=row.reason,
        )  # fmt: skip


def simulated(seed: int) -> tuple[list[dict], dict]:
    """The beats, and the frequency, of one recording."""
    film = make_bat(seed=seed, n_frames=FRAMES, fps=FPS, n_cameras=4)
    true = truth(seed, film.skeleton)
    inside = [row for row in true if row.start_s >= 0 and row.end_s <= film.truth.t_s[-1]]
    film = hidden(film, inside, np.random.default_rng([seed, 7]))
    with TemporaryDirectory() as folder:
        files = write_recording(film, Path(folder))
        source = read(
            files["pixels"],
            fps=film.fps,
            calibration=files["coefficients"],
            profile=files["profile"],
            skeleton=files["skeleton"],
            origin="upper-left",
        )
        run, _ = run_job(source, validated=False)
    rows = cycles(run.kinematics, run.motion, run.skeleton)
    found = list(beats(rows, true, run.motion, run.skeleton))
    return found, frequency(rows, seed)


def frequency(rows: Sequence[Cycle], seed: int) -> dict:
    """The stated frequency beside the true one: how far the phase goes from the first to the last turning point."""
    stated = frequencies(rows)
    if not stated:
        return {}
    counted = [row for row in rows if row.status == COUNTED]
    ends = np.array([min(row.start_s for row in counted), max(row.end_s for row in counted)])
    exact = float(np.diff(beats_done(seed, ends))[0] / (ends[1] - ends[0]))
    one = stated[0]
    return dict(
        value_hz=one.value_hz, sd_hz=one.sd_hz, true_hz=exact, z=(one.value_hz - exact) / one.sd_hz,
        inside=one.low_hz <= exact <= one.high_hz, n_cycles=one.n_cycles, n_doubtful=one.n_doubtful,
    )  # fmt: skip


def summary(found: pd.DataFrame, rates: pd.DataFrame) -> str:
    """What is asked: how many wrong beats count, how many good ones do not, how often the interval holds the truth."""
    counts = found.status == COUNTED
    wrong, good = found.wrong, ~found.wrong & found.measured
    return (
        f"{len(rates)} recordings, {len(found)} beats, {(~counts).sum()} doubtful; "
        f"wrong: {wrong.sum()}, of which counted: {(wrong & counts).sum()}; "
        f"good: {good.sum()}, of which doubtful: {(good & ~counts).sum()} ({(good & ~counts).sum() / good.sum():.1%}); "
        f"frequency inside its interval: {rates.inside.mean():.1%} (z {np.sqrt((rates.z**2).mean()):.2f}, "
        f"median half-width {1.96 * rates.sd_hz.median():.2f} Hz)"
    )


def main() -> None:
    """Run, print, write."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="two recordings")
    options.add_argument("--first", type=int, default=0, help="seed of the first recording")
    options.add_argument("--count", type=int, default=500)
    options.add_argument("--out", type=Path, required=True)
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    found, rates = [], []
    for seed in range(given.first, given.first + (2 if given.quick else given.count)):
        path = given.out / f"{seed}.json"
        if not path.exists():
            path.write_text(json.dumps(simulated(seed), default=float), encoding="utf-8")
        some, rate = json.loads(path.read_text(encoding="utf-8"))
        found += [{"seed": seed, **one} for one in some]
        rates += [{"seed": seed, **rate}] if rate else []
    table, frequency_table = pd.DataFrame(found), pd.DataFrame(rates)
    table[["wrong", "measured"]] = table[["wrong", "measured"]].astype(bool)
    table.to_csv(given.out / "beats.csv", index=False)
    frequency_table.to_csv(given.out / "frequency.csv", index=False)
    print(summary(table, frequency_table))


if __name__ == "__main__":
    main()
