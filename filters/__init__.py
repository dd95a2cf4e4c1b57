"""Tracking: what cameras see, and how animals move (of eal-mocap).

Pixels or positions come in, as arrays, and trials to learn from. Positions, velocities and joint angles go out, with
their covariances. It touches no file.

``UnscentedKalmanFilter`` takes a person's own model, under filterpy's names.
"""

if __name__ == "filters":  # the folder at the repository's root; it is installed as mocap.filters
    from eal.same_module import hand_over

    hand_over(__name__)

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from filterpy.kalman import MerweScaledSigmaPoints
    from mocap.filters.unscented import UnscentedKalmanFilter

__all__ = ["MerweScaledSigmaPoints", "UnscentedKalmanFilter"]

_PLACES = {"MerweScaledSigmaPoints": "filterpy.kalman", "UnscentedKalmanFilter": "mocap.filters.unscented"}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for."""
    if name not in _PLACES:
        raise AttributeError(f"module 'mocap.filters' has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return found
