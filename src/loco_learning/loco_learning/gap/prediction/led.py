# SPDX-License-Identifier: Apache-2.0
"""Inverse dynamics: the torque along the measured motion is compared with the commanded one.

With torque commands and no position feedback, an error of the torque grows with the square of
time, so that any simulation departs from the measurement within a second. Here a stiff drive
tracks the measured motion, so that no initial state has to be known. The torque that it adds to
the commanded one is the gap, at its joint and time, with all effects as they act in a simulation.
With a drive that lags, the torque has to be commanded earlier; in the tracking drive a lag would
be unstable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import binary_dilation, binary_opening, gaussian_filter1d

from loco_control.params import limits
from loco_sim import lazy
from loco_sim.bolted.loop import Bolted
from loco_sim.effects import EFFECTS, from_list
from loco_sim.effects.base import Effect
from loco_sim.effects.chain import DriveEffect
from loco_sim.effects.rows import DELAY, HOLD, LAG
from loco_sim.params import SimParams
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ImpedanceDrive, TorqueDrive
from loco_sim.world.world import Setting

from ..recordings.record import Record, bridged
from ..statistics.free import Free, free
from . import nominal, running
from .channels import Channel
from .forward import Forward, ForwardParams

interpolate = lazy.module("scipy.interpolate")  # loaded on first use

COARSE = 0.006  # time between rows [s]: torques of a body change more slowly (taste)
STEPS = 2  # physics steps in a row (theory: a quarter of the drive's time constant)
STIFFNESS = 0.6  # bandwidth of the tracking drive times the time between rows (theory: stable)
# Standard deviation of the Gaussian filter of the motion, and of both torques [s]. On an arm of
# seven joints (docs/gap_measured.md) shorter ones leave the noise of the second derivative.
SMOOTH = 0.03
# Speed over its rms below which a joint is stationary, if it remains so for `MARGIN` deviations of
# the filter: friction, not the motion, then decides the torque (taste).
STATIONARY = 0.1
MARGIN = 2.0  # deviations of the filter, also at either end: filtered torques there contain it
NOTED = (
    0.05  # share of the time for which a joint is stationary from which on a note says so (taste)
)
TRIM = 5.0  # filter deviations from either end within which nothing is compared (theory)
DECAY_TIMES = 3.0  # time constants after which an initial state has decayed to 1/20 (theory)
# Share of the torque of every joint that its velocity explains, from which on there is feedback:
# friction explains 0.98 of a light wrist and 0.46 of the arm's shoulder (taste).
FED_BACK = 0.7
# Torque of the inertia of every joint over that of its drive, from which on a body swings: 2.2 of a
# pendulum whose controller pumps it, 0.2 of an arm at low speed, where friction takes the torque.
SWINGS = 1.0
# Displacement by the mean torque, over the deviation of the position, from which on a torque that
# is a tenth off moves a joint out of its travel, as beside the weight of a link (taste).
HELD = 10.0
WINDOWS = (2.0, 1.0, 0.5, 0.25)  # lengths of pieces [s] (taste)
CHANGED = 4.0  # length of a piece over the time scale of the motion (docs/gap_measured.md)
_, SUBSTEPS = limits(SimParams, "max_substeps")
POSES = 7  # poses of the record at which inertias are computed
COMMAND_SITES = ("command", "drive")  # sites of effects that change the commanded torque
LEADS = ("torque_constant_error", "joint_offset")  # effects of `COMMAND_SITES` that act here too
LATE = (DELAY, HOLD, LAG)  # laws with which a torque comes late
# Sites that an effect may touch, see `Identity.touches`.
SITES = ("drive", "torque", "brake", "force", "model")
OF_BASE = ("orientation", "angular_velocity", "linear_acceleration")  # readings not compared here


def forward(
    model: Model, records: Sequence[Record], params: ForwardParams | None = None
) -> Forward:
    """Forward model of the kind that is suitable for the records.

    It simulates whole records if initial states decay within a record and a small error of the
    torques moves no joint out of its travel, and otherwise computes torques along the motion. If a
    controller computed the torque from the velocity, so that friction would explain all of it, if a
    joint has no drive, whose small torques acceleration hides, or if no torque was commanded, it
    simulates pieces that start in the measured state. The choice depends on commands, measurements
    and the inertia of the given model, never on what is tried, so that all models are compared
    alike.
    """
    direct = Forward(model, records, params)
    if direct.params.window or not torque_driven(direct):
        return direct
    responses = measured(direct)
    longest = CHANGED * min(joint.time for joint in responses)
    window = next((w for w in WINDOWS if w <= longest), WINDOWS[-1])
    divided = direct.params.replace(window=window)
    if min(joint.fed_back for joint in responses) >= FED_BACK and np.min(swings(direct)) >= SWINGS:
        return Forward(model, records, divided)
    duration = float(np.mean([record.duration for record in records]))
    decays = min(joint.decay for joint in responses) * duration >= DECAY_TIMES
    if decays and not (possible(direct) and max(joint.shift for joint in responses) > HELD):
        return direct
    if not possible(direct) or not told(direct):
        return Forward(model, records, divided)
    return InverseDynamics(model, records, params)


def measured(forward: Forward) -> list[Free]:
    """Velocity feedback and memory of each driven joint, estimated from the records alone."""
    robot, responses = forward.robot(), []
    for column, joint in enumerate(robot.driven):
        motions = []
        for record in forward.records:
            q = bridged(record.read_of(robot, "q")[:, [joint]])[:, 0]
            valid = np.flatnonzero(np.isfinite(q))
            rows = slice(valid[0], valid[-1] + 1)
            torque = _acting(record, robot)[:, column]
            motions.append((q[rows], torque[rows], record.dt))
        responses.append(free(motions))
    return responses


def swings(forward: Forward) -> np.ndarray:
    """Torque that the inertia of each driven joint takes, over that of its drive, (m,)."""
    inertial, measured = [], []
    for record in forward.records:
        robot = forward.model.make_robot(record.overrides)
        q = bridged(record.read_of(robot, "q"))
        rows = np.isfinite(q).all(axis=1)
        inertia = _inertia(record, robot, np.zeros(len(robot.joints)))
        torque = _acting(record, robot)
        acceleration = smoothed(q[rows], record.dt, order=2)
        inertial.append(np.var(inertia * acceleration, axis=0)[robot.driven])
        measured.append(np.var(torque[rows], axis=0))
    return np.sqrt(np.sum(inertial, axis=0) / np.maximum(np.sum(measured, axis=0), 1e-300))


def told(forward: Forward) -> bool:
    """True if a torque was commanded; torques of 0 are no measurement of those along a motion."""
    return any(
        np.any(_acting(record, forward.robot(i))) for i, record in enumerate(forward.records)
    )


def possible(forward: Forward) -> bool:
    """True if every joint is measured and commanded by torque, without quantisation."""
    robots = [forward.robot(i) for i in range(len(forward.records))]
    return torque_driven(forward) and all(len(r.driven) == len(r.joints) for r in robots)


def torque_driven(forward: Forward) -> bool:
    """True if every joint is measured, and every joint with a drive commanded by torque."""
    robots = [forward.robot(i) for i in range(len(forward.records))]
    return all(
        robot.fixed_base
        and all(isinstance(drive, TorqueDrive) for drive in robot.drives.values())
        and np.isfinite(record.joints_of(robot, "q")).any(axis=0).all()
        for robot, record in zip(robots, forward.records, strict=True)
    )


class InverseDynamics(Forward):
    """A `Forward` whose channels are the commanded torques; arguments as of `Forward`.

    Effects of the model on commands and drives change the commanded torque as in a simulation;
    effects on sensors alone are left out.
    """

    how, fine_steps = "torque along the measured motion", False

    def __init__(
        self,
        model: Model,
        records: Sequence[Record],
        params: ForwardParams | None = None,
        loaded: dict[Any, Robot] | None = None,
    ):
        records = _with_torques(model, records)
        model = replace(model, effects=[e for e in model.effects if not _outside(e)])
        robots = [model.make_robot(record.overrides) for record in records]
        pairs = list(zip(records, robots, strict=True))
        prescribed = [_prescribe(record, robot) for record, robot in pairs]
        # Friction larger than the damping of the drives would hold the joints back: these get an
        # inertia with which, at most, they are late by a row, and its torque is subtracted.
        self._added = np.max([_damping(record) for record in prescribed], axis=0) / STIFFNESS**2
        inertia = np.mean([_inertia(*pair, self._added) for pair in pairs], axis=0)
        self._gains = np.maximum(inertia, 1e-9 * np.max(inertia))
        params = (params or ForwardParams()).replace(signals=("tau",))
        super().__init__(model, prescribed, params, loaded)
        self._commands = [self._leading(index) for index in range(len(prescribed))]

    def _leading(self, index: int) -> running.CommandSequence:
        """Commands ahead of a motion by the error with which the given model tracks it.

        Without them the torque is that of a motion which falls short of fast ones: by (w/n)² of it
        at a frequency w, with n the bandwidth of the tracking drive.
        """
        inputs, robot = self._commands[index], self._robot(index, {}, 1.0)
        readings = self._tracked(index, robot, from_list(self.model.effects))
        n = len(robot.joints)
        q, dq = (2.0 * inputs.q - readings[:, :n], 2.0 * inputs.dq - readings[:, n:])
        return inputs._replace(q=q, dq=dq) if np.isfinite(q + dq).all() else inputs

    @cached_property
    def _joints(self) -> tuple[Channel, ...]:
        """Channels of the positions, then of the velocities of all joints."""
        joints = self.robot(0).joints
        return tuple(Channel(s, j, "") for s in ("q", "dq") for j in joints)

    def _robot(self, index: int, overrides: Mapping[str, Any], step: float) -> Robot:
        """The robot with drives that track the motion, without sensors."""
        heavy = super()._robot(index, overrides, step)
        rate = STIFFNESS / self.records[index].dt
        drives = {
            joint: ImpedanceDrive(kp=float(m * rate**2), kd=float(2.0 * m * rate))
            for joint, m in zip(heavy.joints, self._gains, strict=True)
        }
        physics = STEPS / (running.period(self.records[index]) * step)
        free = np.full(len(heavy.joints), np.inf)
        # links may be refitted to 1/1000 of their inertia, which these gains then overdamp
        sim = heavy.sim.replace(physics_rate=physics, damping_limit=1.0, max_substeps=SUBSTEPS)
        rotors = {
            joint: heavy.armature.get(joint, 0.0) + float(by)
            for joint, by in zip(heavy.joints, self._added, strict=True)
        }
        return replace(heavy, drives=drives, armature=rotors, effort=free, sensors=None, sim=sim)

    def shown(self, hypotheses: Sequence[Any]) -> list[Any]:
        """Hypotheses that change a torque, one per body, without those on refitted values."""
        robot = self.given()
        loose = {name.partition(".")[0] for name in robot.uncertain}
        text, out = Description(robot.urdf), {"mass"} if "bodies" in loose else set()
        bodies = {text.child(joint) for joint in robot.joints}
        return [
            h
            for h in hypotheses
            if _changes_torques(h.effect)
            and EFFECTS[h.effect].identity.kind not in out
            and (h.place not in text.links() or h.place in bodies)
        ]

    def given(self, overrides: Mapping[str, Any] | None = None) -> Robot:
        """The robot of the first record with its own drives instead of the tracking ones."""
        return super()._robot(0, nominal.split_drives(overrides or {})[0], 1.0)

    def _run(self, index: int, effects: Any, overrides: Mapping, step: float) -> np.ndarray:
        robot = self._robot(index, overrides, step)
        effects = from_list([*self.model.effects, *effects])
        late = [effect for effect in effects if _is_late(type(effect))]
        inputs, dt = self._commands[index], running.period(self.records[index])
        readings, n = self._tracked(index, robot, effects), len(robot.joints)
        servos = [robot.drives[joint] for joint in robot.joints]
        torque = np.array([d.kp for d in servos]) * (_received(inputs.q) - readings[:, :n])
        torque += np.array([d.kd for d in servos]) * (_received(inputs.dq) - readings[:, n:])
        own = super()._robot(index, overrides, step)
        torque = smoothed(torque, dt) - self._added * smoothed(readings[:, n:], dt, order=1)
        torque = _earlier(torque, late, own, dt)
        bias, gain = _motor_lines(own)
        mean = (torque - bias) / gain
        return mean[:, [robot.joints.index(c.name) for c in self.channels]]

    def _tracked(self, index: int, robot: Robot, effects: Sequence[Effect]) -> np.ndarray:
        """Positions, then velocities of the tracking robot in a record, (T, 2n).

        Effects that delay the torque are left out.
        """
        effects = [effect for effect in effects if not _is_late(type(effect))]
        inputs, record = self._commands[index], self.records[index]
        starts = [running.Start(0, len(record.t), inputs.q[0], inputs.dq[0])]
        return running.run(robot, effects, inputs, starts, running.period(record), self._joints)


def _motor_lines(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Bias [N·m] and gain of the drive of each joint, (n,) each."""
    drives = [robot.drives[joint] for joint in robot.joints]
    return np.array([drive.bias for drive in drives]), np.array([drive.gain for drive in drives])


def _earlier(torque: np.ndarray, effects: Sequence[Effect], robot: Robot, dt: float) -> np.ndarray:
    """Torque that drives must be commanded, so that they give a torque in spite of delays, (T, n).

    Args:
        torque: Smooth torque of each joint [N·m], (T, n).
        effects: Delays and lags of drives, in the order in which they act.
        robot: The robot.
        dt: Time between rows [s].
    """
    t, result = dt * np.arange(len(torque)), torque.copy()
    for effect in reversed(effects):
        effect.configure(Setting(robot, robot.sim, dt))
        curve = interpolate.CubicSpline(t, result[:, effect.joints])
        if effect.law == LAG:
            result[:, effect.joints] += effect.time * curve(t, 1)
        else:
            result[:, effect.joints] = curve(np.minimum(t + effect.lateness, t[-1]))
    return result


def _received(values: np.ndarray) -> np.ndarray:
    """Mean about each row of a command that is linear between rows, (T, n).

    The mean of the chord differs from that of the arc by 1/12 of the second difference.
    """
    bend = np.zeros(values.shape)
    bend[1:-1] = np.diff(values, 2, axis=0) / 12.0
    return values + bend


def smoothed(values: np.ndarray, dt: float, order: int = 0) -> np.ndarray:
    """Values after a Gaussian filter of `SMOOTH`, or their derivative of an order, (T, n)."""
    low = gaussian_filter1d(values, SMOOTH / dt, axis=0, order=order, mode="nearest")
    return low / dt**order


def _is_late(effect: type[Effect]) -> bool:
    """True if with an effect of a class the torque of a drive comes late."""
    return issubclass(effect, DriveEffect) and effect.law in LATE


def _outside(effect: Mapping[str, Any]) -> bool:
    """True if an effect does not act in a computation along the measured motion."""
    name, touches = effect["name"], set(EFFECTS[effect["name"]].identity.touches)
    acts = _acts(effect) or not touches & set(SITES)
    return acts and name not in LEADS and not _is_late(EFFECTS[name])


def _changes_torques(name: str) -> bool:
    """True if an effect changes a torque and no reading of a joint, as a slope beside an IMU."""
    touches = set(EFFECTS[name].identity.touches)
    return bool(touches & set(SITES)) and touches <= {*SITES, *OF_BASE}


def _acts(effect: Mapping[str, Any]) -> bool:
    """True if an effect acts on commands or drives."""
    return bool(set(EFFECTS[effect["name"]].identity.touches) & set(COMMAND_SITES))


def _with_torques(model: Model, records: Sequence[Record]) -> list[Record]:
    """Records whose torques have passed through the model's effects on commands and drives."""
    acting = [e for e in model.effects if _outside(e) and _acts(e)]
    if not acting:
        return list(records)
    result = []
    for record in records:
        robot = model.make_robot(record.overrides)
        torque = record.command_of(robot, "torque")
        signals = {**record.signals, "tau": torque}
        with_torque = replace(record, signals=signals, joint_torque=False)
        params = ForwardParams(window=WINDOWS[-1], signals=("tau",))
        runs = Forward(Model(model.robot, model.overrides, acting), [with_torque], params)
        bias, gain = _motor_lines(robot)
        commanded = (bridged(runs()[0]) - bias) / gain
        result.append(replace(record, command={**record.command, "torque": commanded}))
    return result


def _damping(record: Record) -> np.ndarray:
    """Impulse of a row by the part of each torque that follows its velocity, over that, (n,)."""
    torque, speed = record.signals["tau"], record.signals["dq"]
    valid = np.isfinite(torque)
    along = np.sum(np.where(valid, torque * speed, 0.0), axis=0)
    return record.dt * np.abs(along) / np.maximum(np.sum(valid * speed**2, axis=0), 1e-12)


def _inertia(record: Record, robot: Robot, added: np.ndarray) -> np.ndarray:
    """Inertia of each joint, with rotors, while the others move freely, mean over poses, (n,)."""
    q = record.joints_of(robot, "q")
    q = q[np.isfinite(q).all(axis=1)]
    rows = np.linspace(0, len(q) - 1, POSES).astype(int)
    plant = Bolted(replace(robot, sensors=None))
    each = [plant.inertia(at) + np.diag(added) for at in q[rows]]
    return np.mean([1.0 / np.diag(np.linalg.inv(inertia)) for inertia in each], axis=0)


def _acting(record: Record, robot: Robot) -> np.ndarray:
    """Commanded torque, mean about each row, (T, m)."""
    torque = record.command_of(robot, "torque")
    if "torque" in record.ramps:
        return torque
    # zero-order hold from its time stamp on: each value acts half before the next row
    return 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))


def _stationary(speed: np.ndarray, dt: float) -> np.ndarray:
    """True where a joint is stationary, and within the width of the filter of it, (T, n)."""
    slow = np.abs(speed) < STATIONARY * np.sqrt(np.mean(np.square(speed), axis=0))
    width = round(MARGIN * SMOOTH / dt)
    shortest, window = (np.ones((rows + 1, 1), dtype=bool) for rows in (width, 2 * width))
    return binary_dilation(binary_opening(slow, shortest), window)


def _prescribe(record: Record, robot: Robot) -> Record:
    """A record with the measured motion as the command and the commanded torque as a signal.

    Both pass the same filter and are subsampled: the motion to `COARSE`, torques to `SMOOTH`.
    Torques of a stationary joint are not compared: any up to its friction leaves it there.
    """
    measured, torque = record.read_of(robot, "q"), _acting(record, robot)
    valid, dt = np.isfinite(measured).all(axis=1), record.dt
    filled = bridged(np.where(valid[:, None], measured, np.nan))
    q, dq = smoothed(filled, dt), smoothed(filled, dt, order=1)
    every = max(1, round(COARSE / dt))
    selected = slice(0, len(record.t) // every * every, every)
    stationary = _stationary(dq, dt)
    compared = valid[:, None] & ~stationary
    shares = zip(robot.joints, stationary.mean(axis=0), strict=True)
    notes = [f"{joint} is stationary {share:.0%} of the time: its torque, which friction may hold, "
             "is not compared there" for joint, share in shares if share > NOTED]  # fmt: skip
    tau = np.where(compared, smoothed(smoothed(torque, dt), dt), np.nan)[selected]
    between = max(1, round(SMOOTH / (every * dt)))
    tau[np.arange(len(tau)) % between != 0] = np.nan
    margin = round(TRIM * SMOOTH / (every * dt))
    tau[:margin], tau[len(tau) - margin :] = np.nan, np.nan
    t = record.t[selected]
    return replace(
        record,
        t=t - t[0],
        command={"position": q[selected], "velocity": dq[selected]},
        ramps=("position", "velocity"),
        driven=robot.joints,
        joints=robot.joints,
        signals={"q": q[selected], "dq": dq[selected], "tau": tau},
        inputs={},
        stance={},
        resolution={},
        guessed={},
        moved={},
        notes=(*record.notes, *notes),
    )
