# SPDX-License-Identifier: Apache-2.0
"""Export as Python for Isaac Lab and PACE: actuators and domain randomisation terms.

Isaac's DC motor law, kp e - kd dq within the torque-speed lines, equals the servo law here with
the slope of its torque-speed line as kd: clip(kp e, ±stall) - kd dq.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from . import comments
from .portable import FREE, IMPEDANCE, SERVO, TORQUE, Joint, Portable, grouped
from .ranges import Range

ISAAC = '''
import isaaclab.sim as sim_utils
from isaaclab.actuators import (
    DCMotorCfg,
    DelayedPDActuatorCfg,
    IdealPDActuatorCfg,
    ImplicitActuatorCfg,
)
from isaaclab.assets import ArticulationCfg
from isaaclab.envs import mdp
from isaaclab.managers import EventTermCfg as EventTerm
from isaaclab.managers import SceneEntityCfg
from isaaclab.utils import configclass

PHYSICS_DT = {dt!r}  # [s]; delays are counted in these steps

ROBOT_CFG = ArticulationCfg(
    prim_path="{{ENV_REGEX_NS}}/Robot",
    spawn=sim_utils.UrdfFileCfg(
        asset_path="robot.urdf",
        fix_base={fixed},
        joint_drive=sim_utils.UrdfConverterCfg.JointDriveCfg(
            gains=sim_utils.UrdfConverterCfg.JointDriveCfg.PDGainsCfg(stiffness=0.0, damping=0.0)
        ),
    ),
    init_state=ArticulationCfg.InitialStateCfg(pos=(0.0, 0.0, {height!r}), joint_pos={pose}),
    actuators={{
{actuators}    }},
)


@configclass
class EventCfg:
    """Ranges that the recordings leave open."""
{events}'''
PACE = '''
import torch
from isaaclab.utils import configclass
from pace_sim2real import PaceCfg
from pace_sim2real.utils import PaceDCMotorCfg

PHYSICS_DT = {dt!r}  # [s]; the delay is counted in these steps

ACTUATORS = {{
{actuators}}}


@configclass
class RobotPaceCfg(PaceCfg):
    """Joints, and where their parameters may lie: armature, damping, friction, bias, delay."""

    robot_name: str = {robot!r}
    joint_order: list[str] = {joints}
    bounds_params: torch.Tensor = torch.tensor(
        {bounds}
    )
'''
EVENTS = {
    "friction": ("randomize_joint_parameters", "friction_distribution_params", "abs"),
    "armature": ("randomize_joint_parameters", "armature_distribution_params", "abs"),
    "gain": ("randomize_actuator_gains", "stiffness_distribution_params", "scale"),
}
FAST = 1e9  # speed limit of a motor without a torque-speed line [rad/s]


def isaac(model: Portable, ranges: Sequence[Range]) -> tuple[str, list[str]]:
    """Text of a module for Isaac Lab, to be used with ``robot.urdf``; properties that are lost."""
    lost = [*model.lost, "contact: materials are those of the scene in Isaac Lab"]
    dt, delays = model.world.dt, _delays(model, ranges)
    text = "".join(
        f"        {name!r}: {kind}(\n{_fields(values)}        ),\n"
        for name, kind, values in _groups(model, delays, lost)
    )
    events = ""
    for index, one in enumerate(ranges):
        if one.constant in EVENTS:
            events += _event(index, one, model)
        elif one.constant != "delay":
            lost.append(f"range of {one.constant}: {one.low:g} to {one.high:g}")
    pose = dict(zip(model.robot.joints, model.robot.standing.tolist(), strict=True))
    text = ISAAC.format(
        dt=dt, fixed=model.robot.fixed_base, height=float(model.world.base().position[2]),
        pose=pose, actuators=text, events=events or "\n    pass\n",
    )  # fmt: skip
    lost = grouped(lost, model.robot.joints)
    return comments.python(text, model.robot.name, lost), lost


def _delays(model: Portable, ranges: Sequence[Range]) -> tuple[int, int]:
    """Smallest and largest delay of commands [physics steps]."""
    spans = [(one.low, one.high) for one in ranges if one.constant == "delay"]
    value = max((joint.delay for joint in model.joints), default=0.0)
    low, high = spans[0] if spans else (value, value)
    return round(max(low, 0.0) / model.world.dt), round(high / model.world.dt)


def _groups(model: Portable, delays: tuple[int, int], lost: list[str]) -> list[tuple]:
    """Name, Isaac Lab class and fields of each group of actuators."""
    groups = []
    for (kind, stall), group in groupby(sorted(model.joints, key=_equal), _equal):
        joints = [_linear(joint, lost) for joint in group]
        values: dict = {"joint_names_expr": [joint.name for joint in joints]}
        values |= {"stiffness": _each(joints, "kp"), "damping": _each(joints, "kd")}
        if kind != FREE:
            values["effort_limit"] = _each(joints, "limit")
        values |= {"armature": _each(joints, "armature"), "friction": _each(joints, "friction")}
        values |= {"dynamic_friction": _each(joints, "friction")}
        values |= {"viscous_friction": _each(joints, "damping")}
        name, cls = kind, "IdealPDActuatorCfg"
        if kind == FREE:
            name, cls = "passive", "ImplicitActuatorCfg"
            values |= {"stiffness": _each(joints, "stiffness"), "damping": _zero(joints)}
            rests = {joint.name: joint.rest for joint in joints if joint.stiffness}
            if rests:
                lost.append(f"springs pull to position targets: keep them at {rests}")
        elif kind == SERVO:
            name, cls = f"servos_{len(groups)}", "DCMotorCfg"
            values["saturation_effort"] = stall
            values["velocity_limit"] = {j.name: stall / j.kd for j in joints if j.kd}
            if delays[1]:
                lost.append(f"delay of {delays[0]} to {delays[1]} steps: DCMotorCfg has none")
        elif kind == TORQUE:
            values |= {"stiffness": _zero(joints), "damping": _zero(joints)}
            lost += [f"{j.name}: gain {j.kp:g}, bias {j.bias:g} and lag {j.lag:g} of its torque"
                     for j in joints if (j.kp, j.bias, j.lag) != (1.0, 0.0, 0.0)]  # fmt: skip
        elif delays[1]:
            cls = "DelayedPDActuatorCfg"
            values |= {"min_delay": delays[0], "max_delay": delays[1]}
        groups.append((name, cls, values))
    lost += [f"{joint.name}: offset {joint.offset:g}" for joint in model.joints if joint.offset]
    lost += [f"{joint.name}: spring of {joint.stiffness:g} beside the drive"
             for joint in model.joints if joint.stiffness and joint.kind != FREE]  # fmt: skip
    return groups


def _linear(joint: Joint, lost: list[str]) -> Joint:
    """The joint with its tension spring replaced by the linear equivalent."""
    if joint.tension is None:
        return joint
    lost.append(f"{joint.name}: a linear spring stands for that of {joint.tension.stiffness:g} N/m")
    equal = joint.tension.replace(kind="torsion")
    return joint.sprung(equal.rate, equal.slack)


def _equal(joint: Joint) -> tuple[str, float]:
    return joint.kind, joint.limit if joint.kind == SERVO else 0.0


def _each(joints: Sequence[Joint], key: str) -> dict[str, float]:
    return {joint.name: getattr(joint, key) for joint in joints}


def _zero(joints: Sequence[Joint]) -> dict[str, float]:
    return {joint.name: 0.0 for joint in joints}


def _fields(values: dict) -> str:
    literals = {key: repr(value).replace("inf", 'float("inf")') for key, value in values.items()}
    return "".join(f"            {key}={literal},\n" for key, literal in literals.items())


def _event(index: int, one: Range, model: Portable) -> str:
    """Randomisation term of a range, as values of the joint constant or as scale factors."""
    function, parameter, operation = EVENTS[one.constant]
    low, high = one.scales
    if operation == "abs":
        joint = next(joint for joint in model.joints if joint.name == one.joints[0])
        offset = getattr(joint, one.constant) - one.value
        low, high = one.low + offset, one.high + offset
    span = f"({low:.10g}, {high:.10g})"
    damping_line = (
        f'            "damping_distribution_params": {span},\n' if one.constant == "gain" else ""
    )
    return (
        f"\n    {one.constant}_{index} = EventTerm(\n        func=mdp.{function},\n"
        '        mode="startup",\n        params={\n'
        f'            "asset_cfg": SceneEntityCfg("robot", joint_names={list(one.joints)!r}),\n'
        f'            "{parameter}": {span},\n{damping_line}'
        f'            "operation": "{operation}",\n'
        "        },\n    )\n"
    )


def pace(model: Portable, ranges: Sequence[Range]) -> tuple[str, list[str]]:
    """Text of a module for PACE with initial values from the model; properties that are lost."""
    joints = [joint for joint in model.joints if joint.kind in (IMPEDANCE, SERVO)]
    lost = [*model.lost]
    lost += [f"{j.name}: no drive that follows a position" for j in model.joints if j not in joints]
    lost += [f"{j.name}: spring beside the drive" for j in joints if j.stiffness or j.tension]
    lost = grouped(lost, model.robot.joints)
    steps = _delays(model, ranges)
    actuators = ""
    for joint in joints:
        line = joint.limit / joint.kd if joint.kind == SERVO and joint.kd else FAST
        values = {
            "joint_names_expr": [joint.name], "saturation_effort": joint.limit,
            "effort_limit": joint.limit, "velocity_limit": line, "stiffness": joint.kp,
            "damping": joint.kd, "armature": joint.armature, "encoder_bias": [-joint.offset],
            "static_friction": joint.friction, "dynamic_friction": joint.friction,
            "viscous_friction": joint.damping, "max_delay": steps[1],
        }  # fmt: skip
        text = _fields(values).replace("            ", "        ")
        actuators += f"    {joint.name!r}: PaceDCMotorCfg(\n{text}    ),\n"
    bounds = [
        _bound(joint, key, ranges)
        for key in ("armature", "damping", "friction", "offset")
        for joint in joints
    ]
    rows = ", ".join(f"[{low:.10g}, {high:.10g}]" for low, high in [*bounds, steps])
    text = PACE.format(
        dt=model.world.dt, actuators=actuators, robot=model.robot.name,
        joints=[joint.name for joint in joints], bounds=f"[{rows}]",
    )  # fmt: skip
    return comments.python(text, model.robot.name, lost), lost


def _bound(joint: Joint, key: str, ranges: Sequence[Range]) -> tuple[float, float]:
    """Interval of a parameter of PACE; the bias of PACE is the negative joint offset."""
    value, low, high = getattr(joint, key), 0.0, 0.0
    for one in ranges:
        if one.constant == key and joint.name in one.joints:
            low, high = one.low - one.value, one.high - one.value
    span = value + low, value + high
    return (-span[1], -span[0]) if key == "offset" else span
