"""Figures 3, 6, 12 and 18: what was recorded, and the pendulums with their samples."""

import numpy as np
from matplotlib.figure import Figure as Canvas
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]  # its projection is asked for by name

from eal.arrays import Array
from mocap.datasets.bats import make_bat
from mocap.datasets.film import SyntheticRecording
from mocap.datasets.lizards import make_lizard
from mocap.reproduce.record import Figure, judged
from mocap.reproduce.sweep import DELTA_M, Experiment, N, planar, spherical

SERIES = ("#0072B2", "#D55E00", "#009E73", "0.35")
"""Blue, vermillion and green of Okabe & Ito 2008, and grey."""

_RIGID = "Trajectories of all the joints on the left limb: they hang together by the bones of the skeleton."


def figure_3(*, quick: bool) -> Figure:
    """The joints of the bat's left wing in space, of the built-in bat."""
    return _trajectories("3", make_bat(n_frames=120 if quick else 240), "left wing of a bat in level flight")


def figure_6(*, quick: bool) -> Figure:
    """The joints of the lizard's left arm in space, of the built-in lizard."""
    return _trajectories("6", make_lizard(n_frames=120 if quick else 240), "left arm of a lizard on a rod")


def figure_12(*, quick: bool) -> Figure:  # noqa: ARG001
    """The planar pendulum and its samples."""
    return _pendulum("12", planar(), "pendulum and samples")


def figure_18(*, quick: bool) -> Figure:  # noqa: ARG001
    """The spherical pendulum and its samples."""
    return _pendulum("18", spherical(), "spherical pendulum and samples")


def _trajectories(name: str, recording: SyntheticRecording, title: str) -> Figure:
    truth = recording.truth
    chain = [m for m in truth.names if m in ("shoulder_l", "elbow_l", "wrist_l", "hand_l") or m == "d3_tip_l"]
    xyz_m = np.asarray(truth.xyz_m, dtype=np.float64)
    joints = {m: xyz_m[:, truth.names.index(m)] for m in chain}
    arms = [np.linalg.norm(joints[elbow] - joints["shoulder_l"], axis=1) for elbow in ("elbow_l", "wrist_l")]
    vary, wrong = (float(np.std(arm) / np.mean(arm)) for arm in arms)
    verdict = judged(
        _RIGID,
        "markers on skin keep the length of the upper arm within 5 % (standard deviation)",
        f"{1e3 * np.mean(arms[0]):.1f} mm, {100 * vary:.1f} %",
        lambda share: share < 0.05,
        vary,
        control="the wrist in the place of the elbow",
        faulty=wrong,
    )
    t_s = np.asarray(truth.t_s, dtype=np.float64)
    table = {"t_s": t_s} | {f"{m}_{axis}_m": xyz[:, i] for m, xyz in joints.items() for i, axis in enumerate("xyz")}
    return Figure(
        name=name,
        table=table,
        verdicts=(verdict,),
        draw=lambda canvas: _in_space(canvas, list(joints.items()), f"Fig. {name}: {title}"),
    )


def _pendulum(name: str, experiment: Experiment, title: str) -> Figure:
    exact = experiment.samples(N)
    noisy = experiment.samples(N, delta=DELTA_M, rng=np.random.default_rng(0))
    off = experiment.violation(noisy)
    verdict = judged(
        "The samples are taken along the actual trajectory, free from noise and with uniform noise.",
        "samples without noise lie on the set to 1e-8 m, noisy ones about the noise's share of delta off it",
        f"largest {experiment.violation(exact).max():.1g} m, noisy mean {off.mean() / DELTA_M:.2f} delta",
        lambda offs: offs[0].max() < 1e-8 and 0.2 < offs[1].mean() / DELTA_M < 0.3,
        (experiment.violation(exact), off),
        control="noise of twice the width",
        faulty=(experiment.violation(exact), experiment.violation(2.0 * noisy - exact)),
    )
    names = experiment.system.names
    table = {n: exact[:, i] for i, n in enumerate(names)} | {f"{n}_noisy": noisy[:, i] for i, n in enumerate(names)}
    polar = experiment.system.dimension == 2
    return Figure(
        name=name,
        table=table,
        verdicts=(verdict,),
        draw=lambda canvas: (_in_plane if polar else _on_sphere)(canvas, exact, f"Fig. {name}: {title}, N = {N}"),
    )


def _in_space(canvas: Canvas, lines: list[tuple[str, Array]], title: str) -> None:
    axes = canvas.add_subplot(projection="3d")
    if not isinstance(axes, Axes3D):
        raise TypeError("matplotlib gave no axes in space")
    for i, (label, xyz) in enumerate(lines):
        x, y, z = 1e3 * xyz.T
        axes.plot(x, y, z, color=SERIES[i % len(SERIES)], linewidth=1.0, label=label)
    axes.locator_params(nbins=4)
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")
    axes.set_zlabel("z (mm)")
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal")
    axes.legend(fontsize=7, frameon=False, loc="upper left")


def _in_plane(canvas: Canvas, polar: Array, title: str) -> None:
    axes = canvas.subplots()
    x, y = polar[:, 0] * np.cos(polar[:, 1]), polar[:, 0] * np.sin(polar[:, 1])
    axes.plot(x, y, ".", color=SERIES[0], markersize=3, label="samples")
    axes.plot([0.0, x[0]], [0.0, y[0]], color="0.4", linewidth=2, label="bar, r = 1 m")
    axes.plot(x[0], y[0], "o", color=SERIES[1], markersize=10, label="mass, at the start")
    axes.plot(0.0, 0.0, "k^", markersize=7)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(title, fontsize=10)
    axes.legend(fontsize=8, frameon=False, loc="upper left")


def _on_sphere(canvas: Canvas, x: Array, title: str) -> None:
    axes = canvas.add_subplot(projection="3d")
    if not isinstance(axes, Axes3D):
        raise TypeError("matplotlib gave no axes in space")
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(-np.pi / 2, 0, 9))
    axes.plot_wireframe(
        np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise), color="0.8", linewidth=0.5
    )
    axes.plot(*x.T, ".", color=SERIES[0], markersize=3)
    axes.plot(*np.stack([np.zeros(3), x[0]]).T, color="0.4", linewidth=2)
    axes.plot(*x[:1].T, "o", color=SERIES[1], markersize=9)
    axes.set_xlabel("$x_1$ (m)")
    axes.set_ylabel("$x_2$ (m)")
    axes.set_zlabel("$x_3$ (m)")
    axes.locator_params(nbins=4)
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=10)
