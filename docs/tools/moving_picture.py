"""The moving picture of the README: a wing hidden and filled, the elbow's angle and its interval beside the truth.

``make demo``, then ``python -m docs.tools.moving_picture`` writes ``docs/pictures/filled_wing.gif``.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure
from mocap.datasets import make_bat

import mocap
from eal.arrays import Array
from mocap.plots.kinematics import COLOURS, styled
from mocap.records import Status

PAGE = Path(__file__).resolve().parents[1] / "pictures" / "filled_wing.gif"
FRAMES = range(330, 420)
"""Three wing beats, in two of which most of the right wing is hidden behind the body."""


def flexion_deg(xyz: Array) -> Array:
    """(T,) 180 degrees less the angle at the second of three points (T, 3, 3)."""
    a, b = xyz[:, 0] - xyz[:, 1], xyz[:, 2] - xyz[:, 1]
    cosine = np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return 180 - np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def main(folder: str = "out/demo") -> None:
    """Draw it from a result of the demo."""
    run = mocap.load(folder)
    markers, bones = run.tracks, run.skeleton.bones
    names = list(markers.names)
    truth = make_bat(seed=0).truth.xyz_m
    three = [names.index(name) for name in ("shoulder_r", "elbow_r", "wrist_r")]
    found = mocap.load(folder).kinematics["elbow_r_angle_deg"]
    body = 1e3 * (
        markers.xyz_m - np.nanmean(markers.xyz_m[:, [names.index(n) for n in run.skeleton.trunk]], axis=1)[:, None]
    )
    view = np.linalg.svd(body[FRAMES.start : FRAMES.stop].reshape(-1, 3), full_matrices=False)[2][:2]
    flat = body @ view.T
    figure = Figure(figsize=(7.2, 2.7), dpi=90, layout="constrained")
    animal, curve = figure.subplots(1, 2, width_ratios=(1, 1.25))
    t = markers.t_s[FRAMES.start : FRAMES.stop]
    t = t - t[0]
    part = slice(FRAMES.start, FRAMES.stop)
    curve.plot(t, flexion_deg(truth[:, three])[part], color="0.2", linewidth=1, linestyle="--", label="ground truth")
    curve.fill_between(
        t, 180 - found.high[part], 180 - found.low[part], color=COLOURS[1], alpha=0.35, label="95 % interval"
    )
    (line,) = curve.plot([], [], color=COLOURS[1], linewidth=1.6, label="tracked")
    hidden = (markers.status[part][:, three] != Status.MEASURED).any(axis=1)
    curve.fill_between(
        t, 0, 1, where=hidden.tolist(), transform=curve.get_xaxis_transform(), color="0.92", label="hidden"
    )
    curve.set(xlabel="time (s)", ylabel="right elbow flexion (°)", xlim=(t[0], t[-1]))
    curve.legend(fontsize=7, frameon=False, ncols=2, loc="upper left", bbox_to_anchor=(0, 1.22))
    styled(curve)

    def draw(k: int) -> None:
        frame = FRAMES[k]
        animal.clear()
        animal.axis("off")
        animal.set(
            xlim=(flat[part, :, 0].min(), flat[part, :, 0].max()), ylim=(flat[part, :, 1].min(), flat[part, :, 1].max())
        )
        animal.set_aspect("equal")
        for bone in bones:
            animal.plot(*flat[frame, [names.index(bone.a), names.index(bone.b)]].T, color="0.6", linewidth=1.4)
        seen = markers.status[frame] == Status.MEASURED
        for where, colour, text in ((seen, COLOURS[0], "measured"), (~seen, COLOURS[1], "filled")):
            animal.plot(*flat[frame, where].T, "o", color=colour, markersize=4, label=text)
        animal.legend(fontsize=7, frameon=False, loc="lower left", ncols=2, bbox_to_anchor=(0, -0.08))
        line.set_data(t[: k + 1], 180 - found.value[part][: k + 1])

    FuncAnimation(figure, draw, frames=len(FRAMES)).save(PAGE, writer=PillowWriter(fps=20))  # type: ignore[arg-type]


if __name__ == "__main__":
    main(*sys.argv[1:])
