"""Mixing motion models sample by sample: weights, moments, widths."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.hide import gap_lengths
from mocap.filters.mixture import Mixture, learn_mixture
from mocap.filters.model import Members
from mocap.filters.observations import WHOLE
from mocap.filters.observe import Observed
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.score import Residuals, joined

LENGTHS = np.array([10.0, 25.0, 50.0, 100.0])


def mixture(k, rng, **changed):
    """Any mixture of K models; scales and widths are 1 unless they are given."""
    given = {
        "offset": rng.normal(size=k),
        "slope": rng.normal(size=k),
        "length": LENGTHS,
        "scale": np.ones((4, k)),
        "widen": 1.0,
        "dof": np.inf,
    }
    return Mixture(**{**given, **changed})


def said(k, rng, shape=(6, 3)):
    """Means and covariances of K models, and lengths of gaps."""
    factor = rng.normal(0, 0.02, (k, *shape, 3, 3))
    cov = factor @ np.swapaxes(factor, -1, -2) + 1e-4 * np.eye(3)
    return list(rng.normal(0, 0.05, (k, *shape, 3))), list(cov), rng.integers(1, 150, shape)


@given(seed=st.integers(0, 1000), k=st.integers(1, 5))
def test_weights_are_shares(seed, k):
    """They are positive, sum to 1 to rounding, and are those of the stated formula."""
    rng = np.random.default_rng(seed)
    mixed = mixture(k, rng)
    variance, length = rng.uniform(1e-9, 1, (k, 7, 4)), rng.integers(0, 300, (7, 4))
    weight = mixed.weights(variance, length)
    assert (weight >= 0).all()
    np.testing.assert_allclose(weight.sum(axis=0), 1, rtol=0, atol=1e-14)
    t, m = rng.integers(7), rng.integers(4)
    place = np.log(max(length[t, m], 1) / 30)
    raw = np.exp(mixed.offset + mixed.slope * place) / variance[:, t, m]
    np.testing.assert_allclose(weight[:, t, m], raw / raw.sum(), rtol=1e-9)


def test_the_moments_are_those_of_the_mixture():
    """Mean and covariance of samples: a model is drawn by its weight, a position by its density.

    Of n draws a mean errs by sd / sqrt(n), a variance by sqrt(2 / n) of it and more where tails are heavy: 5 of these.
    """
    rng = np.random.default_rng(1)
    mixed = mixture(3, rng)
    means, covs, length = said(3, rng)
    mean, cov = mixed.combine(means, covs, length)
    weight = mixed.weights(np.trace(np.array(covs), axis1=-2, axis2=-1) / 3, length)
    n = 200_000
    for t, m in ((0, 0), (2, 1), (5, 2)):
        which = rng.choice(3, size=n, p=weight[:, t, m])
        draws = np.concatenate(
            [rng.multivariate_normal(means[k][t, m], covs[k][t, m], (which == k).sum()) for k in range(3)]
        )
        sd = np.sqrt(np.diag(cov[t, m]))
        assert (np.abs(draws.mean(axis=0) - mean[t, m]) < 5 * sd / np.sqrt(n)).all()
        np.testing.assert_allclose(np.cov(draws.T), cov[t, m], rtol=0, atol=5 * np.sqrt(3 / n) * sd.max() ** 2)


@given(seed=st.integers(0, 1000), copies=st.integers(1, 4))
def test_equal_models_say_what_one_says(seed, copies):
    """One model, or the same several times with any weights, is that model, to rounding."""
    rng = np.random.default_rng(seed)
    (mean,), (cov,), length = said(1, rng)
    mixed = mixture(copies, rng).combine([mean] * copies, [cov] * copies, length)
    np.testing.assert_allclose(mixed[0], mean, rtol=1e-12)
    np.testing.assert_allclose(mixed[1], cov, rtol=1e-12, atol=1e-18)


@given(seed=st.integers(0, 1000))
def test_scales_and_widths_act_on_deviations(seed):
    """One model with scale a and width b states a b times its deviation at those lengths, and its own where seen.

    A width of three degrees of freedom states 3.182 / 1.96 times that, as tables of Student's t have it.

    Between the lengths the factor is a power law through them, beyond it stays.
    """
    rng = np.random.default_rng(seed)
    scale, widen = rng.uniform(0.5, 2, (4, 1)), rng.uniform(0.5, 2)
    mixed = mixture(1, rng, scale=scale, widen=widen)
    (mean,), (cov,), _ = said(1, rng, (6, 1))
    length = np.array([[0], [1], [25], [50], [35], [1000]])
    found, wide = mixed.combine([mean], [cov], length)
    np.testing.assert_allclose(found, mean, rtol=1e-12)
    factor = np.sqrt(wide[:, 0, 0, 0] / cov[:, 0, 0, 0])
    both = scale[:, 0] * widen
    between = both[1] * (both[2] / both[1]) ** (np.log(35 / 25) / np.log(2))
    np.testing.assert_allclose(factor, [1, both[0], both[1], both[2], between, both[3]], rtol=1e-9)
    few = replace(mixed, dof=3.0).widening(length[1:])
    np.testing.assert_allclose(few, widen * 3.182 / 1.96, rtol=5e-4)  # four digits


@given(seed=st.integers(0, 1000), n_frames=st.integers(1, 40), share=st.sampled_from([0.0, 0.3, 0.8, 1.0]))
def test_gap_lengths_are_counted(seed, n_frames, share):
    """Against walking to both sides from every sample."""
    seen = np.random.default_rng(seed).random((n_frames, 3)) >= share
    found = gap_lengths(seen)
    for t, m in np.ndindex(*seen.shape):
        first = last = t
        while not seen[t, m] and first > 0 and not seen[first - 1, m]:
            first -= 1
        while not seen[t, m] and last < n_frames - 1 and not seen[last + 1, m]:
            last += 1
        assert found[t, m] == (0 if seen[t, m] else last - first + 1)


def fills(rng, sd, *, stated=None, per_gap=0.0, n_gaps=60, frames=LENGTHS, noise_m=0.0):
    """What models say of the same hidden samples; ``sd[k]`` of a length is the deviation of model k's errors.

    Args:
        rng: Source of errors.
        sd: K functions of the length.
        stated: What each of them states; None: the truth.
        per_gap: Share of an error's variance that a gap's samples have in common.
        n_gaps: Gaps of each length.
        frames: Lengths; of each gap ten samples were measured.
        noise_m: Deviation of the measurements.
    """
    length = np.repeat(frames.astype(int), 10 * n_gaps)
    gap = np.repeat(np.arange(len(frames) * n_gaps), 10)
    out, noise = [], noise_m * rng.normal(size=(len(length), 3))
    for k, law in enumerate(sd):
        shared = np.repeat(rng.normal(size=(len(frames) * n_gaps, 3)), 10, axis=0)
        unit = np.sqrt(per_gap) * shared + np.sqrt(1 - per_gap) * rng.normal(size=(len(length), 3))
        claim = (law if stated is None else stated[k])(length)
        variance = np.broadcast_to((claim**2)[:, None], unit.shape)
        own = {"variance": variance, "noise": np.full(len(length), noise_m**2), "gap": gap, "length": length}
        out.append(Residuals(error_m=law(length)[:, None] * unit - noise, **own))
    return out


def mixed_by_combine(mixed, parts):
    """The mixture's own fill, by ``combine``: each sample is a marker of one frame."""
    length = parts[0].length[None]
    covs = [f.variance[None, :, :, None] * np.eye(3) for f in parts]
    mean, cov = mixed.combine([f.error_m[None] for f in parts], covs, length)
    return replace(parts[0], error_m=mean[0], variance=np.diagonal(cov[0], axis1=-2, axis2=-1))


def short(n):
    """Good in short gaps."""
    return 1e-3 * (n / 10.0) ** 1.5


def long(n):
    """Good in long gaps."""
    return 6e-3 * np.ones_like(n, dtype=float)


def same(n):
    """A model that states the same of all gaps."""
    return 5e-3 * np.ones_like(n, dtype=float)


@pytest.mark.parametrize("stated", [None, [same, same]], ids=["stated", "not stated"])
def test_the_best_of_both_on_fresh_data(stated):
    """One model is best in short gaps, one in long ones: the mixture errs less than either, whether they know or not.

    It is at or below the better of the two at every length, to the 3 % that 1800 coordinates tell: where models state
    themselves by their deviations, else by the slopes, scales and offsets that were learned. Scales of lengths that
    differ forty times are drawn to each other by 12 gaps of 72, as variances: six per cent more in the shortest gaps.
    """
    rng = np.random.default_rng(4)
    mixed = learn_mixture(fills(rng, [short, long], stated=stated))
    fresh = fills(rng, [short, long], stated=stated)
    own = mixed_by_combine(mixed, fresh)
    assert own.log_rmse < min(f.log_rmse for f in fresh) - 0.1
    for n in LENGTHS:
        at = fresh[0].length == n
        each = [np.sqrt(np.mean(f.error_m[at] ** 2)) for f in (*fresh, own)]
        assert each[2] < (1.03 if stated is None else 1.1) * min(each[:2])


@pytest.mark.parametrize("wrong", [0.5, 2.0])
@pytest.mark.parametrize("models", [[short], [long, short]])
def test_widths_give_95_per_cent(models, wrong):
    """Stated deviations that are half or twice the true ones: fresh intervals hold 95 %, and those of each length.

    Of 24000 coordinates the share is known to 0.15 %, of a length to 0.3 %; that it was learned doubles the variance,
    and what lengths lend each other (12 of 212 gaps) bends it by a tenth of their differences.
    """
    rng = np.random.default_rng(5)
    stated = [lambda n, law=law: wrong * law(n) for law in models]
    mixed = learn_mixture(fills(rng, models, stated=stated, n_gaps=200))
    own = mixed_by_combine(mixed, fills(rng, models, stated=stated, n_gaps=200))
    inside = np.abs(own.error_m) <= 1.959964 * np.sqrt(own.variance)
    assert inside.mean() == pytest.approx(0.95, abs=0.006)
    for n in LENGTHS:
        assert inside[own.length == n].mean() == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize("wrong", [0.5, 2.0])
def test_widths_make_errors_what_is_stated(wrong):
    """Errors that gaps have in common, stated at half or twice: z of fresh gaps is 1, in all and at each length.

    Of 800 gaps that count as one error each the root mean square is known to 2.5 %, of a length to 5 %.
    """
    rng = np.random.default_rng(15)
    stated = [lambda n, law=law: wrong * law(n) for law in (long, short)]
    mixed = learn_mixture(fills(rng, [long, short], stated=stated, per_gap=0.8, n_gaps=200, noise_m=1e-4))
    own = mixed_by_combine(mixed, fills(rng, [long, short], stated=stated, per_gap=0.8, n_gaps=200))
    assert np.sqrt(np.mean(own.error_m**2 / own.variance)) == pytest.approx(1, abs=0.07)
    for n in LENGTHS:
        part = own.some(own.length == n)
        assert np.sqrt(np.mean(part.error_m**2 / part.variance)) == pytest.approx(1, abs=0.13)


@pytest.mark.rare
def test_few_gaps_give_intervals_of_students_t():
    """Gaps of which each is one error: over 60 draws of three 95 % intervals of two models hold 95 %.

    Of the 720 coordinates of four fresh gaps a draw, those of a draw share their width: 95 % to 2 points, and two
    more as models are weighted by the same gaps.
    """
    rng, inside = np.random.default_rng(17), []
    given = {"per_gap": 1.0, "frames": np.array([25.0])}
    for _ in range(60):
        mixed = learn_mixture(fills(rng, [same, long], n_gaps=3, **given))
        own = mixed_by_combine(mixed, fills(rng, [same, long], n_gaps=4, **given))
        inside.append(np.mean(np.abs(own.error_m) <= 1.959964 * np.sqrt(own.variance)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.04)


def test_degrees_of_freedom_count_gaps():
    """Samples of a gap that err alike are one error of three coordinates; of 100 gaps 300, to a fifth, 10 samples each.

    Ten independent samples of a gap are no more. The prior has three. Two over a relative variance that 100 gaps tell
    have a deviation of 20 %, as squares of normal errors have heavy tails.
    """
    rng = np.random.default_rng(18)
    for per_gap in (0.0, 1.0):
        found = learn_mixture(fills(rng, [same], per_gap=per_gap, n_gaps=100, frames=np.array([25.0])))
        assert found.dof <= 303.0001
        assert found.dof == pytest.approx(300, rel=0.4)


def test_what_measurements_hide_leaves_the_width():
    """Samples whose noise is fifty times the estimate's deviation show nothing: the width is that of the others."""
    rng = np.random.default_rng(16)
    parts = fills(rng, [same], stated=[lambda n: 2 * same(n)], n_gaps=100)
    noise = np.where(parts[0].length == 10, 50 * 5e-3, 0.0)
    error = parts[0].error_m + noise[:, None] * rng.normal(size=parts[0].error_m.shape)
    mixed = learn_mixture(parts)
    own = mixed.calibrated([replace(parts[0], error_m=error, noise=noise**2)])
    np.testing.assert_allclose(own.widen * own.scale[:, 0], 0.5, rtol=0.1)


@pytest.mark.parametrize("wrong", [0.3, 1.0])
def test_the_noise_of_measurements_is_kept_apart(wrong):
    """However sure a model is, measurements err five times more: fresh intervals of the truth hold 95 %, to 4.

    Widened as one with the noise, a model that is three times too sure would be widened by 1.02 and hold 45 %.
    """
    rng, stated = np.random.default_rng(11), [lambda n: wrong * same(n)]
    mixed = learn_mixture(fills(rng, [same], stated=stated, n_gaps=400, noise_m=5 * 5e-3))
    truth = mixed_by_combine(mixed, fills(rng, [same], stated=stated, n_gaps=400))
    inside = np.abs(truth.error_m) <= 1.959964 * np.sqrt(truth.variance)
    assert inside.mean() == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize("seed", range(4))
def test_gaps_too_short_to_show_anything_have_the_scale_of_others(seed):
    """In gaps of 2 frames measurements err five times more than the model, which states half: it is widened there, too.

    Half of the draws show less than the noise there, and a scale from them alone is as small as it may be. A scale of
    30 gaps of 25 frames is known to 8 %; those of 2 frames, to a factor of 2 at best, are drawn to it.
    """
    rng, truth = np.random.default_rng(seed), 5e-3
    parts = []
    for frames, noise in ((2, 5 * truth), (25, 0.0)):
        law = {"stated": [lambda n: 0.5 * same(n)], "per_gap": 0.5, "n_gaps": 30, "frames": np.array([float(frames)])}
        parts.append(fills(rng, [same], noise_m=noise, **law)[0])
    mixed = learn_mixture([joined(parts)])
    factor = mixed.scale[:, 0] * mixed.widen
    np.testing.assert_array_equal(mixed.length, [2, 25])
    assert factor[1] == pytest.approx(2, rel=0.2)
    assert factor[0] == pytest.approx(2, rel=0.35)


def test_a_prior_that_is_far_off_gives_way():
    """A model states a tenth of its errors, behind measurements that err as much: eight gaps widen it by 10, to 30 %.

    How far mean squares of gaps differ is taken in units of what errors show: in units of what is stated they would
    seem to tell nothing, and the width would stay at the prior's 1.
    """
    rng = np.random.default_rng(19)
    law = {"stated": [lambda n: 0.1 * same(n)], "per_gap": 0.5, "noise_m": 5e-3}
    mixed = learn_mixture(fills(rng, [same], n_gaps=2, **law))
    np.testing.assert_allclose(mixed.scale[:, 0] * mixed.widen, 10, rtol=0.3)


def test_few_gaps_are_not_believed_alone():
    """One gap of 100 frames that happened to be filled ten times too well hardly narrows the intervals there.

    It counts 1 / (1 + 12), for the scale: 0.1^(1/13) = 0.84 of the others'.
    """
    rng = np.random.default_rng(6)
    many = fills(rng, [same], n_gaps=60)[0]
    keep = (many.length < 100) | (many.gap == many.gap.max())
    lucky = np.where((many.length == 100)[:, None], 0.1 * many.error_m, many.error_m)
    kept = {name: getattr(many, name)[keep] for name in ("variance", "noise", "gap", "length")}
    mixed = learn_mixture([Residuals(error_m=lucky[keep], **kept)])
    factor = mixed.scale[:, 0] * mixed.widen
    assert factor[3] == pytest.approx(0.84, rel=0.1)
    np.testing.assert_allclose(factor[:3], 1, atol=0.1)


def test_models_that_say_the_same_share_alike():
    """K copies of one model: no offset is worth its penalty, and the mixture fills as each of them does."""
    one = fills(np.random.default_rng(7), [short])[0]
    mixed = learn_mixture([one] * 3)
    np.testing.assert_allclose(mixed.offset, 0, atol=1e-4)
    np.testing.assert_allclose(mixed.slope, 0, atol=1e-4)
    np.testing.assert_allclose(mixed_by_combine(mixed, [one] * 3).error_m, one.error_m, rtol=1e-9)


def test_gaps_of_one_length():
    """Trials that have room for one length only are enough; another length takes its widths."""
    mixed = learn_mixture(fills(np.random.default_rng(8), [short, long], frames=np.array([25.0])))
    assert mixed.scale.shape == (1, 2)
    assert len(set(mixed.widening(np.array([1, 25, 400])))) == 1


@pytest.mark.parametrize("larger", [0.5, 1.0, 3.0])
def test_intervals_hold_in_another_recording(larger):
    """Errors half or three times as large as in training: intervals hold 95 % after its own gaps were seen.

    Its 240 gaps are 720 errors beside the 36 that what was learned counts as: of variances of 9 and 1 that makes 8.6
    (94.5 % inside), of 0.25 and 1 0.286 (96.4 %); of 7200 coordinates a share is known to 0.3 %.
    """
    rng = np.random.default_rng(9)
    mixed = learn_mixture(fills(rng, [short, long], n_gaps=200))

    def recording():
        parts = fills(rng, [short, long], n_gaps=60)
        return [replace(part, error_m=larger * part.error_m) for part in parts]

    own = mixed_by_combine(mixed.calibrated(recording()), recording())
    inside = np.abs(own.error_m) <= 1.959964 * np.sqrt(own.variance)
    assert inside.mean() == pytest.approx(0.95, abs=0.02)


def test_a_model_that_fails_in_a_recording_weighs_less_there():
    """Two that are alike in training, of which one errs four times as much in the recording: it weighs a sixteenth."""
    rng = np.random.default_rng(10)
    mixed = learn_mixture(fills(rng, [same, same], n_gaps=200))
    good, bad = fills(rng, [same, same], n_gaps=60)
    own = mixed.calibrated([good, replace(bad, error_m=4 * bad.error_m)])
    ratio = (own.scale / mixed.scale)[:, 1] / (own.scale / mixed.scale)[:, 0]
    np.testing.assert_allclose(ratio, 4.0, rtol=0.1)
    weight = own.weights((own.scale[0] ** 2)[:, None], np.array([10]))
    before = mixed.weights((mixed.scale[0] ** 2)[:, None], np.array([10]))
    assert weight[1] / weight[0] / (before[1] / before[0]) == pytest.approx(4.0**-2, rel=0.2)


def test_what_was_refused_is_no_surer_than_what_was_not_seen():
    """Six frames of one marker were refused, those of another were not seen: both are as uncertain, 6 times as stated.

    Where a second model, very sure of itself, believed what was refused, positions stay those of the one that did not.
    """
    frames, seen = np.arange(20), np.ones((20, 2), dtype=bool)
    gap = (frames >= 7) & (frames < 13)
    seen[gap, 1] = False
    xyz = np.where(seen[..., None], 1.0, np.nan) * np.ones(3)
    trial = MarkerTrial(name="a", t_s=frames / 100, xyz_m=xyz, sd_m=np.full((20, 2), 1e-3))
    observed = [
        Observed(
            where=np.array([[WHOLE, m] for m in np.flatnonzero(seen[t])]),
            innovation=np.zeros((seen[t].sum(), 3)),
            weight=np.ones(seen[t].sum()) * ~gap[t],
            nis=0.0,
            n_rows=3,
            log_likelihood=0.0,
        )
        for t in frames
    ]
    cov = np.broadcast_to(1e-6 * np.eye(3), (20, 2, 3, 3))
    pose = Estimate(xyz_m=np.zeros((20, 2, 3)), cov_m2=cov, observed=observed)
    other = Estimate(xyz_m=np.ones((20, 2, 3)), cov_m2=1e-6 * cov)
    rng = np.random.default_rng(19)
    none = np.zeros(seen.shape, dtype=bool)
    alone = Members(found=(pose,), recording=trial, placed=none)
    found = alone.mixed(mixture(1, rng, scale=np.full((4, 1), 2.0), widen=3.0)).markers
    np.testing.assert_allclose(found.cov_m2[gap], 36 * cov[gap], rtol=1e-12)
    np.testing.assert_array_equal(found.cov_m2[~gap], cov[~gap])
    both = Members(found=(other, pose), recording=trial, placed=none).mixed(mixture(2, rng, widen=3.0)).markers
    np.testing.assert_array_equal(both.xyz_m[:, 0], 0)
    np.testing.assert_allclose(both.cov_m2[gap, 0], 9 * cov[gap, 0], rtol=1e-12)
    placed = none.copy()
    placed[gap, 1] = True  # by its rigid body: as certain as that says
    rigid = Members(found=(other, pose), recording=trial, placed=placed).mixed(mixture(2, rng, widen=3.0)).markers
    np.testing.assert_array_equal(rigid.xyz_m[:, 1], pose.xyz_m[:, 1])
    np.testing.assert_array_equal(rigid.cov_m2[gap, 1], cov[gap, 1])
    np.testing.assert_array_equal(rigid.cov_m2[gap, 0], both.cov_m2[gap, 0])
