# SPDX-License-Identifier: Apache-2.0
"""Cases are drawn from a seed, and are as large as they say."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError
from loco_workshop.battery import cases, sizes
from loco_workshop.battery.physics import kinds, machines
from loco_workshop.battery.physics.hidden import Hidden

pytestmark = pytest.mark.usefixtures("short")


def test_the_first_cases_do_not_depend_on_how_many_are_asked_for():
    assert cases.plan(30, 4)[:12] == cases.plan(12, 4)
    assert cases.plan(12, 4) != cases.plan(12, 5)


def test_a_battery_has_all_kinds_on_all_robots():
    made = cases.plan(160, 1001)
    kinds_of = Counter(c.kind for c in made)
    assert kinds_of == {"single": 96, "pair": 24, "outsider": 24, "null": 16}
    assert {c.robot for c in made} == set(machines.MACHINES)
    assert len({c.name for c in made}) == len({c.seed for c in made}) == 160
    used = {name for c in made if c.kind == "single" for name in c.wanted}
    assert len(used) > 0.9 * len(kinds.KINDS)


@pytest.mark.parametrize("robots", range(1, len(machines.MACHINES) + 1))
def test_kinds_and_sizes_meet_all_robots_equally_often(robots):
    made = cases.plan(140, 1001, list(machines.MACHINES)[:robots])
    for what in set(cases.ORDER):
        met = Counter(c.robot for c in made if (c.kind, c.size) == what)
        assert len(met) == robots and max(met.values()) - min(met.values()) <= 1


def test_models_that_are_off_are_met_by_all_robots_and_kinds():
    made = cases.plan(1000, 1001, list(machines.MACHINES)[:3])
    share = Counter((c.robot, c.kind) for c in made if c.condition.off)
    whole = Counter((c.robot, c.kind) for c in made)
    assert all(0.1 < share[key] / count < 0.6 for key, count in whole.items())


def test_effects_asked_for_are_single():
    made = cases.plan(10, 1, ["linear_axis"], ["*friction"])
    assert {c.kind for c in made} == {"single"}
    assert all("friction" in name for c in made for name in c.wanted)


@pytest.mark.parametrize(("robots", "effects"), [(["dog"], []), ([], ["magic"])])
def test_unknown_names_are_refused(robots, effects):
    with pytest.raises(NameUnknownError):
        cases.plan(3, 1, robots, effects)


@pytest.mark.parametrize("size", list(sizes.TARGETS))
def test_a_size_shows_as_much_as_it_says(size):
    found = sizes.sized("viscous_friction", "linear_axis", size, np.random.default_rng(1), 7)
    assert abs(np.log(found[1] / sizes.TARGETS[size])) < 0.4
    again = sizes.visibility("linear_axis", [found[0]], 7)
    assert again == pytest.approx(found[1])


def test_nothing_hidden_shows_nothing():
    assert sizes.visibility("linear_axis", (), 7) < 1.3


def test_what_a_model_that_is_a_little_off_can_make_does_not_show():
    """A carriage of 1.5 kg: its weight does nothing on a level rail, its motor and mass all."""
    for error, least in ((0.01, 1.0), (0.2, 5.0)):
        stronger = Hidden("torque_constant_error", "slide", "error", {"error": error})
        assert least <= sizes.visibility("linear_axis", [stronger], 7) < 8.0 * least
    rubs = Hidden("coulomb_friction", "slide", "torque", {"torque": 1.0})
    moved = sizes._moved(machines.get("linear_axis"), [rubs], "linear_axis", 7)
    raw = np.sqrt(1.0 + np.max(np.mean(np.square(moved), axis=0)))
    assert 0.3 * raw < sizes.visibility("linear_axis", [rubs], 7) <= raw


@pytest.mark.parametrize(
    ("name", "place", "strength", "params"),
    [
        ("viscous_friction", "pivot", "damping", {"damping": 0.004}),  # 2 % of the motor's brake
        ("payload", "rod", "mass", {"link": "rod", "mass": 0.022, "position": [0.0, 0.0, -0.24]}),
    ],
)
def test_what_another_servo_can_make_does_not_show_though_it_rounds(name, place, strength, params):
    """Its encoder makes steps of changes, which no sum of straight lines follows."""
    little = Hidden(name, place, strength, params)
    moved = sizes._moved(sizes._quick("servo_pendulum"), [little], "servo_pendulum", 7)
    raw = np.sqrt(1.0 + np.max(np.mean(np.square(moved), axis=0)))
    shows = sizes.visibility("servo_pendulum", [little], 7)
    assert shows < 2.0 and shows < 0.5 * raw
    much = little.scaled(20.0 * params[strength])
    assert sizes.visibility("servo_pendulum", [much], 7) > 5.0


def test_a_filled_case_is_reproduced_and_survives_its_truth_file():
    planned = cases.plan(1, 8, ["linear_axis"], ["coulomb*", "viscous*"])[0]
    case = cases.fill(planned, ["coulomb*", "viscous*"])
    assert case == cases.fill(planned, ["coulomb*", "viscous*"])
    assert len(case.effects) == 1
    again = cases.from_truth(json.loads(json.dumps(cases.truth(case))))
    assert again.effects == case.effects
    a, b = cases.readings(case), cases.readings(again)
    assert set(a) == {"fit_chirp", "fit_steps", "fit_ramp", "hold_out"}
    assert all(a[k].q.tobytes() == b[k].q.tobytes() for k in a)


def test_a_pair_has_two_effects_of_different_families():
    planned = next(c for c in cases.plan(40, 2, ["linear_axis"]) if c.kind == "pair")
    case = cases.fill(planned)
    first, second = (kinds.KINDS[e.effect].family for e in case.effects)
    assert first != second
