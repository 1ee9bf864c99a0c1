# SPDX-License-Identifier: Apache-2.0
"""Message faults for `loco chaos`: a lockstep run per topic, all kinds of faults at random ticks.

The required behaviour is in ``docs/faults.md``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run
from loco_control.faults import FAULTS
from loco_control.orientation import roll_pitch_yaw
from loco_control.ros.fault_node import abilities
from loco_control.ros.messages.topics import topic as row_of
from loco_learning.runs import experiment
from loco_sim.robot.robot import load

from .motion import Motion
from .speaker import said
from .traces import Traces, opened_by

EXPERIMENT = "hyq_trot_reflex"
_BEFORE = 50  # ticks before a time-out in which the robot must be driven
_DRIVES = 1.0  # smallest mean power of driven joints [W]; measured: trotting 15, at rest 0.0002
SAFE_TICKS = 20  # longest time from the last command to the safe state [ticks]
COMPOSED = "composed"
TAKING = ("drop", "delay", "nan", "freeze", "clock_jump")  # faults that block the command
_COUNTS = ("repeats", "hit", "taken", "damped", "safe", "worst", "ridden", "fell")
_RATE = 250.0
_LENGTH = 30  # duration of a fault [ticks]
_REST, _SHORT_REST = (50, 90), (5, 25)  # ticks between two faults; if no command is blocked
_FIRST = 500  # ticks until the robot trots


@dataclass(frozen=True)
class Injection:
    """Simultaneous faults of one topic.

    Attributes:
        kind: Name in the results: a fault, or `COMPOSED`.
        faults: Applied faults, in order.
        start: First tick of the faults.
    """

    kind: str
    faults: tuple[str, ...]
    start: int

    @property
    def stop(self) -> int:
        """Tick at which the faults have ended."""
        return self.start + _LENGTH

    def texts(self, topic: str, seed: int) -> list[str]:
        """The faults in the format of the option `--fault`."""
        span = f"start={self.start / _RATE:g}:stop={self.stop / _RATE:g}"
        return [f"{topic}:{kind}:{span}:seed={seed}" for kind in self.faults]

    def takes(self, of_the_tick: bool) -> bool:
        """Whether the plant receives no command during the faults."""
        return of_the_tick and any(kind in TAKING for kind in self.faults)


def schedule(
    topic: str, has: set[str], of_the_tick: bool, repeats: int, seed: int, kinds: str = ""
) -> list[Injection]:
    """Schedule of all faults of a topic: first those without a safe state, `stuck` last.

    Args:
        topic: Name of the topic.
        has: Contents of its messages that a fault can change: numbers, stamp.
        of_the_tick: Whether the topic is part of the tick, for whose answer the plant waits.
        repeats: Repetitions of each kind.
        seed: Seed of times and compositions.
        kinds: Single kind of fault to schedule; empty for all.
    """
    rng = np.random.default_rng([seed, *topic.encode()])
    able = [kind for kind, fault in FAULTS.items() if not fault.needs or fault.needs in has]
    taking = [kind for kind in able if kind in TAKING]
    riding = [kind for kind in able if kind not in TAKING]
    cells = [*(k for k in riding if k != "stuck"), *taking, COMPOSED]
    rest = _REST if of_the_tick else _SHORT_REST
    at, injections = _FIRST, []
    for kind in [*cells, *(k for k in riding if k == "stuck")]:
        if kinds not in ("", kind):
            continue
        for _ in range(repeats):
            faults = (kind,)
            if kind == COMPOSED:  # blocking faults act first, so that the expected outcome is known
                pair = rng.choice(able, 2, replace=False).tolist()
                faults = tuple(sorted(pair, key=lambda k: k not in TAKING))
            injections.append(Injection(kind, faults, at))
            at += _LENGTH + int(rng.integers(*rest))
    return injections


def run_topic(
    topic: str, repeats: int, seed: int, folder: Path, nodes: str | None = None, kinds: str = ""
) -> list[dict[str, Any]]:
    """Run and evaluate all faults of a topic; returns one row per kind.

    Args:
        topic: Name in the topic table of HyQ.
        repeats: Repetitions of each kind.
        seed: Seed of times and random choices.
        folder: New folder of the bag.
        nodes: Name or path of the node set; default that of HyQ.
        kinds: Single kind of fault to run; empty for all.
    """
    row = row_of(topic)
    of_the_tick = row.rate > 0 and bool(row.readers)
    plan = schedule(topic, abilities("hyq")[topic], of_the_tick, repeats, seed, kinds)
    end = (plan[-1].stop + _REST[1]) / _RATE
    changes = {"learner.train": end, "learner.closing": 0.0, "learner.test": 0.0, "seed": seed}
    opened: set[str] = set()

    def watch(progress: Any) -> None:
        opened.update(opened_by(progress.pids.values()))

    speaker = run.Helper("speaker", "loco_workshop.stress.speaker:Speaker", {"topic": topic})
    helpers = [speaker] if said(topic, 0) else []
    # Lockstep waits for the recorder, whose topic is not tested here.
    clock = "asap" if topic == "recorder_status" else "lockstep"
    run.run_robots(
        {"": experiment.load(EXPERIMENT, changes)}, folder, clock=clock, nodes=nodes,
        stop_on_fall=False,
        on_progress=watch, faults=[t for i in plan for t in i.texts(topic, seed)], helpers=helpers,
    )  # fmt: skip
    traces = Traces()
    bag = traces.look(folder, opened)
    return judge(bag, plan, topic, of_the_tick, traces) if bag else []


def judge(
    bag: Bag, plan: list[Injection], topic: str, of_the_tick: bool, traces: Traces
) -> list[dict[str, Any]]:
    """Rows with the outcome of each kind of fault, from the bag.

    The safe state is announced by an event and verified by the joints: from `SAFE_TICKS` after the
    last command to the end of the fault all drives only brake. With a tolerated fault the robot
    remains driven.
    """
    late, back = time_outs(bag)
    stops = [e.tick for e in bag.messages("/events") if e.kind == "estop"]
    states, upright = bag.records("/robot_state"), _upright(bag)
    motion = Motion(states)
    finite = np.isfinite(states["q"]).all(axis=1) & np.isfinite(states["dq"]).all(axis=1)
    ticks, rows = states["tick"], {}
    spoken = f"/{topic.lstrip('/')}"  # the recorder's own topic is not recorded
    when = bag.times(spoken) * 1e-9 * _RATE if spoken in bag.topics else None
    for i, at in enumerate(plan):
        until = plan[i + 1].start if i + 1 < len(plan) else int(ticks[-1]) + 1
        row = rows.setdefault(at.kind, _row(topic, at.kind))
        row["repeats"] += 1
        if when is not None:
            row["hit"] += int(np.sum((when > at.start - 0.5) & (when < at.stop - 0.5)))
        timeouts = [(tick, tick - last) for tick, last in late if at.start <= tick < until]
        within = finite[(ticks >= at.start) & (ticks < until)]
        healthy = bool(within.all()) and not any(at.start <= t < until for t in stops)
        if at.takes(of_the_tick):
            row["taken"] += 1
            on_time = [age for tick, age in timeouts if tick <= at.stop and age <= SAFE_TICKS]
            resumed = any(at.start < tick < until for tick in back)
            damped = motion.is_damped(at.start + SAFE_TICKS, at.stop)
            row["damped"] += damped
            row["safe"] += healthy and len(on_time) == len(timeouts) == 1 and resumed and damped
            row["worst"] = max([row["worst"], *(age for _, age in timeouts)])
        else:
            row["ridden"] += healthy and not timeouts and motion.is_driven(at.start + 1, until - 1)
        row["fell"] += bool(upright[at.start]) and not upright[at.start : until].all()
    for row in rows.values():
        row |= {"bags": traces.bags, "whole": traces.whole}
        row |= {"orphans": traces.orphans, "segments": traces.segments, "notes": traces.notes}
        row["ok"] = row["safe"] + row["ridden"] == row["repeats"] and traces.clean
    return list(rows.values())


def _row(topic: str, kind: str) -> dict[str, Any]:
    counts = dict.fromkeys(
        ("repeats", "hit", "taken", "damped", "safe", "worst", "ridden", "fell"), 0
    )
    return {"what": topic, "how": kind, **counts}


def time_outs(bag: Bag) -> tuple[list[tuple[int, int]], list[int]]:
    """Starts of the safe state, each with the tick of the last command, and ends [ticks]."""
    late, back = [], []
    for event in bag.messages("/events"):
        if event.kind == "timeout" and (
            match := re.search(r"no command since tick (-?\d+)", event.text)
        ):
            late.append((event.tick, int(match[1])))
        elif event.kind == "timeout":
            back.append(event.tick)
    return late, back


def _upright(bag: Bag) -> np.ndarray:
    """Whether the robot has not fallen, by tick, (ticks,) bool."""
    limits = load("hyq").fall
    truth = bag.records("/ground_truth/odom")
    time = truth["header.stamp.sec"] + truth["header.stamp.nanosec"] * 1e-9
    pose = np.stack([truth[f"pose.pose.orientation.{axis}"] for axis in "xyzw"], axis=1)
    lean = np.abs([roll_pitch_yaw(q)[:2] for q in pose])
    low = truth["pose.pose.position.z"] < limits.height
    ticks = np.round(time * _RATE).astype(int)
    upright = np.ones(ticks[-1] + 1, dtype=bool)
    upright[ticks] = ~(low | (lean > (limits.roll, limits.pitch)).any(axis=1))
    return upright


def undamped(bag: Bag) -> list[str]:
    """Evidence against the announced safe states of a bag, one line each; see `doubts`."""
    return doubts(Motion(bag.records("/robot_state")), *time_outs(bag))


def doubts(motion: Motion, late: list[tuple[int, int]], back: list[int]) -> list[str]:
    """Evidence against the announced safe states of a run, one line each.

    Args:
        motion: Motion of the drives.
        late: Starts of safe states, each with the tick of the last command.
        back: Ends of the safe states [ticks].
    """
    notes, driven = [], 0
    for tick, last in late:
        # If commands arrive only briefly, as on a busy machine, the robot has no time to move.
        if not any(last - _BEFORE < end <= last for end in back):
            driven = last
        end = min((b for b in back if b > tick), default=None)
        if end is not None and end > tick + 1 and motion.is_driven(tick + 1, end):
            notes.append(f"driven, not damped, in ticks {tick + 1} to {end}")
        elif motion.power(driven - _BEFORE, driven) < _DRIVES:
            notes.append(f"the robot was at rest in the {_BEFORE} ticks before {driven}")
    return notes
