"""Tracked markers as an xarray dataset, laid out as the package movement lays out poses, with covariance and status."""

import numpy as np
import xarray as xr

from mocap.io.tables import WORDS
from mocap.pipeline.recording import Recording
from mocap.records import Status

INDIVIDUAL = "id_0"
"""The only animal of a recording, as movement names it."""


def markers_dataset(run: Recording) -> xr.Dataset:
    """Positions of all markers with their uncertainty and where each comes from.

    Variables, with the dimensions ``time`` (s), ``space`` (x, y, z), ``keypoint`` (markers) and ``individual``, as in
    movement (Sirmpilatze et al. 2025), version 0.17:

    - ``position`` (time, space, keypoint, individual) in metres; NaN where there is none;
    - ``covariance`` (time, space, space_to, keypoint, individual) in square metres;
    - ``confidence`` (time, keypoint, individual), which movement asks for: NaN, since the covariance says more;
    - ``status`` (time, keypoint, individual): whether measured, predicted, smoothed (a filled gap), rejected, missing;
      its attributes ``flag_values`` and ``flag_meanings`` name the codes (CF conventions);
    - ``repaired`` (time, keypoint, individual): 1 where a sample bore another marker's name in the file.

    Args:
        run: A recording that was tracked.
    """
    markers, t_s = run.tracks, run.t_s
    fps = (len(t_s) - 1) / float(t_s[-1] - t_s[0]) if len(t_s) > 1 else 1.0
    flags = {"flag_values": np.array([int(o) for o in Status], dtype=np.int8), "flag_meanings": " ".join(WORDS)}
    sample = ("time", "keypoint", "individual")
    return xr.Dataset(
        {
            "position": (
                ("time", "space", "keypoint", "individual"),
                np.moveaxis(markers.xyz_m, 1, 2)[..., None],
                {"units": "m"},
            ),
            "confidence": (sample, np.full((*markers.status.shape, 1), np.nan)),
            "covariance": (
                ("time", "space", "space_to", "keypoint", "individual"),
                np.moveaxis(markers.cov_m2, 1, 3)[..., None],
                {"units": "m2"},
            ),
            "status": (sample, markers.status[..., None], flags),
            "repaired": (sample, run.repaired[..., None].astype(np.int8)),
        },
        coords={
            "time": ("time", t_s, {"units": "s"}),
            "frame": ("time", np.arange(1, len(t_s) + 1)),
            "space": ["x", "y", "z"],
            "space_to": ["x", "y", "z"],
            "keypoint": list(markers.names),
            "individual": [INDIVIDUAL],
        },
        attrs={
            "source_software": "eal-mocap",
            "ds_type": "poses",
            "fps": fps,
            "time_unit": "seconds",
            "space_unit": "m",
            "motion_model": run.model,
        },
    )
