"""
Which foot stands when
======================

Three quarters of a second of a synthetic lizard's walk up a rod, tracked with constant velocity alone, and its gait
diagram.
"""

from pathlib import Path
from tempfile import mkdtemp

import mocap.datasets

import mocap

walk = mocap.datasets.lizard(seed=0, n_frames=180)
files = mocap.datasets.write_recording(walk, Path(mkdtemp()))
recording = mocap.read(files["pixels"], calibration=files["coefficients"], fps=walk.fps, skeleton=files["skeleton"])
result = mocap.track(recording, model="constant_velocity", validate=False)
result.plot.gait()
