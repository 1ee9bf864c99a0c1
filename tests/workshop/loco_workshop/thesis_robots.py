# SPDX-License-Identifier: Apache-2.0
"""The thesis's robots with hidden differences: recordings for `loco gap`, and replays of its model.

HyQ trots as in the thesis's laboratory (section 7.3.3), and Tigrillo has the springs and feet of
section 5.3.1. Both are simulated in PyBullet; `loco gap` searches in MuJoCo (docs/gap_thesis.md).

    python -m loco_workshop.thesis_robots hyq bags/hyq
    loco gap bags/hyq/fit_fast --robot bags/hyq/known.yaml --hold-out bags/hyq/held_out --out found
    python -m loco_workshop.thesis_robots hyq bags/hyq --replay found/model.yaml
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from loco_bringup.logs.rollout_bag import write_log
from loco_learning.runs import experiment as experiments
from loco_learning.runs.log import Log
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model

START = 0.6  # time at the start that is not compared, since the robot stands [s]
SIGNALS = ("q", "tau", "grf", "gyro", "orientation")
NOISE = {"name": "sensor_noise", "q": 4e-5, "dq": 4e-3, "gyro": 2e-3, "accelerometer": 0.05}
Run = tuple[str, dict[str, Any]]  # an experiment and its changed values


@dataclass(frozen=True)
class Subject:
    """A robot of the thesis.

    Attributes:
        known: The robot as its documents describe it.
        hidden: Effects on the recorded robot.
        records: Recorded runs by the name of their bag; `held_out` is not fitted.
        brink: Runs of which the robot survives some.
    """

    known: Model
    hidden: tuple[dict[str, Any], ...]
    records: Mapping[str, Run]
    brink: tuple[Run, ...]

    @property
    def real(self) -> Model:
        """The recorded robot."""
        return replace(self.known, effects=[dict(effect) for effect in self.hidden])


def _trot(seconds: float, **gait: float) -> Run:
    times = {"learner.stand": 0.5, "learner.train": seconds}
    return "hyq_trot_open", {**times, **{f"gait.{key}": value for key, value in gait.items()}}


def _sine(amplitude: float, frequency: float) -> Run:
    target = {"target.amplitude": [amplitude], "target.frequency": frequency}
    return "tigrillo_sine", {"duration": 10.0, **target}


SUBJECTS = {
    "hyq": Subject(  # effects as in the experiment `hyq_real_like`, drives as in section 4.3.2
        Model("hyq", {"drives.*.torque": "held", "drives.*.period": 0.004}),
        (
            {"name": "payload", "link": "base_link", "mass": 5.0, "position": [0.1, 0.05, 0.1]},
            {"name": "push", "random": 20.0},
            {"name": "command_delay", "delay": 0.004},
            {**NOISE, "tau": 0.2, "grf": 20.0},
        ),
        {
            "fit_slow": _trot(3.0, speed=0.2),
            "fit_fast": _trot(3.0, speed=0.35),
            "held_out": _trot(3.0, speed=0.28, frequency=1.5),
        },
        tuple(
            _trot(6.0, speed=speed, frequency=frequency)
            for speed in (0.25, 0.6)
            for frequency in (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.7)
        ),
    ),
    "tigrillo": Subject(
        Model("tigrillo"),
        (
            {"name": "spring_saturation", "torque": 0.08, "lost": 0.6},
            {"name": "foot_friction", "error": -0.7},
            NOISE,
        ),
        {
            "fit_bound": ("tigrillo_bound", {"duration": 4.0}),
            "fit_walk": ("tigrillo_walk", {"duration": 4.0}),
            "held_out": ("tigrillo_sine", {"duration": 4.0, "target.frequency": 0.6}),
        },
        tuple(  # amplitudes and frequencies of the study `tigrillo_amplitudes`
            _sine(amplitude, frequency)
            for amplitude in (0.4, 0.6, 0.8, 0.9, 1.0, 1.1, 1.2)
            for frequency in (0.31831, 0.6, 1.0)
        ),
    ),
}
_PUSHED = SUBJECTS["hyq"]
SUBJECTS["hyq_unpushed"] = replace(
    _PUSHED, hidden=tuple(effect for effect in _PUSHED.hidden if effect["name"] != "push")
)


def run(robot: str | Path, one: Run, seed: int = 0) -> Log:
    """Simulate a run in PyBullet.

    Args:
        robot: Name of a robot, or path of a model.
        one: Experiment and changed values.
        seed: Seed of pushes and sensor noise.
    """
    name, values = one
    changed = {"robot": str(robot), "sim.engine": "pybullet", **values}
    return rollout(experiments.load(name, changed), seed=seed)


def record(subject: Subject, folder: Path) -> None:
    """Write ``real.yaml``, ``known.yaml`` and the bags of a robot into a new folder."""
    folder.mkdir(parents=True)
    subject.real.save(folder / "real.yaml")
    subject.known.save(folder / "known.yaml")
    for name, one in subject.records.items():
        write_log(run(folder / "real.yaml", one), folder / name)


def nrmse(real: Log, other: Log) -> dict[str, float]:
    """Rms of the difference over the standard deviation of the real robot, by signal.

    All columns of a signal count together, from `START` to the end of the shorter run.
    """
    ticks = slice(round(START / real.dt), min(len(real), len(other)))
    errors = {}
    for name in SIGNALS:
        a, b = (log.columns[name][ticks].reshape(-1, log.columns[name][0].size)
                for log in (real, other))  # fmt: skip
        errors[name] = float(np.sqrt(np.mean((a - b) ** 2) / np.mean(np.var(a, axis=0))))
    return errors


def replay(subject: Subject, folder: Path, models: Mapping[str, str | Path]) -> Iterator[str]:
    """Lines of a table: errors of models in the held-out motion, and in which runs they fall.

    The last row is the real robot itself with other pushes and noise.

    Args:
        subject: The robot.
        folder: Folder of its recordings.
        models: Models by name.
    """
    own = folder / "real.yaml"
    real = run(own, subject.records["held_out"])
    fallen = [bool(run(own, one).fall) for one in subject.brink]
    yield f"the robot falls in {sum(fallen)} of {len(fallen)} runs"
    yield " | ".join(("model", *SIGNALS, "same end", "falls"))
    for name, (model, seed) in {
        **{k: (v, 0) for k, v in models.items()},
        "itself": (own, 1),
    }.items():
        errors = nrmse(real, run(model, subject.records["held_out"], seed))
        falls = [bool(run(model, one, seed).fall) for one in subject.brink]
        same = sum(a == b for a, b in zip(fallen, falls, strict=True))
        yield " | ".join((name, *(f"{e:.3f}" for e in errors.values()), str(same), str(sum(falls))))


def main() -> None:
    """Record a robot, or compare a found model with it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("robot", choices=SUBJECTS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--replay", metavar="MODEL", help="model.yaml of `loco gap`")
    a = parser.parse_args()
    subject = SUBJECTS[a.robot]
    if not a.replay:
        record(subject, a.folder)
        return
    for line in replay(subject, a.folder, {"known": a.folder / "known.yaml", "found": a.replay}):
        sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
