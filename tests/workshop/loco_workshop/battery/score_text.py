# SPDX-License-Identifier: Apache-2.0
"""The score of a battery as Markdown tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

RATES = (
    "cases", "top-1", "right", "kind told", "first choice", "top-2", "with others", "abstained",
    "no gap",
)  # fmt: skip
AFTER = "after the experiment it proposes"
THEN = ("next experiment", "then")
WANTED = (  # name of the figure, its key, requirement
    ("top-1 name, single effects, medium and large", ("singles medium and large", "top-1"),
     ">= 90 %"),
    ("the same, or both of two that no data can tell apart",
     ("singles medium and large", "right"), ""),
    ("the same, or ambiguous between laws of the right kind (a delay, a mass)",
     ("singles medium and large", "kind told"), ""),
    ("first choice (the model it selects, also where it abstains), the same cases",
     ("singles medium and large", "first choice"), ""),
    ("top-2 name, the same cases", ("singles medium and large", "top-2"), ""),
    ("abstained (ambiguous or unknown), the same cases",
     ("singles medium and large", "abstained"), ""),
    ("top-1 name, single effects, small", ("singles small", "top-1"), ""),
    ("called no gap, single effects, small", ("singles small", "no gap"), ""),
    ("pairs: both named", ("pairs both named",), ">= 60 %"),
    ("pairs: both named, or one and that something is late (command or sensors)",
     ("pairs right",), ""),
    ("pairs: at least one named", ("pairs one named",), ""),
    ("false names on nulls", ("false names on nulls",), "<= 5 %"),
    ("false names over all cases", ("false names",), ""),
    ("false names, model a little off", ("false names, model a little off",), "<= 3 %"),
    ("effects outside the registry: unknown or ambiguous", ("outsiders unknown or ambiguous",),
     ">= 80 %"),
    ("the same, or named with the word that more is missing", ("outsiders with a reserve",),
     ">= 95 %"),
    ("place right", ("place right",), ">= 90 %"),
    ("same names under other settings, where any is given",
     ("same names under other settings",), ">= 95 %"),
    ("no name under other settings", ("no name under other settings",), ""),
    ("held-out reducible gap closed, median", ("held-out gap closed median",), ">= 85 %"),
    ("size error, median", ("size error median",), ""),
    ("intervals that hold the true size", ("intervals that hold the truth",), ">= 90 %"),
)  # fmt: skip


def acceptance(
    figures: Mapping[str, Any], later: Mapping[str, Any] | None = None
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of a table: figure, value, value after the next experiment, requirement.

    Args:
        figures: Statistics from the initial bags of all cases.
        later: Statistics after the experiments proposed by ambiguous verdicts.
    """
    rows = []
    for text, path, target in WANTED:
        values: list[Any] = [figures] if later is None else [figures, later]
        for key in path:
            values = [value[key] for value in values]
        rows.append((text, *map(percent, values), target))
    return ("figure", "value", *(() if later is None else (AFTER,)), "wanted"), rows


def markdown(
    figures: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    title: str,
    later: Mapping[str, Any] | None = None,
) -> str:
    """The score as Markdown text."""
    count = f"{figures['cases']} cases, {figures['errors']} of them ended by an error"
    parts = [f"# {title}", f"{count}."]
    parts.append(table(*acceptance(figures, later)))
    parts.append("## By size, robot and condition (single effects)")
    parts.append(table(*rates(figures)))
    parts.append("By robot and condition: medium and large.")
    if later is not None:
        parts.append("The same " + AFTER + ", where the verdict was ambiguous:")
        parts.append(table(*rates(later)))
    if figures["calibration"]["probabilities"]:
        parts.append("## Calibration of the probabilities")
        parts.append(table(*calibration(figures["calibration"])))
    parts.append("## Held-out error, in noise floors")
    parts.append(table(*held_out(figures["held-out error"])))
    parts.append("## Cases")
    head = ("case", "robot", "hidden", "size", "verdict", "names", "before", "after")
    columns = then(rows) if later is not None else [()] * len(rows)
    cells = [(*case(r), *extra) for r, extra in zip(rows, columns, strict=True)]
    parts.append(table((*head, *(THEN if later is not None else ())), cells))
    return "\n\n".join(parts) + "\n"


def rates(figures: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the table of single effects, by size, robot and condition."""
    rows = [
        (name, *(str(rate[k]) if k == "cases" else percent(rate[k]) for k in RATES))
        for group in ("by size", "by robot", "by condition")
        for name, rate in figures[group].items()
    ]
    return ("", *RATES), rows


def calibration(values: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the table of the calibration."""
    return ("figure", "value"), [
        (name, str(v) if name == "probabilities" else number(v)) for name, v in values.items()
    ]


def held_out(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the table of held-out errors."""
    head = ("model", "median", "geometric mean", "gap closed", "worse than loco gap")
    rows = [
        (name, number(v["median"]), number(v["geometric mean"]), percent(v["closed"]),
         percent(v.get("worse than loco gap")))
        for name, v in found.items() if name != "cases"
    ]  # fmt: skip
    return head, rows


def case(r: Mapping[str, Any]) -> tuple[str, ...]:
    """Row of the table of cases."""
    names = ", ".join(r["said"]) or (r["error"][:60] if r["verdict"] == "error" else "")
    return (
        r["case"], r["robot"], ", ".join(r["true"]) or "nothing", r["size"], r["verdict"], names,
        number(r["before"]), number(r["after"]),
    )  # fmt: skip


def then(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Cells with the proposed experiment and the verdict after it, per row."""
    pairs = [(r["experiment"], r["then"]) for r in rows]
    return [(name, ", ".join(r["said"]) or r["verdict"]) if r else ("", "") for name, r in pairs]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def percent(value: float | None) -> str:
    """Share in percent, with one decimal below one percent."""
    if value is None:
        return "–"
    return f"{100.0 * value:.{1 if 0.0 < value < 0.01 else 0}f} %"


def number(value: float | None) -> str:
    """A number with three digits."""
    return "–" if value is None else f"{value:.3g}"
