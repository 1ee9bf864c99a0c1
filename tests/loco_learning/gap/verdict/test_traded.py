# SPDX-License-Identifier: Apache-2.0
"""A model that needs a strained nominal value and an effect in one gives way to others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.prediction.loose import MOST, Loose
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import traded
from loco_learning.gap.verdict.decide import LIMITS
from loco_learning.gap.verdict.traded import Nominal
from loco_sim.effects.coordinates import Coordinate

SPEED = "drives.knee.no_load_speed"
NOMINAL = Nominal({SPEED: 10.0}, 0.3)
FAR = 10.0 * np.exp(1.01 * LIMITS.strained * 0.3)  # just beyond what is plausible


def model(effect: str, speed: float) -> Fitted:
    size = Coordinate("damping", 0.05, (1.0,), 0.0, 10.0, "N·m·s/rad", strength=True)
    parts = ((Hypothesis(effect, "knee", (("joint", "knee"),), (size,)), (1.0,)),)
    r = np.random.default_rng(0).normal(size=(50, 1))
    return Fitted(parts, {SPEED: speed}, 1.0, evidence.score([r]), (r,), 0.0)


@pytest.fixture(autouse=True)
def imitation(monkeypatch):
    """Nominal values imitate viscous friction, no other effect."""

    def sensitivities(case, fitted):
        (name,) = fitted.names
        seen = {f"{name}.damping knee": 0.97 if name == "viscous_friction" else 0.5}
        return {}, SimpleNamespace(imitated=seen)

    monkeypatch.setattr(traded, "sensitivities", sensitivities)


def test_a_value_is_strained_beyond_its_prior_on_either_side():
    for speed, wanted in ((10.0, ()), (FAR, (SPEED,)), (100.0 / FAR, (SPEED,))):
        assert NOMINAL.strained(model("viscous_friction", speed), LIMITS) == wanted


def test_what_is_imitated_and_strains_gives_way():
    bad, good = model("viscous_friction", FAR), model("coulomb_friction", 11.0)
    kept, out = NOMINAL.believed(None, [bad, good], LIMITS, lambda m: True)
    assert kept == [good]
    (one,) = out
    assert one.model is bad and one.values == (SPEED,)
    assert one.effects == (("viscous_friction", "knee", 0.97),)


def test_one_of_both_is_no_reason():
    models = [model("viscous_friction", 11.0), model("coulomb_friction", FAR)]
    assert NOMINAL.believed(None, models, LIMITS, lambda m: True) == (models, [])


def test_nothing_gives_way_to_what_does_not_explain_the_data():
    models = [model("viscous_friction", FAR), model("coulomb_friction", 11.0)]
    kept, out = NOMINAL.believed(None, models, LIMITS, lambda m: m is models[0])
    assert (kept, out) == (models, [])


def test_without_free_values_nothing_is_asked():
    plain = Nominal({}, 0.3)
    bare = replace(model("viscous_friction", FAR), overrides={})
    assert plain.believed(None, [bare], LIMITS, lambda m: True) == ([bare], [])


def test_an_alarm_tells_where_a_value_goes_and_how_many_times_what_it_was():
    (alarm,) = NOMINAL.alarms(model("viscous_friction", 25.0), LIMITS)
    assert alarm == (
        f"{SPEED} goes to 25, 2.5 times what the robot says: more than 2 deviations of its prior"
    )
    assert NOMINAL.alarms(model("viscous_friction", 10.5), LIMITS) == ()


@pytest.mark.parametrize(("cosine", "wanted"), [(0.97, (SPEED,)), (LIMITS.imitated, ()), (0.5, ())])
def test_an_effect_is_traded_with_what_is_strained_where_both_do_the_same(cosine, wanted):
    far = model("viscous_friction", FAR)
    ((law, _),) = far.parts
    known = SimpleNamespace(imitated={"viscous_friction.damping knee": cosine})
    assert NOMINAL.traded(far, law, known, LIMITS) == wanted
    assert NOMINAL.traded(model("viscous_friction", 10.5), law, known, LIMITS) == ()


def test_the_likest_of_all_strengths_counts_and_no_shape():
    size, turn = (Coordinate(n, 1.0, (1.0,), 0.0, 9.0, strength=True) for n in ("size", "turn"))
    shape = Coordinate("speed", 1.0, (1.0,), 0.1, 9.0, logarithmic=True)
    law = Hypothesis("effect", "", (), (size, turn, shape))
    seen = {"effect.size": 0.3, "effect.turn": 0.6, "effect.speed": 0.99}
    assert traded.cosine(law, SimpleNamespace(imitated=seen)) == 0.6
    assert traded.cosine(law, SimpleNamespace(imitated={})) == 0.0


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
    assert traded.strayed(case, off, LIMITS) == (
        "kp goes from 100 to 95.8: more than 2 deviations of what is known of it",
        "mass goes from 1 to 1.04: more than 2 deviations of what is known of it",
    )
    assert traded.strayed(*loose(), LIMITS) == ()
    # A value that nobody refitted stayed as it was.
    assert traded.strayed(case, replace(off, loose={}), LIMITS) == ()


def test_what_is_a_little_off_is_told_the_furthest_first():
    assert traded.little_off(*loose(kp=1.0, mass=-2.0)) == ["mass (1 to 0.96)", "kp (100 to 102)"]
    all_off = loose(kp=1.0, mass=-2.0, inertia=1.5, kd=1.2, no_load_speed=0.7)
    told = traded.little_off(*all_off)
    assert [one.split()[0] for one in told] == ["mass", "inertia", "kd", "2"]
    assert told[-1] == "2 more"
    three = traded.little_off(*loose(kp=1.0, mass=-2.0, inertia=1.5))
    assert len(three) == traded.TOLD and "more" not in three[-1]


def test_where_nothing_is_far_the_furthest_is_told_unless_a_free_value_changed():
    case, near = loose(kd=0.6 * traded.NEAR, kp=0.3 * traded.NEAR)
    assert [one.split()[0] for one in traded.little_off(case, near)] == ["kd"]
    assert traded.little_off(case, replace(near, overrides={SPEED: 11.0})) == []
    assert traded.little_off(SimpleNamespace(loose=None), near) == []
    assert traded.strayed(SimpleNamespace(loose=None), near, LIMITS) == ()


def near(columns, count, most=MOST):
    """Values a0, a1 ... with nominal 1 and deviation 0.02, and what they do, (T, 1, V)."""
    names, one = tuple(f"bodies.a{k}.inertia" for k in range(count)), np.ones(count)
    legal = np.array([[1e-3, 1e3]] * count)
    rows = (np.ones(len(columns), dtype=bool),)
    return Loose(
        names, one, 0.02 * one, legal, np.arange(count), (columns,), np.ones(1), rows, (~rows[0],),
        most, 0.0 * one, one < 0.0,
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
    sides = [MOST * (-1.0) ** k for k in range(on)]
    case, one = refitted([*sides, *(0.3 for _ in range(of - on))])
    text = traded.crowded(case, one)
    assert text.startswith(f"{on} of {of} values on their bound") == told == bool(text)
    found = traded.strayed(case, one, LIMITS)
    assert len(found) == (1 if told else on)


def test_a_value_on_its_bound_or_within_chance_stays_as_it_was():
    """An inertia went 10 % off beside a right name, and another one by what noise makes."""
    rng = np.random.default_rng(4)
    columns = 5.0 * rng.standard_normal((50, 1, 3))
    columns[..., 2] *= 1e-3  # nothing shows it
    case, one = refitted([MOST, -1.5, 1.0], columns)
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
