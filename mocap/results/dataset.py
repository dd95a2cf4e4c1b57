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
    - ``repaired`` (time, keypoint, individual): 1 where a sample bore another marker's name in the file, 2 where a
      person corrected it (``edited`` in tables).
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


def plane_dataset(run: Recording) -> xr.Dataset:
    """As ``markers_dataset``, in x and y, in the unit of the plane."""
    assert run.plane is not None
    unit, factor = run.plane.unit, run.plane.per_m
    found = markers_dataset(run).sel(space=["x", "y"], space_to=["x", "y"])
    found["position"] = (factor * found["position"]).assign_attrs(units=unit)
    found["covariance"] = (factor**2 * found["covariance"]).assign_attrs(units=f"{unit}2")
    return found.assign_attrs(space_unit=unit)
