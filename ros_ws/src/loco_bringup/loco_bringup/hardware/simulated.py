# SPDX-License-Identifier: Apache-2.0
"""Simulated servo bus, and the wiring file through which a driver connects to it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import ParameterError
from loco_control.reading import read_yaml
from loco_sim.effects.base import from_list
from loco_sim.hardware import wiring
from loco_sim.hardware.simulated_bus import SimulatedBus
from loco_sim.robot import robot as robots

_TIMEOUT = 0.02  # for a simulated bus, unless the file gives another latency [s]
FAULTS = ("lost", "garbled", "silent", "hot")


def make_bus(file: Path, robot: str, out: Path, effects: Sequence[dict[str, Any]] = ()) -> Any:
    """A simulated bus on a pseudo-terminal; `out` is a copy of `file` with that port.

    Args:
        file: Wiring file.
        robot: Robot, by name or path.
        out: New wiring file.
        effects: Deviations from the ideal robot, in the format of experiments.

    Raises:
        LocoError: The file does not match the robot, or an effect is invalid.
    """
    loaded = robots.load(robot)
    bus = SimulatedBus(wiring.load(file, loaded), loaded, from_list(effects))
    values = read_yaml(file, "wiring file")
    values["bus"] = {"latency": _TIMEOUT, **(values.get("bus") or {}), "port": bus.port}
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(yaml.safe_dump(values, sort_keys=False))
    return bus


class Failing:
    """Faults of a simulated bus, each with a start time.

    Args:
        texts: ``lost=SHARE``, ``garbled=SHARE``, ``silent=ID`` or ``hot=ID``, each followed by
            ``@SECONDS`` unless it is present from the start.

    Raises:
        ParameterError: A text has another form.
    """

    def __init__(self, specs: Sequence[str]):
        self._due = [_parsed(text) for text in specs]

    def check(self, bus: SimulatedBus, numbers: Sequence[int]) -> None:
        """Raise an error for servos that are not on the bus."""
        for kind, value, _ in self._due:
            if kind in ("silent", "hot") and value not in numbers:
                valid_numbers = ", ".join(map(str, numbers))
                raise ParameterError(
                    f"--fault {kind}={value:g}: the bus has the servos {valid_numbers}"
                )

    def apply(self, bus: SimulatedBus, t: float) -> None:
        """Activate the faults that are due at time t [s]."""
        for kind, value, start in [due for due in self._due if due[2] <= t]:
            self._due.remove((kind, value, start))
            if kind == "lost":
                bus.lost = value
            elif kind == "garbled":
                bus.garbled = value
            elif kind == "silent":
                bus.silence(int(value))
            else:
                bus.overheat(int(value))


def _parsed(text: str) -> tuple[str, float, float]:
    kind, _, value_text = text.partition("=")
    value, _, start = value_text.partition("@")
    try:
        number, start_time = float(value), float(start or 0.0)
    except ValueError:
        number = start_time = -1.0
    share = kind in ("lost", "garbled")
    is_valid = number <= 1.0 if share else number.is_integer()
    if kind not in FAULTS or not (number >= 0.0 and start_time >= 0.0 and is_valid):
        raise ParameterError(
            f"--fault must be lost=SHARE, garbled=SHARE, silent=ID or hot=ID, with @SECONDS for a "
            f"later start, got {text!r}"
        )
    return kind, number, start_time
