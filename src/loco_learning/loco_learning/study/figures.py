# SPDX-License-Identifier: Apache-2.0
"""Figures and tables of a study, from its case results."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.files import write_whole

from ..drawing import png
from ..drawing.chart import DASHED, GREY, LINE, PALETTE, Axis, Chart, Frame, Layer, dots, line
from ..metrics.registry import METRICS
from ..params import OPEN, PHASES
from .case import CaseResult
from .trial import CONFIDENCE, share_interval

BLACK = "#222222"
COLOURS = {"pse": "#009e73", "rse": "#d55e00", "open": "#0072b2"}
TARGET = "#8cc5ea"
COMPONENT = "{} component [-]"
VERDICT = ("nrmse", "amplitude", "slip", "lag", "frequency")


def _variants(results: Sequence[CaseResult]) -> dict[str, list[CaseResult]]:
    groups: dict[str, list[CaseResult]] = {}
    for result in results:
        groups.setdefault(result.variant, []).append(result)
    return groups


def _colour(variant: str, index: int) -> str:
    return COLOURS.get(variant, PALETTE[index % len(PALETTE)])


def _marks(result: CaseResult, top: float, low: float = -np.inf) -> list[Layer]:
    """Vertical lines at the starts of phases and effects."""
    learner = result.experiment["learner"]
    starts = np.cumsum([learner[phase] for phase in PHASES])
    marks = {f"{phase} begins": float(t) for phase, t in zip(PHASES[1:], starts[:-1], strict=True)
             if learner[phase]}  # fmt: skip
    for effect in result.experiment["effects"]:
        marks[f"{effect['name'].replace('_', ' ')} begins"] = effect.get("start", 0.0)
    visible = {name: t for name, t in marks.items() if t >= low}
    return [line(name, [t, t], [0.0, top], GREY, size=0.8) for name, t in visible.items()]


def nrmse_over_time(study: Any, results: Sequence[CaseResult]) -> Chart:
    """Smoothed NRMSE of all trials over time, as figure 8.3; a dot where the robot fell."""
    layers = []
    for i, (variant, cases) in enumerate(_variants(results).items()):
        name, colour = f"{variant.upper()} (trials: {len(cases)})", _colour(variant, i)
        with_error = [case for case in cases if "error" in case.curves]
        layers += [line(name, c.curves["error_t"], c.curves["error"], colour) for c in with_error]
        fallen_cases = [c for c in with_error if c.verdict["fall"]]
        end_points = [[c.curves[key][-1] for c in fallen_cases] for key in ("error_t", "error")]
        layers.append(
            dots(name, *end_points, colour, texts=[f"{c.name} fell" for c in fallen_cases])
        )
    learner = results[0].experiment["learner"]
    closing = learner["stand"] + learner["train"]
    end_points = max(0.0, closing - 10.0), max(case.verdict["end"] for case in results)
    bound = results[0].experiment["criterion"]["nrmse"]
    values = [layer.y[layer.x >= end_points[0]] for layer in layers]
    highest = max((float(np.nanmax(y)) for y in values if np.isfinite(y).any()), default=bound)
    top = 1.05 * (max(highest, bound) if bound < 3.0 * highest else highest)  # ignores a far bound
    layers += _marks(results[0], top, end_points[0])
    layers.append(line("bound of the criterion", end_points, [bound, bound], GREY, shape=DASHED))
    axes = (
        Axis("time [s]", limits=end_points),
        Axis("NRMSE, mean over one stride [-]", limits=(0.0, top)),
    )
    return Chart([Frame(*axes, layers, height=330)])


def limit_cycles(study: Any, results: Sequence[CaseResult]) -> Chart:
    """Limit cycle of one trial per variant in the target's principal components, as figure 8.4."""
    frames = []
    for i, (variant, cases) in enumerate(_variants(results).items()):
        with_cycle = [case for case in cases if "cycle" in case.curves]
        if not with_cycle:
            continue
        case = _typical(with_cycle)
        path, target = case.curves["cycle"], case.curves["cycle_target"][:300]
        last = len(path) - max(1, len(path) // 10)
        layers = [
            line("test phase", *path[:last].T, _colour(variant, i), size=0.5),
            line("target", *target.T, TARGET, size=3.0),
            line("last tenth of the test", *path[last:].T, BLACK),
        ]
        axes = (Axis(COMPONENT.format(rank)) for rank in ("1st", "2nd"))
        title = f"{variant.upper()}, seed {case.seed}"
        frames.append(Frame(*axes, layers, title, equal=True, height=330))
    return Chart(frames)


def foot_heights(study: Any, results: Sequence[CaseResult]) -> Chart:
    """Heights of the front feet at the end of one trial per variant, as figure 8.5."""
    frames = []
    for variant, cases in _variants(results).items():
        case = _typical(cases)
        t, layers = case.curves["feet_t"], list[Layer]()
        in_window = t > t[-1] - 3.0
        for foot, (leg, colour) in enumerate((("LF", PALETTE[1]), ("RF", PALETTE[2]))):
            for key, name, shape in (
                ("feet_target", "target", DASHED), ("feet", "network", LINE),
            ):  # fmt: skip
                height = 100.0 * case.curves[key][in_window, foot]
                layers.append(line(f"{leg} {name}", t[in_window], height, colour, shape=shape))
        axes = Axis("time [s]"), Axis("height of the foot [cm]")
        frames.append(Frame(*axes, layers, f"{variant.upper()}, seed {case.seed}"))
    return Chart(frames)


def joint_traces(study: Any, results: Sequence[CaseResult]) -> Chart:
    """First and last driven and passive joint in train and test, shifted by lag, per variant."""
    frames = []
    for what, label in (("command", "driven joints [rad]"), ("passive", "passive joints [rad]")):
        for variant, cases in _variants(results).items():
            case = _typical(cases)
            if "test_trace_t" not in case.curves:
                continue
            period = 1.0 / case.experiment["target"]["frequency"]
            layers, end = [], 0.0
            for phase, dark, size in (("train", False, 3.0), ("test", True, 1.2)):
                t = case.curves[f"{phase}_trace_t"] - case.curves[f"{phase}_trace_t"][0]
                lag, end = case.metrics[phase]["phase_lag"] % 1.0 * period, t[-1] - period
                values = case.curves[f"{phase}_trace_{what}"]
                for k, name in ((0, "first"), (-1, "last")):
                    colour = (PALETTE[0], PALETTE[1])[k] if dark else (TARGET, "#f3c9a5")[k]
                    layers.append(
                        line(f"{phase}, {name}", t - lag, values[:, k], colour, size=size)
                    )
            axes = Axis("time [s]", limits=(0.0, end)), Axis(label)
            frames.append(Frame(*axes, layers, f"{variant}, seed {case.seed}"))
    return Chart(frames)


def survival(study: Any, results: Sequence[CaseResult]) -> Chart:
    """Share of trials that do not fall, and that keep the gait, over the first axis of a grid.

    Vertical lines are confidence intervals of 90 %.
    """
    whats = {
        "does not fall": lambda case: not case.verdict["fall"],
        "keeps the gait (no criterion fails)": lambda case: case.verdict["survived"],
    }
    if all(len({holds(case) for holds in whats.values()}) == 1 for case in results):
        whats.popitem()  # only falls count: one frame says it
    axis, label = next(((a.name, a.label) for a in study.axes), ("seed", "seed [-]"))
    frames = []
    for title, holds in whats.items():
        layers = list[Layer]()
        for i, (variant, cases) in enumerate(_variants(results).items()):
            at = np.array([case.at.get(axis, case.seed) for case in cases], dtype=float)
            values = np.array([holds(case) for case in cases], dtype=float)
            positions = np.unique(at)
            shares = [values[at == place].mean() for place in positions]
            colour = _colour(variant, i)
            layers += [line(variant, positions, shares, colour),
                       dots(variant, positions, shares, colour)]  # fmt: skip
            for place in positions:
                interval = share_interval(values[at == place])
                layers.append(line(variant, [place, place], interval, colour, size=0.8))
        axes = Axis(label), Axis("share of trials [-]", limits=(-0.05, 1.05))
        frames.append(Frame(*axes, layers, title))
    return Chart(frames)


def trunk(study: Any, results: Sequence[CaseResult]) -> Chart:
    """Height, attitude and path of the trunk."""
    height, angles, path = list[Layer](), list[Layer](), list[Layer]()
    for i, case in enumerate(results):
        colour = _colour(case.variant, i)
        t, position = case.curves["trunk_t"], case.curves["trunk_position"]
        height.append(line(case.variant, t, 100.0 * position[:, 2], colour))
        for k, name in enumerate(("roll", "pitch", "yaw")):
            values = case.curves["trunk_angles"][:, k]
            angles.append(line(name, t, values, PALETTE[k + 3], size=0.8))
        path.append(line(case.variant, *position[:, :2].T, colour))
    return Chart([
        Frame(Axis("time [s]"), Axis("trunk height [cm]"), height),
        Frame(Axis("time [s]"), Axis("trunk attitude [rad]"), angles),
        Frame(Axis("x [m]"), Axis("y [m]"), path, equal=True),
    ])  # fmt: skip


def seeds(study: Any, results: Sequence[CaseResult]) -> Chart:
    """Metrics of every trial, a dot each, a row for each variant.

    Args:
        study: The study, whose metrics are shown.
        results: Cases of the study.
    """
    table, variants = rows(study, results), list(_variants(results))
    frames = []
    for name in study.metrics:
        layers = []
        for survived, label, colour in (
            (True, "survived", PALETTE[2]),
            (False, "failed", PALETTE[1]),
        ):
            values = [
                (row, case)
                for row, case in zip(table, results, strict=True)
                if bool(row["survived"]) == survived and np.isfinite(row[name])
            ]
            # Trials of one variant are drawn slightly apart, in the order of their seeds.
            positions = [variants.index(row["variant"]) + 0.3 * (_rank(case, results) - 0.5)
                     for row, case in values]  # fmt: skip
            layers.append(dots(
                label, [row[name] for row, _ in values], positions, colour,
                texts=[f"{case.name}: {row[name]:.4g}" for row, case in values],
                links=[f"#case-{case.name}" for _, case in values],
            ))  # fmt: skip
        unit = METRICS[name].unit if name in METRICS else "-"
        label = f"{name.replace('_', ' ')} [{unit}]"
        height = 90 + 34 * len(variants)
        frames.append(Frame(Axis(label), Axis("variant", names=variants), layers, height=height))
    return Chart(frames)


def _rank(case: CaseResult, results: Sequence[CaseResult]) -> float:
    """Relative position of a trial among those of its variant, from 0 to 1."""
    names = [other.name for other in results if other.variant == case.variant]
    return names.index(case.name) / max(1, len(names) - 1)


def _typical(cases: Sequence[CaseResult]) -> CaseResult:
    """Case with the median of the largest smoothed NRMSE, of those that lasted longest."""
    end = max(case.verdict["end"] for case in cases)
    lasting = [case for case in cases if case.verdict["end"] > end - 1.0]
    ranked = sorted(lasting, key=lambda case: (case.verdict["nrmse"], case.seed))
    return ranked[len(ranked) // 2]


FIGURES: dict[str, Callable[[Any, Sequence[CaseResult]], Chart]] = {  # of a study and its cases
    draw.__name__: draw
    for draw in (nrmse_over_time, limit_cycles, foot_heights, joint_traces, survival, trunk)
}


def write(study: Any, results: Sequence[CaseResult], folder: str | Path) -> list[Path]:
    """Write the tables (``table.md``, ``cases.csv``, ``cases.npz``) and figures (``.png``).

    ``cases.npz`` has the columns of ``cases.csv`` as arrays, a value per case, for use with NumPy.

    Returns:
        Paths of the files.
    """
    folder = Path(folder)
    files = {"table.md": markdown(study, results), "cases.csv": as_csv(study, results)}
    written = [write_whole(folder / name, text) for name, text in files.items()]
    columns = table_of(study, results)
    written.append(write_whole(folder / "cases.npz", lambda file: np.savez(file, **columns)))
    for name in study.figures:
        written.append(png.write(FIGURES[name](study, results), folder / f"{name}.png"))
    return written


def table_of(study: Any, results: Sequence[CaseResult]) -> dict[str, np.ndarray]:
    """Columns of `rows` as arrays, (cases,) each."""
    table = rows(study, results)
    return {name: np.array([row[name] for row in table]) for name in table[0]}


def rows(study: Any, results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One mapping per case: verdict, then the metrics of the study's phase."""
    rows_of_table = []
    for case in results:
        values = case.metrics.get(study.phase) or case.metrics.get(OPEN, {})
        row = {"variant": case.variant, **case.at, "seed": case.seed}
        row["survived"] = case.verdict["survived"]
        row |= {"failed": " ".join(case.verdict["failed"]) or "-", "end": case.verdict["end"]}
        row |= {f"trial {key}": case.verdict[key] for key in VERDICT}
        row |= {name: values.get(name, float("nan")) for name in study.metrics}
        rows_of_table.append(row)
    return rows_of_table


def as_csv(study: Any, results: Sequence[CaseResult]) -> str:
    """Table of the cases as CSV, with all digits."""
    table = rows(study, results)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def markdown(study: Any, results: Sequence[CaseResult]) -> str:
    """Summary per variant, then one row per case, in Markdown."""
    parts = [f"# {study.name}", "", study.description, "", "## Failures by criterion", ""]
    parts += _table(summary(results))
    for axis in study.axes[:1]:
        parts += ["", f"## Trials that survive, over {axis.label}", "",
                  f"Interval of the share at {CONFIDENCE:.0%} in brackets.", ""]  # fmt: skip
        parts += _table(survivors(study, results))
    if not study.axes:  # the cases of a grid are in cases.csv only
        parts += ["", f"## Cases (metrics of the phase {study.phase!r})", ""]
        parts += _table(rows(study, results))
    return "\n".join(parts) + "\n"


def summary(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One mapping per variant: trials, survivors, and number of failures by each criterion."""
    lines = []
    for variant, cases in _variants(results).items():
        row: dict[str, Any] = {"variant": variant, "trials": len(cases)}
        row["survived"] = sum(case.verdict["survived"] for case in cases)
        for name in ("fall", "phase_slip", "freeze", "nrmse"):
            row[name] = sum(name in case.verdict["failed"] for case in cases)
        for name in ("frequency", "lag"):
            values = [case.verdict[name] for case in cases]
            row[f"{name} mean"], row[f"{name} std"] = np.mean(values), np.std(values)
        lines.append(row)
    return lines


def survivors(study: Any, results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """One mapping per variant: survivors, trials and interval at each value of the first axis."""
    axis, lines = study.axes[0], []
    for variant, cases in _variants(results).items():
        row = {"variant": variant}
        for value in axis.values:
            flags = [case.verdict["survived"] for case in cases if case.at[axis.name] == value]
            low, high = share_interval(np.array(flags))
            text = f"{sum(flags)} of {len(flags)} ({low:.2f} to {high:.2f})" if flags else "-"
            row[f"{value:.4g}" if isinstance(value, float) else str(value)] = text
        lines.append(row)
    return lines


def _table(table: list[dict[str, Any]]) -> list[str]:
    def text(value: Any) -> str:
        return f"{value:.4g}" if isinstance(value, float) else str(value)

    lines = ["| " + " | ".join(table[0]) + " |", "|" + "---|" * len(table[0])]
    return lines + ["| " + " | ".join(map(text, row.values())) + " |" for row in table]
