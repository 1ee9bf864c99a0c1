# SPDX-License-Identifier: Apache-2.0
"""A recording of a known body, made by replaying a quick sine on it."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.calibration.objective import replay
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.recording import Commands, Recording
from loco_sim.plant.model import Model
from loco_sim.robot import robot as robots

SEVEN = parameter_set("seven")
TRUTH = {**SEVEN.default, "stiffness_hind": 440.0, "friction_front": 0.3}
QUICK = CalibrationParams(skip=0.8, population=2, generations=2)


@pytest.fixture(scope="session")
def truth():
    return dict(TRUTH)


@pytest.fixture
def quick():
    return QUICK


@pytest.fixture(scope="session")
def recording():
    """Four and a half seconds of all hips at 1 Hz."""
    robot = robots.load("tigrillo")
    t = np.arange(450) * 0.01
    wave = 0.2 + 0.6 * np.sin(2.0 * np.pi * t)
    command = np.repeat(wave[:, None], len(robot.driven), axis=1)
    done = replay(Model("tigrillo", SEVEN.overrides(TRUTH)), Commands(t, command))
    knees = [j for j in robot.joints if "kfe" in j]
    hips = tuple(robot.joints[i] for i in robot.driven)
    return Recording("known", t, command, done.q, hips, tuple(knees))
