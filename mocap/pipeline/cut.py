"""Parts of runs, and runs put together from parts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mocap.filters.velocities import Motion
from mocap.pipeline.run import Run


def cut(run: Run, frames: slice) -> Run:
    """The run in these frames alone."""
    tracked, markers, pixels = run.tracked, run.tracked.markers, run.ideal_px
    if frames == slice(0, len(markers.t_s)):
        return run
    t_s = markers.t_s[frames]
    part = replace(
        markers, t_s=t_s, xyz_m=markers.xyz_m[frames], cov_m2=markers.cov_m2[frames], status=markers.status[frames]
    )
    return replace(
        run,
        ideal_px=None if pixels is None else replace(pixels, t_s=t_s, uv_px=pixels.uv_px[:, frames]),
        repaired=run.repaired[frames],
        footage=tuple(replace(f, frames=f.frames[frames]) for f in run.footage),
        motion=cut_motion(run.motion, frames),
        limbs=tuple(limb.cut(frames) for limb in run.limbs),
        angles=None if run.angles is None else run.angles.along(np.arange(len(run.angles.angle_rad))[frames]),
        joints={
            name: replace(joints, t_s=t_s, q_m=joints.q_m[frames], sd_m=joints.sd_m[frames])
            for name, joints in run.joints.items()
        },
        tracked=replace(
            tracked,
            markers=part,
            reprojected_px=tracked.reprojected_px[:, frames],
            innovation_px=tracked.innovation_px[:, frames],
            used=tracked.used[:, frames],
            nis=tracked.nis[frames],
            n_rows=tracked.n_rows[frames],
            log_likelihood=tracked.log_likelihood[frames],
        ),
    )


def cut_motion(motion: Motion, frames: slice) -> Motion:
    """The motion in these frames alone."""
    names = ("t_s", "xyz_m", "velocity_m_s", "own", "cross", "kept", "measured")
    return replace(motion, **{name: getattr(motion, name)[frames] for name in names})


def joined(runs: Sequence[Run]) -> Run:
    """Runs of one recording, one after the other in time, as one; what does not change with time is the first one's.

    Their motions hold the same points and pairs.
    """
    first = runs[0]
    t_s = np.concatenate([run.tracked.markers.t_s for run in runs])

    def along(get, axis: int = 0) -> np.ndarray:
        return np.concatenate([get(run) for run in runs], axis=axis)

    tracked, motion = first.tracked, first.motion
    markers = replace(
        tracked.markers,
        t_s=t_s,
        **{name: along(lambda run, n=name: getattr(run.tracked.markers, n)) for name in ("xyz_m", "cov_m2", "status")},
    )
    frames = {name: along(lambda run, n=name: getattr(run.tracked, n)) for name in ("nis", "n_rows", "log_likelihood")}
    views = {
        name: along(lambda run, n=name: getattr(run.tracked, n), 1)
        for name in ("reprojected_px", "innovation_px", "used")
    }
    moving = ("xyz_m", "velocity_m_s", "own", "cross", "kept", "measured")
    return replace(
        first,
        limbs=(),
        angles=None,
        ideal_px=None
        if first.ideal_px is None
        else replace(first.ideal_px, t_s=t_s, uv_px=along(lambda run: run.ideal_px.uv_px, 1)),
        repaired=along(lambda run: run.repaired),
        motion=replace(motion, t_s=t_s, **{name: along(lambda run, n=name: getattr(run.motion, n)) for name in moving}),
        joints={
            name: replace(
                joints,
                t_s=t_s,
                q_m=along(lambda run, n=name: run.joints[n].q_m),
                sd_m=along(lambda run, n=name: run.joints[n].sd_m),
            )
            for name, joints in first.joints.items()
        },
        tracked=replace(tracked, markers=markers, **frames, **views),
    )
