"""Joint potentials of many results."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from eal.arrays import Array
from mocap.errors import MocapError
from mocap.results.stored import read_recording
from mocap.tracking.many import ManyTrials
from mocap.tracking.many import learn_joints as learn
from mocap.tracking.potentials import FRAME, joint_samples


def learn_joints(folders: Sequence[str | PathLike[str]]) -> dict[str, ManyTrials]:
    """Learn the potential V_z of each joint from all results that ``mocap track`` wrote into these folders.

    One result at a time is in memory, and read three times (``mocap.tracking.many``). Of what is returned
    ``potential()`` is that of all trials, ``potential(without=[...])`` that of some, and ``left_out()`` tells how well
    the others know each trial, or each animal; kernel and lambda are those under which trials left out are likeliest.

    Args:
        folders: Of the results; their names are those of the trials.

    Raises:
        MocapError: two folders have one name, or no joint was measured often enough.
        FormatError: a folder holds no result.
    """
    paths = {Path(folder).name: Path(folder) for folder in folders}
    if len(paths) < len(folders):
        raise MocapError(f"{len(folders)} folders have {len(paths)} names: give results that are named differently")

    def trial(name: str) -> dict[str, Array]:
        run = read_recording(paths[name])
        return joint_samples(run.joints_m(FRAME), run.tracks, run.skeleton)

    return learn(list(paths), trial)
