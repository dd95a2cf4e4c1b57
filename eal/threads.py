"""One BLAS thread where matrices are small: two threads that wait for each other took ten times as long."""

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[Any]:
    """A context in which BLAS runs on one thread; entering it costs some microseconds."""
    return _controller().limit(limits=1, user_api="blas")


@cache
def _controller() -> ThreadpoolController:
    """The BLAS libraries of this process, looked up once: NumPy's and SciPy's are loaded by then."""
    return ThreadpoolController()
