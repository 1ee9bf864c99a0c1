# SPDX-License-Identifier: Apache-2.0
"""Tables of the page of `loco gap` as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from loco_learning.gap.curves import Curves
from loco_learning.gap.errors import error_rows

from . import gap_text as text
from .report_tables import table

Result = Mapping[str, Any]
MOST = 12  # rows of a table of cells


def plain(value: Any) -> str:
    """Any value of gap.json as text of a cell."""
    if value is None or value == "":
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return str(value) if isinstance(value, int) else text.number(value)
    if isinstance(value, Mapping):
        if {"mean", "low", "high"} <= set(value):
            low, high = text.number(value["low"]), text.number(value["high"])
            return f"{text.number(value['mean'])} ({low} to {high})"
        return ", ".join(f"{k} {plain(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(plain(v) for v in value)
    return str(value)


def rows_of(items: Sequence[Mapping[str, Any]], keys: Sequence[str] = ()) -> str:
    """Table of mappings; columns are the keys that any of them has, in the order given first."""
    found = list(dict.fromkeys([*keys, *(k for item in items for k in item)]))
    used = [k for k in found if any(item.get(k) not in (None, "", [], {}) for item in items)]
    numeric = [
        i for i, k in enumerate(used)
        if all(isinstance(item.get(k), (int, float, type(None))) for item in items)
    ]  # fmt: skip
    body = [[escape(plain(item.get(k))) for k in used] for item in items]
    return table([escape(text.words(k)) for k in used], body, numeric)


def cells(result: Result) -> str:
    """Cells of the gap map, the largest first."""
    items = result["where"][:MOST]
    if not items:
        return ""
    return f"<p class='soft'>{_CELLS}</p>{rows_of(items)}"


def terms(result: Result) -> str:
    """What was found, one row per term."""
    items = result["terms"]
    if not items:
        return ""
    head = ["Effect", "Place", "Size (interval)", "Verdict", "Gain (interval)", "Odds", "Closed",
            "Looks like"]  # fmt: skip
    body = [
        [
            escape(text.words(t["effect"])),
            escape(text.place_of(t.get("place"))),
            escape("; ".join(text.sizes(t))),
            escape(plain(t.get("verdict"))),
            escape(plain(t.get("gain"))),
            escape(text.odds_text(t.get("odds"))),
            _share(t.get("closed")),
            escape(", ".join(text.words(plain(x)) for x in t.get("look_alikes") or ())),
        ]
        for t in items
    ]
    return table(head, body, (6,))


def rivals(result: Result) -> str:
    """Explanations of other names, the best first."""
    items = result["rivals"]
    if not items:
        return "<p class='soft'>No other effect came near.</p>"
    body = [
        [
            escape(", ".join(text.words(str(n)) for n in r.get("names") or ())),
            escape("; ".join(text.place_of(p) for p in r.get("places") or ())),
            escape(plain(r.get("gain"))),
            escape(text.odds_text(r.get("odds"))),
            _share(r.get("closed")),
        ]
        for r in items
    ]
    head = ["Rival", "Place", "Gain over it (interval)", "Odds against it", "It closes"]
    return f"<p class='soft'>{_RIVALS}</p>{table(head, body, (4,))}"


def _share(value: Any) -> str:
    return f"{round(100.0 * value):d} %" if isinstance(value, (int, float)) else "–"


def errors(curves: Curves) -> str:
    """Normalised errors of every record with intervals."""
    head = ["Record", "Role", "Channel", "NRMSE before", "NRMSE after", "Windowed before",
            "Windowed after"]  # fmt: skip
    body = [
        [escape(cell).replace(" (", "<br><span class='soft'>").replace(")", "</span>") if i > 2
         else escape(cell) for i, cell in enumerate(row)]
        for row in error_rows(curves)
    ]  # fmt: skip
    return f"<p class='soft'>{_ERRORS}</p>{table(head, body, (3, 4, 5, 6))}"


def identifiability(result: Result) -> str:
    """What the data say about the parameters, in words where there are words."""
    found = result.get("identifiability") or {}
    if not found:
        return "<p class='soft'>Nothing was fitted.</p>"
    parts = []
    for key, value in found.items():
        title = f"<p><strong>{escape(text.words(str(key)).capitalize())}</strong></p>"
        if isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            parts.append(title + rows_of(value))
        elif isinstance(value, Mapping) and value:
            rows = [[escape(text.words(str(k))), escape(plain(v))] for k, v in value.items()]
            parts.append(title + table(["", ""], rows))
        elif value not in (None, [], {}, ""):
            parts.append(f"{title}<p>{escape(plain(value))}</p>")
    return "".join(parts)


def proposals(result: Result) -> str:
    """Experiments that would tell most."""
    items, lines = result.get("next") or [], text.at_the_robot(result)
    by_hand = "".join(f"<li>To tell {escape(line)}.</li>" for line in lines)
    by_hand = f"<p>{_BY_HAND}</p><ul>{by_hand}</ul>" if by_hand else ""
    if not items:
        none = "none of the library" if by_hand else "nothing is left to tell apart"
        return f"<p class='soft'>None: {none}.</p>{by_hand}"
    rows = [
        [
            escape(text.words(str(r["experiment"]))),
            escape(text.listed(text.separated(r), "from")),
            escape(text.odds_text(r.get("odds"))),
        ]
        for r in items
    ]
    return f"<p>{_NEXT}</p>{table(['Experiment', 'Tells', 'Odds expected'], rows)}{by_hand}"


def correction(result: Result) -> str:
    """The fallback of an unknown gap."""
    found = result.get("correction")
    if not found:
        return ""
    channels = [c for c in found.get("channels") or () if isinstance(c, Mapping)]
    shown = [{k: v for k, v in c.items() if k != "weights"} for c in channels]
    kind = escape(str(found.get("kind") or "Correction, not an explanation").capitalize())
    return f"<p><strong>{kind}</strong></p><p class='soft'>{_CORRECTION}</p>" + (
        rows_of(shown, ("signal", "name", "unit")) if shown else ""
    )


def notes(result: Result) -> str:
    """What aligning found, and the gap of each record."""
    found = "".join(f"<li>{escape(str(n))}</li>" for n in result.get("align") or ())
    rows = result["gap"].get("records") or []
    return (rows_of(rows, ("name", "role")) if rows else "") + (
        f"<ul>{found}</ul>" if found else ""
    )


def settings(result: Result) -> str:
    """Settings and refitted nominal values."""
    rows = [
        [escape(text.words(str(k))), escape(plain(v))]
        for part in ("settings", "nuisance")
        for k, v in (result.get(part) or {}).items()
    ]
    return table(["Setting", "Value"], rows)


_CELLS = (
    "The parts of the data that hold most of the gap before. Share: of the whole gap, beyond the "
    "noise."
)
_RIVALS = (
    "The best explanations of another name, fitted in the same way. Gain: how much better what "
    "was found explains the data than the rival does, in log-likelihood, with its interval."
)
_ERRORS = (
    "NRMSE: rms of the error over the standard deviation of the measurement. Windowed: mean "
    "absolute error, where the model may be early or late by a little, as thesis eq. (5.4). "
    "Intervals: 90 %, bootstrap over blocks. The channels with the largest gap."
)
_CORRECTION = (
    "A ridge regression of what the model misses on angles, speeds and commands: it says how much "
    "of the gap depends on them, and nothing about the cause. Its weights are in gap.json."
)
_BY_HAND = "At the robot:"
_NEXT = (
    "<code>loco gap next DIR</code> writes the first as a file, <code>loco run</code> executes it, "
    "<code>loco gap DIR --add BAG</code> takes the new recording in."
)
