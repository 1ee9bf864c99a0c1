# SPDX-License-Identifier: Apache-2.0
"""Cache of simulated limbs of a fixed-base robot.

Legs on a fixed trunk are dynamically independent. A search changes one leg at a time and needs
the motion of all, so the motion of a limb is cached by its inputs.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Sequence
from hashlib import blake2b
from typing import NamedTuple

import numpy as np

from ..effects.pulls import Pulls
from ..effects.rows import Laws
from ..multibody.tree import Tree
from .kernels import run

MAX_SIZE = 2**25  # size of the cache [bytes]
RECORDS = 8  # commands whose hashes are kept (taste: a search has so many records)


class RunInputs(NamedTuple):
    """Inputs of `kernels.run` for a tree of n joints.

    Attributes:
        tree: Joints and links of the robot.
        order: Index among the robot's joints of each joint of the tree, (n,).
        gravity: Acceleration of gravity [m/s²], (3,).
        segments: First row of each piece and the row after its last, (w, 2).
        starts: Initial state of each piece as in `loop.Segments`, in the robot's order, (w, 4, n).
        targets: Commands as in `actuators.drive_torques`, in the robot's order, (k, COMMANDS, n).
        which: Row of `targets` for each physics step, (T * steps,).
        power: Supply and switch of each row, (T, 2).
        drives: Drives as in `actuators.drive_torques`, (n, COLUMNS).
        springs: Springs as in `actuators.add_springs`, (n, 7).
        rotors: State of the drives as in `actuators.drive_torques`, (n, MEMORY).
        change: Laws of the effects on torques.
        brakes: Laws of the friction effects.
        pulls: External forces.
        stop_ratio: Values of `braking.stopped_per_torque` per piece, in the robot's order, (w, n).
        motor_torque: Whether the measured torques are those of the drives alone.
        dt: Physics step [s].
    """

    tree: Tree
    order: np.ndarray
    gravity: np.ndarray
    segments: np.ndarray
    starts: np.ndarray
    targets: np.ndarray
    which: np.ndarray
    power: np.ndarray
    drives: np.ndarray
    springs: np.ndarray
    rotors: np.ndarray
    change: Laws
    brakes: Laws
    pulls: Pulls
    stop_ratio: np.ndarray
    motor_torque: bool
    dt: float

    def of(self, limb: np.ndarray) -> RunInputs:
        """Inputs restricted to some joints of the tree, in the order of `limb`."""
        joints, bodies = self.order[limb], _numbered(limb, len(self.order))
        kin = self.tree.kin[limb]
        kin[:, 0] = bodies[kin[:, 0]]
        return self._replace(
            tree=Tree(kin, self.tree.body[limb], self.tree.fastest),
            order=np.arange(len(limb)),
            starts=_columns(self.starts, joints),
            targets=_columns(self.targets, joints),
            drives=self.drives[joints],
            springs=self.springs[joints],
            rotors=self.rotors[joints],
            change=_laws(self.change, _numbered(joints, len(self.order))),
            brakes=_laws(self.brakes, _numbered(joints, len(self.order))),
            pulls=_pulls(self.pulls, bodies),
            stop_ratio=_columns(self.stop_ratio, joints),
        )

    def digest(self, commands: bytes) -> bytes:
        """Hash of the inputs without memory and delay lines, which are zero at the start.

        Args:
            commands: Hash of `targets`, `which` and `power`, which are left out.
        """
        remaining = self._replace(targets=None, which=None, power=None)
        inputs = (*remaining, *self.tree, *self.change[:3], *self.brakes[:3], *self.pulls)
        arrays = [values for values in inputs if isinstance(values, np.ndarray)]
        return commands + _hash(arrays, self.tree.fastest, self.motor_torque, self.dt)


def limb_indices(kin: np.ndarray) -> list[np.ndarray]:
    """Joint indices of each limb (branch of the tree at the base), outwards, from `Tree.kin`."""
    root = np.arange(len(kin))
    for i, before in enumerate(kin[:, 0]):
        if before >= 0:
            root[i] = root[before]
    return [np.flatnonzero(root == first) for first in np.unique(root)]


class LimbCache:
    """Least-recently-used cache of the motion of limbs by their inputs.

    Attributes:
        asked: Number of limbs requested.
        known: Number of requested limbs found in the cache.
    """

    def __init__(self, max_size: int = MAX_SIZE):
        """Empty cache of at most `max_size` bytes."""
        self._max_size = max_size
        self.clear()

    def clear(self) -> None:
        """Clear the cache and its counters."""
        self._runs: OrderedDict[bytes, np.ndarray] = OrderedDict()
        self._size = self.requested = self.hits = 0
        self._commands: list[tuple[tuple[np.ndarray, ...], dict[bytes, bytes]]] = []

    def run(self, inputs: RunInputs, indices: Sequence[np.ndarray], out: np.ndarray) -> None:
        """Simulate a robot as `kernels.run` does, with cached limbs taken from the cache.

        Args:
            inputs: Inputs; no law couples limbs, and the memory of effects is not requested.
            indices: Limbs, from `limb_indices`.
            out: Result, (T, 3, n).
        """
        keys = self.keys(inputs, indices)
        new = [k for k, key in enumerate(keys) if key not in self._runs]
        self.requested, self.hits = self.requested + len(keys), self.hits + len(keys) - len(new)
        for limb, key in zip(indices, keys, strict=True):
            if key in self._runs:
                self._runs.move_to_end(key)
                out[:, :, inputs.order[limb]] = self._runs[key]
        if not new:
            return
        joints = np.concatenate([indices[k] for k in new])
        states = np.full((len(out), 3, len(joints)), np.nan)
        run(inputs.of(joints), states, np.zeros((0, *inputs.change.memory.shape)))
        out[:, :, inputs.order[joints]] = states
        for first, stop in inputs.segments:
            lost = np.isnan(states[first:stop, 0]).any(axis=1)
            if lost.any():  # a diverged limb invalidates all limbs of this run
                out[first + np.argmax(lost) : stop] = np.nan
                new = []
        for k in new:
            self._keep(keys[k], out[:, :, inputs.order[indices[k]]])

    def keys(self, inputs: RunInputs, indices: Sequence[np.ndarray]) -> list[bytes]:
        """Hash of the inputs of each limb; those of its commands are computed once."""
        commands = inputs.targets, inputs.which, inputs.power
        hashes = next((h for c, h in self._commands if all(map(np.array_equal, c, commands))), None)
        if hashes is None:
            hashes = {}
            self._commands = [(commands, hashes), *self._commands[: RECORDS - 1]]
        without_commands, keys = inputs._replace(targets=inputs.targets[:0]), []
        for limb in indices:
            joints = inputs.order[limb]
            place = joints.tobytes()
            if place not in hashes:
                hashes[place] = _hash((_columns(inputs.targets, joints), *commands[1:]))
            keys.append(without_commands.of(limb).digest(hashes[place]))
        return keys

    def _keep(self, key: bytes, motion: np.ndarray) -> None:
        if key in self._runs:  # two limbs of one run are identical
            return
        self._runs[key] = motion
        self._size += motion.nbytes
        while self._size > self._max_size:
            self._size -= self._runs.popitem(last=False)[1].nbytes


CACHE = LimbCache()  # cache of this process


def _hash(arrays: Iterable[np.ndarray], *numbers: float) -> bytes:
    """Hash of arrays with their shapes, and of numbers."""
    arrays = list(arrays)
    header = repr((numbers, [values.shape for values in arrays])).encode()
    payload = b"".join([header, *(values.tobytes() for values in arrays)])
    return blake2b(payload, digest_size=16).digest()


def _numbered(selected: np.ndarray, n: int) -> np.ndarray:
    """New index of each old index, (n + 1,); -1 for indices not chosen and for -1 itself."""
    numbers = np.full(n + 1, -1)
    numbers[selected] = np.arange(len(selected))
    return numbers


def _columns(values: np.ndarray, joints: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values[..., joints])


def _laws(laws: Laws, numbers: np.ndarray) -> Laws:
    """Laws restricted to some joints."""
    plan, mask = laws.plan.copy(), numbers[laws.joint] >= 0
    row = np.concatenate([[0], np.cumsum(mask)])
    plan[:, 1:3] = row[plan[:, 1:3]]
    plan = plan[plan[:, 1] < plan[:, 2]]
    return Laws(plan, numbers[laws.joint[mask]], laws.const[mask], laws.memory[mask], laws.line)


def _pulls(pulls: Pulls, numbers: np.ndarray) -> Pulls:
    mask = numbers[pulls.body] >= 0
    return Pulls(numbers[pulls.body[mask]], pulls.window[mask], pulls.const[mask])
