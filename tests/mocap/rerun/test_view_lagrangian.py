"""Energy and Theorem 3's bound of a tracked Lagrangian are in the recording, and a person sees the bound above V_z."""

from dataclasses import replace

import numpy as np
import pytest
import rerun.blueprint as rrb
from flapping import make_run
from readback import column, entities
from test_view_pictures import loaded

from mocap.rerun import palette, paths
from mocap.rerun.record import make_layout, write_recording
from mocap.rerun.tabs import lagrangian

N = 20


@pytest.fixture(scope="module")
def run():
    """The flapper with energies of a Lagrangian: V_z falls from 0.2 to 0.1, its bound is 0.8."""
    base = make_run(n_frames=N, n_cameras=2, n_joints=0)
    energies = np.column_stack([np.linspace(2, 3, N), np.linspace(0.2, 0.1, N), np.full(N, 0.8)])
    angles = {"angle_rad": np.zeros((N, 1)), "angle_sd_rad": np.full((N, 1), 0.1), "energies": energies}
    lengths = {"segment_length": np.array([0.1]), "segment_length_sd": np.array([0.001])}
    names = {"angle": ["elbow_tip_bend"], "segment": ["elbow to tip"]}
    return base.having(names, **angles, **lengths)


def test_energy_value_and_bound_are_in_the_recording(run, tmp_path):
    """Each number of each frame; nothing of it where angles have learned mechanics."""
    write_recording(run, tmp_path / "a.rrd")
    for path, which in ((paths.ENERGY, 0), (f"{paths.VALLEY}/value", 1), (f"{paths.VALLEY}/bound", 2)):
        frames, _, found = column(tmp_path / "a.rrd", path, "Scalars:scalars")
        np.testing.assert_allclose(np.ravel(found), run.angles["energies"].values[frames, which])
    learned = replace(run, data=run.data.drop_vars("energies"))
    write_recording(learned, tmp_path / "b.rrd")
    assert not [name for name in entities(tmp_path / "b.rrd") if "lagrangian" in name]
    assert lagrangian.tab(make_layout(learned)) is None


def test_a_person_sees_the_bound_above_the_value(viewer, run, tmp_path):
    """The grey line lies above the blue one in the picture."""
    view = lagrangian.valley_view(make_layout(loaded(viewer, run, tmp_path)))
    picture = viewer.show(rrb.Blueprint(view), frame=7).astype(float)
    grey, blue = (np.abs(picture[..., :3] - color).max(axis=-1) < 40 for color in (palette.GREY, palette.SKY_BLUE))
    line = grey.sum(axis=1)
    assert line.max() > 0.5 * picture.shape[1]  # the bound is level
    assert blue.sum() > 0.3 * picture.shape[1]
    assert np.argmax(line) < np.median(np.nonzero(blue)[0])
