"""Fixtures of the EAL tests."""

import numpy as np
import pytest

from eal.threads import one_blas_thread


@pytest.fixture
def rng():
    return np.random.default_rng(20240607)


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    """Small matrices: two BLAS threads on a busy machine take ten times as long as one."""
    with one_blas_thread():
        yield
