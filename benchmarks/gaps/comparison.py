"""What is asked of the benchmark, set by set: EAL beside the best peer, its controls and the oracle.

A row is a set, what was learned from (``trained_on``), the cameras that are left, and short gaps (10 frames) or long
ones (25 and more). The best peer is the one of the least error in each cell, of all peers by the same gaps: a choice in
the peers' favour, which chance alone makes better than EAL where several are as good. Ratios are geometric means over
cells, trials and seeds, in per cent, below zero where EAL errs less. Their standard error is over trials; of one trial
over seeds, of one seed over cells (scenarios and lengths, which are not independent); of one cell there is none. Rows
of "all" weigh sets alike, with the standard error over sets.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from benchmarks.gaps.table import CELL

BESIDE = {"quadratic": "EAL quadratic", "none": "EAL none", "oracle": "EAL oracle"}
"""Columns: what EAL is compared with apart from the best peer."""
GROUP = ["set", "trained_on", "rays", "frames"]
COLUMNS = [*GROUP, "cells", "trials", "eal_mm", "inside95", "best_peer"]
SHORT, LONG = "10", ">= 25"


def comparison(folds: pd.DataFrame, peers: Sequence[str], *, method: str = "EAL") -> pd.DataFrame:
    """A row a set, ``trained_on``, number of rays, and short or long gaps.

    Columns: ``GROUP``; ``cells``, ``trials``; ``eal_mm`` (geometric mean) and ``inside95`` (per cent) of EAL;
    ``best_peer`` (the one that is best in most cells); ``over_peer``, ``over_quadratic``, ``over_none`` (by how many
    per cent EAL errs more than these, negative: less) and ``over_oracle``, each with its standard error (``.._se``).

    Args:
        folds: Rows of ``folds.csv``.
        peers: Names of the methods that are not ours.
        method: What is compared.
    """
    logs = folds.assign(log=np.log(folds["rmse_mm"]), frames=np.where(folds["gap"] <= 10, SHORT, LONG))
    keys = [*CELL, "frames", "trial", "seed"]
    wide = logs.pivot_table(index=keys, columns="method", values="log", dropna=False).dropna(how="all")
    if method not in wide:
        return pd.DataFrame(columns=COLUMNS)
    wide = wide[wide[method].notna()]
    best = _best(folds, [name for name in peers if name in wide])
    place = pd.MultiIndex.from_frame(wide.index.to_frame()[CELL])
    names = best.reindex(place).to_numpy()
    beside = {"peer": _picked(wide, names)} | {column: wide[name] for column, name in BESIDE.items() if name in wide}
    inside = folds[folds["method"] == method].set_index([*CELL, "trial", "seed"])["coverage95"]
    rows = []
    for group, part in wide.groupby(GROUP, sort=False):
        at = wide.index.get_indexer(part.index)
        often = pd.Series(names[at]).dropna().mode()  # of a run that was gone on with, sets may lack peers
        row = dict(zip(GROUP, group, strict=True)) | {
            "cells": len(part.groupby(CELL)),
            "trials": part.index.get_level_values("trial").nunique(),
            "eal_mm": float(np.exp(part[method].mean())),
            "inside95": 100 * float(inside.reindex(part.index.droplevel("frames")).mean()),
            "best_peer": often.iloc[0] if len(often) else "",
        }
        for column, other in beside.items():
            mean, error = mean_and_error((part[method] - other.iloc[at]).dropna())
            row |= {f"over_{column}": 100 * np.expm1(mean), f"over_{column}_se": 100 * np.exp(mean) * error}
        rows.append(row)
    return pd.DataFrame(rows)


def _best(folds: pd.DataFrame, peers: Sequence[str]) -> pd.Series:
    """The peer of the least error in each cell, over all its trials and seeds."""
    own = folds[folds["method"].isin(list(peers)) & folds["rmse_mm"].notna()]
    means = own.assign(log=np.log(own["rmse_mm"])).groupby([*CELL, "method"])["log"].mean().unstack("method")
    return means.idxmin(axis=1) if len(means) else pd.Series(dtype=str)


def _picked(wide: pd.DataFrame, names: np.ndarray) -> pd.Series:
    """Of each row the column that is named for it."""
    column = wide.columns.get_indexer(names)
    values = np.where(column >= 0, wide.to_numpy()[np.arange(len(wide)), column], np.nan)
    return pd.Series(values, index=wide.index)


def mean_and_error(values: pd.Series) -> tuple[float, float]:
    """Mean of log ratios, and its standard error over trials, or seeds, or cells: the first that there are several of.

    Args:
        values: Indexed by the levels of ``CELL``, and ``trial`` and ``seed``.
    """
    mean = float(values.groupby(level="trial").mean().mean()) if len(values) else np.nan
    for levels in (["trial"], ["seed"], CELL):
        means = values.groupby(level=levels).mean()
        if len(means) > 1:
            return mean, float(means.std() / np.sqrt(len(means)))
    return mean, np.nan


def overall(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of "all": over sets, by ``trained_on`` and frames, of each number of rays and of all together."""
    found = []
    ratios = [name for name in rows if name.startswith("over_") and not name.endswith("_se")]
    for keys in (["trained_on", "rays", "frames"], ["trained_on", "frames"], ["frames"]):
        for group, part in rows.groupby(keys, sort=False):
            place = dict.fromkeys(GROUP, "all") | dict(zip(keys, group, strict=True))
            row = place | {"cells": part["cells"].sum(), "trials": part["trials"].sum(), "best_peer": ""}
            row |= {"eal_mm": np.exp(np.log(part["eal_mm"]).mean()), "inside95": part["inside95"].mean()}
            for name in ratios:
                logs = np.log1p(part.groupby("set")[name].mean() / 100).dropna()
                error = logs.std() / np.sqrt(len(logs)) if len(logs) > 1 else np.nan
                row |= {name: 100 * np.expm1(logs.mean()), f"{name}_se": 100 * np.exp(logs.mean()) * error}
            found.append(row)
    return pd.DataFrame(found).drop_duplicates(GROUP)


def as_lines(rows: pd.DataFrame) -> str:
    """The comparison as one table of text, a line a row."""
    head = ["set", "trained on", "rays", "frames", "cells", "EAL mm", "in 95 %", "best peer"]
    names = [name.removesuffix("_se") for name in rows if name.endswith("_se")]
    head += [f"over {name.removeprefix('over_')} %" for name in names]
    lines = [head]
    for _, row in rows.iterrows():
        line = [str(row["set"]), str(row["trained_on"]), str(row["rays"]), str(row["frames"]), str(row["cells"])]
        line += [f"{row['eal_mm']:.2f}", f"{row['inside95']:.0f}", str(row["best_peer"])]
        for name in names:
            error = f" +- {row[f'{name}_se']:.1f}" if np.isfinite(row[f"{name}_se"]) else ""
            line.append(f"{row[name]:+.1f}{error}" if np.isfinite(row[name]) else "-")
        lines.append(line)
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )
