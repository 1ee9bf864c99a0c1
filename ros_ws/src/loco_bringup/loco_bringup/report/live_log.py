# SPDX-License-Identifier: Apache-2.0
"""Read a bag of a live calibration: both robots, the sequence of models, the gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import BagError, LocoError
from loco_learning.calibration import mawe, segments
from loco_learning.calibration.parameters import SETS, BodyParameter, parameter_set
from loco_learning.calibration.recording import Recording, compared
from loco_learning.runs.experiment import Experiment, from_values

from ..bag.reader import Bag
from ..calibrate.bag import read_recording

MEASURED, MODEL = "measured", "model"  # namespaces
TOPICS = ("/gap", f"/{MEASURED}/joint_states", f"/{MODEL}/joint_states")
STATES = ("/calibration", "/gap_search")  # state topics of the calibrator, one of them per run
SETTLE = 1.5  # periods ignored after the start; half as many after a change of model


def is_live(bag: Bag) -> bool:
    """Whether the bag contains a live calibration or a live search for a gap."""
    return not _missing(bag) and bool(_state_topic(bag))


def _missing(bag: Bag) -> list[str]:
    return [name for name in TOPICS if name not in bag.topics or not bag.topics[name].count]


def _state_topic(bag: Bag) -> str:
    """State topic of the calibrator; empty if it has no messages."""
    return next((n for n in STATES if n in bag.topics and bag.topics[n].count), "")


@dataclass(frozen=True)
class LiveRun:
    """The recording of a live calibration.

    Attributes:
        bag: The bag.
        experiments: Experiment of each robot, by namespace.
        joints: Passive joints, the columns of the periods.
        measured: Periods of the measured robot.
        before: Periods of the initial model; None if no period is complete.
        after: Periods of the last model; None if the model never changed or no period is
            complete.
        swaps: Simulated times at which the model robot switched models [s], (S,).
        gap: Rows of the topic `gap`: end of the period [s], gap [rad], index of the model,
            whether the model changed within the period, (P, 4).
        states: Messages of the topic `calibration`, or of `gap_search`.
    """

    bag: Bag
    experiments: dict[str, Experiment]
    joints: tuple[str, ...]
    measured: segments.Segments
    before: segments.Segments | None
    after: segments.Segments | None
    swaps: np.ndarray
    gap: np.ndarray
    states: list

    @property
    def period(self) -> float:
        """Length of a period [s]."""
        return self.measured.period

    def error(self, model: segments.Segments | None, loss: str = "thesis") -> float:
        """Windowed error between the averages of the measured robot and a model; NaN without it."""
        if model is None:
            return float("nan")
        return mawe.loss(loss)(self.measured.mean, model.mean, self.period)[0]

    @property
    def ending(self) -> tuple[str, str]:
        """Final phase of the calibration and its message."""
        return self.states[-1].phase, self.states[-1].text

    @property
    def names_gap(self) -> bool:
        """Whether the run is of `loco gap --live`, with the states of a gap search."""
        return hasattr(self.states[-1], "gap_json")

    def parameters(self) -> list[tuple[BodyParameter, float]]:
        """Calibrated parameters and their best values; empty if there are none."""
        if self.names_gap:
            return []
        names, values = list(self.states[-1].names), list(self.states[-1].values)
        for set_name in SETS:
            parameters = parameter_set(set_name)
            if list(parameters.names) == names:
                return list(zip(parameters.parameters, values, strict=True))
        return []


def read_live(bag: Bag) -> LiveRun:
    """A live calibration from its bag.

    Raises:
        BagError: The bag lacks one of `TOPICS`, or the measured robot has no complete period.
    """
    missing = _missing(bag) or ([] if _state_topic(bag) else [" or ".join(STATES)])
    if missing:
        raise BagError(f"{bag.path} has no messages on {', '.join(missing)}; it is no live run")
    experiments = {
        name: from_values(bag.yaml(f"experiment_{name}.yaml")) for name in (MEASURED, MODEL)
    }
    robot = experiments[MODEL].plant
    joints = tuple(compared(robot))
    robots = {n: read_recording(bag, e.control_rate, e.plant, n) for n, e in experiments.items()}
    events = bag.messages(f"/{MODEL}/events")
    swaps = np.array([_time(e) for e in events if e.kind == "model loaded"])
    first, last = (swaps[0], swaps[-1]) if len(swaps) else (np.inf, np.inf)
    settle_time = SETTLE / experiments[MEASURED].target.frequency
    measured = _periods(robots[MEASURED], joints, settle_time, np.inf)
    if measured is None:
        raise BagError(f"{bag.path}: the measured robot has no whole period of its excitation")
    return LiveRun(
        bag, experiments, joints, measured,
        _periods(robots[MODEL], joints, settle_time, first),
        _periods(robots[MODEL], joints, last + 0.5 * settle_time, np.inf),
        swaps, np.array([(_time(m), m.gap, m.model, m.mixed) for m in bag.messages("/gap")]),
        bag.messages(_state_topic(bag)),
    )  # fmt: skip


def _time(message) -> float:
    return message.stamp.sec + message.stamp.nanosec / 1e9


def _periods(
    recording: Recording, joints: tuple[str, ...], start: float, stop: float
) -> segments.Segments | None:
    """Complete periods between two times [s]; None if there are none."""
    in_window = (recording.t >= start) & (recording.t <= stop)
    t, columns = recording.t[in_window], [recording.joints.index(name) for name in joints]
    try:
        at = segments.crossings(t, recording.command[in_window, 0], 1)
        return segments.cut(t, recording.q[in_window][:, columns], at)
    except LocoError:
        return None
