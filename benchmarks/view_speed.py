"""Writing a recording by columns beside logging it frame by frame, and filtering live beside filtering alone.

``python -m benchmarks.view_speed [--quick]``. 34 markers, 2000 frames, 30 cameras, every ray seen. "columns" is
``write_recording``: scene, ellipsoids, trails, pixels, whiskers, errors, gaps; "calls" logs pixels, reprojections and
the body alone, a call an entity and frame, as rerun's own examples do. Sizes are in units of the numbers as float32.
Then the time that a stream to a viewer, which is a process of its own, adds to filtering: of the processor, and on the
wall.
"""

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import rerun as rr

from benchmarks.tracker_speed import N_CAMERAS, N_MARKERS, Case, markers
from datasets.rig import tunnel_cameras
from filters.live import live, looks
from filters.observations import PixelObservations
from filters.records import TrackedMotion
from mocap.pipeline.run import Run
from mocap.records import MarkerTracks, PixelTracks, Status
from mocap.rerun import paths
from mocap.rerun.live import LiveView
from mocap.rerun.record import run_scene, write_recording
from mocap.rerun.viewer import open_viewer
from mocap.skeleton import Skeleton

ROUNDS = 3


def run_of(case: Case) -> Run:
    """A run that shows the case, without tracking it."""
    seen, t_s = case.seen, case.t_s
    assert isinstance(seen, PixelObservations)
    names = tuple(f"m{i}" for i in range(N_MARKERS))
    cameras = tuple(tunnel_cameras(N_CAMERAS))
    shape = seen.uv_px.shape[:3]
    origin = np.full(shape[1:], Status.MEASURED)
    noise = np.random.default_rng(1).normal(size=seen.uv_px.shape)
    return Run(
        name="speed",
        skeleton=Skeleton(name="markers only", markers=names),
        cameras=cameras,
        ideal_px=PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=seen.uv_px),
        repaired=np.zeros(shape[1:], dtype=bool),
        y_up=False,
        tracked=TrackedMotion(
            model="none",
            markers=MarkerTracks(names=names, t_s=t_s, xyz_m=seen.xyz_m, cov_m2=seen.cov_m2, status=origin),
            reprojected_px=seen.uv_px + noise,
            innovation_px=noise,
            used=np.ones(shape, dtype=bool),
            nis=np.ones(len(t_s)),
            n_rows=np.full(len(t_s), 2 * N_MARKERS * N_CAMERAS),
            log_likelihood=np.zeros(len(t_s)),
        ),
        joints={},
        potentials={},
        spatial_potentials={},
        report={},
        report_text="",
    )


def by_calls(run: Run, path: Path) -> None:
    """Pixels, reprojections and body, frame by frame."""
    assert run.ideal_px is not None
    rec = rr.RecordingStream("speed", recording_id="speed", send_properties=False)
    rec.save(path)
    for k in range(len(run.ideal_px.t_s)):
        rec.set_time("frame", sequence=k)
        rec.log(paths.SKELETON, rr.Points3D(run.tracked.markers.xyz_m[k]))
        for c, name in enumerate(run.ideal_px.cameras):
            rec.log(f"{paths.image(name)}/measured", rr.Points2D(run.ideal_px.uv_px[c, k]))
            rec.log(f"{paths.image(name)}/reprojected", rr.Points2D(run.tracked.reprojected_px[c, k]))
    rec.flush(timeout_sec=60)
    rec.disconnect()


def written(n_frames: int) -> None:
    """Print time and size of both."""
    run = run_of(markers(n_frames))
    pixels, points = N_CAMERAS * N_MARKERS * n_frames, N_MARKERS * n_frames
    numbers = {"columns": 8 * pixels + (3 + 3 + 6 + 10) * points, "calls": 4 * pixels + 3 * points}
    seconds = {}
    for name, write in (("columns", write_recording), ("calls", by_calls)):
        with TemporaryDirectory() as folder:
            path, best = Path(folder) / "r.rrd", np.inf
            for _ in range(ROUNDS if name == "columns" else 1):
                start = time.perf_counter()
                write(run, path)
                best = min(best, time.perf_counter() - start)
            seconds[name] = best
            print(f"{name:8} {best:6.2f} s  {path.stat().st_size / 4 / numbers[name]:.2f} of its float32 numbers")
    print(f"calls / columns: {seconds['calls'] / seconds['columns']:.1f}, for half of what columns write")


def streamed(n_frames: int) -> None:
    """Print what a viewer adds to filtering."""
    case = markers(n_frames)
    scene = run_scene(run_of(case))
    names = [f"m{i}" for i in range(N_MARKERS)]
    viewer = open_viewer(None, web=True)
    best = {"alone": (np.inf, np.inf), "streamed": (np.inf, np.inf)}
    try:
        for _ in range(ROUNDS):
            for name in best:
                view = None
                if name == "streamed":
                    rec = rr.RecordingStream("speed", recording_id="live", send_properties=False)
                    rec.connect_grpc(viewer.sink)
                    view = LiveView(rec, scene, names=names, skeleton=Skeleton(name="none", markers=tuple(names)))
                wall, cpu = time.perf_counter(), time.process_time()
                for estimate in live(case.model, looks(case.seen, case.t_s), lag=8, every=8):
                    if view is not None:
                        view.show(estimate)
                took = time.process_time() - cpu, time.perf_counter() - wall
                best[name] = (min(best[name][0], took[0]), min(best[name][1], took[1]))
                if view is not None:
                    view.__exit__()
                    assert (view.shown, view.dropped) == (n_frames, 0), view.trouble
    finally:
        viewer.close()
    for name, (cpu, wall) in best.items():
        print(
            f"{name:8} {1e3 * cpu / n_frames:.2f} ms a frame of the processor, {1e3 * wall / n_frames:.2f} on the wall"
        )
    print(f"streamed / alone: {best['streamed'][0] / best['alone'][0]:.2f} of the processor")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    written(400 if quick else 2000)
    streamed(200 if quick else 1000)
