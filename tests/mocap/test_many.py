"""Joints of many trials, by map and reduce."""

import numpy as np
import pytest
from mocap.datasets import make_bat

import mocap
from eal import fit_potential
from eal.sums import total
from mocap.errors import MocapError
from mocap.recording import of_points
from mocap.records import marker_tracks
from mocap.report.job import run_job
from mocap.results.stored import write_arrays
from mocap.skeleton import Joint, Skeleton
from mocap.tracking.many import learn_joints


def samples(name: str) -> dict[str, np.ndarray]:
    """An elbow that swings on an arc; that of the animal b bends further."""
    seed = int(name[1:])
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.2, 1.2 if name[0] == "a" else 2.2, 80)
    elbow = 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1) + 2e-4 * rng.standard_normal((80, 2))
    return {"elbow": elbow, "rare": elbow[:1]}


NAMES = ["a0", "a1", "a2", "b3"]


@pytest.fixture(scope="module")
def found():
    """Of four trials."""
    return learn_joints(NAMES, samples)


def test_all_samples_of_all_trials(found):
    """V_z of every sample, which ``fit_potential`` gives of all of them at once with that kernel."""
    assert list(found) == ["elbow"]
    joint = found["elbow"]
    every = np.concatenate([samples(name)["elbow"] for name in NAMES]) / joint.scale_m
    kernel = joint.potential().potential.kernel
    whole = fit_potential(every, kernel=kernel, lam=joint.choice.lam, method="exact")
    q = np.random.default_rng(5).normal(size=(100, 2))
    np.testing.assert_allclose(joint.potential().potential.value(q), whole.value(q), atol=1e-5)
    assert total(joint.sums.values()).total == 320


def test_trials_are_asked_for_one_after_the_other():
    """Three times each, and none is kept."""
    asked = []
    learn_joints(NAMES, lambda name: (asked.append(name), samples(name))[1])
    assert asked == NAMES * 3


def test_an_animal_that_is_left_out_is_known_less(found):
    """Those that bend as others do are known by these; the one that bends further is not."""
    by_trial = {one.trials[0]: one for one in found["elbow"].left_out()}
    assert max(by_trial[name].value for name in NAMES[:3]) < 0.1
    assert by_trial["b3"].value > 3 * by_trial["b3"].own
    animals = {name: name[0] for name in NAMES}
    by_animal = found["elbow"].left_out(animals)
    assert [one.trials for one in by_animal] == [("a0", "a1", "a2"), ("b3",)]
    assert by_animal[1].value == pytest.approx(by_trial["b3"].value)


def test_what_cannot_be_left_out(found):
    """All of it, or what is not there."""
    with pytest.raises(MocapError, match="cannot leave out b7"):
        found["elbow"].potential(without=["b7"])
    with pytest.raises(MocapError, match="two trials"):
        learn_joints(["a0"], samples)["elbow"].left_out()
    with pytest.raises(MocapError, match="no joint"):
        learn_joints(["a0"], lambda _name: {"elbow": np.zeros((3, 2))})


def test_results_on_disk(tmp_path):
    """What ``mocap track`` wrote, joint by joint, as its own samples are."""
    for seed in (0, 1):
        film = make_bat(seed=seed, n_frames=80, n_cameras=2)
        names = film.truth.names[:9]
        joint = Joint(name="neck", parent=names[0], centre=names[4], child=names[8])
        skeleton = Skeleton(name="bat", markers=names, joints=(joint,))
        tracks = marker_tracks(names, film.truth.t_s, film.truth.xyz_m[:, :9])
        run, _ = run_job(of_points(tracks, skeleton, name=f"{seed}"), model="constant_velocity", validated=False)
        (tmp_path / f"{seed}").mkdir()
        write_arrays(run, tmp_path / f"{seed}")
        (tmp_path / f"{seed}" / "report.json").write_text("{}")
        (tmp_path / f"{seed}" / "report.md").write_text("")
    found = mocap.learn_joints([tmp_path / "0", tmp_path / "1"])["neck"]
    measured = mocap.load(tmp_path / "1").joints["neck"]
    inside = measured.q_m["limb"][~measured.filled]
    assert found.sums["1"].total == len(inside)
    assert found.potential().value(inside).mean() < 0.1
    assert len(found.left_out()) == 2
    with pytest.raises(MocapError, match="have 1 names"):
        mocap.learn_joints([tmp_path / "0", tmp_path / "0"])
