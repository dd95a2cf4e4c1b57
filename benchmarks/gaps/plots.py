"""Pictures of the table: error and coverage by gap length."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.gaps.hide import SCENARIOS
from benchmarks.gaps.table import by_cell, summary

LEFT = {0: "dark", 1: "one camera", 2: "two that disagree"}
SHOWN = 10
"""Methods that are drawn: the best of the summary; more lines are not told apart."""


def draw(folds: pd.DataFrame, table: pd.DataFrame, out: Path) -> list[Path]:
    """``error.png`` (RMSE by gap length; rows: sets and cameras left, columns: scenarios) and ``coverage.png``."""
    names = list(summary(folds).index[:SHOWN])
    colours = dict(zip(names, matplotlib.colormaps["tab10"](np.arange(len(names)) % 10), strict=True))
    return [
        _save(_errors(by_cell(table), names, colours), out / "error.png"),
        _save(_coverage(table, names, colours), out / "coverage.png"),
    ]


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    return path


def _errors(logs: pd.DataFrame, names: list[str], colours: dict) -> Figure:
    places = list(dict.fromkeys(logs.index.droplevel(["scenario", "gap", "trained_on"])))
    scenarios = sorted(set(logs.index.get_level_values("scenario")), key=SCENARIOS.index)
    figure = Figure(figsize=(2.6 * len(scenarios) + 2.4, 2.0 * len(places) + 0.8), layout="constrained")
    axes = figure.subplots(len(places), len(scenarios), sharex=True, sharey="row", squeeze=False)
    for row, (name, rays) in zip(axes, places, strict=True):
        for ax, scenario in zip(row, scenarios, strict=True):
            _lines(ax, logs.xs((name, scenario, rays), level=("set", "scenario", "rays")), scenario, names, colours)
        row[0].set_ylabel(f"{name}\n{LEFT[rays]}\nRMSE mm", fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("gap, frames")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8)
    return figure


def _lines(ax: Axes, logs: pd.DataFrame, scenario: str, names: list[str], colours: dict) -> None:
    part = logs.groupby(level="gap")[names].mean()
    for method in names:
        ax.plot(part.index, np.exp(part[method]), ".-", color=colours[method], label=method, linewidth=1.2)
    ax.set(xscale="log", title=scenario)
    if np.isfinite(part.to_numpy()).any():
        ax.set_yscale("log")
    ticks = list(part.index)
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.minorticks_off()


def _coverage(table: pd.DataFrame, names: list[str], colours: dict) -> Figure:
    sets = list(dict.fromkeys(table["set"]))
    figure = Figure(figsize=(2.4 * len(sets) + 2.4, 3.2), layout="constrained")
    axes = figure.subplots(1, len(sets), sharey=True, squeeze=False)[0]
    for ax, name in zip(axes, sets, strict=True):
        ax.axhspan(92, 98, color="0.9")
        for method in names:
            part: Any = table[(table["set"] == name) & (table["method"] == method)]
            shares = 100 * part.groupby("gap")["coverage95"].mean().to_numpy()
            if np.isfinite(shares).any():
                ax.plot(sorted(set(part["gap"])), shares, ".-", color=colours[method], label=method, linewidth=1.2)
        ticks = sorted(set(table["gap"]))
        ax.set(xscale="log", title=name, xlabel="gap, frames", ylim=(0, 101))
        ax.set_xticks(ticks, [str(tick) for tick in ticks])
        ax.minorticks_off()
    axes[0].set_ylabel("% of coordinates inside 95 % intervals")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", fontsize=8)
    return figure
