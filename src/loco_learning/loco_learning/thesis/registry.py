# SPDX-License-Identifier: Apache-2.0
"""Claims of the thesis from ``claims.yaml``, and verdicts on them by its rules.

A measure is a small function from evidence (results of a plan) to named numbers. A claim names a
measure and the ranges of its numbers in which the claim agrees; the ranges are in the file
before anything runs. The claim is not decided if its evidence was not run, or a number is NaN.
"""

from __future__ import annotations

import importlib.resources
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from loco_control.exceptions import LocoError

from ..plain import read_yaml
from ..study.grid import ranges

AGREES, DISAGREES, OPEN = "agrees", "disagrees", "not decided"
Numbers = Mapping[str, float]
MEASURES: dict[str, Callable[[Any], Numbers]] = {}


def measure(function: Callable[[Any], Numbers]) -> Callable[[Any], Numbers]:
    """Register a function from evidence to numbers under its own name."""
    MEASURES[function.__name__] = function
    return function


class NotRunError(LocoError):
    """The evidence that a claim needs was not run in this plan."""


@dataclass(frozen=True)
class Claim:
    """One claim of the registry.

    Attributes:
        number: Number of the claim, such as "7.4".
        item: Figure or line of the thesis.
        says: The claim in a sentence.
        evidence: Names of the plan's entries that are needed.
        measure: Name of the function that measures it; "msd" for the claims of chapter 6, which
            have judges of their own.
        rule: Ranges of the numbers in which the claim agrees.
        why: Explanation of a disagreement, if known.
    """

    number: str
    item: str
    says: str
    evidence: tuple[str, ...]
    measure: str
    rule: dict[str, tuple[float, float]]
    why: str = ""

    @property
    def wanted(self) -> str:
        """The rule in words."""
        return "; ".join(_range(name, *limits) for name, limits in self.rule.items())


@dataclass(frozen=True)
class Verdict:
    """Verdict on a claim.

    Attributes:
        claim: Number of the claim.
        item: Figure or line of the thesis.
        says: The claim.
        wanted: The rule.
        found: Measured numbers.
        verdict: `AGREES`, `DISAGREES` or `OPEN`.
        evidence: Names of the plan's entries.
        why: Explanation of a disagreement.
    """

    claim: str
    item: str
    says: str
    wanted: str
    found: str
    verdict: str
    evidence: tuple[str, ...] = ()
    why: str = ""


def file(name: str) -> Path:
    """Path of a file in this package."""
    return Path(str(importlib.resources.files("loco_learning") / "thesis" / name))


def claims() -> list[Claim]:
    """All claims, in their order.

    Raises:
        ParameterError: The file has a duplicate claim, or a range that is not two numbers.
    """
    claim_list = []
    for number, row in read_yaml(file("claims.yaml")).items():
        rule = ranges(row.get("rule", {}), f"claim {number}")
        evidence = row["from"] if isinstance(row["from"], list) else [row["from"]]
        claim_list.append(
            Claim(str(number), row.get("item", ""), row.get("says", ""), tuple(evidence),
                  row.get("measure", "msd"), rule, row.get("why", ""))
        )  # fmt: skip
    return claim_list


def tally(verdicts: Iterable[str]) -> str:
    """Number of each verdict, as a sentence: "13 agrees, 11 disagrees, 23 not decided"."""
    counts = Counter(verdicts)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in (AGREES, DISAGREES, OPEN))


def judge(claim: Claim, evidence: Any) -> Verdict:
    """Verdict on one claim from the results of a plan."""
    text, verdict = "not run", OPEN
    try:
        numbers = MEASURES[claim.measure](evidence)
    except NotRunError as error:
        text = str(error)
    else:
        text = "; ".join(f"{name.replace('_', ' ')} {_text(v)}" for name, v in numbers.items())
        values = [numbers.get(name, math.nan) for name in claim.rule]
        if values and not any(math.isnan(value) for value in values):
            fits = (low <= v <= high for v, (low, high) in zip(values, claim.rule.values(),
                                                               strict=True))  # fmt: skip
            verdict = AGREES if all(fits) else DISAGREES
    explanation = claim.why if verdict == DISAGREES else ""
    about = claim.number, claim.item, claim.says, claim.wanted
    return Verdict(*about, text, verdict, claim.evidence, explanation)


def _text(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.5g}" if abs(value) >= 1e3 else f"{value:.3g}"


def _range(name: str, low: float, high: float) -> str:
    name = name.replace("_", " ")
    if low == high:
        return f"{name} is {low:g}"
    if math.isinf(high):
        return f"{name} at least {low:g}"
    return f"{name} at most {high:g}" if math.isinf(low) else f"{name} {low:g} to {high:g}"
