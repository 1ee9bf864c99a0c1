# SPDX-License-Identifier: Apache-2.0
"""Stability of a verdict under other splits of the records, stretches of time and noise floors.

For each split the named model and its closest rivals are refitted to the other records, and the
record that is left out judges. Stretches and floors need no fit. If another model wins under one
of these settings, the verdict is ambiguous.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..fitting.fit import Fitted, Setting, fit, weigh
from ..prediction.case import Case
from ..statistics import evidence
from .decide import AMBIGUOUS, MORE, NAMED, Decision, Ruling

SPLITS, STRETCHES, FLOORS = 3, 2, (0.5, 2.0)  # settings that are tested
RIVALS = 2  # models of other names that are refitted
REFIT = 6  # simulations of a refit, and 2 per parameter
FLIPS = 3.0  # odds above which evidence is worth mentioning (Kass and Raftery 1995)
STABLE = 5  # key of random streams
NOTHING = "nothing"


@dataclass(frozen=True)
class Row:
    """Answer under one setting.

    Attributes:
        vary: Kind of setting: split, stretch or floor.
        setting: Setting in words.
        names: Effects of the model that wins; empty for the initial model.
        odds: Odds of the named model over the best of the others, below 1 if that wins.
        against: Names of the best other model.
        closed: Share of the gap that the named model closes.
        flips: Whether another model wins by more than chance.
    """

    vary: str
    setting: str
    names: tuple[str, ...]
    odds: float
    against: tuple[str, ...]
    closed: float
    flips: bool

    @property
    def plain(self) -> dict[str, Any]:
        """Row of ``gap.json``."""
        return asdict(self)


def again(case: Case, model: Fitted, judging: int, setting: Setting) -> tuple[np.ndarray, ...]:
    """Residuals of a model that was refitted to all records but one, (T, C) each.

    Args:
        case: Model and data.
        model: Model to refit, from its current coordinates.
        judging: Index of the record that is left out.
        setting: Settings that all fits share.
    """
    if not model.parts and not model.overrides:
        return tuple(model.whole)
    fitted = [np.full(len(rows), i != judging) for i, rows in enumerate(case.fit_rows)]
    case = case.corrected(model.specs, model.overrides)
    case = replace(case, fit_rows=fitted, held_rows=[~rows for rows in fitted])
    reduced = setting.params.replace(evaluations=max(4, REFIT - 3 * (model.count - 1)))
    refit = fit(case, model.parts, replace(setting, params=reduced, free=model.overrides))
    start = weigh(case, model.parts, model.overrides)
    return min((start, refit), key=lambda m: m.fit_rms).whole


def rows(search: Any, best: Fitted, base: Fitted, others: Sequence[Fitted], seed: int) -> list[Row]:
    """Answers under other settings.

    Args:
        search: Search with its processes, settings and case.
        best: Named model.
        base: The initial model with nominal values refitted.
        others: Rivals, the hardest to exclude first.
        seed: Seed of the resampling.
    """
    alternatives = [m for m in others if m.names != best.names][:RIVALS]
    models = [best, base, *alternatives]
    names = [m.names for m in models]
    return [_row(*each[:2], names, each[2], seed) for each in _settings(search, models)]


def _settings(search: Any, models: Sequence[Fitted]) -> Iterator[tuple[str, str, list]]:
    """Kind and name of each setting, with the residuals of all models under it."""
    case = search.case
    held_out = _loudest(models[1], SPLITS)
    near = [m is models[0] or search.in_reach(m, models) for m in models]
    tasks = [
        (m, i, search.setting) for i in held_out for m, on in zip(models, near, strict=True) if on
    ]
    several = len(models[1].whole) > 1
    refits = iter(search.each(again, tasks) if several else ())
    for i in held_out if several else ():
        group = [next(refits) if on else m.whole for m, on in zip(models, near, strict=True)]
        yield "split", f"{case.records[i].name} judges", [[residuals[i]] for residuals in group]
    for part in range(STRETCHES):
        stretches = [[np.array_split(r, STRETCHES)[part] for r in m.whole] for m in models]
        yield "stretch", f"{('first', 'second')[part]} half of each record", stretches
    for times in FLOORS:
        yield "floor", f"{times:g} times as high", [[r / times for r in m.whole] for m in models]


def _loudest(base: Fitted, count: int) -> list[int]:
    """Indices of the records with most of the gap, in order."""
    size = [evidence.excess([r]) for r in base.whole]
    return sorted(sorted(range(len(size)), key=lambda i: (-size[i], i))[:count])


def _row(vary: str, words: str, names: list, residuals: list, seed: int) -> Row:
    best, *scores = [evidence.score(r) for r in residuals]
    rng = np.random.default_rng([seed, STABLE])
    over = [evidence.compare(best, other, rng).odds for other in scores]
    closest = int(np.argmin(over))
    wins = over[closest] >= 1.0
    return Row(
        vary,
        words,
        names[0] if wins else names[1 + closest],
        over[closest],
        names[1 + closest],
        evidence.closed_by(residuals[1], residuals[0]),
        over[closest] < 1.0 / FLIPS,
    )


def downgraded(decision: Decision, table: Sequence[Row]) -> Decision:
    """The decision, made ambiguous where another model wins under some setting.

    Args:
        decision: Verdict with the current settings.
        table: Answers under other settings.
    """
    flips = [row for row in table if row.flips]
    if decision.verdict not in (NAMED, MORE) or not flips:
        return decision
    row = min(flips, key=lambda r: r.odds)
    names = " and ".join(row.names) or NOTHING
    text = (
        f"The name hangs on the settings: with {row.vary} {row.setting!r} {names} has odds of "
        f"{min(1.0 / max(row.odds, 1e-9), evidence.MOST_ODDS):.3g} to 1. {decision.evidence}"
    )
    assessments = tuple(_unsure(r, flips, decision.names, text) for r in decision.rulings)
    return replace(decision, verdict=AMBIGUOUS, rulings=assessments, evidence=text)


def _unsure(ruling: Ruling, flips: Sequence[Row], named: Sequence[str], text: str) -> Ruling:
    """A ruling, made ambiguous if a model that wins under some setting lacks its effect.

    Args:
        ruling: Ruling with the current settings.
        flips: Settings under which another model wins.
        named: All effects that are named with the current settings.
        text: Sentences of evidence, the first of which is appended to the ruling.
    """
    without = [flip for flip in flips if ruling.name not in flip.names]
    if not without:
        return ruling
    alternatives = {name for flip in without for name in flip.names} - set(named)
    similar = tuple(sorted({*ruling.look_alikes, *alternatives}))
    return replace(ruling, verdict=AMBIGUOUS, look_alikes=similar, odds=min(ruling.odds, 1.0),
                   evidence=f"{ruling.evidence} {text.split('. ')[0]}.")  # fmt: skip
