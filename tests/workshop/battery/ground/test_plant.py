# SPDX-License-Identifier: Apache-2.0
"""The battery's own plant of walking robots carries their weight and hides what it is told to."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.robot import robot as robots
from loco_workshop.battery.ground import hidden, walkers
from loco_workshop.battery.physics.hidden import Hidden

pytest.importorskip("pybullet")
from loco_workshop.battery.ground.plant import Ground  # noqa: E402 (it needs PyBullet)

HYQ = walkers.get("hyq_trot")
ROBOT = robots.load("hyq")
QUIET = dict.fromkeys(HYQ.noise, 0.0)
LOAD = Hidden("payload", "base_link", "mass",
              {"link": "base_link", "mass": 9.0, "position": [0.1, 0.0, 0.1]})  # fmt: skip


def stood(*effects, ticks=500, **more):
    """Readings of HYQ that is told to stand, with its mean forces on feet, and its truth."""
    walker = replace(HYQ, noise=QUIET, steps=8)
    plant = Ground(walker, ROBOT, ROBOT.standing, effects, **more)
    zeros, forces = np.zeros(12), []
    try:
        state = plant.reset()
        for tick in range(ticks):
            told = MotionCommand(tick, 0.004 * tick, ROBOT.standing, zeros)
            state = plant.step(told, TrunkTorque(tick, 0.0, zeros, np.zeros(6), np.ones(4, bool)))
            forces.append(state.grf)
        return replace(state, grf=np.mean(forces[ticks // 2 :], axis=0)), plant.ground_truth()
    finally:
        plant.close()


@cache
def bare_stood():
    return stood()


def test_feet_carry_the_robot_and_the_imu_feels_gravity():
    state, truth = bare_stood()
    assert state.grf[:, 2].sum() == pytest.approx(9.81 * HYQ.mass, rel=0.02)
    assert state.linear_acceleration == pytest.approx([0.0, 0.0, 9.81], abs=0.2)
    assert state.contact.all()
    assert 0.5 < truth.position[2] < 0.6  # legs give a little


def test_a_payload_is_carried_by_the_feet_too_and_more_by_the_nearer_ones():
    state, _ = stood(LOAD)
    assert state.grf[:, 2].sum() == pytest.approx(9.81 * (HYQ.mass + 9.0), rel=0.02)
    bare, _ = bare_stood()
    more = state.grf[:, 2] - bare.grf[:, 2]
    assert more[:2].sum() > more[2:].sum()  # front feet come first


def test_the_imu_tells_a_slope_and_a_tilt_and_the_weight_only_the_slope():
    flat, _ = bare_stood()
    sloped, _ = stood(Hidden("slope", "", "pitch", {"pitch": 0.06, "roll": 0.0}))
    tilted, _ = stood(Hidden("imu_tilt", "", "pitch", {"roll": 0.0, "pitch": -0.06, "yaw": 0.0}))
    pitch = [np.arcsin(2.0 * (w * y - z * x)) for x, y, z, w in
             (s.orientation for s in (flat, sloped, tilted))]  # fmt: skip
    assert pitch[1] - pitch[0] == pytest.approx(-0.06, abs=0.025)  # uphill is nose up
    assert pitch[2] - pitch[0] == pytest.approx(-0.06, abs=1e-3)
    shift = [s.grf[2:, 2].sum() - s.grf[:2, 2].sum() for s in (flat, sloped, tilted)]
    assert shift[1] - shift[0] > 20.0  # hind feet carry more uphill
    assert shift[2] == pytest.approx(shift[0], abs=1.0)


@pytest.mark.parametrize("name", [*hidden.KINDS, *hidden.OUTSIDERS])
@pytest.mark.parametrize("robot", walkers.WALKERS)
def test_each_effect_has_a_place_and_a_size_that_grows(name, robot):
    walker = walkers.get(robot)
    if name in hidden.OUTSIDERS:
        assert name not in hidden.KINDS
    made = [hidden.draw(name, walker, s, np.random.default_rng(3)) for s in
            ("small", "medium", "large")]  # fmt: skip
    assert all(e.effect == name and e.place in ("", *walker.joints, *walker.links) for e in made)
    if name not in ("slope", "imu_tilt"):
        sizes = [np.linalg.norm(e.params[e.strength]) for e in made]
    else:
        sizes = [np.hypot(e.params["pitch"], e.params["roll"]) for e in made]
    assert sizes == sorted(sizes) and sizes[0] > 0.0


def test_a_model_that_is_off_has_other_masses_and_motors_of_a_few_percent():
    here, there = hidden.motors(HYQ, False, 1), hidden.motors(HYQ, True, 1)
    assert set(here.values()) == {1.0}
    assert 0.005 < max(abs(v - 1.0) for v in there.values()) <= 0.03
    exact, off = (s.grf[:, 2].sum() for s, _ in (bare_stood(), stood(off=True, seed=5)))
    assert 1e-4 < abs(off / exact - 1.0) < 0.03
