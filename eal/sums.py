"""Empirical potentials of many trials by map and reduce: what a trial says is a small sum, and sums add up.

V_z depends on its samples through T_z = (1/W) sum_i w_i K_zi (x) K_zi alone. In the span of the kernels of m landmarks
(``eal.fitting``, pivoted Cholesky) that is an (m, m) matrix, the sum over samples of f f^T with f = C^-1 k(z): a trial
is a matrix of that size, however long it is; matrices of trials are added, and taken off again. Samples themselves
need not be kept: memory is that of one trial, and scores of trials left out cost no pass over samples.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from eal.arrays import Array, read_only
from eal.checks import checked_labels, checked_lambda, checked_samples
from eal.fitting import pivoted_cholesky
from eal.kernels import Kernel
from eal.potential import EmpiricalPotential
from eal.spectral import SpectralFilter, Tail


@dataclass(frozen=True, eq=False, kw_only=True)
class Landmarks:
    """Samples whose kernels span what a potential can say.

    Attributes:
        kernel: The kernel K, with K(x, x) = 1.
        centres: (m, d) landmarks.
        corner: (m, m) lower Cholesky factor C of their Gram matrix.
    """

    kernel: Kernel
    centres: Array
    corner: Array

    def __post_init__(self) -> None:
        """Copy and freeze the arrays."""
        for name in ("centres", "corner"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False, kw_only=True)
class PotentialSums:
    """What samples say of a potential: sums over them.

    Attributes:
        landmarks: Those of all trials.
        gram: (m, m) sum of f f^T, f = C^-1 k(z).
        total: Number of samples.
        residual: Sum of 1 - |f|^2, what the landmarks cannot say of the samples.
        first: (d,) sum of the samples.
        second: (d,) sum of their squares.
    """

    landmarks: Landmarks
    gram: Array
    total: float
    residual: float
    first: Array
    second: Array

    def __add__(self, other: "PotentialSums") -> "PotentialSums":
        """Of both sets of samples.

        Raises:
            ValueError: their landmarks differ.
        """
        return self._with(other, 1.0)

    def __sub__(self, other: "PotentialSums") -> "PotentialSums":
        """Of these samples without some of them; raises as for sums."""
        return self._with(other, -1.0)

    def _with(self, other: "PotentialSums", sign: float) -> "PotentialSums":
        if self.landmarks is not other.landmarks and not np.array_equal(
            self.landmarks.centres, other.landmarks.centres
        ):
            raise ValueError("sums over different landmarks cannot be added: choose landmarks once, for all trials")
        return replace(
            self,
            **{
                name: getattr(self, name) + sign * getattr(other, name)
                for name in ("gram", "total", "residual", "first", "second")
            },
        )

    def potential(
        self,
        *,
        lam: float = 1e-3,
        spectral_filter: SpectralFilter | None = None,
        names: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
    ) -> EmpiricalPotential:
        """V_z of the samples, as ``eal.fit_potential`` finds it with these landmarks; lambda compares with K / N.

        Its ``samples`` are the landmarks, each with the weight N / m: the samples themselves are not kept.

        Args:
            lam: lambda > 0.
            spectral_filter: Tail (the default), Projection or Tikhonov.
            names: d coordinate names; None: q0, q1, ...
            units: d units; None: 1.

        Raises:
            ValueError: no samples are left, or lambda is not positive or below rounding.
        """
        marks = self.landmarks
        if self.total < 1:
            raise ValueError(f"a potential needs samples, but {self.total:g} are left")
        labels, measures = checked_labels(names, units, marks.centres.shape[1])
        spectral_filter = Tail() if spectral_filter is None else spectral_filter
        sigma_lambda = checked_lambda(lam, self.total, "mean")
        sigma, vectors = np.linalg.eigh(self.gram / self.total)
        sigma, vectors = np.maximum(sigma[::-1], 0.0), vectors[:, ::-1]
        columns = vectors * np.sqrt(spectral_filter.response(sigma, sigma_lambda))
        root = solve_triangular(marks.corner, columns, lower=True, trans=1, check_finite=False)
        count = len(marks.centres)
        return EmpiricalPotential(
            kernel=marks.kernel,
            lam=float(lam),
            spectral_filter=spectral_filter,
            scaling="mean",
            samples=marks.centres,
            weights=np.full(count, self.total / count),
            centres=marks.centres,
            root=root,
            eigenvalues=sigma,
            missing=max(self.residual / self.total, float(np.finfo(np.float64).eps)),
            method="cholesky",
            names=labels,
            units=measures,
        ).judged()

    def mean_value(self, potential: EmpiricalPotential) -> float:
        """Mean of V_z over these samples, of a potential with the same landmarks: 1 - tr(B^T C G C^T B) / N."""
        rows = self.landmarks.corner.T @ potential.root
        return float(1.0 - np.einsum("ir,ij,jr->", rows, self.gram, rows, optimize=True) / self.total)


def choose_landmarks(
    kernel: Kernel, sketch: ArrayLike, *, lam: float = 1e-3, accuracy: float = 1e-5, max_rank: int = 2000
) -> Landmarks:
    """Landmarks for all trials, by pivoted Cholesky on a few samples of each.

    Args:
        kernel: The kernel.
        sketch: (n, d) samples of all trials together; some dozens of each are enough.
        lam: The smallest lambda wanted.
        accuracy: Wanted bound on the error in V, as in ``eal.fit_potential``; ``PotentialSums.residual`` tells what all
            samples lack.
        max_rank: Most landmarks.
    """
    z = checked_samples(sketch)
    factor = pivoted_cholesky(kernel, z, tolerance=lam * (0.5 * accuracy) ** 2, max_rank=max_rank)
    return Landmarks(kernel=kernel, centres=z[factor.pivots], corner=factor.corner)


def sums_of(landmarks: Landmarks, samples: ArrayLike) -> PotentialSums:
    """What the samples (N, d) of a trial say: O(N m) kernels, O(N m^2) operations, memory for some at a time."""
    z = np.asarray(samples, dtype=np.float64).reshape(-1, landmarks.centres.shape[1])
    m = len(landmarks.centres)
    gram, residual = np.zeros((m, m)), 0.0
    width = max(1, (1 << 22) // max(m, 1))  # 32 MiB of kernel values
    for start in range(0, len(z), width):
        k = landmarks.kernel.gram(landmarks.centres, z[start : start + width])
        f = solve_triangular(landmarks.corner, k, lower=True, check_finite=False)
        gram += f @ f.T
        residual += float(np.maximum(1.0 - np.einsum("mn,mn->n", f, f), 0.0).sum())
    return PotentialSums(
        landmarks=landmarks,
        gram=gram,
        total=float(len(z)),
        residual=residual,
        first=z.sum(axis=0),
        second=(z**2).sum(axis=0),
    )


def total(parts: Iterable[PotentialSums]) -> PotentialSums:
    """All of them together.

    Raises:
        ValueError: there are none, or their landmarks differ.
    """
    found: PotentialSums | None = None
    for part in parts:
        found = part if found is None else found + part
    if found is None:
        raise ValueError("there are no sums to add: give those of one trial at least")
    return found
