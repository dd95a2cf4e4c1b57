"""
From film to angles
===================

From four films and a few clicks to joint angles. On the command line the same is ``mocap digitise`` and ``mocap
track``. You need films of an animal with dots on its joints, and calibrated cameras (:doc:`/tutorials/calibrate`).
"""

# %%
# Films
# -----
# Thirty frames of a synthetic bat in four cameras, as movies. With your own films skip this.

from pathlib import Path
from tempfile import mkdtemp

import mocap.datasets
import numpy as np
from mocap.datasets.bats import bat_motion
from mocap.datasets.movie import shown_pixels, write_movies

import mocap

flight = mocap.datasets.bat(seed=0, n_cameras=4, n_frames=30)
folder = Path(mkdtemp())
files = mocap.datasets.write_recording(flight, folder, others=True)
(folder / "films").mkdir()
scene = (bat_motion(0), flight.truth.t_s, flight.cameras)
write_movies(*scene, folder / "films", fps=flight.fps, start_s=flight.start_s)
calibration, skeleton = folder / "bat_calibration.toml", folder / "bat_skeleton.toml"
print(*sorted(path.name for path in (folder / "films").iterdir()))

# %%
# A person's clicks
# -----------------
# Every marker in two cameras of one frame. ``mocap digitise --web`` opens a page to make them; a table of DLTdv with
# one frame clicked will do as well. Here they are simulated from frame 16, with clicking errors of about a pixel.

shown = shown_pixels(*scene, start_s=flight.start_s)
u_v = np.full_like(shown.uv_px, np.nan)
u_v[:2, 15] = shown.uv_px[:2, 15] + np.random.default_rng(0).normal(0, 0.7, shown.uv_px[:2, 15].shape)
titles = [f"{name}_cam{c}_{axis}" for name in shown.names for c in range(1, 5) for axis in "XY"]
table = np.transpose(u_v, (1, 2, 0, 3)).reshape(30, -1)
np.savetxt(folder / "clicks_xypts.csv", table, delimiter=",", header=",".join(titles), comments="")
print(f"{np.isfinite(table).sum() // 2} clicks")

# %%
# Find and name
# -------------
# Dots are found in all films and given names in all cameras together.

found = mocap.digitise(folder / "films", calibration=calibration, skeleton=skeleton, start=folder / "clicks_xypts.csv")
found

# %%
# Which clicks would help most? Answer them in the page, or by ``found.click([...])``.

for q in found.questions(5):
    print(f"film {q.camera + 1}, frame {q.frame + 1}: {shown.names[q.marker]}")

# %%
# Track
# -----
# What was named, saved as DLTdv's files, and tracked.

found.save(folder / "digitised")
recording = mocap.read(
    folder / "digitised" / "xypts.csv",
    calibration=calibration,
    fps=flight.fps,
    skeleton=skeleton,
    origin="upper-left",
)
result = mocap.track(recording, model="constant_velocity", validate=False)
result.plot.over_time("elbow_l_flexion_deg", "elbow_r_flexion_deg")

# %%
# How close to the truth? The films are synthetic, so we know.

error = np.linalg.norm(result.tracks.xyz_m - flight.truth.xyz_m, axis=-1)
print(f"markers {1e3 * np.nanmedian(error):.2f} mm off (median), 90 % within {1e3 * np.nanquantile(error, 0.9):.2f} mm")

# %%
# More of it: :doc:`/howto/digitising`.
