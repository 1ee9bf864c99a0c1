# SPDX-License-Identifier: Apache-2.0
"""Conversion of a model to constants of links and joints for other simulators.

Effects are converted to constants of the link or joint that they act on where possible: dry
friction is friction loss, a torque constant error scales gains and limit. Each property that
cannot be converted is reported as a sentence in `Portable.lost`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

from ..effects.base import Effect
from ..effects.catalogue import actuator, body, compliance, contact, delay, friction
from ..effects.catalogue.compliance import rest
from ..effects.chain import JointEffect
from ..effects.places import eligible
from ..plant.model import Model
from ..plant.simulation import periods
from ..robot.robot import Robot
from ..robot.servo import ImpedanceDrive, ServoParams
from ..robot.spring import SpringParams
from ..world.world import World, make_world

IMPEDANCE, SERVO, TORQUE, FREE = "impedance", "servo", "torque", "free"
RIGID, ELASTIC = "rigid", "elastic"  # gears of servos
GEARS = ELASTIC, RIGID
ROTOR = "{}: the gear (stiffness {:g}, damping {:g}) is rigid here, the rotor is armature"


@dataclass(frozen=True)
class Gear:
    """The gear between the motor of a servo and its joint.

    Attributes:
        inertia: Inertia of rotor and gear, reflected to the joint [kg·m²].
        stiffness: Torque per angle between rotor and joint [N·m/rad].
        damping: Torque per speed between rotor and joint [N·m·s/rad].
    """

    inertia: float
    stiffness: float
    damping: float


@dataclass(frozen=True)
class Joint:
    """Constants of one joint, in rad, N·m, kg·m² and s (m, N and kg where it slides).

    Attributes:
        name: Name of the joint.
        kind: Law of its drive: `IMPEDANCE`, `SERVO`, `TORQUE` or `FREE`.
        kp: Torque per position error, or torque per commanded torque.
        kd: Torque per velocity error; of a servo the slope of its torque-speed line.
        bias: Torque at zero command.
        limit: Largest torque of the drive, at rest.
        armature: Inertia of rotor and gear from effects or drive, in addition to the link's.
        damping: Viscous damping of the joint itself.
        friction: Dry friction.
        stiffness: Stiffness of the spring in the joint.
        rest: Position at which the spring torque is zero.
        offset: True position at which drive and sensor read 0.
        delay: Delay of commands.
        lag: Time constant of the torque.
        tension: Tension spring of which `stiffness` is the linear equivalent; None for none.
        gear: Elastic gear; None if the motor acts on the joint directly.
        resolution: Resolution of a servo's joint measurement; 0 for none.
        effort: Limit of the total torque of a servo, including its braking; 0 for none.
    """

    name: str
    kind: str = FREE
    kp: float = 0.0
    kd: float = 0.0
    bias: float = 0.0
    limit: float = math.inf
    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    offset: float = 0.0
    delay: float = 0.0
    lag: float = 0.0
    tension: SpringParams | None = None
    gear: Gear | None = None
    resolution: float = 0.0
    effort: float = 0.0

    def sprung(self, stiffness: float, rest_angle: float) -> Joint:
        """The joint with one more linear spring."""
        total = self.stiffness + stiffness
        middle = (
            (self.stiffness * self.rest + stiffness * rest_angle) / total if total else rest_angle
        )
        return replace(self, stiffness=total, rest=middle)


@dataclass
class Portable:
    """A model as a URDF and joint constants, with the properties that were lost.

    Attributes:
        robot: The robot with its overrides.
        world: MuJoCo world with the robot of the model.
        joints: Constants of the robot's joints, in its order.
        lost: Sentences on properties that the constants cannot represent.
    """

    robot: Robot
    world: World
    joints: list[Joint]
    lost: list[str] = field(default_factory=list)


def portable(model: Model, gear: str = RIGID) -> Portable:
    """Constants of a model.

    Args:
        model: The model.
        gear: One of `GEARS`. With `RIGID`, for targets whose motors act on the joints directly,
            rotors become armature, and servo measurements are not quantised.

    Raises:
        LocoError: The model does not fit its robot, or MuJoCo cannot build it.
    """
    robot, effects = model.make_robot(), model.make_effects()
    lost: list[str] = []
    built = [e for e in effects if not e.absent() and not _timed(e, lost)]
    inside = [e for e in built if isinstance(e, BUILT_IN)]
    steps = periods(1.0 / robot.control_rate, robot.sim.physics_rate)
    dt = 1.0 / robot.control_rate / steps
    world = make_world(robot, robot.sim.replace(engine="mujoco"), dt)
    world.rebuild(robot.standing, [e.configure for e in inside], robot.height)
    joints = {name: _joint(robot, world, name, gear, lost) for name in robot.joints}
    for effect in built:
        _apply(effect, robot, joints, lost)
    if robot.sensors:
        lost.append("sensors: resolution, noise and rate stay behind")
    return Portable(robot, world, list(joints.values()), grouped(lost, robot.joints))


def grouped(lost: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Sentences, with equal ones of several joints combined into one."""
    groups: dict[str, list[str]] = {}
    for text in lost:
        name, mark, reason = text.partition(": ")
        names_joint = bool(mark) and name in joints
        groups.setdefault(reason if names_joint else text, []).extend([name] if names_joint else [])
    return [f"{', '.join(names)}: {text}" if names else text for text, names in groups.items()]


def _timed(effect: Effect, lost: list[str]) -> bool:
    timed = effect.start > 0.0 or effect.stop != math.inf
    if timed:
        lost.append(f"{effect.name} acts from {effect.start:g} s to {effect.stop:g} s only")
    return timed


def _joint(robot: Robot, world: World, name: str, gear: str, lost: list[str]) -> Joint:
    """Constants of a joint with drive and spring, without effects."""
    limit = float(robot.effort[robot.joints.index(name)])
    rotor = robot.armature.get(name, 0.0)
    damping, dry = world.description.damping(name), robot.joint_friction.get(name, 0.0)
    joint = Joint(name, damping=damping, friction=dry, armature=rotor)
    drive, spring = robot.drives.get(name), robot.springs.get(name)
    if drive is not None and drive.sampled:
        lost.append(f"{name}: what its drive asks for is {drive.torque} for {drive.period:g} s")
    if speed := getattr(drive, "setpoint_speed", 0.0):
        lost.append(f"{name}: its setpoint moves at {speed:g} rad/s at most")
    if isinstance(drive, ServoParams):
        slope = drive.stall_torque / drive.no_load_speed
        joint = replace(joint, kind=SERVO, kp=drive.kp * drive.stall_torque, kd=slope,
                       limit=drive.stall_torque)  # fmt: skip
        joint = _geared(joint, drive, limit, gear, lost)
    elif isinstance(drive, ImpedanceDrive):
        stiff = drive.kp + drive.kd * drive.position_gain  # both loops of the cascade
        joint = replace(joint, kind=IMPEDANCE, kp=stiff, kd=drive.kd, limit=limit)
        if drive.integrates:
            lost.append(f"{name}: its integrator (ki {drive.ki:g}, speed_ki {drive.speed_ki:g})")
        if drive.speed_feed != 1.0:
            lost.append(f"{name}: {drive.speed_feed:g} of the commanded velocity is asked for")
        if drive.swing != (drive.kp, drive.kd):
            lost.append(f"{name}: gains of swing ({drive.swing[0]:g}, {drive.swing[1]:g})")
    elif drive is not None:
        joint = replace(joint, kind=TORQUE, kp=drive.gain, bias=drive.bias, limit=limit)
        joint = replace(joint, damping=joint.damping + drive.slope)
    if spring is not None:
        joint = replace(joint, damping=joint.damping + spring.damping)
        if spring.kind == "pretension":
            joint = replace(joint, tension=spring)
        else:
            joint = joint.sprung(spring.rate, spring.slack)
    return joint


def _geared(joint: Joint, drive: ServoParams, limit: float, gear: str, lost: list[str]) -> Joint:
    """The joint of a servo with constants of rotor and gear."""
    geared = drive.rotor_inertia > 0.0
    gear_values = Gear(drive.rotor_inertia, drive.gear_stiffness, drive.gear_damping)
    if gear == ELASTIC:
        joint = replace(joint, resolution=drive.resolution, effort=limit)
        return replace(joint, gear=gear_values) if geared else joint
    if geared:
        lost.append(ROTOR.format(joint.name, gear_values.stiffness, gear_values.damping))
    if drive.resolution > 0.0:
        lost.append(f"{joint.name}: its drive no longer rounds to {drive.resolution:g} rad")
    if limit < drive.stall_torque:
        lost.append(f"{joint.name}: the limit of {limit:g} is below the stall torque and left out")
    return replace(joint, armature=joint.armature + drive.rotor_inertia)


def _apply(effect: Effect, robot: Robot, joints: dict, lost: list[str]) -> None:
    """Apply an effect to the constants of its joints, or report it as lost."""
    if isinstance(effect, delay.CommandDelay):
        for name, joint in joints.items():
            joints[name] = replace(joint, delay=joint.delay + effect.delay)
        return
    law = LAWS.get(type(effect))
    if law is None and not isinstance(effect, BUILT_IN):
        place = getattr(effect, "joint", "") or getattr(effect, "foot", "")
        lost.append(f"{effect.name}{place and f' of {place}'}: {effect.identity.equation}")
    if law is None:
        return
    for index in robot_joints(effect, robot):
        name = robot.joints[index]
        changed = law(effect, joints[name], float(rest(robot, [index])[0]))
        if changed is None:
            lost.append(f"{effect.name} of {name}: {effect.identity.equation}")
        else:
            joints[name] = changed


def robot_joints(effect: JointEffect, robot: Robot) -> list[int]:
    """Indices of the joints that an effect acts on."""
    able = eligible(robot, effect.among).tolist()
    return [i for i in able if fnmatchcase(robot.joints[i], effect.joint or "*")]


def _scaled(effect: actuator.TorqueConstantError, joint: Joint, _: float) -> Joint:
    by = 1.0 + effect.error
    return replace(joint, kp=by * joint.kp, kd=by * joint.kd, bias=by * joint.bias,
                   limit=by * joint.limit, effort=by * joint.effort)  # fmt: skip


def _limited(effect: actuator.TorqueLimit, joint: Joint, _: float) -> Joint | None:
    less = min(joint.limit, (1.0 - effect.reduction) * (effect.rated or joint.limit))
    return None if joint.kind == SERVO else replace(joint, limit=less)


def _stiffer(effect: compliance.StiffnessError, joint: Joint, _: float) -> Joint:
    by, spring = 1.0 + effect.error, joint.tension
    if spring is None:
        return replace(joint, stiffness=by * joint.stiffness)
    return replace(joint, tension=spring.replace(stiffness=by * spring.stiffness))


def _rotated(effect: compliance.RestAngleError, joint: Joint, _: float) -> Joint | None:
    return None if joint.tension else replace(joint, rest=joint.rest + effect.offset)


# Effects that only change links and contacts before a run.
BUILT_IN = (
    body.Payload, body.ComOffset, body.TrunkFlex, contact.FootFriction, contact.GroundCompliance,
    contact.GroundHeight, contact.Slope,
)  # fmt: skip
LAWS: dict[type, Callable[..., Joint | None]] = {
    friction.CoulombFriction: lambda e, j, _: replace(j, friction=j.friction + e.torque),
    friction.ViscousFriction: lambda e, j, _: replace(j, damping=j.damping + e.damping),
    body.Armature: lambda e, j, _: replace(j, armature=j.armature + e.inertia),
    actuator.JointOffset: lambda e, j, _: replace(j, offset=j.offset + e.offset),
    actuator.ActuatorLag: lambda e, j, _: replace(j, lag=e.time) if j.kind == TORQUE else None,
    actuator.TorqueConstantError: _scaled,
    actuator.TorqueLimit: _limited,
    compliance.StiffnessError: _stiffer,
    compliance.RestAngleError: _rotated,
    compliance.AddedStiffness: lambda e, j, slack: j.sprung(e.stiffness, slack + e.rest),
}
