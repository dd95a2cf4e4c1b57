"""What others use to fill gaps, each as good as we can make it: one family a file.

Every peer works in body coordinates where that helps it, learns from the training trials and the test trial's own
visible samples, and has its one to three main hyper-parameters chosen on hidden gaps of training trials.
"""

from benchmarks.gaps.method import Method
from benchmarks.gaps.peers import (
    anipose_3d,
    gaussian,
    gplvm,
    interpolation,
    kalman,
    low_rank,
    manifold,
    neighbours,
    pca,
    rays,
)


def peers() -> list[Method]:
    """All peers, simple ones first."""
    families = (interpolation, kalman, rays, anipose_3d, low_rank, pca, neighbours, gaussian, manifold, gplvm)
    return [method for family in families for method in family.peers()]
