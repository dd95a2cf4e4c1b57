"""Recordings whose truth is known, made from a seed (of eal-mocap)."""

from datasets.bat import make_bat
from datasets.folder import read_truth, write_recording
from datasets.lizard import make_lizard
from datasets.observe import PERFECT, Digitiser
from datasets.recording import SyntheticRecording

__all__ = ["PERFECT", "Digitiser", "SyntheticRecording", "make_bat", "make_lizard", "read_truth", "write_recording"]
