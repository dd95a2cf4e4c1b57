"""
The same in a notebook
======================

Everything that the command line does is a function that takes and gives objects. This page reads a recording, tracks
it, and goes on with pandas and xarray. Download it as a notebook at its foot.
"""

# %%
# A recording to work with
# ------------------------
# A third of a second of a synthetic bat's flight, written as files of DLTdv. With your own files begin at
# ``mocap.read``.

from pathlib import Path
from tempfile import mkdtemp

import mocap.datasets

import mocap

flight = mocap.datasets.bat(seed=3, n_frames=90)
files = mocap.datasets.write_recording(flight, Path(mkdtemp()))
print(*sorted(path.name for path in files.values()), sep="\n")

# %%
# From a numpy array
# ------------------
# Positions of shape (frames, markers, 3), NaN where a marker was not seen, need no files. A notebook shows what was
# found: the main numbers, the animal, what is wrong, and what to do next.

import numpy as np

xyz = np.array(flight.truth.xyz_m)
xyz[30:45, flight.truth.names.index("wrist_l")] = np.nan  # fifteen frames without the left wrist
recording = mocap.from_arrays(xyz, names=flight.truth.names, fps=flight.fps, unit="m")
mocap.track(recording, model="constant_velocity", validate=False)

# %%
# Read
# ----
# ``profile`` holds the lenses. A notebook shows the recording as a table; in a script print it.

recording = mocap.read(
    files["pixels"],
    calibration=files["coefficients"],
    profile=files["profile"],
    fps=flight.fps,
    skeleton=files["skeleton"],
)
print(recording)

# %%
# Track
# -----
# ``model`` is chosen by how well hidden samples are filled; here it is stated, and nothing is hidden, to be quick.

result = mocap.track(recording, model="eal", validate=False)
result

# %%
# Markers
# -------
# An ``xarray.Dataset`` in the layout of the package *movement*, with covariances.

result.markers

# %%
# How well heights are known, where markers were seen and where not:

one = result.markers.sel(individual="id_0")
sd_mm = 1e3 * np.sqrt(one.covariance.sel(space="z", space_to="z"))
for code, word in ((1, "measured"), (4, "filled")):  # one.status.attrs has the words of all codes
    where = one.status == code
    print(f"{word}: {int(where.sum())} samples, sd of the height {float(sd_mm.where(where).median()):.2f} mm")

# %%
# Angles
# ------

flexion = result.kinematics["elbow_l_flexion_deg"]
print(flexion.what)
result.plot.over_time("elbow_l_flexion_deg")

# %%
# All of them as a table, with ``<name>_sd`` and ``<name>_status`` beside each:

result.kinematics.to_dataframe().iloc[:3, :6]

# %%
# Wing beats
# ----------
# One row per beat, ready for a mixed model.

result.cycles

# %%
# Save, load, look
# ----------------

folder = Path(mkdtemp()) / "flight"
result.save(folder)
again = mocap.load(folder)
print(again)

# %%
# ``again.view()`` opens it in rerun. Next: :doc:`/tutorials/executed/potential`.
