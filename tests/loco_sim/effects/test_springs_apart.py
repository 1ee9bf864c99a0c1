# SPDX-License-Identifier: Apache-2.0
"""Drives and the springs beside them are apart: what a motor lacks, a spring does not lack."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import loco_sim
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.bolted.loop import Bolted
from loco_sim.effects.base import EFFECTS
from loco_sim.export.portable import portable
from loco_sim.plant.compiled import Compiled
from loco_sim.plant.model import Model
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.servo import ImpedanceDrive, ServoParams, TorqueDrive
from loco_sim.robot.spring import SpringParams

ROOT = Path(loco_sim.__file__).parent
STEPS, BEGIN, DRIVEN = 60, 0.05, np.array([0])
BENCHES = {"spring_mass": 50.0, "pendulum": 2.0, "linear_axis": 80.0}  # stiffness of springs
IMPEDANCE = ImpedanceDrive(kp=40.0, kd=0.5)
SERVO = ServoParams(stall_torque=2.0, no_load_speed=6.0, kp=4.0)


def sprung(name, drive, path="bolted"):
    """A bench whose joint has a drive and a spring beside it."""
    engine = "pybullet" if path == "pybullet" else "mujoco"
    bench = robot.load(name, {"sim.engine": engine})
    joint = bench.joints[0]
    spring = SpringParams(kind="linear", stiffness=BENCHES[name], damping=0.05, rest=-0.02)
    drives, springs = {joint: drive}, {joint: spring}
    effort = np.array([30.0])
    return replace(bench, drives=drives, springs=springs, effort=effort, height=2.0, driven=DRIVEN)


OFF = {"torque, told nothing": (TorqueDrive(), 1.0), "impedance, off": (IMPEDANCE, 0.0),
       "servo, off": (SERVO, 0.0)}  # fmt: skip


def clear(name):
    """The effect with a strength that shows, all else as it is by default."""
    known = EFFECTS[name].identity
    priors = {key: known.priors[key] for key in known.strengths}
    return effects.make(
        name, **{k: p.typical if p.low > 0.0 else p.high for k, p in priors.items()}
    )


def stepped(bench, listed, on, compiled):
    with Simulation(effects=listed, robot=bench, standing=np.array([BEGIN])) as sim:
        if not compiled:
            sim._slow_reason = "a test"
            sim.reset()
        assert isinstance(sim.loop, Compiled) == compiled
        sim.power(1.0, on)
        for k in range(STEPS):
            trunk = TrunkTorque(k, 0.0, np.zeros(1), np.zeros(6), np.ones(0, bool))
            state = sim.step(MotionCommand(k, 0.0, np.zeros(1), np.zeros(1)), trunk)
            yield sim.true_q[0], sim.true_dq[0], state.tau[0]


def run(path, bench, listed=(), on=1.0):
    """Positions and velocities of the joint, let go where its spring is bent, (T, 2)."""
    return readings(path, bench, listed, on)[:, :2]


def readings(path, bench, listed=(), on=1.0):
    """As `run`, with the measured torque, (T, 3)."""
    if path == "bolted":
        power, nothing = np.full((STEPS, 2), (1.0, on)), np.zeros((STEPS, 1))
        start = np.array([BEGIN]), np.zeros(1)
        found = Bolted(bench, listed).run(nothing, start=start, power=power)
        return np.column_stack([found.q, found.dq, found.tau])
    return np.array(list(stepped(bench, listed, on, path == "compiled")))


def of_motors(bench):
    """Effects on what drives are told and give."""
    return ["load_friction"] + [
        name
        for name in effects.applicable(bench)
        if set(EFFECTS[name].identity.touches) <= {"command", "drive"}
    ]


PATHS = ["bolted", "compiled", "stepwise", pytest.param("pybullet", marks=pytest.mark.pybullet)]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("state", OFF)
@pytest.mark.parametrize("name", BENCHES)
def test_no_effect_of_a_motor_that_gives_nothing_moves_a_sprung_joint(name, state, path):
    drive, on = OFF[state]
    bench = sprung(name, drive, path)
    bare = run(path, bench, on=on)
    assert np.ptp(bare[:, 0]) > 0.01, "the spring pulls"
    names = of_motors(sprung(name, drive))
    assert len(names) >= 8
    for effect in names:
        moved = run(path, bench, [clear(effect)], on)
        assert moved.tobytes() == bare.tobytes(), effect


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("effect", ["stiffness_error", "rest_angle_error", "spring_saturation",
                                    "hysteresis", "coulomb_friction", "added_stiffness"])  # fmt: skip
def test_effects_of_the_spring_itself_are_there_with_the_motor_off(effect, path):
    bench = sprung("spring_mass", IMPEDANCE, path)
    assert run(path, bench, [clear(effect)], 0.0).tobytes() != run(path, bench, on=0.0).tobytes()


@pytest.mark.parametrize("path", PATHS)
def test_a_motor_that_gives_half_beside_a_spring_is_a_drive_of_half_the_gains(path):
    weak, half = (
        effects.make("torque_constant_error", error=-0.5),
        IMPEDANCE.replace(kp=0.5 * IMPEDANCE.kp, kd=0.5 * IMPEDANCE.kd),
    )
    found = run(path, sprung("spring_mass", IMPEDANCE, path), [weak])
    wanted = run(path, sprung("spring_mass", half, path))
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert np.abs(found - run(path, sprung("spring_mass", IMPEDANCE, path))).max() > 1e-3


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("effect", ["added_stiffness", "hysteresis", "end_stop", "torque_bias"])
def test_a_motor_current_tells_nothing_of_springs_and_effects_beside_the_drive(effect, path):
    joint = sprung("spring_mass", IMPEDANCE, path)
    motor = replace(joint, motor_torque=True)
    alone, beside = readings(path, motor, on=0.0), readings(path, joint, on=0.0)
    assert not alone[1:, 2].any(), "the motor is off"
    assert np.abs(beside[1:, 2]).max() > 0.5, "the spring pulls"
    listed = [clear(effect)]
    found, wanted = readings(path, motor, listed), readings(path, joint, listed)
    assert found[:, :2].tobytes() == wanted[:, :2].tobytes(), "the motion is the same"
    assert np.abs(found[1:, 2] - wanted[1:, 2]).max() > 0.5
    wound = IMPEDANCE.kp * found[:, 0] + IMPEDANCE.kd * found[:, 1]
    assert np.corrcoef(-wound[1:], found[1:, 2])[0, 1] > 0.99, "what the drive does, no more"


def test_a_motor_that_gives_half_is_exported_beside_its_spring(tmp_path):
    """The actuator is weaker, the spring of the joint is as it was, and nothing is lost."""
    shutil.copytree(ROOT / "assets" / "spring_mass", tmp_path, dirs_exist_ok=True)
    with (tmp_path / "robot.yaml").open("a") as file:
        file.write("drives:\n  spring: {kind: impedance, kp: 40, kd: 0.5}\n")
    listed = [{"name": "torque_constant_error", "error": -0.5}]
    found = portable(Model(str(tmp_path / "robot.yaml"), {}, listed))
    (joint,) = found.joints
    assert (joint.kp, joint.kd, joint.stiffness) == (20.0, 0.25, 50.0)
    assert found.lost == []


def test_where_an_added_spring_is_slack_is_told_in_the_angle_of_the_joint():
    leg = robot.load("pendulum")
    posed = replace(leg, standing=leg.standing - 0.25)
    spring = effects.make("added_stiffness", joint="pivot", stiffness=14.0, rest=-0.151)
    assert spring.amount(posed) == "it is slack at -0.401 rad"
    assert effects.make("added_stiffness", stiffness=14.0).amount(posed) == ""
