"""Joint potentials of many trials by map and reduce: three rounds over trials, of which one at a time is in memory."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.choice import Choice
from eal.potential import EmpiricalPotential
from eal.sums import Landmarks, PotentialSums, choose_landmarks, sums_of, total
from mocap.errors import MocapError
from mocap.tracking.potentials import FEWEST, FRAME, NAMES, JointPotential, settings


@dataclass(frozen=True, kw_only=True)
class LeftOutTrials:
    """How well a potential knows trials that it was not learned from.

    Attributes:
        trials: The trials that were left out together: one, or all of an animal.
        samples: Their samples.
        value: Mean of V_z at these: 0 where the others' poses are theirs, 1 where none is.
        own: The same, of the potential that was learned from them, too.
    """

    trials: tuple[str, ...]
    samples: int
    value: float
    own: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ManyTrials:
    """What many trials say of one joint.

    Attributes:
        joint: Joint name.
        frame: Frame of reference of the coordinates.
        scale_m: Metres a unit of the potential's coordinates.
        sums: What each trial says, by its name.
        sketch_m: (n, d) some samples of all trials, in metres.
        choice: Metric, kernel and lambda under which trials left out are likeliest.
    """

    joint: str
    frame: str
    scale_m: float
    sums: Mapping[str, PotentialSums]
    sketch_m: Array
    choice: Choice

    def potential(self, without: Sequence[str] = ()) -> JointPotential:
        """V_z of all trials, or of all but some.

        Raises:
            MocapError: there is no such trial, or no other.
        """
        odd = [name for name in without if name not in self.sums]
        if odd or len(set(without)) == len(self.sums):
            raise MocapError(f"cannot leave out {', '.join(odd or without)}: the trials are {', '.join(self.sums)}")
        found = self._fitted(total(part for name, part in self.sums.items() if name not in without))
        shown = self.sketch_m[:: max(1, len(self.sketch_m) // 2000)]  # samples to draw a potential with
        return JointPotential(
            joint=self.joint,
            frame=self.frame,
            samples_m=shown,
            potential=found,
            scale_m=self.scale_m,
            choice=self.choice,
        )

    def _fitted(self, sums: PotentialSums) -> EmpiricalPotential:
        names = NAMES[: self.sketch_m.shape[1]]
        return sums.potential(lam=self.choice.lam, names=names, units=(f"{self.scale_m:.6g} m",) * len(names))

    def left_out(self, animals: Mapping[str, Hashable] | None = None) -> list[LeftOutTrials]:
        """Each trial, or all trials of each animal, by the potential of the others: from the sums alone.

        Args:
            animals: The animal of each trial; None: each trial by itself.

        Raises:
            MocapError: there is one trial, or one animal.
        """
        groups: dict[Hashable, list[str]] = {}
        for name in self.sums:
            groups.setdefault(name if animals is None else animals[name], []).append(name)
        if len(groups) < 2:
            raise MocapError("leaving out needs two trials, or two animals, at least")
        whole = total(self.sums.values())
        every, out = self._fitted(whole), []
        for names in groups.values():
            part = total(self.sums[name] for name in names)
            others = self._fitted(whole - part)
            value, own = part.mean_value(others), part.mean_value(every)
            out.append(LeftOutTrials(trials=tuple(names), samples=int(part.total), value=value, own=own))
        return out


def learn_joints(names: Sequence[str], trial: Callable[[str], Mapping[str, Array]]) -> dict[str, ManyTrials]:
    """Learn the potential of each joint from all samples of many trials.

    First round: some samples of each trial, which give scale, kernel and lambda: those under which a trial is likeliest
    by the others. Second: the pivots of each trial, whose kernels span those of all its samples; landmarks are the
    pivots of all pivots. Third: sums over all samples of each trial. A trial is asked for three times, and forgotten
    each time; what is kept of it is a matrix.

    Args:
        names: Of the trials.
        trial: Name to samples of each joint, (N, d) in metres (``joint_samples``).

    Raises:
        MocapError: no joint has samples enough.
    """
    sketches: dict[str, list[Array]] = {}
    owners: dict[str, list[str]] = {}
    for name in names:
        for joint, samples in trial(name).items():
            # samples of a joint and trial that choose scale and kernel for all trials
            few = samples[np.linspace(0, len(samples) - 1, min(len(samples), 40)).astype(int)]
            sketches.setdefault(joint, []).append(few)
            owners.setdefault(joint, []).extend([name] * len(few))
    scales: dict[str, float] = {}
    chosen: dict[str, Choice] = {}
    whole = {joint: np.concatenate(parts) for joint, parts in sketches.items()}
    for joint, sketch in whole.items():
        if len(sketch) >= FEWEST:
            scales[joint], chosen[joint] = settings(sketch, owners[joint])
    if not chosen:
        raise MocapError(f"no joint was measured in {FEWEST} frames of these trials")
    pivots: dict[str, list[Array]] = {joint: [] for joint in chosen}
    for name in names:
        for joint, samples in trial(name).items():
            if joint in chosen and len(samples):
                pivots[joint].append(_landmarks(chosen[joint], samples / scales[joint]).centres)
    marks = {joint: _landmarks(chosen[joint], np.concatenate(parts)) for joint, parts in pivots.items()}
    sums: dict[str, dict[str, PotentialSums]] = {joint: {} for joint in marks}
    for name in names:
        for joint, samples in trial(name).items():
            if joint in marks and len(samples):
                sums[joint][name] = sums_of(marks[joint], samples / scales[joint])
    return {
        joint: ManyTrials(
            joint=joint,
            frame=FRAME,
            scale_m=scales[joint],
            sums=sums[joint],
            sketch_m=whole[joint],
            choice=chosen[joint],
        )
        for joint in marks
    }


def _landmarks(chosen: Choice, samples: Array) -> Landmarks:
    return choose_landmarks(chosen.kernel, samples, lam=chosen.lam, max_rank=400)
