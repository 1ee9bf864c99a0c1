# SPDX-License-Identifier: Apache-2.0
"""Domain randomisation ranges from the intervals of ``gap.json``, for MuJoCo Playground.

`of` returns the ranges for every target; `playground` writes them as a randomisation function for
Playground's training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from . import comments
from .portable import FREE, SERVO, Portable

# Constant of `portable.Joint` to which an effect parameter is added; gain scales the drive's.
CONSTANTS = {
    ("armature", "inertia"): "armature",
    ("coulomb_friction", "torque"): "friction",
    ("viscous_friction", "damping"): "damping",
    ("torque_constant_error", "error"): "gain",
    ("joint_offset", "offset"): "offset",
    ("command_delay", "delay"): "delay",
}
FIELDS = {"armature": "dof_armature", "friction": "dof_frictionloss", "damping": "dof_damping"}

PLAYGROUND = '''
import jax

# Low, high, and what is set to a + b x: field of mjx.Model, index, a, b.
RANGES = (
{rows})


def domain_randomize(model, rng):
    """Draw each range once a world; `rng` is one key a world."""

    @jax.vmap
    def draw(key):
        fields = {{}}
        for (low, high, targets), one in zip(RANGES, jax.random.split(key, len(RANGES))):
            x = jax.random.uniform(one, minval=low, maxval=high)
            for name, index, a, b in targets:
                before = fields.get(name, getattr(model, name))
                fields[name] = before.at[index].set(a + b * x)
        return fields

    fields = draw(rng)
    in_axes = jax.tree_util.tree_map(lambda leaf: None, model)
    in_axes = in_axes.tree_replace(dict.fromkeys(fields, 0))
    return model.tree_replace(fields), in_axes
'''


@dataclass(frozen=True)
class Range:
    """Randomisation interval of a joint constant.

    Attributes:
        constant: Name of the constant, a value of `CONSTANTS`.
        joints: Joints that share it.
        value: Estimated contribution of the effect [unit of the constant].
        low: Lower end of the interval.
        high: Upper end.
    """

    constant: str
    joints: tuple[str, ...]
    value: float
    low: float
    high: float

    @property
    def scales(self) -> tuple[float, float]:
        """For gains: factors on the model's constants, which already include the estimate."""
        return (1.0 + self.low) / (1.0 + self.value), (1.0 + self.high) / (1.0 + self.value)


def of(model: Portable, terms: Sequence[Mapping[str, Any]]) -> tuple[list[Range], list[str]]:
    """Ranges of the terms of a ``gap.json``, and a sentence for each unsupported term."""
    entries, lost = [], []
    driven = [joint.name for joint in model.joints if joint.kind != FREE]
    for term in terms:
        named = str(term.get("place", "")).split()
        all_joints = [joint.name for joint in model.joints]
        joints = tuple(j for j in all_joints if any(fnmatchcase(j, name) for name in named))
        for name, entry in term["parameters"].items():
            constant = CONSTANTS.get((term["effect"], name))
            if None in (entry["value"], entry["low"], entry["high"]):
                lost.append(f"range of {term['effect']} {name}: none is known")
            elif constant is None:
                lost.append(
                    f"range of {term['effect']} {name}: {entry['low']:g} to {entry['high']:g} "
                    f"{entry['unit']} around {entry['value']:g}"
                )
            else:
                default = driven if constant in ("gain", "offset", "delay") else all_joints
                names = joints or tuple(default)
                entries.append(Range(constant, names, entry["value"], entry["low"], entry["high"]))
    return entries, lost


def playground(
    model: Portable, ranges: Sequence[Range], dof: Mapping[str, int]
) -> tuple[str, list[str]]:
    """Text of a module with ``domain_randomize(model, rng)``, and properties that are lost.

    Args:
        model: The exported model.
        ranges: Ranges from `of`.
        dof: Index of the degree of freedom of each joint in the exported file: see `mjcf.dofs`.
    """
    actuators = [joint.name for joint in model.joints if joint.kind != FREE]
    joints = {joint.name: joint for joint in model.joints}
    rows, lost = [], []
    for one in ranges:
        targets: list[tuple] = []
        for name in one.joints:
            if one.constant in FIELDS:
                has = getattr(joints[name], one.constant) - one.value
                on_joint = joints[name].kind == SERVO and joints[name].gear is None
                if one.constant == "damping" and on_joint:
                    has += joints[name].kd
                targets.append((FIELDS[one.constant], dof[name], has, 1.0))
            elif one.constant == "gain":
                targets += _gains(joints[name], actuators.index(name), one.value)
        if targets:
            text = "".join(f"            {target!r},\n" for target in targets)
            span = f"{one.low:.10g}, {one.high:.10g}"
            rows.append(f"    (\n        {span},\n        (\n{text}        ),\n    ),\n")
        else:
            lost.append(
                f"range of {one.constant}: {one.low:g} to {one.high:g}, for the environment"
            )
    text = PLAYGROUND.format(rows="".join(rows))
    return comments.python(text, model.robot.name, lost), lost


def _gains(joint: Any, index: int, value: float) -> list[tuple]:
    """Targets for gain and feedback of an actuator, in proportion to 1 + x."""
    entries = [("actuator_gainprm", (index, 0), joint.kp)]
    if joint.kind != FREE and joint.kd + joint.kp and joint.kind != "torque":
        brake = 0.0 if joint.kind == SERVO else joint.kd
        entries += [("actuator_biasprm", (index, 1), -joint.kp),
                    ("actuator_biasprm", (index, 2), -brake)]  # fmt: skip
    shares = [(name, at, gain / (1.0 + value)) for name, at, gain in entries if gain]
    return [(name, at, share, share) for name, at, share in shares]
