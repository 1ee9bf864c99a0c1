# SPDX-License-Identifier: Apache-2.0
"""HyQ trots by model predictive control, and takes a push that throws the open loop over."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout

PUSH = {"name": "push", "force": [0.0, 500.0, 0.0], "start": 16.0, "stop": 16.2}  # 100 N·s


@pytest.fixture(scope="module")
def walk():
    changes = {"learner.train": 20.0, "sim.engine": "mujoco", "effects": [PUSH]}
    return rollout(load("hyq_trot_mpc", changes))


def test_hyq_trots_for_20_s_at_its_speed_and_survives_a_push(walk):
    assert walk.fall == "" and walk.t[-1] > 20.0
    before = (walk.t > 6.0) & (walk.t < 16.0)
    assert 0.2 < np.ptp(walk.position[before, 0]) / 10.0 < 0.3
    assert np.ptp(walk.position[before, 1]) < 0.1


def test_gait_and_plan_have_one_duty_factor():
    with pytest.raises(ParameterError, match="trunk.mpc.duty_factor is 0.5.*gait, 0.6"):
        load("hyq_trot_mpc", {"gait.duty_factor": 0.6})
    load("hyq_trot_mpc", {"gait.duty_factor": 0.6, "trunk.mpc.duty_factor": 0.6})
    load("hyq_trot_open", {"gait.duty_factor": 0.6})
