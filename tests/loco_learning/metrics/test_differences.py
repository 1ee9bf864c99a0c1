# SPDX-License-Identifier: Apache-2.0
"""Pushed robots are seen, repeats differ in nothing, and noise of blocks passes for nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from loco_learning.metrics import differences as d
from loco_learning.metrics.registry import METRICS
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout

BUMPS = {"name": "push", "random": 0.5, "point": [0.0, 0.0, -0.2]}  # a bench that is touched
RUNS = {  # experiment, its settings, what differs between repeats, time of a push [s] and how
    "arm": ("servo_pendulum_sine", {"duration": 12.0}, [BUMPS], 6.2,
            {"point": [0.0, 0.0, -0.2], "force": (1.0, 0.0, 0.0)}),
    "tigrillo": ("tigrillo_bound", {"duration": 10.0}, [], 6.05, {"force": (0.0, 1.0, 0.0)}),
    "hyq": ("hyq_trot_open", {"duration": 9.0}, [], 6.5, {"force": (0.0, 1.0, 0.0)}),
}  # fmt: skip
SEEN = {"arm": "tracking_error", "tigrillo": "lateral_drift", "hyq": "lateral_drift"}


def run(robot, seed=0, force=0.0):
    """A repeat of a robot's run, perhaps pushed with a force [N]."""
    name, settings, effects, stop, push = RUNS[robot]
    pushes = [{"name": "push", "start": 6.0, "stop": stop, **push,
               "force": [force * x for x in push["force"]]}] if force else []  # fmt: skip
    return rollout(load(name, {**settings, "effects": [*effects, *pushes]}), seed)


@pytest.fixture(scope="module")
def first():
    logs = {}

    def of(robot):
        if robot not in logs:
            logs[robot] = run(robot)
        return logs[robot]

    return of


def differing(first, other):
    return {row.metric: row for row in d.differences(first, other, "open loop") if row.kind}


@pytest.mark.parametrize("robot", RUNS)
def test_pushes_are_seen_and_what_they_change_is_named(robot, first):
    for number, force in enumerate((15.0, 25.0, 40.0)):
        other = run(robot, 20 + number, force)
        found = differing(first(robot), other)
        if other.fall:  # 40 N throw a robot of a kilogram over: the page says so
            assert robot == "tigrillo" and force == 40.0
            continue
        row = found[SEEN[robot]]
        block = d.window(first(robot), other, "open loop").length * other.dt
        start = other.phases()["open loop"].start * other.dt
        assert row.kind == d.PASSING
        assert start + row.at - 1e-9 <= 6.5 and start + row.at + block > 6.0  # when it was pushed
        assert abs(row.largest) > row.size


@pytest.mark.parametrize(("robot", "repeats"), [("arm", 10), ("tigrillo", 10), ("hyq", 2)])
def test_repeats_of_one_run_differ_in_nothing(robot, repeats, first):
    """Seeds differ, and with them noise and what touches the arm; HyQ draws nothing here."""
    for seed in range(1, repeats + 1):
        assert differing(first(robot), run(robot, seed)) == {}


def test_every_metric_has_a_change_that_matters():
    for metric in METRICS.values():
        assert metric.min_change > 0.0 and metric.share > 0.0, metric.name
    assert METRICS["speed"].notable(0.01) == 0.005 and METRICS["speed"].notable(1.0) == 0.05
    assert math.isinf(METRICS["step_time"].notable(1.0))  # that of the machine


def noise(rng, count):
    return rng.standard_normal(count)


@pytest.mark.parametrize("count", [6, 10, 40])
def test_noise_stays_within_its_chance(count):
    """Of many tables of pure noise no more than the chance call anything a difference."""
    rng, chance, trials = np.random.default_rng(1), 0.05, 400
    passing = lasting = 0
    for _ in range(trials):
        pairs = noise(rng, count)
        passing += bool(np.max(np.abs(pairs)) > d.outstanding(pairs, chance))
        low, high = d.interval((pairs,), chance)
        lasting += low * high > 0.0
    assert lasting <= 1.6 * chance * trials
    assert passing <= 1.6 * chance * trials


def test_runs_without_the_same_target_are_not_paired(first):
    one = first("arm")
    later = one.changed(target=np.roll(one.target, 7, axis=0))
    assert d.window(one, one, "open loop").paired
    assert not d.window(one, later, "open loop").paired
    assert differing(one, later) == {}
    twice = later.changed(tau=2.0 * later.tau)
    assert differing(one, twice)["torque_max"].kind == d.LASTING


def test_what_is_beyond_noise_and_does_not_matter_is_no_difference(first):
    one = first("arm")
    assert differing(one, one.changed(tau=1.01 * one.tau)) == {}
    rows = {r.metric: r for r in d.differences(one, one.changed(tau=1.01 * one.tau), "open loop")}
    assert rows["torque_max"].low > 0.0  # beyond noise
    assert differing(one, one.changed(tau=1.2 * one.tau))["torque_max"].kind == d.LASTING
