# SPDX-License-Identifier: Apache-2.0
"""Model and measurements with their whitened residuals, and refits of uncertain values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from loco_control.params import limits
from loco_sim.effects import EFFECTS, from_list, pulls

from ..recordings.record import Record, coarsest
from ..statistics import evidence, noise
from ..statistics.solve import FIRST, MIN_GAIN, differences, guided
from . import floors as errors
from . import horizon, loose, nominal, running
from .loose import Loose

REST = 0.05  # share of the numerical error over all records that is assumed at any time
RATIO = 1.12  # largest ratio of simulated and linearised cost (1.05: one test is ambiguous)
ROUNDS = 3  # simulations per refitted value if the linearisation fails (taste)
MAX_LINEARISATIONS = 3  # linearisations, each about the last solution, until it converges (taste)
SMALL = 0.2  # rms [floors] below which a change of the step or linearisation error is negligible
N_SEGMENTS = 6  # pieces of each record in a sparse case (taste)
CAP = 20.0  # bound on residuals, over the largest one of the initial model: beyond, a robot fell


def are_smooth(effects: Iterable[str]) -> bool:
    """True if none of the named effects acts in jumps, as dry friction and stops do."""
    return all(EFFECTS[name].identity.smooth for name in effects)


@dataclass
class Case:
    """Residuals of models on the fitted and on the held-out records.

    Attributes:
        forward: Forward model: predictions at the measured times.
        records: All records, in the order of the forward model.
        fit_rows: Rows of each record that are fitted, (T,) flags.
        held_rows: Held-out rows of each record, (T,) flags.
        floor: Noise and numerical error of each channel, (C,).
        floors: The floor with the error that no model can avoid at that time, (T, C) per record.
        fine: Ratio of the physics step to the model's, for runs without the physics engine.
        correction: Correction of predictions for the finite physics step, (T, C) for each record,
            by step.
        own: Whether it is that of a model near those to be simulated, not of the initial one.
        cap: Bound on whitened residuals, so that a fall does not dominate.
        ground: Whether the robot stands on feet; contacts permit no step extrapolation.
        count: Number of simulated records so far.
        runs: Cached predictions of the initial model, (T, C) each, by step.
        loose: Uncertain values, refitted with every model; None if the robot declares none.
        lines: Cached linearisation about the last model with effects, by these effects.
        times: Standard deviation of the times of readings about their clock [s], by record.
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
    own: bool = False
    count: int = field(default=0, compare=False)
    runs: dict[float, list[np.ndarray]] = field(default_factory=dict, compare=False, repr=False)
    loose: Loose | None = None
    lines: dict[str, Loose] = field(default_factory=dict, compare=False, repr=False)
    times: Sequence[float] = ()

    @property
    def fitted(self) -> list[int]:
        """Indices of the records with fitted rows."""
        return [i for i, rows in enumerate(self.fit_rows) if rows.any()]

    @property
    def judging(self) -> list[int]:
        """Indices of the records with held-out rows."""
        return [i for i, rows in enumerate(self.held_rows) if rows.any()]

    @cached_property
    def rounds(self) -> bool:
        """Whether a drive rounds its encoder, so that even smooth effects act in jumps."""
        return self.forward._robot(0, {}, 1.0).encoder_step > 0.0

    @property
    def signals(self) -> list[str]:
        """Names of the measured signals."""
        return sorted({channel.signal for channel in self.forward.channels})

    @property
    def bends(self) -> bool:
        """True if values are refitted with a linearisation that holds for small changes only."""
        linear = self.loose
        return linear is not None and not linear.held and bool(np.isfinite(linear.most))

    def whitened(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> list[np.ndarray]:
        """Residuals of whole records [floors], (T, C) each; `coarse` uses the model's own steps."""
        only = list(range(len(self.records))) if only is None else list(only)
        return self._refitted(specs, overrides, only, coarse)[0]

    @cached_property
    def sparse(self) -> Case:
        """The case with at most `N_SEGMENTS` pieces of each record on the ground."""
        loose = self.loose and replace(self.loose, grams={})  # they depend on the measured rows
        return replace(self, forward=self.forward.fewer(N_SEGMENTS), loose=loose, lines={})

    def kept(self) -> Case:
        """The case in which only the initial states of the records are refitted."""
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
        """Residuals after refitting the uncertain values, and their deviations (`Loose.best`).

        Unless `exact`, well-known values stay linearised about nominal, however far they deviate.
        """
        if self.loose is None:
            return self.bare(specs, overrides, only, coarse), []
        assigned, linear = overrides or {}, self.loose
        residuals, by = self._solved(linear, specs, assigned, only, coarse)
        left = linear.left(residuals, only, by)
        for _ in range(MAX_LINEARISATIONS if exact else 1):
            if not linear.far(by, exact):
                break
            # outside the range of the linearisation: repeat about the solution, if better
            linear = linear.about(np.where(linear.stated | exact, by[0], linear.at))
            residuals, new = self._solved(linear, specs, assigned, only, coarse)
            after = linear.left(residuals, only, new)
            if exact and self._cost(after, new, only) > self._cost(left, by, only) + MIN_GAIN:
                break
            left, by = after, new
        return left, by

    def _solved(
        self,
        linear: Loose,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any],
        only: list[int],
        coarse: bool = False,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Residuals simulated at the values of `linear`, and the refitted deviations."""
        residuals = self.bare(specs, {**_about(linear), **overrides}, only, coarse)
        return residuals, linear.best(residuals, only)

    def _about(self, overrides: Mapping[str, Any] | None) -> dict[str, Any]:
        """Overrides with the values about which the uncertain values are linearised."""
        return {**_about(self.loose), **(overrides or {})}

    def suited(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any],
        fixed: Mapping[str, float] | None = None,
        seek: bool = True,
    ) -> tuple[list[np.ndarray], dict[str, float], float, tuple[np.ndarray, ...], float]:
        """Residuals on all records, refitted values, their prior penalty and initial states.

        The refitted values are checked by a simulation. Where it differs from the linearisation, as
        when a joint sticks or a drive quantises its encoder, the values are fitted by simulation,
        starting from there or from the initial robot. The model without effects is the reference
        for all others; for it, a difference above `SMALL` is already reason to do so.

        Args:
            specs: Effects of the model.
            overrides: Values of the robot in the model.
            fixed: Uncertain values that were fitted by simulation before; no others are sought.
            seek: Whether values are fitted by simulation where that is needed.

        Returns:
            Residuals, (T, C) each; refitted values by dotted name, empty if there are none; half of
            the sum of squares of all deviations [nat]; change of the initial positions and
            velocities of each record [rad, rad/s], (2n,), empty if they were not refitted; share
            of the cost that, by the linearisation, a fit by simulation would leave, 1 after it.
        """
        left, by, alternative = self._promised(specs, overrides)
        hope = 1.0
        if alternative is not None:
            expected = self._cost(left, by)
            has_step_error = not specs and self._apart(left, alternative[0]) > SMALL
            if has_step_error or not self._agree(left, by, *alternative):
                starts = [alternative, self._fixed(specs, overrides, 0.0 * by[0])]
                if fixed:
                    starts.append(self._fixed(specs, overrides, self.loose.deviations(fixed)))
                left, by = min(starts, key=lambda each: self._cost(*each))
                if seek and not fixed:
                    candidate = self._sought(specs, overrides, by[0], expected)
                    if self._cost(*candidate) < self._cost(left, by) - MIN_GAIN:
                        left, by = candidate
                elif not fixed:
                    hope = min(1.0, expected / max(self._cost(left, by), 1e-9))
        stays = self.loose is None or self.loose.held
        values = {} if stays else self.loose.values(by[0])
        return left, values, _price(by), self._moved(by[1:]), hope

    def simulated(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], at: np.ndarray
    ) -> tuple[list[np.ndarray], dict[str, float], float, tuple[np.ndarray, ...]]:
        """As `suited`, without the last, with values of the robot at deviations, (V,)."""
        left, by = self._fixed(specs, overrides, at)
        return left, self.loose.values(at), _price(by), self._moved(by[1:])

    def _moved(self, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
        """Change of the initial state of each record [rad, rad/s], (2n,), from its deviations."""
        spreads = self.forward.doubtful() if starts else []
        count = 2 * len(self.forward.robot().joints)
        spreads = [std[:count] for std in spreads]
        pairs = zip(starts, spreads, strict=True)
        return tuple(by[: len(std)] * std[: len(by)] for by, std in pairs)

    def straight(self, specs: Sequence[Mapping], overrides: Mapping[str, Any]) -> bool:
        """True if a simulation of the refitted values agrees with the linearisation."""
        left, by, alternative = self._promised(specs, overrides)
        return alternative is None or self._agree(left, by, *alternative)

    def _promised(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any]
    ) -> tuple[list[np.ndarray], list[np.ndarray], tuple[list, list] | None]:
        """Residuals and deviations by linearisation; both by simulation too, if that may differ."""
        every = list(range(len(self.records)))
        left, by = self._refitted(specs, overrides, every, exact=True)
        if not self.bends or not by[0].any():
            return left, by, None
        return left, by, self._fixed(specs, overrides, by[0])

    def _agree(
        self, left: list, by: Sequence[np.ndarray], sim: list, at: Sequence[np.ndarray]
    ) -> bool:
        """True if the costs of simulation and linearisation agree within `RATIO`."""
        return 1.0 / RATIO < self._cost(sim, at) / max(self._cost(left, by), 1e-9) < RATIO

    def _apart(self, left: Sequence[np.ndarray], other: Sequence[np.ndarray]) -> float:
        """Rms difference between simulated and linearised residuals [floors]."""
        differences = [a - b for a, b in zip(left, other, strict=True)]
        return evidence.rms(self.masked(differences, range(len(left)), held=False))

    def relined(self, specs: Sequence[Mapping]) -> Case:
        """The case with uncertain values linearised about a model with effects."""
        key = repr(specs)
        if key not in self.lines:
            self.lines.clear()  # to save memory
            self.lines[key] = loose.of_model(self, specs)
        return replace(self, loose=self.lines[key])

    def at(self, deviations: np.ndarray) -> Case:
        """The case with values fixed at these deviations; initial states are refitted."""
        return replace(self, loose=replace(self.loose, at=deviations, held=True))

    def _sought(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any],
        start: np.ndarray,
        expected: float,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Residuals and deviations after fitting the uncertain values by simulation, near `start`.

        The first steps use the linearisation. The sensitivity to each value is simulated only if
        the cost does not fall as the linearisation predicts.
        """
        fitted, (low, high) = self.fitted, self.loose.reach
        extrapolate = self.at(start).extrapolated(specs, overrides, fitted)

        def promise(at: np.ndarray) -> np.ndarray:
            return self._line(*extrapolate(at), fitted)

        def residual(at: np.ndarray, coarse: bool = False) -> np.ndarray:
            return self._line(*self.at(at)._refitted(specs, overrides, fitted, coarse), fitted)

        slopes = differences(promise, start, promise(start), np.full(len(start), loose.PART), high)
        budgets = FIRST, ROUNDS * (len(start) + 1)
        cheap = partial(residual, coarse=True) if self.quickly(specs) else None
        result = guided(residual, start, (low, high), loose.PART, budgets, slopes, expected, cheap)
        return self._fixed(specs, overrides, result.z)

    def extrapolated(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], only: list[int]
    ) -> Callable[[np.ndarray], tuple[list[np.ndarray], list[np.ndarray]]]:
        """Linear prediction of residuals about the values of the case, from one simulation.

        Returns:
            A function of deviations, (V,), that returns residuals, (T, C) for each record of
            `only`, with refitted initial states, and all deviations.
        """
        linear, ref = self.loose, self.bare(specs, self._about(overrides), only)

        def predict(at: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
            shifted, starts = self.at(at).loose, linear.unmoved(only)[1:]
            moved = linear.moved(ref, only, [at, *starts])
            best = shifted.best(moved, only)
            return shifted.left(moved, only, best), best

        return predict

    def _fixed(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], at: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Residuals and deviations with values fixed at `at` and initial states refitted."""
        return self.at(at)._refitted(specs, overrides, list(range(len(self.records))))

    def _line(
        self, left: Sequence[np.ndarray], by: Sequence[np.ndarray], only: Sequence[int] = ()
    ) -> np.ndarray:
        """Residuals of fitted rows and all deviations, (N,); half its squared norm is the cost."""
        fitted = self.masked(left, only or range(len(left)), held=False)
        return np.concatenate([*(np.nan_to_num(r).ravel() for r in fitted), *by])

    def _cost(
        self, left: Sequence[np.ndarray], by: Sequence[np.ndarray], only: Sequence[int] = ()
    ) -> float:
        """Half of the sum of squares of fitted residuals and deviations [nat]."""
        line = self._line(left, by, only)
        return 0.5 * float(line @ line)

    def bare(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> list[np.ndarray]:
        """Residuals as `whitened` with nothing refitted."""
        only = list(range(len(self.records))) if only is None else list(only)
        self.count += len(only)
        step = 1.0 if coarse else self.step_of(specs)
        predicted = self.predicted(specs, overrides or {}, only, step)
        step_error = self.correction[step]
        scales = 1.0 + nominal.reading_scales(overrides or {}, self.forward.channels).sum(axis=0)
        residuals = []
        for i, p in zip(only, predicted, strict=True):
            measured = [self.forward.measured[i] * scales]
            residuals += evidence.whiten(measured, [p + step_error[i]], self.floors[i])
        return residuals

    def predicted(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], only: list[int], step: float
    ) -> list[np.ndarray]:
        """Predictions; a delay between two whole steps is interpolated between two simulations."""
        names = [EFFECTS[s["name"]].identity.whole_steps for s in specs]
        late = [i for i, name in enumerate(names) if name]
        if len(late) != 1:
            return self.forward(specs, overrides, only, step)
        (index,), period = late, step * self.period
        name = names[index]
        below, between = divmod(specs[index][name] / period, 1.0)
        runs, (_, longest) = [], limits(EFFECTS[specs[index]["name"]], name)
        for n_periods in (below, below + 1.0):
            changed = list(specs)
            changed[index] = {**specs[index], name: min(n_periods * period, longest)}
            runs.append(self.forward(changed, overrides, only, step))
        return [(1.0 - between) * a + between * b for a, b in zip(*runs, strict=True)]

    @cached_property
    def period(self) -> float:
        """Physics step of the initial model [s]."""
        return running.step(self.forward._robot(0, {}, 1.0), running.period(self.records[0]))

    def step_of(self, specs: Sequence[Mapping]) -> float:
        """Ratio of the physics step to the model's: `fine` for runs without the physics engine."""
        return 1.0 if any(pull is None for _, pull in pulls.of(from_list(specs))) else self.fine

    def quickly(self, specs: Sequence[Mapping]) -> bool:
        """True if the larger steps of the model give nearly the same Jacobian.

        They do not where a joint sticks or hits a stop.
        """
        return are_smooth(spec["name"] for spec in specs) and self.step_of(specs) < 1.0

    def corrected(self, specs: Sequence[Mapping], overrides: Mapping[str, Any]) -> Case:
        """The case with the step error of another model; itself if the change is negligible.

        The model's own steps are used if their error is of first order, so that it is known. It is
        not where a joint hits a stiff stop.
        """
        if self.ground or self.own:
            return self
        step, about = self.step_of(specs), self._near(specs, overrides)
        if step < 1.0:
            full, mid, quarter = (self._apart_from_bare(specs, about, k) for k in (1.0, 0.5, 0.25))
            limits = [errors.extrapolated(*pair) for pair in ((full, mid), (mid, quarter))]
            if self._small([a - b for a, b in zip(*limits, strict=True)]):
                return self._off_by(1.0, full, mid)
        full, mid = (self._apart_from_bare(specs, about, k * step) for k in (1.0, 0.5))
        if self._small([2.0 * (h - w) for w, h in zip(full, mid, strict=True)]):
            return self
        return self._off_by(step, full, mid)

    def _near(self, specs: Sequence[Mapping], overrides: Mapping[str, Any]) -> dict[str, Any]:
        """Overrides with the refitted uncertain values: the step error changes with them."""
        if self.loose is None or self.loose.held:
            return self._about(overrides)
        _, by = self._refitted(specs, overrides, [*range(len(self.records))], coarse=True)
        return {**self.loose.values(by[0]), **overrides}

    def _apart_from_bare(
        self, specs: Sequence[Mapping], overrides: Mapping[str, Any], step: float
    ) -> list[np.ndarray]:
        """Predictions of a model minus those of the initial one, both at a step, (T, C) each."""
        self.count += len(self.records)
        predicted = self.predicted(specs, overrides, [*range(len(self.records))], step)
        return [p - b for p, b in zip(predicted, self._bare(step), strict=True)]

    def _off_by(self, step: float, full: list[np.ndarray], half: list[np.ndarray]) -> Case:
        """The case with the step error of a model, from its runs at a step and at half of it."""
        each = zip(self.correction[step], full, half, strict=True)
        error = [np.nan_to_num(c + 2.0 * (h - w)) for c, w, h in each]
        return replace(self, fine=step, correction={**self.correction, step: error}, own=True)

    def _small(self, errors: Sequence[np.ndarray]) -> bool:
        """True if prediction errors are far below the floor in every channel of every record."""
        each = [np.square(np.nan_to_num(e) / f) for e, f in zip(errors, self.floors, strict=True)]
        return all(np.max(np.mean(e, axis=0)) < SMALL**2 for e in each)

    def _bare(self, step: float) -> list[np.ndarray]:
        """Predictions of the initial model at a step."""
        if step not in self.runs:
            self.runs[step] = self.forward((), self._about({}), step=step)
        return self.runs[step]

    def persistence(self) -> list[np.ndarray]:
        """Residuals of signals that keep their first value in a piece [floors], (T, C) each."""
        pairs = zip(self.forward.measured, self.forward.persistence(), self.floors, strict=True)
        return [evidence.whiten([y], [p], floor)[0] for y, p, floor in pairs]

    def masked(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], held: bool
    ) -> list[np.ndarray]:
        """Residuals of the fitted or of the held-out rows; others are NaN."""
        rows = self.held_rows if held else self.fit_rows
        return [np.where(rows[i][:, None], r, np.nan) for i, r in zip(only, residuals, strict=True)]

    def judged(self, residuals: Sequence[np.ndarray]) -> evidence.Score:
        """Score of residuals of all records, (T, C) each, on held-out data."""
        return evidence.score(self.masked(residuals, range(len(self.records)), held=True))

    def vector(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> np.ndarray:
        """Residuals of all fitted values as a vector [floors], (N,)."""
        return self.pulled(specs, overrides, only, coarse)[0]

    def pulled(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residuals as `vector`, and all deviations of the refitted values, (K,)."""
        only = self.fitted if only is None else list(only)
        return self.flat(*self._refitted(specs, overrides, only, coarse), only)

    def flat(
        self, left: Sequence[np.ndarray], by: Sequence[np.ndarray], only: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residual vector of records, (T, C) each, and their deviations, as `pulled`."""
        vector = np.concatenate([r[self._weighed[i]] for i, r in zip(only, left, strict=True)])
        vector = np.clip(np.nan_to_num(vector, nan=self.cap), -self.cap, self.cap)
        return vector, np.concatenate([*by, np.zeros(0)])

    @cached_property
    def _weighed(self) -> list[np.ndarray]:
        """Flags of the measured values in fitted rows, (T, C) for each record."""
        pairs = zip(self.fit_rows, self.forward.measured, strict=True)
        return [rows[:, None] & np.isfinite(measured) for rows, measured in pairs]

    def channel_of(self, only: Sequence[int] | None = None) -> np.ndarray:
        """Channel index of each value of `vector`, (N,)."""
        only = self.fitted if only is None else list(only)
        return np.concatenate([np.nonzero(self._weighed[i])[1] for i in only])


def _about(linear: Loose | None) -> dict[str, float]:
    """Values about which the robot is linearised; empty if they are its nominal values."""
    return linear.values(linear.at) if linear is not None and linear.at.any() else {}


def _price(by: Sequence[np.ndarray]) -> float:
    """Half of the sum of squares of deviations [nat]."""
    return 0.5 * float(sum(np.square(part).sum() for part in by))


def prepare(
    forward: Any,
    records: Sequence[Record],
    held_out: Sequence[Record],
    suspects: Sequence[Mapping[str, Any]] = (),
    free_names: Collection[str] = (),
    refitted: bool = True,
) -> Case:
    """Split data into fitted and held-out rows, and compute the floor of each channel.

    Without held-out records, the last third of each record is held out.

    Args:
        forward: Forward model of ``[*records, *held_out]``.
        records: Records to fit.
        held_out: Held-out records.
        suspects: Effects with which physics engines are compared too, on the ground.
        free_names: Names of values that are not refitted with every model, because they are free.
        refitted: Whether uncertain values of the robot are refitted.
    """
    both = [*records, *held_out]
    fit_rows, held_rows = [], []
    for i, record in enumerate(both):
        rows = np.zeros(len(record.t), dtype=bool)
        if held_out:
            rows[:] = i < len(records)
            verification = ~rows
        else:
            rows[: (2 * len(rows)) // 3] = True
            verification = ~rows
        fit_rows.append(rows)
        held_rows.append(verification)
    steps = np.array([coarsest(both, c.signal, c.name) for c in forward.channels])
    fine, ground = errors.finest(forward), forward.grounded
    signals = [c.signal for c in forward.channels]
    correction, numeric = errors.step_error(forward, fine)
    extra = [errors.stepped(forward, correction[1.0]), errors.undersampled(forward)]
    extra += [errors.state_errors(forward, suspects)] if forward.in_pieces else []
    for about in extra:
        numeric = [np.hypot(n, a) for n, a in zip(numeric, about, strict=True)]
    sensors = noise.floor(forward.measured, steps, signals)
    pooled = errors.pooled(numeric, forward.measured)
    floor = noise.total(sensors, pooled)
    limit_cycles = horizon.timing(forward) if ground else errors.limit_cycle_errors(forward, fine)
    times = errors.times(forward)
    mistimed = errors.mistimed(forward, times)
    local = zip(numeric, map(np.hypot, limit_cycles, mistimed), strict=True)
    sensor_noise = noise.without(sensors, mistimed, forward.measured)
    floors = [
        np.hypot(noise.total(sensor_noise, np.maximum(n, REST * pooled)), h) for n, h in local
    ]
    case = Case(forward, both, fit_rows, held_rows, floor, floors, fine, correction, ground=ground)
    case.times = times
    robot = forward.given()
    uncertain = robot.uncertain if refitted else {}
    is_cheap = refitted and (ground or errors.compiled(forward))
    overridden = {name for record in both for name in record.overrides}
    unsaid = nominal.priors(robot, {*uncertain, *free_names, *overridden}) if is_cheap else []
    unsaid += _readings(forward, both) if refitted else []
    case.loose = loose.prepare(case, uncertain, robot, not forward.fine_steps, unsaid)
    if case.loose and case.loose.at.any() and not ground:
        case.correction = errors.step_error(forward, fine, case._about({}))[0]
        case.runs = {}
    before = case.vector([])
    case.cap = CAP * max(float(np.max(np.abs(before), initial=0.0)), 10.0)
    return case


def _readings(forward: Any, records: Sequence[Record]) -> list[dict[str, float]]:
    """Standard deviations of the scales of measured currents without torque constants."""
    names = {c.name for c in forward.channels if c.signal == "tau" and forward.fine_steps}
    joints = dict.fromkeys(j for record in records for j in record.unscaled if j in names)
    return [{f"{nominal.READING}.{joint}": nominal.READING_ERROR} for joint in joints]


def fit_all_rows(forward: Any, records: Sequence[Record]) -> Case:
    """A case in which all rows count as fitted and no value of the robot is refitted."""
    case = prepare(forward, records, (), refitted=False)
    return replace(case, fit_rows=[np.ones(len(r.t), dtype=bool) for r in records])
