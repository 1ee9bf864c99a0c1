# SPDX-License-Identifier: Apache-2.0
"""What was measured on a robot: commands of its driven joints, angles of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import ParameterError
from loco_sim.robot import Robot

from ..joint_sensors import columns, passive_joints

GAP = 0.25  # longest silence that is bridged [s]


@dataclass(frozen=True)
class Recording:
    """Commands and sensor signals on one even time axis.

    Attributes:
        name: Where it comes from, for people.
        t: Times [s], even, (T,).
        command: Command that holds from each time on [rad], (T, m).
        q: Measured joint angles [rad], (T, n).
        driven: Joints of the command's columns.
        joints: Joints of the columns of `q`.
    """

    name: str
    t: np.ndarray
    command: np.ndarray
    q: np.ndarray
    driven: tuple[str, ...]
    joints: tuple[str, ...]

    @property
    def dt(self) -> float:
        """Time between samples [s]."""
        return float(self.t[1] - self.t[0])

    def command_of(self, robot: Robot) -> np.ndarray:
        """Command of the robot's driven joints, in the robot's order, (T, m).

        Raises:
            ParameterError: The recording lacks a driven joint.
        """
        wanted = [robot.joints[i] for i in robot.driven]
        return self.command[:, columns(self.name, wanted, self.driven, "commands", robot)]

    def sensors_of(self, robot: Robot) -> np.ndarray:
        """Measured angles of the joints that `passive` names, (T, J).

        Raises:
            ParameterError: The recording lacks a passive joint.
        """
        return self.q[:, columns(self.name, passive(robot), self.joints, "sensors", robot)]


def passive(robot: Robot) -> list[str]:
    """Joints that no motor drives: what they do shows the body. Tigrillo: its knees."""
    return [robot.joints[i] for i in passive_joints(robot)]


def align(
    name: str,
    states: tuple[np.ndarray, np.ndarray, Sequence[str]],
    commands: tuple[np.ndarray, np.ndarray, Sequence[str]],
    rate: float,
) -> Recording:
    """Put commands and states with their own stamps on one even time axis.

    A command holds until the next one, an angle is interpolated. The axis runs over
    the time that both cover.

    Args:
        name: Where it comes from.
        states: Stamps [s], (K,), joint angles [rad], (K, n), and names of the joints.
        commands: Stamps [s], (L,), commands [rad], (L, m), and names of the joints.
        rate: Samples per second of the result.

    Raises:
        ParameterError: No time in common, a long gap, or values that are not finite.
    """
    for what, (t, x, _) in (("joint states", states), ("joint commands", commands)):
        if len(t) < 2 or np.any(np.diff(t) < 0.0):
            raise ParameterError(f"{name}: the {what} need at least two samples in rising order")
        if np.max(np.diff(t)) > GAP:
            raise ParameterError(f"{name}: the {what} pause for {np.max(np.diff(t)):.2f} s")
        if not np.all(np.isfinite(x)):
            raise ParameterError(f"{name}: the {what} have values that are not finite")
    first = max(states[0][0], commands[0][0])
    last = min(states[0][-1], commands[0][-1])
    count = int((last - first) * rate + 1e-6) + 1
    if count < 2:
        raise ParameterError(f"{name}: states and commands have no time in common")
    t = first + np.arange(count) / rate
    row = np.searchsorted(commands[0], t + 1e-6, side="right") - 1
    q = np.stack([np.interp(t, states[0], column) for column in states[1].T], axis=1)
    return Recording(name, t, commands[1][row], q, tuple(commands[2]), tuple(states[2]))
