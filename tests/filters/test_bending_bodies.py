"""How far a body bends, and for how long, is what all trials show; the covariance grows with the time since."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets.walkers import STIFF, Shoe, walker
from mocap.filters.anatomy import Anatomy
from mocap.filters.models.base import TrialSet
from mocap.filters.models.constant_velocity import LastingSettings
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.rigid import completed, find_bodies
from mocap.filters.slips import Slip, bridged, kernel, learn_slip


def slip(**changes):
    """One that lasts 10 frames, about an offset of 1 mm."""
    known = {"offset_m": np.array([1e-3, 0, 0]), "between_m2": 1e-8 * np.eye(3), "within_m2": 4e-6 * np.eye(3)}
    return replace(Slip(**known, lasts=10.0, white_m2=1e-10, dof=np.inf), **changes)


def test_it_is_where_it_was_seen_and_forgets_that():
    """Beside what is seen it is there, to its noise; far from it at the offset, with the covariance of any frame."""
    seen = np.full((400, 3), np.nan)
    seen[:20] = 3e-3
    mean, cov = bridged(slip(), seen, np.arange(20, 400))
    assert (np.diff(cov[:, 0, 0]) > -1e-15).all()
    assert cov[0, 0, 0] < 0.02 * 4e-6
    np.testing.assert_allclose(cov[-1, 0, 0], 4e-6 + 1e-8, rtol=0.01)
    assert abs(mean[0, 0] - 3e-3) < 3e-4
    np.testing.assert_allclose(mean[-1], [1e-3, 0, 0], atol=1e-4)  # 20 frames move the offset by 1e-8 of 4e-6


def test_it_is_learned_from_what_is_drawn():
    """Of five trials that are drawn from one process the length is found to a factor of two, and z is 0.8 to 1.2."""
    rng, frames = np.random.default_rng(0), np.arange(300)
    root = np.linalg.cholesky(kernel(frames[:, None] - frames, 12.0) + 1e-8 * np.eye(300))
    squared = []
    for _ in range(8):
        series = [1e-3 * root @ rng.normal(size=(300, 3)) + 1e-4 * rng.normal(size=(300, 3)) for _ in range(5)]
        truth, gap = series[-1].copy(), np.arange(120, 180)
        series[-1] = truth.copy()
        series[-1][gap] = np.nan
        found = learn_slip(series, len(gap), np.eye(3))
        assert 6 <= found.lasts <= 24
        mean, cov = bridged(found, series[-1], gap)
        squared.append(np.mean((mean - truth[gap]) ** 2 / (cov[:, [0, 1, 2], [0, 1, 2]] + 1e-8)))
    assert 0.8 < np.sqrt(np.mean(squared)) < 1.2  # 8 gaps of 5 lengths and 3 coordinates: 0.09


def trial(seed, shoe, frames=slice(0, 300)):
    """Pelvis, left shank and left shoe of a walker."""
    tracks, _ = walker(seed, shoe=shoe)
    own = [m for m, name in enumerate(tracks.names) if name.startswith(("pelvis", "shank_l", "foot_l"))]
    xyz = tracks.xyz_m[frames][:, own]
    return MarkerTrial(name=str(seed), t_s=tracks.t_s[: len(xyz)], xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 2e-4))


@pytest.mark.rare
@pytest.mark.parametrize(("shoe", "most"), [(STIFF, 1.05), (Shoe(bend_rad=0.2), 0.75)])
def test_trials_say_how_far_a_shoe_bends(shoe, most):
    """120 frames of which 50 are hidden: three other trials make a shoe that bends a quarter nearer, a stiff one none.

    Deviations are right to 0.7 to 1.4; of a shoe that bends they are twice too small by the trial alone.
    """
    others = [trial(seed, shoe) for seed in (1, 2, 3)]
    error, z = ([], []), ([], [])
    for seed in (20, 21):
        whole = trial(seed, shoe, slice(90, 210))
        for marker in range(8, 14):
            xyz = whole.xyz_m.copy()
            xyz[40:90, marker] = np.nan
            shown = replace(whole, xyz_m=xyz)
            bodies = [body for body in find_bodies(shown) if marker in body]
            for i, more in enumerate(((), others)):
                found = completed(shown, bodies, more)
                away = found.xyz_m[40:90, marker] - whole.xyz_m[40:90, marker]
                error[i].append(away)
                z[i].append(away**2 / (np.diagonal(found.cov_m2[40:90, marker], axis1=1, axis2=2) + 4e-8))
    alone, together = (np.sqrt(np.mean(np.square(one))) for one in error)
    assert together < most * alone
    assert 0.7 < np.sqrt(np.mean(z[1])) < 1.4


@pytest.mark.rare
@pytest.mark.parametrize("shoe", [STIFF, Shoe(bend_rad=0.2)])
def test_a_body_makes_no_marker_worse(shoe):
    """Each marker of the shoe once, in 50 dark frames: not worse by more than a standard error, deviations right."""
    others, logs, squared = [trial(seed, shoe) for seed in (1, 2, 3)], [], []
    for k, marker in enumerate(range(8, 14)):
        whole = trial(20 + k, shoe, slice(90, 210))
        xyz = whole.xyz_m.copy()
        xyz[40:90, marker] = np.nan
        seen, rms = PositionObservations(xyz_m=xyz, sd_m=whole.sd_m), []
        for bodies in (None, ()):
            trials = TrialSet([*others, replace(whole, xyz_m=xyz)], Anatomy(trunk=(0, 1, 2, 3), bodies=bodies))
            found = LastingSettings().fit(trials).fill(seen)
            error = (found.xyz_m - whole.xyz_m)[40:90, marker]
            rms.append(np.sqrt(np.mean(error**2)))
            if bodies is None:
                squared.append(error**2 / (np.diagonal(found.cov_m2[40:90, marker], axis1=1, axis2=2) + 4e-8))
        logs.append(np.log(rms[0] / rms[1]))
    assert np.mean(logs) < np.std(logs, ddof=1) / np.sqrt(len(logs))
    assert 0.7 < np.sqrt(np.mean(squared)) < 1.4
