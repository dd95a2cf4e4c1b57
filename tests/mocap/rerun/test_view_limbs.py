"""Limbs in the recording are those that the filter held, and a person sees them."""

from dataclasses import replace

import numpy as np
import pytest
import rerun.blueprint as rrb
from flapping import make_run
from mocap.filters.limb_potential import limb_values
from readback import column, entities
from test_view_pictures import loaded

from mocap.rerun import palette, paths
from mocap.rerun.limbs import REACH, map_view, pull_view
from mocap.rerun.log_markers import ELLIPSOID_SD
from mocap.rerun.record import make_layout, write_recording
from mocap.results.stored import read_recording, write_arrays

N, NAME = 20, "shoulder to elbow"


@pytest.fixture(scope="module")
def run():
    """The flapper with a limb that circles its potential, wide in frame 7, and pulls along x."""
    base = make_run(n_frames=N, n_cameras=2, n_joints=0)
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 2 * np.pi, N)
    cov = np.broadcast_to(0.01 * np.eye(2), (N, 2, 2)).copy()
    cov[7] = np.diag([0.36, 0.09])
    pull = np.full((N, len(base.names), 3), np.nan)
    pull[:, 4:6] = 0.0
    pull[:, 4:6, 0] = 40.0 + np.arange(N)[:, None]
    place = np.full(len(base.names), -1)
    place[4:6] = 0, 1
    axis = np.linspace(-2, 2, 30)
    limb = {
        "x": axis,
        "y": axis,
        "value": np.clip((np.hypot(*np.meshgrid(axis, axis)) - 1) ** 2, 0, 1),
        "samples": rng.normal(0, 1, (50, 2)),
        "marker": place,
        "state": np.stack([np.cos(angle), np.sin(angle)], axis=1),
        "covariance": cov,
        "at_state": np.linspace(0, 0.5, N),
        "pull": pull,
    }
    return base.having({"limb": [NAME]}, **limb_values({NAME: limb}))


def test_state_ellipse_and_pulls_are_in_the_recording(run, tmp_path):
    """The state with its second coordinate turned round, an ellipse of 2 sd, arrows of a share of the scene."""
    write_recording(run, tmp_path / "a.rrd")
    limb = run.limbs[NAME]
    path = f"{paths.child(paths.LIMBS, NAME)}/map"
    frames, _, state = column(tmp_path / "a.rrd", f"{path}/now", "Points2D:positions")
    np.testing.assert_allclose(state, (limb["state"] * (1, -1))[frames], atol=1e-6)
    _, _, outline = column(tmp_path / "a.rrd", f"{path}/ellipse", "LineStrips2D:strips")
    outline = outline.reshape(N, -1, 2)
    reach = np.abs(outline - (limb["state"] * (1, -1))[:, None]).max(axis=1)
    np.testing.assert_allclose(reach[7], ELLIPSOID_SD * np.array([0.6, 0.3]), atol=1e-3)
    np.testing.assert_allclose(reach[3], ELLIPSOID_SD * 0.1, atol=1e-3)
    _, counts, arrows = column(tmp_path / "a.rrd", paths.child(paths.PULL, NAME), "Arrows3D:vectors")
    assert (counts <= 2).all()
    longest = np.linalg.norm(arrows, axis=1).max()
    assert longest == pytest.approx(REACH * make_layout(run).scene.radius_m, rel=0.05)
    assert (arrows[:, 1:] == 0).all()


def test_without_limbs_there_is_nothing(tmp_path):
    write_recording(make_run(n_frames=5, n_cameras=1), tmp_path / "a.rrd")
    assert not [e for e in entities(tmp_path / "a.rrd") if e.startswith((paths.LIMBS, paths.PULL))]


def test_limbs_are_restored_and_cut(run, tmp_path):
    """Written and read back to single precision of grid and pulls; a part holds its own frames."""
    write_arrays(replace(run, skeleton=replace(run.skeleton, joints=())), tmp_path)
    for name, text in (("report.json", "{}"), ("report.md", "")):
        (tmp_path / name).write_text(text)
    back, limb = read_recording(tmp_path).limbs[NAME], run.limbs[NAME]
    assert limb["marker"].tolist() == [4, 5]
    for name, values in limb.items():
        np.testing.assert_allclose(back[name], values, atol=1e-6)
    np.testing.assert_array_equal(run.at(slice(5, 9)).limbs[NAME]["state"], limb["state"][5:9])


def test_a_person_sees_the_state_its_ellipse_and_the_arrows(viewer, run, tmp_path):
    """Colours of the map view: the state vermillion, the outline white, low ground yellow; arrows in the scene."""
    layout = make_layout(loaded(viewer, run, tmp_path))
    picture = viewer.show(rrb.Blueprint(map_view(layout, NAME)), frame=7).astype(float)
    scene = viewer.show(rrb.Blueprint(pull_view(layout, NAME)), frame=7).astype(float)
    for color, least in ((palette.VERMILLION, 20), (palette.WHITE, 60), (palette.depth(np.zeros(1))[0], 500)):
        assert (np.linalg.norm(picture[..., :3] - color, axis=-1) < 60).sum() > least
    assert (np.linalg.norm(scene[..., :3] - palette.VERMILLION, axis=-1) < 60).sum() > 30
