# SPDX-License-Identifier: Apache-2.0
"""Rough ground: what its heights are like, and that engines put it where they say."""

import numpy as np
import pytest

from loco_control.exceptions import LocoError
from loco_sim import effects
from loco_sim.engines import installed
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.terrain import CELL, REAR, SIDE, Patches, Terrain
from loco_sim.world.world import Base

HILLS = Terrain("uneven", 0.03, 0.4, 0, 0.8)


def settled(world, hyq, at, each=lambda t: None):
    """Places of the feet of a HyQ that stands up where it was put, [m] each."""
    world.put(hyq.standing, np.zeros(12), Base(at))
    for step in range(900):
        q, dq = world.joint_states()
        each(0.001 * step)
        world.step([400.0 * (a - b) - 20.0 * c for a, b, c in
                    zip(hyq.standing, q, dq, strict=True)])  # fmt: skip
    return [world.place(foot) for foot in hyq.feet]


def height_at(terrain, x, y):
    """Height between four neighbours [m]."""
    column, row = (x + REAR) / CELL, (y + SIDE) / CELL
    j, i = int(column), int(row)
    a, b = column - j, row - i
    h = terrain.heights
    low = (1 - a) * h[i, j] + a * h[i, j + 1]
    return (1 - b) * low + b * ((1 - a) * h[i + 1, j] + a * h[i + 1, j + 1])


@pytest.mark.parametrize("kind", ["uneven", "steps"])
def test_heights_have_the_roughness_asked_for_and_a_flat_start(kind):
    terrain = Terrain(kind, 0.03, 0.4, 3, 0.8)
    assert terrain.heights.std() == pytest.approx(0.03, rel=0.1)
    assert abs(terrain.heights.mean()) < 0.005
    for x, y in ((0.0, 0.0), (0.5, 0.5), (-0.7, 0.0)):
        assert height_at(terrain, x, y) == 0.0
    np.testing.assert_array_equal(terrain.heights, Terrain(kind, 0.03, 0.4, 3, 0.8).heights)
    assert not np.array_equal(terrain.heights, Terrain(kind, 0.03, 0.4, 4, 0.8).heights)


def test_hills_forget_each_other_over_their_length():
    h = HILLS.heights[:, 120:]  # beyond the flat start

    def likeness(cells):
        return float(np.mean(h[:, cells:] * h[:, :-cells]) / np.mean(h * h))

    assert likeness(round(0.4 / CELL)) == pytest.approx(np.exp(-1.0), abs=0.12)
    assert abs(likeness(round(1.2 / CELL))) < 0.15


@pytest.mark.parametrize("engine", installed())
def test_feet_stand_on_the_heights(engine):
    """A HyQ that is dropped somewhere rests on three feet at least, each on the ground there."""
    listed = [effects.make("terrain", roughness=0.03, length=0.4, flat=0.0)]
    terrain, hyq = Terrain("uneven", 0.03, 0.4, 0, 0.0), robot.load("hyq", {"sim.engine": engine})
    with Simulation(effects=listed, robot=hyq) as sim:
        sim.reset()
        world, gaps = sim._world, []
        for x, y in ((3.0, 1.0), (7.4, -2.0), (12.1, 0.3)):
            feet = settled(world, hyq, (x, y, 0.75))
            gaps.append(sorted(z - height_at(terrain, x, y) - 0.02175 for x, y, z in feet))
    assert np.all(np.abs(np.array(gaps)[:, :3]) < 1e-3)  # [m]
    assert np.all(np.array(gaps)[:, 3] > -1e-3)


@pytest.mark.parametrize("engine", installed())
def test_the_lowest_points_of_a_robot_do_not_depend_on_the_ground(engine):
    hyq, found = robot.load("hyq", {"sim.engine": engine}), []
    for listed in ([], [effects.make("terrain", roughness=0.1, flat=0.0)]):
        with Simulation(effects=listed, robot=hyq) as sim:
            sim._world.pose((3.0, 1.0, 2.0), (0.0, 0.0, 0.0, 1.0), hyq.standing)
            found.append(sim._world.lowest_points())
    flat, rough = found
    assert flat.keys() == rough.keys() >= set(hyq.feet)
    for link, point in flat.items():
        assert rough[link][2] == pytest.approx(point[2], abs=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.8])
def test_patches_cover_their_share_and_not_the_start(share):
    patches = Patches(share, 0.3, 2, 0.8)
    assert patches.soft.mean() == pytest.approx(share, rel=0.05)
    assert not any(
        patches.under(0.7 * np.cos(a), 0.7 * np.sin(a)) for a in np.arange(0.0, 6.3, 0.1)
    )
    np.testing.assert_array_equal(patches.soft, Patches(share, 0.3, 2, 0.8).soft)
    assert not np.array_equal(patches.soft, Patches(share, 0.3, 3, 0.8).soft)
    assert patches.under(1e6, 1e6) == patches.soft[-1, -1]


@pytest.mark.parametrize("engine", installed())
def test_a_foot_sinks_in_on_a_patch_and_comes_up_beside_it(engine):
    """Firm ground under a foot is firm again after a patch: what sinks in is who stands on one."""
    soft = {"compliance": 5e-5, "damping": 300.0, "length": 0.4, "flat": 0.0}
    patches, hyq = Patches(0.3, 0.4, 0, 0.0), robot.load("hyq", {"sim.engine": engine})
    depths = {True: [], False: []}
    with Simulation(effects=[effects.make("soft_patches", **soft)], robot=hyq) as sim:
        sim.reset()
        world, (acting,) = sim._world, sim._effects
        for x, y in ((1.6, 0.0), (3.0, 1.0), (5.2, -1.0), (7.4, -2.0)):
            feet = settled(world, hyq, (x, y, 0.65), lambda t: acting.on_step(world, t))
            for x_foot, y_foot, z in feet:
                depths[patches.under(x_foot, y_foot)].append(0.02175 - z)
    assert len(depths[True]) >= 3 and len(depths[False]) >= 3
    assert min(depths[True]) > 2e-3  # [m]
    assert max(depths[False]) < 1e-3


def test_mistakes_are_one_line():
    with pytest.raises(LocoError, match="kind .*'bumpy'"):
        effects.make("terrain", roughness=0.1, kind="bumpy")
    with pytest.raises(LocoError, match="does not apply to robot 'pendulum'"):
        Simulation(effects=[effects.make("terrain", roughness=0.1)],
                   robot=robot.load("pendulum")).reset()  # fmt: skip
