"""Figures 13, 19 and 20 as recordings: what the filter with the joint's own mechanics made of filmed markers."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from eal.arrays import Z95
from eal.midpoint import simulate_midpoint
from mocap.reproduce.joint_filter import substeps, theorem_3
from mocap.reproduce.record import Figure, Verdict, judged
from mocap.reproduce.recordings import TrackedJoint, planar, spherical, wrist

Array = NDArray[Any]
"""Of any type of number: this file stands between libraries that name theirs."""

COORDINATES = {
    "planar": (("r", "m"), ("θ", "rad")),
    "spherical": (("$x_1$", "m"), ("$x_2$", "m"), ("$x_3$", "m")),
    "wrist": tuple((f"$q_{i}$", "median distances") for i in (1, 2, 3)),
}
_INSIDE = "The filter's 95 % intervals hold the true joint coordinates."
_BOUND = "Theorem 3: the motion of the model stays where V_z is below its bound."
_ENERGY = "Released without noise the filter's model conserves T + U + V_z/eps^2."
RELEASED_S = 0.5  # chosen


RECORDED: dict[str, tuple[Callable[..., TrackedJoint], str]] = {
    "13_recorded": (planar, "planar pendulum, filmed"),
    "19_recorded": (spherical, "spherical pendulum, filmed"),
    "20_recorded": (wrist, "wrist about elbow of a lizard, filmed"),
}
"""Figures 13, 19 and 20 from videos: in (r, theta), in (x1, x2, x3), and in body axes; and their titles."""


def figure_recorded(name: str, *, quick: bool) -> Figure:
    """One of ``RECORDED``."""
    make, title = RECORDED[name]
    return _figure(name, make(quick=quick), title)


def _figure(name: str, tracked: TrackedJoint, title: str) -> Figure:
    track, truth = tracked.track, tracked.seen.truth
    there = np.isfinite(truth).all(axis=1)
    measured, hidden = there & (track.measured > 0), there & (track.measured == 0)
    off = np.abs(track.q - truth)
    raw = np.abs(tracked.seen.q - truth)
    highest = (float(track.value[track.measured > 0].max()), float(tracked.model.penalty.value(truth[there]).max()))
    verdicts = [
        _share(tracked, measured, "measured"),
        *([_share(tracked, hidden, "hidden in all cameras")] if hidden.sum() >= 30 else []),
        judged(
            _INSIDE,
            "the track is nearer to the truth than the converted markers, in every coordinate (RMS, measured)",
            _listed(_rms(off[measured])) + " against " + _listed(_rms(raw[np.isfinite(raw).all(axis=1)])),
            lambda errors: (errors < _rms(raw[np.isfinite(raw).all(axis=1)])).all(),
            _rms(off[measured]),
            control="the track a frame late",
            faulty=_rms(np.abs(track.q[:-1] - truth[1:])[measured[1:] & measured[:-1]]),
        ),
        judged(
            _BOUND,
            "V_z at the true coordinates and along the track, where measured, is below the bound of a release at "
            + ("its most energetic state" if tracked.name == "wrist" else "its first state"),
            f"bound {tracked.bound:.3g}, track up to {highest[0]:.2g}, truth up to {highest[1]:.2g}: the bound is "
            f"{tracked.bound / max(highest):.2g} times loose",
            lambda peaks: max(peaks) <= tracked.bound < 1.0,
            highest,
            control="coordinates of twice the size",
            faulty=(float(tracked.model.penalty.value(2.0 * truth[there]).max()),),
        ),
        *_released(tracked),
    ]
    labels = [f"q{i + 1}" for i in range(truth.shape[1])]
    table = {"t_s": track.t_s, "measured": track.measured.astype(float), "V": track.value}
    for i, label in enumerate(labels):
        table |= {label: track.q[:, i], f"{label}_sd": track.sd[:, i], f"{label}_true": truth[:, i]}
        table |= {f"{label}_converted": tracked.seen.q[:, i]}
    return Figure(
        name=name,
        table=table,
        verdicts=tuple(verdicts),
        draw=lambda canvas: _draw(canvas, tracked, f"Fig. {name.split('_')[0]} as a recording: {title}"),
    )


def _share(tracked: TrackedJoint, frames: Array, which: str) -> Verdict:
    """Intervals that hold; of the few gaps, in which errors are all alike, an upper limit would say nothing."""
    most = 0.99 if which == "measured" else 1.0
    share = tracked.inside[frames].mean(axis=0)
    mean = float(share.mean())
    off = np.abs(tracked.track.q - tracked.seen.truth)[frames]
    narrow = float((off <= 0.5 * Z95 * tracked.track.sd[frames]).mean())
    return judged(
        _INSIDE,
        f"90 to {100 * most:.0f} % of the true coordinates are inside, {which} ({int(frames.sum())} frames)",
        f"{100 * mean:.0f} % (" + ", ".join(f"{100 * s:.0f}" for s in share) + ")",
        lambda inside: 0.90 <= inside <= most,
        mean,
        control="intervals half as wide",
        faulty=narrow,
    )


def _released(tracked: TrackedJoint) -> list[Verdict]:
    """Energy and V_z of the model released at the track's first state, at three steps of the integrator."""
    model, q, v = tracked.model, tracked.track.q[0], tracked.track.v[0]
    h = float(np.diff(tracked.track.t_s).mean()) / substeps(model, q, float(np.diff(tracked.track.t_s).mean()))
    drifts, peaks = [], []
    for share in (0.5, 0.25, 0.125):
        run = simulate_midpoint(model, q, v, duration_s=RELEASED_S, h_s=share * h)
        energy = model.energy(run.q, run.v)
        drifts.append(float(np.abs(energy - energy[0]).max()))
        peaks.append(float(model.penalty.value(run.q).max()))
    order = float(np.log2(drifts[0] / drifts[2]) / 2.0)
    bound = theorem_3(model, q, v, potential_min_j=tracked.lowest_j)
    kinetic = float(model.energy(q, v) - model.energy(q, np.zeros_like(v)))
    faster = v * np.sqrt(10.0 * bound * float(model.strength) / kinetic)
    thrown = simulate_midpoint(model, q, faster, duration_s=RELEASED_S, h_s=0.125 * h)
    return [
        judged(
            _ENERGY,
            "its error falls with the step as the order of the midpoint rule, 1.7 to 2.3",
            f"{order:.2f}, {', '.join(f'{d:.2g}' for d in drifts)} J at steps of {0.5 * h:.2g} s and halves",
            lambda power: 1.7 <= power <= 2.3,
            order,
            control="the square root of the errors: a method of order 1",
            faulty=0.5 * order,
        ),
        judged(
            _BOUND,
            f"released without noise for {RELEASED_S:g} s it stays below the bound",
            f"V_z up to {peaks[-1]:.3g}, bound {bound:.3g}, {bound / peaks[-1]:.2g} times loose; energy error over "
            f"strength {drifts[-1] / float(model.strength):.1g}",
            lambda peak: peak <= bound + drifts[-1] / float(model.strength),
            peaks[-1],
            control="a start with ten times the bound's energy",
            faulty=float(model.penalty.value(thrown.q).max()),
        ),
    ]


def _rms(x: Array) -> Array:
    return np.sqrt(np.mean(x**2, axis=0))


def _listed(values: Array) -> str:
    return ", ".join(f"{x:.2g}" for x in values)


def _draw(canvas: Canvas, tracked: TrackedJoint, title: str) -> None:
    """Coordinates with their 95 % bands, and V_z with Theorem 3's bound."""
    track = tracked.track
    labels = COORDINATES[tracked.name]
    rows = canvas.subplots(len(labels) + 1, 1, sharex=True)
    edges = bound_edges(tracked)
    hidden = track.measured == 0
    for i, (axes, (label, unit)) in enumerate(zip(rows, labels, strict=False)):
        axes.plot(track.t_s, tracked.seen.q[:, i], ".", color="0.75", markersize=2, label="converted markers")
        half = 1.96 * track.sd[:, i]
        axes.fill_between(
            track.t_s, track.q[:, i] - half, track.q[:, i] + half, color="#0072B2", alpha=0.3, linewidth=0
        )
        axes.plot(track.t_s, track.q[:, i], color="#0072B2", linewidth=1.0, label="track with 95 %")
        axes.plot(track.t_s, tracked.seen.truth[:, i], color="black", linewidth=0.6, label="truth")
        if i == 0 and len(edges):
            axes.plot(track.t_s, edges, color="#D55E00", linewidth=0.8, linestyle="--")
        if i == 0:
            axes.plot([], [], color="#D55E00", linewidth=0.8, linestyle="--", label="Theorem 3's bound")
        low, high = np.nanmin(tracked.seen.truth[:, i]), np.nanmax(tracked.seen.truth[:, i])
        margin = 0.15 * (high - low) + 3.0 * float(np.median(track.sd[:, i]))
        if i == 0 and len(edges):
            low, high = min(low, float(np.nanmin(edges))), max(high, float(np.nanmax(edges)))
        axes.set_ylim(low - margin, high + margin)
        axes.set_ylabel(f"{label} ({unit})" if tracked.name != "wrist" else label)
    rows[-1].semilogy(track.t_s, np.maximum(track.value, 1e-6), color="#0072B2", linewidth=1.0)
    value = tracked.model.penalty.value(tracked.seen.truth)
    rows[-1].semilogy(track.t_s, np.maximum(value, 1e-6), color="black", linewidth=0.6)
    rows[-1].axhline(tracked.bound, color="#D55E00", linewidth=0.8, linestyle="--")
    rows[-1].set_ylabel("$V_z$")
    rows[-1].set_xlabel("t (s)")
    for axes in rows:
        axes.fill_between(
            track.t_s,
            0,
            1,
            where=hidden.tolist(),
            transform=axes.get_xaxis_transform(),
            color="0.9",
            linewidth=0,
            zorder=-2,
        )
        axes.grid(visible=True, alpha=0.3)
    canvas.legend(
        *rows[0].get_legend_handles_labels(), fontsize=6.5, frameon=False, ncols=4, loc="outside lower center"
    )
    rows[0].set_title(f"{title} (grey: hidden in all cameras)", fontsize=9)


def bound_edges(tracked: TrackedJoint) -> Array:
    """(T, 2) least and greatest r at the track's theta where V_z is at the bound; empty unless planar."""
    if tracked.name != "planar":
        return np.empty(0)
    radii = np.linspace(0.7, 1.3, 241)
    grid = np.stack(np.broadcast_arrays(radii, tracked.track.q[:, 1:2]), axis=-1)
    inside = tracked.model.penalty.value(grid) <= tracked.bound
    first, last = np.argmax(inside, axis=1), len(radii) - 1 - np.argmax(inside[:, ::-1], axis=1)
    return np.where(np.asarray(inside.any(axis=1))[:, None], np.stack([radii[first], radii[last]], axis=1), np.nan)
