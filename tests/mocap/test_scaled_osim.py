"""A generic OpenSim model scaled to the animal: factors against known lengths, and the model that OpenSim reads."""

from csv import DictReader
from types import SimpleNamespace

import numpy as np
import pytest

from mocap.errors import MocapError
from mocap.records import MarkerTracks, Status
from mocap.results.scaled_osim import FILE, TABLE, factors, write_scaled_osim

GENERIC = {"hip": (0.0, 0.0, 0.0), "knee": (0.0, -0.4, 0.0), "shank": (0.03, -0.6, 0.0), "ankle": (0.0, -0.8, 0.0)}
THIGH, SHANK = 1.2, 0.9


def markers(names=("HIP", "knee", "shank", "ankle"), *, n_frames=40):
    """A leg whose thigh is 1.2 times and whose shank is 0.9 times the generic one; it bends at the knee and turns."""
    t = np.linspace(0, 1, n_frames)
    knee = THIGH * np.array(GENERIC["knee"])
    angle = np.sin(2 * np.pi * t)
    turn = np.zeros((n_frames, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = -np.sin(angle), np.sin(angle), 1.0
    below = [SHANK * (np.array(GENERIC[m]) - GENERIC["knee"]) for m in ("shank", "ankle")]
    xyz = np.stack([np.zeros((n_frames, 3)), np.tile(knee, (n_frames, 1)), *(knee + turn @ v for v in below)], axis=1)
    status = np.full(xyz.shape[:2], Status.MEASURED, dtype=np.int8)
    status[::7, 3] = Status.SMOOTHED
    xyz[::7, 3] += 1.0  # what was not measured is not believed
    cov = np.broadcast_to(1e-6 * np.eye(3), (*xyz.shape, 3))
    return MarkerTracks(names=tuple(names), t_s=t, xyz_m=xyz, cov_m2=cov, status=status)


def test_each_body_is_scaled_by_the_distances_of_its_own_markers():
    """1.2 and 0.9; a body without two markers gets the median of the others."""
    at = {name: np.array(place) for name, place in GENERIC.items()}
    places = {"thigh": {m: at[m] for m in ("hip", "knee")}, "shank": {m: at[m] for m in ("knee", "shank", "ankle")}}
    found = factors({**places, "foot": {"toe": np.zeros(3)}}, markers(), name="leg.osim")
    assert found["thigh"].factor == pytest.approx(THIGH, rel=1e-9)
    assert found["shank"].factor == pytest.approx(SHANK, rel=1e-9)
    assert found["shank"].pairs == 3
    assert found["foot"].factor == pytest.approx((THIGH + SHANK) / 2)
    assert found["foot"].pairs == 0


def test_a_model_of_other_markers_says_which_it_has():
    places = {"thigh": {"RASI": np.zeros(3), "RKNE": np.ones(3)}}
    with pytest.raises(MocapError, match=r"RASI, RKNE; those of the recording HIP, knee.*same names"):
        factors(places, markers(), name="leg.osim")


def test_opensim_scales_bodies_joints_and_masses(tmp_path):
    """A model that OpenSim built: its knee comes to 1.2 times 0.4 m, its ankle marker to 0.9 times its own place."""
    opensim = pytest.importorskip("opensim", reason="OpenSim is not installed (pip install opensim)")
    generic = tmp_path / "leg.osim"
    _leg(opensim).printToXML(str(generic))
    before = generic.read_bytes()
    write_scaled_osim(SimpleNamespace(name="walk 1", tracked=SimpleNamespace(markers=markers())), generic, tmp_path)
    assert generic.read_bytes() == before
    model = opensim.Model(str(tmp_path / FILE))
    model.initSystem()
    knee = model.getJointSet().get("knee").getParentFrame().findTransformInBaseFrame().p()
    assert knee.get(1) == pytest.approx(-0.4 * THIGH, rel=1e-6)
    ankle = model.getMarkerSet().get("ankle").get_location()
    assert ankle.get(1) == pytest.approx(-0.4 * SHANK, rel=1e-6)
    assert model.getBodySet().get("thigh").getMass() == pytest.approx(8 * THIGH**3)
    with (tmp_path / TABLE).open(encoding="utf-8") as stream:
        rows = {row["body"]: row for row in DictReader(stream)}
    assert float(rows["thigh"]["factor"]) == pytest.approx(THIGH, rel=1e-5)
    with pytest.raises(MocapError, match="OpenSim does not read it as a model"):
        write_scaled_osim(SimpleNamespace(name="x", tracked=None), tmp_path / TABLE, tmp_path)


def _leg(opensim):
    model = opensim.Model()
    model.setName("leg")
    thigh, shank = (
        opensim.Body(name, mass, opensim.Vec3(0, -0.2, 0), opensim.Inertia(0.1))
        for name, mass in (("thigh", 8.0), ("shank", 3.0))
    )
    model.addBody(thigh)
    model.addBody(shank)
    o = opensim.Vec3(0, 0, 0)
    model.addJoint(opensim.FreeJoint("hip", model.getGround(), o, o, thigh, o, o))
    model.addJoint(opensim.PinJoint("knee", thigh, opensim.Vec3(0, -0.4, 0), o, shank, o, o))
    places = {"hip": (thigh, 0, 0), "knee": (thigh, 0, -0.4), "shank": (shank, 0.03, -0.2), "ankle": (shank, 0, -0.4)}
    for name, (body, x, y) in places.items():
        model.addMarker(opensim.Marker(name, body, opensim.Vec3(x, y, 0)))
    model.finalizeConnections()
    return model
