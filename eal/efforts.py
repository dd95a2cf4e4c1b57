"""How far a whole is, from how far its parts are, and what time each of them takes beside the others."""

from collections.abc import Callable, Sequence
from functools import partial
from heapq import heapreplace
from itertools import accumulate
from typing import Any

Progress = Callable[[float], None]
"""Called with the share done, from 0 to 1."""
Call = Callable[..., Any]
"""Takes ``progress``, a ``Progress`` or None; may be made in another process."""
CallAll = Callable[[Sequence[Call], Progress | None], list[Any]]
"""What calls that do not wait for each other return, in their order (``in_turn``); it may make them side by side."""


def shares(progress: Progress | None, efforts: Sequence[float]) -> list[Progress | None]:
    """What each of several parts, one after the other, calls with its own share done.

    Args:
        progress: Called with the share done of the whole.
        efforts: Time that each part takes; only their ratios count.
    """
    begins, whole = [*accumulate(efforts, initial=0.0)], sum(efforts)

    def tell(part: int, share: float) -> None:
        if progress is not None:
            progress((begins[part] + share * efforts[part]) / whole)

    return [None if progress is None else partial(tell, part) for part in range(len(efforts))]


def shares_beside(progress: Progress, efforts: Sequence[float], count: int) -> Callable[[int, float], None]:
    """What is called with a part and its share done, where ``count`` of them are made at a time, in their order.

    The whole is done by the time that it still takes so: a part that is left over at the end keeps one of ``count``
    busy alone.

    Args:
        progress: Called with the share done of the whole, which never falls.
        efforts: Time that each part takes; only their ratios count.
        count: Of parts that are made at a time.
    """
    left, whole, told = [*efforts], time_of(efforts, count), 0.0

    def tell(part: int, share: float) -> None:
        nonlocal told
        left[part] = min(left[part], (1.0 - share) * efforts[part])
        told = max(told, 1.0 - time_of([one for one in left if one], count) / whole)
        progress(told)

    return tell


def time_of(efforts: Sequence[float], count: int) -> float:
    """The time in which parts are done, ``count`` at a time, each begun as soon as another ends."""
    ends = [0.0] * count
    for effort in efforts:
        heapreplace(ends, ends[0] + effort)
    return max(ends)


def with_effort(call: Any, effort: float) -> Call:
    """A call (a partial function) that says how much time it takes beside others; it keeps that where it travels."""
    call.effort = effort
    return call


def efforts_of(calls: Sequence[Call]) -> list[float]:
    """Time that each of some calls takes beside the others, as far as they say it."""
    return [getattr(call, "effort", 1.0) for call in calls]


def in_turn(calls: Sequence[Call], progress: Progress | None = None) -> list[Any]:
    """What calls return, made one after the other.

    Args:
        calls: See ``Call``.
        progress: Called with the share done of all of them together.
    """
    return [call(progress=tell) for call, tell in zip(calls, shares(progress, efforts_of(calls)), strict=True)]
