"""Smooth random curves in closed form: what makes a cycle differ from the one before."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array, frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class Wander:
    """A sum of K sinusoids, w(t) = sqrt(2 / K) sum_k sin(2 pi f_k t + p_k), of unit mean square.

    Attributes:
        frequency_hz: (K,) frequencies.
        phase_rad: (K,) phases.
    """

    frequency_hz: Array
    phase_rad: Array

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "frequency_hz", frozen("frequency_hz", self.frequency_hz, (None,)))
        object.__setattr__(self, "phase_rad", frozen("phase_rad", self.phase_rad, self.frequency_hz.shape))

    def value(self, t_s: Array) -> Array:
        """Values w at times (T,), shape (T,)."""
        return self._sum(t_s, order=0)

    def integral(self, t_s: Array) -> Array:
        """Integral of w from 0 to times (T,), in seconds, shape (T,)."""
        return self._sum(t_s, order=-1) - self._sum(np.zeros(1), order=-1)

    def acceleration(self, t_s: Array) -> Array:
        """Second derivative of w at times (T,), in 1/s^2, shape (T,)."""
        return self._sum(t_s, order=2)

    def _sum(self, t_s: Array, *, order: int) -> Array:
        omega = 2 * np.pi * self.frequency_hz
        # every derivative of a sine is that sine a quarter turn ahead, times omega
        angles = np.multiply.outer(t_s, omega) + self.phase_rad + order * np.pi / 2
        return np.sqrt(2 / len(omega)) * np.sin(angles) @ omega**order


def draw_wander(rng: np.random.Generator, *, band_hz: tuple[float, float], terms: int = 5) -> Wander:
    """A wander whose frequencies lie in ``band_hz``, one in each of ``terms`` equal parts, with uniform phases."""
    edges = np.linspace(*band_hz, terms + 1)
    return Wander(
        frequency_hz=rng.uniform(edges[:-1], edges[1:]),
        phase_rad=rng.uniform(0, 2 * np.pi, terms),
    )


def skin_motion(rng: np.random.Generator, t_s: Array, cycle_rad: Array, scale_m: Array) -> Array:
    """How far skin carries each marker from the bone beneath it: half in step with the cycle, half wandering.

    Args:
        rng: Source of the amplitudes and phases.
        t_s: (T,) times.
        cycle_rad: (T,) phase of the gait or wing beat.
        scale_m: (M,) root mean square of one coordinate of each marker.

    Returns:
        (T, M, 3) offsets in metres, in the frame of the trunk.
    """
    offsets = np.empty((len(t_s), len(scale_m), 3))
    for m in range(len(scale_m)):
        for axis in range(3):
            in_step = np.sqrt(2) * np.sin(cycle_rad + rng.uniform(0, 2 * np.pi))
            wander = draw_wander(rng, band_hz=(0.5, 6.0)).value(t_s)
            offsets[:, m, axis] = scale_m[m] * np.sqrt(0.5) * (in_step + wander)
    return offsets
