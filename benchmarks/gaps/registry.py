"""All methods of the benchmark."""

import sys
from functools import cache
from importlib.util import find_spec

from benchmarks.gaps.method import Method
from benchmarks.gaps.peers import peers


@cache
def methods() -> tuple[Method, ...]:
    """Peers, then ours.

    Raises:
        ValueError: two have the same name.
    """
    found = peers()
    if find_spec("benchmarks.gaps.ours") is not None:
        from benchmarks.gaps.oracle import EalOracle
        from benchmarks.gaps.ours import alone, ours

        found = [*found, *ours(), EalOracle(), *alone()]
    else:
        print("benchmarks.gaps.ours is not there: peers only", file=sys.stderr)
    names = [method.name for method in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"methods with the same name: {', '.join(twice)}: rename one")
    return tuple(found)
