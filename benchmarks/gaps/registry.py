"""All methods of the benchmark."""

from functools import cache

from benchmarks.gaps.method import Method
from benchmarks.gaps.oracle import EalOracle
from benchmarks.gaps.ours import alone, ours
from benchmarks.gaps.peers import peers


@cache
def methods() -> tuple[Method, ...]:
    """Peers, then ours."""
    return (*peers(), *ours(), EalOracle(), *alone())
