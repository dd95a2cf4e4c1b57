"""Synthetic recordings with known truth, made from a random seed (part of eal-mocap).

``mocap.datasets.bat(seed=0)`` flies and ``mocap.datasets.lizard(seed=0)`` walks: markers with ground truth, cameras,
pixels.

A seed comes in. A video with its ground truth goes out. It touches a file only where a video is written for others.
"""

if __name__ == "datasets":  # the folder at the repository's root; it is installed as mocap.datasets
    from eal.same_module import hand_over

    hand_over(__name__)

from mocap.datasets.bats import make_bat
from mocap.datasets.film import SyntheticRecording
from mocap.datasets.folder import read_truth, write_recording
from mocap.datasets.lizards import make_lizard
from mocap.datasets.observe import PERFECT, Digitiser

bat, lizard = make_bat, make_lizard

__all__ = [
    "PERFECT",
    "Digitiser",
    "SyntheticRecording",
    "bat",
    "lizard",
    "make_bat",
    "make_lizard",
    "read_truth",
    "write_recording",
]
