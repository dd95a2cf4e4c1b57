"""Joint forces and moments against truth: filmed pendulums, limbs of the lizard while they swing, and MuJoCo.

    python -m benchmarks.moments [--seeds 2]

Pendulums are filmed and clicked, and tracked as users do (``run_job``); the pivot is free, so that its moment is 0, and
the force on the mass is the Lagrange multiplier of the rod. The lizard's limbs get a mass of 0.1 g a segment; the truth
is the same formula with true motion, so that this is about velocities and accelerations, not about masses. MuJoCo,
where it is installed, has its own inverse dynamics of two links that turn about crossed axes.
"""

import argparse
import importlib
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mocap.datasets.folder import write_recording
from mocap.datasets.lizards import lizard_motion, make_lizard
from mocap.datasets.pendulum_film import STAND_M, make_pendulum_film, pendulum_skeleton
from mocap.datasets.pendulums import GRAVITY_M_S2, Pendulum, pendulum_motion
from mocap.filters.velocities import Motion

from benchmarks.kinematics import EDGE, tracked, true_motion
from eal.arrays import Z95, Array
from mocap.kinematics.cycles import footfalls
from mocap.kinematics.moments import ROD, moments
from mocap.kinematics.records import Kinematics, Rests
from mocap.measures import Measures, Segment
from mocap.pipeline.job import run_job
from mocap.pipeline.reading import read
from mocap.skeleton import Bone, Joint, Skeleton


def row(name: str, found: Kinematics, exact: Mapping[str, Array], ending: str) -> str:
    """Error and coverage, measured and filled apart, of all quantities with such an end."""
    cells = []
    for rests in (Rests.MEASURED, Rests.FILLED):
        errors, inside = [], []
        for one in found.quantities:
            if not one.name.endswith(ending):
                continue
            where = (one.rests == rests) & np.isfinite(one.value) & np.isfinite(exact[one.name])
            where[:EDGE], where[-EDGE:] = False, False
            errors.append((one.value - exact[one.name])[where])
            inside.append(np.abs(errors[-1]) < Z95 * one.sd[where])
        error = np.concatenate(errors)
        share = f"{100 * np.concatenate(inside).mean():5.1f} %" if len(error) else "     - "
        size = f"{np.sqrt(np.mean(error**2)):9.3g}" if len(error) else "        -"
        cells.append(f"{size} {share} of {len(error):5d}")
    return f"  {name:34} {cells[0]}   {cells[1]}"


def pendulum(kind: Pendulum, seed: int) -> None:
    """A filmed pendulum: force and moment of its pivot."""
    recording = make_pendulum_film(kind, seed=seed)
    with TemporaryDirectory() as folder:
        files = write_recording(recording, Path(folder))
        source = read(
            files["pixels"],
            fps=recording.fps,
            calibration=files["coefficients"],
            profile=files["profile"],
            skeleton=files["skeleton"],
        )
        run, _ = run_job(source, model="mixture", validated=False)
    found = moments(run.motion, pendulum_skeleton())
    t_s, bob = recording.truth.t_s, recording.truth.xyz_m[:, len(STAND_M)]
    q, v = pendulum_motion(kind, t_s)[:2]
    speed = q[:, 0] * v[:, 1] if kind == "planar" else np.linalg.norm(v, axis=1)
    pull = (GRAVITY_M_S2 * bob[:, 2] - speed**2)[:, None] * bob
    exact = {f"pivot_force_{axis}_n": pull[:, k] for k, axis in enumerate("xyz")}
    exact |= {q.name: np.zeros(len(t_s)) for q in found.quantities if "moment" in q.name}
    print(row(f"{kind} pendulum, force N (10 N)", found, exact, "_n"))
    print(row(f"{kind} pendulum, moment N m", found, exact, "_n_m"), flush=True)


def lizard(seed: int, *, n_frames: int = 300, noise_m: float = 2e-4) -> None:
    """Limbs while they swing."""
    recording = make_lizard(seed=seed, n_frames=n_frames)
    parts = {
        f"{a}_{side}": Segment(start=f"{a}_{side}", end=f"{b}_{side}", mass_g=0.1)
        for side in "lr"
        for chain in (("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot"))
        for a, b in pairwise(chain)
    }
    skeleton = replace(recording.skeleton, measures=replace(recording.skeleton.measures, segments=parts))
    seen = recording.pixels.seen.sum(axis=0) >= 2
    true = recording.truth.xyz_m
    noisy = true + noise_m * np.random.default_rng(seed).normal(size=true.shape)
    _, motion = tracked(np.where(seen[..., None], noisy, np.nan), recording.truth.t_s, skeleton, noise_m)
    steps = footfalls(motion, skeleton)
    found = moments(motion, skeleton, steps=steps)
    exact = moments(true_motion(lizard_motion(seed), motion, skeleton), skeleton, steps=steps)
    values = {q.name: q.value for q in exact.quantities}
    size = np.sqrt(np.nanmean([q.value**2 for q in exact.quantities if q.name.endswith("flexion_moment_n_m")]))
    print(row(f"lizard, flexion N m (rms {size:.2g})", found, values, "flexion_moment_n_m"), flush=True)


CHAIN = """
<mujoco><option gravity="0 0 -9.81"/><worldbody><site name="a" pos="0 0 0.2"/>
<body name="one"><joint name="b" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 -0.15" mass="0.02" diaginertia="{i1:.12g} {i1:.12g} 1e-12"/><site name="b" pos="0 0 0"/>
<body name="two" pos="0 0 -0.3"><joint name="c" type="hinge" axis="1 0 0"/>
<inertial pos="0 0 -0.1" mass="0.01" diaginertia="{i2:.12g} {i2:.12g} 1e-12"/><site name="c" pos="0 0 0"/>
<site name="d" pos="0 0 -0.2"/></body></body></worldbody></mujoco>
"""


def mujoco_chain() -> str:
    """Largest difference to MuJoCo's inverse dynamics over the largest moment, in two joints."""
    try:
        mujoco = importlib.import_module("mujoco")
    except ImportError:
        return "  MuJoCo is not installed: pip install mujoco"
    i1, i2 = ROD * 0.02 * 0.3**2, ROD * 0.01 * 0.2**2
    model = mujoco.MjModel.from_xml_string(CHAIN.format(i1=i1, i2=i2))
    data = mujoco.MjData(model)
    t, rates = 1e-3 * np.arange(500), np.array([8.0, 13.0])
    x, v, axes, torques = [], [], [], []
    for now in t:
        data.qpos[:], data.qvel[:] = 0.7 * np.sin(rates * now), 0.7 * rates * np.cos(rates * now)
        data.qacc[:] = -0.7 * rates**2 * np.sin(rates * now)
        mujoco.mj_inverse(model, data)
        x.append(data.site_xpos.copy())
        speed = np.zeros((4, 3))
        for k in range(4):
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jacSite(model, data, jacobian, None, k)
            speed[k] = jacobian @ data.qvel
        v.append(speed)
        axes.append(data.xaxis.copy())
        torques.append(data.qfrc_inverse.copy())
    names = ("a", "b", "c", "d")
    parts = {"one": Segment(start="b", end="c", mass_g=20), "two": Segment(start="c", end="d", mass_g=10)}
    skeleton = Skeleton(
        name="chain",
        markers=names,
        bones=tuple(Bone(a=p, b=q) for p, q in pairwise(names)),
        joints=(Joint(name="b", parent="a", centre="b", child="c"), Joint(name="c", parent="b", centre="c", child="d")),
        trunk=names[:2],
        measures=Measures(segments=parts),
    )
    shape = (len(t), 4, 6, 6)
    motion = Motion(
        names=names,
        t_s=t,
        xyz_m=np.array(x),
        velocity_m_s=np.array(v),
        own=np.zeros(shape, dtype=np.float32),
        pairs=np.empty((0, 2), dtype=np.int64),
        cross=np.empty((len(t), 0, 6, 6), dtype=np.float32),
        kept=np.ones((*shape[:2], 3)),
        measured=np.ones(shape[:2], dtype=bool),
    )
    found, worst = moments(motion, skeleton), []
    for k, joint in enumerate("bc"):
        moment = np.stack([found[f"{joint}_moment_{axis}_n_m"].value for axis in "xyz"], axis=1)
        about = np.sum(moment * np.array(axes)[:, k], axis=1)
        expected = np.array(torques)[:, k]
        worst.append(np.abs(about - expected)[2:-2].max() / np.abs(expected).max())
    return f"  MuJoCo {mujoco.__version__}, two links: largest difference {worst[0]:.1e}, {worst[1]:.1e} of the moment"


def main() -> None:
    """All of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    print(mujoco_chain())
    print(f"  {'':34} {'measured: error, inside 95 %':>27}   {'filled':>27}")
    for seed in range(given.seeds):
        for kind in ("planar", "spherical"):
            pendulum(kind, seed)
        lizard(seed)


if __name__ == "__main__":
    main()
