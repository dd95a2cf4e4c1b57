"""The figures of the EAL paper, reproduced with a verdict for every claim.

The number of a figure and a seed come in. Images, tables and verdicts go out. It touches the result folder.
"""

from mocap.reproduce.figures import FIGURES, reproduce
from mocap.reproduce.record import Verdict

__all__ = ["FIGURES", "Verdict", "reproduce"]
