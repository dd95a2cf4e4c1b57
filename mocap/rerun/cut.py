"""The part of a run in which there is something to see."""

import numpy as np

from mocap.pipeline.recording import Recording


def known_part(run: Recording) -> slice:
    """Frames from the first to the last position of any marker; all where there is none."""
    known = np.flatnonzero(run.tracks.seen.any(axis=1))
    return slice(int(known[0]), int(known[-1]) + 1) if len(known) else slice(0, len(run.t_s))
