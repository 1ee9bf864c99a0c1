# SPDX-License-Identifier: Apache-2.0
"""Names under other settings: other splits of the records, other stretches, other floors.

For each split the named model and its nearest rivals are fitted again to the other records, from
where they are, and the record that was left out judges. Stretches and floors need no fit. A name
that another one beats under a setting is no name: both are told.
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

SPLITS, STRETCHES, FLOORS = 3, 2, (0.5, 2.0)  # settings that are tried, beside the one as it is
RIVALS = 2  # models of other names that are fitted again
REFIT = 6  # simulations of a fit from where it was, and 2 per parameter
FLIPS = 3.0  # odds from which evidence is worth a mention (Kass and Raftery 1995)
STABLE = 5  # key of random streams
NOTHING = "nothing"


@dataclass(frozen=True)
class Row:
    """Answer under one setting.

    Attributes:
        vary: Kind of setting: split, stretch or floor.
        setting: Setting in words.
        names: Effects of the model that wins there; none where the model as it came does.
        odds: Odds of the named model over the best of the others, below 1 where that wins.
        against: Names of this other model.
        closed: Share of the gap that the named model closes there.
        flips: Another answer wins by more than chance.
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
    """Residuals of a model that was fitted again to all records but one, (T, C) each.

    Args:
        case: Model and data.
        model: Model to fit, from where it is.
        judging: Record that is left out.
        setting: Settings that all fits share.
    """
    if not model.parts and not model.overrides:
        return tuple(model.whole)
    fitted = [np.full(len(rows), i != judging) for i, rows in enumerate(case.fit_rows)]
    case = case.corrected(model.specs, model.overrides)
    case = replace(case, fit_rows=fitted, held_rows=[~rows for rows in fitted])
    few = setting.params.replace(evaluations=max(4, REFIT - 3 * (model.count - 1)))
    found = fit(case, model.parts, replace(setting, params=few, free=model.overrides))
    start = weigh(case, model.parts, model.overrides)
    return min((start, found), key=lambda m: m.fit_rms).whole


def rows(search: Any, best: Fitted, base: Fitted, others: Sequence[Fitted], seed: int) -> list[Row]:
    """Answers under other settings.

    Args:
        search: Search with its processes, settings and case.
        best: Named model.
        base: The model as it came, nominal values refitted.
        others: Rivals, the hardest to exclude first.
        seed: Seed of the resampling.
    """
    rivals = [m for m in others if m.names != best.names][:RIVALS]
    models = [best, base, *rivals]
    names = [m.names for m in models]
    return [_row(*each[:2], names, each[2], seed) for each in _settings(search, models)]


def _settings(search: Any, models: Sequence[Fitted]) -> Iterator[tuple[str, str, list]]:
    """Kind and words of each setting, with the residuals of all models under it."""
    case = search.case
    judging = _loudest(models[1], SPLITS)
    tasks = [(m, i, search.setting) for i in judging for m in models]
    results = list(search.each(again, tasks)) if len(models[1].whole) > 1 else []
    for k, i in enumerate(judging if results else ()):
        mine = results[k * len(models) : (k + 1) * len(models)]
        yield "split", f"{case.records[i].name} judges", [[whole[i]] for whole in mine]
    for part in range(STRETCHES):
        stretches = [[np.array_split(r, STRETCHES)[part] for r in m.whole] for m in models]
        yield "stretch", f"{('first', 'second')[part]} half of each record", stretches
    for times in FLOORS:
        yield "floor", f"{times:g} times as high", [[r / times for r in m.whole] for m in models]


def _loudest(base: Fitted, count: int) -> list[int]:
    """Records in which most of the gap is, in their order."""
    size = [evidence.excess([r]) for r in base.whole]
    return sorted(sorted(range(len(size)), key=lambda i: (-size[i], i))[:count])


def _row(vary: str, words: str, names: list, residuals: list, seed: int) -> Row:
    best, *others = [evidence.score(r) for r in residuals]
    rng = np.random.default_rng([seed, STABLE])
    over = [evidence.compare(best, other, rng).odds for other in others]
    worst = int(np.argmin(over))
    wins = over[worst] >= 1.0
    return Row(
        vary,
        words,
        names[0] if wins else names[1 + worst],
        over[worst],
        names[1 + worst],
        evidence.closed_by(residuals[1], residuals[0]),
        over[worst] < 1.0 / FLIPS,
    )


def downgraded(decision: Decision, table: Sequence[Row]) -> Decision:
    """The decision, ambiguous where another answer wins under a setting, but for what both name.

    Args:
        decision: Verdict with the settings as they are.
        table: Answers under others.
    """
    flips = [row for row in table if row.flips]
    if decision.verdict not in (NAMED, MORE) or not flips:
        return decision
    row = min(flips, key=lambda r: r.odds)
    said = " and ".join(row.names) or NOTHING
    text = (
        f"The name hangs on the settings: with {row.vary} {row.setting!r} {said} has odds of "
        f"{min(1.0 / max(row.odds, 1e-9), evidence.MOST_ODDS):.3g} to 1. {decision.evidence}"
    )
    rulings = tuple(_unsure(r, flips, decision.names, text) for r in decision.rulings)
    return replace(decision, verdict=AMBIGUOUS, rulings=rulings, evidence=text)


def _unsure(ruling: Ruling, flips: Sequence[Row], named: Sequence[str], text: str) -> Ruling:
    """A ruling, ambiguous where an answer that wins lacks its name.

    Args:
        ruling: Ruling with the settings as they are.
        flips: Settings under which another answer wins.
        named: All effects that are named with the settings as they are.
        text: Sentences of evidence, the first of which goes with the ruling.
    """
    without = [flip for flip in flips if ruling.name not in flip.names]
    if not without:
        return ruling
    others = {name for flip in without for name in flip.names} - set(named)
    alike = tuple(sorted({*ruling.look_alikes, *others}))
    return replace(ruling, verdict=AMBIGUOUS, look_alikes=alike, odds=min(ruling.odds, 1.0),
                   evidence=f"{ruling.evidence} {text.split('. ')[0]}.")  # fmt: skip
