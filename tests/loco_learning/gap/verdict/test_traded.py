# SPDX-License-Identifier: Apache-2.0
"""Values of the robot that a fit moved: prices, alarms, and what is written into a model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.prediction.loose import RANGE, Columns, Loose, Response
from loco_learning.gap.statistics import evidence
from loco_learning.gap.statistics.leftover import LIMITS
from loco_learning.gap.verdict import traded
from loco_learning.gap.verdict.estimates import ALARMS
from loco_sim.effects.coordinates import Coordinate

SPEED = "drives.knee.no_load_speed"
FAR = 10.0 * np.exp(1.01 * ALARMS.strained * 0.3)  # just beyond what is plausible


def model(effect: str, speed: float) -> Fitted:
    size = Coordinate("damping", 0.05, (1.0,), 0.0, 10.0, "N·m·s/rad", strength=True)
    parts = ((Hypothesis(effect, "knee", (("joint", "knee"),), (size,)), (1.0,)),)
    r = np.random.default_rng(0).normal(size=(50, 1))
    return Fitted(parts, {SPEED: speed}, 1.0, evidence.score([r]), (r,), 0.0)


VALUES = {SPEED: 10.0}


def test_a_value_is_strained_beyond_its_prior_on_either_side_and_told_with_its_ratio():
    for speed, told in ((10.0, False), (10.5, False), (FAR, True), (100.0 / FAR, True)):
        assert (
            bool(traded.implausible_values(model("viscous_friction", speed), VALUES, 0.3)) is told
        )
    (alarm,) = traded.implausible_values(model("viscous_friction", 25.0), VALUES, 0.3)
    assert alarm == (
        f"{SPEED} goes to 25, 2.5 times what the robot says: more than 2 deviations of its prior"
    )


def test_a_free_value_is_priced_by_its_prior():
    assert traded.penalty(model("viscous_friction", 10.0), VALUES, 0.3) == 0.0
    for by in (-2.0, 1.0, 3.0):
        speed = 10.0 * np.exp(0.3 * by)
        assert traded.penalty(model("a", speed), VALUES, 0.3) == pytest.approx(0.5 * by**2)


# Values of a robot that nobody knows exactly: name, what the robot says, its deviation.
KNOWN = {"kp": (100.0, 2.0), "mass": (1.0, 0.02), "inertia": (0.01, 0.0004), "kd": (4.0, 0.08),
         "no_load_speed": (6.0, 0.12)}  # fmt: skip


def loose(**deviations: float) -> tuple[SimpleNamespace, Fitted]:
    """Case of which those values are known, and a model that has them so many deviations off."""
    nominal, spread = zip(*KNOWN.values(), strict=True)
    count = len(KNOWN)
    case = SimpleNamespace(loose=near(np.zeros((50, 1, count)), count))
    known = {"names": (*KNOWN,), "nominal": np.array(nominal), "spread": np.array(spread)}
    case.loose = replace(case.loose, **known)
    values = {n: at + deviations.get(n, 0.0) * dev for n, (at, dev) in KNOWN.items()}
    return case, replace(model("coulomb_friction", 10.0), overrides={}, loose=values)


def test_a_value_that_went_further_than_believable_is_told_with_both_ends():
    case, off = loose(kp=-2.1, mass=2.1, inertia=1.9)
    assert traded.deviating_motion(case, off) == (
        "kp goes from 100 to 95.8: more than 2 deviations of what is known of it",
        "mass goes from 1 to 1.04: more than 2 deviations of what is known of it",
    )
    assert traded.deviating_motion(*loose()) == ()
    # A value that nobody refitted stayed as it was.
    assert traded.deviating_motion(case, replace(off, loose={})) == ()


def test_what_is_a_little_off_is_told_the_furthest_first():
    assert traded.little_off(*loose(kp=1.0, mass=-2.0)) == ["mass (1 to 0.96)", "kp (100 to 102)"]
    all_off = loose(kp=1.0, mass=-2.0, inertia=1.5, kd=1.2, no_load_speed=0.7)
    told = traded.little_off(*all_off)
    assert [one.split()[0] for one in told] == ["mass", "inertia", "kd", "2"]
    assert told[-1] == "2 more"
    three = traded.little_off(*loose(kp=1.0, mass=-2.0, inertia=1.5))
    assert len(three) == traded.LISTED and "more" not in three[-1]


def test_where_nothing_is_far_the_furthest_is_told_unless_a_free_value_changed():
    case, near = loose(kd=0.6 * traded.SHIFT, kp=0.3 * traded.SHIFT)
    assert [one.split()[0] for one in traded.little_off(case, near)] == ["kd"]
    assert traded.little_off(case, replace(near, overrides={SPEED: 11.0})) == []
    assert traded.little_off(SimpleNamespace(loose=None), near) == []
    assert traded.deviating_motion(SimpleNamespace(loose=None), near) == ()


def near(columns, count, most=RANGE):
    """Values a0, a1 ... with nominal 1 and deviation 0.02, and what they do, (T, 1, V)."""
    names, one = tuple(f"bodies.a{k}.inertia" for k in range(count)), np.ones(count)
    legal = np.array([[1e-3, 1e3]] * count)
    rows = (np.ones(len(columns), dtype=bool),)
    responses = [Response.of(change) for change in np.moveaxis(columns, -1, 0)]
    sensitivities = (Columns.of(columns.shape[:2], responses),)
    return Loose(
        names, one, 0.02 * one, legal, np.arange(count), sensitivities,
        np.ones(1), rows, (~rows[0],), most, 0.0 * one, one < 0.0,
    )  # fmt: skip


def refitted(by, columns=None):
    """A case with so many values, and a model that has them at deviations."""
    by = np.array(by)
    columns = np.zeros((50, 1, len(by))) if columns is None else columns
    loose = near(columns, len(by))
    one = replace(model("viscous_friction", 10.0), overrides={}, loose=loose.values(by))
    return SimpleNamespace(loose=loose), one


def names(count, first=0):
    return {f"bodies.a{k}.inertia" for k in range(first, count)}


@pytest.mark.parametrize(
    ("on", "of", "told"),
    [(14, 36, True), (1, 36, False), (2, 4, True), (0, 9, False), (1, 8, False)],
)
def test_many_values_on_their_bounds_are_one_line(on, of, told):
    """Fourteen of thirty-six: what the model lacks is imitated by its links."""
    sides = [RANGE * (-1.0) ** k for k in range(on)]
    case, one = refitted([*sides, *(0.3 for _ in range(of - on))])
    text = traded.crowded(case, one)
    assert text.startswith(f"{on} of {of} values on their bound") == told == bool(text)
    found = traded.deviating_motion(case, one)
    assert len(found) == (1 if told else on)


@pytest.mark.parametrize("of", [9, 11, 30, 40])
def test_as_many_on_their_bounds_as_chance_makes_once_in_a_hundred_robots_are_told(of):
    values = np.abs(np.random.default_rng(of).normal(size=(100_000, of)))
    count = (values > RANGE).sum(1)
    first = next(on for on in range(1, of) if np.mean(count >= on) < LIMITS.rare)
    for on in (first - 1, first):
        case, one = refitted([RANGE] * on + [0.3] * (of - on))
        assert bool(traded.crowded(case, one)) is (on == first)


def test_a_value_on_its_bound_or_within_chance_stays_as_it_was():
    """An inertia went 10 % off beside a right name, and another one by what noise makes."""
    rng = np.random.default_rng(4)
    columns = 5.0 * rng.standard_normal((50, 1, 3))
    columns[..., 2] *= 1e-3  # nothing shows it
    case, one = refitted([RANGE, -1.5, 1.0], columns)
    assert set(traded.put_right(case, one)) == {"bodies.a1.inertia"}
    assert traded.put_right(case, one)["bodies.a1.inertia"] == pytest.approx(0.97)


@pytest.mark.parametrize("size", [5.0, 0.01])
def test_values_that_make_up_for_each_other_go_together_or_stay_together(size):
    """Twice the mass under twice the gain is the same motion: neither alone may be put back."""
    both = size * np.random.default_rng(5).standard_normal((50, 1, 1))
    case, one = refitted([0.7, -0.6], np.concatenate([both, 0.9 * both], axis=2))
    assert set(traded.put_right(case, one)) == (names(2) if size > 1.0 else set())


def test_what_was_not_refitted_or_was_asked_for_is_written_as_it_is():
    case, one = refitted([0.0, 0.0])
    asked = replace(one, overrides={SPEED: 12.0}, loose={})
    assert traded.put_right(case, asked) == {SPEED: 12.0}
    assert traded.put_right(SimpleNamespace(loose=None), asked) == {SPEED: 12.0}
    assert traded.crowded(case, asked) == ""
