"""Our NetCDF files in the released package movement, which needs a newer Python than the project: installed apart."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mocap.io.registry import read, write
from tests.mocap.recordings import points

ENV = Path(__file__).resolve().parents[2] / ".venv-movement"
VERSION = "0.17.0"
NEEDS = (3, 12)
IMPORTS = ("attrs", "loguru", "scipy", "xarray", "h5netcdf", "h5py")
"""What its validators and kinematics import; all that it depends on (napari's formats, videos) is a gigabyte."""
SCRIPT = """
import json, sys, xarray
from movement.validators.datasets import ValidPosesInputs
from movement.kinematics import compute_velocity
out = []
for path in sys.argv[1:]:
    data = xarray.load_dataset(path)
    ValidPosesInputs.validate(data)
    velocity = compute_velocity(data["position"])
    pick = {"keypoint": "knee, left", "time": data.time[1]}
    out.append({
        "dims": list(data["position"].dims), "fps": float(data.attrs["fps"]), "unit": data.attrs["time_unit"],
        "type": data.attrs["ds_type"], "individuals": [str(v) for v in data["individual"].values],
        "position": data["position"].sel(**pick).isel(individual=0).values.tolist(),
        "velocity": velocity.sel(**pick).isel(individual=0).values.tolist(),
        "missing": int(data["position"].isnull().sum()),
        "confidence": list(data["confidence"].dims),
    })
    again = path.replace(".nc", "_again.nc")
    data.to_netcdf(again)
print(json.dumps(out))
"""


def _pythons() -> list[str]:
    """Interpreters of this machine that may be new enough."""
    versions = Path.home() / ".pyenv" / "versions"
    named = [shutil.which(f"python3.{minor}") for minor in (14, 13, 12)]
    found = [sys.executable, *named, *sorted(map(str, versions.glob("3.1[2-9].*/bin/python")))]
    return [python for python in found if python is not None]


def _new_enough(python: str) -> bool:
    code = f"import sys; sys.exit(sys.version_info < {NEEDS})"
    return subprocess.run([python, "-c", code], capture_output=True, check=False).returncode == 0


@pytest.fixture(scope="module")
def movement_python():
    """The interpreter of an environment with movement; made once, beside the project's own."""
    python = ENV / "bin" / "python"
    if python.exists():
        return python
    base = next((p for p in _pythons() if _new_enough(p)), None)
    if base is None:
        pytest.skip(f"movement {VERSION} needs Python {NEEDS[0]}.{NEEDS[1]} or newer: none is here")
    try:
        subprocess.run([base, "-m", "venv", "--without-pip", str(ENV)], check=True, capture_output=True, timeout=100)
        (ENV / ".gitignore").write_text("*\n")
        pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-compile"]
        subprocess.run([*pip, "--no-deps", f"movement=={VERSION}"], check=True, capture_output=True, timeout=60)
        subprocess.run([*pip, *IMPORTS], check=True, capture_output=True, timeout=200)
    except (subprocess.SubprocessError, OSError) as error:
        shutil.rmtree(ENV, ignore_errors=True)
        pytest.skip(f"movement {VERSION} could not be installed: {error}")
    return python


def test_movement_takes_our_files(movement_python, tmp_path):
    """Its own validator passes them, its kinematics find the velocity, and what it saves we read back.

    A knee that moves evenly has the velocity of its path (central differences are exact on a line).
    """
    t = np.arange(6) / 250
    velocity = np.array([0.5, -1.0, 2.0])
    xyz = np.stack([np.zeros((6, 3)), t[:, None] * velocity], axis=1)
    xyz[4, 0] = np.nan
    plain = points(["hip joint", "knee, left"], xyz)
    two = replace(plain, animals=(("bat 1", "hip joint"), ("bat 2", "knee, left")))
    for recording, name in ((plain, "one.nc"), (two, "two.nc")):
        write(recording, tmp_path / name)
    environment = {**os.environ, "HOME": str(tmp_path), "LOGURU_LEVEL": "ERROR"}
    files = [str(tmp_path / name) for name in ("one.nc", "two.nc")]
    done = subprocess.run(
        [str(movement_python), "-c", SCRIPT, *files], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    one, animals = json.loads(done.stdout.splitlines()[-1])
    assert one["dims"] == ["time", "space", "keypoint", "individual"]
    assert one["confidence"] == ["time", "keypoint", "individual"]
    assert (one["fps"], one["unit"], one["type"], one["individuals"]) == (250.0, "seconds", "poses", ["id_0"])
    np.testing.assert_allclose(one["position"], xyz[1, 1], atol=1e-15)
    np.testing.assert_allclose(one["velocity"], velocity, rtol=1e-12)
    assert one["missing"] == 3
    assert animals["individuals"] == ["bat 1", "bat 2"]
    back = read(tmp_path / "one_again.nc")
    assert back.names == plain.names
    np.testing.assert_array_equal(back.points.xyz_m, plain.points.xyz_m)
