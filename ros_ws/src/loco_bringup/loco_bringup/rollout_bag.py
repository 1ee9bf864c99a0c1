# SPDX-License-Identifier: Apache-2.0
"""A rollout without ROS, written as the same topics with the same bytes."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from loco_control.params import to_dict
from loco_control.ros.convert import Converter
from loco_control.ros.topics import topic
from loco_control.types import (
    GaitTarget,
    LearningState,
    MotionCommand,
    RobotState,
    Stance,
    TrunkTorque,
)
from loco_learning.experiment import Experiment
from loco_learning.reflex import PHASES

from .bag_writer import BagWriter, qos_dict
from .interfaces import definition, type_hash, type_name
from .run import Outcome, Progress, describe, duration_of

_TOPICS = {
    RobotState: "robot_state",
    GaitTarget: "gait_target",
    MotionCommand: "motion_command",
    LearningState: "learning_state",
    Stance: "stance",
    TrunkTorque: "trunk_torque",
}


class TickWriter:
    """Writes the dataclasses of a tick to a bag, each on its topic."""

    def __init__(self, writer: BagWriter):
        self._writer = writer
        self._pack = {cls: Converter(cls).pack for cls in _TOPICS}
        for name in _TOPICS.values():
            row = topic(name)
            kind = type_name(row.type)
            qos = [qos_dict(row.qos.reliable, row.qos.latched, row.qos.depth)]
            writer.add_topic("/" + name, kind, definition(kind), type_hash(kind), qos)

    def write(self, *values: Any) -> None:
        """Write values of `loco_control.types` in the order given."""
        for value in values:
            cls = type(value)
            self._writer.write("/" + _TOPICS[cls], self._pack[cls](value), round(value.t * 1e9))


def run_rollout(
    experiment: Experiment, folder: Path, on_progress: Callable[[Progress], None]
) -> Outcome:
    """Run an experiment in this process, without nodes, into a bag of six topics."""
    from loco_learning.rollout import rollout

    folder = Path(folder)
    writer = BagWriter(folder, describe(experiment, layout="rollout", clock="asap"))
    ticks = TickWriter(writer)
    progress = Progress(duration=duration_of(experiment))
    began = time.perf_counter()

    def on_tick(*values: Any) -> None:
        ticks.write(*values)
        state, learning = values[0], values[3]
        if state.tick % 250 == 0:
            progress.sim_time, progress.phase = state.t, PHASES[learning.phase]
            progress.real_time_factor = state.t / (time.perf_counter() - began)
            on_progress(progress)

    try:
        log = rollout(experiment, on_tick=on_tick)
    finally:
        text = yaml.safe_dump(to_dict(experiment), sort_keys=False)
        (folder / "experiment.yaml").write_text(text)
        writer.attach("experiment.yaml", text.encode())
        writer.close()
    outcome = Outcome(folder, fallen=bool(log.fall))
    outcome.text = log.fall or f"{log.t[-1]:.1f} s simulated"
    outcome.real_time_factor = log.t[-1] / (time.perf_counter() - began)
    return outcome
