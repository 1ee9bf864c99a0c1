# SPDX-License-Identifier: Apache-2.0
"""Claims of the thesis from ``claims.yaml``, and verdicts on them by its rules.

A measure is a function from evidence (results of a plan) to named numbers: one value per
independent run, or a single number where nothing is drawn. A claim names a measure and, for each
number that decides, a comparison and a range; the rule is in the file before anything runs. The
comparisons are

- ``median``: the interval of the median over the runs, by order statistics, at `CONFIDENCE`;
- ``share``: the interval of the share of runs that are 1 and not 0 (Clopper and Pearson);
- ``each``: every run;
- ``value``: a single number, for a claim that says why one is enough (`exact` or `holds`).

A number agrees if its interval is within the range, disagrees if it is outside, and leaves the
claim open if it has the limit within it, or comes from fewer runs than the rule requires.
"""

from __future__ import annotations

import datetime
import importlib.resources
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_control.reading import shown

from ..plain import read_yaml
from ..study.grid import ranges
from ..study.trial import CONFIDENCE, share_interval

AGREES, DISAGREES, OPEN = "agrees", "disagrees", "open"
HOLDS, ROBOT = "holds by construction", "cannot be judged without the robot"
VERDICTS = (AGREES, DISAGREES, OPEN, HOLDS, ROBOT)
DIGITS = 6  # significant digits of numbers that are judged and published (taste)
LEAST_RUNS = 5  # fewest runs whose range is an interval of the median at `CONFIDENCE`
Numbers = Mapping[str, float | np.ndarray]
MEASURES: dict[str, Callable[[Any], Numbers]] = {}
KEYS = ("item", "says", "from", "measure", "rule", "runs", "frozen", "after_results", "valid",
        "exact", "holds", "robot", "note", "why")  # fmt: skip


def measure(function: Callable[[Any], Numbers]) -> Callable[[Any], Numbers]:
    """Register a function from evidence to numbers under its own name."""
    MEASURES[function.__name__] = function
    return function


class NotRunError(LocoError):
    """The evidence that a claim needs was not run in this plan."""


@dataclass(frozen=True)
class Bound:
    """Comparison of one number with its range.

    Attributes:
        kind: Name of the comparison in `COMPARISONS`.
        low: Smallest value that agrees; may be -inf.
        high: Largest value that agrees; may be inf.
    """

    kind: str
    low: float
    high: float

    @property
    def text(self) -> str:
        """The range in words."""
        if self.low == self.high:
            return f"is {self.low:g}"
        if math.isinf(self.high):
            return f"at least {self.low:g}"
        if math.isinf(self.low):
            return f"at most {self.high:g}"
        return f"{self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Claim:
    """One claim of the registry.

    Attributes:
        number: Number of the claim, such as "7.4".
        item: Figure or line of the thesis.
        says: The claim in a sentence.
        evidence: Names of the plan's entries that are needed.
        measure: Name of the function that measures it.
        rule: Comparison of each number that decides; empty if `robot`.
        runs: Fewest runs of each number that is not a ``value``.
        frozen: Date since which the ranges of the rule are unchanged.
        after_results: Whether numbers of this claim were known when its ranges were written.
        valid: Ranges of numbers outside of which the claim is open.
        exact: Why one value of a number is enough.
        holds: Why the claim holds by construction, if it does.
        robot: Why the claim cannot be judged without the robot, if so.
        note: Remark on the rule, for the page.
        why: Explanation of a disagreement, if known.
    """

    number: str
    item: str
    says: str
    evidence: tuple[str, ...]
    measure: str
    rule: dict[str, Bound]
    runs: int = 0
    frozen: str = ""
    after_results: bool = False
    valid: dict[str, tuple[float, float]] = field(default_factory=dict)
    exact: str = ""
    holds: str = ""
    robot: str = ""
    note: str = ""
    why: str = ""

    @property
    def rule_text(self) -> str:
        """The rule in words."""
        if self.robot:
            return "no rule"
        parts = [f"{_name(name, bound.kind)} {bound.text}" for name, bound in self.rule.items()]
        if self.runs:
            parts.append(f"at least {self.runs} runs")
        return "; ".join(parts)

    @property
    def since(self) -> str:
        """Date of the ranges, and whether they were written after numbers had been seen."""
        return f"{self.frozen}{', numbers seen' if self.after_results else ''}"


@dataclass(frozen=True)
class Verdict:
    """Verdict on a claim.

    Attributes:
        claim: The claim.
        text: Measured numbers.
        verdict: One of `VERDICTS`.
        reason: Why it is not "agrees": explanation, or what is missing.
        numbers: Numbers of the measure, by name.
        change: Change of the runs; empty for the verdict on the thesis.
    """

    claim: Claim
    text: str
    verdict: str
    reason: str = ""
    numbers: Numbers = field(default_factory=dict)
    change: str = ""

    @property
    def name(self) -> str:
        """Number of the claim, and the change."""
        return f"{self.claim.number}, {self.change}" if self.change else self.claim.number


def file(name: str) -> Path:
    """Path of a file in this package."""
    return Path(str(importlib.resources.files("loco_learning") / "thesis" / name))


# ---- the registry


def claims(path: Path | None = None) -> list[Claim]:
    """All claims, in their order.

    Args:
        path: Another file than ``claims.yaml``.

    Raises:
        NameUnknownError: A key or a comparison does not exist.
        ParameterError: A row lacks a part of its rule, has a rule that cannot fail, or judges a
            number that depends on draws by fewer than `LEAST_RUNS` runs.
    """
    return [
        _claim(str(number), row) for number, row in read_yaml(path or file("claims.yaml")).items()
    ]


def _claim(number: str, row: Mapping[str, Any]) -> Claim:
    where = f"claim {number}"
    for key in row:
        if key not in KEYS:
            raise NameUnknownError(f"key in {where}", str(key), KEYS)
    evidence = row["from"] if isinstance(row["from"], list) else [row["from"]]
    rule = {str(k): _bound(f"{where}.{k}", v) for k, v in row.get("rule", {}).items()}
    claim = Claim(
        number, str(row["item"]), str(row["says"]), tuple(evidence), str(row["measure"]), rule,
        row.get("runs", 0), str(row.get("frozen", "")), bool(row.get("after_results", False)),
        ranges(row.get("valid", {}), where),
        *(str(row.get(key, "")) for key in ("exact", "holds", "robot", "note", "why")),
    )  # fmt: skip
    _check(claim, where)
    return claim


def _bound(where: str, spec: Any) -> Bound:
    if not isinstance(spec, Mapping) or len(spec) != 1:
        raise ParameterError(f"{where} must be like {{median: [low, high]}}, got {shown(spec)}")
    ((kind, (low, high)),) = ranges(spec, where).items()
    if kind not in COMPARISONS:
        raise NameUnknownError(f"comparison in {where}", kind, COMPARISONS)
    if math.isinf(low) and math.isinf(high) or (kind == "share" and low <= 0.0 and high >= 1.0):
        raise ParameterError(f"{where} cannot fail: every number is within its range")
    if low > high:
        raise ParameterError(f"{where}: {low:g} is above {high:g}")
    return Bound(kind, low, high)


def _check(claim: Claim, where: str) -> None:
    """Refuse a row without a whole rule."""
    if bool(claim.rule) == bool(claim.robot):
        raise ParameterError(f"{where} must have either a rule, or a reason in robot")
    if claim.robot:
        return
    try:
        datetime.date.fromisoformat(claim.frozen)
    except ValueError as error:
        raise ParameterError(f"{where}.frozen must be the date of the rule, {error}") from error
    bound_types = {bound.kind for bound in claim.rule.values()}
    if "value" in bound_types and not (claim.exact or claim.holds):
        raise ParameterError(f"{where} judges one value and does not say why that is enough")
    if bound_types != {"value"} and claim.runs < LEAST_RUNS:
        raise ParameterError(
            f"{where} judges numbers that differ between runs by {claim.runs} runs; their spread "
            f"needs at least {LEAST_RUNS}"
        )


# ---- comparisons: interval of a number over its runs, NaN without one


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Interval of the median at `CONFIDENCE`, by order statistics; NaN below 5 values."""
    rank = int(binom.ppf((1.0 - CONFIDENCE) / 2.0, len(values), 0.5)) if len(values) else 0
    if rank < 1:
        return math.nan, math.nan
    ordered = np.sort(values)
    return float(ordered[rank - 1]), float(ordered[-rank])


def _range(values: np.ndarray) -> tuple[float, float]:
    return (float(np.min(values)), float(np.max(values))) if len(values) else (math.nan, math.nan)


COMPARISONS: dict[str, Callable[[np.ndarray], tuple[float, float]]] = {
    "median": median_interval, "share": share_interval, "each": _range, "value": _range,
}  # fmt: skip


def _compared(bound: Bound, values: np.ndarray, runs: int) -> tuple[bool | None, str]:
    """Whether a number is within its range, None if open, and what is missing then."""
    if bound.kind == "value":
        runs = 1
    if len(values) < runs:
        return None, f"{len(values)} of {runs} runs"
    low, high = COMPARISONS[bound.kind](values)
    if bound.low <= low and high <= bound.high:
        return True, ""
    outside = high < bound.low or low > bound.high
    if outside or bound.kind == "each":  # one run refutes what is said of each
        return False, ""
    return None, f"{_text(low)} to {_text(high)} has a limit of the range in it"


# ---- verdicts


def judge_all(claims: Iterable[Claim], evidence: Any) -> list[Verdict]:
    """Verdicts on claims; after each those by its runs with each change, where these were run."""
    verdicts, changed = [], evidence.with_changes()
    for claim in claims:
        verdicts.append(judge(claim, evidence))
        if claim.holds or claim.robot:
            continue
        for other in changed:
            if claim.evidence[0] in other.changed:
                verdict = judge(claim, other)
                verdicts += [replace(verdict, change=other.change)] if verdict.numbers else []
    return verdicts


def judge(claim: Claim, evidence: Any) -> Verdict:
    """Verdict on one claim from the results of a plan."""
    try:
        numbers = MEASURES[claim.measure](evidence)
    except NotRunError as error:
        if claim.robot:
            return Verdict(claim, str(error), ROBOT, claim.robot)
        return Verdict(claim, "not run", OPEN, f"Not run: {error}.")
    return decide(claim, numbers)


def decide(claim: Claim, numbers: Numbers) -> Verdict:
    """Verdict on one claim from the numbers of its measure, rounded to what `as_json` writes."""
    numbers = {name: _rounded(value) for name, value in numbers.items()}
    text = "; ".join(_number_text(k, value, claim.rule.get(k)) for k, value in numbers.items())
    if claim.robot:
        return Verdict(claim, text, ROBOT, claim.robot, numbers)
    for name, (low, high) in claim.valid.items():
        value = float(numbers.get(name, math.nan))
        if not low <= value <= high:
            limits = Bound("value", low, high).text
            reason = f"Number {_readable(name)} is {_text(value)}, not {limits}."
            return Verdict(claim, text, OPEN, reason, numbers)
    lacking, refuted = [], False
    for name, bound in claim.rule.items():
        agrees, lack = _compared(bound, _finite(numbers.get(name, math.nan)), claim.runs)
        refuted |= agrees is False
        if lack:
            lacking.append(f"{_readable(name)}: {lack}")
    if refuted:
        return Verdict(claim, text, DISAGREES, claim.why or "Not explained yet.", numbers)
    if lacking:
        return Verdict(claim, text, OPEN, "Number " + "; ".join(lacking) + ".", numbers)
    verdict, reason = (HOLDS, claim.holds) if claim.holds else (AGREES, "")
    return Verdict(claim, text, verdict, reason, numbers)


def as_json(verdicts: Iterable[Verdict]) -> str:
    """Numbers of each run by name of the verdict; "nan" and "inf" are strings."""

    def short(value: Any) -> Any:
        if np.ndim(value):
            return [short(x) for x in value]
        return str(value) if not math.isfinite(value) else int(value) if value % 1 == 0 else value

    lines = [
        f"{json.dumps(v.name)}: {json.dumps({k: short(n) for k, n in v.numbers.items()})}"
        for v in verdicts
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def from_json(text: str) -> dict[str, Numbers]:
    """Numbers by name of the verdict from the text of `as_json`."""
    return {
        claim: {
            k: np.array([float(x) for x in value]) if isinstance(value, list) else float(value)
            for k, value in numbers.items()
        }
        for claim, numbers in json.loads(text).items()
    }


def tally(verdicts: Iterable[Verdict]) -> str:
    """Number of each verdict that occurs: "13 agrees, 11 disagrees, 23 open"; without changes."""
    counts = Counter(v.verdict for v in verdicts if not v.change)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])


def _rounded(value: float | np.ndarray) -> float | np.ndarray:
    """A number, or those of the runs, to `DIGITS` significant digits."""
    return np.vectorize(lambda x: float(f"{x:.{DIGITS}g}"), otypes=[float])(value)[()]


def _finite(value: float | np.ndarray) -> np.ndarray:
    values = np.atleast_1d(np.asarray(value, dtype=float))
    return values[~np.isnan(values)]


def _number_text(name: str, value: float | np.ndarray, bound: Bound | None) -> str:
    """A number with its interval and its runs."""
    if np.ndim(value) == 0:
        return f"{_readable(name)} {_text(float(value))}"
    values = _finite(value)
    if not len(values):
        return f"{_readable(name)} –"
    kind = bound.kind if bound else "share" if set(values) <= {0.0, 1.0} else "median"
    low, high = COMPARISONS[kind](values)
    if math.isnan(low):
        low, high = _range(values)
    middle = np.mean(values) if kind == "share" else np.median(values)
    numbers = f"{_text(low)} to {_text(high)}, {len(values)} runs"
    return f"{_readable(name)} {_text(float(middle))} ({numbers})"


def _name(name: str, kind: str) -> str:
    return {"median": "median of ", "share": "share of ", "each": "each ", "value": ""}[
        kind
    ] + _readable(name)


def _readable(name: str) -> str:
    return name.replace("_", " ")


def _text(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.5g}" if abs(value) >= 1e3 else f"{value:.3g}"
