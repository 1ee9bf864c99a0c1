# SPDX-License-Identifier: Apache-2.0
"""What no effect explains as a motion is compared as torques along the measured motion."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap import workflow
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.prediction import led
from loco_learning.gap.recordings.record import Record
from loco_sim.plant.model import Model

DT = 0.005
DAMPED = Model("pendulum", {"dynamics.pivot.damping": 0.1})


def swings(kind="torque", damping=0.1):
    """A joint under commands that its motion does not determine; positions are arbitrary."""
    t = DT * np.arange(3200)
    motion = (0.3 * np.sin(2.0 * t) + 0.2 * np.sin(5.0 * t))[:, None]
    if kind == "torque":  # of the rod's inertia, damping and weight
        motion, speed = motion, np.gradient(motion, DT, axis=0)
        told = 0.0267 * np.gradient(speed, DT, axis=0) + damping * speed + 0.98 * np.sin(motion)
    else:
        told = motion
    return Record("swings", t, {kind: told}, ("pivot",), {"q": motion}, ("pivot",))


@pytest.fixture
def verdicts(monkeypatch):
    """Searches that answer at once: by a motion, and by torques along it; returns what was kept."""

    def found(model, record, by_motion, by_torques, **settings):
        kept = []

        def search(model, records, held_out, params, report, workers, keep, memory):
            verdict = by_torques if params.inverse_dynamics else by_motion
            result = {"verdict": verdict, "names": ["armature"], "along": params.inverse_dynamics}
            keep(result, None)
            return result

        monkeypatch.setattr(workflow, "search", search)
        params = GapParams(setup=False, **settings)
        result = workflow.find(
            model, [record], params=params, keep=lambda result, _: kept.append(result)
        )
        assert kept[-1] == result
        return result["along"], len(kept)

    return found


@pytest.mark.parametrize(
    ("by_motion", "by_torques", "answer"),
    [("unknown", "named", (True, 2)), ("unknown", "unknown", (False, 1)),
     ("unknown", "no gap", (False, 1)), ("ambiguous", "named", (False, 1))],
)  # fmt: skip
def test_torques_answer_where_the_motion_does_not(verdicts, by_motion, by_torques, answer):
    assert verdicts(DAMPED, swings(), by_motion, by_torques) == answer


def test_only_where_torques_are_commanded_and_the_motion_was_compared(verdicts):
    follows, remembers = Model("servo_pendulum"), swings(damping=0.0)
    assert verdicts(follows, swings("position"), "unknown", "named") == (False, 1)
    assert verdicts(DAMPED, remembers, "unknown", "named") == (False, 1)
    assert workflow.forward_of(DAMPED, [remembers], GapParams()).how == led.InverseDynamics.how


def test_it_can_be_asked_for():
    params = GapParams(inverse_dynamics=True)
    forward = workflow.forward_of(DAMPED, [swings()], params)
    assert forward.how == led.InverseDynamics.how
    with pytest.raises(ParameterError, match="inverse_dynamics: every joint"):
        workflow.forward_of(Model("servo_pendulum"), [swings("position")], params)
