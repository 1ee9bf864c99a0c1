# SPDX-License-Identifier: Apache-2.0
"""Proof, from a bag alone, that the readout drives a joint robot in the test phase.

As `readout_check` does for HyQ: the network of the bag is run again over the recorded
knees and IMU, without any target, and must give the recorded commands.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from loco_control.exceptions import BagError, LocoError
from loco_learning.joint_log import JointLog
from loco_learning.joint_reflex import JointReflex, passive_joints, sensor_vector
from loco_learning.schedule import TEST

from .readout_check import WEIGHTS, ReadoutCheck


def check_joint_log(log: JointLog, weights: bytes) -> ReadoutCheck:
    """Run the network of a bag again over the test phase.

    Args:
        log: The run.
        weights: Network file, written right after the first tick of test.

    Raises:
        BagError: The run has no network, no test phase, or misses ticks or senses in it.
    """
    network, start = _load(weights), int(np.searchsorted(log.phase, TEST))
    if len(log) - start < 2:
        raise BagError("the run has no test phase, so nothing shows that the readout drives")
    rows = slice(start + 1, len(log))  # the first tick of test is in the saved network already
    ticks = np.rint(log.t / log.dt).astype(int)
    if np.any(np.diff(ticks[start:]) != 1) or np.isnan(log.gyro[rows]).any():
        raise BagError("ticks or the IMU of the test phase are not in the bag")
    robot = log.experiment.plant
    passive, nowhere = passive_joints(robot), np.full(len(robot.driven), np.nan)
    recomputed = []
    for row in range(rows.start, rows.stop):
        felt = SimpleNamespace(
            q=log.q[row], angular_velocity=log.gyro[row], orientation=log.imu_orientation[row]
        )
        sensors = sensor_vector(felt, robot, passive)
        q, dq, *_ = network.step(int(ticks[row]), log.t[row], sensors, nowhere, nowhere)
        recomputed.append(np.concatenate((q, dq)))
    return ReadoutCheck(
        log.t[rows],
        np.concatenate((log.command, log.command_dq), axis=1)[rows],
        np.array(recomputed),
        np.concatenate((log.target, log.target_dq), axis=1)[rows],
        0.0,
        "the driven joints",
    )


def _load(weights: bytes) -> JointReflex:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / WEIGHTS
        path.write_bytes(weights)
        try:
            network = JointReflex.load(path)
        except LocoError as error:
            raise BagError(str(error).replace(str(path), f"the bag's {WEIGHTS}")) from None
    if not network.params.enabled:
        raise BagError("open loop: the network of this run is switched off")
    return network
