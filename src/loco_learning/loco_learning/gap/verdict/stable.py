# SPDX-License-Identifier: Apache-2.0
"""Stability of a verdict under other splits of the records, stretches of time and noise floors.

For each split the named model and its closest rivals are refitted to the other records, and the
record that is left out judges. Stretches and floors need no fit. The table is a check of the
probabilities: if another answer is more probable under one of these settings, this is told.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from loco_sim.foreign.notes import listed

from ..fitting.fit import Fitted, Setting, fit, weigh
from ..prediction.case import Case
from ..probability.weights import CRITERION, NO_EFFECT
from ..probability.weights import weigh as weights_of
from ..recordings.record import Record
from ..statistics import evidence

SPLITS, STRETCHES, FLOORS = 3, 2, (0.5, 2.0)  # settings that are tested
N_RIVALS = 2  # models of other names that are refitted
UNLIKE = 10.0  # ratio of the errors of two recordings that one robot does not make (taste)
REFIT = 6  # simulations of a refit, and 2 per parameter
FLIPS = 3.0  # odds above which evidence is worth mentioning (Kass and Raftery 1995)


@dataclass(frozen=True)
class Row:
    """Answer under one setting.

    Attributes:
        vary: Kind of setting: split, stretch or floor.
        setting: Setting in words.
        names: Effects of the most probable model; empty for the initial model.
        probability: Probability of the named effects under the setting.
        closed: Share of the gap that the named model closes.
    """

    vary: str
    setting: str
    names: tuple[str, ...]
    probability: float
    closed: float

    @property
    def plain(self) -> dict[str, Any]:
        """Row of ``gap.json``."""
        return asdict(self)


def cross_validate(
    case: Case, model: Fitted, held_out: Sequence[int], setting: Setting
) -> list[tuple[np.ndarray, ...]]:
    """Residuals of a model that was refitted to all records but one, (T, C) each, for each one.

    Args:
        case: Model and data.
        model: Model to refit, from its current coordinates.
        held_out: Indices of the records that are left out, one at a time.
        setting: Settings that all fits share.
    """
    if not model.parts and not model.overrides:
        return [tuple(model.whole)] * len(held_out)
    exact = case.corrected(model.specs, model.overrides)
    reduced = setting.params.replace(evaluations=max(4, REFIT - 3 * (model.count - 1)))
    setting = replace(setting, params=reduced, free=model.overrides)
    residuals = []
    for i in held_out:
        fitted = [np.full(len(rows), k != i) for k, rows in enumerate(case.fit_rows)]
        split = replace(exact, fit_rows=fitted, held_rows=[~rows for rows in fitted])
        refit = fit(split, model.parts, setting)
        start = weigh(split, model.parts, model.overrides, seek=False)
        residuals.append(min((start, refit), key=lambda m: m.fit_rms).whole)
    return residuals


def rows(search: Any, best: Fitted, base: Fitted, rest: Sequence[Fitted], seed: int) -> list[Row]:
    """Answers under other settings.

    Args:
        search: Search with its processes, settings and case.
        best: Named model.
        base: The initial model with nominal values refitted.
        rest: Rivals, the most probable first.
        seed: Seed of the resampling.
    """
    models = [best, base, *[m for m in rest if m.names != best.names][:N_RIVALS]]
    return [_row(*each[:2], models, each[2], seed) for each in _settings(search, models)]


def _settings(search: Any, models: Sequence[Fitted]) -> Iterator[tuple[str, str, list]]:
    """Kind and name of each setting, with the residuals of all models under it."""
    case = search.case
    held_out = _loudest(models[1], SPLITS) if len(models[1].whole) > 1 else []
    in_reach = [m is models[0] or search.in_reach(m, models) for m in models]
    tasks = [(m, held_out, search.setting) for m, on in zip(models, in_reach, strict=True) if on]
    refits = iter(search.each(cross_validate, tasks) if held_out else ())
    both = zip(models, in_reach, strict=True)
    over = [next(refits, []) if on else [m.whole] * len(held_out) for m, on in both]
    for i, *group in zip(held_out, *over, strict=True):
        yield "split", f"{case.records[i].name} judges", [[residuals[i]] for residuals in group]
    starts = [np.argmax(np.isfinite(r).any(1)) for r in models[0].whole]  # after an unread rest
    read = [[r[row:] for r, row in zip(m.whole, starts, strict=True)] for m in models]
    for part in range(STRETCHES):
        stretches = [[np.array_split(r, STRETCHES)[part] for r in each] for each in read]
        yield "stretch", f"{('first', 'second')[part]} half of each record", stretches
    for times in FLOORS:
        yield "floor", f"{times:g} times as high", [[r / times for r in m.whole] for m in models]


def _loudest(base: Fitted, count: int) -> list[int]:
    """Indices of the records with most of the gap, in order."""
    size = [evidence.excess([r]) for r in base.whole]
    return sorted(sorted(range(len(size)), key=lambda i: (-size[i], i))[:count])


def _row(vary: str, text: str, models: Sequence[Fitted], residuals: list, seed: int) -> Row:
    refitted = [replace(m, whole=tuple(r)) for m, r in zip(models, residuals, strict=True)]
    weights = weights_of(refitted, seed)
    named = set(models[0].names)
    share = sum(value for model, value in weights.ranked if named <= set(model.names))
    closed = evidence.closed_by(residuals[1], residuals[0])
    return Row(vary, text, weights.best.names, share, closed)


def alarms(table: Sequence[Row]) -> tuple[str, ...]:
    """A sentence about the setting under which another answer is most probable; empty if none is.

    Args:
        table: Answers under other settings.
    """
    flips = [row for row in table if row.probability < 1.0 / (1.0 + FLIPS)]
    if not flips:
        return ()
    row = min(flips, key=lambda r: r.probability)
    names = " and ".join(row.names) or NO_EFFECT
    return (
        f"the name depends on a setting: with {row.vary} {row.setting!r} it has a probability of "
        f"{row.probability:.2g}, and {names} is more probable",
    )


def unlike(records: Sequence[Record], model: Fitted) -> tuple[str, ...]:
    """A sentence about recordings that a model misses while it explains others; empty if none are.

    Args:
        records: The recordings.
        model: The model, with its errors in each recording.
    """
    errors = [float(np.sqrt(np.nanmean(np.square(each)))) for each in model.whole]
    names, limit = [record.name for record in records], UNLIKE * max(min(errors), 1.0)
    missed = [name for name, error in zip(names, errors, strict=True) if error > limit]
    if not missed or min(errors) > CRITERION.trifle:
        return ()
    others = [name for name in names if name not in missed]
    return (
        f"{listed(missed)} and {listed(others)} differ: the model leaves "
        f"{max(errors):.3g} noise floors in one and {min(errors):.2g} in another; was the robot, "
        "its load or its controller changed between them? Search in each group by itself",
    )
