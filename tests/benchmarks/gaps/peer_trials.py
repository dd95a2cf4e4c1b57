"""Trials for the tests of peers: a still trunk and limbs whose poses follow a law."""

import numpy as np

from benchmarks.gaps.method import Trial

TRUNK = ("chest", "hip_l", "hip_r", "tail")
LIMBS = (("a", "b", "c"), ("d", "e", "f"))
NAMES = TRUNK + LIMBS[0] + LIMBS[1]
SHAPE_M = np.array([[0.2, 0.0, 0.1], [0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [-0.2, 0.0, 0.05]])


def make_trial(limbs_m, *, sd_m=1e-6, name="one"):
    """A trial of limb positions (T, 6, 3) about a trunk that stands still."""
    n_frames = len(limbs_m)
    trunk = np.repeat(SHAPE_M[None], n_frames, axis=0)
    return Trial(
        name=name,
        names=NAMES,
        t_s=np.arange(n_frames) / 100,
        xyz_m=np.concatenate([trunk, limbs_m], axis=1),
        sd_m=np.full(len(NAMES), sd_m),
        trunk=TRUNK,
        limbs=LIMBS,
    )


def in_subspace(rng, loading, *, n_frames=160):
    """Limb positions (T, 6, 3) that are linear in three mixed sines; ``loading`` (3, 18)."""
    t = np.arange(n_frames)[:, None]
    z = np.sin(t * rng.uniform(0.05, 0.3, 3) + rng.uniform(0, 6, 3)) + 0.3 * np.sin(t * rng.uniform(0.05, 0.3, 3))
    return (0.1 + z @ loading).reshape(n_frames, 6, 3)


def hidden(trial, markers, frames):
    """Positions of a trial with some markers not seen in some frames."""
    xyz = np.array(trial.xyz_m)
    xyz[frames, [[trial.names.index(m)] for m in markers]] = np.nan
    return xyz
