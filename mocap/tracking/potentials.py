"""The empirical potential of each joint, in the plane of its limb."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eal.archive import ArchiveError
from eal.arrays import Array, short_repr
from eal.choice import Choice, choose
from eal.plot import plot_potential
from eal.potential import EmpiricalPotential, fit_potential, load_potential
from mocap.errors import FormatError
from mocap.findings import Finding
from mocap.joints import FRAMES
from mocap.json_records import AGAIN, plain, record
from mocap.parts import of_the_whole
from mocap.records import MarkerTracks, Status
from mocap.schema import POSITIVE, Entry, Schema, checked
from mocap.skeleton import Skeleton
from mocap.text import file_names
from mocap.tracking.joint_map import JointMap, draw_map, joint_map

FRAME = "limb"
"""Frame of reference in which joints have two coordinates."""
SPACE = "body"
"""Frame of reference in which joints have three coordinates."""
NAMES = ("along", "across", "third")
FEWEST, MOST = 30, 500
"""Samples below which a potential says more about their number than about the joint; of more, evenly spaced ones.
Chosen; time goes with the cube of their number."""


PLANAR, SPATIAL = "potentials", "spatial_potentials"
"""Folders of potentials in the planes of limbs, and in the three coordinates of the body."""
_POTENTIAL: Schema = {"frame": Entry(kind="s", words=FRAMES), "scale_m": Entry(least=POSITIVE)}
_CHOICE: Schema = {
    "metric": Entry(kind="s"),
    "width": Entry(least=POSITIVE),
    "weight": Entry(least=POSITIVE),
    "log_likelihood": Entry(),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class JointPotential:
    """The empirical potential V_z of one joint: 0 where it was seen, 1 far from there (EAL paper, equation 14).

    Attributes:
        joint: Joint name.
        frame: Frame of reference of the coordinates (see ``mocap.joints``).
        samples_m: (N, d) coordinates in metres; d = 2 in the planes of a limb, 3 in the body.
        potential: V_z on coordinates divided by ``scale_m``.
        scale_m: Metres a unit of the potential's coordinates.
        choice: How its kernel and lambda were chosen; None: it was not, or a version that did not keep it wrote it.
    """

    joint: str
    frame: str
    samples_m: Array
    potential: EmpiricalPotential
    scale_m: float
    choice: Choice | None = None

    __repr__ = short_repr

    def value(self, q_m: ArrayLike) -> Array:
        """V_z at (..., d) coordinates in metres: (...) values between 0 (where the joint was seen) and 1."""
        return self.potential.value(np.asarray(q_m) / self.scale_m)

    def gradient(self, q_m: ArrayLike) -> Array:
        """Gradient of V_z in 1/m at (..., d) coordinates in metres."""
        return self.potential.gradient(np.asarray(q_m) / self.scale_m) / self.scale_m

    def hessian(self, q_m: ArrayLike) -> Array:
        """Hessian of V_z in 1/m^2, (..., d, d), at (..., d) coordinates in metres."""
        return self.potential.hessian(np.asarray(q_m) / self.scale_m) / self.scale_m**2

    @cached_property
    def map(self) -> JointMap:
        """What is seen in its plane: where it was often and never, its edge, both segments, angles.

        Raises:
            ValueError: it has more than two coordinates.
        """
        if self.samples_m.shape[1] != 2:
            raise ValueError(
                f"a potential of {self.samples_m.shape[1]} coordinates has no map: take that in the plane of the limb, "
                "or fix all but two and draw value() of these"
            )
        return joint_map(self.joint, self.potential, self.samples_m, self.scale_m)

    def at(self, *, degrees: ArrayLike) -> Array:
        """V_z at angles of flexion, of which 0 is straight, with the segment as long as it is in half of the samples.

        Args:
            degrees: (...) angles; negative ones are beyond straight.

        Returns:
            (...) values between 0 (where the joint was seen) and 1.

        Raises:
            ValueError: it has more than two coordinates.
        """
        angle = np.radians(degrees)
        return self.value(self.map.length_mm / 1e3 * np.stack([np.cos(angle), np.sin(angle)], axis=-1))

    def plot(self, ax: Any = None, *, expert: bool = False) -> Any:
        """Map in the plane of the limb: yellow where the joint was often, violet where it never was; returns its axes.

        Args:
            ax: Matplotlib axes to draw on; None: new ones.
            expert: Coordinates in mm, the standard deviation of V_z, kernel, lambda and rank in its place.

        Raises:
            ValueError: it has more than two coordinates.
        """
        from matplotlib import pyplot

        ax = pyplot.subplots(figsize=(5.4, 5.6), layout="constrained")[1] if ax is None else ax
        found = self.map
        if not expert:
            return draw_map(found, ax)
        plot_potential(self.potential, ax, scale=1e3 * self.scale_m, labels=("along the limb (mm)", "across (mm)"))
        v = self.potential
        how = f"lambda {v.sigma_lambda:.1g}, rank {v.effective_rank:.0f} of {len(v.samples)} samples"
        ax.set_title(f"{found.name}: V_z, {v.kernel!r}\n{how}", fontsize=7)
        return ax


@dataclass(frozen=True, eq=False, kw_only=True)
class Potentials:
    """The potentials of a recording's joints.

    Attributes:
        planar: By joint name, in the planes of limbs.
        spatial: The same in the three coordinates of the body.
        told: Why there are none.
    """

    planar: Mapping[str, JointPotential] = field(default_factory=dict)
    spatial: Mapping[str, JointPotential] = field(default_factory=dict)
    told: tuple[Finding, ...] = ()

    step: ClassVar[str] = "track"
    depends_on: ClassVar[tuple[str, ...]] = ("ModelChoice",)

    at = only = of_the_whole

    def findings(self) -> tuple[Finding, ...]:
        """What is told."""
        return self.told

    def to_file(self, folder: Path) -> dict[str, Any]:
        """What is chosen of each; kernels and samples go to a file each."""
        out: dict[str, Any] = {"told": plain(self.told)}
        for kind in (PLANAR, SPATIAL):
            of = self.planar if kind == PLANAR else self.spatial
            for file, one in zip(file_names(of), of.values(), strict=True):
                (folder / kind).mkdir(exist_ok=True)
                one.potential.save(folder / kind / f"{file}.npz")
            out[kind] = {
                name: {"frame": one.frame, "scale_m": one.scale_m, "choice": _chosen(one.choice)}
                for name, one in of.items()
            }
        return out

    @classmethod
    def of_file(cls, entries: Any, folder: Path, where: str) -> Self:
        """Read back."""
        if not isinstance(entries, dict):
            raise FormatError(f"{where}: expected a table: {AGAIN}")
        planar, spatial = (_of_file(entries.get(kind), folder, f"{where}: {kind}", kind) for kind in (PLANAR, SPATIAL))
        told = record(cls, {"told": entries.get("told", [])}, where).told
        return cls(planar=planar, spatial=spatial, told=told)


def _chosen(choice: Choice | None) -> dict[str, Any] | None:
    """How a kernel was chosen, without the kernel, which the potential has."""
    return None if choice is None else {name: getattr(choice, name) for name in _CHOICE}


def _of_file(found: Any, folder: Path, where: str, kind: str) -> dict[str, JointPotential]:
    """The potentials of a kind.

    Raises:
        FormatError: they are not as they were written.
    """
    if not isinstance(found, dict):
        raise FormatError(f"{where}: expected a table by names of joints: {AGAIN}")
    out, wanted = {}, 2 if kind == PLANAR else 3
    for (name, one), file in zip(found.items(), file_names(found), strict=True):
        entries = checked(f"{where}: {name}", one, _POTENTIAL, again=AGAIN)
        how = one.get("choice")
        try:
            potential = load_potential(folder / kind / f"{file}.npz")
        except ArchiveError as error:
            raise FormatError(f"{error}: {AGAIN}") from None
        if potential.dimension != wanted:
            raise FormatError(
                f"{folder / kind / file}.npz: has {potential.dimension} coordinates, expected {wanted}: {AGAIN}"
            )
        choice = None
        if how is not None:
            numbers = checked(f"{where}: {name}: choice", how, _CHOICE, again=AGAIN)
            own = {of: value[()] if of == "metric" else float(value) for of, value in numbers.items()}
            choice = Choice(kernel=potential.kernel, lam=potential.lam, **own)  # type: ignore[arg-type]
        scale_m = float(entries["scale_m"])
        out[name] = JointPotential(
            joint=name,
            frame=entries["frame"][()],
            scale_m=scale_m,
            samples_m=scale_m * potential.samples,
            potential=potential,
            choice=choice,
        )
    return out


def joint_potentials(
    joints_m: Mapping[str, Array],
    frame: str,
    markers: MarkerTracks,
    skeleton: Skeleton,
    *,
    trials: Sequence[int] | None = None,
) -> dict[str, JointPotential]:
    """Learn V_z of every joint from the frames in which its three markers were measured.

    Coordinates keep the joint's centre as their origin and are divided by their standard deviation. Metric, kernel and
    lambda are those under which the part of the recording that is left out is likeliest (``eal.choose``). Samples are
    what a smoother estimates: their standard deviations are no noise that could be taken out (``eal.fit_potential``).

    Args:
        joints_m: (T, d) coordinates of each joint, in two or three dimensions.
        frame: Their frame of reference.
        markers: Tracked markers; filled samples are not learned from.
        skeleton: Joints.
        trials: (T,) trial of each frame, where there are several; they are left out one at a time.

    Returns:
        Potentials by joint; joints with fewer than ``FEWEST`` samples are left out.
    """
    out = {}
    for name, ok, q_m in _measured(joints_m, markers, skeleton):
        if ok.sum() >= FEWEST:
            some = np.flatnonzero(ok)[np.linspace(0, ok.sum() - 1, min(ok.sum(), MOST)).astype(int)]
            out[name] = _potential(name, frame, q_m[some], [] if trials is None else [trials[i] for i in some])
    return out


def joint_samples(joints_m: Mapping[str, Array], markers: MarkerTracks, skeleton: Skeleton) -> dict[str, Array]:
    """(N, d) samples of each joint in metres: frames in which its three markers were measured."""
    return {name: q_m[ok] for name, ok, q_m in _measured(joints_m, markers, skeleton)}


def _measured(
    joints_m: Mapping[str, Array], markers: MarkerTracks, skeleton: Skeleton
) -> Iterator[tuple[str, NDArray[np.bool_], Array]]:
    """Of each joint: its name, in which frames its markers were measured, and its (T, d) coordinates."""
    measured = dict(zip(markers.names, (markers.status == Status.MEASURED).T, strict=True))
    for joint in (j for j in skeleton.joints if j.name in joints_m):
        ok = measured[joint.parent] & measured[joint.centre] & measured[joint.child]
        yield joint.name, ok & np.isfinite(joints_m[joint.name][:, 0]), joints_m[joint.name]


def settings(samples_m: Array, trials: Sequence[str | int]) -> tuple[float, Choice]:
    """Metres a unit of a joint's coordinates, and the kernel and lambda of its potential, however many trials it is of.

    Args:
        samples_m: (N, d) coordinates.
        trials: (N,) trial of each; none, or one alone: parts of the recording are left out in turn.
    """
    scale = max(float(np.sqrt(samples_m.var(axis=0).sum())), 1e-9)
    return scale, choose(samples_m / scale, trials=trials if len(set(trials)) > 1 else None)


def _potential(joint: str, frame: str, samples_m: Array, trials: Sequence[int]) -> JointPotential:
    scale, chosen = settings(samples_m, trials)
    scaled = samples_m / scale
    names, units = NAMES[: scaled.shape[1]], (f"{scale:.6g} m",) * scaled.shape[1]
    potential = fit_potential(scaled, kernel=chosen.kernel, lam=chosen.lam, names=names, units=units)
    # the samples as they are read back, to the last digit
    return JointPotential(
        joint=joint, frame=frame, samples_m=scale * scaled, potential=potential, scale_m=scale, choice=chosen
    )
