# SPDX-License-Identifier: Apache-2.0
"""Proof, from the bag only, that the readout drives the joints in the test phase.

The bag contains the network at the first tick of the test phase and all its inputs
from then on. The network is run again on these inputs, without a target, and must
reproduce the recorded commands. No recorded flag is used.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError, LocoError
from loco_control.types import MotionCommand
from loco_learning.reflex.joint_sensors import passive_joints, sensor_vector
from loco_learning.reflex.network import ReflexNetwork
from loco_learning.reflex.schedule import TEST
from loco_learning.runs.log import Log

from ..bag.reader import Bag
from ..logs.bag_log import read_log

WEIGHTS = "weights.npz"
TOLERANCE = 1e-9  # [rad]; the difference is 0 on the same machine, another may round differently


@dataclass(frozen=True)
class ReadoutCheck:
    """Commands of the test phase compared with those of the recomputed network.

    Columns are the k positions that the network outputs [rad], then k velocities [rad/s]: for
    HyQ the 8 joints HFE and KFE, for other robots the driven joints.
    """

    t: np.ndarray  # [s], (T,)
    commanded: np.ndarray  # recorded commands, (T, 2k)
    recomputed: np.ndarray  # output of the network on its recorded inputs, (T, 2k)
    target: np.ndarray  # recorded target, (T, 2k)
    abduction: float  # largest difference of the other commands (HAA) from their targets
    what: str = "HFE and KFE"  # names of the driven joints

    @property
    def error(self) -> float:
        """Largest difference between command and network over ticks and columns."""
        return float(np.max(np.abs(self.commanded - self.recomputed)))

    @property
    def target_distance(self) -> np.ndarray:
        """Largest difference between command and target at each tick, (T,)."""
        return np.max(np.abs(self.commanded - self.target), axis=1)

    @property
    def drives(self) -> bool:
        """Whether every command equals the network's output, and none equals the target."""
        return self.error <= TOLERANCE < float(np.min(self.target_distance))

    def summary(self) -> str:
        """The result in one line."""
        verdict = "the readout drives" if self.drives else "the readout does NOT drive"
        count = self.commanded.shape[1] // 2
        positions = np.abs(self.commanded - self.target)[:, :count]
        return (
            f"{verdict} {self.what} from {self.t[0]:.3f} s to {self.t[-1]:.3f} s: over "
            f"{len(self.t)} ticks, commands are {self.error:.1g} at most from the network run "
            f"again, and {np.sqrt(np.mean(positions**2)):.1g} rad (rms) from the target"
        )


def check_readout(bag: Bag | str | Path) -> ReadoutCheck:
    """Recompute the network of a bag over its test phase.

    Raises:
        BagError: The bag has no network or no test phase, or ticks of the test phase are missing.
        MissingFileError: There is no such bag.
    """
    bag = bag if isinstance(bag, Bag) else Bag(bag)
    return check_log(read_log(bag), weights_of(bag))


def weights_of(bag: Bag) -> bytes:
    """Bytes of the network file in a bag.

    Raises:
        BagError: The bag has none: the run is open-loop or ended before the test phase.
    """
    if WEIGHTS not in bag.attachments():
        raise BagError(
            f"{bag.path.name} carries no {WEIGHTS}: the run had no network or ended before test"
        )
    return bag.attachment(WEIGHTS)


def check_log(log: Log, weights: bytes) -> ReadoutCheck:
    """`check_readout` for a log.

    Args:
        log: The run.
        weights: Bytes of the network file, written after the first tick of the test phase.

    Raises:
        BagError: The run has no network or no test phase, or ticks or network inputs are missing.
    """
    network = _load(weights)
    rows = _rows(log, network)
    felt, m = _felt(log, rows), log.target.shape[1]
    # The network gets no target, so its output cannot depend on it.
    nowhere = MotionCommand(0, 0.0, np.full(m, np.nan), np.full(m, np.nan))
    recomputed, ticks = [], log.ticks()
    for row, senses in zip(range(rows.start, rows.stop), felt, strict=True):
        command, _ = network.step(int(ticks[row]), float(log.t[row]), senses, nowhere)
        recomputed.append(np.concatenate((command.q, command.dq)))
    commanded = np.concatenate((log.command, log.command_dq), axis=1)[rows]
    target = np.concatenate((log.target, log.target_dq), axis=1)[rows]
    moved = np.concatenate((network.outputs, m + network.outputs))
    fixed = np.setdiff1d(np.arange(2 * m), moved)
    return ReadoutCheck(
        log.t[rows],
        commanded[:, moved],
        np.array(recomputed)[:, moved],
        target[:, moved],
        float(np.max(np.abs(commanded - target)[:, fixed], initial=0.0)),
        "HFE and KFE" if log.experiment.gait else "the driven joints",
    )


def _felt(log: Log, rows: slice) -> np.ndarray:
    """Inputs of the network, one row per tick."""
    if log.experiment.gait:
        return log.grf[rows, :, 2]
    robot, log = log.experiment.plant, log.cut(rows)
    passive = passive_joints(robot)
    felt = [sensor_vector(log.message("state", row), robot, passive) for row in range(len(log))]
    if np.isnan(felt).any():
        raise BagError("the IMU of the test phase is not in the bag")
    return np.array(felt)


def _rows(log: Log, network: ReflexNetwork) -> slice:
    """Ticks of the test phase after the first, which the saved network has already processed."""
    if not network.params.enabled:
        raise BagError("open loop: the network of this run is switched off")
    start = int(np.searchsorted([network.phase_at(t) for t in log.t], TEST))
    ticks = log.ticks()[start:]
    if len(ticks) < 2:
        raise BagError("the run has no test phase, so nothing shows that the readout drives")
    gaps = np.flatnonzero(np.diff(ticks) != 1)
    if len(gaps):
        raise BagError(
            f"tick {ticks[gaps[0]] + 1} of the test phase is not in the bag, so the network "
            "cannot be run again over what it felt"
        )
    return slice(start + 1, len(log))


def _load(weights: bytes) -> ReflexNetwork:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / WEIGHTS
        path.write_bytes(weights)
        try:
            return ReflexNetwork.load(path)
        except LocoError as error:
            raise BagError(str(error).replace(str(path), f"the bag's {WEIGHTS}")) from None
