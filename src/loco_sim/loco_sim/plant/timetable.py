# SPDX-License-Identifier: Apache-2.0
"""Precomputed actions of effects that do not depend on the state of the robot.

They are input data for a compiled loop: commands as received by the drives, and random forces
and friction changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..effects.base import Effect, overrides, windows
from ..effects.catalogue.actuator import JointOffset, SeriesElasticity
from ..effects.pulls import CONSTANTS, Pulls

Window = tuple[int, float, Any]  # first step, step after the last, function


def commanding(effects: Sequence[Effect], dt: float) -> list[Window]:
    """Hooks `on_command`, except those of series springs, whose deflection depends on the state."""
    entries = windows(effects, "on_command", dt)
    return [w for w in entries if not isinstance(w[2].__self__, SeriesElasticity)]


def behind_springs(effects: Sequence[Effect]) -> str:
    """Reason why commands cannot be precomputed; "" if they can."""
    spring = False
    for effect in (e for e in effects if overrides(e, "on_command") and not e.absent()):
        if spring and not isinstance(effect, (JointOffset, SeriesElasticity)):
            return f"{effect.name} comes after series_elasticity"
        spring |= isinstance(effect, SeriesElasticity)
    return ""


def received(
    changes: Sequence[Window],
    targets: Sequence[tuple[np.ndarray, np.ndarray]],
    which: np.ndarray,
    remaining: np.ndarray,
    first: int,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Commands received by the drives, (k, COMMANDS, n), and their index at each physics step.

    Args:
        changes: Hooks of `commanding`.
        targets: Desired positions and velocities of each command, (n,) each.
        which: Command index of each physics step.
        remaining: Remaining rows of each command.
        first: Number of the first physics step.
        dt: Physics step [s].
    """
    # Effects detect a new command by object identity, so each command has its own objects.
    numbers: dict[tuple[int, int, int], int] = {}
    table, index, references = [], np.empty_like(which), []
    for at, row in enumerate(which):
        q, dq = targets[row]
        for start, end, change in changes:
            if start <= first + at < end:
                q, dq = change(q, dq, (first + at) * dt)
        key = id(q), id(dq), int(row)
        if key not in numbers:
            numbers[key] = len(table)
            table.append(np.stack([q, dq, *remaining[row]]))
            references.append((q, dq))
        index[at] = numbers[key]
    return np.array(table), index


class Script:
    """Recorder of the actions of hooks `on_step`, step by step, for effects that are `blind`.

    Args:
        frames: Frame of each link: body, origin and rotation in it; None stands for the root link.
        shapes: Indices of the shapes of each link.
    """

    def __init__(self, frames: Mapping[str | None, Any], shapes: Mapping[str, Sequence[int]]):
        self._frames, self._shapes = frames, shapes

    def write(
        self, acts: Sequence[Window], first: int, stop: int, dt: float
    ) -> tuple[Pulls, tuple[np.ndarray, np.ndarray]]:
        """Forces, and changes of friction: step and shape, (c, 2), and the new value, (c,).

        Args:
            acts: Hooks `on_step`.
            first: Number of the first step.
            stop: Step after the last.
            dt: Physics step [s].
        """
        self._body, self._window, self._const = [], [], []
        self._shape, self._value = [], []
        for step in range(first, stop):
            self._step = step
            for start, end, act in acts:
                if start <= step < end:
                    act(self, step * dt)
        forces = Pulls(
            np.array(self._body, np.int64),
            np.array(self._window, np.int64).reshape(-1, 2),
            np.array(self._const, float).reshape(-1, CONSTANTS),
        )
        return forces, (np.array(self._shape, np.int64).reshape(-1, 2), np.array(self._value))

    def push(
        self,
        force: Sequence[float],
        link: str | None = None,
        point: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """As `World.push`; an equal force in the next step extends the recorded one."""
        body, place, turn = self._frames[link]
        const = [*(place + turn @ np.array(point)), *force, 0.0, 0.0, 0.0, 0.0, 0.0]
        for k in range(len(self._body) - 1, -1, -1):
            if self._window[k][1] == self._step and (self._body[k], self._const[k]) == (
                body,
                const,
            ):
                self._window[k][1] = self._step + 1
                return
        self._body.append(body)
        self._window.append([self._step, self._step + 1])
        self._const.append(const)

    def set_friction(self, link: str, friction: float) -> None:
        """As `World.set_friction`."""
        for shape in self._shapes[link]:
            self._shape.append([self._step, shape])
            self._value.append(friction)
