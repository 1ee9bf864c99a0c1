# SPDX-License-Identifier: Apache-2.0
"""Scores of made-up verdicts."""

from __future__ import annotations

import pytest

from loco_workshop.battery import page, score, score_text
from loco_workshop.battery.physics import machines

pytestmark = pytest.mark.usefixtures("short")


def truth(effects, kind="single", size="large", robot="tigrillo", name="case_0000"):
    listed = [
        {"effect": e, "place": p, "strength": "torque", "params": {"torque": 0.1}}
        for e, p in effects
    ]
    return {"name": name, "robot": robot, "kind": kind, "size": size, "seed": 1,
            "effects": listed, "shows": [15.0] * len(listed)}  # fmt: skip


def term(effect, place, value=0.1, low=0.08, high=0.12):
    values = {"value": value, "low": low, "high": high, "unit": "N·m"}
    return {"effect": effect, "place": place, "verdict": "named", "parameters": {"torque": values}}


def result(verdict, terms=(), ambiguous=(), rivals=(), before=10.0, after=1.0):
    return {"verdict": verdict, "names": sorted({t["effect"] for t in terms}), "terms": list(terms),
            "ambiguous": list(ambiguous), "rivals": [{"names": r} for r in rivals],
            "gap": {"before": before, "after": after}, "seconds": 20.0}  # fmt: skip


FRICTION = [("coulomb_friction", "lf_hfe_joint")]


def test_the_right_name_at_the_right_place():
    r = score.row(truth(FRICTION), result("named", [term(*FRICTION[0])]))
    assert r["top1"] and r["right"] and r["top2"] and r["place"] and not r["false"]
    assert r["sizes"] == [{"effect": "coulomb_friction", "error": 0.0, "inside": True}]
    assert r["closed"] == pytest.approx(1.0)


def test_late_stamps_may_be_named_but_are_not_asked_for():
    late, name = {"condition": {"way": "late", "off": True}}, ("sensor_latency", "")
    friction, delay = term(*FRICTION[0]), term(*name)
    null = score.row(truth([], "null") | late, result("named", [delay]))
    assert not null["named"] and not null["false"]
    both = score.row(truth(FRICTION) | late, result("named", [friction, delay]))
    assert both["top1"] and both["said"] == ["coulomb_friction"]
    alone = score.row(truth([name]) | late, result("named", [delay]))
    assert alone["said"] == ["sensor_latency"] and alone["named"]
    wrong = score.row(truth([], "null") | late, result("named", [friction, delay]))
    assert wrong["false"]
    f = score.figures([null, both, alone, wrong])
    assert f["false names, model a little off"] == 0.25
    assert f["by condition"]["late"]["cases"] == 2


def test_probabilities_are_compared_with_the_share_of_right_effects():
    effects = [{"coulomb_friction": 0.97}, {"backlash": 0.25, "coulomb_friction": 0.5}]
    found = [{**result("unknown"), "probability": {"effects": each}} for each in effects]
    rows = [score.row(truth(FRICTION), one) for one in (*found, result("unknown"))]
    f = score.figures(rows)["calibration"]
    assert f["probabilities"] == 3
    assert f["probability told"] == pytest.approx((0.97 + 0.25 + 0.5) / 3)
    assert f["share right"] == pytest.approx(2 / 3)
    assert f["Brier score"] == pytest.approx((0.03**2 + 0.25**2 + 0.5**2) / 3)
    assert f["calibration error"] == pytest.approx((0.03 + 0.25 + 0.5) / 3)
    assert "## Calibration" in score_text.markdown(score.figures(rows), rows, "t")
    bare = score.figures(rows[2:])
    assert bare["calibration"]["Brier score"] is None
    assert "## Calibration" not in score_text.markdown(bare, rows[2:], "t")


def test_names_under_other_settings_are_counted_where_any_is_given():
    named = result("named", [term(*FRICTION[0])])
    answers = [
        ("named", ["coulomb_friction"]),
        ("unknown", []),
        ("named", ["payload"]),
        ("ambiguous", ["payload"]),
        ("named, and more is missing", ["coulomb_friction"]),
    ]
    named["settings"] = [{"verdict": verdict, "names": names} for verdict, names in answers]
    f = score.figures([score.row(truth(FRICTION), named)])
    assert f["answers under other settings"] == 5
    assert f["same names under other settings"] == pytest.approx(2 / 3)
    assert f["no name under other settings"] == pytest.approx(2 / 5)


def test_another_leg_is_the_wrong_place_and_a_wrong_size_is_seen():
    found = term("coulomb_friction", "rf_hfe_joint", 0.15, 0.14, 0.16)
    r = score.row(truth(FRICTION), result("named", [found]))
    assert r["top1"] and r["place"] is False
    assert r["sizes"][0]["error"] == pytest.approx(0.5) and r["sizes"][0]["inside"] is False


@pytest.mark.parametrize(
    ("group", "told"),
    [
        (["coulomb_friction", "viscous_friction"], True),
        (["coulomb_friction", "backlash"], False),
        (["payload", "armature"], False),
    ],
)
def test_a_kind_is_told_where_all_that_is_left_is_of_it(group, told):
    case = truth(FRICTION)
    assert score.row(case, result("ambiguous", ambiguous=[group]))["kind_told"] is told
    assert score.row(case, result("named", [term(*FRICTION[0])]))["kind_told"]
    assert not score.row(case, result("unknown", ambiguous=[group]))["kind_told"]
    assert not score.row(truth([], "null", ""), result("no gap"))["kind_told"]


def test_the_experiment_that_was_run_next_is_scored_beside_the_first_verdict():
    case, plain = truth(FRICTION), score.row(truth(FRICTION), result("ambiguous"))
    assert plain["then"] is None and score.followed([plain]) == []
    first = result("ambiguous", ambiguous=[["coulomb_friction", "hysteresis"]])
    later = {**result("named", [term(*FRICTION[0])]), "experiment": "still_poses"}
    between = {**first, "experiment": "preload", "followed": later}
    twice = score.row(case, {**first, "followed": between})
    assert twice["then"]["top1"] and twice["experiment"] == "preload, still_poses"
    r = score.row(case, {**first, "followed": later})
    assert r["abstained"] and not r["top1"] and r["experiment"] == "still_poses"
    rows = score.followed([plain, r])
    assert [x["top1"] for x in rows] == [False, True]
    text = score_text.markdown(score.figures([plain, r]), [plain, r], "T", score.figures(rows))
    assert "| 0 % | 50 % | >= 90 % |" in text and "| still_poses | coulomb_friction |" in text


@pytest.mark.parametrize(
    ("true", "said", "same"),
    [("", "*", True), ("*_hfe_joint", "*_hfe_joint", True), ("lf_hfe_joint", "*_hfe_joint", False),
     ("lf_lower_leg", "lf_lower_leg", True), ("lf_lower_leg", "lf_upper_leg", False)],
)  # fmt: skip
def test_places_are_compared_by_what_they_name(true, said, same):
    assert score.same_place(machines.get("tigrillo"), true, said) is same


def test_parts_of_a_force_that_the_data_do_not_determine_do_not_count():
    case = truth([("push", "carriage")], robot="linear_axis")
    case["effects"][0] |= {"strength": "force", "params": {"force": [-2.0, 0.5, 1.0]}}
    said = {"effect": "push", "place": "carriage", "verdict": "named", "parameters": {
        "force.x": {"value": -2.1, "low": -2.2, "high": -1.9},
        "force.y": {"value": 0.0, "low": None, "high": None},
        "force.z": {"value": 0.0, "low": None, "high": None},
    }}  # fmt: skip
    (size,) = score.row(case, result("named", [said]))["sizes"]
    assert size["error"] == pytest.approx(0.05) and size["inside"] is True


MORE = "named, and more is missing"


def test_a_name_counts_although_more_is_missing_beside_it():
    r = score.row(truth(FRICTION), result(MORE, [term(*FRICTION[0])]))
    assert r["top1"] and r["named"] and r["place"] and r["sizes"][0]["inside"] and r["more"]
    assert score.said(r) == "coulomb_friction"
    wrong = score.row(truth([], "null"), result(MORE, [term(*FRICTION[0])]))
    assert wrong["false"] and score.figures([r, wrong])["false names"] == 0.5


def test_an_outsider_may_be_told_with_the_word_that_more_is_missing():
    strange = truth([("rubber", "lf_hfe_joint")], "outsider")
    found = [score.row(strange, result(v, [term(*FRICTION[0])])) for v in ("named", MORE)]
    shares = score.figures(found)
    assert (shares["outsiders with a reserve"], shares["outsiders named"]) == (0.5, 1.0)


def test_a_name_too_many_is_not_right():
    extra = [term(*FRICTION[0]), term("payload", "")]
    r = score.row(truth(FRICTION), result("named", extra))
    assert r["with_others"] and not r["top1"] and not r["right"]
    assert score.said(r) == "coulomb_friction and others"


def test_a_rival_in_second_place_counts_for_top_two():
    wrong = result("named", [term("load_friction", "lf_hfe_joint")], rivals=[["coulomb_friction"]])
    r = score.row(truth(FRICTION), wrong)
    assert r["top2"] and not r["top1"] and r["place"] is None


def test_twins_are_right_when_both_are_named_as_ambiguous():
    case = truth([("command_delay", "")])
    hedged = result("ambiguous", ambiguous=[["command_delay", "sensor_latency"]])
    guessed = result("named", [term("command_delay", "")])
    assert score.row(case, hedged)["right"] and not score.row(case, hedged)["top1"]
    assert score.row(case, guessed)["top1"] and not score.row(case, guessed)["right"]


def test_late_sensors_are_told_from_a_late_command_where_torques_come_in_time():
    named = result("named", [term("sensor_latency", "")])
    case = truth([("sensor_latency", "")], robot="hyq_leg")
    assert score.row(case, named)["right"]
    assert not score.row({**case, "robot": "linear_axis"}, named)["right"]


@pytest.mark.parametrize(
    ("robot", "alone"), [("servo_pendulum", True), ("hyq_leg", False), ("hyq_trot", False)]
)
def test_a_tilted_bench_and_a_shifted_mass_are_the_same_to_one_joint(robot, alone):
    case = truth([("com_offset", "rod")], robot=robot)
    hedged = result("ambiguous", ambiguous=[["com_offset", "slope"]])
    assert score.row(case, hedged)["right"] is alone


def test_a_pair_is_right_when_only_its_twin_is_left():
    delay = ["command_delay", "sensor_latency"]
    case = truth([*FRICTION, ("sensor_latency", "")], "pair")
    hedged = result("ambiguous", [term(*FRICTION[0])], ambiguous=[delay])
    assert score.row(case, hedged)["right"] and not score.row(case, hedged)["top1"]
    assert not score.row(case, result("unknown", [term(*FRICTION[0])], ambiguous=[delay]))["right"]
    more = result("ambiguous", [term(*FRICTION[0])], ambiguous=[delay, ["payload", "com_offset"]])
    assert not score.row(case, more)["right"]
    assert not score.row(case, result("ambiguous", [], ambiguous=[delay]))["right"]


def test_the_first_choice_counts_whatever_the_verdict():
    found = term(*FRICTION[0])
    hedged = result("ambiguous", [found], ambiguous=[["coulomb_friction", "load_friction"]])
    r = score.row(truth(FRICTION), hedged)
    assert r["first"] and r["top2"] and not r["top1"]
    more = result("ambiguous", [found, term("payload", "")])
    assert not score.row(truth(FRICTION), more)["first"]
    assert not score.row(truth([], "null", ""), result("no gap"))["first"]


def rows():
    cases = [
        (truth(FRICTION), result("named", [term(*FRICTION[0])])),
        (truth(FRICTION, size="small"), result("no gap", before=1.0)),
        (truth([*FRICTION, ("payload", "lf_lower_leg")], "pair"), result("unknown")),
        (truth([], "null", ""), result("no gap", before=1.0)),
        (truth([], "null", ""), result("named", [term(*FRICTION[0])], before=1.1)),
        (truth([("rubber", "lf_hfe_joint")], "outsider"), result("unknown", after=6.0)),
        (truth(FRICTION), {"verdict": "error", "names": [], "terms": [], "error": "too slow"}),
    ]
    return [score.row(*c) for c in cases]


def test_figures_over_cases():
    f = score.figures(rows())
    assert f["cases"] == 7 and f["errors"] == 1
    assert f["singles medium and large"]["top-1"] == 0.5  # an error counts as wrong
    assert f["singles small"]["no gap"] == 1.0
    assert f["pairs both named"] == 0.0 and f["false names on nulls"] == 0.5
    assert f["outsiders unknown or ambiguous"] == 1.0
    assert f["false names"] == pytest.approx(1 / 7)


def test_every_single_case_is_in_the_confusion_matrix_once():
    table = score.confusion(rows())
    assert sum(n for line in table.values() for n in line.values()) == 6
    assert table["nothing"] == {"no gap": 1, "coulomb_friction": 1}


def test_baselines_are_compared_on_the_cases_that_have_them():
    made = result("named", [term(*FRICTION[0])], after=1.1)
    made["baselines"] = {"everything": {"after": 1.4, "seconds": 3.0}}
    f = score.figures([score.row(truth(FRICTION), made), *rows()])
    held = f["held-out error"]
    assert held["cases"] == 1
    assert held["fit everything"]["median"] == 1.4
    assert held["fit everything"]["worse than loco gap"] == 1.0
    assert held["loco gap"]["closed"] == pytest.approx(1.0 - (1.21 - 1.0) / 99.0)


def test_the_page_in_markdown_has_all_cases():
    found = rows()
    text = score_text.markdown(score.figures(found), found, "Battery")
    assert text.count("case_0000") == len(found)
    assert "| 50 % | >= 90 % |" in text


def test_a_share_of_less_than_a_percent_is_not_told_as_none():
    told = [score_text.percent(value) for value in (None, 0.0, 0.004, 0.01, 0.874, 1.0)]
    assert told == ["–", "0 %", "0.4 %", "1 %", "87 %", "100 %"]


def test_a_published_battery_has_its_page(repository):
    text = page.published(repository / "docs/results/gap_battery/seed_7301.jsonl.gz")
    assert "Blind battery, seed 7301" in text and "29 cases" in text
