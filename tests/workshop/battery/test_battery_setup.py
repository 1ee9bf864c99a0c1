# SPDX-License-Identifier: Apache-2.0
"""What is said about the set-up of a battery's cases, where nothing is wrong."""

import dataclasses

import numpy as np
import pytest

from loco_workshop import battery_setup
from loco_workshop.battery import bags, cases, trial


@pytest.fixture
def battery(tmp_path, short):
    for index, robot in enumerate(("servo_pendulum", "hyq_leg")):
        bags.write(tmp_path, cases.Case(f"case_{index:04}", robot, "null", "", 5))
    return tmp_path


def test_healthy_cases_have_no_finding(battery):
    assert list(battery_setup.lines(battery)) == ["0 of 2 cases have a finding"]


def test_a_case_in_degrees_has_one(battery, monkeypatch):
    read = trial.read

    def turned(record):
        q = np.degrees(record.signals["q"])
        return dataclasses.replace(record, signals=record.signals | {"q": q})

    def in_degrees(place, robot):
        model, fit, held = read(place, robot)
        if robot == "hyq_leg":
            return model, fit, held
        return model, [turned(r) for r in fit], [turned(r) for r in held]

    monkeypatch.setattr(trial, "read", in_degrees)
    (finding, count) = battery_setup.lines(battery)
    assert finding.startswith("case_0000: ")
    assert "unit: deg" in finding
    assert count == "1 of 2 cases have a finding"
