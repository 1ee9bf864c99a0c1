# SPDX-License-Identifier: Apache-2.0
"""Rounding of joint sensors, which no residual shows: readings say it themselves.

Rounding belongs to the noise floor, so a model that lacks it leaves no gap. It is named when
all readings of a joint are multiples of a step that is coarser than the model's sensor, and
nothing but that rounding is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from loco_sim.robot import Robot

from .record import Record

NAME = "quantisation"
COARSER = 1.5  # times the step that the model knows
EXACT = 1e-3  # of a step: a reading that is nearer to a multiple lies on it
READINGS = 100  # fewer say nothing
ADEQUATE = 1.5  # floors; more is left than rounding


def step_of(values: np.ndarray) -> float:
    """Step of which all readings are multiples; 0 if there is none that repeats.

    Args:
        values: Readings, (N,); NaN = not measured.
    """
    values = values[np.isfinite(values)]
    levels = np.unique(np.round(values, 12))
    if len(values) < READINGS or not 3 <= len(levels) <= len(values) // 2:
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    counts = np.round((levels - levels[0]) / step)
    if counts[-1] > 0:
        step = float((levels[-1] - levels[0]) / counts[-1])
    off = np.abs((levels - levels[0]) / step - np.round((levels - levels[0]) / step))
    return step if off.max() < EXACT * max(1.0, counts[-1] * EXACT) else 0.0


def steps(records: Sequence[Record], robot: Robot) -> dict[str, float]:
    """Steps of the joints whose readings are coarser than those of the model's sensors."""
    known = robot.sensors.encoder.resolution if robot.sensors else 0.0
    found = {}
    for j, joint in enumerate(robot.joints):
        if joint in robot.hall:
            continue
        step = step_of(np.concatenate([r.joints_of(robot, "q")[:, j] for r in records]))
        mine = max(known, getattr(robot.drives.get(joint), "resolution", 0.0))
        if step > COARSER * mine:
            found[joint] = step
    return found


def tell(
    gap: dict[str, Any], records: Sequence[Record], robot: Robot, effects: Sequence[str]
) -> dict[str, Any]:
    """Contents of ``gap.json`` with the rounding that was found.

    Args:
        gap: Contents so far.
        records: What was measured.
        robot: As the model has it.
        effects: Patterns of the effects that may be named.
    """
    allowed = any(fnmatchcase(NAME, pattern) for pattern in effects)
    found = steps(records, robot) if allowed and gap["gap"]["after"] <= ADEQUATE else {}
    if not found:
        return gap
    joints = ", ".join(found)
    text = f"All readings of {joints} are multiples of a step that the model's sensor lacks."
    gap = {**gap, "names": sorted({*gap["names"], NAME})}
    if gap["verdict"] == "no gap":
        gap |= {"verdict": "named", "evidence": text}
    gap["terms"] = [*gap["terms"], *(_term(joint, step, text) for joint, step in found.items())]
    effects = [{"name": NAME, "joint": joint, "step": step} for joint, step in found.items()]
    gap["model"] = {**gap["model"], "effects": [*gap["model"]["effects"], *effects]}
    return gap


def _term(joint: str, step: float, text: str) -> dict[str, Any]:
    unit = {"value": step, "low": 0.99 * step, "high": 1.01 * step, "unit": "rad"}
    return {
        "effect": NAME,
        "place": joint,
        "places": [],
        "verdict": "named",
        "parameters": {"step": unit},
        "gain": {"mean": 0.0, "low": 0.0, "high": 0.0},
        "odds": 1e9,
        "closed": 1.0,
        "look_alikes": [],
        "evidence": text,
    }
