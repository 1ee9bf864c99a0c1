# SPDX-License-Identifier: Apache-2.0
"""Sentences from the contents of gap.json, for terminal, page and ROS action."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from loco_learning.gap.setup.contents import SETUP
from loco_sim.effects.base import EFFECTS

Result = Mapping[str, Any]


def words(name: str) -> str:
    """Name of an effect or experiment as text: ``coulomb_friction`` → "coulomb friction"."""
    return name.replace("_", " ")


def number(value: Any) -> str:
    """A number with three digits; a dash for no number."""
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        return "–"
    return f"{value:.3g}".replace("e-0", "e-").replace("e+0", "e")


NAMED = ("named", "named, and more is missing")


def place_of(place: Any) -> str:
    """Place of a term as text."""
    if not place or place == "*":
        return "the whole robot"
    if isinstance(place, (list, tuple)):
        return listed([place_of(p) for p in place])
    return str(place).replace("*_", "all ").replace("_joint", "").replace("_", " ")


def listed(items: Sequence[str], conjunction: str = "and") -> str:
    """Items joined as "a, b and c"."""
    items = list(items)
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {conjunction} {items[-1]}"


def term_name(term: Mapping[str, Any]) -> str:
    """Name and place of a term."""
    return f"{words(term['effect'])} in {place_of(term.get('place'))}"


FLOOR = "A noise floor is what sensors and numerics leave of a model that lacks nothing."
CLOSED = "of the rms above the noise floor, on held-out data"


def sizes_of(term: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value with its unit, and interval of each parameter."""
    out = []
    for name, p in (term.get("parameters") or {}).items():
        unit = "" if p.get("unit") in (None, "", "-") else f" {p['unit']}"
        out.append((words(name), f"{number(p.get('value'))}{unit}", _interval(p)))
    return out


def _interval(parameter: Mapping[str, Any]) -> str:
    """Bounds of a parameter; the data may give one side, or none."""
    low, high = (number(parameter.get(side)) for side in ("low", "high"))
    if low == high == "–":
        return "not determined"
    if "–" in (low, high):
        return f"at most {high}" if low == "–" else f"at least {low}"
    return f"{low} to {high}"


def sizes(term: Mapping[str, Any]) -> list[str]:
    """Each parameter with its interval and unit."""
    return [f"{name} {value} ({interval})" for name, value, interval in sizes_of(term)]


def first(items: Sequence[str]) -> str:
    """First of some sentences; empty if there are none."""
    return str(items[0]) if items else ""


def next_step(result: Result) -> str:
    """Recommended next step if the verdict names no effect."""
    if result.get("next"):
        return f"record {next_line(result['next'][0])}: loco gap next DIR writes it"
    if lines := at_the_robot(result):
        return f"to tell {lines[0]}"
    if result["verdict"] == "ambiguous":
        return "record a motion of another speed, load or pose, and add it: loco gap DIR --add BAG"
    return "look there at the robot, record a motion that dwells there, and add it: loco gap DIR --add BAG"


def headline(result: Result) -> str:
    """The verdict in one sentence."""
    verdict, terms = result["verdict"], result.get("terms") or []
    if verdict == SETUP:
        first = "; ".join(one["says"] for one in result["setup"] if one["stops"])
        return f"Unknown, since the set-up is wrong: {first}."
    if verdict == "no gap":
        return "No gap: nothing needs to be added to the model."
    if verdict in NAMED:
        suffix = " More is missing." if verdict != "named" else ""
        return f"Named: {listed([term_name(t) for t in terms if _named(t)] or ['-'])}.{suffix}"
    if verdict == "ambiguous":
        groups = [listed([_alternative(n) for n in group], "or") for group in ambiguous(result)]
        identified = [term_name(t) for t in terms if t.get("verdict") == "named"]
        identified += [f"{k['kind']} in {place_of(k['places'])}, by what law is not told"
                       for k in result.get("kinds") or ()]  # fmt: skip
        suffix = f" Named: {'; '.join(identified)}." if identified else ""
        suffix += " More is missing." if result.get("adequate") is False else ""
        return f"Ambiguous: {'; '.join(groups)}. These recordings cannot tell.{suffix}"
    return "Unknown: the model lacks something that none of the effects tried explains."


def _named(term: Mapping[str, Any]) -> bool:
    return term.get("verdict", "named") == "named"


def ambiguous(result: Result) -> list[list[Any]]:
    """Groups of indistinguishable explanations; the terms themselves if none are listed."""
    groups = [list(g) for g in result.get("ambiguous") or () if g]
    return groups or [list(result.get("names") or ["-"])]


def _alternative(item: Any) -> str:
    if isinstance(item, Mapping):
        return term_name(item)
    return words(str(item))


def term_lines(result: Result) -> list[str]:
    """One line per term: effect, place, size, certainty."""
    lines = []
    for term in result.get("terms") or ():
        sure, amount = probability(term.get("probability")), str(term.get("amount") or "")
        lines.append(
            f"{term_name(term)}: {', '.join(sizes(term)) or 'no size'}"
            f"{', so that ' * bool(amount)}{amount}; probability {sure}"
        )
    return lines


def probability(value: Any) -> str:
    """A probability as text; a dash for none."""
    if not isinstance(value, (int, float)):
        return "–"
    return "over 0.999" if value > 0.999 else f"{value:.3f}" if value > 0.99 else f"{value:.2g}"


def odds_text(odds: Any) -> str:
    """Odds as text."""
    if not isinstance(odds, (int, float)):
        return "–"
    return "over 1000 : 1" if odds > 1e3 else f"{number(odds)} : 1"


def gap_line(result: Result) -> str:
    """Sentence on the residual of the model before and after, on held-out data."""
    gap = result.get("gap") or {}
    if gap.get("before") is None:
        return ""
    name, *rest = [f"{number(gap[key])}{{}} {key}" for key in told(result)]
    line = f"gap on held-out data: {', '.join([name.format(' noise floors'), *rest])}".format("")
    if told(result, ("after",)) == ["after"] and result["verdict"] != "no gap":
        line += f"; share closed {closed_rms(gap)} (of the rms above the noise floor)"
    return line


def learned_line(result: Result) -> str:
    """Sentence about the learned correction and its type; empty if none was requested."""
    residual = result.get("residual")
    return f"{residual['kind'].replace(':', ',')}: {residual['says']}" if residual else ""


def closed_rms(gap: Mapping[str, Any]) -> str:
    """Share [%] by which the rms above the noise floor on held-out data is reduced."""
    return f"{round(100.0 * gap['closed']):d} %"


def summary(result: Result) -> str:
    """Headline, terms and gap of a result, one per line."""
    return "\n  ".join([headline(result), *term_lines(result), gap_line(result)]).rstrip()


def told(result: Result, keys: Sequence[str] = ("before", "after")) -> list[str]:
    """Keys of the available gap figures; only ``before`` if the verdict is unknown."""
    stages = [key for key in keys if result["gap"].get(key) is not None]
    return [key for key in stages if result["verdict"] != "unknown" or key == "before"]


def at_the_robot(result: Result) -> list[str]:
    """Tests on the robot that distinguish ambiguous effects, from the registry, one per pair."""
    tests: dict[frozenset[str], list[str]] = {}
    for group in ambiguous(result) if result["verdict"] == "ambiguous" else ():
        names = {str(item).split(" ")[0] for item in group}
        for name in sorted(names & set(EFFECTS)):
            for similar in EFFECTS[name].identity.look_alikes:
                if similar.name in names:
                    tests.setdefault(frozenset((name, similar.name)), []).append(similar.experiment)
    return [
        f"{listed([words(n) for n in sorted(pair)], 'from')}: {'; or '.join(dict.fromkeys(tasks))}"
        for pair, tasks in tests.items()
    ]


def next_line(row: Mapping[str, Any]) -> str:
    """Benefit of an experiment as text."""
    parts = separated(row)
    purpose = f" tells {listed(parts, 'from')} apart" if len(parts) > 1 else ""
    odds = f", odds expected {odds_text(row['odds'])}" if row.get("odds") else ""
    return f"{words(str(row['experiment']))}{purpose}{odds}"


def separated(row: Mapping[str, Any]) -> list[str]:
    """The explanations that an experiment distinguishes."""
    items = row.get("separates") or []
    return [items] if isinstance(items, str) else [_alternative(x) for x in items]
