"""What the field compares groups of trials with, on the draws of ``benchmarks.compare``.

Curves of a trial are its cycles, from one rising passage through its mean to the next, at 101 phases, averaged; animals
that are named are the means of their trials. A trial without a whole cycle has no curve and is left out: with fewer
than three units a side a method says nothing.

- **spm1d**: Welch's t over the cycle, by random field theory (Pataky 2010; ``pip install spm1d``: GPL, not of this).
- **procrustes**: Procrustes motion analysis (Adams & Cerney 2007, J. Biomech. 40): shapes of the limb's three points,
  superimposed, are a path; paths are centred, scaled and rotated onto their mean. Size and shape of paths, each by 999
  splits, at half of the level.
- **peaks**: Welch's t on the mean of the cycles' peaks, of all trials (the largest angle, where no cycle is whole).
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import stats
from scipy.ndimage import gaussian_filter1d

from eal.arrays import Array

PHASES, SHAPES = 101, 20
SMOOTH_S = 0.004
FEWEST = 3

Owners = tuple[Sequence[str], Sequence[str]] | None


def cycles(trial: Array, fps: float) -> list[Array]:
    """(101,) angles of each whole cycle; frames that were not seen lie on straight lines."""
    angle = trial[:, 0]
    rows, seen = np.arange(len(angle)), np.isfinite(angle)
    angle = gaussian_filter1d(np.interp(rows, rows[seen], angle[seen]), SMOOTH_S * fps)
    wave = angle - angle.mean()
    starts, low = [], False
    for i in range(1, len(wave)):
        low = low or wave[i] < -0.5 * wave.std()
        if low and wave[i - 1] < 0.0 <= wave[i]:
            starts.append(i - wave[i] / (wave[i] - wave[i - 1]))
            low = False
    return [np.interp(np.linspace(a, b, PHASES), rows, angle) for a, b in pairwise(starts)]


def peers(
    groups: tuple[Sequence[Array], Sequence[Array]], fps: tuple[float, float], owners: Owners, number: int
) -> dict[str, float]:
    """Of each method whether it rejects at 0.05 and at 0.01 (1 or 0); NaN: it says nothing."""
    curves, tops = [], []
    for side, (trials, rate) in enumerate(zip(groups, fps, strict=True)):
        whole = [cycles(trial, rate) for trial in trials]
        whose = [str(i) for i in range(len(trials))] if owners is None else list(owners[side])
        top = [
            np.mean([c.max() for c in found]) if found else np.nanmax(trial)
            for found, trial in zip(whole, trials, strict=True)
        ]
        tops.append(_of_animals(whose, [np.array([x]) for x in top])[:, 0])
        kept = [(name, np.mean(found, axis=0)) for name, found in zip(whose, whole, strict=True) if found]
        curves.append(_of_animals([name for name, _ in kept], [one for _, one in kept]) if kept else np.zeros((0, 1)))
    p = float(np.asarray(stats.ttest_ind(*tops, equal_var=False))[1])
    found = {"peaks_p05": float(p <= 0.05), "peaks_p01": float(p <= 0.01)}
    enough = min(map(len, curves)) >= FEWEST
    for name, method in (("spm1d", _spm), ("procrustes", lambda a, b: _procrustes(a, b, number))):
        at = method(*curves) if enough else (np.nan, np.nan)
        found |= {f"{name}_p05": at[0], f"{name}_p01": at[1]}
    return found


def _of_animals(whose: Sequence[str], values: Sequence[Array]) -> Array:
    return np.stack(
        [np.mean([v for w, v in zip(whose, values, strict=True) if w == one], 0) for one in sorted(set(whose))]
    )


def _spm(a: Array, b: Array) -> tuple[float, float]:
    try:
        import spm1d  # type: ignore[import-not-found]
    except ImportError:
        return np.nan, np.nan
    t = spm1d.stats.ttest2(a, b, equal_var=False)
    first, second = (bool(t.inference(alpha, two_tailed=True).h0reject) for alpha in (0.05, 0.01))
    return float(first), float(second)


def _procrustes(a: Array, b: Array, number: int) -> tuple[float, float]:
    """Sizes and shapes of paths of three points, parent, centre and child, of equal segments."""
    angle = np.radians(np.concatenate([a, b])[:, np.linspace(0, PHASES - 1, SHAPES).astype(int)])
    points = np.zeros((*angle.shape, 3, 2))
    points[..., 0, 0] = -1.0
    points[..., 2, 0], points[..., 2, 1] = np.cos(angle), np.sin(angle)
    shapes = _superimposed(points.reshape(-1, 3, 2)).reshape(*angle.shape, 6)
    centred = shapes - shapes.mean(axis=1, keepdims=True)
    size = np.linalg.norm(centred, axis=(1, 2))
    paths = _superimposed(centred)
    p = [_permuted(x, len(a), np.random.default_rng(number)) for x in (size[:, None], paths.reshape(len(paths), -1))]
    return float(min(p) <= 0.025), float(min(p) <= 0.005)


def _superimposed(shapes: Array) -> Array:
    """(n, k, d) centred, of size 1, rotated onto their mean (Gower 1975, five rounds)."""
    x = shapes - shapes.mean(axis=1, keepdims=True)
    x = x / np.linalg.norm(x, axis=(1, 2), keepdims=True)
    mean = x[0]
    for _ in range(5):
        left, _, right = np.linalg.svd(np.swapaxes(x, 1, 2) @ mean)
        x = x @ left @ right
        mean = x.mean(axis=0)
        mean = mean / np.linalg.norm(mean)
    return x


def _permuted(x: Array, n_a: int, rng: np.random.Generator) -> float:
    first = np.arange(len(x)) < n_a
    chosen = np.vstack([first, rng.permuted(np.tile(first, (999, 1)), axis=1)])
    share = chosen / n_a - ~chosen / (len(x) - n_a)
    apart = np.linalg.norm(share @ x, axis=1)
    return float(np.mean(apart >= apart[0] * (1.0 - 1e-9)))
