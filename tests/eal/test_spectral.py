"""Spectral filters: values by hand, and what they do with rounding below zero."""

import numpy as np
import pytest

from eal import Projection, Tail, Tikhonov
from eal.spectral import effective_lambda

SIGMA = np.array([0.5, 0.1, 0.01, 0.0, -1e-17])


def test_tail_is_equation_30_with_a_rule_below_zero():
    np.testing.assert_allclose(Tail().gain(SIGMA, 0.1), [2.0, 10.0, 10.0, 10.0, 10.0])
    np.testing.assert_allclose(Tail().response(SIGMA, 0.1), [1.0, 1.0, 0.1, 0.0, 0.0])


def test_projection_keeps_modes_above_lambda_whole():
    np.testing.assert_allclose(Projection().gain(SIGMA, 0.05), [2.0, 10.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(Projection().response(SIGMA, 0.05), [1.0, 1.0, 0.0, 0.0, 0.0])


def test_tikhonov_damps_every_mode():
    np.testing.assert_allclose(Tikhonov().gain(SIGMA, 0.1), [1 / 0.6, 5.0, 1 / 0.11, 10.0, 10.0])
    np.testing.assert_allclose(Tikhonov().response(SIGMA, 0.1), [5 / 6, 0.5, 1 / 11, 0.0, 0.0])


def test_gram_scaling_is_lambda_over_n():
    assert effective_lambda(1e-3, 400.0, "gram") == pytest.approx(2.5e-6)
    assert effective_lambda(1e-3, 400.0, "mean") == 1e-3
    with pytest.raises(ValueError, match="scaling must be one of mean, gram"):
        effective_lambda(1e-3, 400.0, "none")  # type: ignore[arg-type]
