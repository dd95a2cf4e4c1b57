"""All figures: compute, draw, write."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas

from eal.arrays import Array
from eal.threads import one_blas_thread
from mocap.reproduce import fig_balance, fig_joints, fig_motion, fig_penalty, fig_time, theorems
from mocap.reproduce.fig_recordings import RECORDED, figure_recorded
from mocap.reproduce.record import Figure, Verdict, label
from mocap.reproduce.samples import built_in_samples

_SYNTHETIC: dict[str, Callable[..., Figure]] = {
    "3": fig_motion.figure_3,
    "6": fig_motion.figure_6,
    "11": fig_balance.figure_11,
    "12": fig_motion.figure_12,
    "13": fig_time.figure_13,
    "14a": fig_penalty.figure_14a,
    "14b": fig_penalty.figure_14b,
    "15a": fig_balance.figure_15a,
    "15b": fig_balance.figure_15b,
    "16": fig_time.figure_16,
    "17": fig_time.figure_17,
    "18": fig_motion.figure_18,
    "19a": fig_penalty.figure_19a,
    "19b": fig_penalty.figure_19b,
    "19c": fig_balance.figure_19c,
    "theorem1": theorems.theorem_1,
    "theorem2": theorems.theorem_2,
    "theorem3": theorems.theorem_3,
}
_ANIMAL: dict[str, tuple[Callable[..., Figure], str]] = {
    "7": (fig_joints.figure_7, "bat"),
    "8": (fig_joints.figure_8, "lizard"),
    "20": (fig_joints.figure_20, "lizard"),
}
FIGURES = (
    *("3", "6", "7", "8", "11", "12", "13", "14a", "14b", "15a", "15b", "16", "17", "18", "19a", "19b", "19c", "20"),
    *("theorem1", "theorem2", "theorem3"),
)

ELSEWHERE = {
    "1": "photograph of a bat and a lizard with markers: `mocap demo` makes recordings of both kinds with known truth",
    "2": "photograph of the tunnel with its cameras: `mocap view` shows the cameras of any recording in space",
    "4": "photograph of a board: `mocap data make` films one, `mocap calibrate` reads it",
    "5": "photograph of the lizard on its rod: the scene of `mocap view` on the lizard of `mocap demo`",
    "9": "strain energy of a joint: `mocap design-joint FOLDER --joint elbow_l` draws it beside its V_z, in "
    "potential_and_energy.png",
    "10": "printed joint: `mocap design-joint` writes its parts/*.stl and assembly.3mf",
}
"""Figures of the paper that are not made here, and where they are."""


def reproduce(
    figures: Sequence[str] | None = None,
    out: Path = Path("out/reproduce"),
    quick: bool = False,
    progress: Callable[[str], None] = lambda _line: None,
    *,
    samples_m: Mapping[str, Array] | None = None,
    real_bat_m: Array | None = None,
    flights_deg: Mapping[str, Sequence[Array]] | None = None,
    spans_s: Sequence[float] = fig_penalty.SPANS_S,
    recordings: bool = False,
) -> list[Verdict]:
    """Figures of the EAL paper as images, tables and verdicts.

    Writes ``fig<NAME>.png`` and ``fig<NAME>.csv`` (``theorem1.png`` ...), ``verdicts.json`` and ``figures.md``, which
    says of every figure of the paper which file it is in, or where else it is. One BLAS thread: the matrices are small.

    Args:
        figures: Names such as ``14a``; None: all of ``FIGURES``.
        out: Folder, made where missing.
        quick: Coarser grids and fewer seeds.
        progress: Told a line a figure and a verdict.
        samples_m: (N, 2) samples of the wrist about the elbow in metres, for ``bat`` and ``lizard``; None: the
            built-in animals.
        real_bat_m: (N, 2) samples of a real bat's; figure 7 is then drawn for it too, as ``7_real``.
        flights_deg: (N, 1) angles of the elbow of ``bat`` and ``lizard``, a trial each, for figure 8; None: the
            built-in animals.
        spans_s: Spans of the samples of figure 19a, in seconds; the paper gives none.
        recordings: Whether to video, convert and track the pendulums and the lizard's wrist as well: ``13_recorded``,
            ``19_recorded``, ``20_recorded``, some minutes.

    Returns:
        The verdicts, in the order of the figures.

    Raises:
        ValueError: a figure that there is not, or a span that is not above 0.
    """
    names = list(FIGURES) if figures is None else [name.lower().removeprefix("fig") for name in figures]
    for name in names:
        if name not in FIGURES:
            raise ValueError(f"there is no figure {name!r}: the figures are {', '.join(FIGURES)}")
    if not spans_s or min(spans_s) <= 0:
        raise ValueError(f"spans_s must be times above 0 s, but are {list(spans_s)}")
    out.mkdir(parents=True, exist_ok=True)
    verdicts: list[Verdict] = []
    with one_blas_thread():
        for name in (*names, *(RECORDED if recordings else ())):
            progress(f"figure {name}")
            if name == "19a":
                made = [fig_penalty.figure_19a(quick=quick, spans_s=spans_s)]
            elif name in RECORDED:
                made = [figure_recorded(name, quick=quick)]
            elif name in _SYNTHETIC:
                made = [_SYNTHETIC[name](quick=quick)]
            else:
                samples_m = built_in_samples() if samples_m is None else samples_m
                make, animal = _ANIMAL[name]
                more = {"flights_deg": flights_deg} if name == "8" else {}
                made = [make(samples_m[animal], quick=quick, **more)]
            if name == "7" and real_bat_m is not None:
                made.append(fig_joints.figure_7(real_bat_m, quick=quick, name="7_real"))
            for figure in made:
                write_figure(figure, out)
                for verdict in figure.verdicts:
                    verdicts.append(replace(verdict, figure=figure.name))
                    progress(verdicts[-1].line())
    text = json.dumps([asdict(v) for v in verdicts], indent=1, ensure_ascii=False)
    (out / "verdicts.json").write_text(text, encoding="utf-8")
    # A line for every figure of the paper: its file and how many of its claims hold, or where else it is
    lines = ["# Figures of the EAL paper", ""]
    for name in sorted((*FIGURES, *ELSEWHERE, *RECORDED), key=_order):
        mine = [v for v in verdicts if v.figure == name]
        if name in ELSEWHERE:
            lines.append(f"- Figure {name}: {ELSEWHERE[name]}")
        elif mine:
            stem = name if name.startswith("theorem") else f"fig{name}"
            holding = sum(v.holds for v in mine)
            title = label(name).replace("fig", "Figure").capitalize()
            lines.append(f"- {title}: {stem}.png, {stem}.csv; {holding} of {len(mine)} claims hold")
    (out / "figures.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return verdicts


def _order(name: str) -> tuple[int, str]:
    digits = "".join(c for c in name if c.isdigit())
    return (int(digits) + (100 if name.startswith("theorem") else 0), name)


def write_figure(figure: Figure, out: Path) -> None:
    """Image and table of one figure."""
    canvas = Canvas(figsize=(6.4, 4.6), dpi=110, layout="constrained")
    FigureCanvasAgg(canvas)
    figure.draw(canvas)
    canvas.savefig(out / f"{figure.stem}.png")
    (out / f"{figure.stem}.csv").write_bytes(figure.csv_text().encode())
