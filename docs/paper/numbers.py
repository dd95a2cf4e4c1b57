"""Table and figure of the paper, from the result of ``make demo``: ``python -m docs.paper.numbers``."""

import argparse
import json
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
METHODS = {
    "mixture": "this program",
    "conditional_gaussian": "conditional Gaussian (regression on the other markers)",
    "principal_components": "principal components of all poses",
    "chains": "directions of bones through splines",
    "constant_velocity": "Kalman smoother, constant velocity",
    "linear": "straight line",
    "cubic": "cubic spline",
}


def table(gaps: dict) -> str:
    """Rows of the paper's table, in Markdown, of the report's ``gaps``."""
    lines = ["| method | RMSE in gaps, mm | inside 95 % intervals |", "|---|---|---|"]
    for method, title in METHODS.items():
        share = gaps[method]["coverage95"]
        lines.append(f"| {title} | {gaps[method]['rmse_mm']:.2f} | {'-' if share is None else f'{share:.1f} %'} |")
    return "\n".join(lines)


def draw(demo: Path, out: Path) -> None:
    """A gap of a wing tip with its interval, the ground truth and two usual fills; the potential of the wrist."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt
    import mocap.datasets
    from mocap.filters.interpolate import interpolated

    import mocap

    result, truth = mocap.load(demo), mocap.datasets.bat(seed=0).truth
    tip = result.markers.sel(keypoint="d4_tip_l", individual="id_0")
    z, t, filled = tip.position.sel(space="z").values, tip.time.values, (tip.status != 1).values
    sd = np.sqrt(tip.covariance.sel(space="z", space_to="z").values)
    runs = np.split(np.arange(len(t)), np.flatnonzero(np.diff(filled)) + 1)
    gap = max((run for run in runs if filled[run[0]] and run[0] > 0 and run[-1] < len(t) - 1), key=len)
    w = slice(gap[0] - 15, gap[-1] + 16)
    seen = np.where(filled, np.nan, z)[:, None, None]
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.1, 2.8), width_ratios=(3, 2), layout="constrained")
    left.axvspan(t[gap[0]], t[gap[-1]], color="k", alpha=0.08)
    for kind, style in (("cubic", "-."), ("linear", ":")):
        fill = interpolated(np.repeat(seen, 3, axis=2), t, kind=kind)[:, 0, 2]
        left.plot(t[gap], 1000 * fill[gap], style, color="#0072b2", label=f"{kind} interpolation")
    low, high = (1000 * (z + sign * 1.96 * sd)[w] for sign in (-1, 1))
    left.fill_between(t[w], low, high, color="#d55e00", alpha=0.4, label="95 % interval")
    left.plot(t[w], 1000 * truth.xyz_m[w, truth.names.index("d4_tip_l"), 2], "k--", lw=1, label="ground truth")
    left.set(xlabel="time (s)", ylabel="height of the wing tip (mm)", title="a")
    left.set_ylim(np.nanmin(low) - 30, np.nanmax(high) + 90)
    left.legend(fontsize=7, ncols=2, loc="upper center")
    result.potential("wrist_l").plot(ax=right)
    right.set_title("b")
    right.set_xlabel("")  # its legend is the paper's caption
    for text in right.texts:
        text.set_fontsize(6)
    bars = [bar for shown in (*right.collections, *right.images) if (bar := shown.colorbar) is not None]
    for bar in bars:
        bar.set_label("joint potential $V_z$")
    figure.savefig(out, dpi=200)


def main() -> None:
    """Draw, store, print."""
    parser = argparse.ArgumentParser(description="Table and figure of the paper.")
    parser.add_argument("--demo", type=Path, default=Path("out/demo"), help="result of make demo")
    demo = parser.parse_args().demo
    draw(demo, HERE / "figure.png")
    gaps = json.loads((demo / "report.json").read_text(encoding="utf-8"))["gaps"]
    (HERE / "numbers.json").write_text(json.dumps(gaps, indent=1) + "\n", encoding="utf-8")
    print(table(gaps))


if __name__ == "__main__":
    main()
