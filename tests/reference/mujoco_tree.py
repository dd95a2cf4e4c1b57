"""Mass matrices and inverse dynamics of an articulated body by MuJoCo, an independent program.

Needs ``pip install mujoco`` in an environment of its own; ``python tests/reference/mujoco_tree.py`` writes
``mujoco_tree.json`` beside itself. A free root carries a ball joint, a second ball joint on that, and a third beside
them; a ball can play a hinge or a universal joint, as what is stored are velocities and forces of all three freedoms.
"""

import json
from pathlib import Path

import numpy as np

PARENTS = (0, 1, 0)


def main() -> None:
    """Write the numbers."""
    import mujoco

    rng = np.random.default_rng(7)
    joints, centres = rng.normal(size=(3, 3)), rng.normal(size=(4, 3))
    masses = rng.uniform(0.5, 2.0, 4)
    inertias = []
    for mass in masses:
        points = rng.normal(size=(8, 3))
        spread = mass * np.cov(points.T, bias=True)
        inertias.append(np.trace(spread) * np.eye(3) - spread)

    def body(i: int) -> str:
        numbers = " ".join(f"{x:.17g}" for x in inertias[i][[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        at = " ".join(f"{x:.17g}" for x in (joints[i - 1] if i else np.zeros(3)))
        centre = " ".join(f"{x:.17g}" for x in centres[i])
        inner = "".join(body(j + 1) for j, parent in enumerate(PARENTS) if parent == i)
        joint = "<freejoint/>" if not i else '<joint type="ball"/>'
        inertia = f'<inertial pos="{centre}" mass="{masses[i]:.17g}" fullinertia="{numbers}"/>'
        return f'<body pos="{at}">{joint}{inertia}{inner}</body>'

    text = (
        f'<mujoco><compiler balanceinertia="false"/><option gravity="0 0 0"/><worldbody>{body(0)}</worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    cases = []
    for _ in range(4):
        quaternions = rng.normal(size=(4, 4))
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        data.qpos[:] = np.concatenate([rng.normal(size=3), quaternions.ravel()])
        data.qvel[:], data.qacc[:] = rng.normal(size=15), rng.normal(size=15)
        mujoco.mj_forward(model, data)
        mass = np.zeros((15, 15))
        mujoco.mj_fullM(model, data, mass)
        data.qacc[:] = accelerations = rng.normal(size=15)
        mujoco.mj_inverse(model, data)
        cases.append(
            {
                "quaternions_wxyz": quaternions.tolist(),
                "velocity": data.qvel.tolist(),
                "acceleration": accelerations.tolist(),
                "mass": mass.tolist(),
                "force": data.qfrc_inverse.tolist(),
            }
        )
    out = {
        "about": f"MuJoCo {mujoco.__version__}; root: velocity in the world, all turns in the body's own axes",
        "parents": PARENTS,
        "joint_m": joints.tolist(),
        "centre_m": centres.tolist(),
        "mass_kg": masses.tolist(),
        "inertia_kg_m2": [one.tolist() for one in inertias],
        "cases": cases,
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
