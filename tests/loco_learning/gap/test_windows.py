# SPDX-License-Identifier: Apache-2.0
"""Pieces begin where the robot was, and a right model stays there."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap import windows
from loco_learning.gap.forward import Forward, ForwardParams
from loco_learning.gap.record import Record
from loco_learning.joint_experiment import JointExperiment
from loco_learning.joint_reflex import JointLearnerParams
from loco_learning.joint_rollout import rollout
from loco_sim.model import Model

SHORT = ForwardParams(window=0.2)


def swinging(effects: list | None = None, rows: int = 400) -> Record:
    """A pendulum that is thrown about by a torque."""
    t = np.arange(rows) / 200.0
    push = np.sin(9.0 * t)[:, None] + 0.7 * np.sin(2.3 * t)[:, None]
    silent = Record("p", t, {"torque": push}, ("pivot",), {"q": 0.0 * push}, ("pivot",))
    q = Forward(Model("pendulum", {}, effects or []), [silent])()[0]
    return Record("p", t, {"torque": push}, ("pivot",), {"q": q}, ("pivot",))


def test_smoothing_gives_value_and_rate_of_a_noisy_wave():
    t = np.arange(500) * 0.005
    noisy = np.sin(6.0 * t) + np.random.default_rng(0).normal(0.0, 1e-3, len(t))
    level, rate = windows.smoothed(noisy, 0.005)
    assert np.std(level - np.sin(6.0 * t)) < 7e-4
    assert np.std(rate - 6.0 * np.cos(6.0 * t)) < 0.09


def test_smoothing_of_exact_samples_changes_little_and_bridges_a_gap():
    t = np.arange(300) * 0.005
    exact = np.sin(6.0 * t)
    exact[40] = np.nan
    level, rate = windows.smoothed(exact, 0.005)
    assert np.isnan(level[40]) and np.isnan(rate[40])
    assert np.nanmax(np.abs(level - np.sin(6.0 * t))) < 3e-4
    assert np.nanmax(np.abs(rate - 6.0 * np.cos(6.0 * t))[3:-3]) < 0.02


def test_noise_is_found_under_a_wave():
    wave = np.sin(np.arange(4000) * 0.05)
    noisy = wave + np.random.default_rng(1).normal(0.0, 0.01, 4000)
    assert windows.noise_of(noisy) == pytest.approx(0.01, rel=0.1)


def test_pieces_follow_each_other_and_the_right_model_stays_in_them():
    record = swinging()
    forward = Forward(Model("pendulum"), [record], SHORT)
    error = forward()[0] - forward.measured[0]
    starts = windows.pieces(record, forward.robot(), 0.2)
    assert [s.row for s in starts] == list(range(0, 400, 40))
    assert np.isnan(error[[0, 1, 2, 3, 40, 41, 42, 43]]).all()
    assert np.sqrt(np.nanmean(error**2)) < 5e-3 * np.std(record.signals["q"])


def test_pieces_tell_a_wrong_model_from_the_right_one():
    effect = {"name": "coulomb_friction", "torque": 0.2}
    forward = Forward(Model("pendulum"), [swinging([effect])], SHORT)
    wrong, right = (
        np.sqrt(np.nanmean((p[0] - forward.measured[0]) ** 2))
        for p in (forward(), forward([effect]))
    )
    assert wrong > 10.0 * right


def test_a_walking_robot_is_put_where_it_was():
    experiment = JointExperiment(
        robot="tigrillo",
        duration=0.6,
        overrides={"sensors.exact": True},
        learner=JointLearnerParams(enabled=False),
    )
    log, plant = rollout(experiment), experiment.plant
    signals = {"q": log.q, "base_position": log.position, "base_orientation": log.orientation}
    said = {"position": log.command, "velocity": log.command_dq}
    driven = tuple(plant.joints[i] for i in plant.driven)
    record = Record("walk", log.t, said, driven, signals, plant.joints).rows(10, 60)
    forward = Forward(Model("tigrillo"), [record], ForwardParams(window=0.1))
    error, wanted = forward()[0] - forward.measured[0], forward.measured[0]
    names = [str(channel) for channel in forward.channels]
    height = names.index("base_position z")
    assert np.isfinite(error[9]).all()
    assert np.nanmax(np.abs(error[:, height])) < 5e-3
    assert np.nanmean(error**2) < 0.05 * np.nanmean((wanted - np.nanmean(wanted, axis=0)) ** 2)
