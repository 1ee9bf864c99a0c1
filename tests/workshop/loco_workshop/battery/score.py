# SPDX-License-Identifier: Apache-2.0
"""Score of a battery: a row per case, then statistics over rows.

A verdict on a single effect is correct if exactly this effect is named. If two effects are
indistinguishable even in principle (`twins`), the verdict "ambiguous" with both is correct,
and naming one of them is not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from loco_learning.gap.verdict.decide import NAMED, PARTLY
from loco_sim.effects import EFFECTS

from .drawn import fleet
from .ground import walkers

TWINS = tuple({name, *cls.identity.twins} for name, cls in EFFECTS.items() if cls.identity.twins)
LEVEL = {"com_offset", "constant_force", "slope"}  # of one joint that turns
STRAIGHT = {"constant_force", "slope", "torque_bias"}  # of one that slides
LATE = frozenset({"command_delay", "sensor_latency"})  # effects of late stamps
SURE = (NAMED, PARTLY)  # verdicts with a name, complete or not
UNNAMED = ("ambiguous", "unknown", "no gap", "error")
OFF, EXACT = "model a little off", "model exact"
BASELINES = {
    "everything": "fit everything", "sparse": "sparse terms", "cma": "CMA-ES calibration",
    "sysid": "mujoco.sysid",
}  # fmt: skip


def row(truth: Mapping[str, Any], result: Mapping[str, Any]) -> dict[str, Any]:
    """Row of the score for a case.

    Args:
        truth: Hidden effects, in the format of `cases.truth`.
        result: Parts of gap.json.
    """
    true = sorted({e["effect"] for e in truth["effects"]})
    how = truth.get("condition", {})
    besides = LATE - set(true) if how.get("way") == "late" else frozenset()
    names, verdict = sorted(set(result.get("names", [])) - besides), result["verdict"]
    kind = truth["kind"]
    options = _options(result)
    cells = {
        "case": truth["name"], "robot": truth["robot"], "kind": kind, "size": truth["size"],
        "true": true, "shows": truth["shows"], "verdict": verdict, "said": names,
        "condition": (how.get("way") or "clean", OFF if how.get("off") else EXACT),
        "options": options, "error": result.get("error", ""),
    }  # fmt: skip
    machine = _machine(truth["robot"])
    cells["groups"] = (
        (truth["robot"],) if truth["robot"] in walkers.WALKERS else fleet.groups(machine)
    )
    equivalents = twins_of(truth["robot"])
    twin = next((sorted(t) for t in equivalents if set(true) <= t), None) if true else None
    if true == ["sensor_latency"] and machine.torque_noise:
        twin = None  # torque readings are not delayed, so the two can be distinguished
    hedged = verdict == "ambiguous" and any(set(true) <= set(o) for o in _groups(result))
    cells["named"] = verdict in SURE and bool(names or not result.get("names"))
    cells["top1"] = bool(true) and verdict in SURE and names == true
    cells["first"] = bool(true) and sorted({t["effect"] for t in result.get("terms", [])}) == true
    cells["kind_told"] = (
        cells["top1"]
        or verdict == "ambiguous"
        and any(
            kind_of(true[0]) and {kind_of(name) for name in group} == {kind_of(true[0])}
            for group in (_groups(result) if len(true) == 1 else ())
        )
    )
    cells["right"] = cells["top1"] if twin is None else hedged
    if kind == "pair":
        cells["right"] = (
            cells["top1"] or verdict == "ambiguous" and _both(true, names, result, equivalents)
        )
    cells["top2"] = cells["right"] or bool(true) and (hedged or set(true) <= set(options[:2]))
    cells["with_others"] = verdict in SURE and bool(true) and set(true) < set(names)
    cells["false"] = cells["named"] and kind in ("null", "outsider")
    cells["more"] = verdict == PARTLY
    cells["abstained"] = verdict in ("ambiguous", "unknown")
    cells["place"], cells["sizes"] = _found(truth, result)
    cells["closed"], cells["before"], cells["after"] = _gap(result)
    cells["baselines"] = {
        name: {"after": entry.get("after")} for name, entry in result.get("baselines", {}).items()
    }
    cells["settings"] = [
        sorted(set(answer["names"]) - besides) if answer["verdict"] in SURE else []
        for answer in result.get("settings", [])
    ]
    effects = (result.get("probability") or {}).get("effects", {})
    cells["probabilities"] = [(p, name in true) for name, p in effects.items()]
    later = result.get("followed")
    cells["experiment"] = later["experiment"] if later else ""
    last = row(truth, later) if later else None
    cells["then"] = last["then"] or last if last else None
    if last and last["experiment"]:
        cells["experiment"] += f", {last['experiment']}"
    return cells


def kind_of(name: str) -> str:
    """Kind of an effect; empty if it has none, or if there is no such effect."""
    return EFFECTS[name].identity.kind if name in EFFECTS else ""


def followed(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Rows after the experiments proposed by ambiguous verdicts; empty if none ran."""
    return [r["then"] or r for r in rows] if any(r["then"] for r in rows) else []


def _groups(result: Mapping[str, Any]) -> list[list[str]]:
    """Sets of effects that the workflow cannot distinguish."""
    groups = [[str(name).split(" ")[0] for name in g] for g in result.get("ambiguous", [])]
    return groups or ([list(result["names"])] if result.get("names") else [])


def twins_of(robot: str) -> list[set[str]]:
    """Sets of effects that no data of a robot can distinguish."""
    machine = _machine(robot)
    if len(machine.joints) > 1:
        return list(TWINS)
    return [*TWINS, STRAIGHT if machine.body.slides[0] else LEVEL]


def _both(
    true: Sequence[str], said: Sequence[str], result: Mapping[str, Any], twins: Sequence[set[str]]
) -> bool:
    """Whether all effects are named, where twins may be reported as ambiguous."""
    groups = [set(group) for group in _groups(result)]
    groups_named = {name for group in groups for name in group if name in true}
    alike = all(any(group <= each for each in twins) for group in groups)
    return alike and {*said, *groups_named} == set(true)


def _options(result: Mapping[str, Any]) -> list[str]:
    """Effects by decreasing rank in the result of the workflow, without duplicates."""
    ordered = list(result.get("names", []))
    for group in result.get("ambiguous", []):
        ordered += [str(name).split(" ")[0] for name in group]
    ordered += [term["effect"] for term in result.get("terms", [])]
    for rival in result.get("rivals", []):
        ordered += rival.get("names", [])
    return list(dict.fromkeys(ordered))


def _found(
    truth: Mapping[str, Any], result: Mapping[str, Any]
) -> tuple[bool | None, list[dict[str, Any]]]:
    """Whether all correctly named effects have the correct place, and errors of their sizes."""
    terms = {t["effect"]: t for t in result.get("terms", []) if t["verdict"] == "named"}
    if result["verdict"] not in SURE:
        return None, []
    machine = _machine(truth["robot"])
    matches, sizes = [], []
    for effect in truth["effects"]:
        term = terms.get(effect["effect"])
        if term is None:
            continue
        matches.append(same_place(machine, effect["place"], term["place"]))
        measured = _strength(term["parameters"], effect["strength"])
        if measured is not None:
            sizes.append(_error(effect, measured))
    return (all(matches) if matches else None), sizes


def _machine(robot: str) -> Any:
    """Machine or walker of a case."""
    return walkers.get(robot) if robot in walkers.WALKERS else fleet.get(robot)


def same_place(machine: Any, true: str, said: str) -> bool:
    """Whether two places denote the same joints or the same link."""
    parts = (*machine.joints, *machine.links)

    def members(place: str) -> list[str]:
        pool = machine.joints if place in ("", "*") else parts
        return [name for name in pool if fnmatchcase(name, place or "*")]

    return members(true) == members(said)


def _strength(parameters: Mapping[str, Any], name: str) -> dict[str, np.ndarray] | None:
    """Value and interval of a strength, NaN without interval; components of a vector in order."""
    labels = [k for k in sorted(parameters) if k == name or k.startswith(f"{name}.")]
    if not labels:
        return None
    keys = ("value", "low", "high")
    return {key: np.array([parameters[k][key] for k in labels], dtype=float) for key in keys}


def _error(effect: Mapping[str, Any], said: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Relative error of a strength, without components that the data do not determine."""
    true = np.atleast_1d(np.asarray(effect["params"][effect["strength"]], float))
    finite = np.isfinite(said["low"]) & np.isfinite(said["high"])
    if len(true) == len(finite) and finite.any():
        true, said = true[finite], {key: values[finite] for key, values in said.items()}
    if len(true) != len(said["value"]):
        true, value = np.array([np.linalg.norm(true)]), np.array([np.linalg.norm(said["value"])])
        inside = None
    else:
        value = said["value"]
        inside = bool(np.all((said["low"] <= true) & (true <= said["high"])))
    gap = float(np.linalg.norm(value - true) / np.linalg.norm(true))
    return {"effect": effect["effect"], "error": gap, "inside": inside}


def _gap(result: Mapping[str, Any]) -> tuple[float | None, float | None, float | None]:
    gap = result.get("gap") or {}
    before, after = gap.get("before"), gap.get("after")
    return reducible(before, after), before, after


def reducible(before: float | None, after: float | None) -> float | None:
    """Closed share of the gap above the noise floor; None if the gap was negligible."""
    if before is None or after is None or before**2 - 1.0 < 0.1:
        return None
    return float(1.0 - (after**2 - 1.0) / (before**2 - 1.0))


def figures(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Statistics over all rows: acceptance, by robot, by size, and baselines."""
    singles = [r for r in rows if r["kind"] == "single"]
    larger = [r for r in singles if r["size"] in ("medium", "large")]
    pairs = [r for r in rows if r["kind"] == "pair"]
    nulls = [r for r in rows if r["kind"] == "null"]
    strange = [r for r in rows if r["kind"] == "outsider"]
    sizes = [s for r in rows for s in r["sizes"]]
    repeats = [(r["said"], names) for r in rows for names in r["settings"]]
    return {
        "cases": len(rows),
        "errors": sum(r["verdict"] == "error" for r in rows),
        "singles medium and large": rates(larger),
        "singles small": rates([r for r in singles if r["size"] == "small"]),
        "by size": {s: rates([r for r in singles if r["size"] == s])
                    for s in ("small", "medium", "large")},
        "by robot": {name: rates([r for r in larger if name in r["groups"]])
                     for name in sorted({g for r in rows for g in r["groups"]})},
        "by condition": {name: rates([r for r in larger if name in r["condition"]])
                         for name in sorted({c for r in rows for c in r["condition"]})},
        "false names, model a little off": share(
            _false(r) for r in rows if OFF in r["condition"]),
        "pairs both named": share(set(r["true"]) <= set(r["said"]) for r in pairs),
        "pairs right": share(r["right"] or set(r["true"]) <= set(r["said"]) for r in pairs),
        "pairs one named": share(bool(set(r["true"]) & set(r["said"])) for r in pairs),
        "pairs": len(pairs),
        "nulls": len(nulls),
        "false names on nulls": share(r["named"] for r in nulls),
        "nulls not called no gap": share(r["verdict"] != "no gap" for r in nulls),
        "outsiders": len(strange),
        "outsiders unknown or ambiguous": share(r["abstained"] for r in strange),
        "outsiders with a reserve": share(r["abstained"] or r["more"] for r in strange),
        "outsiders named": share(r["named"] for r in strange),
        "false names": share(_false(r) for r in rows),
        "abstained": share(r["abstained"] for r in [*singles, *pairs]),
        "answers under other settings": len(repeats),
        "same names under other settings": share(new == then for then, new in repeats if new),
        "no name under other settings": share(not new for _, new in repeats),
        "place right": share(r["place"] for r in rows if r["place"] is not None),
        "places judged": sum(r["place"] is not None for r in rows),
        "size error median": median(s["error"] for s in sizes),
        "intervals that hold the truth": share(
            s["inside"] for s in sizes if s["inside"] is not None),
        "held-out gap closed median": median(
            r["closed"] for r in [*larger, *pairs] if r["closed"] is not None),
        "held-out error": held_out(rows),
        "calibration": calibration(rows),
    }  # fmt: skip


def calibration(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Calibration of the probabilities of the effects of the selected models.

    Its error is the mean difference between probability and share of right effects, in ten bins.
    """
    values = np.array([v for r in rows for v in r["probabilities"]], dtype=float).reshape(-1, 2)
    told, true = values.T
    bins = np.minimum((10.0 * told).astype(int), 9)
    gaps = [abs(np.sum((told - true)[bins == k])) for k in np.unique(bins)]
    return {
        "probabilities": len(told),
        "probability told": float(told.mean()) if len(told) else None,
        "share right": float(true.mean()) if len(told) else None,
        "Brier score": float(np.mean(np.square(told - true))) if len(told) else None,
        "calibration error": float(np.sum(gaps)) / len(told) if len(told) else None,
    }


def _false(r: Mapping[str, Any]) -> bool:
    """Whether an effect was named that is not hidden in the robot."""
    return r["named"] and not set(r["said"]) <= set(r["true"])


def rates(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Shares of correct verdicts among single effects."""
    return {
        "cases": len(rows),
        "top-1": share(r["top1"] for r in rows),
        "right": share(r["right"] for r in rows),
        "kind told": share(r["kind_told"] for r in rows),
        "first choice": share(r["first"] for r in rows),
        "top-2": share(r["top2"] for r in rows),
        "with others": share(r["with_others"] for r in rows),
        "abstained": share(r["abstained"] for r in rows),
        "no gap": share(r["verdict"] == "no gap" for r in rows),
    }


def held_out(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Held-out error in noise floors: of the initial model, the workflow, and the baselines.

    Computed over cases with hidden effects for which all of them have a value.
    """
    names = [n for n in BASELINES if any(n in r["baselines"] for r in rows)]
    both = [
        r for r in rows
        if r["kind"] != "null" and r["after"] is not None
        and all(r["baselines"].get(n, {}).get("after") is not None for n in names)
    ]  # fmt: skip
    table = {"cases": len(both)}
    table["model as it came"] = _spread([r["before"] for r in both], both)
    table["loco gap"] = _spread([r["after"] for r in both], both)
    for n in names:
        summary = _spread([r["baselines"][n]["after"] for r in both], both)
        summary["worse than loco gap"] = share(
            r["baselines"][n]["after"] > r["after"] * 1.001 for r in both
        )
        table[BASELINES[n]] = summary
    return table


def _spread(after: Sequence[float], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    closed = [reducible(r["before"], a) for r, a in zip(rows, after, strict=True)]
    return {
        "median": median(after),
        "geometric mean": float(np.exp(np.mean(np.log(after)))) if after else None,
        "closed": median(c for c in closed if c is not None),
    }


def confusion(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Counts of named effects and verdicts by hidden effect (`nothing` if none is hidden).

    A case with several names counts as the true one with others, or as the first wrong name.
    """
    table: dict[str, dict[str, int]] = {}
    for r in rows:
        if r["kind"] not in ("single", "null", "outsider"):
            continue
        line = table.setdefault(r["true"][0] if r["true"] else "nothing", {})
        name = said(r)
        line[name] = line.get(name, 0) + 1
    return {key: dict(sorted(table[key].items())) for key in sorted(table)}


def said(r: Mapping[str, Any]) -> str:
    """Verdict of a row as short text."""
    if r["verdict"] not in SURE or not r["said"]:
        return r["verdict"]
    if set(r["true"]) & set(r["said"]):
        return r["true"][0] if r["said"] == r["true"] else f"{r['true'][0]} and others"
    return r["said"][0]


def share(flags: Iterable[Any]) -> float | None:
    """Share of true flags; None without flags."""
    flags_known = [bool(f) for f in flags]
    return sum(flags_known) / len(flags_known) if flags_known else None


def median(values: Iterable[float]) -> float | None:
    """Median; None without values."""
    numbers = [float(v) for v in values if v is not None]
    return float(np.median(numbers)) if numbers else None
