# SPDX-License-Identifier: Apache-2.0
"""Preview of what recordings can show about a model, in 15 s and without a search.

`inspect` reports properties of the recordings, the smallest visible size of each effect, missing
signals, and the expected duration of a search.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from loco_control.params import Params, parameter
from loco_sim.bolted.loop import needs_engine
from loco_sim.effects.places import chains
from loco_sim.engines import installed
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from ...jobs import pool
from ...plain import plain
from ..fitting.params import GapParams
from ..fitting.search import call
from ..hypotheses import hints
from ..hypotheses.bundles import batches
from ..hypotheses.hypotheses import offer, omitted, separable
from ..prediction import case as cases
from ..prediction import floors, running
from ..prediction.channels import ON_SLIDES
from ..prediction.forward import Forward, ForwardParams
from ..recordings import lags
from ..recordings.record import Record
from ..setup import family, mend
from ..setup.bench import busiest
from ..setup.finding import Finding
from ..statistics.leftover import LIMITS
from . import visible
from .visible import Visible

FORMAT = 1
STEPS = 20.0  # smallest travel of an informative joint [encoder steps]
TURN = 0.01  # [rad or m] smallest travel of an informative joint
LIMBER = 1.0  # largest kd dt / I of damping in a preview: above, its response overshoots


@dataclass(frozen=True)
class Effort(Params):
    """Work of a preview, whatever the length, number and sub-steps of the recordings."""

    compiled: float = parameter(
        1.4e7, "joints times steps, of physics and of the recording, of all simulations: 7 s on "
        "one core of a server, at 0.5 µs each (UR5e, TX40)", low=1e4
    )  # fmt: skip
    engine: float = parameter(4.8e5, "steps of all simulations with a physics engine", low=1e3)
    runs: float = parameter(
        3.2, "simulations for each effect, and its share of those that find the floors (UR5e)",
        low=1.0,
    )  # fmt: skip
    each_min: float = parameter(
        0.5, "of an excerpt, the first 0.2 s of which are not weighed", "s", low=0.3
    )
    total_min: float = parameter(
        2.0, "all excerpts together without an engine: of a UR5e that swings at 0.5 Hz 0.7 s "
        "change 20 of 226 verdicts and treble the effects that look alike, 2.8 s change one", "s",
        low=0.5,
    )  # fmt: skip
    total_max: float = parameter(20.0, "all excerpts together (taste)", "s", low=1.0)


EFFORT = Effort()


@dataclass(frozen=True)
class SearchTime(Params):
    """Processor time of a search over that of the preview, each per second of recording.

    From searches of a bolted Tigrillo, a leg of HyQ and the DFKI pendulum, one worker: 188, 114 and
    45 s (the last adds effects twice).
    """

    screening: float = parameter(10.0, "of all effects, over trying all effects", low=0.1)
    simulation: float = parameter(
        0.47, "of a simulation in a fit, over trying one effect: 1.5 for the verdict, and a try is "
        "3.2 simulations", low=0.01
    )  # fmt: skip


SEARCH = SearchTime()


def inspect(
    model: Model,
    records: Sequence[Record],
    params: GapParams | None = None,
    progress: Callable[[float, str], Any] | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Compute the preview of recordings and a model.

    Args:
        model: Robot, overrides and effects.
        records: All recordings, including held-out ones.
        params: Settings of a later search.
        progress: Called with the completed share and the stage.
        workers: Number of processes for simulations with an engine; without one, a second process
            costs more to start than it saves. It also influences the expected duration of a search.

    Returns:
        Contents of ``check.json``.

    Raises:
        LocoError: The model cannot be simulated along the recordings.
    """
    params = params or GapParams()
    report = progress or (lambda share, stage: None)
    report(0.0, "looking at the set-up")
    findings = family.find_mistakes(model, records)
    robots = [model.make_robot(r.overrides) for r in records]
    if any(finding.stops for finding in findings):
        return _contents(model, records, robots, findings)
    model = mend.model_mended(model, mend.changes_of(findings)) or model
    report(0.1, "running the model as it is")
    robots = [model.make_robot(r.overrides) for r in records]
    how = ForwardParams(window=params.window)
    limit = {"sim.damping_limit": max(LIMBER, robots[0].sim.damping_limit)}
    limited = replace(model, overrides={**model.overrides, **limit})
    parts = excerpts(records, _seconds(Forward(limited, records[:1], how)))
    case = cases.fit_all_rows(Forward(limited, parts, how), parts)
    robot = case.forward.robot()
    offers = hints.sized(offer(robot, case.signals, hints.find(case, robot)), case.forward)
    single = [h for h in offers if "*" not in h.place]  # effects on groups show in their joints
    hypotheses, rest = separable(single)
    fixed = all(robot.fixed_base for robot in robots)
    groups = batches(robot, case.forward.channels, hypotheses, fixed)

    def report_share(share: float) -> None:
        report(0.2 + 0.7 * share, "trying every effect")

    report_share(0.0)
    count = 0 if workers < 2 or floors.compiled(case.forward) else workers
    with pool.start(call, (case,), count) as tasks:
        results, seconds = visible.visible_sizes(
            case, groups, math.sqrt(LIMITS.explained**2 - 1.0), tasks, report_share
        )
    each = seconds / len(groups) / sum(r.duration for r in parts) if groups else 0.0
    times = _search(case.forward, records, len(groups), each, params)
    return _contents(
        model, records, robots, findings,
        channels=[
            {"signal": c.signal, "name": c.name, "unit": c.unit, "floor": floor}
            for c, floor in zip(case.forward.channels, case.floor, strict=True)
        ],
        effects=[_row(one, robot) for one in results],
        not_tried=[{"effect": name, "reason": note}
                   for name, note in omitted(robot, offers, case.signals) + rest],
        notes=[*untested(robots), *_scope_notes(records, parts), *engine_notes(robot)],
        search_seconds=[float(f"{s / max(1, workers):.2g}") for s in times],
    )  # fmt: skip


def _contents(
    model: Model, records: Sequence[Record], robots: Sequence[Robot], findings: Sequence[Finding],
    **results: list,
) -> dict[str, Any]:  # fmt: skip
    """Contents of ``check.json``; no effect is tested if the set-up must be corrected first."""
    empty = {name: [] for name in ("channels", "effects", "not_tried", "notes", "search_seconds")}
    about = [recording(r, robot) for r, robot in zip(records, robots, strict=True)]
    return plain(
        {
            "format": FORMAT,
            "robot": model.robot,
            "setup": [finding.plain() for finding in findings],
            "recordings": about,
            "missing": missing(records, robots),
            **empty,
            **results,
        }
    )


def recording(record: Record, robot: Robot) -> dict[str, Any]:
    """Properties of a recording: signals, time stamps, travel of joints, delay after commands."""
    q = record.signals["q"]
    command = record.command.get("position")
    late = {}
    for i, joint in enumerate(record.driven if command is not None else ()):
        if joint in record.joints:
            commanded = lags.rates(command[:, i], record.dt)
            motion = lags.rates(q[:, record.joints.index(joint)], record.dt)
            by, correlation = lags.lag(commanded, motion, record.dt)
            if correlation > lags.LAG_IS_TOLD:
                late[joint] = 1e3 * by
    return {
        "name": record.name,
        "role": record.role,
        "held": "bolted" if robot.fixed_base else "free",
        "seconds": record.duration,
        "rate": 1.0 / record.dt,
        "commands": list(record.command),
        "signals": sorted(name for name in record.signals if record.has(name)),
        "stamps": dict(record.stamps),
        "travel": dict(zip(record.joints, _travel(q), strict=True)),
        "lag_ms": late,
        "notes": list(record.notes),
        "warnings": list(record.warnings),
    }


def missing(records: Sequence[Record], robots: Sequence[Robot]) -> list[str]:
    """Deficiencies of the recordings for a search, a sentence each, the most important first."""
    notes, robot = [], robots[0]
    driven = {robot.joints[i] for i in robot.driven}
    measured = {joint for r in records for joint in r.joints}
    lost = [joint for joint in robot.joints if joint not in measured]
    if lost:
        notes.append(f"{_list(lost)}: position not measured; what happens there is told by the "
                     "other joints alone")  # fmt: skip
    unmoved = [joint for joint in robot.joints if joint in measured and not _moves(joint, records)]
    if unmoved:
        what = "no experiment moves it" if len(unmoved) == 1 else "no experiment moves them"
        drive = " (a spring alone holds it)" if not driven & set(unmoved) else ""
        notes.append(f"{_list(unmoved)}{drive}: {what} far enough to tell anything; `loco gap "
                     "experiments` writes some that do")  # fmt: skip
    signals = {name for r in records for name in r.signals if r.has(name)}
    if "tau" not in signals:
        notes.append("no joint torques: errors of torque and of mass differ only in the shape of "
                     "the motion")  # fmt: skip
    if not all(r.fixed_base for r in robots):
        if "gyro" not in signals and "base_orientation" not in signals:
            notes.append("no IMU on a robot that is free: how its trunk moves is not known")
        if not any(r.fixed_base for r in robots):
            notes.append("no recording in the air: with one, effects in the joints are separated "
                         "more surely from those at the feet")  # fmt: skip
    if len(records) == 1:
        notes.append("one recording: its last third is held out; a second recording of another "
                     "motion is a better test")  # fmt: skip
    return notes


def _moves(joint: str, records: Sequence[Record]) -> bool:
    """True if a joint moves by more than rounding in any record that measures it."""
    return any(
        not _travel(r.signals["q"])[r.joints.index(joint)]
        < max(STEPS * r.resolution.get(("q", joint), 0.0), TURN)  # NaN is not known to rest
        for r in records
        if joint in r.joints
    )


def _seconds(forward: Forward) -> float:
    """Duration of all excerpts together, so that all simulations stay near `EFFORT` [s].

    Branches of a fixed-base robot are simulated together, so that the number of bundles grows with
    the longest branch.
    """
    robot, dt = forward.robot(), running.period(forward.records[0])
    work, effects, floor = EFFORT.engine, 20.0 * len(robot.joints), EFFORT.each_min
    if floors.compiled(forward):
        floor = EFFORT.total_min
        effects = 35.0 * max((len(chain) for chain in chains(robot)), default=1)
        work = EFFORT.compiled / len(robot.joints)
    rate = 1.0 / running.step(robot, dt) + 1.0 / dt
    return min(max(work / (effects * EFFORT.runs * rate), floor), EFFORT.total_max)


def excerpts(records: Sequence[Record], seconds: float) -> list[Record]:
    """The part of each recording with the most motion (`busiest`), within a total duration.

    Of recordings too many for that, some are chosen, evenly spread.
    """
    count = min(max(int(seconds / EFFORT.each_min), 1), len(records))
    selected = np.linspace(0.0, len(records) - 1.0, count).round().astype(int)
    each = max(seconds / count, EFFORT.each_min)
    return [busiest(records[i], each) for i in selected]


def untested(robots: Sequence[Robot]) -> list[str]:
    """A sentence on tests of the set-up that bolted robots did not have; none if they had all."""
    reasons = [needs_engine(robot) for robot in robots if robot.fixed_base]
    if len(reasons) < len(robots) or not all(reasons):
        return []
    return [f"axes, weight, masses and gains of the set-up were not tested: {reasons[0]}"]


def engine_notes(robot: Robot) -> list[str]:
    """A sentence on the faster engine for a robot that needs one; none if that is used."""
    slow = robot.sim.engine == "pybullet" and "mujoco" in installed() and needs_engine(robot)
    text = "PyBullet's steps go through Python: with --engine mujoco a search is much faster"
    return [text] if slow else []


def _scope_notes(records: Sequence[Record], parts: Sequence[Record]) -> list[str]:
    """A sentence on the excerpts on which effects were tried; none if they are everything."""
    part, total = (sum(r.duration for r in each) for each in (parts, records))
    if part > 0.99 * total:
        return []
    return [f"effects were tried on excerpts, the parts that move most: {part:.3g} s of "
            f"{total:.3g} s, from {len(parts)} of {len(records)} recordings"]  # fmt: skip


def _row(one: Visible, robot: Robot) -> dict[str, Any]:
    """A strength as a dictionary for JSON, in the unit of its joint."""
    text = Description(robot.urdf)
    sliding = text.joint_types().get(one.place) == "prismatic"
    return asdict(replace(one, unit=ON_SLIDES.get(one.unit, one.unit) if sliding else one.unit))


def _travel(q: np.ndarray) -> np.ndarray:
    """Range of the values of each column; NaN if it has no value."""
    valid = np.isfinite(q)
    low, high = np.where(valid, q, np.inf).min(axis=0), np.where(valid, q, -np.inf).max(axis=0)
    return np.where(valid.any(axis=0), high - low, np.nan)


def _search(
    forward: Forward, records: Sequence[Record], count: int, each: float, params: GapParams
) -> list[float]:
    """Processor time of a search that finds one effect, and of the longest search [s].

    Trying each of `count` bundles took `each` seconds per second of recording. The estimate counts
    simulations of rough and complete fits.
    """
    total, fine = sum(r.duration for r in records), 1.0 / floors.finest(forward)
    part = min(total, max(params.screen_seconds, max(r.duration for r in records)))
    coarse = 2 * params.keep * (params.rough + 4) * part
    fits = params.finalists * (params.evaluations + 10) * total
    screening = count * SEARCH.screening * part
    level = each * (screening + SEARCH.simulation * fine * (coarse + fits))
    return [level, params.most_terms * level]


def _list(names: Sequence[str], max_names: int = 6) -> str:
    suffix = f" and {len(names) - max_names} more" if len(names) > max_names else ""
    return ", ".join(names[:max_names]) + suffix
