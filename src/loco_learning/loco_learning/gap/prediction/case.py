# SPDX-License-Identifier: Apache-2.0
"""A model, what was measured, and what the one leaves of the other: whitened residuals."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from loco_control.params import limits
from loco_sim.effects import EFFECTS, from_list, pulls

from ..recordings.record import Record, coarsest
from ..statistics import evidence, noise
from ..statistics.solve import FEW, FIRST, differences, guided
from . import floors as errors
from . import horizon, loose, nominal, running
from .loose import Loose

REST = 0.05  # of the numerical error over all records that is there at any time
ASTRAY = 1.12  # times what straight lines promise, or less by that (1.05: one test is ambiguous)
ROUNDS = 3  # simulations per value that is refitted without them (taste)
AGAIN = 3  # runs about what suits a model, until that is near (taste)
LITTLE = 0.2  # rms [floors] of a change in the step error, or from straight lines, that is none
CAP = 20.0  # times the largest residual of the model as it came: more is a model that fell over


@dataclass
class Case:
    """Residuals of models on the records that are fitted and those that judge.

    Attributes:
        forward: Forward model: predictions where the robot was measured.
        records: All records, in the order of the forward model.
        fit_rows: Rows of each record that are fitted, (T,) flags.
        held_rows: Rows of each record that only judge, (T,) flags.
        floor: Noise and numerical error of each channel, (C,).
        floors: The same with what no model can tell at that time, (T, C) per record.
        fine: Physics step over the model's, for runs without the engine.
        correction: Part that predictions lack because the physics step is not zero, (T, C) for
            each record, by step.
        cap: Largest whitened residual that is told from a fall.
        ground: The robot stands on feet, whose contacts leave nothing to extrapolate.
        count: Simulations so far [records].
        runs: Runs of the model as it came, by step.
        loose: Values that are refitted to every model, where the robot says that it has such.
        lines: The same about the last model that was asked for, by its effects.
    """

    forward: Any
    records: list[Record]
    fit_rows: list[np.ndarray]
    held_rows: list[np.ndarray]
    floor: np.ndarray
    floors: list[np.ndarray]
    fine: float
    correction: dict[float, list[np.ndarray]]
    cap: float = evidence.LIMIT
    ground: bool = False
    count: int = field(default=0, compare=False)
    runs: dict[float, tuple] = field(default_factory=dict, compare=False, repr=False)
    loose: Loose | None = None
    lines: dict[str, Loose] = field(default_factory=dict, compare=False, repr=False)

    @property
    def fitted(self) -> list[int]:
        """Records that are fitted, at least in part."""
        return [i for i, rows in enumerate(self.fit_rows) if rows.any()]

    @property
    def judging(self) -> list[int]:
        """Records that judge, at least in part."""
        return [i for i, rows in enumerate(self.held_rows) if rows.any()]

    @property
    def signals(self) -> list[str]:
        """Names of the signals that were measured."""
        return sorted({channel.signal for channel in self.forward.channels})

    @property
    def bends(self) -> bool:
        """Whether values are refitted along straight lines that are so for small changes alone."""
        near = self.loose
        return near is not None and not near.held and bool(np.isfinite(near.most))

    def whitened(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> list[np.ndarray]:
        """Residual of whole records in floors, (T, C) each; coarse in the model's own steps."""
        only = list(range(len(self.records))) if only is None else list(only)
        return self._refitted(specs, overrides, only, coarse)[0]

    def fewer(self, most: int) -> Case:
        """The case with few pieces of each record on the ground."""
        loose = self.loose and replace(self.loose, grams={})  # they are of what is measured
        return replace(self, forward=self.forward.fewer(most), loose=loose, lines={})

    def kept(self) -> Case:
        """The case with nothing refitted but the states in which records begin."""
        if self.loose is None:
            return self
        return self.at(0.0 * self.loose.at)

    def _refitted(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None,
        only: list[int],
        coarse: bool = False,
        exact: bool = False,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Residuals with what suits the model best, and the deviations of that (`Loose.best`).

        Where it is not exact, what is known well is taken as linear, however far off it is.
        """
        if self.loose is None:
            return self.bare(specs, overrides, only, coarse), []
        given, near = overrides or {}, self.loose
        residuals, by = self._solved(near, specs, given, only, coarse)
        for _ in range(AGAIN if exact else 1):
            if not near.far(by, exact):
                break
            # too far for a straight line: once more, from there
            near = near.about(np.where(near.stated | exact, by[0], near.at))
            residuals, by = self._solved(near, specs, given, only, coarse)
        return near.left(residuals, only, by), by

    def _solved(
        self,
        near: Loose,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any],
        only: list[int],
        coarse: bool = False,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Residuals simulated about the values of `near`, and what suits the model best there."""
        residuals = self.bare(specs, {**_about(near), **overrides}, only, coarse)
        return residuals, near.best(residuals, only)

    def _about(self, overrides: Mapping[str, Any] | None) -> dict[str, Any]:
        """Overrides with the values about which what is refitted is linear."""
        return {**_about(self.loose), **(overrides or {})}

    def suited(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any],
        known: Mapping[str, float] | None = None,
    ) -> tuple[list[np.ndarray], dict[str, float], float, tuple[np.ndarray, ...]]:
        """Residuals as of `whitened` of all records; what was refitted for them; its price.

        What was refitted is simulated once more. Where that is not what straight lines promised, as
        a joint sticks or a drive rounds its encoder, values are sought by simulation, from there or
        from the robot as it came. The model without effects, which all others have to beat, is held
        to more: there any difference that shows will do.

        Args:
            specs: Effects of the model.
            overrides: Values of the robot that it has.
            known: Values from which they are sought, too.

        Returns:
            Residuals, (T, C) each; values by dotted name, none without any that are refitted;
            half of the squares of all deviations [nat]; by how much positions and velocities at
            the start of each record were moved [rad, rad/s], (2n,), empty where they were not.
        """
        left, by, bent = self._promised(specs, overrides)
        if bent is not None:
            promised = self._cost(left, by)
            differs = not specs and self._apart(left, bent[0]) > LITTLE
            if differs or not self._told(left, by, *bent):
                starts = [bent, self._fixed(specs, overrides, 0.0 * by[0])]
                if known:
                    starts.append(self._fixed(specs, overrides, self.loose.deviations(known)))
                left, by = min(starts, key=lambda each: self._cost(*each))
                found = self._sought(specs, overrides, by[0], promised)
                if self._cost(*found) < self._cost(left, by) - FEW:
                    left, by = found
        stays = self.loose is None or self.loose.held
        return left, {} if stays else self.loose.values(by[0]), _price(by), self._moved(by[1:])

    def _moved(self, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
        """Change of the state in which each record begins, (2n,), from deviations of it."""
        if not any(len(by) for by in starts):
            return tuple(starts)
        doubts = self.forward.doubtful()
        return tuple(by * doubt[: len(by)] for by, doubt in zip(starts, doubts, strict=True))

    def straight(self, specs: Sequence[Mapping], overrides: Mapping[str, Any]) -> bool:
        """Whether simulating what was refitted for a model gives what straight lines promised."""
        left, by, bent = self._promised(specs, overrides)
        return bent is None or self._told(left, by, *bent)

    def _promised(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any]
    ) -> tuple[list[np.ndarray], list[np.ndarray], tuple[list, list] | None]:
        """Residuals and deviations by straight lines; both by simulation, where that may differ."""
        every = list(range(len(self.records)))
        left, by = self._refitted(specs, overrides, every, exact=True)
        if not self.bends or not by[0].any():
            return left, by, None
        return left, by, self._fixed(specs, overrides, by[0])

    def _told(
        self, left: list, by: Sequence[np.ndarray], there: list, at: Sequence[np.ndarray]
    ) -> bool:
        """A simulation costs what straight lines promised, about."""
        return 1.0 / ASTRAY < self._cost(there, at) / max(self._cost(left, by), 1e-9) < ASTRAY

    def _apart(self, left: Sequence[np.ndarray], there: Sequence[np.ndarray]) -> float:
        """Rms of what a simulation leaves beside what straight lines promised [floors]."""
        apart = [a - b for a, b in zip(left, there, strict=True)]
        return evidence.rms(self.masked(apart, range(len(left)), held=False))

    def relined(self, specs: Sequence[Mapping]) -> Case:
        """The case whose straight lines are those about a model with effects."""
        key = repr(specs)
        if key not in self.lines:
            self.lines.clear()  # they are large
            self.lines[key] = loose.of_model(self, specs)
        return replace(self, loose=self.lines[key])

    def at(self, deviations: np.ndarray) -> Case:
        """The case with values at these deviations, which stay; starts are refitted."""
        return replace(self, loose=replace(self.loose, at=deviations, held=True))

    def _sought(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any],
        start: np.ndarray,
        promised: float,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The same with values that suit the model best by simulation, near others.

        Straight lines say where to go first. Only where that does not lead to what they promised is
        the change by each value simulated.
        """
        every, (low, high) = list(range(len(self.records))), self.loose.reach
        told = self.at(start).extrapolated(specs, overrides, every)

        def promise(at: np.ndarray) -> np.ndarray:
            return self._line(*told(at))

        def residual(at: np.ndarray) -> np.ndarray:
            return self._line(*self._fixed(specs, overrides, at))

        slopes = differences(promise, start, promise(start), loose.PART, high)
        budgets = FIRST, ROUNDS * (len(start) + 1)
        found = guided(residual, start, (low, high), loose.PART, budgets, slopes, promised)
        return self._fixed(specs, overrides, found.z)

    def extrapolated(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], only: list[int]
    ) -> Callable[[np.ndarray], tuple[list[np.ndarray], list[np.ndarray]]]:
        """Function that follows straight lines from the values of the case, after one simulation.

        Returns:
            A function of deviations, (V,), that returns residuals, (T, C) for each record of
            `only`, with the starts that suit these best, and all deviations.
        """
        near, count = self.loose, len(self.loose.at)
        here = self.bare(specs, self._about(overrides), only)

        def told(at: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
            by, there = at - near.at, self.at(at).loose
            moved = [r + near.columns[i][..., :count] @ by for i, r in zip(only, here, strict=True)]
            best = there.best(moved, only)
            return there.left(moved, only, best), best

        return told

    def _fixed(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], at: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The same with values at these deviations, and starts that suit the model best."""
        return self.at(at)._refitted(specs, overrides, list(range(len(self.records))))

    def _line(self, left: Sequence[np.ndarray], by: Sequence[np.ndarray]) -> np.ndarray:
        """Residual where it is fitted and all deviations, (N,): half of its squares is the cost."""
        fitted = self.masked(left, range(len(left)), held=False)
        return np.concatenate([*(np.nan_to_num(r).ravel() for r in fitted), *by])

    def _cost(self, left: Sequence[np.ndarray], by: Sequence[np.ndarray]) -> float:
        """Half of the squares of fitted residuals and of deviations [nat]."""
        line = self._line(left, by)
        return 0.5 * float(line @ line)

    def bare(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> list[np.ndarray]:
        """Residual as of `whitened` with nothing refitted."""
        only = list(range(len(self.records))) if only is None else list(only)
        self.count += len(only)
        step = 1.0 if coarse else self.step_of(specs)
        predicted = self.predicted(specs, overrides or {}, only, step)
        lacks = self.correction[step]
        residuals = []
        for i, p in zip(only, predicted, strict=True):
            measured = [self.forward.measured[i]]
            residuals += evidence.whiten(measured, [p + lacks[i]], self.floors[i])
        return residuals

    def predicted(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], only: list[int], step: float
    ) -> list[np.ndarray]:
        """Prediction; a delay, which the plant rounds to whole steps, lies between two of them."""
        names = [EFFECTS[s["name"]].identity.whole_steps for s in specs]
        late = [i for i, name in enumerate(names) if name]
        if len(late) != 1:
            return self.forward(specs, overrides, only, step)
        (index,), period = late, step * self.period
        name = names[index]
        below, between = divmod(specs[index][name] / period, 1.0)
        runs, (_, longest) = [], limits(EFFECTS[specs[index]["name"]], name)
        for whole in (below, below + 1.0):
            changed = list(specs)
            changed[index] = {**specs[index], name: min(whole * period, longest)}
            runs.append(self.forward(changed, overrides, only, step))
        return [(1.0 - between) * a + between * b for a, b in zip(*runs, strict=True)]

    @cached_property
    def period(self) -> float:
        """Physics step of the model as it came [s]."""
        return running.step(self.forward._robot(0, {}, 1.0), running.period(self.records[0]))

    def step_of(self, specs: Sequence[Mapping]) -> float:
        """Physics step over the model's: fine for what runs without the engine."""
        return 1.0 if any(pull is None for _, pull in pulls.of(from_list(specs))) else self.fine

    def corrected(self, specs: Sequence[Mapping], overrides: Mapping[str, Any]) -> Case:
        """The case with the step error of another model; itself where that is the same."""
        if self.ground:
            return self
        step = self.step_of(specs)
        self.count += 3 * len(self.records)
        every = list(range(len(self.records)))
        about = self._about(overrides)
        here, half = (self.predicted(specs, about, every, s * step) for s in (1.0, 0.5))
        first = [2.0 * (h - w) for h, w in zip(half, here, strict=True)]
        bare = [2.0 * (h - w) for h, w in zip(*self._bare(step), strict=True)]
        moved = [f - b for f, b in zip(first, bare, strict=True)]
        if self._small(moved):
            return self
        if step != self.fine:  # what finer steps would add is taken from the model as it came
            first = [c + m for c, m in zip(self.correction[step], moved, strict=True)]
        known = {step: [np.nan_to_num(c) for c in first]}
        return replace(self, correction={**self.correction, **known})

    def _small(self, errors: Sequence[np.ndarray]) -> bool:
        """Errors of predictions are far below the floor in every channel of every record."""
        each = [np.square(np.nan_to_num(e) / f) for e, f in zip(errors, self.floors, strict=True)]
        return all(np.max(np.mean(e, axis=0)) < LITTLE**2 for e in each)

    def _bare(self, step: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The model as it came at half a step, and at the step."""
        if step not in self.runs:
            about = self._about({})
            runs = (self.forward((), about, step=part * step) for part in (0.5, 1.0))
            self.runs[step] = tuple(runs)
        return self.runs[step]

    def masked(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], held: bool
    ) -> list[np.ndarray]:
        """Residuals of the rows that are fitted, or of those that judge; others are NaN."""
        rows = self.held_rows if held else self.fit_rows
        return [np.where(rows[i][:, None], r, np.nan) for i, r in zip(only, residuals, strict=True)]

    def judged(self, whole: Sequence[np.ndarray]) -> evidence.Score:
        """Score of residuals of all records, (T, C) each, on the data that judge."""
        return evidence.score(self.masked(whole, range(len(self.records)), held=True))

    def vector(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> np.ndarray:
        """Residual of all fitted values in one line [floors], (N,)."""
        return self.pulled(specs, overrides, only, coarse)[0]

    def pulled(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The same, and all deviations of what was refitted for it, (K,)."""
        only = self.fitted if only is None else list(only)
        return self.flat(*self._refitted(specs, overrides, only, coarse), only)

    def flat(
        self, left: Sequence[np.ndarray], by: Sequence[np.ndarray], only: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of records, (T, C) each, and their deviations, as of `pulled`."""
        residuals = self.masked(left, only, held=False)
        flat = np.concatenate(
            [r[np.isfinite(self._weighed(i))] for i, r in zip(only, residuals, strict=True)]
        )
        flat = np.clip(np.nan_to_num(flat, nan=self.cap), -self.cap, self.cap)
        return flat, np.concatenate([*by, np.zeros(0)])

    def _weighed(self, i: int) -> np.ndarray:
        """Measured values of a record where it is fitted, NaN elsewhere, (T, C)."""
        return np.where(self.fit_rows[i][:, None], self.forward.measured[i], np.nan)

    def channel_of(self, only: Sequence[int] | None = None) -> np.ndarray:
        """Channel of each value of `vector`, (N,)."""
        only = self.fitted if only is None else list(only)
        return np.concatenate([np.nonzero(np.isfinite(self._weighed(i)))[1] for i in only])


def _about(near: Loose | None) -> dict[str, float]:
    """Values about which what is refitted is linear; none where they are the robot's own."""
    return near.values(near.at) if near is not None and near.at.any() else {}


def _price(by: Sequence[np.ndarray]) -> float:
    """Half of the squares of deviations [nat]."""
    return 0.5 * float(sum(np.square(part).sum() for part in by))


def prepare(
    forward: Any,
    records: Sequence[Record],
    held_out: Sequence[Record],
    likely: Sequence[Mapping[str, Any]] = (),
    known: Collection[str] = (),
    refitted: bool = True,
) -> Case:
    """Split what is fitted from what judges, and find the floor of each channel.

    Without records to judge on, the last third of each record judges.

    Args:
        forward: Forward model of ``[*records, *held_out]``.
        records: Records to fit.
        held_out: Records to judge on.
        likely: Effects with which engines are compared, too, on the ground.
        known: Values that are not refitted to every model, as they are free.
        refitted: Whether what nobody knows exactly is.
    """
    both = [*records, *held_out]
    fit_rows, held_rows = [], []
    for i, record in enumerate(both):
        rows = np.zeros(len(record.t), dtype=bool)
        if held_out:
            rows[:] = i < len(records)
            judges = ~rows
        else:
            rows[: (2 * len(rows)) // 3] = True
            judges = ~rows
        fit_rows.append(rows)
        held_rows.append(judges)
    steps = np.array([coarsest(both, c.signal, c.name) for c in forward.channels])
    fine, ground = errors.finest(forward), forward.grounded
    signals = [c.signal for c in forward.channels]
    correction, numeric = errors.step_error(forward, fine)
    more = [errors.stepped(forward, correction[1.0])]
    more += [errors.doubts(forward, likely)] if forward.in_pieces else []
    for about in more:
        numeric = [np.hypot(n, a) for n, a in zip(numeric, about, strict=True)]
    sensors = noise.floor(forward.measured, steps, signals)
    pooled = errors.pooled(numeric, forward.measured)
    floor = noise.total(sensors, pooled)
    hunts = horizon.timing(forward) if ground else errors.hunting(forward, fine)
    local = zip(numeric, hunts, strict=True)
    floors = [np.hypot(noise.total(sensors, np.maximum(n, REST * pooled)), h) for n, h in local]
    case = Case(forward, both, fit_rows, held_rows, floor, floors, fine, correction, ground=ground)
    robot = forward.given()
    uncertain = robot.uncertain if refitted else {}
    quick = refitted and (ground or errors.compiled(forward)) and forward.fine_steps
    said = {name for record in both for name in record.overrides}
    unsaid = nominal.priors(robot, {*uncertain, *known, *said}) if quick else []
    case.loose = loose.prepare(case, uncertain, robot, not forward.fine_steps, unsaid)
    if case.loose and case.loose.at.any() and not ground:
        case.correction = errors.step_error(forward, fine, case._about({}))[0]
        case.runs = {}
    before = case.vector([])
    case.cap = CAP * max(float(np.max(np.abs(before), initial=0.0)), 10.0)
    return case
