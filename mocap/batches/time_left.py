"""The time that is left of a batch, by what its samples took so far."""

from collections.abc import Mapping
from statistics import median

from mocap.progress import Tell, as_one

TRACKED = "track"
SECONDS = {
    "read, triangulate, clean": 2.0,
    "check points of two rays": 8.0,
    TRACKED: 16.0,
    "joints and potentials": 2.5,
    "write": 2.0,
}
"""Processor time of the stages of ``mocap track``: the mean of six flights of bats, of 10 to 51 s."""
LEAST = 0.3
"""Of a trial: how long a smaller part took says little of the whole."""


def told_whole(tell: Tell) -> Tell:
    """Progress of the stages of ``mocap track`` as the stage and the share of the whole that is done."""
    now, most = "", 0.0

    def told(_name: str, share: float) -> None:
        nonlocal most
        most = max(most, share)  # some trials are tracked a second time
        tell(now, most)

    whole = as_one(told, "", SECONDS)

    def said(stage: str, share: float) -> None:
        nonlocal now
        now = stage
        whole(TRACKED if stage.startswith(TRACKED) else stage, share)

    return said


def time_left(
    samples: Mapping[str, int],
    took_s: Mapping[str, float],
    works: Mapping[str, tuple[float, float]],
    *,
    workers: int,
) -> float | None:
    """Seconds that are left; None: too early to say, or nothing is.

    Trials take time as they have samples, measured on flights of 800 to 3800: 9 to 17 ms each.

    Args:
        samples: How many each trial has that has ended, is tracked or waits; 0: not known, as the middle of the others.
        took_s: What those took that have ended.
        works: Since how many seconds those are tracked that are, and the share of each that is done.
        workers: How many are tracked at a time.
    """
    middle = median([n for n in samples.values() if n] or [1])
    effort = {name: n or middle for name, n in samples.items()}
    shares = {name: 1.0 for name in took_s} | {name: share for name, (_, share) in works.items()}
    if sum(shares.values()) < LEAST:
        return None
    spent_s = sum(took_s.values()) + sum(since_s for since_s, _ in works.values())
    rate = spent_s / sum(share * effort[name] for name, share in shares.items())
    left = [rate * n * (1 - shares.get(name, 0.0)) for name, n in effort.items()]
    return max(sum(left) / max(workers, 1), *left) or None
