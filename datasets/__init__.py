"""Synthetic recordings with known truth, made from a random seed (part of eal-mocap).

``datasets.bat(seed=0)`` flies and ``datasets.lizard(seed=0)`` walks: markers with their truth, cameras, pixels.
"""

from datasets.bats import make_bat
from datasets.folder import read_truth, write_recording
from datasets.lizards import make_lizard
from datasets.observe import PERFECT, Digitiser
from datasets.recording import SyntheticRecording

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
