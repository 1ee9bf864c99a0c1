# SPDX-License-Identifier: Apache-2.0
"""Bags of the battery are read by the importer; the runner goes on where it stopped."""

from __future__ import annotations

import errno
import json

import numpy as np
import pytest

from loco_bringup.cli.table import parser
from loco_bringup.gap.importing import load
from loco_control.exceptions import BagError, ParameterError
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_learning.jobs import pool
from loco_sim.robot import robot as robots
from loco_workshop.battery import (
    bags as gap_battery_bags,
)
from loco_workshop.battery import (
    battery as gap_battery,
)
from loco_workshop.battery import cases
from loco_workshop.battery import (
    page as gap_battery_page,
)
from loco_workshop.battery import (
    trial as gap_battery_case,
)
from loco_workshop.battery.physics import excitation, machines, plant


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Records of one second."""
    monkeypatch.setattr(excitation, "DURATION", 1.0)
    monkeypatch.setattr(plant, "SETTLE", 0.2)


def options(*words):
    a = parser("gap battery").parse_args(words)
    gap_battery.check(a)
    return a


class FullDisk(gap_battery_bags.BagWriter):
    """Room for 50 messages, then for the end of the file."""

    def write(self, *message):
        if self.written == 50:
            self._fail(OSError(errno.ENOSPC, "No space left on device"))
        super().write(*message)


def test_a_case_without_room_for_its_bags_is_not_there_and_is_made_again(tmp_path, monkeypatch):
    """What fits is a whole bag, but of a shorter record."""
    case = cases.Case("case_0000", "servo_pendulum", "null", "", 5)
    with monkeypatch.context() as full, pytest.raises(BagError, match="not complete: No space"):
        full.setattr(gap_battery_bags, "BagWriter", FullDisk)
        gap_battery_bags.write(tmp_path / "full", case)
    assert not gap_battery_bags.ready(tmp_path / "full", case.name)
    for name in ("full", "whole"):
        gap_battery_bags.write(tmp_path / name, case)
    one, other = (
        {str(p.relative_to(tmp_path / name)): p.read_bytes()
         for p in (tmp_path / name).rglob("*") if p.is_file()}
        for name in ("full", "whole")
    )  # fmt: skip
    assert one == other


@pytest.mark.parametrize("robot", ["servo_pendulum", "linear_axis", "hyq_leg"])
def test_bags_say_what_was_measured_and_no_more(tmp_path, robot):
    case = cases.Case("case_0000", robot, "null", "", 5)
    gap_battery_bags.write(tmp_path, case)
    place = tmp_path / "bags" / "case_0000"
    assert sorted(p.name for p in place.iterdir()) == [
        "fit_chirp", "fit_ramp", "fit_steps", "hold_out",
    ]  # fmt: skip
    made = cases.readings(case)["fit_ramp"]
    (record,) = load(place / "fit_ramp", robots.load(robot))
    assert np.allclose(record.signals["q"], made.q)
    assert np.allclose(record.command["position"], made.command)
    assert record.has("tau") == (made.tau is not None)
    text = b"".join(f.read_bytes() for f in place.rglob("*") if f.is_file())
    assert b"effect" not in text and b"truth" not in text


def test_a_battery_goes_on_and_refuses_another_one(tmp_path, monkeypatch):
    done = []

    def fake(folder, case, *_):
        done.append(case.name)
        gap_battery_bags.write_json(folder / "truth" / f"{case.name}.json", cases.truth(case))
        result = {"case": case.name, "verdict": "unknown", "names": [], "terms": []}
        gap_battery_bags.write_json(folder / "results" / f"{case.name}.json", result)
        return result

    monkeypatch.setattr(pool, "start", lambda function, **_: pool.InProcess(fake))
    told = []
    a = options("--cases", "3", "--seed", "4", "--robots", "linear_axis", "--baselines")
    gap_battery.run(a, tmp_path, lambda *news: told.append(news))
    a.cases = 5
    found = gap_battery.run(a, tmp_path, lambda *news: told.append(news))
    assert done == [f"case_{i:04d}" for i in range(5)] and len(found) == 5
    assert told[-1] == (5, "case_0004", "unknown")
    a.seed = 5
    with pytest.raises(ParameterError, match="another --out"):
        gap_battery.run(a, tmp_path, lambda *news: None)
    lines = gap_battery_page.write_score(tmp_path, found)
    assert "5 cases" in lines[0]
    score = json.loads((tmp_path / "score.json").read_text())
    assert score["figures"]["cases"] == 5
    page = (tmp_path / "score.html").read_text()
    assert "http" not in page and "case_0004" in page


def test_an_ambiguous_case_is_asked_again_with_the_experiments_it_proposes(tmp_path, monkeypatch):
    """The robot moves as the library says, and the workflow gets one bag more each time."""
    seen = []

    def examined(place, robot, seed, more=()):
        _, fit, held = gap_battery_case.read(place, robot, more)
        seen.append([r.name for r in fit])
        proposed = [{"experiment": "preload", "separates": ["a", "b"], "odds": 20.0}]
        verdict = "named" if len(more) > 1 else "ambiguous"
        return {"verdict": verdict, "names": [], "terms": [], "next": proposed}

    monkeypatch.setattr(gap_battery_case, "examined", examined)
    case = cases.Case("case_0000", "linear_axis", "null", "", 5)
    first = gap_battery_case.work(tmp_path, case, (), ())
    assert gap_battery_case.unfinished(case, first, (), 1)
    assert not gap_battery_case.unfinished(case, first, (), 0)
    once = gap_battery_case.work(tmp_path, case, (), (), follow=1)
    assert not gap_battery_case.unfinished(case, once, (), 1)
    assert gap_battery_case.unfinished(case, once, (), 3)
    result = gap_battery_case.work(tmp_path, case, (), (), follow=3)
    verdicts = [answer["verdict"] for answer in gap_battery_case.answers(result)]
    assert verdicts == ["ambiguous", "ambiguous", "named"]
    assert result["followed"]["experiment"] == "preload"
    given = ["fit_chirp", "fit_ramp", "fit_steps"]
    assert seen == [given, [*given, "next_1"], [*given, "next_1", "next_2"]]
    assert result == gap_battery_bags.result(tmp_path, "case_0000")
    assert not gap_battery_case.unfinished(case, result, (), 3)
    (made,) = load(tmp_path / "bags/case_0000/next_1", robots.load("linear_axis"))
    assert made.duration == pytest.approx(7.5, abs=0.01)
    moved = np.ptp(made.signals["q"]) / np.ptp(made.command["position"])
    assert moved == pytest.approx(1.0, abs=0.3)


def test_a_name_is_asked_again_with_the_data_divided_otherwise(tmp_path, monkeypatch):
    """Each once, in an order drawn by the seed; a later run asks those that are missing."""
    seen = []

    def find(model, fit, held, params):
        seen.append((tuple(r.name for r in fit), tuple(r.name for r in held), params.seed))
        return {"verdict": "named", "names": ["payload"], "terms": []}

    monkeypatch.setattr(gap_battery_case.workflow, "find", find)
    case = cases.Case("case_0000", "linear_axis", "null", "", 5)
    two = gap_battery_case.work(tmp_path, case, (), (), settings=2)
    assert len(two["settings"]) == 2 and not gap_battery_case.unfinished(case, two, (), settings=2)
    assert gap_battery_case.unfinished(case, two, (), settings=6)
    all_of_them = gap_battery_case.work(tmp_path, case, (), (), settings=6)
    assert all_of_them["settings"][:2] == two["settings"]
    assert {answer["setting"] for answer in all_of_them["settings"]} == set(gap_battery_case.OTHERS)
    assert len(seen) == len(set(seen)) == 7
    assert seen[0] == (("fit_chirp", "fit_ramp", "fit_steps"), ("hold_out",), 5)


@pytest.mark.parametrize("setting", gap_battery_case.OTHERS)
@pytest.mark.parametrize("count", [1, 4])
def test_data_divided_otherwise_are_the_same_data(setting, count):
    records = [
        Record(f"r{k}", np.arange(10 + k) / 100.0, {"position": np.arange(10.0 + k)[:, None]},
               ("hip",), {"q": np.arange(10.0 + k)[:, None]}, ("hip",))
        for k in range(count)
    ]  # fmt: skip
    fit, held = records[:-1] or records, records[-1:] if count > 1 else []
    others = gap_battery_case.otherwise(setting, fit, held)
    rows = {r.name: [] for r in records}
    for r in (*others[0], *others[1]):
        rows[r.name.split("_")[0]] += r.signals["q"][:, 0].tolist()
    for r in records:
        half = len(r.t) // 2
        part = {"first half": slice(0, half), "second half": slice(half, None)}.get(
            setting, slice(None)
        )
        assert sorted(rows[r.name]) == r.signals["q"][part, 0].tolist()
    judges = [r.name for r in others[1]]
    if setting == "judge":
        assert judges == (["r0"] if count > 1 else ["r0_1"])
    else:
        assert {name.split("_")[0] for name in judges} == {r.name for r in held}


def test_nothing_is_asked_again_where_nothing_is_named(tmp_path, monkeypatch):
    result = {"verdict": "unknown", "names": [], "terms": []}
    monkeypatch.setattr(gap_battery_case.workflow, "find", lambda *a: dict(result))
    case = cases.Case("case_0000", "linear_axis", "null", "", 5)
    assert "settings" not in gap_battery_case.work(tmp_path, case, (), (), settings=3)


def test_a_case_that_fails_is_an_error_the_others_go_on_and_it_is_tried_again(
    tmp_path, monkeypatch
):
    """Why it failed, such as a full disk, need not be there the next time."""
    reasons, tried = ["no room"], []

    def fake(folder, case, *_):
        tried.append(case.name)
        if case.name == "case_0000" and reasons:
            raise ParameterError(reasons.pop())
        result = {"case": case.name, "verdict": "unknown", "names": [], "terms": []}
        gap_battery_bags.keep(folder, result)
        return result

    monkeypatch.setattr(pool, "start", lambda function, **_: pool.InProcess(fake))
    a = options("--cases", "2", "--seed", "4", "--robots", "linear_axis", "--baselines")
    first, second = gap_battery.run(a, tmp_path, lambda *news: None)
    assert (first["verdict"], first["error"]) == ("error", "no room")
    assert second["verdict"] == "unknown"
    again = gap_battery.run(a, tmp_path, lambda *news: None)
    assert [result["verdict"] for result in again] == ["unknown", "unknown"]
    assert tried == ["case_0000", "case_0001", "case_0000"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cases", "0"], "--cases must be above 0"),
        (["--baselines", "luck"], "unknown baseline"),
        (["--settings", "7"], "--settings must be 0 to 6, got 7"),
        (["--follow", "1", "--robots", "hyq_trot"], "--follow is for listed robots"),
    ],
)
def test_mistakes_are_told(words, said):
    with pytest.raises(ParameterError, match=said):
        options(*words)


@pytest.mark.parametrize("robot", ["kuka_iiwa", "a1_air", "hyq_air"])
def test_the_workflow_has_a_model_of_every_robot_that_moves_like_it(robot):
    machine = machines.get(robot)
    model = gap_battery_case.model_of(robot)
    assert model.make_robot().joints == machine.joints
    moved = machine.centre + np.zeros((200, 1)), np.zeros((200, len(machine.driven)))
    moved[0][50:, 0] += 0.1
    r = plant.record(machine, (), moved, 0)
    command = {"position": r.command, "velocity": r.rate}
    forward = Forward(model, [Record("null", r.t, command, r.driven, {"q": r.q}, r.joints)])
    said = forward(step=0.25)[0]
    assert np.ptp(r.q[:, 0]) > 0.09
    assert np.abs(said[-1] - r.q[-1]).max() < 1e-3
