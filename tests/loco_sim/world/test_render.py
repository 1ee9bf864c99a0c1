# SPDX-License-Identifier: Apache-2.0
"""Animations show the robot, standing on the floor, and are files that play."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from loco_control.exceptions import ParameterError
from loco_sim.robot import robot as robots
from loco_sim.world import render
from loco_sim.world.figure import Figure
from loco_sim.world.render import frames, render_gif
from loco_sim.world.stage import Stage, look_at, perspective
from loco_workshop.make_urdf import hyq as hyq_urdf

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
    figure = Figure(hyq)
    figure.pose((0.0, 0.0, 0.62), (0.0, 0.0, 0.0, 1.0), hyq.standing)
    silhouette, lens = stage._shadow(figure, target)
    clip = np.column_stack([ground, np.zeros(len(ground)), np.ones(len(ground))]) @ lens.T
    place = (0.5 + 0.5 * clip[:, :2] / clip[:, 2:] * [1.0, -1.0]) * len(silhouette)
    column, row = place.astype(int).clip(0, len(silhouette) - 1).T
    dark = silhouette[row, column] / 255.0
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


# --- the figure itself -----------------------------------------------------------


def silhouette(figure, size=(60, 60)):
    """Which pixels a camera sees of a figure from a metre away, and their colours."""
    view = look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3))
    colours, seen = figure.picture(view, perspective(0.6, 1.0), size, (0.0, -1.0, 0.0))
    return colours, seen


def shape_robot(hyq, tmp_path, geometry, colour="1 0 0 1"):
    """HyQ's record with a single shape for a body."""
    urdf = (
        f'<robot name="one"><link name="base"><visual><geometry>{geometry}</geometry>'
        f'<material name="m"><color rgba="{colour}"/></material></visual></link></robot>'
    )
    return replace(hyq, urdf=urdf, joints=(), feet=(), standing=np.zeros(0), folder=tmp_path)


@pytest.mark.parametrize(
    ("geometry", "area"),  # seen from the side [m²]
    [
        ('<box size="0.2 0.1 0.3"/>', 0.2 * 0.3),
        ('<sphere radius="0.1"/>', np.pi * 0.01),
        ('<cylinder radius="0.1" length="0.3"/>', 0.2 * 0.3),
        ('<capsule radius="0.1" length="0.2"/>', 0.2 * 0.2 + np.pi * 0.01),
    ],
)
def test_a_shape_covers_its_own_area(hyq, tmp_path, geometry, area):
    _, seen = silhouette(Figure(shape_robot(hyq, tmp_path, geometry)), (400, 400))
    pixel = (2.0 * np.tan(0.3) / 400) ** 2
    # Things nearer than the middle look larger: by half the depth of 0.1 m at 1 m.
    assert area * 0.97 < seen.sum() * pixel < area * 1.25


def test_what_is_in_front_hides_what_is_behind(hyq, tmp_path):
    robot = shape_robot(hyq, tmp_path, '<box size="0.2 0.2 0.2"/>')
    behind = (
        '<visual><origin xyz="0 0.3 0"/><geometry><box size="0.2 0.2 0.2"/></geometry>'
        '<material name="n"><color rgba="0 1 0 1"/></material></visual>'
    )
    both = replace(robot, urdf=robot.urdf.replace("</link>", behind + "</link>"))
    colours, seen = silhouette(Figure(both))
    assert seen.any()
    assert (colours[seen][:, 0] > 0.5).all()  # all red


def test_a_mesh_file_is_drawn_and_a_missing_one_left_out(hyq, tmp_path, caplog):
    (tmp_path / "box.obj").write_text("v 0 0 0\nv 0.2 0 0\nv 0 0 0.2\nf 1 2 3\n")
    _, seen = silhouette(Figure(shape_robot(hyq, tmp_path, '<mesh filename="box.obj"/>')))
    assert seen.any()
    _, nothing = silhouette(Figure(shape_robot(hyq, tmp_path, '<mesh filename="no.obj"/>')))
    assert not nothing.any()
    assert "no.obj" in caplog.text


def test_a_robot_without_shapes_is_drawn_by_its_joints_and_masses(hyq, tmp_path):
    """A stick of 0.2 m down to the joint, and 0.3 kg of water around the forearm's centre."""
    urdf = (
        '<robot name="bare"><link name="base"/>'
        '<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.3"/></inertial></link>'
        '<joint name="j" type="fixed"><parent link="base"/><child link="arm"/>'
        '<origin xyz="0 0 -0.2"/></joint></robot>'
    )
    robot = replace(
        hyq, urdf=urdf, joints=(), feet=(), standing=np.zeros(0), folder=tmp_path
    )  # fmt: skip
    figure = Figure(robot)
    low, high = (getattr(figure.corners(0.0), which)(axis=0) for which in ("min", "max"))
    radius = (0.3 * 3.0 / (4.0 * np.pi * 1000.0)) ** (1.0 / 3.0)
    assert high[2] == pytest.approx(0.0, abs=0.01) and low[2] == pytest.approx(
        -0.3 - radius, abs=2e-3
    )
    _, seen = silhouette(figure)
    assert seen.any()


def test_a_robot_of_nothing_is_refused(hyq, tmp_path):
    robot = replace(
        hyq, urdf='<robot name="none"><link name="base"/></robot>', joints=(), feet=(),
        standing=np.zeros(0), folder=tmp_path,
    )  # fmt: skip
    with pytest.raises(ParameterError, match="nothing that could be drawn"):
        render_gif(None, np.arange(2.0), np.zeros((2, 3)), np.eye(4)[[3, 3]], np.zeros((2, 0)),
                   robot=robot)  # fmt: skip


LINK = """<link name="{0}"><visual><origin xyz="0 0 {1}"/><geometry><box size="0.1 0.1 {2}"/>
</geometry></visual><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
iyz="0"/></inertial></link>"""


@pytest.mark.parametrize("length", [0.2, 1.0, 4.0])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_bolted_robot_of_any_size_is_in_the_picture_in_all_its_poses(length, up, tmp_path):
    """Also an arm of four metres that swings, and one that hangs below its base."""
    joint = """<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>"""
    parts = LINK.format("base", 0.0, 0.1), LINK.format("arm", 0.5 * up * length, length)
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{"".join(parts)}{joint}</robot>')
    text = "urdf: arm.urdf\njoints: [hinge]\nfixed_base: true\nheight: 1.0\n"
    (tmp_path / "robot.yaml").write_text(text)
    robot = robots.load(tmp_path)
    figure, size = Figure(robot), (120, 80)
    angles = np.linspace(-1.4, 1.4, 30)
    poses = [(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0, 0, 1]), np.array([a])) for a in angles]
    stage, middle = render.camera(figure, size, poses)
    target = np.array([*middle[:2], stage._height])
    view, boxes = look_at(target + stage._eye, target), []
    assert target[2] + stage._eye[2] > 0.0  # the camera is over the floor
    for pose in poses:
        figure.pose(*pose)
        left, top, right, bottom = stage._box(figure.corners(0.0), view)
        assert 0 < left and 0 < top and right < size[0] and bottom < size[1]
        boxes.append((left, top, -right, -bottom))
    left, top, right, bottom = np.abs(np.min(boxes, axis=0))
    assert max((right - left) / size[0], (bottom - top) / size[1]) > 0.5  # and fills it
