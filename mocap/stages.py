"""The stages of a long job: how far it is, and how long each took."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter


@dataclass(kw_only=True)
class Stages:
    """Times stages, and tells somebody how far the current one is.

    Attributes:
        tell: Called with the name of the stage and the share done.
        seconds: Time that each stage took.
    """

    tell: Callable[[str, float], None] = lambda _stage, _share: None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Time one stage; yields its progress callback."""
        start = perf_counter()
        self.tell(name, 0.0)
        yield lambda share: self.tell(name, share)
        self.tell(name, 1.0)
        self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start
