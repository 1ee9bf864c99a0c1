# SPDX-License-Identifier: Apache-2.0
"""Replay of held-out records with the exported MJCF, in a process with MuJoCo but not loco."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from loco_control.exceptions import DivergedError
from loco_control.files import write_whole
from loco_learning.gap.prediction import running
from loco_learning.gap.prediction.forward import Forward, true_starts
from loco_learning.gap.recordings.record import Record
from loco_sim.effects import from_list
from loco_sim.export.mjcf import mjcf
from loco_sim.export.portable import ELASTIC, FREE, IMPEDANCE, SERVO, Portable, portable
from loco_sim.plant.model import Model
from loco_sim.robot.robot import Robot

SCRIPT = Path(str(files("loco_sim.export") / "replay_mjcf.py"))
FINER, FASTEST = (16, 8, 4, 2, 1), 20000.0  # substeps per physics step, largest rate [Hz]


@dataclass(frozen=True)
class Compared:
    """Errors on one held-out record.

    Attributes:
        name: Name of the record.
        ours: Root mean square of measured minus predicted position by loco [rad], over all joints.
        theirs: The same error [rad] of MuJoCo with the exported file.
        joints: Both errors [rad] by joint.
    """

    name: str
    ours: float
    theirs: float
    joints: dict[str, tuple[float, float]]


def compare(
    model: Model,
    records: Sequence[Record],
    folder: Path,
    gear: str = ELASTIC,
    starts: Mapping[str, np.ndarray] | None = None,
) -> tuple[list[Compared], list]:
    """Errors on records, and notes on records that cannot be compared.

    If a search corrected the initial state of a record, both simulators use it (`starts`, by
    name: change of the positions, then velocities of the joints [rad, rad/s], (2n,)).

    Both use a sixteenth of the model's physics step, or the finest step that `FASTEST` allows:
    the integration errors are proportional to the step.

    ``replay_N.xml`` and ``replay_N.npz`` stay in the folder, as input of ``replay.py`` there.

    Raises:
        DivergedError: MuJoCo cannot simulate the file.
    """
    comparisons, notes = [], []
    for number, record in enumerate(records, 1):
        one = Model(model.robot, {**model.overrides, **record.overrides}, model.effects)
        exported = portable(one, gear)
        if not exported.robot.fixed_base:
            notes.append(f"{record.name}: not compared, its robot is not bolted")
            continue
        forward = Forward(one, [record])
        start = (starts or {}).get(record.name, np.zeros(0))
        forward = forward.begun_at([start]) if len(start) else forward
        columns = [i for i, channel in enumerate(forward.channels) if channel.signal == "q"]
        if not columns:
            notes.append(f"{record.name}: not compared, no position was measured")
            continue
        measured = forward.measured[0][:, columns]
        rate = forward.robot(0).sim.physics_rate
        finer = next(parts for parts in FINER if parts * rate <= FASTEST or parts == 1)
        predicted = forward(step=1.0 / finer)[0][:, columns]
        error = np.where(np.isfinite(measured), predicted - measured, np.nan)
        path = folder / f"replay_{number}.npz"
        path.with_suffix(".xml").write_text(mjcf(exported)[0], encoding="utf-8")
        arrays = _inputs(exported, record, forward, measured, columns)
        arrays["finer"] = np.array(float(finer))
        write_whole(path, lambda file, contents=arrays: np.savez_compressed(file, **contents))
        names = [forward.channels[i].name for i in columns]
        played, rms_joints = _played(path), np.sqrt(np.nanmean(error**2, axis=0)).tolist()
        joints = {name: (rms, played[name]) for name, rms in zip(names, rms_joints, strict=True)}
        sides = np.array(list(joints.values()))
        rms_loco, rms_mujoco = np.sqrt(np.mean(sides**2, axis=0)).tolist()
        comparisons.append(Compared(record.name, rms_loco, rms_mujoco, joints))
    return comparisons, notes


def _inputs(
    built: Portable, record: Record, forward: Forward, measured: np.ndarray, columns: list[int]
) -> dict[str, np.ndarray]:
    """Contents of ``replay.npz``: see `replay_mjcf`."""
    robot, inputs = built.robot, running.sequence(record, built.robot)
    q, dq = initial_state(record, robot, forward, 0)
    aligned = np.full((len(record.t), len(robot.joints)), np.nan)
    for column, channel in enumerate(columns):
        aligned[:, robot.joints.index(forward.channels[channel].name)] = measured[:, column]
    return {
        "dt": np.array(running.period(record)),
        "ctrl": commands(built, inputs),
        "ramps": np.array(float(any(inputs.ramps))),
        "power": np.ones((len(record.t), 2)) if inputs.power is None else inputs.power,
        "joints": np.array(robot.joints),
        "q": np.asarray(q, dtype=float),
        "dq": np.asarray(dq, dtype=float),
        "measured": aligned,
    }


def initial_state(
    record: Record, robot: Robot, forward: Forward, index: int
) -> tuple[np.ndarray, np.ndarray]:
    """Initial joint positions [rad] and velocities [rad/s] of a record, (n,) each."""
    effects = from_list(forward.model.effects)
    starts = true_starts(record, robot, effects, forward.starts[index])
    return (starts[0].q, starts[0].dq) if starts else (robot.standing, 0.0 * robot.standing)


def commands(built: Portable, inputs: running.CommandSequence) -> np.ndarray:
    """Actuator commands of the exported MJCF, (T, nu)."""
    columns = []
    for index, joint in enumerate(built.joints):
        q, dq, tau = (table[:, index] for table in (inputs.q, inputs.dq, inputs.tau))
        if joint.kind == IMPEDANCE:
            feedforward = joint.kd * dq + tau
            columns.append(q + feedforward / joint.kp if joint.kp else feedforward)
        elif joint.kind != FREE:
            step = built.robot.drives[joint.name].resolution if joint.kind == SERVO else 0.0
            if step:  # position commands are rounded to the resolution of the servo [rad]
                q = step * np.floor((q + joint.offset) / step + 0.5) - joint.offset
            columns.append(q if joint.kind == SERVO else tau)
    return np.stack(columns, axis=1)


def _played(path: Path) -> dict[str, float]:
    """Root mean square error of each joint [rad], from the replay script in a separate process."""
    command = [sys.executable, "-I", SCRIPT, path.with_suffix(".xml"), path]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode:
        message = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise DivergedError(f"MuJoCo cannot play {path.with_suffix('.xml').name}: {message}")
    return {name: rms for name, rms in json.loads(done.stdout).items() if np.isfinite(rms)}
