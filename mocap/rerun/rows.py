"""Views in rows that leave no cell empty: the last row shares its width among what is left."""

from collections.abc import Sequence
from math import ceil, sqrt

import rerun.blueprint as rrb


def rows(views: Sequence[rrb.View], *, columns: int | None = None, name: str | None = None) -> rrb.Container:
    """Views from left to right and from top to bottom.

    Args:
        views: At least one.
        columns: Views in a row; None: about as many as there are rows.
        name: Of the whole.
    """
    across = ceil(sqrt(len(views))) if columns is None else columns
    parts = [views[i : i + across] for i in range(0, len(views), across)]
    return rrb.Vertical(*(part[0] if len(part) == 1 else rrb.Horizontal(*part) for part in parts), name=name)
