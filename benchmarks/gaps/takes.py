"""From recordings to the trials of a set: what is believed of them, and how noisy it is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.gaps.method import Film, Trial
from eal.arrays import Array
from mocap.cleaning.positions import clean, position_sd
from mocap.skeleton import Skeleton

LEAST_SD_M = 1e-5


@dataclass(frozen=True, eq=False)
class Take:
    """One recording of a set.

    Attributes:
        name: Of the trial.
        t_s: (T,) times.
        xyz_m: (T, M, 3) positions that are believed; NaN else.
        film: The pixels that they follow from, if there are any.
        animal: Which it is, where the set has several.
        gait: How it moves, where the set has several gaits.
    """

    name: str
    t_s: Array
    xyz_m: Array
    film: Film | None = None
    animal: str = ""
    gait: str = ""

    def only(self, names: Sequence[str], wanted: Sequence[str]) -> "Take":
        """Some of its markers ``names``."""
        index = [names.index(name) for name in wanted]
        own = self.film
        if own is not None:
            own = replace(own, pixels=replace(own.pixels, names=tuple(wanted), uv_px=own.pixels.uv_px[:, :, index]))
        return replace(self, xyz_m=self.xyz_m[:, index], film=own)


def trials_of(
    takes: Sequence[Take],
    names: Sequence[str],
    *,
    trunk: Sequence[str],
    limbs: Sequence[Sequence[str]],
    bones: Sequence[tuple[str, str]] = (),
) -> list[Trial]:
    """Trials of one set, each from the first to the last frame in which anything was seen.

    Args:
        takes: The recordings.
        names: The M markers.
        trunk: Of them, those of the body.
        limbs: Of them, those of each limb.
        bones: Ends of the bones that a user would state.
    """
    cut = []
    for take in takes:
        frames = np.flatnonzero(np.isfinite(take.xyz_m[..., 0]).any(axis=1))
        inside = slice(int(frames[0]), int(frames[-1]) + 1)
        own = None if take.film is None else take.film.cut(inside)
        t_s = take.t_s[inside] - take.t_s[inside.start]
        cut.append(replace(take, t_s=t_s, xyz_m=take.xyz_m[inside], film=own))
    sd_m = noise_sd([(take.t_s, take.xyz_m) for take in cut], names)
    return [
        Trial(
            name=take.name,
            names=tuple(names),
            t_s=take.t_s,
            xyz_m=take.xyz_m,
            sd_m=sd_m,
            trunk=tuple(trunk),
            limbs=tuple(tuple(limb) for limb in limbs),
            film=take.film,
            animal=take.animal,
            gait=take.gait,
            bones=tuple(bones),
        )
        for take in cut
    ]


def noise_sd(recordings: Sequence[tuple[Array, Array]], names: Sequence[str]) -> Array:
    """(M,) standard deviation of a measured coordinate; recordings are laid end to end, with a hole between them."""
    hole = np.full((5, len(names), 3), np.nan)
    xyz = np.concatenate([part for _, x in recordings for part in (x, hole)])
    return np.maximum(position_sd(xyz)[0], LEAST_SD_M)


def believed(t_s: Array, xyz_m: Array, names: Sequence[str]) -> Array:
    """(T, M, 3) positions without jumps and duplicates (exchanged labels), as ``mocap track`` takes them."""
    sd = np.broadcast_to(noise_sd([(t_s, xyz_m)], names), xyz_m.shape[:2])
    cleaning = clean(xyz_m, sd, t_s, Skeleton(name="markers only", markers=tuple(names)), tuple(names))
    return np.where(cleaning.any[..., None], np.nan, xyz_m)


def blocks(name: str, t_s: Array, xyz_m: Array, count: int) -> list[Take]:
    """A recording cut into blocks of equal length."""
    length = len(t_s) // count
    cuts = [slice(i * length, (i + 1) * length) for i in range(count)]
    return [Take(f"{name}[{cut.start}:{cut.stop}]", t_s[cut], xyz_m[cut]) for cut in cuts]
