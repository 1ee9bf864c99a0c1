# SPDX-License-Identifier: Apache-2.0
"""Cases of robots that trot: drawn from one seed, recorded as a robot records them."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_sim.robot import robot as robots
from loco_workshop.battery import bags, battery, cases, trial
from loco_workshop.battery.ground import hidden, trots, walkers

BOTH = tuple(walkers.WALKERS)


def test_cases_come_from_one_seed_and_hide_what_they_should():
    planned = cases.plan(20, 3, BOTH)
    filled = [cases.fill(case) for case in planned]
    assert filled == [cases.fill(case) for case in cases.plan(20, 3, BOTH)]
    count = {"null": 0, "pair": 2}
    for case in filled:
        assert len(case.effects) == count.get(case.kind, 1)
        families = [hidden.family(e.effect) for e in case.effects]
        assert len(set(families)) == len(families)
        assert case.condition.way == ""
        assert cases.from_truth(cases.truth(case)).effects == case.effects
    assert {case.robot for case in filled} == set(BOTH)


def test_patterns_choose_among_effects_of_the_ground():
    (case,) = cases.plan(1, 3, ("hyq_trot",), ("foot_*",))
    assert [e.effect for e in cases.fill(case, ("foot_*",)).effects] == ["foot_friction"]
    with pytest.raises(NameUnknownError, match="backlash"):
        cases.plan(1, 3, ("hyq_trot",), ("backlash",))  # it is of robots that are held


@pytest.mark.parametrize("more", [{"baselines": ["cma"]}, {"follow": 1}])
def test_what_is_for_robots_that_are_held_is_refused(more):
    asked = {"cases": 1, "workers": 1, "limit": 1.0, "robots": ["hyq_trot"], "baselines": None}
    asked |= {"follow": 0, "settings": 0}
    with pytest.raises(ParameterError, match="held, not for hyq_trot; leave it out"):
        battery.check(argparse.Namespace(**{**asked, **more}))
    plain = argparse.Namespace(**asked)
    battery.check(plain)
    assert plain.baselines == []


@pytest.mark.parametrize("name", BOTH)
def test_its_bags_are_what_a_robot_records(tmp_path, monkeypatch, name):
    pytest.importorskip("pybullet")
    monkeypatch.setattr(trots, "TROT", (0.2, 0.12))
    (case,) = cases.plan(1, 3, (name,), ("payload",))
    trial.make(tmp_path, case, ("payload",))
    assert bags.truth(tmp_path, case.name)["effects"][0]["effect"] == "payload"
    model, fit, held = trial.read(tmp_path / bags.BAGS / case.name, name)
    assert [len(fit), len(held)] == [1, 1]
    for record in (*fit, *held):
        assert "base_position" not in record.signals  # no motion capture
        assert {"q", "tau", "gyro", "orientation", "grf"} <= set(record.signals)
        assert record.simulated == pytest.approx(1.0 / (250 * walkers.get(name).steps))
        assert np.isfinite(record.signals["q"][60:]).all()
    assert model.make_robot().joints == tuple(fit[0].joints)


def test_a_robot_that_falls_is_one_line(tmp_path, monkeypatch):
    pytest.importorskip("pybullet")
    monkeypatch.setattr(trots.plant, "FAR", 2.0)  # times its height: it has fallen as it stands
    with pytest.raises(LocoError, match="hyq_trot falls: base height"):
        trots.write(tmp_path, "hyq", "hyq_trot", [], cases.Condition(), 1)
    assert not list(tmp_path.glob("*/*.mcap"))


def test_its_robots_are_those_of_the_workflow(tmp_path):
    for name in BOTH:
        walker = walkers.get(name)
        robot = robots.load(trots.robot_of(walker, tmp_path))
        assert set(robot.joints) == set(walker.joints)
        assert set(robot.feet) == set(walker.feet)
        for joint in robot.joints:
            drive, gains = robot.drives[joint], walker.gains_of(joint)
            assert (drive.kp, drive.kd) == gains[:2]
            swing = drive.swing_kp if drive.swing_kp >= 0.0 else drive.kp
            assert swing == gains[2]
