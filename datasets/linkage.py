"""Rotations, directions and two-bone limbs, over time; smooth random curves that make cycles differ."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array, frozen


def turn(axis: int, angle_rad: Array | float) -> Array:
    """Right-handed rotations about a coordinate axis.

    Args:
        axis: 0, 1 or 2.
        angle_rad: (...) angles.

    Returns:
        (..., 3, 3) rotation matrices.
    """
    angle_rad = np.asarray(angle_rad, dtype=np.float64)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((*angle_rad.shape, 3, 3))
    rotation[..., axis, axis] = 1
    rotation[..., i, i] = rotation[..., j, j] = np.cos(angle_rad)
    rotation[..., j, i] = np.sin(angle_rad)
    rotation[..., i, j] = -rotation[..., j, i]
    return rotation


def rotated(rotation: Array, vector: Array) -> Array:
    """``rotation @ vector`` for (..., 3, 3) rotations and (..., 3) vectors, broadcast."""
    return (rotation @ np.asarray(vector)[..., None])[..., 0]


def unit(vector: Array) -> Array:
    """(..., 3) vectors of length 1 along ``vector``."""
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def hinged(before: Array, direction: Array, *, length_m: float, condyle_m: float) -> Array:
    """From the centre of a joint to the far end of the bone beyond it, where round condyles roll on each other.

    Two circles of one radius r, one on each bone, roll without slip: their line of centres halves the angle
    of the bones. The instantaneous centre is where they touch, and wanders over the condyle as the joint bends. The
    marker sits at the centre of the near circle: it is ``length_m`` from the next one in the straight joint only.

    Args:
        before: (T, 3) direction of the bone before the joint, of length 1.
        direction: (T, 3) direction of the bone beyond it; not opposite to ``before``.
        length_m: Length in the straight joint.
        condyle_m: Radius r; 0: an ideal hinge.

    Returns:
        (T, 3) metres.
    """
    return 2 * condyle_m * unit(before + direction) + (length_m - 2 * condyle_m) * direction


def bent(root_m: Array, end_m: Array, pole: Array, *, upper_m: float, lower_m: float, condyle_m: float = 0.0) -> Array:
    """Middle joint of a two-bone limb between two points.

    With c = cos(half the bend) and the lower bone W = lower - 2 r from its condyle on, the span s of U, the bisector's
    2 r and W is s^2 = 4 U W c^2 + 4 r (U + W) c + 4 r^2 + (U - W)^2; for r = 0 that is the cosine rule.

    Args:
        root_m: (T, 3) upper end: shoulder or hip.
        end_m: (T, 3) lower end: wrist or ankle.
        pole: (T, 3) or (3,) direction to which the middle joint bends.
        upper_m: Length of the upper bone, U.
        lower_m: Length of the lower bone in the straight joint.
        condyle_m: Radius r of the condyles that roll on each other, see ``hinged``; 0: an ideal hinge.

    Returns:
        (T, 3) elbow or knee, exactly ``upper_m`` from the root and, for an ideal hinge, ``lower_m`` from the end.

    Raises:
        ValueError: the ends are further apart than the limb is long, or closer than its bones can fold.
    """
    beyond_m = lower_m - 2 * condyle_m
    difference = upper_m - beyond_m
    reach = np.linalg.norm(end_m - root_m, axis=-1)
    if reach.max() >= upper_m + lower_m or reach.min() <= np.hypot(difference, 2 * condyle_m):
        raise ValueError(
            f"a limb of {1e3 * upper_m:.1f} + {1e3 * lower_m:.1f} mm cannot span {1e3 * reach.min():.1f} to "
            f"{1e3 * reach.max():.1f} mm: shorten the stride or lengthen the bones"
        )
    a, half_b = 4 * upper_m * beyond_m, 2 * condyle_m * (upper_m + beyond_m)
    c = (np.sqrt(half_b**2 + a * (reach**2 - difference**2 - 4 * condyle_m**2)) - half_b) / a
    along = (end_m - root_m) / reach[..., None]
    # the upper bone on the line to the end: U (c (bisector) + s (across)), the same of the span, multiplied
    bisector = (upper_m + beyond_m) * c + 2 * condyle_m
    forward = upper_m * (c * bisector + (1 - c**2) * difference) / reach
    aside = pole - np.sum(pole * along, axis=-1, keepdims=True) * along
    height = np.sqrt(upper_m**2 - forward**2)
    return root_m + forward[..., None] * along + height[..., None] * unit(aside)


def ramp(u: Array) -> Array:
    """Smooth step 10 u^3 - 15 u^4 + 6 u^5 from 0 to 1 with zero speed and acceleration at both ends; u clipped."""
    u = np.clip(u, 0, 1)
    return u**3 * (10 + u * (6 * u - 15))


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
