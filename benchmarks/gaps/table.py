"""From scores of folds to tables: pooled cells, ratios to the best, one line a method.

A row of ``folds`` is one method on one trial with one seed in one kind of gap. Trials are pooled into a cell of
``table.csv``: RMSE as the root of the mean squared distance over all their samples, coverage and NLL as means over
samples, milliseconds of the processor over all frames that were filled. A method that failed on a trial has no number
in that cell.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

CELL = ["set", "scenario", "gap", "rays", "trained_on"]
KEYS = [*CELL, "method", "seed"]
NAMED = ["set", "scenario", "gap", "method", "seed"]
TABLE = [*NAMED, "rmse_mm", "coverage95", "nll", "ms_per_frame", "rays", "trained_on"]
FOLDS = [*NAMED, "trial", "samples", "rmse_mm", "coverage95", "nll", "seconds", "frames", "rays", "trained_on"]


def pooled(folds: pd.DataFrame) -> pd.DataFrame:
    """``TABLE`` from ``FOLDS``: trials pooled, seeds kept apart; NaN where a method failed on one of the trials."""
    weighed = folds[KEYS].copy()
    weighed["samples"] = folds["samples"]
    weighed["square"] = folds["samples"] * folds["rmse_mm"] ** 2
    for column in ("coverage95", "nll"):
        weighed[column] = folds["samples"] * folds[column]
    sums = weighed.groupby(KEYS, sort=False).agg(lambda part: part.sum(skipna=False))
    out = sums[["coverage95", "nll"]].div(sums["samples"], axis=0)
    out.insert(0, "rmse_mm", np.sqrt(sums["square"] / sums["samples"]))
    once = folds.drop_duplicates(["set", "method", "seed", "trial"])  # all kinds of gaps of a trial are filled together
    time = once.groupby(["set", "method", "seed"])[["seconds", "frames"]].sum(min_count=1)
    per_frame = (1e3 * time["seconds"] / time["frames"]).rename("ms_per_frame")
    out = out.join(per_frame, on=["set", "method", "seed"])
    return out.reset_index()[TABLE]


def by_cell(table: pd.DataFrame) -> pd.DataFrame:
    """Natural logarithm of the RMSE in mm, mean over seeds: a row a cell (``CELL``), a column a method."""
    logs = table.assign(log=np.log(table["rmse_mm"]))
    means = logs.groupby([*CELL, "method"], sort=False)["log"].agg(lambda part: part.mean(skipna=False))
    return means.unstack("method")[list(dict.fromkeys(table["method"]))]


def summary(folds: pd.DataFrame) -> pd.DataFrame:
    """A row a method, best mean rank first.

    Columns: ``rank`` (mean over the cells that it was run on; a method that failed in one is last there), ``wins``
    (cells in which it is best), ``ln_mm`` (mean over its cells of the logarithm of the RMSE in mm), ``spread``
    (standard deviation over trials and seeds of that against the mean of all methods, root mean square over sets),
    ``mm_<gap>`` (geometric mean of the RMSE over sets and scenarios), ``in95_<gap>`` and ``nll`` (means over cells),
    ``ms`` a frame (mean over sets), ``failed`` cells.
    """
    table = pooled(folds)
    logs = by_cell(table)
    lost = table[table["rmse_mm"].isna()].groupby([*CELL, "method"]).size()
    failed = lost.unstack("method").reindex(index=logs.index, columns=logs.columns).notna()
    ranks = logs.mask(failed, np.inf).rank(axis=1, method="average")
    out = pd.DataFrame({"rank": ranks.mean(), "wins": (logs.eq(logs.min(axis=1), axis=0)).sum()})
    out["ln_mm"] = logs.mean()
    out["spread"] = spread(folds)
    lengths = sorted(table["gap"].unique())
    levels = logs.index.get_level_values("gap")
    for gap in lengths:
        out[f"mm_{gap}"] = np.exp(logs[levels == gap].mean())
    for gap in lengths:
        out[f"in95_{gap}"] = table[table["gap"] == gap].groupby("method")["coverage95"].mean()
    out["nll"] = table.groupby("method")["nll"].mean()
    out["ms"] = table.groupby(["method", "set"])["ms_per_frame"].mean().groupby("method").mean()
    out["failed"] = failed.sum()
    return out.sort_values(["rank", "ln_mm"])


def spread(folds: pd.DataFrame) -> pd.Series:
    """Standard deviation over trials and seeds of a method's mean log error against that of all methods."""
    logs = folds.assign(log=np.log(folds["rmse_mm"]))
    wide = logs.groupby(["set", "trial", "seed", "method"])["log"].mean().unstack("method")
    relative = wide.sub(wide.mean(axis=1), axis=0)
    return np.sqrt(relative.groupby("set").var().mean())


def draws(folds: pd.DataFrame) -> pd.DataFrame:
    """How much a set's numbers change from draw to draw of its gaps, by which a change of a method can be judged.

    Columns: ``set``, ``method``, ``draws`` (seeds), ``mm`` (geometric mean of the RMSE over draws, a draw being that
    over its cells and trials), ``sd`` (standard deviation over draws of its logarithm), ``error`` (standard error of
    the mean), ``seconds`` (of the processor, of filling all trials once a draw); NaN of one draw.
    """
    logs = folds.assign(log=np.log(folds["rmse_mm"]))
    each = logs.groupby(["set", "method", "seed"], sort=False)["log"].mean().groupby(["set", "method"], sort=False)
    once = folds.drop_duplicates(["set", "method", "seed", "trial"])
    seconds = once.groupby(["set", "method", "seed"])["seconds"].sum(min_count=1).groupby(["set", "method"]).mean()
    out = pd.DataFrame({"draws": each.count(), "mm": np.exp(each.mean()), "sd": each.std()})
    out["error"] = out["sd"] / np.sqrt(out["draws"])
    return out.join(seconds).reset_index()


def ratios(folds: pd.DataFrame) -> pd.DataFrame:
    """Each method against the best of each cell, paired by trial and seed.

    Columns: ``CELL``, ``method``, ``best`` (the method of the least pooled RMSE), ``ln_ratio`` (mean over trials of ln
    RMSE minus that of the best) and ``error`` (its standard error over trials, seeds averaged first; NaN of one trial).
    """
    logs = by_cell(pooled(folds))
    out = []
    scored = folds.assign(log=np.log(folds["rmse_mm"]))
    for cell, part in scored.groupby(CELL, sort=False):
        row = logs.loc[cell]
        if row.isna().all():
            continue
        best = row.idxmin()
        wide = part.groupby(["trial", "seed", "method"])["log"].mean().unstack("method")
        relative = wide.sub(wide[best], axis=0).groupby("trial").mean()
        for method in relative:
            values = relative[method].dropna()
            error = values.std() / np.sqrt(len(values)) if len(values) > 1 else np.nan
            out.append((*cell, method, best, values.mean(), error))
    return pd.DataFrame(out, columns=[*CELL, "method", "best", "ln_ratio", "error"])


def against_best(folds: pd.DataFrame, method: str, peers: Sequence[str], *, by: str = "seed") -> pd.DataFrame:
    """A method against the peer that is best in a cell by the other seeds: the best of many by the same seed is luck.

    Columns: ``CELL``, ``seed``, ``best`` (the peer of the least mean log RMSE over the other seeds), ``ln_ratio`` (ln
    RMSE of the method minus that peer's, by this seed). Cells of one seed are left out. With ``by`` "trial" the same of
    trials in place of seeds: seeds hide other gaps in the same trial, and in a short one these show the same event.
    """
    table = pooled(folds) if by == "seed" else folds
    logs = np.log(table.set_index([*CELL, by, "method"])["rmse_mm"]).groupby(level=[*CELL, by, "method"]).mean()
    out = []
    for cell, part in logs.unstack("method").groupby(CELL, sort=False):
        for row, line in part.iterrows():
            others = part.drop(index=row)[list(peers)].mean().dropna()
            if len(part) > 1 and len(others):
                best = str(others.idxmin())
                out.append((*cell, row[-1], best, line[method] - line[best]))
    return pd.DataFrame(out, columns=[*CELL, by, "best", "ln_ratio"])


def as_sentence(ratios: pd.DataFrame, method: str) -> str:
    """What ``against_best`` says of gaps of 25 frames or more.

    A cell's standard error is the same for all: by the variance between seeds, or trials, pooled over cells.
    """
    by = "trial" if "trial" in ratios else "seed"
    by_cell = ratios[ratios["gap"] >= 25].dropna().groupby(CELL)["ln_ratio"]
    cells = by_cell.agg(["min", "mean", "max", "count", "var"])
    mean, near = np.expm1(np.average(cells["mean"], weights=cells["count"])), 0.03
    sure = 2 * np.sqrt(cells["var"].mean() / cells["count"])
    return (
        f"{method} against the peer that is best in the cell by the other {by}s, gaps of 25 frames or more: "
        f"{mean:+.0%} on average; of {len(cells)} cells {(cells['max'] < -near).sum()} more than 3 % better with every "
        f"{by}, {(cells['min'] > near).sum()} worse; {(cells['mean'] < -sure).sum()} better by more than two standard "
        f"errors, {(cells['mean'] > sure).sum()} worse"
    )


def as_text(lines: pd.DataFrame) -> str:
    """The summary as one table."""
    lengths = [int(name.removeprefix("mm_")) for name in lines if name.startswith("mm_")]
    head = ["method", "rank", "wins", "ln mm", "spread", *(f"{gap}" for gap in lengths)]
    head += [*(f"{gap}" for gap in lengths), "nll", "ms/frame", "failed"]
    rows = []
    for method, line in lines.iterrows():
        row = [
            str(method),
            f"{line['rank']:.2f}",
            f"{line['wins']:.0f}",
            f"{line['ln_mm']:.3f}",
            f"{line['spread']:.3f}",
        ]
        row += [f"{line[f'mm_{gap}']:.2f}" for gap in lengths]
        row += [f"{100 * line[f'in95_{gap}']:.1f}" for gap in lengths]
        row += [f"{line['nll']:.2f}", f"{line['ms']:.3f}", f"{line['failed']:.0f}"]
        rows.append([cell.replace("nan", "-") for cell in row])
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    first = 5
    groups = [("RMSE mm, gaps of frames", first), ("% inside 95 % intervals", first + len(lengths))]
    above = " " * (sum(widths[:first]) + 2 * first)
    for title, start in groups:
        width = sum(widths[start : start + len(lengths)]) + 2 * len(lengths)
        above += title[: width - 1].ljust(width)
    lines_out = [above.rstrip()]
    for row in [head, *rows]:
        cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        lines_out.append("  ".join(cells).rstrip())
    return "\n".join(lines_out)
