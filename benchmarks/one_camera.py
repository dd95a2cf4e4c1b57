"""Whole flights from one camera alone, with poses learned from other flights.

    python -m benchmarks.one_camera [--quick] [--data FOLDER] --out DIR

Bats in a wind tunnel, digitised in four cameras (``bat_windtunnel_dltdv8``). Each camera of each flight is tracked by
itself by what ``mocap track`` runs; the reference is the same flight from all four, its lens fitted. Pixels are
corrected with that lens. ``DIR/table.csv`` has a row for each flight, camera, kind of teachers and method:

- ``trained_on``: ``same bat`` (its other flights of that day), ``other bat``, ``other day`` (where such flights exist);
- ``method``: the product with ``V_z``; a ``Gaussian`` or a ``kernel density`` in its place, or ``none``; ``V_z alone``
  and ``Gaussian alone``, without the lengths of bones that the others have; each frame
  alone with the ``nearest pose`` of the trials or the ``mean pose``, placed; and the ``subspace bound``, the shapes
  fitted to the reference's points;
- ``abs_rms_mm``, ``rel_rms_mm``, ``rel_median_mm`` (less the mean of a frame's markers), ``depth_rms_mm`` (along the
  line of sight); ``mirrored``: share of frames that fit better with depth relative to the body reversed;
- ``inside95_rel``, ``inside95_abs``: share of coordinates inside 95 % intervals, ``z_rel``, ``z_abs``: rms error over
  deviation. The reference errs, too: its stated variance is counted in (an elbow is at 96 mm from a wrist that is at
  40 in all other frames, and states 16 mm);
- ``empty``: share of the reference's frames that are called unlike the trials and stay empty. All else is of the rest.

The last lines compare methods, paired over cells, in percent of relative and absolute rms with standard errors.
"""

import argparse
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from mocap.datasets.real import folder
from mocap.filters.first_poses import settled, starts_of
from mocap.filters.misfit import Misfit
from mocap.filters.motion.potential import Bones
from mocap.filters.one_camera import Found, LeftOut, jitter_px, left_out, shown, track_views
from mocap.filters.one_view import Poses, Recorded, Views
from mocap.filters.pose_prior import Barrier, PosePrior, learn_prior
from mocap.filters.poses import MarkerTrial, poses_of
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from eal.arrays import Z95, Array
from mocap.cameras.origin import PixelOptions
from mocap.cleaning.cleaning import clean
from mocap.io.dvproject import read_project
from mocap.reading.ideal_pixels import of_pixels
from mocap.tracking.tracking import marker_trial, seen_frames

POINTS = (
    *("t3L", "wstL", "t5L", "elbL", "shdL", "ankL", "nl", "str"),
    *("lmb", "shdR", "ankR", "elbR", "wstR", "t5R", "t3R"),
)
TRUNK = ("str", "lmb", "nl", "shdL", "shdR", "ankL", "ankR")
FPS = 700
LEFT_WING = ("F1",)
"""Flights of which one wing alone was digitised teach none with both."""
QUICK = ((0, 2), ("F3", "F5"))
"""Cameras and flights of ``--quick``."""
COLUMNS = (
    *("flight", "camera", "trained_on", "method", "abs_rms_mm", "rel_rms_mm", "rel_median_mm", "depth_rms_mm"),
    *("mirrored", "inside95_rel", "inside95_abs", "z_rel", "z_abs", "empty"),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """A flight as all cameras see it.

    Attributes:
        bat: Animal.
        day: As its file names it.
        trial: Reference points.
        matrices: (4, 3, 4).
        uv_px: (4, T, M, 2) pixels without lens.
    """

    bat: str
    day: str
    trial: MarkerTrial
    matrices: Array
    uv_px: Array


@cache
def flight(path: Path) -> Flight:
    """One project."""
    project = read_project(path).with_rate(FPS)
    pixels = replace(project.pixels, names=POINTS, uv_px=project.pixels.uv_px[:, :, : len(POINTS)])
    options = PixelOptions(fit_lens=project.cameras[0].lens is None)
    film = of_pixels(pixels, project.cameras, name=path.parent.name, options=options)
    prepared = clean(film)
    frames = seen_frames(prepared)
    day = re.search(r"\d+ ?[A-Z][a-z]{2,8} ?\d{4}", path.stem)
    return Flight(
        bat=path.parent.parent.name,
        day="" if day is None else re.sub(r"([A-Z][a-z]{2})[a-z]*", r"\1", day[0]),
        trial=replace(marker_trial(prepared.at(frames)), name=path.parent.name),
        matrices=film.matrices,
        uv_px=film.ideal_px[:, frames],
    )


@dataclass(frozen=True, eq=False)
class Density:
    """Minus log of a kernel density of shapes, as wide as held-out shapes are likeliest (``pose_prior.Hold``)."""

    centres: Array
    beta: float

    def _apart(self, z: Array) -> tuple[Array, Array]:
        away = z[:, None] - self.centres
        return away, -self.beta * np.sum(away**2, axis=-1)

    def held_out(self, shapes: Array, folds: int = 5) -> float:
        """Mean log density of shapes (N, r) of which a fifth at a time is left out, with as many centres."""
        fold, every = np.arange(len(shapes)) * folds // len(shapes), max(1, len(shapes) // len(self.centres))
        parts = [replace(self, centres=shapes[fold != i][::every]) for i in range(folds)]
        log = [-part.value(shapes[fold == i]) - np.log(len(part.centres)) for i, part in enumerate(parts)]
        return float(np.mean(np.concatenate(log)) + 0.5 * shapes.shape[1] * np.log(self.beta))

    def value(self, z: Array) -> Array:
        """(S,)."""
        return -logsumexp(self._apart(z)[1], axis=1)

    def gradient(self, z: Array) -> Array:
        """(S, r)."""
        away, log = self._apart(z)
        return 2 * self.beta * np.einsum("sn,snr->sr", softmax(log, axis=1), away)

    def hessian(self, z: Array) -> Array:
        """(S, r, r)."""
        away, log = self._apart(z)
        share = softmax(log, axis=1)
        mean = np.einsum("sn,snr->sr", share, away)
        spread = np.einsum("sn,sna,snb->sab", share, away, away) - mean[:, :, None] * mean[:, None]
        return 2 * self.beta * (np.eye(z.shape[1]) - 2 * self.beta * spread)


def held(prior: PosePrior) -> dict[str, PosePrior]:
    """The prior with each potential."""
    barrier = prior.hold
    assert isinstance(barrier, Barrier)
    beta = float(barrier.potential.kernel.curvature) / 2  # of a Gaussian kernel: 2 beta
    nothing = Bones(ends=prior.bones.ends[:0], length_m=prior.bones.length_m[:0], sd_m=prior.bones.sd_m[:0])
    wide = [Density(barrier.potential.centres, beta * 4.0**k) for k in range(6)]
    return {
        "V_z": prior,
        "Gaussian": replace(prior, hold=prior.gaussian()),
        "none": replace(prior, hold=Barrier(barrier.potential, 0.0)),
        "kernel density": replace(prior, hold=max(wide, key=lambda one: one.held_out(prior.shapes))),
        "V_z alone": replace(prior, bones=nothing),
        "Gaussian alone": replace(prior, hold=prior.gaussian(), bones=nothing),
    }


def frame_by_frame(prior: PosePrior, views: Views) -> Array:
    """(T, M, 3) the shape that fits each frame best when it is placed there; NaN where too little is seen."""
    found = starts_of(prior, views, every=1)
    scale = views.px_per_m(found.position_m)[:, None, None]
    wide = replace(views, sd_px=np.hypot(views.sd_px, scale * prior.left_sd[::3]))
    count = [len(one.z) for one in found.poses]
    joined = Poses(
        position_m=np.concatenate([p.position_m for p in found.poses]),
        rotation=np.concatenate([p.rotation for p in found.poses]),
        z=np.concatenate([p.z for p in found.poses]),
    )
    recorded = Recorded(prior=prior, views=wide.frames(np.repeat(found.frames, count)))
    at, _ = settled(recorded, joined, placed=True)
    xyz, cost = recorded.markers(at), recorded.views.cost(recorded.markers(at))
    out = np.full((views.uv_px.shape[1], *xyz.shape[1:]), np.nan)
    for frame, part in zip(found.frames, np.split(np.arange(len(cost)), np.cumsum(count)[:-1]), strict=True):
        out[frame] = xyz[part[cost[part].argmin()]]
    return out


def bound(prior: PosePrior, own: MarkerTrial, teachers: Sequence[MarkerTrial], trunk: Sequence[int]) -> Array:
    """(T, M, 3) shapes and places fitted to the reference's points."""
    pose = poses_of([*teachers, own], trunk)[-1]
    out = np.full(own.xyz_m.shape, np.nan)
    for t, y in enumerate(pose.y):
        seen = np.isfinite(y)
        if seen.sum() <= prior.rank + 6:
            continue
        at = prior.mean.copy()
        for _ in range(3):
            body = at.reshape(-1, 3)
            turns = np.stack([np.cross(axis, body).ravel() for axis in np.eye(3)], axis=1)
            rows = np.column_stack([prior.basis, np.tile(np.eye(3), (len(body), 1)), turns])
            step, *_ = np.linalg.lstsq(rows[seen], (y - at)[seen], rcond=None)
            at = at + rows @ step
        out[t] = at.reshape(-1, 3) @ pose.frames.rotation[t].T + pose.frames.position_m[t]
    return out


def scored(xyz_m: Array, joint: Array | None, truth: MarkerTrial, centre_m: Array) -> dict[str, float]:
    """A row of the table.

    Args:
        xyz_m: (T, M, 3) estimate.
        joint: (T, 3M, 3M) its covariance; None: it states none.
        truth: Reference.
        centre_m: (3,) of the camera.
    """
    seen = np.isfinite(xyz_m[..., 0]) & truth.seen
    frames, wanted = seen.sum(axis=1) > 1, truth.seen.sum(axis=1) > 1  # of one marker nothing is relative
    empty = float(np.mean(~frames[wanted]))
    if not frames.any():
        return {"empty": empty}
    xyz_m, truth_m, seen = xyz_m[frames], truth.xyz_m[frames], seen[frames]
    weight = seen / seen.sum(axis=1, keepdims=True)

    def centred(values: Array) -> Array:
        return np.where(seen[..., None], values - np.einsum("tm,tmi->ti", weight, values)[:, None], 0.0)

    error = np.where(seen[..., None], xyz_m - truth_m, 0.0)
    relative = centred(error)
    place = np.einsum("tm,tmi->ti", weight, np.where(seen[..., None], truth_m, 0.0))
    sight = (place - centre_m) / np.linalg.norm(place - centre_m, axis=1, keepdims=True)
    own = centred(np.where(seen[..., None], xyz_m, 0.0))
    flipped = own - 2 * np.einsum("tmi,ti->tm", own, sight)[..., None] * sight[:, None]
    other = flipped - centred(np.where(seen[..., None], truth_m, 0.0))
    depth = np.einsum("tmi,ti->tm", error, sight)[seen]
    posed = seen.sum(axis=1) > 2  # two markers have no mirror image: they are one nearer than the other
    distance = np.linalg.norm(relative, axis=-1)[seen]
    row = {
        "abs_rms_mm": 1e3 * float(np.sqrt(np.mean(np.sum(error**2, axis=-1)[seen]))),
        "rel_rms_mm": 1e3 * float(np.sqrt(np.mean(distance**2))),
        "rel_median_mm": 1e3 * float(np.median(distance)),
        "depth_rms_mm": 1e3 * float(np.sqrt(np.mean(depth**2))),
        "mirrored": float(np.mean(np.sum(relative**2, axis=(1, 2)) > np.sum(other**2, axis=(1, 2)), where=posed))
        if posed.any()
        else np.nan,
        "empty": empty,
    }
    if joint is None:
        return row
    markers, noise = seen.shape[1], np.where(seen, truth.sd_m[frames], 0.0) ** 2
    joint = joint[frames] + np.eye(3 * markers) * np.repeat(noise, 3, axis=1)[:, None]
    less = np.eye(3 * markers) - np.einsum("tm,ij->timj", weight, np.eye(3)).reshape(-1, 1, 3, 3 * markers).repeat(
        markers, axis=1
    ).reshape(-1, 3 * markers, 3 * markers)
    sd = {
        "abs": np.sqrt(np.einsum("tii->ti", joint)).reshape(-1, markers, 3)[seen],
        "rel": np.sqrt(np.einsum("tij,tij->ti", less @ joint, less)).reshape(-1, markers, 3)[seen],
    }
    for name, missed in (("abs", error), ("rel", relative)):
        z = missed[seen] / sd[name]
        row |= {f"inside95_{name}": float(np.mean(np.abs(z) < Z95)), f"z_{name}": float(np.sqrt(np.mean(z**2)))}
    return row


def cells(data: Path, *, quick: bool, tell: Callable[[str], None]) -> Iterator[dict[str, object]]:
    """Rows of the table."""
    files = sorted((data / "bat_windtunnel_dltdv8").glob("*/F*/*dvProject.mat"))
    flights = {path: flight(path) for path in files}
    whole = [p for p in files if p.parent.name not in LEFT_WING]
    for path in whole:
        own = flights[path]
        if quick and (own.bat, path.parent.name) not in {("078A3", name) for name in QUICK[1]}:
            continue
        rest = [p for p in whole if p != path]
        teachers = {
            "same bat": [p for p in rest if flights[p].bat == own.bat and flights[p].day == own.day],
            "other bat": [p for p in rest if flights[p].bat != own.bat],
            "other day": [p for p in rest if flights[p].bat == own.bat and flights[p].day != own.day],
        }
        for kind, chosen in teachers.items():
            if chosen and not (quick and kind != "same bat" and path.parent.name != QUICK[1][-1]):
                yield from _of_teachers(own, [flights[p] for p in chosen], kind, quick=quick, tell=tell)


def _of_teachers(
    own: Flight, chosen: Sequence[Flight], kind: str, *, quick: bool, tell: Callable[[str], None]
) -> Iterator[dict[str, object]]:
    markers = np.flatnonzero(np.any([f.trial.seen.any(axis=0) for f in chosen], axis=0) & own.trial.seen.any(axis=0))
    some = [_only(f.trial, markers) for f in chosen]
    mine, trunk = _only(own.trial, markers), [k for k, m in enumerate(markers) if POINTS[m] in TRUNK]
    prior = learn_prior(some, trunk)
    every = held(prior)
    mean = replace(prior, shapes=np.tile(prior.shapes.mean(axis=0), (2, 1)))  # two, as one has no spread
    for camera in QUICK[0] if quick else range(len(own.matrices)):
        uv = own.uv_px[camera : camera + 1][:, :, markers]
        part = shown(np.isfinite(uv[..., 0]))
        if part.stop == 0:
            continue
        uv[:, : part.start], uv[:, part.stop :] = np.nan, np.nan
        noise = max(float(np.nan_to_num(jitter_px(uv))), 0.05)
        views = Views(matrices=own.matrices[camera : camera + 1], uv_px=uv, sd_px=np.full(uv.shape[:3], noise))
        centre = -np.linalg.solve(own.matrices[camera, :, :3], own.matrices[camera, :, 3])
        trusted: list[LeftOut] = []

        def doubt(
            told: PosePrior, noise_m: float, beyond: Misfit, axes: Array, trusted: list[LeftOut] = trusted
        ) -> LeftOut:
            if not trusted:  # by V_z, of all methods
                trusted.append(left_out(told, noise_m, beyond, axes, trials=some, trunk=trunk))
            return trusted[0]

        found: dict[str, tuple[Array, Array | None]] = {}
        for name, one in every.items():
            result: Found = track_views(one, views, doubt=doubt)
            empty = result.unlike.copy()
            empty[: part.start], empty[part.stop :] = True, True
            found[name] = np.where(empty[:, None, None], np.nan, result.estimate.xyz_m), result.joint
        found["nearest pose"] = frame_by_frame(prior, views), None
        found["mean pose"] = frame_by_frame(mean, views), None
        found["subspace bound"] = bound(prior, mine, some, trunk), None
        for method, (xyz, joint) in found.items():
            row = {"flight": f"{own.bat}_{own.trial.name}", "camera": camera + 1, "trained_on": kind, "method": method}
            row |= scored(xyz, joint, mine, centre)
            tell(" ".join(f"{row[c]:.3g}" if isinstance(row.get(c), float) else str(row.get(c, "")) for c in COLUMNS))
            yield row


def _only(trial: MarkerTrial, markers: NDArray[np.int64]) -> MarkerTrial:
    return replace(trial, xyz_m=trial.xyz_m[:, markers], sd_m=trial.sd_m[:, markers])


def compared(table: pd.DataFrame) -> str:
    """V_z beside the others, paired over cells: percent of their rms, with standard errors over cells."""
    lines = []
    for kind, part in table.groupby("trained_on", sort=False):
        for column in ("rel_rms_mm", "abs_rms_mm"):
            wide = part.pivot_table(index=["flight", "camera"], columns="method", values=column)
            own = ("V_z", "V_z", "V_z", "V_z alone", "V_z")
            for one, other in zip(
                own, ("Gaussian", "none", "kernel density", "Gaussian alone", "V_z alone"), strict=True
            ):
                less = 100 * (wide[one] / wide[other] - 1)
                error = less.std() / np.sqrt(len(less)) if len(less) > 1 else np.nan
                lines.append(
                    f"{kind}: {one} over {other}, {column}: {less.mean():+.1f} +- {error:.1f} % ({len(less)} cells)"
                )
    return "\n".join(lines)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two flights, two cameras")
    parser.add_argument("--data", type=Path, default=folder(), help="folder of the real recordings")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for row in cells(given.data, quick=given.quick, tell=lambda line: print(line, flush=True)):
        rows.append(row)
        pd.DataFrame(rows, columns=COLUMNS).to_csv(given.out / "table.csv", index=False)
    if not rows:
        raise SystemExit(f"{given.data}: no flights there: get bat_windtunnel_dltdv8 (mocap data list)")
    table = pd.DataFrame(rows, columns=COLUMNS)
    print(table.groupby(["trained_on", "method"], sort=False).mean(numeric_only=True).round(3).to_string())
    print(compared(table))


if __name__ == "__main__":
    main()
