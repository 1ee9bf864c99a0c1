# SPDX-License-Identifier: Apache-2.0
"""A learned correction closes what has no name, where it was fitted, and nothing else.

The measurements are made by an integrator of this file, with torques that no effect of the
registry is.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap import workflow
from loco_learning.gap.fitting import residual
from loco_learning.gap.fitting.fit import weigh
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.localisation.correction import KIND
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward
from loco_sim.effects.rows import FEATURES
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

MASS, DAMPING, STEPS = 1.5, 1.0, 64
ASKED = GapParams(effects=("*_friction", "sensor_bias"), most_terms=1, residual=True)
SHIFT = ASKED.replace(effects=("sensor_bias",))  # where what is named is not asked


def nothing(q, v):
    return 0.0


def ripple(q, v):
    """Force that goes up and down along the way, two and a half times."""
    return 6.0 * np.sin(30.0 * q)


def motion(record, drive, effort, force):
    """Positions of a mass on the drive's spring and damper, with a force added, (T, 1)."""
    wanted, speed = (record.command[k][:, 0] for k in ("position", "velocity"))
    q = v = 0.0
    dt, said = record.dt / STEPS, []
    for want, fast in zip(wanted, speed, strict=True):
        said.append([q])
        for _ in range(STEPS):
            tau = drive.kp * (want - q) + drive.kd * (fast - v)
            v += dt * (min(max(tau, -effort), effort) - DAMPING * v + force(q, v)) / MASS
            q += dt * v
    return np.array(said)


@pytest.fixture(scope="module")
def measured(slide):
    """Function that makes records to fit and to judge on, of an axis with a force."""
    robot, kept = slide.model.make_robot(), {}

    def make(force, noise=5e-5):
        if (force, noise) not in kept:
            rng, made = np.random.default_rng(1), []
            for r in [r for part in slide.records() for r in part]:
                q = motion(r, robot.drives["slide"], robot.effort[0], force)
                made.append(replace(r, signals={"q": q + noise * rng.standard_normal(q.shape)}))
            kept[force, noise] = made
        return kept[force, noise][:2], kept[force, noise][2:]

    return make


def prepared(model, fit, judge):
    case = cases.prepare(Forward(model, [*fit, *judge]), fit, judge)
    return case, lambda function, arguments: [function(case, *entry) for entry in arguments]


def test_a_force_without_a_name_is_corrected_and_the_model_file_does_the_same(
    slide, measured, tmp_path
):
    fit, judge = measured(ripple)
    gap = workflow.find(slide.model, fit, judge, ASKED)
    assert (gap["verdict"], gap["names"], gap["model"]["effects"]) == ("unknown", [], [])
    learned = gap["residual"]
    assert learned["used"] and learned["kind"] == KIND
    assert learned["before"] == pytest.approx(gap["gap"]["before"])
    assert learned["closed"] > 0.75  # a part of the force is taken for a late drive
    assert "explains nothing" in learned["says"]
    (row,) = learned["records"]
    assert (row["name"], row["after"]) == (judge[0].name, pytest.approx(learned["after"]))

    Model(slide.model.robot, {}, learned["effects"]).save(tmp_path / "model.yaml")
    assert "explains nothing" in (tmp_path / "model.yaml").read_text()
    again, _ = prepared(models.load_any(tmp_path / "model.yaml"), fit, judge)
    assert weigh(again, (), {}).held.rms == pytest.approx(learned["after"], rel=0.05)


def test_nobody_gets_a_correction_that_did_not_ask_or_has_no_gap(slide, measured):
    quiet = workflow.find(slide.model, *measured(ripple), SHIFT.replace(residual=False))
    assert quiet["residual"] is None
    fit, judge = slide.records()
    assert workflow.find(slide.model, fit, judge, ASKED)["residual"] is None
    fit, judge = slide.records([{"name": "coulomb_friction", "torque": 3.0}])
    named = ASKED.replace(effects=("coulomb_friction",))
    assert workflow.find(slide.model, fit[:1], judge, named)["residual"] is None


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_is_not_fitted(slide, seed):
    fit, judge = slide.records(noise=1e-3, seed=seed)
    case, each = prepared(slide.model, fit, judge)
    found = residual.fit(case, weigh(case, (), {}), each)
    assert found is None


def test_what_helps_only_where_it_was_fitted_is_left_out_with_the_reason(slide, measured):
    """The force is there in the records that are fitted, and gone in the one that judges."""
    fit, _ = measured(ripple)
    _, judge = measured(nothing)
    learned = workflow.find(slide.model, fit, judge, ASKED)["residual"]
    assert not learned["used"] and learned["effects"] == []
    assert learned["says"].startswith("A learned correction is left out: ")


def test_joints_that_hardly_move_what_is_predicted_are_left_alone():
    x = np.random.default_rng(0).normal(size=(50, 3 * FEATURES))
    weights = np.repeat([1.0, 0.01, 0.5], FEATURES)
    assert residual.telling(x, weights) == [0, 2]


def test_same_bytes_for_any_number_of_workers(slide, measured):
    one, two = (
        workflow.find(slide.model, *measured(ripple), SHIFT, workers=n)["residual"] for n in (1, 2)
    )
    assert one["used"]
    assert json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)


def test_it_is_never_proposed_as_a_cause(slide, measured):
    fit, judge = measured(nothing)
    gap = workflow.find(slide.model, fit, judge, GapParams(effects=("learned_residual",)))
    assert gap["terms"] == [] and gap["names"] == []
    (row,) = [one for one in gap["not_tried"] if one["effect"] == "learned_residual"]
    assert "explains nothing" in row["reason"]


def test_the_load_of_a_joint_is_of_springs_too_whatever_torque_is_measured(slide, measured):
    fit, judge = measured(nothing)
    pull, load = [{"name": "added_stiffness", "stiffness": 80.0, "rest": 0.4}], []
    for joint_torque in (False, True):
        pair = [[replace(r, joint_torque=joint_torque) for r in part] for part in (fit, judge)]
        case, _ = prepared(slide.model, *pair)
        load += residual.visible_specs(case, pull, {})
    (alone,) = residual.visible_specs(case, [], {})
    assert load[0] == load[1]
    assert abs(load[0]["load"] - alone["load"]) > 0.5 * 80.0 * 0.4


@pytest.mark.parametrize("channels", [1, 2, 3, 6, 35])
@pytest.mark.parametrize("times", [0.5, 1.0, 1.5, 3.0, 5.9, 20.0])
def test_of_many_values_few_are_used_of_each_channel_as_many(times, channels):
    ticks = int(times * residual.MAX_VALUES) // channels
    stride = residual._stride(np.zeros(ticks * channels), channels)
    used = np.arange(0, ticks * channels, stride) % channels
    assert len(used) <= residual.MAX_VALUES and (times > 1.0) == (stride > 1)
    assert np.ptp(np.bincount(used, minlength=channels)) <= 1
