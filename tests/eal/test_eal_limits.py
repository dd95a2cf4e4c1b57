"""Each threshold of potentials, their files and what is compared, with a case just below and one just above it."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.special import ndtri

from eal import (
    GaussianKernel,
    Matern32Kernel,
    Matern52Kernel,
    Projection,
    choose,
    compare,
    fit_potential,
    fitting,
    load_potential,
    midpoint,
    radius,
)
from eal.archive import ArchiveError
from eal.arrays import Z95
from eal.checks import checked_lambda
from eal.integrators import IntegrationError
from eal.splits import two_groups


def changed(tmp_path, **arrays):
    """A file of a potential of two samples, some of its arrays replaced by others."""
    path = tmp_path / "one.npz"
    fit_potential([[0.0], [1.0]]).save(path)
    with np.load(path) as stored:
        np.savez(path, **dict(stored) | arrays)
    return path


@pytest.mark.parametrize(("number", "read"), [(0.9e19, True), (1.2e19, False)])
def test_a_file_holds_numbers_up_to_1e19(tmp_path, number, read):
    """Of samples, whose squares float64 holds."""
    path = changed(tmp_path, samples=np.array([[0.0], [number]]))
    if read:
        assert load_potential(path).samples[1, 0] == number
    else:
        with pytest.raises(ArchiveError, match="real numbers up to 1e\\+19"):
            load_potential(path)


@pytest.mark.parametrize(("beyond", "read"), [(0.9e-9, True), (1.2e-9, False)])
def test_eigenvalues_of_a_file_are_rounded_to_1e_9(tmp_path, beyond, read):
    """Beyond 0 and 1, and where one exceeds the one before it."""
    for sigma in ([1 + beyond, 0.5], [0.5, -beyond], [0.5, 0.5 + beyond]):
        path = changed(tmp_path, eigenvalues=np.array(sigma))
        if read:
            assert load_potential(path).eigenvalues.tolist() == sigma
        else:
            with pytest.raises(ArchiveError, match="eigenvalues must decrease"):
                load_potential(path)


def test_intervals_of_95_percent():
    """Of the normal law, by SciPy, to the digits that are written."""
    assert pytest.approx(ndtri(0.975), abs=1e-6) == Z95


@pytest.mark.parametrize(("lam", "enough"), [(0.9e-13, False), (1.2e-13, True)])
def test_lambda_is_above_rounding(lam, enough):
    """In units of the eigenvalues of K / N."""
    if enough:
        assert checked_lambda(lam, 5.0, "mean") == lam
    else:
        with pytest.raises(ValueError, match="V would be rounding"):
            checked_lambda(lam, 5.0, "mean")


def test_kernels_are_looked_for_up_to_twelve_factors_of_two():
    """The same two places in each trial: the narrower the kernel, the likelier they are, without end."""
    found = choose(np.tile([[0.0], [1.0]], (10, 1)), trials=np.repeat(np.arange(5), 4))
    assert found.width == 4.0 * 2.0**12


def test_five_blocks_or_ten_trials_are_left_out():
    """A recording as five trials of its fifths; twenty trials as ten of two."""
    z = np.random.default_rng(0).normal(size=(100, 1))
    tenths = np.arange(100) // 10
    assert choose(z).log_likelihood == choose(z, trials=tenths // 2).log_likelihood
    assert choose(z, trials=np.arange(100) // 5).log_likelihood == choose(z, trials=tenths).log_likelihood


@pytest.mark.parametrize(("trials", "splits"), [(15, 6435), (16, 10000)])
def test_splits_are_drawn_where_there_are_more_than_9999(trials, splits):
    """Of 15 trials (15 choose 7) are looked at, of 16 not all 12870, but 9999 and the observed one."""
    assert len(two_groups(np.arange(trials) < trials // 2, np.ones(trials), np.random.default_rng(0))) == splits


def test_ranges_hold_95_percent_of_the_samples():
    """Of even samples between 0 and 1, in four trials each."""
    even = np.linspace(0, 1, 41)[:, None]
    found = compare([even] * 4, [even + 0.5] * 4)
    np.testing.assert_allclose(found.range_a, [[0.025, 0.975]])
    np.testing.assert_allclose(found.overlap, 0.45 / 1.45)


@pytest.mark.parametrize(("pivots", "kept"), [(450, True), (550, False)])
def test_small_eigenvalues_are_kept_of_500_pivots(pivots, kept):
    """Two directions, of which one has an eigenvalue of 1e-24: of more pivots that is rounding."""
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(pivots, 2)))[0]
    sigma, _ = fitting._principal_axes(np.diag([1.0, 1e-12]) @ axes.T, np.ones(2))
    assert sigma[0] == pytest.approx(1.0)
    assert (sigma[1] == pytest.approx(1e-24, rel=0.1, abs=0)) == kept


def test_a_step_is_halved_eight_times(monkeypatch):
    """Before one that does not converge at any length is given up."""
    steps = []

    def never(_acceleration, _t_s, q, v, h_s):
        steps.append(h_s)
        return v, np.zeros(len(q), dtype=bool)

    monkeypatch.setattr(midpoint, "_mean_velocity", never)
    with pytest.raises(IntegrationError, match="did not converge"):
        midpoint.midpoint_step(lambda _t, q, _v: q, 0.0, np.zeros((1, 1)), np.zeros((1, 1)), 1.0)
    assert min(steps) == 2.0**-8


def test_lines_of_equal_deviation_are_a_tenth_apart(monkeypatch):
    """Of one that grows from 0 to 0.35 across the map."""

    def grows(_potential, q, **_):
        return 0.35 * (q[..., 0] - q[..., 0].min()) / np.ptp(q[..., 0])

    monkeypatch.setattr(radius, "value_deviation", grows)
    ax, levels = Figure().subplots(), []
    contour = ax.contour
    monkeypatch.setattr(ax, "contour", lambda *of, **how: levels.extend(how["levels"]) or contour(*of, **how))
    fit_potential(np.random.default_rng(0).normal(size=(20, 2))).plot(ax)
    np.testing.assert_allclose(levels, [0.1, 0.2, 0.3])


@pytest.mark.parametrize("kernel", [GaussianKernel, Matern32Kernel, Matern52Kernel])
def test_the_limit_of_the_curvature_is_met(kernel):
    """V of one sample is 1 - K^2, whose curvature there is that limit: 4 beta for the Gaussian kernel, in closed form.

    Of several samples it is no larger at any of them.
    """
    one = fit_potential([[0.3, -0.2]], kernel=kernel(beta=1.7), spectral_filter=Projection(), lam=1e-6)
    np.testing.assert_allclose(one.hessian([0.3, -0.2]), one.curvature_limit * np.eye(2), rtol=1e-9)
    if kernel is GaussianKernel:
        assert one.curvature_limit == pytest.approx(4 * 1.7)
    z = np.random.default_rng(0).normal(size=(30, 2))
    several = fit_potential(z, kernel=kernel(beta=1.7), spectral_filter=Projection(), lam=1e-6)
    assert np.linalg.eigvalsh(several.hessian(z)).max() <= several.curvature_limit * (1 + 1e-6)


@pytest.mark.parametrize(("missing", "bound"), [(1e-4, 0.02 / 0.38), (2.6e-3, 1.0)])
def test_what_is_left_out_of_a_factor_moves_a_projection_by_davis_and_kahan(missing, bound):
    """By 2 sqrt(missing) over the gap that is left about lambda, where no eigenvalue can cross it; else by anything."""
    found = fitting.truncation_bound(Projection(), np.array([0.5, 0.1]), 0.2, missing)
    assert found == pytest.approx(bound)
