"""The figures of the EAL paper, reproduced with a verdict for every claim."""

from mocap.reproduce.figures import FIGURES, reproduce
from mocap.reproduce.record import Verdict

__all__ = ["FIGURES", "Verdict", "reproduce"]
