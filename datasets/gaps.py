"""How often markers are seen, and how long they are not."""

import numpy as np
from numpy.typing import NDArray


def interior_gaps(seen: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Runs of frames without a marker between two frames with it.

    Args:
        seen: (T, M) True where there is a sample.

    Returns:
        (G, 3) marker index, first missing frame and length of each gap, by marker, then by frame.
    """
    rows = []
    for m in range(seen.shape[1]):
        at = np.flatnonzero(seen[:, m])
        length = np.diff(at) - 1
        rows.append(np.column_stack([np.full(len(length), m), at[:-1] + 1, length])[length > 0])
    return np.concatenate(rows) if rows else np.empty((0, 3), dtype=np.intp)


def gap_statistics(seen: NDArray[np.bool_]) -> dict:
    """Share seen, and number and lengths of interior gaps, of (T, M) samples; ready for JSON."""
    gaps = interior_gaps(seen)
    length = gaps[:, 2]
    quantiles = np.quantile(length, [0.5, 0.9, 1.0]) if len(length) else np.zeros(3)
    return {
        "share_seen": round(float(seen.mean()), 4),
        "interior_gaps": len(length),
        "interior_gap_frames": int(length.sum()),
        "gaps_10_to_60_frames": int(np.sum((length >= 10) & (length <= 60))),
        "markers_with_gaps_10_to_60_frames": len(np.unique(gaps[(length >= 10) & (length <= 60), 0])),
        "gap_frames_median": float(quantiles[0]),
        "gap_frames_90_percent": float(quantiles[1]),
        "gap_frames_max": float(quantiles[2]),
    }
