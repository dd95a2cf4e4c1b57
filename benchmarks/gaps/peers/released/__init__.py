"""Tools run as released, in an environment of their own (``make_env``), each skipped with a line where it is absent.

| method | what runs | tuned |
|---|---|---|
| ``pose2sim_kalman`` | pose2sim 0.10: interpolation of gaps, then its Kalman smoother | interpolation, trust ratio |
| ``pose2sim_butterworth`` | the same with its Butterworth filter | interpolation, cutoff |
| ``pykalman`` | pykalman 0.11: constant velocity of a marker, EM and smoother | factor on the covariance EM finds |
| ``eks`` | ensemble-kalman-smoother 4.6: a marker's random walk, its own optimiser for s | - |
| ``eks_pca`` | the same on principal components of all markers (its multi-camera form) | components |
| ``anipose`` | aniposelib 0.8: ``optim_points`` of what virtual cameras see | smoothness and its derivative |

DISK (``disk``) is trained for minutes on each set of trials: it is run by ``benchmarks.gaps.learning_curve`` alone.

Everything installs with pip; pose2sim only without its dependencies, its filters do not need them. pose2sim's
``kalman_filter_1d`` and ``butterworth_filter_1d`` skip gaps by themselves, so it fills as its pipeline does: by
interpolation, before. EKS wants the variance of an ensemble of networks; it is given that of the measurement, and a
metre where a sample is hidden. aniposelib optimises points under smoothness and bone lengths against pixels; it is
given what three virtual cameras, a pixel a standard deviation, see of the measured points.

The tools compute in another process: the time a frame that the benchmark takes is that of handing over.
"""

import sys

from benchmarks.gaps.method import Method
from benchmarks.gaps.peers.released.make_env import interpreter
from benchmarks.gaps.peers.released.tools import tools


def peers() -> list[Method]:
    """The tools, none where their environment is absent."""
    found = tools()
    if interpreter().exists():
        return list(found)
    for method in found:
        print(f"{method.name}: skipped, run python -m benchmarks.gaps.peers.released.make_env", file=sys.stderr)
    return []
