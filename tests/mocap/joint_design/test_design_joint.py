"""``mocap design-joint``: what it writes holds together, and what it refuses it explains."""

import json
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from eal import fit_potential, load_potential, usual_kernel
from eal.joint_design import Limits, Truss, design_truss, equilibria, make_target, measure
from mocap.cli.main import app
from mocap.errors import MocapError
from mocap.io.manifest import MANIFEST
from mocap.joint_design.source import read_source
from mocap.reproduce.samples import real_bat_samples
from tests.real_data import real


def test_a_joint_is_designed_as_asked(designed):
    """At most 12 members, RMS at most 0.1 in the region, overlap of 0.8 at the half level, energy kept in motion."""
    _, report = designed
    assert report["fit"]["rms"] <= 0.1
    assert report["fit"]["iou"]["0.5"] >= 0.8
    assert len(report["truss_as_printed"]["members"]) <= 12
    assert report["release"]["truss"]["inside"] > 0.99
    assert report["release"]["truss"]["energy_drift"] < 1e-3
    assert report["parts"]["walls_hold"]


def test_the_truss_of_the_report_has_the_energy_that_it_states(designed, potential_file):
    """Rebuilt from report.json alone in metres and newtons: U / U(V = 1) is V within the stated RMS."""
    _, report = designed
    stored, energy = report["truss_as_printed"], report["energy_at_v_1_j"]
    members = stored["members"]
    truss = Truss(
        fixed_m=np.array(stored["fixed_m"]),
        internal_m=np.empty((0, 2)),
        ends=np.array([member["ends"] for member in members]),
        rest_m=np.array([member["rest_m"] for member in members]),
        stiffness_n_m=np.array([member["stiffness_n_m"] for member in members]),
        laws=tuple(member["law"] for member in members),
    )
    potential = load_potential(potential_file)
    z = np.random.default_rng(0).uniform(-1, 1, (4000, 2)) * 1.2 * np.abs(potential.samples).max(axis=0)
    z = z[potential.value(z) < report["level"]]
    metres = report["printed_over_animal"] * float(potential.units[0].removesuffix(" m"))
    u = equilibria(truss, z * metres).energy_j / energy - report["fit"]["stored_over_unit"]
    rms = np.sqrt(np.mean((u - potential.value(z)) ** 2))
    # some hundred random points instead of the grid: 20 %
    assert rms == pytest.approx(report["fit"]["rms"], rel=0.2)


def test_parts_come_back_watertight_with_their_volume(designed):
    """Every STL is read by trimesh as one closed body of the stated volume; edges under 2 um are taken out: 1e-3."""
    folder, report = designed
    files = sorted((folder / "parts").glob("*.stl"))
    assert {file.stem for file in files} == set(report["parts"]["volumes_mm3"])
    for file in files:
        mesh = trimesh.load_mesh(file)
        assert mesh.is_watertight, file.name
        assert mesh.is_winding_consistent
        assert mesh.body_count == 1
        assert mesh.volume == pytest.approx(report["parts"]["volumes_mm3"][file.stem], rel=1e-3)
        assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-5)
    assert report["parts"]["mass_g"] == pytest.approx(sum(report["parts"]["volumes_mm3"].values()) * 0.93e-3, rel=1e-6)


def test_the_assembly_holds_all_parts_in_place(designed):
    """The 3MF: the same parts, closed, and no two members at one height."""
    folder, report = designed
    scene = trimesh.load(folder / "assembly.3mf")
    assert set(scene.geometry) == set(report["parts"]["volumes_mm3"])
    assert all(mesh.is_watertight for mesh in scene.geometry.values())
    heights = sorted(tuple(mesh.bounds[:, 2]) for name, mesh in scene.geometry.items() if name.startswith("member_"))
    assert all(low[1] < high[0] for low, high in pairwise(heights))


@pytest.mark.main
def test_everything_is_written(designed):
    folder, _ = designed
    names = {path.name for path in folder.iterdir()}
    pictures = {"drawing.png", "drawing.svg", "potential_and_energy.png", "motion.png"}
    assert names == pictures | {"report.json", "report.md", "recording.rrd", "parts", "assembly.3mf", MANIFEST}
    assert json.loads((folder / "report.json").read_text())["joint"] == "elbow"


def test_what_exists_is_kept(designed, potential_file):
    folder, _ = designed
    result = CliRunner().invoke(app, ["design-joint", str(potential_file), "--out", str(folder)])
    assert isinstance(result.exception, MocapError)
    assert "`overwrite`" in str(result.exception)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--longest-mm", "30"], "'longest'"),
        (["--laws", "rope"], "linear, neo_hookean"),
        (["--shortest-mm", "-1"], "shortest"),
        (["--level", "1.5"], "level must be between"),
    ],
)
def test_requests_that_cannot_be_met_are_explained(potential_file, tmp_path, options, says):
    """One sentence that names the limit; nothing is written."""
    out = tmp_path / "out"
    result = CliRunner().invoke(
        app, ["design-joint", str(potential_file), "--out", str(out), "--starts", "1", *options]
    )
    assert isinstance(result.exception, MocapError)
    assert says in str(result.exception)
    assert not out.exists()


def test_sources_that_hold_no_joint_are_explained(tmp_path, potential_file):
    with pytest.raises(MocapError, match="no such file"):
        read_source(tmp_path / "none.npz", None, None)
    (tmp_path / "potentials").mkdir()
    (tmp_path / "potentials" / "elbow.npz").write_bytes(potential_file.read_bytes())
    with pytest.raises(MocapError, match="one of elbow, not knee"):
        read_source(tmp_path, "knee", None)
    (tmp_path / "text.npz").write_text("nothing")
    with pytest.raises(MocapError, match=r"not a potential or model"):
        read_source(tmp_path / "text.npz", None, None)


def test_a_truss_for_a_real_elbow():
    """A Carollia's left elbow, 97 samples: RMS at most 0.1, overlap of 0.8 at the half level, 12 members at most."""
    samples = real_bat_samples(real("bat_windtunnel_dltdv8").parent)
    z = samples / np.sqrt(samples.var(axis=0).sum())
    potential = fit_potential(z, kernel=usual_kernel(z), lam=1e-3)
    unit = np.linalg.norm(z, axis=1).max() / 0.08  # of the metre, where it is printed as large as the command has it
    lengths = {"shortest": 0.02, "longest": 0.176, "reach": 0.1, "spacing": 0.014}
    limits = Limits(contraction=0.65, extension=1.5, **{name: unit * metres for name, metres in lengths.items()})
    design = design_truss(make_target(potential.value, z), limits, rng=np.random.default_rng(1), starts=1)[0]
    fit = measure(design.truss, design.stored, make_target(potential.value, z, points=4000))
    assert fit.rms <= 0.1
    assert fit.iou[1] >= 0.8
    assert len(design.truss.rest_m) <= 12
