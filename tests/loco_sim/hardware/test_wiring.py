# SPDX-License-Identifier: Apache-2.0
"""The file that says which servo drives which joint."""

import pytest

from loco_control.exceptions import LocoError
from loco_sim.hardware import wiring
from loco_sim.robot import robot as robots


def load(tmp_path, text, robot="servo_pendulum"):
    path = tmp_path / "servos.yaml"
    path.write_text(text)
    return wiring.load(path, robots.load(robot))


def test_entries_are_joined_by_pattern(tmp_path):
    text = "bus: {baud: 57600}\nservos:\n  '*': {current: 2.0, sign: -1}\n  pivot: {id: 7}"
    wired = load(tmp_path, text)
    (servo,) = wired.servos
    later = load(tmp_path, text + "\n  p*: {current: 3.0}").servos[0]
    assert (later.id, later.sign, later.current) == (7, -1, 3.0)
    assert (wired.bus.baud, servo.id, servo.sign, servo.current) == (57600, 7, -1, 2.0)


def test_servos_are_in_the_order_of_the_robot_and_the_port_may_be_another(tmp_path, quadruped):
    path = quadruped("a1", fixed_base=True, drives={"*": {"kind": "servo"}})
    robot = robots.load(path)
    numbers = {joint: 100 + i for i, joint in enumerate(robot.joints)}
    entries = "".join(f"  {j}: {{id: {n}}}\n" for j, n in reversed(numbers.items()))
    file = tmp_path / "servos.yaml"
    file.write_text(f"bus: {{port: /dev/ttyA}}\nservos:\n{entries}")
    wired = wiring.load(file, robot, "/dev/ttyB")
    assert [servo.id for servo in wired.servos] == list(numbers.values())
    assert wired.bus.port == "/dev/ttyB" and wiring.load(file, robot).bus.port == "/dev/ttyA"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("servos: 3", "servos must be a mapping"),
        ("bus: {}", "must have the keys bus and servos"),
        ("servos: {}\nmore: 1", "no others"),
        ("servos: {pivot: 3}", "servos.pivot must be a mapping"),
        ("servos: {pivot: {}}", "pivot needs servos.pivot.id"),
        ("servos: {knee: {id: 1}}", "knee"),
        ("servos: {pivot: {id: 253}}", r"servos.pivot.id must be in \[0, 252\]"),
        ("servos: {pivot: {id: 1.5}}", "whole number"),
        ("servos: {pivot: {id: 1, sign: 0}}", "sign must be 1 or -1"),
        ("servos: {pivot: {id: 1, zero: 4096}}", r"in \[0, 4095\]"),
        ("servos: {pivot: {id: 1, current: .inf}}", "current"),
        ("servos: {pivot: {id: 1, colour: 2}}", "colour"),
        ("bus: {baud: 12345}\nservos: {pivot: {id: 1}}", "bus.baud must be one of"),
        ("bus: {watchdog: 3}\nservos: {pivot: {id: 1}}", "watchdog"),
        ("servos: [", "line 1"),
    ],
)
def test_mistakes_are_named(tmp_path, text, words):
    with pytest.raises(LocoError, match=words):
        load(tmp_path, text)


@pytest.mark.parametrize(
    ("robot", "words"),
    [("tigrillo", "its base moves"), ("hyq_leg", "impedance"), ("spring_mass", "has no drive")],
)
def test_robots_that_servos_cannot_drive_are_refused(tmp_path, robot, words):
    with pytest.raises(LocoError, match=words):
        load(tmp_path, "servos: {'*': {id: 1}}", robot)


def test_two_joints_do_not_share_a_servo(tmp_path, quadruped):
    path = quadruped("a1", fixed_base=True, drives={"*": {"kind": "servo"}})
    with pytest.raises(LocoError, match="must be its own"):
        load(tmp_path, "servos: {'*': {id: 1}}", str(path))
