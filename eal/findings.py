"""What in samples or settings makes no sense, as sentences for the user."""

import numpy as np

from eal.arrays import Array
from eal.fitting import Root
from eal.kernels import Kernel


def findings_of(
    z: Array, names: tuple[str, ...], kernel: Kernel, sigma_lambda: float, found: Root, error_bound: float
) -> tuple[str, ...]:
    """Sentences on samples and settings that a user should read; empty where all is well.

    Args:
        z: (N, d) samples.
        names: d coordinate names.
        kernel: The kernel.
        sigma_lambda: lambda in units of the eigenvalues of T_z.
        found: The root.
        error_bound: sup |V - V of all samples|.

    Returns:
        What was found, what it means, what to do.
    """
    n = len(z)
    sentences = []
    if n == 1:
        return ("there is one sample: V is one minus the squared kernel about it, and knows no shape",)
    ordered = z[np.lexsort(z.T)]
    distinct = 1 + int(np.count_nonzero((ordered[1:] != ordered[:-1]).any(axis=1)))
    if distinct < n:
        sentences.append(
            f"{n - distinct} of {n} samples repeat others: they add weight, not information (was a gap filled by hold?)"
        )
    still = [name for name, spread in zip(names, np.ptp(z, axis=0), strict=True) if spread == 0.0]
    if still:
        sentences.append(
            f"coordinate {', '.join(still)} never varies: V confines it to that value as tightly as the kernel is wide"
        )
    sigma = found.eigenvalues
    if len(sigma) > 1 and sigma[0] > 1.0 - 1e-6 and distinct > 1:
        sentences.append(
            f"all samples lie within a small part of the kernel's width (first eigenvalue {sigma[0]:.7f}): V sees one "
            "cluster; scale the coordinates up or take a larger beta"
        )
    alone = 1.0 / n
    if sigma[0] < 2.0 * alone and n > 2:
        sentences.append(
            f"no two samples are near at the kernel's width (first eigenvalue {sigma[0]:.2g} of {n} samples): V is a "
            "set of separate wells; scale the coordinates down, take a smaller beta or more samples"
        )
    elif float(np.minimum(sigma / sigma_lambda, 1.0).sum()) > 0.9 * distinct and n > 2:
        sentences.append(
            f"nearly every one of the {distinct} distinct samples is a mode of its own above lambda: V follows each "
            "sample, noise included; take a larger lambda, a smaller beta or more samples"
        )
    if sigma[0] < sigma_lambda:
        sentences.append(
            f"lambda = {sigma_lambda:.2g} is above the first eigenvalue {sigma[0]:.2g}: V stays near 1 even on the "
            "samples; take a smaller lambda"
        )
    if sigma_lambda < 1e-11:
        sentences.append(f"lambda = {sigma_lambda:.2g} is near rounding: V on the samples has few correct digits")
    if error_bound > 0.01 and found.method != "exact":
        sentences.append(
            f"V may be off by up to {error_bound:.2g} away from the samples ({found.method}, "
            f"{len(found.centres)} centres): raise lambda or max_rank, or take method='exact'"
        )
    if not np.isfinite(kernel.curvature):
        sentences.append("the kernel has a cusp: forces jump at the samples, and no explicit step is stable there")
    return tuple(sentences)
