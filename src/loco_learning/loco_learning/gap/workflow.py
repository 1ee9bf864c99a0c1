# SPDX-License-Identifier: Apache-2.0
"""Workflow that finds the gap between a model and measurements, and names its cause.

`find` takes a model and records and returns the contents of ``gap.json``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_sim.effects.coordinates import Coordinate
from loco_sim.plant.model import Model

from ..jobs import pool
from ..jobs.base import Jobs
from ..jobs.kept import Memory
from . import stages
from .contents import add, contents, details
from .fitting.fit import Fitted, Parts, Setting, rough_fit, specs_of
from .fitting.params import GapParams
from .fitting.screen import Screened
from .fitting.search import Pool, Search, call
from .hypotheses import hints
from .hypotheses.bundles import batches
from .hypotheses.hypotheses import Hypothesis, offer, omitted, separable
from .hypotheses.likely import likely_hypotheses
from .localisation.curves import Curves, curves, merge
from .prediction import case as cases
from .prediction import horizon, led
from .prediction import nominal as nominals
from .prediction.forward import Forward, ForwardParams
from .recordings.record import Record
from .setup import contents as setup_contents
from .setup import family as setups
from .setup import mend
from .statistics.evidence import Score
from .statistics.leftover import has_gap
from .verdict.decide import AMBIGUOUS, NAMED, PARTLY, UNKNOWN
from .verdict.judge import judge

Report = Callable[[float, str, str], Any]
Keep = Callable[[dict[str, Any], Curves | None], Any]

# Shares of the progress bar at the end of the preselection on the ground, of the search and of the
# verdict: a search without its verdict took 0.35 to 0.5 of the processor time of 9 benches.
PRESELECTION, SEARCH, VERDICT = 0.15, 0.55, 0.95
SAME_FLOOR = 1.1  # ratio of two noise floors with which no search is repeated (taste)
ROBUST_SCALE = 3.0  # scale of the robust loss [floors] of the fit before engines are compared


def find(
    model: Model,
    records: Sequence[Record],
    held_out: Sequence[Record] = (),
    params: GapParams | None = None,
    progress: Callable[[float, str, str], Any] | None = None,
    workers: int | str = 1,
    keep: Keep | None = None,
    memory: Memory | None = None,
) -> dict[str, Any]:
    """Compare a model with measurements and name the effects that it lacks.

    Args:
        model: Robot, overrides and effects.
        records: Records to fit.
        held_out: Held-out records; if there are none, the last third of each record is held out.
        params: Settings.
        progress: Called with the completed share, the stage and the best name so far.
        workers: Number of processes, or address of a dask scheduler; it does not influence the
            result.
        keep: Called with the contents of ``gap.json`` and the measured and predicted curves (None
            if the set-up is wrong), as soon as the verdict is known, before further parts are
            computed.
        memory: Results of jobs that a killed search completed; see `memory_of`.

    Returns:
        Contents of ``gap.json``.
    """
    params = params or GapParams()
    report = progress or (lambda fraction, stage, best: None)
    wrong = setups.find_mistakes(model, [*records, *held_out]) if params.setup else []
    if any(finding.stops for finding in wrong):
        result = setup_contents.contents(model, [*records, *held_out], wrong, params)
        if keep:
            keep(result, None)
        return result
    model = mend.model_mended(model, mend.changes_of(wrong)) or model
    records, held_out = mend.noted(records, wrong), mend.noted(held_out, wrong)
    fit, checks = stages.split(model, records), stages.split(model, held_out)

    def part(start: float) -> Report:
        return lambda share, stage, best: report(start + 0.5 * share, stage, best)

    if params.window or not all(fit):
        if not along_motion(model, [*records, *held_out], params):
            return search(model, records, held_out, params, report, workers, keep, memory)
        result = search(model, records, held_out, params, part(0.0), workers, keep, memory)
        if result["verdict"] != UNKNOWN:
            report(1.0, "done", " + ".join(result["names"]))
            return result
        inverse, explained = params.replace(inverse_dynamics=True), (NAMED, PARTLY, AMBIGUOUS)

        def explaining(torques: dict[str, Any], curves: Curves) -> None:
            if keep and torques["verdict"] in explained:
                keep(torques, curves)

        torques = search(model, records, held_out, inverse, part(0.5), workers, explaining, memory)
        return torques if torques["verdict"] in explained else result

    named = params.replace(residual=False)  # on the ground, only named effects are added
    aloft: list[Curves] = []

    def first(air: dict[str, Any], curves: Curves) -> None:
        aloft.append(curves)
        if keep:
            keep(air, curves)

    def second(ground: dict[str, Any], curves: Curves) -> None:
        if keep:
            keep(stages.merge(air, ground), merge(aloft[0], curves))

    air = search(model, fit[0], checks[0], named, part(0.0), workers, first, memory)
    ground = search(
        stages.after(model, air), fit[1], checks[1], params, part(0.5), workers, second, memory
    )
    return stages.merge(air, ground)


def search(
    model: Model,
    records: Sequence[Record],
    held_out: Sequence[Record],
    params: GapParams,
    report: Report,
    workers: int | str,
    keep: Keep | None,
    memory: Memory | None,
) -> dict[str, Any]:
    """Do what `find` does for records that are all in the air or all on the ground."""
    report(0.0, "reading the model", "")
    forward = forward_of(model, [*records, *held_out], params)
    params = params.replace(window=forward.params.window)
    count = len(records)
    records, held_out = forward.records[:count], forward.records[count:]
    robots = [forward.robot(i) for i in range(len(forward.records))]
    robot, fixed = robots[0], all(r.fixed_base for r in robots)
    nominal = nominals.values(robot, params.free)
    case = cases.prepare(forward, records, held_out, free_names=nominal)
    offers = hints.sized(offer(robot, case.signals, hints.find(case, robot)), forward)
    candidates = forward.shown(offers)
    hypotheses, inseparable = separable([h for h in candidates if allowed(h.effect, params)])
    omissions = omitted(robot, candidates, case.signals)
    not_tried = [one for one in omissions if allowed(one[0], params)] + inseparable

    def started() -> Jobs:
        place = pool.start(call, (case,), *pool.where(workers))
        return memory.keeping(place) if memory else place

    tasks = started()

    def compared(parts: Parts) -> bool:
        """Restart with floors that include the difference of engines with these effects.

        Returns:
            False if the floors hardly change, so that nothing was restarted.
        """
        nonlocal case, tasks
        other = cases.prepare(forward, records, held_out, specs_of(parts), nominal)
        if np.max(np.abs(np.log(other.floor / case.floor)), initial=0.0) < math.log(SAME_FLOOR):
            return False
        case = other
        tasks.close()
        tasks = started()
        return True

    progress, offset = 0.0, PRESELECTION if case.ground else 0.0

    def preselect(function: Callable, arguments: Sequence[tuple]) -> Iterator[Any]:
        for i, result in enumerate(each(tasks, function, arguments)):
            report(offset * i / len(arguments), "looking for what is likely", "")
            yield result

    def searching(fraction: float, stage: str, best: str) -> None:
        nonlocal progress
        progress = max(progress, fraction)  # progress does not decrease when the search restarts
        report(offset + (SEARCH - offset) * progress, stage, best)

    try:
        guess: tuple = ()
        if case.ground and has_gap(case.kept().whitened([])):
            hypotheses, excluded, first = likely_hypotheses(case, hypotheses, preselect)
            not_tried += excluded
            setting = Setting(params, nominal, nominal, ROBUST_SCALE, tuple(case.fitted))
            guess = rough_fit(case, first, setting)[1]
            compared(guess)
        led_along = not forward.fine_steps
        grouping = partial(batches, robot, forward.channels, fixed_base=fixed, inverse=led_along)

        def run_search() -> tuple[Search, Pool]:
            searcher = Search(case, hypotheses, params, tasks, searching, nominal, grouping)
            return searcher, searcher.singles()

        seeking, outcome = run_search()
        if guess and outcome.models and not same(outcome.best.parts, guess):
            if compared(outcome.best.parts):
                seeking, outcome = run_search()
        outcome = seeking.together(outcome)

        def weighing(share: float) -> None:
            at = SEARCH + (VERDICT - SEARCH) * share
            report(at, "weighing", " + ".join(outcome.best.names))

        weighing(0.0)
        judgement = judge(case, seeking, outcome, weighing)
        not_tried += seeking.failed(outcome.screened)
        result = contents(model, case, judgement, params, not_tried)
        if keep:
            keep(result, curves(case, judgement.given, judgement.after))
        for detail in details(model, case, judgement, params, partial(each, tasks)):
            report(VERDICT, detail.stage, " + ".join(result["names"]))
            result = add(result, detail)
    finally:
        tasks.close()
    report(1.0, "done", " + ".join(result["names"]))
    return result


def memory_of(
    path: Path,
    model: Model,
    records: Sequence[Record],
    held_out: Sequence[Record],
    params: GapParams,
) -> Memory:
    """File with the results of a search's jobs, for `find` with the same arguments.

    Args:
        path: File of the results until the search is done.
        model: Robot, overrides and effects.
        records: Records to fit.
        held_out: Held-out records.
        params: Settings.
    """
    robot = model.make_robot()
    inputs = (model, robot, tuple(records), tuple(held_out), params)
    return Memory(path, inputs, (Fitted, Hypothesis, Coordinate, Screened, Score))


def forward_of(model: Model, records: Sequence[Record], params: GapParams) -> Forward:
    """Forward model of records that are all in the air or all on the ground."""
    length = on_ground(model, records, params)
    settings = ForwardParams(window=params.window, ground=length)
    if params.inverse_dynamics:
        if length or not led.possible(Forward(model, records, settings)):
            raise ParameterError(
                "inverse_dynamics: every joint of a bolted robot must be measured, and commanded "
                "by torque"
            )
        return led.InverseDynamics(model, records, settings)
    return led.forward(horizon.quickest(model) if length else model, records, settings)


def along_motion(model: Model, records: Sequence[Record], params: GapParams) -> bool:
    """True if torques along the measured motion can be compared instead of the motion."""
    if params.window or params.inverse_dynamics or any(stages.free(model, r) for r in records):
        return False
    forward = forward_of(model, records, params)
    is_motion = forward.fine_steps and not forward.params.window
    return is_motion and led.possible(forward) and led.told(forward)


def same(parts: Parts, ref: Parts) -> bool:
    """True if both have the same effects at the same places."""
    return {h.key for h, _ in parts} == {h.key for h, _ in ref}


def each(tasks: Jobs, function: Callable, arguments: Sequence[tuple]) -> Iterator[Any]:
    """Results of calls with the case, in the order of the arguments."""
    return tasks.ordered([(function, entry) for entry in arguments])


def on_ground(model: Model, records: Sequence[Record], params: GapParams) -> float:
    """Length of pieces on the ground [s]; 0 if there are none or all records are in pieces."""
    free = [r for r in records if stages.free(model, r)]
    return horizon.length(horizon.quickest(model), free) if free and not params.window else 0.0


def allowed(effect: str, params: GapParams) -> bool:
    """True if the user permits an effect to be named."""
    return any(fnmatchcase(effect, pattern) for pattern in params.effects)
