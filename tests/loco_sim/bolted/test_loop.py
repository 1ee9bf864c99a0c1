# SPDX-License-Identifier: Apache-2.0
"""A bolted robot without the engine does what it does with the engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.bolted.loop import Bolted, Run, Segments, needs_engine
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.world.world import make_world

pytestmark = pytest.mark.pybullet

AIR = {"fixed_base": True, "height": 1.0}
BENCHES = {"pendulum": {}, "servo_pendulum": {}, "linear_axis": {}, "hyq_leg": {}, "tigrillo": AIR}
CLOSE = {"rtol": 0.0, "atol": 1e-6}  # the URDF of HyQ has pi with few digits for the engine
SMALL = {  # parameters with which robots of all sizes stay stable
    "learned_residual": {"weights": (0.005,) * 18, "travel": 9.0, "speed": 99.0},
    "actuator_lag": {"time": 0.002},
    "actuation_delay": {"delay": 0.001},
    "torque_hold": {"period": 0.003},
    "added_stiffness": {"stiffness": 0.5},
    "cubic_stiffness": {"cubic": 0.1},
    "backlash": {"width": 0.002, "inertia": 0.01},
    "series_elasticity": {"compliance": 0.001, "inertia": 0.5},
    "asymmetric_friction": {"forward": 0.03, "backward": 0.06},
    "coupled_friction": {"torque": 0.02, "damping": 0.001, "stroke": 0.1},
    "friction_compensation": {"torque": 0.01, "damping": 0.005},
    "torque_bias": {"torque": 0.05},
    "constant_force": {"force": [0.4, -0.2, 0.3]},
    "torque_ripple": {"sine": 0.03, "cosine": -0.02},
    "gravity_compensation": {"share": 0.6},
    "coulomb_friction": {"torque": 0.05},
    "stribeck_friction": {"torque": 0.05},
    "viscous_friction": {"damping": 0.02},
    "load_friction": {"share": 0.1},
}


def loaded(name: str) -> robot.Robot:
    found = robot.load(name, BENCHES[name])
    return replace(found, sensors=found.sensors.replace(exact=True)) if found.sensors else found


def commands(plant: robot.Robot, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(rows) / plant.control_rate
    n = len(plant.joints)
    wave = np.sin(2.0 * np.pi * np.outer(t, 1.0 + 0.3 * np.arange(n)))
    on = np.zeros(n)
    on[plant.driven] = 1.0
    return (plant.standing + 0.3 * wave) * on, wave * on, 0.3 * wave * on


def with_engine(plant, specs, told, start=None, stance=None) -> Run:
    still = np.zeros(6)
    stance = np.ones((len(told[0]), len(plant.feet)), dtype=bool) if stance is None else stance
    with Simulation(None, effects.from_list(specs), 0, None, plant) as sim:
        state, said = sim.reset() if start is None else sim.place(*start), []
        for k, (q, dq, tau) in enumerate(zip(*told, strict=True)):
            said.append((state.q, state.dq, state.tau))
            t = k * sim.dt
            state = sim.step(MotionCommand(k, t, q, dq), TrunkTorque(k, t, tau, still, stance[k]))
    return Run(*(np.array(column) for column in zip(*said, strict=True)))


def same(first: Run, second: Run) -> None:
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, **CLOSE)


def specs(name: str) -> list[dict]:
    """An effect at its typical size."""
    priors = effects.EFFECTS[name].identity.priors
    typical = {key: prior.typical or prior.high for key, prior in priors.items()}
    for key, value in typical.items():
        default = getattr(effects.EFFECTS[name], key)
        if isinstance(default, tuple):
            typical[key] = (value,) * len(default)
    return [{"name": name, **typical, **SMALL.get(name, {})}]


@pytest.mark.parametrize("name", BENCHES)
def test_a_bare_robot(name):
    plant = loaded(name)
    told = commands(plant, 150)
    same(Bolted(plant).run(*told), with_engine(plant, [], told))


@pytest.mark.parametrize("effect", effects.names())
@pytest.mark.parametrize("name", ["servo_pendulum", "tigrillo"])
def test_a_robot_with_an_effect(name, effect):
    plant, listed = loaded(name), specs(effect)
    made = effects.from_list(listed)
    if effect not in effects.applicable(plant):
        return  # it says so itself
    if effects.base.overrides(made[0], "on_step") and made[0].pull() is None:
        assert "acts on the world" in needs_engine(plant, made)
        return
    if effect == "armature" and len(plant.joints) > 1:
        return  # PyBullet has no rotors: see the test of inertias
    told = commands(plant, 40)
    same(Bolted(plant, made).run(*told), with_engine(plant, listed, told))


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize("name", ["hyq_leg", "tigrillo"])
def test_a_rotor_of_an_effect_or_of_robot_yaml_is_felt_by_its_joint_alone(name, listed):
    plant, at = loaded(name), 0.1
    wanted = Bolted(plant).inertia(plant.standing)
    rotors = effects.from_list([{"name": "armature", "inertia": at, "joint": plant.joints[1]}])
    if listed:
        plant, rotors = replace(plant, armature={plant.joints[1]: at}), []
    wanted[1, 1] += at
    found = Bolted(plant, rotors).inertia(plant.standing)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    world = make_world(plant, plant.sim.replace(engine="mujoco"), 1e-3)
    world.rebuild(plant.standing, [e.configure for e in rotors], plant.height)
    np.testing.assert_allclose(world.joint_inertia(plant.standing), wanted, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", ["linear_axis", "hyq_leg", "tigrillo"])
def test_pushes_and_cables(name):
    plant = loaded(name)
    at = {"point": [0.02, -0.01, 0.03]}
    listed = [
        {"name": "push", "force": [0.4, -0.2, 0.3], "start": 0.1, "stop": 0.3, **at},
        {"name": "cable_force", "stiffness": 2.0, "anchor": [0.5, 0.2, 1.5], "length": 0.3, **at},
    ]
    told = commands(plant, 100)
    made = effects.from_list(listed)
    run = Bolted(plant, made).run(*told)
    same(run, with_engine(plant, listed, told))
    assert not np.allclose(run.q, Bolted(plant).run(*told).q, atol=1e-5)
    made[0].random = 1.0
    assert "push acts on the world" in needs_engine(plant, made)


def test_effects_that_come_and_go_and_mix():
    listed = [
        {"name": "command_delay", "delay": 0.02},
        {"name": "joint_offset", "offset": 0.05, "start": 0.3},
        {"name": "coulomb_friction", "torque": 0.1, "stop": 0.4},
        {"name": "series_elasticity", "compliance": 0.002, "inertia": 0.1},
        {"name": "sensor_latency", "delay": 0.013},
        {"name": "payload", "mass": 0.1},
    ]
    plant = loaded("servo_pendulum")
    told = commands(plant, 80)
    run = Bolted(plant, effects.from_list(listed)).run(*told)
    same(run, with_engine(plant, listed, told))
    late = effects.from_list([listed[3], listed[0]])
    assert "after series_elasticity" in needs_engine(plant, late)


@pytest.mark.parametrize("name", BENCHES)
def test_it_starts_in_any_state(name):
    plant = loaded(name)
    told = commands(plant, 50)
    start = plant.standing - 0.07, 0.5 * np.ones(len(plant.joints))
    same(Bolted(plant).run(*told, start), with_engine(plant, [], told, start))


def test_pieces_are_runs_of_their_own_on_the_clock_of_the_whole():
    plant = loaded("servo_pendulum")
    told = commands(plant, 90)
    bias = [{"name": "joint_offset", "offset": 0.1, "start": 0.5}]
    bench = Bolted(plant, effects.from_list(bias))
    state = np.array([[0.2], [0.0], [0.0]])
    rows = np.array([[10, 40], [50, 80]])
    run = bench.run(*told, segments=Segments(rows, np.stack([state, state])))
    assert np.isnan(run.q[[0, 9, 40, 49, 80]]).all()
    np.testing.assert_allclose(run.q[[10, 50], 0], [0.2, 0.1], **CLOSE)  # as the sensor says
    later = Bolted(plant, effects.from_list([{"name": "joint_offset", "offset": 0.1}]))
    alone = later.run(*(part[50:80] for part in told), start=(state[0], state[1]))
    np.testing.assert_allclose(run.q[50:80], alone.q, **CLOSE)


def test_power_weakens_servos_and_switches_drives_off():
    plant = loaded("servo_pendulum")
    wanted = np.full((60, 1), 0.5)
    full, weak = (
        Bolted(plant).run(wanted, power=np.tile([supply, 1.0], (60, 1))) for supply in (1.0, 0.7)
    )
    off = Bolted(plant).run(wanted, power=np.zeros((60, 2)), start=(np.array([0.3]), np.zeros(1)))
    assert full.q[10, 0] > weak.q[10, 0] > 0.0
    assert np.min(off.q) < 0.0  # it swings
    with Simulation(robot=plant) as sim:
        state = sim.reset()
        sim.power(0.7)
        for k in range(60):
            np.testing.assert_allclose(state.q, weak.q[k], **CLOSE)
            state = sim.step(MotionCommand(k, k * sim.dt, wanted[k], np.zeros(1)))


@pytest.mark.parametrize(
    ("name", "overrides", "why"),
    [
        ("hyq", {}, "not bolted"),
        ("tigrillo", {}, "not bolted"),
        ("servo_pendulum", {}, "round and have noise"),
        ("tigrillo", {"fixed_base": True, "height": 0.1, "sensors.exact": True}, "the ground"),
    ],
)
def test_others_need_the_engine(name, overrides, why):
    plant = robot.load(name, overrides)
    assert why in needs_engine(plant)
    with pytest.raises(ParameterError, match=why):
        Bolted(plant)


def test_a_ramp_between_rows_is_what_finer_rows_say():
    plant = loaded("pendulum")
    wave = 0.3 * np.sin(0.2 * np.arange(60))[:, None]
    ramp = Bolted(plant).run(0.0 * wave, None, wave, ramps=(False, False, True))
    fine = np.interp(np.arange(300) / 5.0, np.arange(60), wave[:, 0])[:, None]
    held = Bolted(plant, dt=0.001).run(0.0 * fine, None, fine)
    np.testing.assert_allclose(ramp.q, held.q[::5], **CLOSE)
    plain = Bolted(plant).run(0.0 * wave, None, wave)
    assert np.max(np.abs(plain.q - ramp.q)) > 1e-4


def test_a_joint_that_may_be_fast_is_not_clipped(tmp_path):
    urdf = robot.load("linear_axis").urdf.replace('velocity="2"', 'velocity="900"')
    urdf = urdf.replace('lower="-0.4" upper="0.4"', 'lower="-9e3" upper="9e3"')
    plant = replace(robot.load("linear_axis"), urdf=urdf.replace("0.05 0.03", "0.05 0.0301"))
    told = np.zeros((4, 1)), np.zeros((4, 1)), np.zeros((4, 1))
    start = np.zeros(1), np.array([400.0])
    same(Bolted(plant).run(*told, start), with_engine(plant, [], told, start))
    assert Bolted(plant).run(*told, start).q[1, 0] > 0.9


def test_gains_change_with_the_legs_that_swing():
    hyq = robot.load("hyq", AIR)
    told = commands(hyq, 60)
    stance = np.random.default_rng(2).uniform(size=(60, 4)) < 0.5
    swinging = np.array([hyq.swinging(flags) for flags in stance])
    run = Bolted(hyq).run(*told, swinging=swinging)
    same(run, with_engine(hyq, [], told, stance=stance))
    assert np.max(np.abs(run.tau - Bolted(hyq).run(*told).tau)) > 1.0


@pytest.mark.parametrize("rate", [400.0, 4000.0, 250.0])
def test_without_a_period_it_is_the_closest_one_to_the_control_period_that_fits(rate):
    """Drives run at rates that are no divisors of that of the physics."""
    plant = replace(loaded("pendulum"), control_rate=rate)
    steps = Bolted(plant).dt * plant.sim.physics_rate
    assert steps == pytest.approx(round(steps)) and steps >= 1.0
    assert abs(steps - plant.sim.physics_rate / rate) <= 1.0
    with pytest.raises(ParameterError, match="whole multiple of the physics step"):
        Bolted(plant, dt=0.4 / plant.sim.physics_rate)


def test_without_a_gear_stiffness_the_rotor_turns_with_the_joint():
    """A servo of any size: its gear is not that of a small one."""
    gear = {"drives.*.gear_stiffness": 0.0}
    plain = {**gear, "drives.*.rotor_inertia": 0.0, "dynamics.*.armature": 0.003}
    both = [replace(robot.load("servo_pendulum", v), sensors=None) for v in (gear, plain)]
    rigid, rotor = (Bolted(one).run(*commands(one, 200)).q for one in both)
    assert np.ptp(rigid) > 0.1
    np.testing.assert_array_equal(rigid, rotor)


@pytest.mark.parametrize("effect", ["", "actuator_lag", "coulomb_friction", "armature"])
def test_damping_of_joints_needs_no_finer_steps_whatever_acts(effect):
    """Far above the limit of explicit damping; the error falls with the step, as elsewhere."""
    plant = robot.load("hyq_leg", {"sim.max_substeps": 1000})
    inertia = np.diag(Bolted(plant, []).inertia(plant.standing)).min()
    heavy = {f"dynamics.{joint}.damping": 20.0 * inertia / 0.001 for joint in plant.joints}
    acting = specs(effect) if effect else []

    def moved(**how) -> tuple[float, np.ndarray]:
        values = {f"sim.{name}": value for name, value in how.items()}
        found = robot.load("hyq_leg", {"sim.max_substeps": 1000, **heavy, **values})
        bolted = Bolted(found, effects.from_list(acting), 0, 0.004)
        return bolted.physics_dt, bolted.run(*commands(found, 250)).q

    step, by_default = moved()
    _, half = moved(physics_rate=2000.0)
    explicit, fine = moved(implicit_damping=False, physics_rate=4000.0)
    assert step > 20.0 * explicit
    errors = [np.sqrt(np.mean((q - fine) ** 2)) for q in (by_default, half)]
    assert errors[0] < 0.02 * np.std(fine)
    assert 1.5 < errors[0] / errors[1] < 2.5
