# SPDX-License-Identifier: Apache-2.0
"""Find the gap between a model and measurements, name its cause, and prove it.

`find` takes a model and records and returns the contents of ``gap.json``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from functools import partial
from typing import Any

from loco_sim.model import Model

from . import case as cases
from . import hints, lattice
from . import nominal as nominals
from .bundles import bundles
from .following import following
from .forward import Forward, ForwardParams
from .hypotheses import offer, separable
from .judge import judge
from .parallel import Tasks
from .params import GapParams
from .record import Record
from .search import Search
from .tell import contents, in_metres

SEARCH = 0.9  # share of the time that the search takes


def find(
    model: Model,
    records: Sequence[Record],
    held_out: Sequence[Record] = (),
    params: GapParams | None = None,
    progress: Callable[[float, str, str], Any] | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Compare a model with measurements and name what it lacks.

    Args:
        model: Robot, overrides and effects.
        records: To fit.
        held_out: To judge on; without any, the last third of each record judges.
        params: Settings.
        progress: Called with the share done, the stage and the best name so far.
        workers: Processes; the result is the same for any number.

    Returns:
        Contents of ``gap.json``.
    """
    params = params or GapParams()
    report = progress or (lambda fraction, stage, best: None)
    report(0.0, "reading the model", "")
    forward = Forward(model, [*records, *held_out], ForwardParams(window=params.window))
    robots = [forward.robot(i) for i in range(len(forward.records))]
    robot, fixed = robots[0], all(r.fixed_base for r in robots)
    nominal = nominals.values(robot, params.free)
    case = cases.prepare(forward, records, held_out)
    hypotheses = offer(robot, case.signals, hints.find(case, robot))
    wanted = params.effects
    hypotheses = separable([h for h in hypotheses if any(fnmatchcase(h.effect, w) for w in wanted)])
    tasks = Tasks(case, workers)

    def searching(fraction: float, stage: str, best: str) -> None:
        report(SEARCH * fraction, stage, best)

    try:
        bundled = partial(bundles, robot, forward.channels, fixed_base=fixed)
        search = Search(case, hypotheses, params, tasks, searching, nominal, bundled)
        found = search.run()
        report(SEARCH, "weighing", " + ".join(found.best.names))
        judged = judge(case, search, found)
        result = contents(model, case, judged, params)
        result = lattice.tell(result, case.records, robot, params.effects)
        result["terms"] = in_metres(result["terms"], forward.channels)
        report(0.95, "looking for the next experiment", " + ".join(result["names"]))
        result["next"] = following(model, case, judged)
    finally:
        tasks.close()
    report(1.0, "done", " + ".join(result["names"]))
    return result
