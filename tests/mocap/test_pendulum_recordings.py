"""Filmed pendulums: their joint coordinates are the true ones, and verdicts on their tracks can fail."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets.pendulums import make_pendulum_film

from eal import GaussianKernel, fit_potential
from eal.lagrangian import PenalisedModel
from eal.systems import planar_pendulum, spherical_pendulum
from mocap.reproduce import fig_recordings, recordings
from mocap.reproduce.joint_filter import JointTrack
from mocap.reproduce.recordings import Seen, TrackedJoint


@pytest.mark.parametrize(("kind", "d"), [("planar", 2), ("spherical", 3)])
def test_markers_of_a_film_become_the_joint_coordinates(kind, d):
    """Converted (r, theta) or x of 120 frames: each within 6 of its own robust deviations of the truth, 5 mm at most.

    Pixels of the truth, by the sights that a filter gets, are the clicks to 1.2 px (what the digitiser errs by).
    """
    seen = recordings._stand(make_pendulum_film(kind, n_frames=120), polar=kind == "planar")
    known = np.isfinite(seen.q).all(axis=1)
    off = seen.q[known] - seen.truth[known]
    assert seen.q.shape == (120, d)
    assert known.mean() > 0.3
    assert np.median(np.abs(off)) < 0.005
    assert (np.abs(np.median(off, axis=0)) < 0.003).all()
    away = [seen.sights.pixels(i, seen.truth[i : i + 1]).reshape(4, 2) - seen.sights.uv_px[:, i, 0] for i in range(120)]
    assert np.nanmedian(np.abs(away)) < 1.2


def tracked(*, shift=0.0, sd=0.001, strength=1e4):
    """A track of the planar pendulum that is off by some of its radius."""
    t = np.arange(80) / 100.0
    truth = np.stack([np.ones(80), np.pi / 18 - 4.9 * t**2], axis=1)
    rng = np.random.default_rng(0)
    q = truth + rng.normal(0, 0.001, truth.shape) + [shift, 0.0]
    potential = fit_potential(truth, kernel=GaussianKernel(3.0), lam=1e-4)
    model = PenalisedModel(system=planar_pendulum(), penalty=potential, strength=strength)
    v = np.gradient(truth, t, axis=0)
    v[0] = 0.0
    track = JointTrack(
        t_s=t,
        q=q,
        v=v,
        cov=np.broadcast_to(np.diag([sd**2] * 2 + [0.01] * 2), (80, 4, 4)),
        measured=np.ones(80, dtype=bool),
        log_likelihood=0.0,
        energy_j=model.energy(q, v),
        value=potential.value(q),
    )
    bound = recordings.theorem_3(model, q[0], v[0], potential_min_j=-10.3)
    converted = truth + rng.normal(0, 0.004, truth.shape)
    seen = Seen(sights=None, q=converted, truth=truth)
    return TrackedJoint(name="planar", model=model, seen=seen, track=track, bound=bound, lowest_j=-10.3)


def holds(monkeypatch, found):
    monkeypatch.setattr(fig_recordings, "_released", lambda *_: [])
    return [v.holds for v in fig_recordings._figure("13_recorded", found, "planar").verdicts]


def test_verdicts_fail_where_they_should(monkeypatch):
    """A good track holds all three: intervals, comparison, bound.

    Deviations of 1 mm fail for errors of 10 mm, and so do ones that are too narrow; a V_z up to 1 fails the bound.
    """
    assert holds(monkeypatch, tracked()) == [True, True, True]
    assert holds(monkeypatch, tracked(shift=0.01)) == [False, False, True]
    assert holds(monkeypatch, tracked(sd=2e-4))[0] is False
    assert holds(monkeypatch, tracked(strength=5.0))[2] is False


def test_the_bound_is_drawn_round_the_planar_track():
    """Radii at which V_z is the bound lie on both sides of the track, and V_z there is near it."""
    found = tracked()
    edges = fig_recordings.bound_edges(found)
    assert (edges[:, 0] < found.track.q[:, 0]).all()
    assert (edges[:, 1] > found.track.q[:, 0]).all()
    other = replace(found, name="spherical", model=replace(found.model, system=spherical_pendulum()))
    assert not len(fig_recordings.bound_edges(other))
