# SPDX-License-Identifier: Apache-2.0
"""A model that needs a strained nominal value and an effect in one gives way to others."""

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
    free = model("viscous_friction", FAR)
    bare = Fitted(free.parts, {}, 1.0, free.held, free.whole, 0.0)
    assert plain.believed(None, [bare], LIMITS, lambda m: True) == ([bare], [])
