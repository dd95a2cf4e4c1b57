"""Where the processor time of a job goes: a profile by stage, in seconds and in turns of a fixed reference loop.

Each moment counts once, in the innermost stage that is running; "rest" is what no stage covers. Python tells of every
call while the job runs, which slows code of many small functions: shares are to be read, not seconds. The reference
loop is the same arithmetic on every machine, timed beside the job, so that numbers of two machines can be compared.
"""

import sys
import time
from collections.abc import Callable, Mapping
from types import CodeType, FrameType, FunctionType
from typing import Any

import numpy as np
from mocap.filters import bones, track
from mocap.filters.mixture import Mixture, learn_mixture
from mocap.filters.models import delayed_poses, pose
from mocap.filters.models.base import TrialSet
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.observe import observe

from eal.threads import one_blas_thread
from mocap.joints import joint_tracks
from mocap.pipeline import potentials, prepare, report

STAGES: dict[str, tuple[FunctionType, ...]] = {
    "triangulate, clean": (prepare.prepare_filmed, prepare.prepare_tracks),
    "poses, subspace": (TrialSet.shapes,),
    "rigid bones": (bones.rigid_bones,),
    "regression": (delayed_poses.FittedDelays.fill, delayed_poses.DelaySettings.tuned),
    "mechanics, V_z": (pose.learn_pose,),
    "filter: observe": (observe,),
    "filter: potential, bones": (PoseMotion.constrain,),
    "filter: predict, rest": (track.filter_forward,),
    "smooth back": (track.smooth,),
    "mix models": (learn_mixture, Mixture.calibrated, Mixture.combine),
    "joints, potentials": (joint_tracks, potentials.joint_potentials),
    "report": (report.make_report, report.readable),
}


def reference_s() -> float:
    """Processor time of the fixed loop: 200 products of 200 x 200 matrices and a hundred thousand steps of Python."""
    a = np.random.default_rng(0).normal(size=(200, 200)) / 200
    with one_blas_thread():
        start = time.process_time()
        b = np.eye(200)
        for _ in range(200):
            b = a @ b + np.eye(200)
        total = 0
        for k in range(100_000):
            total += k % 7
        return time.process_time() - start


def by_stage(
    job: Callable[[], object], stages: Mapping[str, tuple[FunctionType, ...]] = STAGES
) -> dict[str, tuple[float, int]]:
    """Seconds of the processor and calls of each stage while a job runs, of the rest, and of all together."""
    names: dict[CodeType, str] = {one.__code__: stage for stage, functions in stages.items() for one in functions}
    spent, calls = dict.fromkeys([*stages, "rest"], 0.0), dict.fromkeys(stages, 0)
    running, since = ["rest"], time.process_time()

    def tell(frame: FrameType, event: str, _: Any) -> None:
        nonlocal since
        stage = names.get(frame.f_code)
        if stage is None or event not in ("call", "return"):
            return
        now = time.process_time()
        spent[running[-1]] += now - since
        since = now
        if event == "call":
            calls[stage] += 1
            running.append(stage)
        else:
            running.pop()

    with one_blas_thread():
        sys.setprofile(tell)
        try:
            job()
        finally:
            sys.setprofile(None)
    spent[running[-1]] += time.process_time() - since
    found = {stage: (seconds, calls.get(stage, 0)) for stage, seconds in spent.items()}
    return found | {"all": (sum(spent.values()), 1)}


def as_lines(title: str, found: Mapping[str, tuple[float, int]], reference: float) -> str:
    """A table of one job; stages that it does not have are left out."""
    total = found["all"][0]
    lines = [f"{title:34}{'calls':>8}{'cpu s':>9}{'share':>8}{'x reference':>13}"]
    for stage, (seconds, calls) in found.items():
        if seconds:
            share = f"{100 * seconds / total:7.0f}%"
            lines.append(f"  {stage:32}{calls or '':>8}{seconds:9.2f}{share}{seconds / reference:13.1f}")
    return "\n".join(lines)
