"""One joint, designed once: an arc of samples as a potential file, and what the command makes of it."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.distance import pdist

from eal import GaussianKernel, fit_potential
from tests.eal.joint_design.conftest import _hardly_optimised

__all__ = ["_hardly_optimised"]


@pytest.fixture(scope="module")
def potential_file(tmp_path_factory):
    """The potential of a forearm of 40 mm that swings over 80 degrees, as mocap track writes it."""
    rng = np.random.default_rng(5)
    angle = np.deg2rad(95 + 40 * np.sin(np.linspace(0, 9 * np.pi, 240)))
    samples = (0.040 + 0.0006 * rng.standard_normal(240))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    scale = float(np.sqrt(samples.var(axis=0).sum()))
    z = samples / scale
    kernel = GaussianKernel(4.0 / float(np.median(pdist(z, "sqeuclidean"))))
    path = tmp_path_factory.mktemp("potentials") / "elbow.npz"
    fit_potential(z, kernel=kernel, lam=1e-3, names=("along", "across"), units=(f"{scale:.6g} m",) * 2).save(path)
    return path


@pytest.fixture(scope="module")
def designed(potential_file, tmp_path_factory):
    """The folder that ``mocap design-joint`` writes, and its report."""
    from typer.testing import CliRunner

    from mocap.cli.main import app

    out = tmp_path_factory.mktemp("joint") / "elbow"
    command = ["design-joint", str(potential_file), "--out", str(out), "--starts", "1", "--seed", "1", "--json"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mocap.joint_design.design.FINE", 2500)
        patch.setattr(Figure, "savefig", lambda _, target, **_options: Path(target).write_bytes(b"drawn"))
        result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    return out, json.loads(result.stdout)
