# SPDX-License-Identifier: Apache-2.0
"""Parameters that the data cannot see are not paid for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import weigh
from loco_learning.gap.fitting.seen import observable_count
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.probability import prices
from loco_learning.gap.recordings.record import Record
from loco_sim.effects.offers import Motion
from loco_sim.plant.model import Model

from .. import laws

NOISE = 5e-4
TILT = {"name": "slope", "pitch": 0.05}


@pytest.fixture(scope="module")
def case():
    """A pendulum on a table that is not level, and the effects that may explain it."""
    rng, t = np.random.default_rng(0), np.arange(600) / 200.0
    push = 0.4 * np.sin(4.0 * t)[:, None]
    empty = Record("r", t, {"torque": push}, ("pivot",), {"q": push}, ("pivot",))
    (q,) = Forward(Model("pendulum"), [empty])([TILT], step=1 / 8)
    record = replace(empty, signals={"q": q + NOISE * rng.standard_normal(q.shape)})
    forward = Forward(Model("pendulum"), [record])
    return cases.prepare(forward, [record], [])


def weighed(case, effect, x):
    robot = case.forward.robot()
    offered = offer(robot, ("q",), Motion(np.full(1, -0.5), np.full(1, 0.5)))
    (hypothesis,) = [h for h in offered if h.effect == effect and h.place in ("", "rod", "pivot")]
    return weigh(case, ((hypothesis, tuple(x)),), {})


def test_a_hinge_sees_two_offsets_of_three_and_one_way_of_a_slope(case):
    """Gravity along the axis, and a shift along it, turn nothing."""
    offset = weighed(case, "com_offset", (0.1, 1.0, 0.1))
    slope = weighed(case, "slope", (1.0, 0.0))
    assert (offset.count, observable_count(case, offset)) == (3, 2)
    assert (slope.count, observable_count(case, slope)) == (2, 1)


def test_only_what_is_seen_is_paid(case):
    """Exact twins got odds of hundreds to one for the parameter of which nothing is known."""
    made = weighed(case, "com_offset", (0.1, 1.0, 0.1)), weighed(case, "slope", (1.0, 0.0))
    noise = (np.random.default_rng(0).normal(size=(1000, 1)),)
    offset, slope = (replace(m, whole=noise, pull=0.0) for m in made)
    blind = prices.occam(offset, slope)
    assert blind == pytest.approx(0.5 * np.log(offset.score.n_eff))  # 30 : 1 for three against two
    assert offset.score.n_eff == pytest.approx(1000.0, rel=0.1)
    assert prices.occam(replace(offset, seen=2), replace(slope, seen=2)) == 0.0
    assert prices.occam(replace(offset, seen=2), replace(slope, seen=1)) == pytest.approx(blind)


@pytest.mark.parametrize("x", [0.0, 1.0, laws.TORQUE.inverse(laws.TORQUE.high)])
@pytest.mark.parametrize(("response", "count"), [(0.9, 0), (1.1, 1)])
def test_a_size_is_seen_by_its_typical_change_within_its_bounds(x, response, count):
    model = replace(laws.fitted(laws.COULOMB), parts=((laws.COULOMB, (x,)),))
    deviation = model.score.scale * np.sqrt(model.score.tau[0][0])

    def whitened(specs, overrides, coarse):
        (spec,) = specs
        asked.append(laws.TORQUE.inverse(spec["torque"]))
        change = (asked[-1] - x) / max(1.0, x) * response * deviation
        return [np.where((np.arange(500) == 0)[:, None] & [True, False], change, 0.0)]

    asked = []
    case = SimpleNamespace(cap=1e3, whitened=whitened)
    case.kept = lambda: case
    assert observable_count(case, model) == count
    assert abs(asked[1] - x) == pytest.approx(0.05 * max(1.0, x))
