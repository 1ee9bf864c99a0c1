# SPDX-License-Identifier: Apache-2.0
"""Figures and tables of a study, from its case results."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.files import write_whole

from ..params import OPEN, PHASES
from .case import CaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"pse": "#2a7f4f", "rse": "#c0392b", "open": "#34568b"}
OTHER = ("#34568b", "#b8860b", "#6a3d9a", "#444444")
TARGET = "#34568b"
VERDICT = ("nrmse", "amplitude", "slip", "lag", "frequency")

FIGURES: dict[str, Callable[[Sequence[CaseResult]], Figure]] = {}


def figure(function: Callable[[Sequence[CaseResult]], Figure]) -> Callable:
    """Register a figure under the name of its function."""
    FIGURES[function.__name__] = function
    return function


def new(
    columns: int, size: tuple[float, float], rows: int = 1, **kwargs: Any
) -> tuple[Figure, np.ndarray]:
    """Figure of some size [in] without a display, and its axes: a row, or (rows, columns)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=size, layout="constrained", dpi=120)
    FigureCanvasAgg(made)  # no display, and no global state as pyplot has
    axes = made.subplots(rows, columns, squeeze=False, **kwargs)
    for ax in axes.flat:
        ax.spines[["top", "right"]].set_visible(False)
    return made, axes if rows > 1 else axes[0]


def _variants(results: Sequence[CaseResult]) -> dict[str, list[CaseResult]]:
    groups: dict[str, list[CaseResult]] = {}
    for result in results:
        groups.setdefault(result.variant, []).append(result)
    return groups


def _colour(variant: str, index: int) -> str:
    return COLOURS.get(variant, OTHER[index % len(OTHER)])


def _marks(ax: Any, result: CaseResult, low: float = -np.inf) -> None:
    """Vertical lines where phases and effects begin, with their names above the axes."""
    learner = result.experiment["learner"]
    starts = np.cumsum([learner[phase] for phase in PHASES])
    marks = {phase: t for phase, t in zip(PHASES[1:], starts[:-1], strict=True) if learner[phase]}
    for effect in result.experiment["effects"]:
        marks[effect["name"].replace("_", " ")] = effect.get("start", 0.0)
    for name, t in marks.items():
        if t >= low:
            ax.axvline(t, color="0.6", lw=0.8, ls="-" if name in PHASES else ":", zorder=0)
            ax.annotate(name, (t, 1.01), xycoords=ax.get_xaxis_transform(), color="0.4")


@figure
def nrmse_over_time(results: Sequence[CaseResult]) -> Figure:
    """Smoothed NRMSE of all trials over time, as figure 8.3."""
    made, (ax,) = new(1, (9.0, 4.0))
    for i, (variant, cases) in enumerate(_variants(results).items()):
        colour = _colour(variant, i)
        ax.plot([], [], color=colour, label=f"{variant.upper()} ({len(cases)} trials)")
        for case in (case for case in cases if "error" in case.curves):
            t, error = case.curves["error_t"], case.curves["error"]
            ax.plot(t, error, color=colour, lw=0.9, alpha=0.8)
            if case.verdict["fall"]:
                ax.plot(t[-1], error[-1], "x", color=colour, ms=7, mew=2)
    learner = results[0].experiment["learner"]
    closing = learner["stand"] + learner["train"]
    ax.set_xlim(max(0.0, closing - 10.0), max(case.verdict["end"] for case in results))
    _marks(ax, results[0], closing - 10.0)
    bound = results[0].experiment["criterion"]["nrmse"]
    ax.axhline(bound, color="0.5", lw=0.8, ls="--", label=f"failure above {bound:g}")
    ax.set(xlabel="time [s]", ylabel="NRMSE, mean over one stride [-]", ylim=(0.0, None))
    ax.legend(loc="upper left", frameon=False)
    return made


@figure
def limit_cycles(results: Sequence[CaseResult]) -> Figure:
    """Limit cycle of one trial per variant in the target's principal components, as figure 8.4."""
    groups = {
        v: [c for c in cases if "cycle" in c.curves] for v, cases in _variants(results).items()
    }
    groups = {v: cases for v, cases in groups.items() if cases}
    columns = max(1, len(groups))
    made, axes = new(columns, (4.6 * columns, 5.2), sharex=True, sharey=True)
    for ax, (variant, cases) in zip(axes, groups.items(), strict=False):
        case = _typical(cases)
        t, path = case.curves["cycle_t"], case.curves["cycle"]
        last = len(t) - max(1, len(t) // 10)
        ax.plot(*case.curves["cycle_target"][:300].T, color=TARGET, lw=2.0, label="target")
        ax.scatter(*path[:last].T, c=t[:last], cmap="autumn_r", s=1.0, lw=0, rasterized=True)
        ax.plot(*path[last:].T, color="black", lw=0.8, label="last tenth of the test")
        ax.set(title=f"{variant.upper()}, seed {case.seed}", xlabel="1st component [-]")
        ax.set_aspect("equal", adjustable="box")
    axes[0].set_ylabel("2nd component [-]")
    made.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        title="dots: the test phase, from yellow to red",
    )
    return made


@figure
def foot_heights(results: Sequence[CaseResult]) -> Figure:
    """Heights of the front feet at the end of one trial per variant, as figure 8.5."""
    groups = _variants(results)
    made, axes = new(len(groups), (5.2 * len(groups), 3.4), sharey=True)
    for ax, (variant, cases) in zip(axes, groups.items(), strict=True):
        case = _typical(cases)
        t = case.curves["feet_t"]
        shown = t > t[-1] - 3.0
        for foot, (leg, colour) in enumerate((("LF", "#d97706"), ("RF", "#15803d"))):
            wanted = 100.0 * case.curves["feet_target"][shown, foot]
            ax.plot(t[shown], wanted, color=colour, lw=1.0, ls=":", label=f"{leg} target")
            sent = 100.0 * case.curves["feet"][shown, foot]
            ax.plot(t[shown], sent, color=colour, lw=1.5, label=f"{leg} network")
        ax.set(title=f"{variant.upper()}, seed {case.seed}", xlabel="time [s]")
    axes[0].set_ylabel("height of the foot [cm]")
    made.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return made


@figure
def joint_traces(results: Sequence[CaseResult]) -> Figure:
    """First and last driven and passive joint in train and test, moved by its lag, per variant."""
    groups = {v: c for v, c in _variants(results).items() if "test_trace_t" in _typical(c).curves}
    columns = max(1, len(groups))
    made, axes = new(columns, (4.6 * columns, 4.4), rows=2, sharex=True, sharey="row")
    for column, (variant, cases) in zip(axes.T, groups.items(), strict=False):
        case = _typical(cases)
        period = 1.0 / case.experiment["target"]["frequency"]
        for phase, look in (("train", {"color": "0.7", "lw": 3.0}), ("test", {"lw": 1.1})):
            t = case.curves[f"{phase}_trace_t"] - case.curves[f"{phase}_trace_t"][0]
            lag = case.metrics[phase]["phase_lag"] % 1.0 * period
            for ax, what in zip(column, ("command", "passive"), strict=True):
                values = case.curves[f"{phase}_trace_{what}"]
                for k, name, colour in ((0, "first", OTHER[0]), (-1, "last", OTHER[1])):
                    style = {"color": colour, **look}
                    ax.plot(t - lag, values[:, k], label=f"{phase}, {name}", **style)
        column[0].set_title(f"{variant}, seed {case.seed}")
        column[1].set(xlabel="time [s]", xlim=(0.0, t[-1] - period))
    axes[0, 0].set_ylabel("driven joints [rad]")
    axes[1, 0].set_ylabel("passive joints [rad]")
    handles = axes[0, 0].get_legend_handles_labels()
    made.legend(*handles, loc="outside lower center", ncols=4, frameon=False)
    return made


@figure
def survival(results: Sequence[CaseResult]) -> Figure:
    """Share of trials that do not fall, and that keep the gait, over the first axis of a grid."""
    made, axes = new(2, (9.0, 3.6), sharey=True)
    for i, (variant, cases) in enumerate(_variants(results).items()):
        axis = next(iter(cases[0].at), "seed")
        at = np.array([case.at.get(axis, case.seed) for case in cases], dtype=float)
        stands = np.array([not case.verdict["fall"] for case in cases], dtype=float)
        keeps = np.array([case.verdict["survived"] for case in cases], dtype=float)
        for ax, values in zip(axes, (stands, keeps), strict=True):
            places = np.unique(at)
            shares = [values[at == place].mean() + 0.012 * i for place in places]  # apart
            ax.plot(places, shares, "o-", color=OTHER[i % len(OTHER)], ms=4, label=variant)
            ax.set(xlabel=axis, ylim=(-0.03, 1.08))
    axes[0].set(ylabel="share of trials", title="does not fall")
    axes[1].set_title("keeps the gait (no criterion fails)")
    axes[1].legend(frameon=False)
    return made


@figure
def trunk(results: Sequence[CaseResult]) -> Figure:
    """Height, attitude and path of the trunk."""
    made, axes = new(3, (11.0, 3.4))
    for i, case in enumerate(results):
        colour = _colour(case.variant, i)
        t, position = case.curves["trunk_t"], case.curves["trunk_position"]
        axes[0].plot(t, 100.0 * position[:, 2], color=colour, lw=0.6)
        for k, name in enumerate(("roll", "pitch", "yaw")):
            label = name if i == 0 else None
            axes[1].plot(t, case.curves["trunk_angles"][:, k], color=OTHER[k], lw=0.6, label=label)
        axes[2].plot(position[:, 0], position[:, 1], color=colour, lw=0.8)
    axes[0].set(xlabel="time [s]", ylabel="trunk height [cm]")
    axes[1].set(xlabel="time [s]", ylabel="trunk attitude [rad]")
    axes[1].legend(frameon=False)
    axes[2].set(xlabel="x [m]", ylabel="y [m]")
    return made


def _typical(cases: Sequence[CaseResult]) -> CaseResult:
    """Case in the middle by its largest smoothed NRMSE, of those that lasted longest."""
    end = max(case.verdict["end"] for case in cases)
    lasting = [case for case in cases if case.verdict["end"] > end - 1.0]
    ranked = sorted(lasting, key=lambda case: (case.verdict["nrmse"], case.seed))
    return ranked[len(ranked) // 2]


def write(study: Any, results: Sequence[CaseResult], folder: str | Path) -> list[Path]:
    """Write the tables (``table.md``, ``cases.csv``, ``cases.npz``) and figures (``.png``).

    ``cases.npz`` has the columns of ``cases.csv`` as arrays, a value per case, for NumPy alone.

    Returns:
        Paths of the files.
    """
    folder = Path(folder)
    texts = {"table.md": markdown(study, results), "cases.csv": as_csv(study, results)}
    written = [write_whole(folder / name, text) for name, text in texts.items()]
    columns = table_of(study, results)
    written.append(write_whole(folder / "cases.npz", lambda file: np.savez(file, **columns)))
    for name in study.figures:
        draw = partial(FIGURES[name](results).savefig, format="png")
        written.append(write_whole(folder / f"{name}.png", draw))
    return written


def table_of(study: Any, results: Sequence[CaseResult]) -> dict[str, np.ndarray]:
    """Columns of `rows` as arrays, (cases,) each."""
    table = rows(study, results)
    return {name: np.array([row[name] for row in table]) for name in table[0]}


def rows(study: Any, results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One mapping per case: verdict, then the metrics of the study's phase."""
    made = []
    for case in results:
        values = case.metrics.get(study.phase) or case.metrics.get(OPEN, {})
        row = {"variant": case.variant, **case.at, "seed": case.seed}
        row["survived"] = case.verdict["survived"]
        row |= {"failed": " ".join(case.verdict["failed"]) or "-", "end": case.verdict["end"]}
        row |= {f"trial {key}": case.verdict[key] for key in VERDICT}
        row |= {name: values.get(name, float("nan")) for name in study.metrics}
        made.append(row)
    return made


def as_csv(study: Any, results: Sequence[CaseResult]) -> str:
    """Table of the cases with all digits."""
    table = rows(study, results)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def markdown(study: Any, results: Sequence[CaseResult]) -> str:
    """Summary per variant, then one row per case, to read."""
    parts = [f"# {study.name}", "", study.description, "", "## Failures by criterion", ""]
    parts += _table(summary(results))
    if not study.axes:  # those of a grid are in cases.csv
        parts += ["", f"## Cases (metrics of the phase {study.phase!r})", ""]
        parts += _table(rows(study, results))
    return "\n".join(parts) + "\n"


def summary(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One mapping per variant: trials, survivors, and how many failed by each criterion."""
    made = []
    for variant, cases in _variants(results).items():
        row: dict[str, Any] = {"variant": variant, "trials": len(cases)}
        row["survived"] = sum(case.verdict["survived"] for case in cases)
        for name in ("fall", "phase_slip", "freeze", "nrmse"):
            row[name] = sum(name in case.verdict["failed"] for case in cases)
        for name in ("frequency", "lag"):
            values = [case.verdict[name] for case in cases]
            row[f"{name} mean"], row[f"{name} std"] = np.mean(values), np.std(values)
        made.append(row)
    return made


def _table(table: list[dict[str, Any]]) -> list[str]:
    def text(value: Any) -> str:
        return f"{value:.4g}" if isinstance(value, float) else str(value)

    lines = ["| " + " | ".join(table[0]) + " |", "|" + "---|" * len(table[0])]
    return lines + ["| " + " | ".join(map(text, row.values())) + " |" for row in table]
