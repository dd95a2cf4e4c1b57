"""Trusses for three elbows: bat and lizard of the built-in recordings, a real bat where its recording lies.

Beside the design stand what its two halves give alone: selection from the ground structure without refinement, and
SciPy's least squares from random trusses of 12 members (as many as the design had starts, the best of them).
"""

import argparse
import os
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from eal import fit_potential, usual_kernel
from eal.joint_design import Limits, Target, Truss, design_truss, make_target, measure
from eal.joint_design.ground import candidates, fixed_nodes, sparse
from eal.joint_design.refine import refine
from mocap.reproduce.samples import built_in_samples, real_bat_samples

STARTS = 4


def elbow(samples_m: np.ndarray) -> tuple[Target, Target, Limits]:
    """The potential as mocap track learns it, on the grid of the fit and on a finer one, and the command's limits."""
    samples_m = samples_m[np.linspace(0, len(samples_m) - 1, min(len(samples_m), 500)).astype(int)]
    z = samples_m / np.sqrt(samples_m.var(axis=0).sum())
    potential = fit_potential(z, kernel=usual_kernel(z), lam=1e-3)
    mm = float(np.linalg.norm(z, axis=1).max()) / 80.0
    limits = Limits(
        shortest=20 * mm, longest=176 * mm, reach=100 * mm, spacing=14 * mm, contraction=0.65, extension=1.5
    )
    return make_target(potential.value, z), make_target(potential.value, z, points=10_000), limits


def random_truss(target: Target, limits: Limits, rng: np.random.Generator) -> Truss:
    """Twelve members of random laws from random fixed nodes, at rest somewhere in the region."""
    nodes = fixed_nodes(target, limits, rng, mirror=None, lines=12)
    node = nodes[rng.choice(len(nodes), limits.members, replace=False)]
    region = target.q[target.inside]
    rest = np.linalg.norm(region[rng.integers(len(region), size=limits.members)] - node, axis=1)
    return Truss(
        fixed_m=node,
        internal_m=np.empty((0, 2)),
        ends=np.column_stack([np.arange(limits.members), np.full(limits.members, limits.members)]),
        rest_m=rest,
        stiffness_n_m=rng.uniform(0.2, 2.0, limits.members),
        laws=tuple(rng.choice(np.array(limits.laws, dtype=object), limits.members)),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the bat only")
    quick = parser.parse_args().quick
    joints = dict(built_in_samples())
    found = real_bat_samples(Path(os.environ.get("MOCAP_REAL_DATA", "../shared/data")))
    if found is not None:
        joints["real bat"] = found
    print(f"{'':10}{'method':26}{'members':>8}{'RMS':>8}{'x ours':>8}{'IoU 0.5':>9}{'wall s':>8}{'cpu s':>8}")
    for name, samples in list(joints.items())[: 1 if quick else None]:
        target, fine, limits = elbow(samples)
        rows = []
        for method in ("design", "ground structure alone", "random starts alone"):
            rng, wall, cpu = np.random.default_rng(0), perf_counter(), process_time()
            if method == "design":
                best = design_truss(target, limits, rng=rng, starts=STARTS)[0]
                pairs = [(best.truss, best.stored)]
            elif method == "random starts alone":
                tries = [refine(target, random_truss(target, limits, rng), 0.0, limits) for _ in range(STARTS)]
                pairs = [(one.truss, one.stored) for one in tries]
            else:
                nodes = [fixed_nodes(target, limits, rng, mirror=None, lines=12) for _ in range(STARTS)]
                offered = [candidates(target, limits, some, mirror=None) for some in nodes]
                pairs = [sparse(target, some, most=limits.members, alpha=1e-3) for some in offered]
            wall, cpu = perf_counter() - wall, process_time() - cpu
            fits = [measure(truss, stored, fine) for truss, stored in pairs]
            k = int(np.argmin([fit.rms for fit in fits]))
            rows.append((method, len(pairs[k][0].rest_m), fits[k].rms, fits[k].iou[1], wall, cpu))
        for method, members, rms, iou, wall, cpu in rows:
            ratio = rms / rows[0][2]
            print(f"{name:10}{method:26}{members:8}{rms:8.3f}{ratio:8.2f}{iou:9.2f}{wall:8.1f}{cpu:8.1f}", flush=True)


if __name__ == "__main__":
    main()
