# SPDX-License-Identifier: Apache-2.0
"""Measurements of a robot: commands of its driven joints, angles of its joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from loco_control.exceptions import ParameterError
from loco_sim.robot.robot import Robot

from ..reflex.joint_sensors import columns, passive_joints

GAP = 0.25  # longest gap that is interpolated [s]


@dataclass(frozen=True)
class Commands:
    """Commands to a robot on an even time axis.

    Attributes:
        t: Times [s], (T,).
        q: Commanded positions of the driven joints [rad], (T, m).
        dq: Commanded velocities [rad/s], (T, m); None is zero.
        torque: Feed-forward torque of all joints [N·m], (T, n); None is zero.
        stance: Flags of feet whose legs use the stance gains, (T, feet); None is all.
    """

    t: np.ndarray
    q: np.ndarray
    dq: np.ndarray | None = None
    torque: np.ndarray | None = None
    stance: np.ndarray | None = None

    def part(self, rows: np.ndarray) -> Commands:
        """The commands at the selected times."""
        cut = {name: None if x is None else x[rows] for name, x in vars(self).items()}
        return replace(self, **cut)


@dataclass(frozen=True)
class Recording:
    """Commands and sensor signals on one even time axis.

    Attributes:
        name: Origin of the recording, for messages.
        t: Times [s], evenly spaced, (T,).
        command: Command from each time on [rad], (T, m).
        q: Measured joint angles [rad], (T, n).
        driven: Joints of the command's columns.
        joints: Joints of the columns of `q`.
        velocity: Commanded velocity of the driven joints [rad/s], (T, m); None if not commanded.
        torque: Feed-forward torque of the robot's joints [N·m], (T, n), in the robot's order;
            None if not commanded.
        stance: Flags of feet whose legs use the stance gains, (T, feet), in the robot's order;
            None is all.
    """

    name: str
    t: np.ndarray
    command: np.ndarray
    q: np.ndarray
    driven: tuple[str, ...]
    joints: tuple[str, ...]
    velocity: np.ndarray | None = None
    torque: np.ndarray | None = None
    stance: np.ndarray | None = None

    @property
    def dt(self) -> float:
        """Time between samples [s]."""
        return float(self.t[1] - self.t[0])

    def commands_of(self, robot: Robot) -> Commands:
        """Commands of the robot's driven joints, in the robot's order.

        Raises:
            ParameterError: The recording lacks a driven joint.
        """
        names = [robot.joints[i] for i in robot.driven]
        order = columns(self.name, names, self.driven, "commands", robot)
        velocity = None if self.velocity is None else self.velocity[:, order]
        return Commands(self.t, self.command[:, order], velocity, self.torque, self.stance)

    def sensors_of(self, robot: Robot) -> np.ndarray:
        """Measured angles of the compared joints (`compared`), (T, J).

        Raises:
            ParameterError: The recording lacks one of these joints.
        """
        return self.q[:, columns(self.name, compared(robot), self.joints, "sensors", robot)]


def compared(robot: Robot) -> list[str]:
    """Joints whose motion depends on the body parameters.

    These are the joints without a motor, as Tigrillo's knees; if all have one, as on HyQ, all.
    """
    return [robot.joints[i] for i in passive_joints(robot)] or list(robot.joints)


def align(
    name: str,
    states: tuple[np.ndarray, np.ndarray, Sequence[str]],
    commands: tuple[np.ndarray, np.ndarray, Sequence[str]],
    rate: float,
    extra: Mapping[str, np.ndarray] | None = None,
) -> Recording:
    """Commands and states with their own time stamps on one even time axis.

    A command holds until the next one, an angle is interpolated. The axis covers the time
    that both have in common.

    Args:
        name: Origin of the recording.
        states: Time stamps [s], (K,), joint angles [rad], (K, n), and names of the joints.
        commands: Time stamps [s], (L,), commands [rad], (L, m), and names of the joints.
        rate: Sampling rate of the result [Hz].
        extra: Arrays `velocity`, `torque` and `stance` of a `Recording`, at the time stamps of
            the commands, (L, …).

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
    held = {key: values[row] for key, values in (extra or {}).items()}
    return Recording(name, t, commands[1][row], q, tuple(commands[2]), tuple(states[2]), **held)
