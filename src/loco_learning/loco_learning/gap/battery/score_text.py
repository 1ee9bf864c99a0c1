# SPDX-License-Identifier: Apache-2.0
"""The score of a battery as Markdown tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

RATES = (
    "cases", "top-1", "right", "first choice", "top-2", "with others", "abstained", "no gap",
)  # fmt: skip
WANTED = (  # figure, where it stands, what is asked for
    ("top-1 name, single effects, medium and large", ("singles medium and large", "top-1"),
     ">= 90 %"),
    ("the same, or both of two that no data can tell apart",
     ("singles medium and large", "right"), ""),
    ("first choice (the model it selects, also where it abstains), the same cases",
     ("singles medium and large", "first choice"), ""),
    ("top-2 name, the same cases", ("singles medium and large", "top-2"), ""),
    ("abstained (ambiguous or unknown), the same cases",
     ("singles medium and large", "abstained"), ""),
    ("top-1 name, single effects, small", ("singles small", "top-1"), ""),
    ("called no gap, single effects, small", ("singles small", "no gap"), ""),
    ("pairs: both named", ("pairs both named",), ">= 60 %"),
    ("pairs: at least one named", ("pairs one named",), ""),
    ("false names on nulls", ("false names on nulls",), "<= 5 %"),
    ("false names over all cases", ("false names",), ""),
    ("effects outside the registry: unknown or ambiguous", ("outsiders unknown or ambiguous",),
     ">= 80 %"),
    ("place right", ("place right",), ">= 90 %"),
    ("held-out reducible gap closed, median", ("held-out gap closed median",), ">= 85 %"),
    ("size error, median", ("size error median",), ""),
    ("intervals that hold the true size", ("intervals that hold the truth",), "95 %"),
)  # fmt: skip


def acceptance(figures: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Rows of figure, value, what is asked for."""
    made = []
    for text, path, wanted in WANTED:
        value: Any = figures
        for key in path:
            value = value[key]
        made.append((text, percent(value), wanted))
    return made


def markdown(figures: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], title: str) -> str:
    """The whole score."""
    seconds = figures["seconds median"]
    count = f"{figures['cases']} cases, {figures['errors']} of them ended by an error"
    parts = [f"# {title}", count + f"; median {seconds:.0f} s per case." if seconds else count]
    parts.append(table(("figure", "value", "wanted"), acceptance(figures)))
    parts.append("## By robot and size (single effects)")
    parts.append(table(*rates(figures)))
    parts.append("By robot: medium and large.")
    parts.append("## Held-out error, in noise floors")
    parts.append(table(*held_out(figures["held-out error"])))
    parts.append("## Cases")
    parts.append(table(("case", "robot", "hidden", "size", "verdict", "names", "before", "after"),
                       [case(r) for r in rows]))  # fmt: skip
    return "\n\n".join(parts) + "\n"


def rates(figures: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the table of single effects, by size and by robot."""
    rows = [
        (name, *(str(found[k]) if k == "cases" else percent(found[k]) for k in RATES))
        for group in ("by size", "by robot")
        for name, found in figures[group].items()
    ]
    return ("", *RATES), rows


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
    said = ", ".join(r["said"]) or (r["error"][:60] if r["verdict"] == "error" else "")
    return (
        r["case"], r["robot"], ", ".join(r["true"]) or "nothing", r["size"], r["verdict"], said,
        number(r["before"]), number(r["after"]),
    )  # fmt: skip


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def percent(value: float | None) -> str:
    """Share in percent."""
    return "–" if value is None else f"{100.0 * value:.0f} %"


def number(value: float | None) -> str:
    """Three digits."""
    return "–" if value is None else f"{value:.3g}"
