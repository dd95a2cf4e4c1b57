"""Our NetCDF files in the package movement, installed apart: the last release for the newest Python that is here."""

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
VERSIONS = {"0.17.0": ((3, 12), {}), "0.15.0": ((3, 11), {"keypoint": "keypoints", "individual": "individuals"})}
"""Each with the Python that it needs, and the names that it has for dimensions (docs/reference/files.md)."""
IMPORTS = ("attrs", "loguru", "scipy", "xarray", "h5netcdf", "h5py")
"""What its validators and kinematics import; all that it depends on (napari's formats, videos) is a gigabyte."""
SCRIPT = """
import json, sys, xarray
from movement.validators.datasets import ValidPosesInputs
from movement.kinematics import compute_velocity
out = []
names = json.loads(sys.argv[1])
for path in sys.argv[2:]:
    data = xarray.load_dataset(path).rename(names)
    ValidPosesInputs.validate(data)
    velocity = compute_velocity(data["position"])
    pick = {names.get("keypoint", "keypoint"): "knee, left", "time": data.time[1]}
    individual = names.get("individual", "individual")
    out.append({
        "dims": list(data["position"].dims), "fps": float(data.attrs["fps"]), "unit": data.attrs["time_unit"],
        "type": data.attrs["ds_type"], "individuals": [str(v) for v in data[individual].values],
        "position": data["position"].sel(**pick).isel({individual: 0}).values.tolist(),
        "velocity": velocity.sel(**pick).isel({individual: 0}).values.tolist(),
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
    named = [shutil.which(f"python3.{minor}") for minor in (14, 13, 12, 11)]
    found = [sys.executable, *named, *sorted(map(str, versions.glob("3.1[2-9].*/bin/python")))]
    return [python for python in found if python is not None]


def _new_enough(python: str, needs: tuple[int, int]) -> bool:
    code = f"import sys; sys.exit(sys.version_info < {needs})"
    return subprocess.run([python, "-c", code], capture_output=True, check=False).returncode == 0


@pytest.fixture(scope="module")
def movement():
    """A release: the interpreter of an environment with it, made once beside the project's own, and its names."""
    usable = ((v, p) for v, (needs, _) in VERSIONS.items() for p in _pythons() if _new_enough(p, needs))
    version, base = next(usable)  # at least this Python, for which the older one is
    env, names = ENV / version, VERSIONS[version][1]
    python = env / "bin" / "python"
    if python.exists():
        return python, names
    try:
        subprocess.run([base, "-m", "venv", "--without-pip", str(env)], check=True, capture_output=True, timeout=100)
        (ENV / ".gitignore").write_text("*\n")
        pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-compile"]
        subprocess.run([*pip, "--no-deps", f"movement=={version}"], check=True, capture_output=True, timeout=60)
        subprocess.run([*pip, *IMPORTS], check=True, capture_output=True, timeout=200)
    except (subprocess.SubprocessError, OSError) as error:
        shutil.rmtree(env, ignore_errors=True)
        pytest.skip(f"movement {version} could not be installed: {error}")
    return python, names


def test_movement_takes_our_files(movement, tmp_path):
    """Its own validator passes them, its kinematics find the velocity, and what it saves we read back.

    An older one takes them with the names that it has for dimensions. A knee that moves evenly has the velocity of its
    path (central differences are exact on a line).
    """
    python, names = movement
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
        [str(python), "-c", SCRIPT, json.dumps(names), *files],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    one, animals = json.loads(done.stdout.splitlines()[-1])
    own = [names.get(dim, dim) for dim in ("time", "space", "keypoint", "individual")]
    assert one["dims"] == own
    assert one["confidence"] == [own[0], *own[2:]]
    assert (one["fps"], one["unit"], one["type"], one["individuals"]) == (250.0, "seconds", "poses", ["id_0"])
    np.testing.assert_allclose(one["position"], xyz[1, 1], atol=1e-15)
    np.testing.assert_allclose(one["velocity"], velocity, rtol=1e-12)
    assert one["missing"] == 3
    assert animals["individuals"] == ["bat 1", "bat 2"]
    back = read(tmp_path / "one_again.nc")
    assert back.names == plain.names
    np.testing.assert_array_equal(back.points.xyz_m, plain.points.xyz_m)
