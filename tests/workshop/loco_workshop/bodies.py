# SPDX-License-Identifier: Apache-2.0
"""Calibrations of drawn bodies: how well each of the seven parameters of chapter 5 is found.

A body is drawn, moves its hips in PyBullet with effects that the seven parameters do not contain,
and is calibrated in MuJoCo. Unlike the surrogate robot it is not the thesis's own result.

    python -m loco_workshop.bodies results/bodies.csv --bodies 20 --generations 20
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loco_learning.calibration.fit import Calibration
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.recording import Recording
from loco_learning.runs import experiment as experiments
from loco_learning.runs.rollout import rollout
from loco_learning.thesis.registry import median_interval
from loco_sim.plant.model import Model

EXPERIMENT = "surrogate_sine"  # its effects are replaced by drawn ones
SET = parameter_set("seven")
PAIRS = ("stiffness", "depth", "friction")  # of front and hind legs
Body = dict[str, float]


@dataclass(frozen=True)
class Prior:
    """Ranges from which bodies are drawn; our choice, around both columns of Table 5.1.

    Front and hind legs are drawn independently, stiffness, depth and friction on a logarithmic
    scale.
    """

    stiffness: tuple[float, float] = (120.0, 500.0)  # [N/m]
    depth: tuple[float, float] = (3e-4, 1e-2)  # [m]
    friction: tuple[float, float] = (0.05, 0.8)
    mass_share: tuple[float, float] = (0.6, 0.78)
    delay: tuple[float, float] = (0.05, 0.15)  # of commands [s]
    lost: tuple[float, float] = (0.0, 0.7)  # stiffness of springs above 0.2 N·m
    hip: tuple[float, float] = (0.0, 0.2)  # dry friction [N·m]
    knee: tuple[float, float] = (0.0, 0.01)
    bend: tuple[float, float] = (-0.035, 0.035)  # quadratic error of the knee sensors [1/rad]


def draw(seed: int, prior: Prior | None = None) -> tuple[Body, list[dict[str, Any]]]:
    """Body parameters and effects of a robot.

    Args:
        seed: Seed of the draw.
        prior: Ranges.
    """
    ranges, rng = prior or Prior(), np.random.default_rng([seed, 48])
    body = {
        f"{quantity}_{end}": float(np.exp(rng.uniform(*np.log(getattr(ranges, quantity)))))
        for quantity in PAIRS
        for end in ("front", "hind")
    }
    body["mass_share"] = float(rng.uniform(*ranges.mass_share))
    delay, lost, hip, knee, bend = (
        float(rng.uniform(*getattr(ranges, name)))
        for name in ("delay", "lost", "hip", "knee", "bend")
    )
    return body, [
        {"name": "command_delay", "delay": round(delay, 3)},
        {"name": "spring_saturation", "joint": "*_kfe_joint", "torque": 0.2, "lost": lost},
        {"name": "coulomb_friction", "joint": "*_hfe_joint", "torque": hip},
        {"name": "coulomb_friction", "joint": "*_kfe_joint", "torque": knee},
        {"name": "sensor_nonlinearity", "joint": "*_kfe_joint", "quadratic": bend},
    ]


def record(
    body: Body, effects: Sequence[Mapping[str, Any]], seed: int, seconds: float
) -> Recording:
    """Recording of a body that moves its hips; too short if it falls.

    Args:
        body: Values of the seven parameters.
        effects: Effects of the body, as in an experiment.
        seed: Seed of the sensor noise.
        seconds: Length [s].
    """
    values = {
        "duration": seconds, "effects": list(effects), "sim.engine": "pybullet",
        "overrides": SET.overrides(body),
    }  # fmt: skip
    experiment = experiments.load(EXPERIMENT, values)
    log, robot = rollout(experiment, seed=seed), experiment.plant
    driven = tuple(robot.joints[i] for i in robot.driven)
    return Recording(f"body {seed}", log.t, log.command, log.q, driven, tuple(robot.joints))


def calibrate(seed: int, generations: int, seconds: float, model: Path) -> dict[str, float] | None:
    """True and found values of a drawn body, and errors before and after; None if it falls.

    Args:
        seed: Seed of the body, of its noise and of the search.
        generations: Generations of the search.
        seconds: Length of the recording [s].
        model: Robot of the search.
    """
    body, effects = draw(seed)
    recording = record(body, effects, seed, seconds)
    if len(recording.t) * recording.dt < seconds - recording.dt:
        return None
    options = CalibrationParams(generations=generations, seed=seed)
    fit = Calibration(recording, model, options).run()
    row = {"seed": float(seed), "before": fit.before, "after": fit.error}
    for name in SET.names:
        row |= {name: body[name], f"{name}_found": fit.values[name]}
    return row


def extend(table: Path, bodies: int, generations: int, seconds: float) -> None:
    """Add calibrations to a table until it has so many bodies; those that fall are left out."""
    rows = read(table) if table.is_file() else []
    table.parent.mkdir(parents=True, exist_ok=True)
    model = table.with_suffix(".yaml")
    Model("tigrillo", {"sim.engine": "mujoco"}).save(model)
    seed = int(rows[-1]["seed"]) + 1 if rows else 0
    while len(rows) < bodies:
        row = calibrate(seed, generations, seconds, model)
        seed += 1
        if row:
            rows.append(row)
            with table.open("a", newline="", encoding="utf-8") as file:
                writer = csv.writer(file, lineterminator="\n")
                if len(rows) == 1:
                    writer.writerow(row)
                writer.writerow(f"{value:.5g}" for value in row.values())
    model.unlink()


def read(table: Path) -> list[dict[str, float]]:
    """Rows of a table of calibrations."""
    with table.open(newline="", encoding="utf-8") as file:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def errors(rows: Sequence[Mapping[str, float]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Errors of a parameter, calibrated and default, (bodies,) each.

    An error is the factor between found and true value, at least 1; of the mass share the
    absolute difference.
    """
    true = np.array([row[name] for row in rows])
    found = np.array([row[f"{name}_found"] for row in rows])
    default = np.full(len(rows), SET.default[name])
    if name == "mass_share":
        return np.abs(found - true), np.abs(default - true)
    return np.exp(np.abs(np.log(found / true))), np.exp(np.abs(np.log(default / true)))


def summary(rows: Sequence[Mapping[str, float]]) -> Iterator[str]:
    """Lines of a table: medians of errors with 90 % intervals; patterns of front and hind legs."""
    yield "| parameter | error, calibrated | error, default | closer than the default |"
    yield "| --- | --- | --- | --- |"
    for name in SET.names:
        found, default = errors(rows, name)
        closer = f"{sum(found < default)} of {len(rows)}"
        yield f"| {name} | {_median(found)} | {_median(default)} | {closer} |"
    ratio = np.array([row["before"] / row["after"] for row in rows])
    yield f"Error of the knees, before over after: {_median(ratio)}"
    for what in PAIRS:
        true, found = (
            np.array([row[f"{what}_hind{end}"] > row[f"{what}_front{end}"] for row in rows])
            for end in ("", "_found")
        )
        yield (
            f"{what} of the hind legs is larger in {sum(true)} bodies: found in {sum(found & true)}"
            f" of them, and in {sum(found & ~true)} of the other {sum(~true)}"
        )


def _median(values: np.ndarray) -> str:
    low, high = median_interval(values)
    return f"{np.median(values):.3g} ({low:.3g} to {high:.3g})"


def main() -> None:
    """Extend a table of calibrations, or print its summary."""
    parser = argparse.ArgumentParser()
    parser.add_argument("table", type=Path)
    parser.add_argument("--bodies", type=int, default=0, help="calibrate until there are so many")
    parser.add_argument("--generations", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=20.0, help="length of a recording")
    a = parser.parse_args()
    if a.bodies:
        extend(a.table, a.bodies, a.generations, a.seconds)
    sys.stdout.write("\n".join(summary(read(a.table))) + "\n")


if __name__ == "__main__":
    main()
