"""The empirical potential: the letter of the paper, closed forms, laws."""

import numpy as np
import pytest

from eal import (
    CoordinateKernel,
    GaussianKernel,
    LaplaceKernel,
    Matern32Kernel,
    Matern52Kernel,
    Projection,
    RotationKernel,
    SumKernel,
    Tail,
    Tikhonov,
    fit_potential,
    fitting,
    load_potential,
)
from eal.archive import ArchiveError
from eal.fitting import ROUNDING, pivoted_cholesky
from tests.reference import empirical_potential as reference

KERNELS = [GaussianKernel(3.0), LaplaceKernel(1.5), Matern32Kernel(2.0), Matern52Kernel(2.0)]
FILTERS = [Tail(), Projection(), Tikhonov()]


def circle(rng, n=60, noise=0.02):
    angle = rng.uniform(0, 2 * np.pi, n)
    radius = 1 + noise * rng.standard_normal(n)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda k: type(k).__name__)
@pytest.mark.parametrize("spectral_filter", FILTERS, ids=lambda f: f.name)
@pytest.mark.parametrize("method", ["exact", "cholesky"])
def test_value_is_the_letter_of_the_paper(kernel, spectral_filter, method, rng):
    """Every method agrees with loops over equations 12, 14 and 29, to its own error bound and 1e-9 of rounding."""
    z, q, lam = circle(rng), 1.5 * rng.standard_normal((20, 2)), 1e-3
    fitted = fit_potential(z, kernel=kernel, lam=lam, spectral_filter=spectral_filter, method=method)
    name = type(kernel).__name__
    expected = reference.potential(z, q, kernel=name, beta=kernel.beta, lam=lam, filter_name=spectral_filter.name)
    assert np.abs(fitted.value(q) - expected).max() <= fitted.error_bound + 1e-9
    assert np.abs(fitted.value(q) - expected).max() <= 2e-5


@pytest.mark.parametrize("weighted", [False, True])
def test_eigenvalues_tell_in_vain_pivots_beforehand(weighted, rng, monkeypatch):
    """Whether looked at first or not, the same method and bits: of narrow kernels all samples are centres."""
    methods = set()
    for n in (1, 2, 3, 20, 60):
        z = circle(rng, n)
        weights = rng.integers(1, 4, n) if weighted else None
        for beta in (1e-6, 1e-2, 1.0, 30.0, 1e4):
            for max_rank in (2000, 5, 1):
                options = {"kernel": GaussianKernel(beta), "lam": 1e-3, "weights": weights, "max_rank": max_rank}
                with monkeypatch.context() as patched:
                    patched.setattr(fitting, "FEW", 0)
                    late = fit_potential(z, **options)
                found = fit_potential(z, **options)
                assert found.method == late.method, (n, beta, max_rank)
                assert np.array_equal(found.root, late.root)
                methods.add(found.method)
    assert methods == {"exact", "cholesky"}


def test_one_sample_is_one_minus_the_squared_kernel():
    """V = 1 - K(q, z)^2: T_z = K_z (x) K_z has the one eigenvalue 1."""
    fitted = fit_potential([[1.0, 2.0]], kernel=GaussianKernel(0.7), lam=1e-6)
    q = np.array([[1.0, 2.0], [1.3, 1.6]])
    np.testing.assert_allclose(fitted.value(q), [0.0, 1 - np.exp(-2 * 0.7 * 0.25)], atol=1e-14)
    assert "one sample" in fitted.findings[0]


def test_two_samples_have_a_closed_form():
    """K = [[1, c], [c, 1]] has eigenvalues 1 +- c with vectors (1, +-1)/sqrt 2; lambda = 0.3 is above (1 - c)/2."""
    x, beta, lam = 0.4, 1.0, 0.3
    c = np.exp(-beta * (2 * x) ** 2)
    q = np.linspace(-1, 1, 9)
    a, b = np.exp(-beta * (q - x) ** 2), np.exp(-beta * (q + x) ** 2)
    expected = 1 - (a + b) ** 2 / 2 / (1 + c) - (a - b) ** 2 / 2 / (2 * lam)
    fitted = fit_potential([[x], [-x]], kernel=GaussianKernel(beta), lam=lam)
    assert (1 - c) / 2 < lam < (1 + c) / 2
    np.testing.assert_allclose(fitted.value(q[:, None]), expected, atol=1e-14)


@pytest.mark.parametrize("spectral_filter", FILTERS, ids=lambda f: f.name)
@pytest.mark.parametrize("kernel", [*KERNELS, SumKernel((GaussianKernel(2.0), LaplaceKernel(1.0)))], ids=str)
@pytest.mark.parametrize("lam", [1e-1, 1e-5, 1e-10])
def test_value_lies_between_zero_and_one(kernel, spectral_filter, lam, rng):
    """0 <= V <= 1 everywhere, on data and off, and V -> 1 far away."""
    z = circle(rng)
    fitted = fit_potential(z, kernel=kernel, lam=lam, spectral_filter=spectral_filter)
    v = fitted.value(np.concatenate([z, 3 * rng.standard_normal((500, 2)), [[1e3, 0.0]]]))
    assert (v >= 0).all()
    assert (v <= 1).all()
    assert v[-1] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("method", ["exact", "cholesky"])
@pytest.mark.parametrize(
    "kernel",
    [*KERNELS, CoordinateKernel(GaussianKernel(2.0), (1.0, 0.5), (0.0, 2 * np.pi))],
    ids=lambda k: type(k).__name__,
)
def test_gradient_and_hessian_are_differences(kernel, method, rng):
    """Richardson-extrapolated central differences, h = 1e-3: truncation (h/r)^4 at r >= 0.15, below 1e-8."""
    fitted = fit_potential(circle(rng), kernel=kernel, lam=1e-4, method=method)
    angle, radius = rng.uniform(0, 6, (2, 6)), rng.choice([0.6, 0.8, 1.3], (2, 6))
    q = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    for value, gradient, hessian in (
        (fitted.value, fitted.gradient, fitted.hessian),
        (fitted.barrier_value, fitted.barrier_gradient, fitted.barrier_hessian),
    ):
        slope, bend = gradient(q), hessian(q)
        assert slope.shape == (2, 6, 2)
        assert bend.shape == (2, 6, 2, 2)
        np.testing.assert_allclose(slope, differences(value, q), rtol=1e-7, atol=1e-7 * np.abs(slope).max())
        np.testing.assert_allclose(bend, differences(gradient, q), rtol=1e-6, atol=1e-6 * np.abs(bend).max())
        np.testing.assert_allclose(bend, bend.swapaxes(-1, -2), atol=1e-11 * np.abs(bend).max())


def differences(function, q, h=1e-3):
    def central(step, axis):
        return (function(q + step * axis) - function(q - step * axis)) / (2 * step)

    return np.stack([(4 * central(h / 2, e) - central(h, e)) / 3 for e in np.eye(q.shape[-1])], axis=-1)


def test_barrier_is_right_where_the_potential_saturates(rng):
    """At 1 to 30 units exp(-2 beta s) falls to 1e-2300; extended precision still has it, and so has the barrier."""
    fitted = fit_potential(circle(rng), kernel=GaussianKernel(3.0), lam=1e-5)
    for distance in (1.0, 3.0, 10.0, 30.0):
        q = distance * np.array([0.6, 0.8])
        expected = reference.gaussian_barrier(fitted.centres, fitted.root, 3.0, q)
        assert fitted.barrier_value(q) == pytest.approx(expected, rel=1e-12, abs=1e-12)
        pull = fitted.barrier_gradient(q)
        h = 1e-6 * distance
        rise = [
            reference.gaussian_barrier(fitted.centres, fitted.root, 3.0, q + h * e)
            - reference.gaussian_barrier(fitted.centres, fitted.root, 3.0, q - h * e)
            for e in np.eye(2)
        ]
        np.testing.assert_allclose(pull, np.array(rise) / (2 * h), rtol=1e-6, atol=1e-7 * np.abs(pull).max())


def test_barrier_does_not_saturate_at_any_distance(rng):
    """-log(1 - V) ~ 2 beta |q|^2 far away, gradient 4 beta q, Hessian 4 beta: to 2/|q| at 1e6 units of distance."""
    fitted = fit_potential(circle(rng), kernel=GaussianKernel(3.0), lam=1e-5)
    q = 1e6 * np.array([0.6, -0.8])
    assert fitted.value(q) == 1.0
    assert (fitted.gradient(q) == 0).all()
    assert fitted.barrier_value(q) == pytest.approx(6.0 * 1e12, rel=1e-5)
    np.testing.assert_allclose(fitted.barrier_gradient(q), 12.0 * q, rtol=1e-5)
    np.testing.assert_allclose(fitted.barrier_hessian(q), 12.0 * np.eye(2), atol=1e-3)


def test_barrier_is_the_potential_near_the_data(rng):
    """-log(1 - V) = V + V^2/2 + V^3/3 + ...: within V^3 where V < 0.1."""
    z = circle(rng, noise=0.0)
    fitted = fit_potential(z, kernel=GaussianKernel(3.0), lam=1e-6)
    v = fitted.value(1.03 * z)
    assert 1e-4 < v.max() < 0.1
    assert (np.abs(fitted.barrier_value(1.03 * z) - v - v**2 / 2) <= v**3).all()


@pytest.mark.parametrize("method", ["exact", "cholesky"])
def test_order_of_samples_does_not_matter(method, rng):
    """V depends on the set of samples: to rounding (exact) or to the error bound of two factors (cholesky)."""
    z, q = circle(rng, n=100), rng.standard_normal((30, 2))
    one = fit_potential(z, kernel=GaussianKernel(3.0), lam=1e-5, method=method)
    two = fit_potential(rng.permutation(z), kernel=GaussianKernel(3.0), lam=1e-5, method=method)
    tolerance = one.error_bound + two.error_bound + 1e-10
    assert np.abs(one.value(q) - two.value(q)).max() <= tolerance
    assert tolerance < 1e-3


@pytest.mark.parametrize("method", ["exact", "cholesky"])
def test_weights_are_repeats(method, rng):
    """Weight 3 is the same sample three times, in V, gradient and eigenvalues."""
    z, q = circle(rng, n=40), rng.standard_normal((30, 2))
    times = rng.integers(1, 4, 40)
    weighted = fit_potential(z, kernel=GaussianKernel(2.0), lam=1e-4, weights=times, method=method)
    repeated = fit_potential(np.repeat(z, times, axis=0), kernel=GaussianKernel(2.0), lam=1e-4, method=method)
    tolerance = weighted.error_bound + repeated.error_bound + 1e-9
    assert np.abs(weighted.value(q) - repeated.value(q)).max() <= tolerance
    np.testing.assert_allclose(weighted.eigenvalues[:8], repeated.eigenvalues[:8], rtol=1e-9)
    assert any("repeat others" in f for f in repeated.findings)
    assert not weighted.findings


@pytest.mark.parametrize("spectral_filter", [Tail(), Tikhonov()], ids=lambda f: f.name)
@pytest.mark.parametrize("method", ["exact", "cholesky"])
def test_another_lambda_needs_no_new_fit(spectral_filter, method, rng):
    """with_lambda is the fit at that lambda on the same factor, to rounding over lambda."""
    z, q = circle(rng), rng.standard_normal((30, 2))
    settings = {"kernel": GaussianKernel(3.0), "spectral_filter": spectral_filter, "method": method, "accuracy": 1e-9}
    moved = fit_potential(z, lam=1e-6, **settings).with_lambda(1e-3)
    fresh = fit_potential(z, lam=1e-3, **settings)
    np.testing.assert_allclose(moved.value(q), fresh.value(q), atol=1e-9)
    assert moved.error_bound == pytest.approx(fresh.error_bound, rel=1e-6)


def test_a_projection_is_fitted_again(rng):
    fitted = fit_potential(circle(rng), kernel=GaussianKernel(3.0), lam=1e-3, spectral_filter=Projection())
    with pytest.raises(ValueError, match="use fit_potential"):
        fitted.with_lambda(1e-4)


def test_rotating_the_world_rotates_the_potential(rng):
    """V(R q; R z) = V(q; z) for a radial kernel, to rounding over lambda."""
    z, q = circle(rng), rng.standard_normal((30, 2))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    one = fit_potential(z, kernel=GaussianKernel(3.0), lam=1e-4, method="exact")
    two = fit_potential(z @ turn.T, kernel=GaussianKernel(3.0), lam=1e-4, method="exact")
    np.testing.assert_allclose(two.value(q @ turn.T), one.value(q), atol=1e-10)
    np.testing.assert_allclose(two.gradient(q @ turn.T), one.gradient(q) @ turn.T, atol=1e-9)


def test_gram_scaling_is_lambda_over_n(rng):
    z, q = circle(rng), rng.standard_normal((10, 2))
    gram = fit_potential(z, kernel=GaussianKernel(3.0), lam=6e-3, scaling="gram")
    mean = fit_potential(z, kernel=GaussianKernel(3.0), lam=1e-4)
    np.testing.assert_allclose(gram.value(q), mean.value(q), rtol=1e-12)


def test_value_at_the_samples_is_below_lambda_for_the_tail_filter(rng):
    """The mean of V over the samples is the trace of (1 - r(T_z)) T_z; on an exact curve the tail falls fast.

    So that the mean stays below 2 lambda (0.4 to 0.8 for the pendulum).
    """
    z = circle(rng, n=400, noise=0.0)
    for lam in (1e-3, 1e-5, 1e-7):
        fitted = fit_potential(z, kernel=GaussianKernel(3.0), lam=lam)
        sigma = fitted.eigenvalues
        expected = float(((1 - np.minimum(sigma / lam, 1.0)) * sigma).sum())
        assert fitted.value(z).mean() == pytest.approx(expected, rel=0.01, abs=2 * fitted.error_bound**2 + 1e-12)
        assert fitted.value(z).mean() < 2 * lam


def test_pivots_stop_before_rounding_does(rng):
    """Noisy samples at tolerance zero: every pivot taken is above rounding, so that the corner can be inverted."""
    for n in (200, 400, 800):
        z = circle(rng, n=n, noise=0.003)
        factor = pivoted_cholesky(GaussianKernel(3.0), z, tolerance=0.0, max_rank=n)
        assert np.diag(factor.corner).min() > 0.5 * np.sqrt(ROUNDING)
        gram = GaussianKernel(3.0).gram(z, z)
        assert np.abs(gram - factor.rows @ factor.rows.T).max() < 10 * ROUNDING


def test_many_pivots_take_the_short_way_to_the_same_potential(rng, monkeypatch):
    """Eigenvalues from the product of the factor with itself: V agrees to 1e-16 over lambda, with weights too."""
    z, q, weights = circle(rng), rng.standard_normal((30, 2)), rng.uniform(0.5, 2.0, 60)
    settings = {"kernel": GaussianKernel(3.0), "lam": 1e-4, "weights": weights, "method": "cholesky"}
    long = fit_potential(z, **settings)
    monkeypatch.setattr("eal.fitting.WIDE", 5)
    short = fit_potential(z, **settings)
    np.testing.assert_allclose(short.value(q), long.value(q), atol=1e-10)
    np.testing.assert_allclose(short.eigenvalues, long.eigenvalues, atol=1e-14)


def test_hundred_thousand_samples_need_few_centres(rng):
    """N = 1e5 on a curve never forms K: as many centres as for N = 1e3, and a stated bound."""
    small = fit_potential(circle(rng, n=1000, noise=0.0), kernel=GaussianKernel(3.0), lam=1e-5)
    large = fit_potential(circle(rng, n=100_000, noise=0.0), kernel=GaussianKernel(3.0), lam=1e-5)
    assert len(large.centres) < 1.5 * len(small.centres)
    assert large.error_bound < 1e-3
    assert large.eigenvalues.sum() == pytest.approx(1.0, abs=1e-9)


def test_file_gives_the_same_potential_back(rng, tmp_path):
    """Save and load keep V to the bit, with settings, names and units."""
    circle_kernel = CoordinateKernel(GaussianKernel(2.0), (1.0, np.inf), (0.0, 1.0))
    joint_kernel = RotationKernel(Matern52Kernel(1.0), (1, 0), (0.5, 2.0))
    kernel = SumKernel((circle_kernel, joint_kernel), (1, 2))
    fitted = fit_potential(circle(rng), kernel=kernel, lam=1e-4, names=("x", "y"), units=("m", "m"))
    fitted.save(tmp_path / "elbow.npz")
    back = load_potential(tmp_path / "elbow.npz")
    q = rng.standard_normal((30, 2))
    assert (back.value(q) == fitted.value(q)).all()
    assert (back.kernel, back.names, back.units, back.lam) == (kernel, ("x", "y"), ("m", "m"), 1e-4)
    assert [p.name for p in tmp_path.iterdir()] == ["elbow.npz"]


def test_files_of_another_version_are_refused(rng, tmp_path, monkeypatch):
    monkeypatch.setattr("eal.archive.VERSION", 99)
    fit_potential(circle(rng), kernel=GaussianKernel(1.0), lam=1e-3).save(tmp_path / "new.npz")
    monkeypatch.undo()
    with pytest.raises(ArchiveError, match="version 99, but this program reads 1"):
        load_potential(tmp_path / "new.npz")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.npz").write_text("no")
    np.savez(tmp_path / "b.npz", x=np.zeros(3))
    for name in ("a.npz", "b.npz", "missing.npz"):
        with pytest.raises(ArchiveError, match=name):
            load_potential(tmp_path / name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"samples": np.zeros((0, 2))}, "shape"),
        ({"samples": np.zeros(4)}, "shape"),
        ({"samples": np.full((4, 2), 1j)}, "samples must be real numbers"),
        ({"samples": [[0.0, 1.0], [np.nan, 1.0]]}, "1 of 2 rows are not, the first is row 1"),
        ({"lam": 0.0}, "lam must be a finite number above 0"),
        ({"lam": 1e-14}, "V would be rounding"),
        ({"weights": [1.0]}, "weights must be 2 finite numbers"),
        ({"weights": [1.0, -1.0]}, "weights must be 2 finite numbers"),
        ({"names": ("x",)}, "2 coordinates need as many names"),
        ({"method": "magic"}, "method must be one of"),
        ({"scaling": "magic"}, "scaling must be one of"),
    ],
)
def test_bad_input_is_named(change, message):
    settings = {"samples": [[0.0, 1.0], [1.0, 0.0]], "kernel": GaussianKernel(1.0), "lam": 1e-3} | change
    with pytest.raises(ValueError, match=message):
        fit_potential(settings.pop("samples"), **settings)


def test_query_of_another_dimension_is_refused(rng):
    fitted = fit_potential(circle(rng), kernel=GaussianKernel(1.0), lam=1e-3)
    with pytest.raises(ValueError, match="2 coordinates on its last axis"):
        fitted.value(np.zeros((5, 3)))


@pytest.mark.parametrize(
    ("samples", "settings", "sentence"),
    [
        (np.tile([[0.0, 1.0], [1.0, 0.0]], (5, 1)), {}, "8 of 10 samples repeat others"),
        (np.stack([np.linspace(0, 1, 9), np.ones(9)], axis=1), {}, "coordinate q1 never varies"),
        (np.linspace(0, 1e-5, 9)[:, None], {}, "one cluster"),
        (np.linspace(0, 100, 9)[:, None], {}, "separate wells"),
        (np.linspace(0, 9, 20)[:, None], {"lam": 1e-6}, "a mode of its own"),
        (np.linspace(0, 1, 9)[:, None], {"lam": 0.95}, "above the first eigenvalue"),
        (np.linspace(0, 1, 9)[:, None], {"lam": 1e-12}, "near rounding"),
        (np.linspace(0, 9, 90)[:, None], {"max_rank": 2, "method": "cholesky"}, "may be off by"),
        (np.linspace(0, 1, 9)[:, None], {"kernel": LaplaceKernel(1.0)}, "cusp"),
    ],
)
def test_samples_that_make_no_sense_are_findings(samples, settings, sentence):
    fitted = fit_potential(samples, **({"kernel": GaussianKernel(1.0), "lam": 1e-4} | settings))
    assert any(sentence in f for f in fitted.findings)
