# SPDX-License-Identifier: Apache-2.0
"""`loco hardware`: check the servos of a robot, or simulate them."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from loco_control.exceptions import ParameterError
from loco_control.reading import parse_yaml
from loco_sim.hardware import wiring
from loco_sim.hardware.dynamixel import ServoRobot
from loco_sim.robot import robot as robots

from ..outcome import file_at
from ..terminal import console
from .simulated import Failing, make_bus

FILE = Path("results/simulated_servos.yaml")


def show_servos(a: argparse.Namespace) -> int:
    """Print the state of each servo, with the torque off; returns 1 if one has a fault.

    Raises:
        LocoError: The file does not match the robot, or a servo does not answer.
    """
    robot = robots.load(a.robot)
    servos = ServoRobot(wiring.load(a.file, robot), robot)
    try:
        state = servos.measure(0, 0.0)
        for joint, q, tau in zip(robot.joints, state.q, state.tau, strict=True):
            console.print(f"  {joint}: {q:+.3f} rad, {tau:+.3f} N·m")
        console.print(servos.fault or "all servos answer; the torque is off")
    finally:
        servos.close()
    return int(bool(servos.fault))


def simulate(a: argparse.Namespace) -> int:
    """Serve simulated servos until Ctrl-C or for some time; returns 0.

    Raises:
        LocoError: The file does not match the robot, or an option is wrong.
    """
    out = file_at(a.out, FILE)
    if out.exists() and out.samefile(a.file):
        raise ParameterError(f"--out {out} is the wiring file itself; choose another file")
    failing = Failing(a.fault)
    bus = make_bus(a.file, a.robot, out, parse_yaml(a.effects, "--effects") or [])
    try:
        failing.check(bus, sorted(bus.torques))
        console.print(f"servos of {a.robot} at {bus.port}; wiring file {out}")
        start_time = time.monotonic()

        def is_done() -> bool:
            t = time.monotonic() - start_time
            failing.apply(bus, t)
            return 0.0 < a.seconds <= t

        bus.serve(is_done)
    except KeyboardInterrupt:
        pass
    finally:
        bus.close()
    return 0
