"""Rigid bodies: found where distances keep, and only there; what their seen markers say of hidden ones."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.filters.anatomy import Anatomy
from mocap.filters.models.base import TrialSet
from mocap.filters.models.constant_velocity import LastingSettings
from mocap.filters.observations import PixelObservations, PositionObservations, Sights
from mocap.filters.rigid import completed, distance_spread, find_bodies, wobble_deg
from scipy.spatial.transform import Rotation

from tests.filters.bodies_trials import two_bodies


@pytest.mark.parametrize("count", [(3, 4), (5, 5), (6, 8)])
@pytest.mark.parametrize(("noise_m", "slip_m"), [(1e-6, 0.0), (2e-4, 0.0), (1e-4, 3e-4)])
def test_two_bodies_are_found(count, noise_m, slip_m):
    """Both, exactly, whether their distances vary by micrometres of noise or by half a millimetre of slip.

    Between bodies they vary by some millimetres.
    """
    found = find_bodies(two_bodies(count, noise_m=noise_m, slip_m=slip_m, seed=sum(count)).trial)
    assert found == [[*range(count[0])], [*range(count[0], sum(count))]]


def test_markers_that_go_missing():
    """A quarter of all samples, in gaps of 25 frames, changes nothing; a marker that is never seen is in no body."""
    trial = two_bodies().trial
    lost = np.random.default_rng(0).random((20, 10)).repeat(25, axis=0) < 0.25
    lost[:, 9] = True
    found = find_bodies(replace(trial, xyz_m=np.where(lost[..., None], np.nan, trial.xyz_m)))
    assert found == [[0, 1, 2, 3, 4], [5, 6, 7, 8]]


def test_one_body_alone_is_judged_by_the_noise():
    """Nothing moves against it: its distances vary by the noise, which is stated. Stated ten times less, it is none."""
    trial = two_bodies((6, 3), noise_m=1e-4).trial
    alone = replace(trial, xyz_m=trial.xyz_m[:, :6], sd_m=trial.sd_m[:, :6])
    assert find_bodies(alone) == [[0, 1, 2, 3, 4, 5]]
    assert find_bodies(replace(alone, sd_m=0.1 * alone.sd_m)) == []


def test_what_bends_is_no_body():
    """Wings, membranes and fingers: no three markers of a flying bat are found, and none of points in a cloud."""
    bat = make_bat(seed=3, n_frames=300).truth
    trial = two_bodies().trial
    rng = np.random.default_rng(0)
    flying = replace(trial, t_s=bat.t_s, xyz_m=bat.xyz_m, sd_m=np.full(bat.xyz_m.shape[:2], 3e-4))
    assert find_bodies(replace(flying, xyz_m=bat.xyz_m + 3e-4 * rng.normal(size=bat.xyz_m.shape))) == []
    assert find_bodies(replace(trial, xyz_m=rng.normal(size=trial.xyz_m.shape))) == []


def test_a_body_is_broad_for_what_its_markers_move():
    """A plate beside markers that fly about: it is a body while its frame turns by 5 degrees at most."""
    rng = np.random.default_rng(2)
    plate = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]])
    others, slip = rng.normal(0, 0.5, (200, 2, 3)), rng.normal(0, 1e-3, (200, 4, 3))
    trial = replace(two_bodies().trial, t_s=np.arange(200) / 100, sd_m=np.full((200, 6), 1e-4))
    for wanted, found in ((4.3, [[0, 1, 2, 3]]), (5.7, [])):
        body = plate + slip * np.tan(np.radians(wanted)) / np.tan(np.radians(wobble_deg(plate + slip)))
        assert wobble_deg(body) == pytest.approx(wanted, rel=0.05)  # turns take up a part of what markers move
        assert find_bodies(replace(trial, xyz_m=np.concatenate([body, others], axis=1))) == found


def test_independent_samples():
    """White distances count fully; of an autoregression with rho the share (1 - rho^2) / (1 + rho^2).

    The sum over all lags of rho^(2 |k|) is (1 + rho^2) / (1 - rho^2). Both from 2000 frames, to 10 %.
    """
    rng = np.random.default_rng(0)
    n, rho = 2000, 0.9
    steps, path = rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        path[k] = rho * path[k - 1] + np.sqrt(1 - rho**2) * steps[k]
    xyz = np.zeros((n, 3, 3))
    xyz[:, 1, 0], xyz[:, 2, 1] = 1 + 1e-3 * steps, 1 + 1e-3 * path
    trial = replace(two_bodies().trial, t_s=np.arange(n) / 100, xyz_m=xyz, sd_m=np.full((n, 3), 1e-5))
    spread, samples = distance_spread(trial)
    np.testing.assert_allclose(spread[0, 1:], [1e-3, 1e-3], rtol=0.1)
    np.testing.assert_allclose(samples[0, 1:], [n, n * (1 - rho**2) / (1 + rho**2)], rtol=0.1)


def fitted(xyz, place, seen, hidden):
    """A hidden marker by the rigid fit of those that are seen (Kabsch 1976), by SciPy."""
    out = []
    for frame in xyz:
        turn = Rotation.align_vectors(frame[seen] - frame[seen].mean(axis=0), place[seen] - place[seen].mean(axis=0))[0]
        out.append(frame[seen].mean(axis=0) + turn.apply(place[hidden] - place[seen].mean(axis=0)))
    return np.array(out)


def places(simulated, xyz):
    """(5, 3) mean places of the first body's markers in its true axes."""
    away = xyz[:, :5] - simulated.joint_m[:, None]
    return np.nanmean(np.einsum("tji,tmj->tmi", simulated.rotation[:, 0], away), axis=0)


def hide_one_at_a_time(simulated, length):
    """The trial without one marker after the other of its first body, and which samples are hidden."""
    hidden = np.zeros(simulated.xyz_m.shape[:2], dtype=bool)
    for turn, start in enumerate(range(10, len(hidden) - length - 10, length + 15)):
        hidden[start : start + length, turn % 5] = True
    return replace(simulated.trial, xyz_m=np.where(hidden[..., None], np.nan, simulated.trial.xyz_m)), hidden


@pytest.mark.rare
@pytest.mark.parametrize(("noise_m", "slip_m"), [(3e-4, 0.0), (1e-4, 3e-4), (1e-6, 3e-4)])
def test_a_hidden_marker_is_where_the_others_have_it(noise_m, slip_m):
    """Errors at most 5 % above a plain rigid fit's, and rms 0.7 to 1.2 of what is stated.

    The 40 gaps are of 25 frames each, in which slip, which lasts for 15, is about one independent sample. Slip that is
    smoother than the kernel is bridged with fewer errors than stated.
    """
    squares, fits, scaled = [], [], []
    for seed in range(5):
        simulated = two_bodies(noise_m=noise_m, slip_m=slip_m, seed=seed)
        trial, hidden = hide_one_at_a_time(simulated, 25)
        found = completed(trial, [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]])
        np.testing.assert_array_equal(found.filled, hidden)
        error = (found.xyz_m - simulated.xyz_m)[hidden]
        squares.append(np.mean(error**2))
        scaled.append(np.mean(error**2 / np.diagonal(found.cov_m2[hidden], axis1=1, axis2=2)))
        place = places(simulated, trial.xyz_m)
        for marker in range(5):
            frames = hidden[:, marker]
            seen = np.arange(5) != marker
            away = fitted(trial.xyz_m[frames][:, :5], place, seen, marker) - simulated.xyz_m[frames, marker]
            fits.append((away**2).mean(axis=1))
    assert np.sqrt(np.mean(squares)) <= 1.05 * np.sqrt(np.mean(np.concatenate(fits)))
    assert 0.7 < np.sqrt(np.mean(scaled)) < 1.2


def test_slip_that_markers_share_is_used():
    """Where a marker slips twice as far as its neighbour, along with it, that tells: half the rigid fit's error."""
    simulated = two_bodies(noise_m=2e-5, seed=3)
    along = 2e-3 * np.sin(np.arange(500) / 7)[:, None] * simulated.rotation[:, 0, :, 2]
    xyz = simulated.trial.xyz_m.copy()
    xyz[:, 0] += along
    xyz[:, 1] += 0.5 * along
    trial, hidden = hide_one_at_a_time(replace_truth(simulated, xyz), 25)
    found = completed(trial, [[0, 1, 2, 3, 4]])
    place = places(simulated, xyz)
    frames = hidden[:, 0]
    rigid = fitted(xyz[frames][:, :5], place, np.arange(5) != 0, 0) - xyz[frames, 0]
    ours = found.xyz_m[frames, 0] - xyz[frames, 0]
    assert np.mean(ours**2) < 0.25 * np.mean(rigid**2)


def replace_truth(simulated, xyz):
    """The simulated bodies with other measurements, which are the truth as well."""
    return replace(simulated, trial=replace(simulated.trial, xyz_m=xyz), xyz_m=xyz)


def test_what_a_body_does_not_say():
    """Two seen markers leave a turn about their line, three in a line nearly so: nothing is said there."""
    simulated = two_bodies(seed=1)
    xyz = simulated.trial.xyz_m.copy()
    xyz[50:80, [0, 1, 2]] = np.nan
    trial = replace(simulated.trial, xyz_m=xyz)
    assert not completed(trial, [[0, 1, 2, 3, 4]]).filled.any()
    straight = simulated.trial.xyz_m.copy()
    straight[:, 2] = 0.3 * straight[:, 0] + 0.7 * straight[:, 1]
    straight[50:80, [3, 4]] = np.nan
    straight[100:130, 3] = np.nan
    found = completed(replace(simulated.trial, xyz_m=straight), [[0, 1, 2, 3, 4]]).filled
    assert not found[50:80].any()
    assert found[100:130, 3].all()


@pytest.mark.parametrize("rays", [0, 1])
def test_the_filter_uses_bodies(rays):
    """In a gap of 60 frames, dark or with one ray, at most 5 % above the rigid fit; without it several times that.

    Stated deviations are right to within 0.7 to 1.2. Markers by themselves know nothing else of each other.
    """
    simulated = two_bodies(noise_m=2e-4, slip_m=1e-4, n_frames=300, seed=2)
    trial, hidden = hide_one_at_a_time(simulated, 60)
    seen = PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m)
    if rays:
        matrix = np.array([[1000.0, 0, 0, 0], [0, 1000, 0, 0], [0, 0, 1, 1]])  # a metre away: 0.2 px are 0.2 mm
        pixels = simulated.xyz_m[None] @ matrix[:, :3].T + matrix[:, 3]
        pixels = pixels[..., :2] / pixels[..., 2:] + np.random.default_rng(0).normal(size=(1, *hidden.shape, 2)) * 0.2
        seen = Both(
            seen,
            PixelObservations(
                matrices=matrix[None],
                uv_px=np.where(hidden[None, ..., None], pixels, np.nan),
                sd_px=np.full((1, *hidden.shape), 0.2),
                xyz_m=np.full_like(trial.xyz_m, np.nan),
                cov_m2=np.full((*trial.xyz_m.shape, 3), np.nan),
                wide_m=0.1,
            ),
        )
    bodies, none = (TrialSet([trial], Anatomy(trunk=(0, 1, 2, 3, 4), bodies=one)) for one in (None, ()))
    assert bodies.anatomy.bodies == ((0, 1, 2, 3, 4), (5, 6, 7, 8, 9))
    rms, stated = [], []
    for trials in (bodies, none):
        found = LastingSettings().fit(trials).fill(seen)
        error = (found.xyz_m - simulated.xyz_m)[hidden]
        rms.append(np.sqrt(np.mean(error**2)))
        stated.append(np.sqrt(np.mean(error**2 / np.diagonal(found.cov_m2[hidden], axis1=1, axis2=2))))
    fit = completed(trial, [[0, 1, 2, 3, 4]]).xyz_m[hidden] - simulated.xyz_m[hidden]
    assert rms[0] <= 1.05 * np.sqrt(np.mean(fit**2))
    assert rms[1] > 3 * rms[0]
    assert 0.7 < stated[0] < 1.2


class Both:
    """Two sources of sights."""

    def __init__(self, *parts):
        """Of as many frames each."""
        self.parts = parts
        self.n_frames = parts[0].n_frames
        self.shown = np.any([part.shown for part in parts], axis=0)

    def sights(self, frame, mean, cov):
        """Of both."""
        found = [vars(part.sights(frame, mean, cov)) for part in self.parts]
        return Sights(**{name: np.concatenate([one[name] for one in found]) for name in found[0]})
