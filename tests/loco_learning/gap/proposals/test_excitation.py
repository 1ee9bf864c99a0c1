# SPDX-License-Identifier: Apache-2.0
"""Experiments that excite robots: for all that have drives, sound, and within their limits."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait.oscillators import Cpg, CpgParams
from loco_control.params import from_dict
from loco_learning.gap.proposals import excitation, pool
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model

BENCHES = ("servo_pendulum", "pendulum", "linear_axis", "hyq_leg")


@pytest.mark.parametrize("robot", BENCHES)
def test_every_motion_of_a_bench_keeps_within_its_limits(robot):
    for experiment in pool.pool(Model(robot)):
        assert pool.limit_violation(rollout(experiment)) == "", experiment.name


@pytest.mark.parametrize("robot", (*BENCHES, "tigrillo"))
def test_names_are_distinct_and_every_joint_moves(robot):
    found = pool.pool(Model(robot))
    names = [e.name for e in found]
    assert len(set(names)) == len(names) >= 6
    for experiment in found:
        target = experiment.make_target()
        said = np.array([target.step(k * experiment.dt)[0] for k in range(experiment.ticks)])
        assert experiment.name == "drop" or np.all(np.ptp(said, axis=0) > 0.01)


@pytest.mark.parametrize("robot", (*BENCHES, "tigrillo"))
def test_commands_stay_within_stops_and_speeds(robot):
    model = Model(robot)
    joints = excitation.joints_of(model.make_robot())
    for name, make in excitation.MAKERS.items():
        if name == "in_turn" and len(joints.rest) < 2:
            continue
        duration, target = make(joints)
        experiment = excitation._experiment(model, name, "x", duration, target)
        cpg = experiment.make_target()
        q, dq = (np.array(x) for x in zip(
            *(cpg.step(k * experiment.dt) for k in range(experiment.ticks)), strict=True
        ))  # fmt: skip
        assert np.all(np.abs(q - joints.rest) <= joints.room + 1e-6), name
        # A chirp that grows while it sweeps adds a little speed.
        assert np.all(np.abs(dq) <= 1.15 * joints.speed + 1e-6), name


def test_a_free_robot_has_motions_in_the_air_on_the_ground_gaits_and_a_drop():
    names = {e.name: e for e in pool.pool(Model("tigrillo"))}
    assert {"steps_air", "steps_ground", "walk_slow", "bound_fast", "drop"} <= set(names)
    assert names["steps_air"].overrides == {"fixed_base": True, "height": excitation.HANG}
    log = rollout(names["drop"])
    assert log.position[:, 2].min() < log.position[0, 2] - 0.5 * excitation.DROP


def test_a_robot_that_is_too_fast_gets_a_smaller_motion():
    chosen = pool.choose(pool.pool(Model("linear_axis")), "steps")
    wild = chosen.replace(target=chosen.target.replace(rise=0.15, amplitude=(0.4,)))
    tamed = pool.within_limits(wild)
    assert tamed.target.amplitude[0] < 0.4
    assert pool.limit_violation(rollout(tamed)) == ""


def test_a_motion_that_is_never_possible_says_why():
    chosen = pool.choose(pool.pool(Model("linear_axis")), "steps")
    with pytest.raises(ParameterError, match="not possible within the robot's limits: slide"):
        pool.within_limits(chosen.replace(target=chosen.target.replace(offset=(3.0,))))


def test_an_unknown_experiment_is_named_beside_those_there_are():
    with pytest.raises(NameUnknownError, match="steps"):
        pool.choose(pool.pool(Model("pendulum")), "dance")


def test_records_are_what_the_model_would_have_said():
    model = Model("servo_pendulum", {}, [{"name": "coulomb_friction", "torque": 0.2}])
    chosen = [pool.choose(pool.pool(Model("servo_pendulum")), "steps")]
    plain, rubbing = (pool.records(m, chosen)[0] for m in (Model("servo_pendulum"), model))
    assert plain.driven == ("pivot",) and set(plain.command) == {"position", "velocity"}
    np.testing.assert_array_equal(plain.command["position"], rubbing.command["position"])
    assert np.abs(plain.signals["q"] - rubbing.signals["q"]).max() > 0.005
    assert set(pool.records(Model("pendulum"), pool.pool(Model("pendulum"))[:1])[0].command) == {
        "torque"
    }


@pytest.mark.parametrize("name", ["linear_axis", "pendulum", "servo_pendulum"])
def test_ideal_records_of_a_bolted_robot_are_those_of_the_engine_without_it(name, monkeypatch):
    model = Model(name, {}, [{"name": "viscous_friction", "damping": 0.01}])
    chosen = [pool.choose(pool.pool(model), "chirp_small")]
    (real,) = pool.records(model, chosen)
    monkeypatch.setattr(pool, "rollout", None)
    (record,) = pool.records(model, chosen, ideal=True)
    assert record.driven == real.driven and record.command.keys() == real.command.keys()
    for kind, told in real.command.items():
        np.testing.assert_array_equal(record.command[kind], told)
    np.testing.assert_array_equal(record.t, real.t)
    rounds = 0.501 * model.make_robot().encoder_step
    for signal, limit in (("q", 1e-9 + rounds), ("tau", 1e-9)):
        assert np.abs(record.signals[signal] - real.signals[signal]).max() <= limit, signal


def test_a_record_is_ideal_only_where_no_engine_is_needed():
    hanging = Model("tigrillo")
    chosen = [pool.choose(pool.pool(hanging), "drop")]
    pairs = [pool.records(hanging, chosen, ideal=ideal)[0] for ideal in (False, True)]
    np.testing.assert_array_equal(*(r.signals["q"] for r in pairs))


def test_a_physics_rate_that_is_no_multiple_of_the_control_rate_ends_no_search():
    model = Model("linear_axis", {"sim.physics_rate": 1013.0})
    chosen = pool.choose(pool.pool(model), "steps")
    (record,) = pool.records(model, [chosen])
    assert len(record.t) == chosen.ticks


@pytest.mark.parametrize("count", [2, 5, 6, 12, 40])
def test_joints_move_in_turn_however_many_there_are(count):
    ones = np.ones(count)
    duration, target = excitation.MAKERS["in_turn"](excitation.Joints(0.0 * ones, ones, 10 * ones))
    cpg = Cpg(from_dict(CpgParams, target), count, 0.01)
    q = np.array([cpg.step(0.01 * k)[0] for k in range(round(100.0 * duration))])
    moving = np.abs(np.diff(q, axis=0)) > 1e-9
    assert moving.sum(axis=1).max() == 1  # never two at once
    turns = [int(np.argmax(row)) for row in moving if row.any()]
    assert list(dict.fromkeys(turns)) == list(range(count)) and turns == sorted(turns)
