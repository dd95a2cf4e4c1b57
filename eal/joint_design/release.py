"""A mass on the truss, released where the joint was: does it stay where the joint goes? Beside the EAL model."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from eal.arrays import Array
from eal.integrators import simulate
from eal.joint_design.equilibrium import Equilibria, equilibria
from eal.joint_design.laws import Indices
from eal.joint_design.truss import Truss, truss_energy
from eal.lagrangian import AnalyticPenalty, PenalisedModel, Penalty
from eal.optional_jax import jax, jnp
from eal.systems import free_joint


def truss_penalty(truss: Truss, stored: float, found: Equilibria) -> AnalyticPenalty:
    """The energy of a truss as a penalty of ``eal.lagrangian``: a single-valued U(q) on the branch of a map.

    Args:
        truss: The truss.
        stored: Subtracted from its energy.
        found: The truss over a grid (``over_grid``); internal nodes start from the nearest point's, and the largest
            eigenvalue of its stiffness there limits the step.
    """
    nearest = KDTree(found.q_m)
    with jax.enable_x64(True):
        p = {name: jnp.asarray(value) for name, value in truss.parameters().items()}
        at = jax.jit(jax.vmap(lambda q, x: jax.value_and_grad(truss_energy)(q, x, p)))

    def both(q: Array) -> tuple[Array, Array]:
        flat = q.reshape(-1, q.shape[-1])
        start = found.x_m[nearest.query(flat)[1]] if truss.internal_m.size else np.empty((len(flat), 0, q.shape[-1]))
        x = equilibria(truss, flat, start).x_m if truss.internal_m.size else start
        with jax.enable_x64(True):
            energy, slope = at(flat, x)
        return np.asarray(energy).reshape(q.shape[:-1]) - stored, np.asarray(slope).reshape(q.shape)

    return AnalyticPenalty(
        value=lambda q: both(q)[0],
        gradient=lambda q: both(q)[1],
        curvature_limit=float(np.linalg.eigvalsh(found.stiffness_n_m)[:, -1].max()),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Release:
    """Masses released from sampled states.

    Attributes:
        q: (T, n, d) their ways.
        t: (T,) times; the unit is the time in which a mass with the kinetic energy V = 1/2 covers one length.
        inside: Share of time with V below the region's level.
        inside_half: Share of time with V < 1/2.
        drift: Largest departure of the energy from its start, V = 1 being the unit.
    """

    q: Array
    t: Array
    inside: float
    inside_half: float
    drift: float


def release(
    penalty: Penalty,
    potential: Penalty,
    starts: Array,
    velocities: Array,
    *,
    level: float,
    duration: float,
    step: float,
) -> Release:
    """Unit masses in a penalty of strength 1, without damping.

    Args:
        penalty: What holds them: the truss, or V_z itself for the EAL model (equation 7 with 1/eps^2 = 1).
        potential: V, which says where they are.
        starts: (n, d) sampled positions.
        velocities: (n, d) velocities there.
        level: Edge of the region.
        duration: Time.
        step: Step of RK4.
    """
    model = PenalisedModel(system=free_joint(starts.shape[1]), penalty=penalty, strength=1.0)
    run = simulate(model, starts, velocities, duration_s=duration, h_s=step, every=2)
    v = potential.value(run.q)
    energy = model.energy(run.q, run.v)
    return Release(
        q=run.q,
        t=run.t_s,
        inside=float(np.mean(v < level)),
        inside_half=float(np.mean(v < 0.5)),
        drift=float(np.abs(energy - energy[0]).max()),
    )


def recorded_velocities(samples: Array, starts: Indices, *, energy: float) -> Array:
    """(n, d) velocities at some samples, as the sequence of all has them, the fastest with a kinetic energy.

    Args:
        samples: (N, d) positions in the order of time.
        starts: (n,) indices of the starts.
        energy: Kinetic energy of the fastest of these, unit mass.
    """
    way = np.gradient(samples, axis=0)[starts]
    fastest = float(np.linalg.norm(way, axis=1).max())
    return way * (np.sqrt(2.0 * energy) / max(fastest, 1e-300))
