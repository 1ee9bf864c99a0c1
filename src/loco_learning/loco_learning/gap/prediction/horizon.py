# SPDX-License-Identifier: Apache-2.0
"""Time for which simulations on the ground follow a recording, and their error until then.

Initial states are uncertain, and each contact amplifies errors. Simulations from states that are
drawn from this uncertainty show how errors grow; predictions are used as long as the error is
near its initial size. A comparison with another physics engine shows the error that is due to the
contact model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loco_sim.engines import ENGINES, installed
from loco_sim.plant.model import Model

from ..recordings.record import Record, coarsest
from ..statistics import noise
from . import windows
from .forward import Forward, ForwardParams

LONGEST, SHORTEST = 0.4, 0.08  # length of pieces [s]
GROWN = 2.0  # ratio to the initial error, or to the noise, above which an error has grown
FIRST = 0.02  # time after a start that is not compared [s]
DRAWS = 10  # simulations from drawn initial states, for a reliable standard deviation
CHANCE = 2.0  # deviations of the mean square over a few pieces that chance may add (theory)
N_SEGMENTS = 12  # pieces that are used to find the length
COMPILED_ENGINE = "mujoco"  # the physics engine with compiled runs


def length(model: Model, records: Sequence[Record]) -> float:
    """Length of all pieces on the ground [s]; 0 if the initial states cannot be estimated.

    Args:
        model: Initial model.
        records: Records of a robot with a free base.
        records: Records of a robot whose base is free.
    """
    forward = Forward(model, records, ForwardParams(ground=LONGEST, most=N_SEGMENTS))
    if not any(forward.starts):
        return 0.0
    ref, perturbed_runs = forward(), [perturbed() for perturbed in forward.shaken(2)]
    dt = records[0].dt
    rows = np.arange(round(LONGEST / dt))
    size = np.zeros((len(rows), len(forward.channels)))
    count = np.zeros(size.shape)
    for i, starts in enumerate(forward.starts):
        for start in starts:
            stop = min(start.stop, start.row + len(rows))
            for other in perturbed_runs:
                growth = np.square(other[i][start.row : stop] - ref[i][start.row : stop])
                size[: stop - start.row] += np.nan_to_num(growth)
                count[: stop - start.row] += np.isfinite(growth)
    growth = np.sqrt(size / np.maximum(count, 1.0))
    first = max(1, round(FIRST / dt))
    steps = np.array([coarsest(records, c.signal, c.name) for c in forward.channels])
    floor = np.hypot(noise.floor(forward.measured, steps), np.mean(growth[1 : first + 1], axis=0))
    grown = np.median(growth / floor, axis=1) > GROWN
    grown[: round(SHORTEST / dt)] = False
    stop = int(np.argmax(grown)) if grown.any() else len(rows)
    return round(stop * dt, 4)


def state_std(forward: Forward, suspects: Sequence[Mapping[str, Any]] = ()) -> list[np.ndarray]:
    """Standard deviation of predictions that no model can avoid, (T, C) each; 0 outside of pieces.

    It is that of uncertain initial states and, on the ground, the difference between two physics
    engines if another one is installed. Two engines that agree on the initial model may differ
    where effects change its contacts, so the larger difference is taken.

    Args:
        forward: Forward model.
        suspects: Effects that the robot may have.
    """
    ref = forward()
    runs = [ref, *(perturbed() for perturbed in forward.shaken(DRAWS))]
    # The error of an initial state persists over its piece, and pieces are few.
    chance = np.sqrt(1.0 + CHANCE * np.sqrt(2.0 / max(sum(map(len, forward.starts)), 1)))
    deviations = (np.std(each, axis=0, ddof=1) for each in zip(*runs, strict=True))
    errors = [chance * np.nan_to_num(each) for each in deviations]
    other = next((e for e in ENGINES if e in installed() and e != engine(forward)), None)
    if other is None or not forward.grounded:
        return errors
    engine_change = {"sim.engine": other}
    pairs = [(ref, forward((), engine_change))]
    if suspects:
        pairs.append((forward(suspects), forward(suspects, engine_change)))
    sides = [[np.nan_to_num(a - b) for a, b in zip(*pair, strict=True)] for pair in pairs]
    largest = [np.max(np.abs(each), axis=0) for each in zip(*sides, strict=True)]
    return [np.hypot(f, a) for f, a in zip(errors, largest, strict=True)]


def timing(forward: Forward) -> list[np.ndarray]:
    """Error of a prediction with a touch-down or lift-off one sample too late, (T, C) each."""
    timing_errors = []
    for i, run in enumerate(forward()):
        change = np.abs(np.diff(np.nan_to_num(run), axis=0, prepend=np.nan_to_num(run[:1])))
        late = np.maximum(change, np.roll(change, -1, axis=0))
        legs = forward.legs(i) if forward.on_ground(i) else None
        about = np.zeros(len(run), bool) if legs is None else ~windows.steady(legs, 2.0 * legs.dt)
        timing_errors.append(np.where(about[:, None], late, 0.0))
    return timing_errors


def messages(forward: Forward) -> list[str]:
    """Sentences on how records on the ground are compared; empty if there are none."""
    every = range(len(forward.records))
    on = [i for i in every if forward.on_ground(i)]
    if not on:
        loose = [forward.records[i].name for i in every if not forward.robot(i).fixed_base]
        lost = f"{', '.join(loose)}: nothing tells the attitude of the base, so whole runs are "
        return [f"{lost}compared, which part at the first contact that comes late"] if loose else []
    count = sum(len(forward.starts[i]) for i in on)
    return [
        f"on the ground the model is compared in {count} pieces of {forward.params.ground:.3g} s, "
        "each from the state that IMU and legs tell: so long its own errors stay small"
    ]


def quickest(model: Model) -> Model:
    """The model with the compiled physics engine, if that is installed."""
    if COMPILED_ENGINE not in installed():
        return model
    return Model(model.robot, {**model.overrides, "sim.engine": COMPILED_ENGINE}, model.effects)


def engine(forward: Forward) -> str:
    """Name of the physics engine of a model."""
    return forward.robot().sim.engine
