# SPDX-License-Identifier: Apache-2.0
"""Animations show the robot, standing on the floor, and are files that play."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from loco_control.exceptions import ParameterError
from loco_sim import hyq_urdf
from loco_sim import robot as robots
from loco_sim.params import SimParams
from loco_sim.render import frames, render_gif
from loco_sim.stage import Stage, look_at, perspective
from loco_sim.world import World

SIZE = (180, 120)


@pytest.fixture
def recorded(hyq):
    """A second of a robot gliding forward: t, position, orientation, q."""
    t = np.arange(251) * 0.004
    position = np.column_stack([0.25 * t, 0.0 * t, np.full_like(t, 0.6217)])
    return t, position, np.tile([0.0, 0.0, 0.0, 1.0], (251, 1)), np.tile(hyq.standing, (251, 1))


def hues(picture):
    """Which legs' colours are in a picture."""
    pixels = np.asarray(picture).reshape(-1, 3) / 255.0
    pixels = pixels[np.ptp(pixels, axis=1) > 0.25]  # floor, sky and trunk are grey
    directions = pixels / np.linalg.norm(pixels, axis=1, keepdims=True)
    found = set()
    for leg, colour in hyq_urdf.COLOURS.items():
        aim = np.array(colour) / np.linalg.norm(colour)
        if (directions @ aim > 0.99).sum() > 5:
            found.add(leg)
    return found


def test_the_camera_comes_closer_to_a_small_robot():
    robot = robots.load("tigrillo")  # a quarter of the size of HyQ
    pose = np.zeros(1), np.array([[0.0, 0.0, 0.14]]), np.array([[0.0, 0.0, 0.0, 1.0]])
    picture = next(frames(*pose, robot.standing[None], size=SIZE, robot=robot))
    assert hues(picture) == set(hyq_urdf.COLOURS)  # both robots' legs have the same colours


def test_a_gif_plays_for_the_time_of_the_run(tmp_path, recorded):
    file = tmp_path / "run.gif"
    data = render_gif(file, *recorded, fps=5.0, size=SIZE)
    assert file.read_bytes() == data
    with Image.open(BytesIO(data)) as gif:
        assert gif.size == SIZE
        assert gif.n_frames == 6
        assert gif.info["duration"] == 200
        assert gif.info["loop"] == 0


def test_slow_motion_has_more_frames(recorded):
    assert len(list(frames(*recorded, fps=4.0, size=SIZE, speed=0.5))) == 9


def test_all_four_legs_are_seen(recorded):
    picture = next(frames(*recorded, size=SIZE))
    assert hues(picture) == set(hyq_urdf.COLOURS)


def test_the_camera_follows_and_the_floor_passes(recorded):
    first, *_, last = frames(*recorded, fps=2.0, size=SIZE)
    assert hues(last) == set(hyq_urdf.COLOURS)
    floor = (slice(90, 105), slice(100, 180))  # right of the feet, above the label's line
    change = np.asarray(first, float)[floor] - np.asarray(last, float)[floor]
    assert np.abs(change).max() > 10.0


def test_the_shadow_lies_under_the_robot(hyq):
    stage, target = Stage(SIZE), np.array([0.0, 0.0, 0.4])
    ground = stage._ground + target[:2]
    world = World(hyq, SimParams(), 0.001, visible=True)
    world.rebuild(hyq.standing)
    dark = stage._shadow(world, target, ground)
    world.close()
    under = np.linalg.norm(ground, axis=1) < 0.3
    far = np.linalg.norm(ground, axis=1) > 1.5
    assert dark[under].mean() > 0.3
    assert dark[far].max() == 0.0


def test_a_run_is_drawn_the_same_every_time(recorded):
    short = [x[:30] for x in recorded]
    assert render_gif(None, *short, size=SIZE) == render_gif(None, *short, size=SIZE)


def test_the_camera_looks_at_its_target():
    eye, target = np.array([1.0, -2.0, 0.7]), np.array([0.2, 0.1, 0.4])
    seen = perspective(0.6, 1.5) @ look_at(eye, target) @ [*target, 1.0]
    np.testing.assert_allclose(seen[:2], 0.0, atol=1e-12)
    assert seen[3] == pytest.approx(np.linalg.norm(eye - target))
    above = perspective(0.6, 1.5) @ look_at(eye, target) @ [*(target + [0, 0, 0.1]), 1.0]
    assert above[1] > 0.0
    assert above[0] == pytest.approx(0.0, abs=1e-12)


def test_a_robot_out_of_sight_leaves_the_floor(recorded):
    t, position, orientation, q = recorded
    away = position[:1] + [[0.0, 0.0, 40.0]]
    (picture,) = frames(t[:1], away, orientation[:1], q[:1], size=SIZE)
    assert hues(picture) == set()


@pytest.mark.parametrize("which", [1, 2, 3])
def test_arrays_that_do_not_fit_together_are_refused(recorded, which):
    arrays = list(recorded)
    arrays[which] = arrays[which][:-1]
    with pytest.raises(ParameterError, match="must have shape"):
        render_gif(None, *arrays)


def test_an_empty_run_is_refused():
    with pytest.raises(ParameterError):
        render_gif(None, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 12)))
