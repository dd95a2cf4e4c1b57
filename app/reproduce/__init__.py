"""The figures of the EAL paper, reproduced with a verdict for every claim."""

from app.reproduce.record import Verdict
from app.reproduce.run import FIGURES, reproduce

__all__ = ["FIGURES", "Verdict", "reproduce"]
