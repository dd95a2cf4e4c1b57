"""All figures: compute, draw, write."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from threadpoolctl import threadpool_limits

from eal.arrays import Array
from mocap.reproduce import fig_balance, fig_joints, fig_penalty, fig_samples, fig_time
from mocap.reproduce.record import Figure, Verdict
from mocap.reproduce.samples import built_in_samples

_SYNTHETIC: dict[str, Callable[..., Figure]] = {
    "11": fig_balance.figure_11,
    "13": fig_time.figure_13,
    "14a": fig_penalty.figure_14a,
    "14b": fig_penalty.figure_14b,
    "15a": fig_samples.figure_15a,
    "15b": fig_samples.figure_15b,
    "16": fig_time.figure_16,
    "17": fig_time.figure_17,
    "19a": fig_penalty.figure_19a,
    "19b": fig_penalty.figure_19b,
    "19c": fig_balance.figure_19c,
}
_ANIMAL: dict[str, tuple[Callable[..., Figure], str]] = {
    "7": (fig_joints.figure_7, "bat"),
    "8": (fig_joints.figure_8, "lizard"),
    "20": (fig_joints.figure_20, "lizard"),
}
FIGURES = ("7", "8", "11", "13", "14a", "14b", "15a", "15b", "16", "17", "19a", "19b", "19c", "20")


def _silent(line: str) -> None:
    """No progress."""


def reproduce(
    figures: Sequence[str] | None = None,
    out: Path = Path("out/reproduce"),
    quick: bool = False,
    progress: Callable[[str], None] = _silent,
    *,
    samples_m: Mapping[str, Array] | None = None,
    real_bat_m: Array | None = None,
) -> list[Verdict]:
    """Figures of the EAL paper as pictures, tables and verdicts.

    Writes ``fig<NAME>.png``, ``fig<NAME>.csv`` and ``verdicts.json``. One BLAS thread: the matrices are small.

    Args:
        figures: Names such as ``14a``; None: all of ``FIGURES``.
        out: Folder, made where missing.
        quick: Coarser grids and fewer seeds.
        progress: Told a line a figure and a verdict.
        samples_m: (N, 2) samples of the wrist about the elbow in metres, for ``bat`` and ``lizard``; None: the
            built-in animals.
        real_bat_m: (N, 2) samples of a real bat's; figure 7 is then drawn for it too, as ``7_real``.

    Returns:
        The verdicts, in the order of the figures.

    Raises:
        ValueError: a figure that there is not.
    """
    names = list(FIGURES) if figures is None else [name.lower().removeprefix("fig") for name in figures]
    for name in names:
        if name not in FIGURES:
            raise ValueError(f"there is no figure {name!r}: the figures are {', '.join(FIGURES)}")
    out.mkdir(parents=True, exist_ok=True)
    verdicts: list[Verdict] = []
    with threadpool_limits(1):
        for name in names:
            progress(f"figure {name}")
            if name in _SYNTHETIC:
                made = [_SYNTHETIC[name](quick=quick)]
            else:
                samples_m = built_in_samples() if samples_m is None else samples_m
                make, animal = _ANIMAL[name]
                made = [make(samples_m[animal], quick=quick)]
            if name == "7" and real_bat_m is not None:
                made.append(fig_joints.figure_7(real_bat_m, quick=quick, name="7_real"))
            for figure in made:
                write_figure(figure, out)
                verdicts.extend(figure.verdicts)
                for verdict in figure.verdicts:
                    progress(verdict.line())
    text = json.dumps([v.as_dict() for v in verdicts], indent=1, ensure_ascii=False)
    (out / "verdicts.json").write_text(text, encoding="utf-8")
    return verdicts


def write_figure(figure: Figure, out: Path) -> None:
    """Picture and table of one figure."""
    canvas = Canvas(figsize=(6.4, 4.6), dpi=110, layout="constrained")
    FigureCanvasAgg(canvas)
    figure.draw(canvas)
    canvas.savefig(out / f"fig{figure.name}.png")
    (out / f"fig{figure.name}.csv").write_bytes(figure.csv_text().encode())
