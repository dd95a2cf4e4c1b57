"""DISK (Rose et al. 2025, Nature Methods): networks that learn to fill gaps, trained for few steps on processors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.gaps.method import Filler, Trial
from benchmarks.gaps.peers.coordinates import learn_body
from benchmarks.gaps.peers.released.make_env import ENV
from benchmarks.gaps.peers.released.process import run
from benchmarks.gaps.peers.released.tools import ToolFiller


def installed() -> bool:
    """Whether the environment has it (``make_env --disk``)."""
    return any(any(ENV.glob(f"{lib}/site-packages/DISK")) for lib in ("lib/python*", "Lib"))


@dataclass(frozen=True)
class Disk:
    """DISK's own training and defaults on positions in body coordinates, windows of 60 frames.

    Attributes:
        network: Of its networks.
        steps: Of the optimiser, in batches of 8 windows: the same for any number of trials, rounded to whole epochs.
    """

    network: Literal["transformer", "gru"]
    steps: int

    @property
    def name(self) -> str:
        """For the table."""
        return f"disk_{self.network}"

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Train it; the last 72 frames of each trial decide which epoch is kept."""
        body = learn_body(training)
        y = [1e3 * body.place(trial).y for trial in training]
        more = {"network": self.network, "steps": self.steps, "lengths": [len(part) for part in y]}
        folder, _ = run("disk_train", np.concatenate(y), 1e3 * training[0].sd_m, more)
        return ToolFiller("disk", body, {"network": self.network, "folder": str(folder)})
