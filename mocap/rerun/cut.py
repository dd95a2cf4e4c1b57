"""The part of a run in which there is something to see."""

from dataclasses import replace

import numpy as np

from mocap.pipeline.run import Run


def known_part(run: Run) -> slice:
    """Frames from the first to the last position of any marker; all where there is none."""
    known = np.flatnonzero(run.tracked.markers.seen.any(axis=1))
    return slice(int(known[0]), int(known[-1]) + 1) if len(known) else slice(0, len(run.tracked.markers.t_s))


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
