# SPDX-License-Identifier: Apache-2.0
"""Tables of the page of `loco gap` as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from loco_learning.gap.localisation.errors import error_rows

from ..page import html
from ..page.html import table
from . import text

if TYPE_CHECKING:
    from loco_learning.gap.localisation.curves import Curves

Result = Mapping[str, Any]
MAX_ROWS = 12  # largest number of rows in the table of cells


def cell_text(value: Any) -> str:
    """Text of a table cell for any value of gap.json."""
    if value is None or value == "":
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return str(value) if isinstance(value, int) else text.number(value)
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {cell_text(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(cell_text(v) for v in value)
    return str(value)


def rows_of(items: Sequence[Mapping[str, Any]], keys: Sequence[str] = ()) -> Markup:
    """Table of mappings, one column per key; the keys in `keys` come first."""
    columns = list(dict.fromkeys([*keys, *(k for item in items for k in item)]))
    used = [k for k in columns if any(item.get(k) not in (None, "", [], {}) for item in items)]
    numeric = [
        i for i, k in enumerate(used)
        if all(isinstance(item.get(k), (int, float, type(None))) for item in items)
    ]  # fmt: skip
    body = [[cell_text(item.get(k)) for k in used] for item in items]
    return table([text.words(k) for k in used], body, numeric)


def cells(result: Result) -> Markup:
    """Table of the cells of the gap map, largest first."""
    items = result["where"][:MAX_ROWS]
    if not items:
        return Markup()
    return html.paragraph(_CELLS, soft=True) + rows_of(items)


def terms(result: Result) -> Markup:
    """Table of the effects found, one row per term."""
    items = result["terms"]
    if not items:
        return Markup()
    head = ["Effect", "Place", "Size (interval)", "Verdict", "Probability", "Share closed",
            "Looks like"]  # fmt: skip
    body = [
        [
            text.words(t["effect"]),
            text.place_of(t.get("place")),
            "; ".join(text.sizes(t)),
            cell_text(t.get("verdict")),
            text.probability(t.get("probability")),
            _share(t.get("closed")),
            ", ".join(text.words(cell_text(x)) for x in t.get("look_alikes") or ()),
        ]
        for t in items
    ]
    return table(head, body, (5,))


def over_settings(result: Result) -> Markup:
    """Table of the answers with other splits of the records, segment lengths and noise floors."""
    items = result.get("over_settings", [])
    if not items:
        return Markup()
    body = [
        [
            row["vary"], row["setting"], ", ".join(map(text.words, row["names"])) or "nothing",
            text.probability(row["probability"]), _share(row["closed"]),
        ]
        for row in items
    ]  # fmt: skip
    head = ["Varied", "Setting", "Most probable there", "Probability of the name", "Share closed"]
    return html.paragraph(_SETTINGS, soft=True) + table(head, body, (4,))


def rivals(result: Result) -> Markup:
    """Table of alternative explanations, best first."""
    items = result["rivals"]
    if not items:
        return html.paragraph("No other effect came near.", soft=True)
    body = [
        [
            ", ".join(text.words(str(n)) for n in r.get("names") or ()),
            "; ".join(text.place_of(p) for p in r.get("places") or ()),
            text.probability(r.get("probability")),
            _share(r.get("closed")),
        ]
        for r in items
    ]
    head = ["Rival", "Place", "Probability", "Share closed"]
    return html.paragraph(_RIVALS_NOTE, soft=True) + table(head, body, (3,))


def _share(value: Any) -> str:
    return f"{round(100.0 * value):d} %" if isinstance(value, (int, float)) else "–"


def errors(curves: Curves) -> Markup:
    """Table of the normalised errors of every record with intervals."""
    head = ["Record", "Role", "Channel", "NRMSE before", "NRMSE after", "Windowed before",
            "Windowed after"]  # fmt: skip
    body = [
        [_with_interval(cell) if i > 2 else cell for i, cell in enumerate(row)]
        for row in error_rows(curves)
    ]
    return html.paragraph(_ERRORS, soft=True) + table(head, body, (3, 4, 5, 6))


def _with_interval(cell: str) -> Markup | str:
    """Cell with a number and, below it, the bracketed interval that follows it in the text."""
    value, bracket, interval = cell.partition(" (")
    if not bracket:
        return cell
    return Markup("{}<br>{}").format(value, html.note(interval.rstrip(")")))


def identifiability(result: Result) -> Markup:
    """Table of how well the data determine each parameter."""
    values = result.get("identifiability") or {}
    if not values:
        return html.paragraph("Nothing was fitted.", soft=True)
    parts = []
    for key, value in values.items():
        title = html.paragraph(html.strong(text.words(str(key)).capitalize()))
        if isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            parts.append(title + rows_of(value))
        elif isinstance(value, Mapping) and value:
            rows = [[text.words(str(k)), cell_text(v)] for k, v in value.items()]
            parts.append(title + table(["", ""], rows))
        elif value not in (None, [], {}, ""):
            parts.append(title + html.paragraph(cell_text(value)))
    return html.join(parts)


def proposals(result: Result) -> Markup:
    """Table of the most informative experiments."""
    items, lines = result.get("next") or [], text.at_the_robot(result)
    by_hand = html.bullets(f"To tell {line}." for line in lines)
    by_hand = html.paragraph(_BY_HAND) + by_hand if lines else Markup()
    if not items:
        none = "none of the library" if lines else "nothing is left to tell apart"
        return html.paragraph(f"None: {none}.", soft=True) + by_hand
    rows = [
        [
            text.words(str(r["experiment"])),
            text.listed(text.separated(r), "from"),
            text.odds_text(r.get("odds")),
        ]
        for r in items
    ]
    listed = table(["Experiment", "Tells", "Odds expected"], rows)
    return html.join([html.paragraph(_NEXT), listed, by_hand])


def correction(result: Result) -> Markup:
    """Table of the empirical correction that is the fallback for an unknown gap."""
    section = result.get("correction")
    if not section:
        return Markup()
    channels = [c for c in section.get("channels") or () if isinstance(c, Mapping)]
    summaries = [{k: v for k, v in c.items() if k != "weights"} for c in channels]
    kind = str(section.get("kind") or "Correction, not an explanation").capitalize()
    text_of_it = [html.paragraph(html.strong(kind)), html.paragraph(_CORRECTION, soft=True)]
    rows = [rows_of(summaries, ("signal", "name", "unit"))] if summaries else []
    return html.join([*text_of_it, *rows])


def learned(result: Result) -> Markup:
    """Learned correction: its description, and its effect on each held-out record."""
    sentence = text.learned_line(result)
    if not sentence:
        return Markup()
    rows = result["residual"].get("records") or []
    return html.paragraph(html.strong(sentence)) + (rows_of(rows, ("name",)) if rows else Markup())


def notes(result: Result) -> Markup:
    """Gap of each record, and notes from alignment and search."""
    unique = list(dict.fromkeys([*(result.get("align") or ()), *(result.get("notes") or ())]))
    rows = result["gap"].get("records") or []
    listed = html.bullets(str(n) for n in unique)
    return (rows_of(rows, ("name", "role")) if rows else Markup()) + listed


def not_tried(result: Result) -> Markup:
    """List of the effects that the search did not try, each with the reason."""
    rows = result.get("not_tried") or ()
    items = [f"{text.words(str(r['effect']))}, since {r['reason']}" for r in rows]
    return html.bullets(items) or html.paragraph("None.", soft=True)


def settings(result: Result) -> Markup:
    """Table of settings and refitted nominal values."""
    rows = [
        [text.words(str(k)), cell_text(v)]
        for part in ("settings", "nuisance")
        for k, v in (result.get(part) or {}).items()
    ]
    return table(["Setting", "Value"], rows)


_CELLS = (
    "The parts of the data that hold most of the gap before. Share: of the whole gap, beyond the "
    "noise floor."
)
_RIVALS_NOTE = (
    "Other models, fitted in the same way. Probability: share of the weight of all models that "
    "were fitted, which sums to 1."
)
_SETTINGS = (
    "Does the name hang on a setting? For each split the model and its rivals are fitted again to "
    "the other records. Where the name is less probable than 1 : 3, there is an alarm."
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
_NEXT = Markup(
    "<code>loco gap next DIR</code> writes the first as a file, <code>loco run</code> executes it, "
    "<code>loco gap DIR --add BAG</code> takes the new recording in."
)
