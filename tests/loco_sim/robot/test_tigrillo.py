# SPDX-License-Identifier: Apache-2.0
"""Tigrillo has the sizes and masses of the thesis, stands on its springs and sits down."""

import numpy as np
import pytest

from loco_control.types import MotionCommand
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.description import Description
from loco_sim.world.world import make_world
from loco_workshop.make_urdf import tigrillo as tigrillo_urdf

KNEES = [1, 3, 5, 7]


@pytest.fixture(scope="module")
def tigrillo():
    return robot.load("tigrillo")


def sine(tigrillo, seconds, **sim):
    """Joint angles [rad] while all hips swing 30 degrees at 2 rad/s, (ticks, 8)."""
    angles = []
    with Simulation(tigrillo.sim.replace(**sim), robot=tigrillo) as plant:
        for k in range(round(seconds / plant.dt)):
            hips = np.deg2rad(30.0) * np.sin(2.0 * k * plant.dt)
            plant.step(MotionCommand(k, k * plant.dt, np.full(8, hips), np.zeros(8)))
            angles.append(plant.true_q)
        assert plant.fallen is None
    return np.array(angles)


def test_the_urdf_is_the_one_that_is_written(tigrillo):
    file = tigrillo.folder / "tigrillo.urdf"
    assert file.read_text() == tigrillo_urdf.write()


def test_it_weighs_what_the_thesis_weighed(tigrillo):
    described = Description(tigrillo.urdf)
    assert described.mass() == pytest.approx(0.95, abs=5e-4)
    for link, mass in (("front_body", 0.712), ("hind_body", 0.238), ("lf_upper_leg", 0.043)):
        assert sum(map(described.mass_of, described.below(link))) == pytest.approx(mass)


def test_feet_are_a_wheelbase_and_a_track_apart_and_ahead_of_the_hips(tigrillo):
    """Facts of the author's model: 0.15 m, 0.149 and 0.099 m, hip 0.122 m high at rest."""
    rest = np.tile([0.0, np.deg2rad(33.807)], 4)
    world = make_world(tigrillo, tigrillo.sim, 0.001)
    world.rebuild(rest)
    lf, rf, lh, rh = (np.array(world.place(foot)) for foot in tigrillo.feet)
    hip = np.array(world.place("lf_upper_leg"))
    assert lf[0] - lh[0] == pytest.approx(0.15, abs=1e-6)
    assert lf[1] - rf[1] == pytest.approx(0.149, abs=1e-6)
    assert lh[1] - rh[1] == pytest.approx(0.099, abs=1e-6)
    assert lf[0] - hip[0] == pytest.approx(0.031, abs=5e-4)
    assert hip[2] - lf[2] + 0.006 == pytest.approx(0.122, abs=5e-4)
    world.close()


def test_it_stands_still_on_its_springs(tigrillo):
    with Simulation(robot=tigrillo) as plant:
        angles = []
        for k in range(250):
            command = MotionCommand(k, k * plant.dt, tigrillo.standing, np.zeros(8))
            state = plant.step(command)
            angles.append(plant.true_q)
        assert plant.fallen is None
        assert state.contact.all()
        assert state.grf[:, 2].sum() == pytest.approx(0.95 * 9.81, rel=0.05)
        # The hips hunt by a step of their encoders, as such servos do.
        assert np.ptp(angles[-100:], axis=0).max() < np.deg2rad(1.5)
        stops = [tigrillo.springs[tigrillo.joints[i]].stop for i in KNEES]
        assert np.all(plant.true_q[KNEES] > np.array(stops) - 0.01)
        assert np.all(plant.true_q[[1, 3]] > np.array(stops[:2]) + 0.05)  # springs carry


def test_it_stands_up_and_sits_down_with_its_hips(tigrillo):
    knees = np.rad2deg(sine(tigrillo, 4.0)[200:, KNEES])
    assert np.all(np.ptp(knees, axis=0) > 10.0)


def test_stiffer_springs_move_less(tigrillo):
    stiff = robot.load("tigrillo", {"springs.?h_kfe_joint.stiffness": 440.6})
    soft, hard = (np.ptp(sine(each, 4.0)[200:, [5, 7]], axis=0) for each in (tigrillo, stiff))
    assert np.all(hard < 0.5 * soft)


def test_a_finer_step_gives_the_same_knees(tigrillo):
    """The light legs and their dampers are resolved at 1 kHz."""
    coarse, fine = (sine(tigrillo, 1.5, physics_rate=rate)[:, KNEES] for rate in (1e3, 5e3))
    assert np.rad2deg(np.sqrt(np.mean((coarse - fine) ** 2))) < 0.3


def test_deep_contacts_let_the_feet_sink_in(tigrillo):
    heights = []
    for depth in (0.0005, 0.005):
        soft = robot.load("tigrillo", {"contacts.*_foot.depth": depth})
        with Simulation(robot=soft) as plant:
            for k in range(150):
                plant.step(MotionCommand(k, k * plant.dt, soft.standing, np.zeros(8)))
            heights.append(plant.ground_truth().position[2])
    assert heights[0] - heights[1] == pytest.approx(0.0045, rel=0.5)
