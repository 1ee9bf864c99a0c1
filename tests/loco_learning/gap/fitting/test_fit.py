# SPDX-License-Identifier: Apache-2.0
"""Fits leave the minimum next to their start for a deeper one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import (
    Problem,
    Setting,
    _bounds,
    _strides,
    escape,
    fit,
    jointly,
    refine,
    to_minimum,
    weigh,
)
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.prediction.case import Case
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.statistics.solve import MIN_GAIN, guided
from loco_sim.effects.coordinates import Coordinate
from loco_sim.effects.offers import Motion

from .. import laws

STRIBECK = {"name": "stribeck_friction", "torque": 4.3, "velocity": 0.085}


def setting(**params):
    return Setting(GapParams(**params), {}, {}, 100.0, ())


def at(hypothesis, **values):
    """A hypothesis at values of its parameters."""
    return hypothesis, tuple(c.inverse(values[c.name]) for c in hypothesis.coordinates)


@pytest.mark.parametrize("h", [laws.COULOMB, laws.STRIBECK])
def test_a_model_of_usual_shapes_with_nothing_refitted_is_not_strained(h):
    model = laws.fitted(h)
    assert (model.strain, model.settled, model.hope) == (0.0, {}, 1.0)
    assert model.paid == model.count == len(h.coordinates)


def test_a_wrong_shape_is_left_behind(bench):
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    near = weigh(case, [at(hypothesis, torque=0.5, velocity=1.0)], {})
    far = escape(case, near, setting())
    assert far.fit_rms < 0.5 * near.fit_rms
    (spec,) = far.specs
    assert spec["velocity"] == pytest.approx(STRIBECK["velocity"], rel=0.1)


def test_minima_are_sought_in_steps_of_the_model_and_fitted_in_finer_ones(bench, monkeypatch):
    case, offered = bench([STRIBECK])
    case = replace(case, own=True)  # with the step error that it has
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    near = weigh(case, [at(hypothesis, torque=0.5, velocity=1.0)], {})
    steps, simulate = [], Forward.__call__

    def counted(self, effects=(), overrides=None, only=None, step=1.0):
        steps.append(step)
        return simulate(self, effects, overrides, only, step)

    monkeypatch.setattr(Forward, "__call__", counted)
    far = escape(case, near, setting())
    assert steps[-1] == case.fine < 1.0
    assert steps.count(1.0) > 2 * steps.count(case.fine)
    r = Problem(case, far.parts, setting())(Problem(case, far.parts, setting()).start)
    assert far.cost == pytest.approx(0.5 * float(r @ r), rel=1e-6)


def test_the_right_one_stays(bench):
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    right = fit(case, [at(hypothesis, torque=4.3, velocity=0.085)], setting())
    assert escape(case, right, setting()).fit_rms <= right.fit_rms


def test_a_model_is_fitted_in_its_own_steps_where_their_error_is_known(bench, monkeypatch):
    """A spring is smooth: what finer steps would tell is known. A stiff stop needs them."""
    steps, simulate = [], Forward.__call__

    def counted(self, effects=(), overrides=None, only=None, step=1.0):
        steps.append(step)
        return simulate(self, effects, overrides, only, step)

    monkeypatch.setattr(Forward, "__call__", counted)
    for name, values, start, fine in (
        ("added_stiffness", {"stiffness": 300.0, "rest": 0.0}, "stiffness", False),
        ("end_stop", ROUGH["end_stop"], "stiffness", True),
    ):
        case, offered = bench([{"name": name, **values}])
        (hypothesis, *_) = offered[name].hypotheses
        begun = at(hypothesis, **{**values, start: 0.5 * values[start]})
        steps.clear()
        model = fit(case, [begun], setting())
        assert (max(steps[-3:]) < 1.0) == fine, name
        assert model.fit_rms < 1.3 or fine, name  # the fit of a stop has several minima
        (spec,) = model.specs
        assert spec[start] == pytest.approx(values[start], rel=0.1)


def test_a_strength_alone_has_one_minimum(bench):
    case, offered = bench([{"name": "coulomb_friction", "torque": 3.0}])
    (hypothesis,) = offered["coulomb_friction"].hypotheses
    model = fit(case, [at(hypothesis, torque=1.0)], setting())
    before = case.count
    assert escape(case, model, setting()) is model
    assert case.count == before


ROUGH = {  # effects that are not smooth, at sizes that the bench shows
    "backlash": {"width": 0.004, "inertia": 3.0},
    "coulomb_friction": {"torque": 3.0},
    "end_stop": {"angle": -0.06, "stiffness": 4e4, "damping": 100.0},
    "stribeck_friction": STRIBECK,
    "torque_limit": {"reduction": 0.9},
    "torque_speed_line": {"slope": 5.0},
}
SCAN = (0.5, 0.8, 1.25, 2.0)  # times a value; a place is scanned by a tenth of the deviation from 1


@pytest.mark.parametrize("name", ROUGH)
def test_no_single_value_lowers_a_fit_of_an_effect_that_is_not_smooth(bench, name):
    case, offered = bench([{"name": name, **ROUGH[name]}])
    (hypothesis,) = offered[name].hypotheses
    first, *rest = hypothesis.coordinates
    begun = {c.name: ROUGH[name][c.name] for c in rest} | {
        first.name: 0.3 * ROUGH[name][first.name]
    }
    model = refine(case, fit(case, [at(hypothesis, **begun)], setting()), setting())
    exact = case.corrected(model.specs, {})
    ((_, x),) = model.parts

    def cost(values):
        problem = Problem(exact, [(hypothesis, values)], setting())
        r = problem(problem.start)
        return 0.5 * float(r @ r)

    for i, c in enumerate(hypothesis.coordinates):
        for factor in SCAN:
            moved = list(x)
            ratio = factor if c.strength or c.logarithmic else 1.0 + 0.1 * (factor - 1.0)
            moved[i] = c.clipped(x[i] + math.log(ratio) if c.logarithmic else x[i] * ratio)
            assert cost(moved) > cost(x) - MIN_GAIN, (c.name, factor)


def test_a_stop_is_found_from_a_hundredth_of_its_stiffness(bench):
    """The fit ran out of simulations at 4 kN/m and a damping on its bound."""
    case, offered = bench([{"name": "end_stop", **ROUGH["end_stop"]}])
    (hypothesis,) = offered["end_stop"].hypotheses
    soft = at(hypothesis, angle=-0.054, stiffness=400.0, damping=1.0)
    model = refine(case, fit(case, [soft], setting()), setting())
    (spec,) = model.specs
    for key, value in ROUGH["end_stop"].items():
        assert spec[key] == pytest.approx(value, rel=0.1), key


def test_unusual_shapes_strain_a_model(bench):
    case, offered = bench([])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    usual, odd = (weigh(case, [at(hypothesis, torque=1.0, velocity=v)], {}) for v in (0.1, 40.0))
    assert usual.strain - usual.pull < 0.5 < 5.0 < odd.strain - odd.pull  # but for clocks


@pytest.mark.parametrize("deviations", [-2.0, 0.0, 1.0, 3.0])
def test_strain_is_that_of_a_normal_prior(deviations):
    model = replace(laws.fitted(laws.STRIBECK, 0.7 * deviations), pull=1.5)
    assert model.strain == pytest.approx(0.5 * deviations**2 + 1.5)


def test_a_shape_without_limits_ends_at_the_same_multiples_of_its_size_in_any_unit():
    velocity = replace(laws.SPEED, low=0.0, high=math.inf)
    degrees = replace(velocity, size=math.degrees(velocity.size))
    assert _bounds(degrees) == pytest.approx(_bounds(velocity))
    assert _bounds(velocity) == pytest.approx([-math.log(1e6), math.log(1e6)])


@pytest.mark.parametrize(
    ("starts", "width"), [((0.3,), 0.2 * 4.0 / 0.5), ((0.3, 0.8), 0.5), ((0.1, 0.4, 1.1), 1.0)]
)
def test_minima_of_a_place_are_as_far_apart_as_its_starts_or_a_part_of_its_range(starts, width):
    place = Coordinate("angle", 0.5, starts, -2.0, 2.0, "rad")
    plant = SimpleNamespace(encoder_step=0.0)
    problem = SimpleNamespace(
        case=SimpleNamespace(forward=SimpleNamespace(_robot=lambda *args: plant)),
        each=[(None, place, 0.3, 2.0)],
    )  # fmt: skip
    assert _strides(problem) == [(0, pytest.approx(width / 2.0))]


def test_a_hopeless_fit_ends_in_the_steps_of_the_model(bench):
    """It is no worse than it began, and cheaper; any other one is fitted as before."""
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["viscous_friction"].hypotheses
    begun = [at(hypothesis, damping=1.0)]
    costs, models = [], []
    for hopeless in (np.inf, 0.0):
        before = case.count
        models.append(fit(case, begun, replace(setting(), hopeless=hopeless)))
        costs.append(case.count - before)
    assert costs[1] < costs[0]
    assert models[1].fit_rms < weigh(case, begun, {}).fit_rms
    wide = replace(setting(), hopeless=1.01 * models[1].cost)
    assert fit(case, begun, wide).parts == models[0].parts


@pytest.mark.parametrize("name", ["end_stop", "coulomb_friction"])
def test_every_step_of_a_fit_has_as_many_simulations_more_for_more_parameters(
    bench, monkeypatch, name
):
    """Where a stop runs out of them in one step alone, its stiffness stays where it was."""
    case, offered = bench([])
    (hypothesis, *_) = offered[name].hypotheses
    begun, given = (hypothesis, hypothesis.starts()[0]), []

    def keep(index):
        def least(fun, z, bounds, step, *rest):
            given.append(rest[index])
            return SimpleNamespace(z=z, cost=0.0, jacobian=None)

        return least

    monkeypatch.setattr("loco_learning.gap.fitting.fit.minimise", keep(0))
    monkeypatch.setattr("loco_learning.gap.fitting.fit.lowest", keep(1))
    model = fit(case, [begun], setting(evaluations=20))
    to_minimum(case, model, setting(evaluations=20, beyond=0))
    first, _, (beyond, again) = given
    assert first == again and beyond == 0
    assert (first == 20) is (len(begun[1]) == 1) and first >= 20 + 2 * (len(begun[1]) - 1)


def test_a_smooth_effect_is_at_its_minimum_and_one_in_jumps_moves_only_to_a_lower_one(bench):
    case, offered = bench([{"name": "coulomb_friction", "torque": 3.0}])
    (smooth,), (dry,) = (offered[n].hypotheses for n in ("viscous_friction", "coulomb_friction"))
    model = weigh(case, [at(smooth, damping=1.0)], {})
    assert to_minimum(case, model, setting()) is model
    start = weigh(case, [at(dry, torque=0.5)], {})
    found = to_minimum(case, start, setting())
    (spec,) = found.specs
    assert spec["torque"] == pytest.approx(3.0, rel=0.05) and found.fit_rms < start.fit_rms
    assert to_minimum(case, replace(found), setting()).fit_rms <= found.fit_rms


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_free_value_is_pulled_by_its_relative_change_in_any_unit(unit):
    """Nothing pulls a value that stays; one spread of its logarithm is one deviation."""
    params, nominal = GapParams(), {"kp": 0.3 * unit, "mass": 7.0}
    for kp, by in ((0.0, 0.0), (params.free_spread, 1.0), (-2.0 * params.free_spread, -2.0)):
        free = {**nominal, "kp": nominal["kp"] * math.exp(kp)}
        problem = Problem(None, [], Setting(params, nominal, free, 3.0, ()))
        line = problem.line(problem.start, np.zeros(4), np.zeros(0))
        assert line == pytest.approx([0.0] * 4 + [by, 0.0])


def test_a_model_without_free_numbers_is_not_fitted(bench):
    case, _ = bench([])
    counts = [case.count]
    for function in (weigh, fit):
        found = function(case, [], {} if function is weigh else setting())
        counts.append(case.count)
    assert found.cost == 0.0 and len(set(np.diff(counts))) == 1


def test_a_stop_and_a_weak_drive_are_fitted_together(servo):
    """A stop by itself ended at a rod 5 % too heavy, and a payload got a name for the rest."""
    stop = {"name": "end_stop", "joint": "pivot", "angle": 0.55, "stiffness": 0.5, "damping": 0.03}
    case = servo([stop])
    robot = case.forward.robot(0)
    offered = offer(robot, case.signals, Motion(np.full(1, -0.9), np.full(1, 0.9)))
    (hypothesis,) = [h for h in offered if h.effect == "end_stop" and "above" in h.key]
    apart = weigh(case, [at(hypothesis, angle=0.5, stiffness=0.4, damping=0.03)], {})
    together = jointly(case, apart, setting())
    assert together.fit_rms < 1.1 < 1.4 < apart.fit_rms
    (spec,) = together.specs
    assert spec["angle"] == pytest.approx(0.55, rel=0.02)
    assert spec["stiffness"] == pytest.approx(0.5, rel=0.1)
    for name, value in servo.truth.items():
        assert together.loose[name] == pytest.approx(value, rel=0.01)


def test_a_model_that_is_polished_gets_its_robot_fitted_once(servo, monkeypatch):
    """Together with the effects; before this, values were sought after each refit as well."""
    stop = {"name": "end_stop", "joint": "pivot", "angle": 0.55, "stiffness": 0.5, "damping": 0.03}
    case = servo([stop])
    offered = offer(case.forward.robot(0), case.signals, Motion(np.full(1, -0.9), np.full(1, 0.9)))
    (hypothesis,) = [h for h in offered if h.effect == "end_stop" and "above" in h.key]
    apart = weigh(case, [at(hypothesis, angle=0.5, stiffness=0.4, damping=0.03)], {}, seek=False)

    def never(*args):
        raise AssertionError("sought apart from the effects")

    monkeypatch.setattr(Case, "_sought", never)
    found = refine(case, apart, setting())
    assert found.fit_rms < 0.8 * apart.fit_rms


def test_each_value_is_changed_only_where_straight_lines_lead_nowhere(servo, monkeypatch):
    """A cost of nothing is one that no fit reaches: there each value is changed in a simulation."""
    stop = {"name": "end_stop", "joint": "pivot", "angle": 0.55, "stiffness": 0.5, "damping": 0.03}
    case = servo([stop])
    offered = offer(case.forward.robot(0), case.signals, Motion(np.full(1, -0.9), np.full(1, 0.9)))
    (hypothesis,) = [h for h in offered if h.effect == "end_stop" and "above" in h.key]
    apart = weigh(case, [at(hypothesis, angle=0.5, stiffness=0.4, damping=0.03)], {})
    runs, searched, bare = [], [], Case.bare

    def counted(self, *args, **kwargs):
        runs.append(args)
        return bare(self, *args, **kwargs)

    def search(*args):  # what comes before and after is the same for both
        before = len(runs)
        found = guided(*args)
        searched.append(len(runs) - before)
        return found

    monkeypatch.setattr(Case, "bare", counted)
    monkeypatch.setattr("loco_learning.gap.fitting.fit.guided", search)
    costs = [
        jointly(case, replace(apart, cost=promised), setting()).cost for promised in (np.inf, 0.0)
    ]
    assert searched[0] < 0.75 * searched[1]
    assert costs[0] < 1.02 * costs[1]


def test_where_straight_lines_are_true_nothing_is_fitted_again(bench):
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    model = weigh(case, [at(hypothesis, torque=4.3, velocity=0.085)], {})
    assert jointly(case, model, setting()) is model
