# SPDX-License-Identifier: Apache-2.0
"""Trial of a new robot in the engine: standing, or swinging for a fixed base."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import DivergedError, LocoError
from loco_control.types import MotionCommand

from ..geometry import roll_pitch, rotation_matrix
from ..plant.simulation import Simulation
from ..robot import robot as robots

STAND_TIME, SWINGS = 5.0, 2.0  # durations of a trial [s]; a robot stands as long in its experiment
QUIET = 0.5  # at its end the robot must be at rest for this time [s]
MIN_HEIGHT = 0.2  # minimum base height used for the tolerances, share of the size
SINKS = 0.15  # largest sinking of the base, share of its height
TILTS = 0.15  # largest tilt [rad]
GIVES = 0.25  # largest deflection of a joint [rad or m]
MOVES = 0.01  # largest height change of the base at the end, share of its height
FOLLOWS = 0.5  # largest RMS tracking error, share of the swing
SWING = 0.5  # frequency of the swing [Hz]


@dataclass(frozen=True)
class Outcome:
    """The result of a trial.

    Attributes:
        fault: Reason of a failure, "" if the trial passed.
        sank: Distance that the base sank [m].
        gave: Largest position error of a joint, RMS for a swing [rad or m].
        load: Largest joint torque / effort limit [-].
        missed: Joints that do not follow their swing.
    """

    fault: str
    sank: float = 0.0
    gave: float = 0.0
    load: float = 0.0
    missed: tuple[str, ...] = ()


def stand(robot: robots.Robot, size: float) -> Outcome:
    """Hold the standing posture for `STAND_TIME`.

    Args:
        robot: The robot.
        size: Longest side of the robot [m].
    """
    rows, load = [], 0.0
    try:
        with Simulation(robot=robot) as plant:
            start = plant.ground_truth().position[2]
            for k in range(round(STAND_TIME / plant.dt)):
                zero_speed = np.zeros(len(robot.joints))
                state = plant.step(MotionCommand(k, k * plant.dt, robot.standing, zero_speed))
                truth = plant.ground_truth()
                rows.append((truth.position[2], *roll_pitch(rotation_matrix(truth.orientation))))
                load = max(load, _load(state.tau, robot))
                if plant.fallen:
                    return Outcome(f"it falls after {k * plant.dt:.1f} s ({plant.fallen})")
            held = np.array([getattr(robot.drives.get(j), "kp", 0.0) > 0.0 for j in robot.joints])
            gave = np.abs(plant.true_q - robot.standing)[held].max(initial=0.0)
            quiet = np.array(rows)[-round(QUIET / plant.dt) :]
    except DivergedError:
        return Outcome("its gains are not stable at the physics step")
    except LocoError as error:
        return Outcome(str(error))
    sank, size = start - quiet[-1, 0], max(start, MIN_HEIGHT * size)
    tilt = np.abs(quiet[:, 1:]).max()
    if tilt > TILTS:
        return Outcome(f"it tilts by {math.degrees(tilt):.0f} degrees", sank, gave, load)
    if abs(sank) > SINKS * size:
        return Outcome(f"it sinks by {sank:.3f} m", sank, gave, load)
    if gave > GIVES:
        return Outcome(f"a joint gives way by {gave:.2f} rad", sank, gave, load)
    if np.ptp(quiet[:, 0]) > MOVES * size:
        return Outcome("it does not come to rest", sank, gave, load)
    return Outcome("", float(sank), float(gave), load)


def swing(robot: robots.Robot, amplitude: np.ndarray) -> Outcome:
    """Swing all joints about the standing posture for `SWINGS`.

    Args:
        robot: A robot with a fixed base.
        amplitude: Swing amplitude of each joint [rad or m], (n,).
    """
    w, missed, load = 2.0 * np.pi * SWING, [], 0.0
    try:
        with Simulation(robot=robot) as plant:
            for k in range(round(SWINGS / plant.dt)):
                t = k * plant.dt
                grown, growth = (t, 1.0) if t < 1.0 else (1.0, 0.0)
                q = robot.standing + grown * amplitude * np.sin(w * t)
                dq = amplitude * (growth * np.sin(w * t) + grown * w * np.cos(w * t))
                state = plant.step(MotionCommand(k, t, q, dq))
                missed.append(plant.true_q - q)
                load = max(load, _load(state.tau, robot))
    except DivergedError:
        return Outcome("its gains are not stable at the physics step")
    except LocoError as error:
        return Outcome(str(error))
    rms, size = np.sqrt(np.mean(np.square(missed), axis=0)), np.abs(amplitude)
    rms = np.where(np.isin(np.arange(len(rms)), robot.driven), rms, 0.0)  # driven joints only
    i_max = int(np.argmax(rms / np.maximum(size, 1e-9)))
    if rms[i_max] > FOLLOWS * size[i_max]:
        name = robot.joints[i_max]
        fault = f"joint {name!r} misses its swing of {size[i_max]:.2g} by {rms[i_max]:.2g}"
        failed = zip(robot.joints, rms > FOLLOWS * size, strict=True)
        return Outcome(fault, 0.0, float(rms.max()), load, tuple(n for n, large in failed if large))
    return Outcome("", 0.0, float(rms.max()), load)


def _load(tau: np.ndarray, robot: robots.Robot) -> float:
    limited = np.isfinite(robot.effort) & (robot.effort > 0.0)
    return float((np.abs(tau)[limited] / robot.effort[limited]).max(initial=0.0))
