# SPDX-License-Identifier: Apache-2.0
"""Strengths that are confounded with the scale of the drive torques, without a force sensor.

All masses, torques and forces times a common factor give the same motion. A strength in kg, N or
N·m is therefore only as accurate as drives and masses in `robot.yaml`, and where an effect acts
nearly like a change of the drive torques, the data cannot distinguish the two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case
from ..prediction.nominal import READING, torques
from ..statistics import identify

SCALE_STEP = 0.1  # finite difference of the logarithm of a scale
STRENGTH = 0.05  # relative finite difference of a strength
ABSOLUTE = ("grf",)  # signals that measure a force directly


def masses(robot: Robot, factor: float) -> dict[str, float]:
    """Values of robot.yaml with all link masses multiplied by a factor; inertias follow."""
    text = Description(robot.urdf)
    total = {link: sum(text.mass_of(below) for below in text.below(link)) for link in text.links()}
    links = [link for link in total if text.mass_of(link) > 0.0]  # links without mass are frames
    return {f"masses.{link}": factor * total[link] for link in links}


def scale_messages(case: Case, model: Fitted) -> list[str]:
    """Strengths that are confounded with the scale of the drive torques, one sentence each."""
    messages = []
    for row in ambiguous(case, model):
        single, combined = row["torque"], row["torque_and_masses"]
        if max(single, combined) <= identify.SAME_DIRECTION:
            continue
        what = f"{row['parameter'].replace('.', ' ').replace('_', ' ')} {row['place']}".strip()
        if single > identify.SAME_DIRECTION:
            messages.append(
                f"{what} and the scale of the drives' torque: only their ratio shows (cosine "
                f"{single:.3f}). Its size is as right as the torque in robot.yaml: weigh it, or "
                "hang a known mass on the joint."
            )
        else:
            messages.append(
                f"{what}, the scale of the drives' torque and that of all masses: only their "
                f"ratios show (cosine {combined:.3f}). Its size is as right as the torque and the "
                "masses in robot.yaml: measure one of them."
            )
    return messages


def currents(values: Mapping[str, Any]) -> list[str]:
    """Sentence on fitted scales of measured currents without torque constants; empty if none."""
    factors = [
        f"{name.partition('.')[2]} {1.0 + error:.3g}"
        for name, error in values.items()
        if name.startswith(f"{READING}.")
    ]
    return [
        f"the torque constants of measured currents are not known and were fitted with every model "
        f"(over what the mapping says: {', '.join(factors)}): they are as right as the masses and "
        "drives of the model, since all of these scale together"
    ][: len(factors)]  # fmt: skip


def ambiguous(case: Case, model: Fitted) -> list[dict[str, Any]]:
    """Cosines of strengths with the scales of drive torques and masses.

    Args:
        case: Model and data.
        model: Selected model.

    Returns:
        One row for each strength in a unit of mass or force: its name and place, the cosine of
        its column with that of the torque scale, and with the span of the scales of torque and
        masses.
    """
    robot = case.forward.given()
    if set(case.signals) & set(ABSOLUTE) or not torques(robot, 1.0):
        return []
    base_case = case.kept()
    reference = base_case.whitened(model.specs, model.settled)
    weight = np.sqrt(identify.weights(model.score))

    def column(specs: Sequence[Mapping], overrides: Mapping[str, float]) -> np.ndarray:
        moved = base_case.whitened(specs, {**model.settled, **overrides})
        change = identify.pack([a - b for a, b in zip(moved, reference, strict=True)])
        return np.nan_to_num(np.clip(change, -case.cap, case.cap)) * weight

    factor = math.exp(SCALE_STEP)
    torque = column(model.specs, torques(_with(case, model), factor))
    both = np.stack([torque, column(model.specs, masses(robot, factor))], axis=1)
    rows = []
    for i, (hypothesis, x) in enumerate(model.parts):
        for j in filter(partial(_forceful, hypothesis), hypothesis.strengths):
            specs = model.moved(i, [v * (1.0 + STRENGTH * (k == j)) for k, v in enumerate(x)])
            direction = column(specs, {})
            single, combined = (identify.cosine(direction, c) for c in (torque[:, None], both))
            rows.append(
                {
                    "parameter": f"{hypothesis.effect}.{hypothesis.coordinates[j].label}",
                    "place": hypothesis.place,
                    "torque": single,
                    "torque_and_masses": combined,
                }
            )
    return rows


def _forceful(hypothesis: Hypothesis, index: int) -> bool:
    """True if the unit of a coordinate contains a mass or a force."""
    unit = hypothesis.coordinates[index].unit
    return "N" in unit or "kg" in unit


def _with(case: Case, model: Fitted) -> Robot:
    """The robot with the refitted nominal values."""
    return case.forward.given(model.settled)
