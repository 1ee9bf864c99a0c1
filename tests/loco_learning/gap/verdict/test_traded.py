# SPDX-License-Identifier: Apache-2.0
"""A model that needs a strained nominal value and an effect in one gives way to others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
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
    case = SimpleNamespace(loose=SimpleNamespace(names=[*KNOWN], nominal=nominal, spread=spread))
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
