# SPDX-License-Identifier: Apache-2.0
"""Sequence of the set-up tests: each runs with the corrections that earlier ones found."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from loco_sim.plant.model import Model
from loco_sim.robot.description import Description

from ..recordings.lags import rates
from ..recordings.record import Record
from . import bodies, commands, mend, parts, signals, suspect, torques
from .bench import Bench
from .finding import Change, Finding
from .limits import LIMITS

TESTS = (
    bodies.inertias, bodies.drafted, signals.turns, signals.relative, commands.exchanged,
    torques.renamed, commands.sign, commands.scale, bodies.drafted, signals.ahead, torques.inclined,
    torques.commanded,
)  # fmt: skip
OF_TORQUES = (
    torques.exchanged, torques.zeros, torques.reversed_torques, torques.effort, torques.inclined,
)  # fmt: skip
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
OF_RANGE = ("unit", "turns")  # faults that a range of angles may tell by mistake
OF_MOTION = {"q", "dq", "command_position", "command_velocity"}
RUNS = (bodies.axis, bodies.joint_scale, bodies.gravity, bodies.weights, bodies.gains)


def find_mistakes(model: Model, records: Sequence[Record]) -> list[Finding]:
    """Mistakes of a set-up, in the order in which they should be corrected.

    Args:
        model: Robot, overrides and effects.
        records: Recordings.
    """
    changes = [list(parts.changed(model, record)) for record in records]
    local = list(itertools.chain(*changes))
    records = [record for record, changed in zip(records, changes, strict=True) if not changed]
    faults = of_signals(model, records)
    large = [f for f in faults if f.fault == "effort" and not f.mends]  # told last
    faults = [f for f in faults if f not in large]
    if len(records) > 1 and all(finding.mends for finding in faults):
        single, records = parts.isolate(model, records, mend.changes_of(faults))
        local += single
    bench = Bench(model, records, mend.changes_of(faults))
    if not bench.possible or not all(finding.mends for finding in faults):
        return local + faults + large  # no simulation is possible, or it would be of a wrong set-up
    rounds = 0 if bench.free else LIMITS.rounds
    for test in (*TESTS, *(best,) * rounds, *OF_TORQUES):
        new = test(bench) if all(finding.mends for finding in faults) else []
        bench = bench.mended(change for finding in new for change in finding.mends)
        for finding in new:
            faults = mend.merge(faults, finding)
    units = {f.joints for f in faults if f.fault == "effort"}
    return local + faults + [f for f in large if f.joints not in units]


def _refuted(finding: Finding, bench_of: Callable[[], Bench], record: Record) -> bool:
    """True for degrees, turns or an unknown unit, told by a range, that a simulation contradicts.

    The model does not fit better with its lines, and another scale explains the motion, or a motion
    without measured velocity is within the velocity limits of the URDF.
    """
    roles, joints = {change.role for change in finding.mends}, finding.joints
    if finding.fault not in OF_RANGE or roles - OF_MOTION or roles == {"dq"}:
        return False
    bench = bench_of()
    if bench.free or not bench.possible:
        return False
    trial = bench(*finding.mends)
    error = trial.miss(joints) if trial else np.inf
    if error <= min(bench().miss(joints) / LIMITS.better, LIMITS.left):
        return False
    scaled = commands.scale(bench)
    if record.has("dq") or not roles:
        return any(set(joints) & set(other.joints) for other in scaled)
    text = Description(bench.robot.urdf)
    is_slow = all(
        np.nanpercentile(np.abs(rates(q, record.dt)), 99.0) <= (text.velocity(j) or LIMITS.fastest)
        for j, q in zip(record.joints, record.signals["q"].T, strict=True)
    )
    return is_slow or bool(scaled or bodies.joint_scale(bench))


def best(bench: Bench) -> list[Finding]:
    """The mistake of the robot or of a whole joint that explains most; none if the model fits.

    Mistakes that explain as much are listed as alternatives: the recordings cannot distinguish
    them.
    """
    new = [] if bench.fits else [finding for test in RUNS for finding in test(bench)]
    rows = sorted(((bench.miss(*finding.mends), k) for k, finding in enumerate(new)))
    if not rows or any(
        least(bench) < LIMITS.alike * rows[0][0] for least in (bodies.misread, bodies.saturated)
    ):
        return []  # a sensor whose zero or gain is off, or a motor that saturates: to the search
    lowest, first = rows[0][0], new[rows[0][1]]
    ties = [new[k] for miss, k in rows[1:] if miss < LIMITS.alike * lowest + 1e-3]
    options = [fix for finding in ties for fix in (finding.mends, *finding.others)]
    return [replace(first, others=tuple(dict.fromkeys((*first.others, *options))))]


def _consistent(findings: Sequence[Finding]) -> bool:
    """Whether the numbers in the lines of findings are those of one cause."""
    for changes in zip(*(finding.mends for finding in findings), strict=True):
        if isinstance(changes[0].value, float):
            low, *_, high = sorted(abs(change.value) for change in (*changes, changes[0]))
            if high > np.exp(suspect.RATIO_NEAR) * low:
                return False
    return True


def of_signals(model: Model, records: Sequence[Record]) -> list[Finding]:
    """Mistakes that follow from comparing signals, each once for all records.

    Lines of a mapping apply to all records: if only some have the mistake, no correction is given.
    """
    by_key: dict[object, dict[str, Finding]] = {}
    for record in records:
        robot = model.make_robot(record.overrides)
        bench_of = cache(partial(Bench, model, [record]))  # simulated once, and only if needed
        of_units = () if record.trusted else suspect.findings(record, robot)
        signal_findings = (signals.wraps(record, robot), signals.base(record, robot))
        for finding in itertools.chain(*signal_findings, of_units):
            if _refuted(finding, bench_of, record):
                continue
            # Numbers are estimated in each record, as are periods of a wrap.
            lines_of = tuple(replace(c, value=0.0) if isinstance(c.value, float) else c
                             for c in finding.mends)  # fmt: skip
            wraps, text = finding.fault == "wrap", NUMBER.sub("", finding.says)
            key = finding.joints, "wrap" if wraps else lines_of or text
            by_key.setdefault(key, {})[record.name] = finding
    findings, lines = [], set[Change]()
    for rows in by_key.values():
        names, finding = list(rows), next(iter(rows.values()))
        note = f"{', '.join(names)}: {finding.says}"
        consistent = len(names) == len(records) and _consistent(list(rows.values()))
        if not consistent and finding.fault != "wrap":  # which is harmless for others
            findings.append(replace(finding, says=note, mends=()))
            continue
        new = tuple(c for c in finding.mends if c not in lines)  # two signals may tell the same
        lines.update(new)
        findings += [replace(finding, mends=new)] if new or not finding.mends else []
    return findings
