# SPDX-License-Identifier: Apache-2.0
"""Laws of the effects in the joints, on one-joint benches and by hand."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.bolted.loop import Bolted
from loco_sim.drives.servo_kernels import motor_torque
from loco_sim.effects.chain import DriveEffect
from loco_sim.effects.readings import Layout, behind
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.world.braking import split
from loco_sim.world.world import Setting

INERTIA, ARM = 0.00667 + 0.5 * 0.2**2, 0.5 * 0.2  # of the pendulum's rod; mass times lever
BENCH = robot.load("pendulum")


def swing(listed, tau=0.0, begin=0.0, steps=400, gravity=True):
    """Positions, velocities and motor torques of the pendulum, every physics step."""
    sim_params = BENCH.sim if gravity else BENCH.sim.replace(gravity=0.0)
    made = effects.from_list(listed)
    dt = 1.0 / BENCH.sim.physics_rate
    rows = []
    with Simulation(sim_params, made, dt=dt, robot=BENCH, standing=np.array([begin])) as sim:
        for k in range(steps):
            torque = tau(k * dt) if callable(tau) else tau
            trunk = TrunkTorque(k, 0.0, np.array([torque]), np.zeros(6), np.ones(0, bool))
            state = sim.step(MotionCommand(k, 0.0, np.zeros(1), np.zeros(1)), trunk)
            rows.append((sim.true_q[0], sim.true_dq[0], state.tau[0]))
    return np.array(rows).T


@pytest.mark.pybullet
@pytest.mark.parametrize("load", [0.0, 0.1, -0.29])
def test_a_joint_at_rest_below_the_budget_stays_exactly_at_rest(load):
    q, dq, tau = swing([{"name": "coulomb_friction", "torque": 0.3}], tau=load)
    assert np.all(q == 0.0)
    assert np.all(dq == 0.0)
    assert np.all(tau == load), "friction is no part of the motor's torque"


def test_above_the_budget_it_moves_with_what_is_left():
    _, dq, _ = swing([{"name": "coulomb_friction", "torque": 0.3}], tau=0.5, steps=20)
    assert dq[-1] == pytest.approx(0.2 / INERTIA * 0.02, rel=0.02)


@pytest.mark.pybullet
def test_a_sliding_joint_slows_by_budget_over_inertia_and_stops_without_a_sign_flip():
    def kick(t):
        return 0.5 if t < 0.05 else 0.0

    friction = [{"name": "coulomb_friction", "torque": 0.1}]
    q, dq, _ = swing(friction, tau=kick, gravity=False)
    sliding = np.flatnonzero(dq > 0.02)
    sliding = sliding[sliding > 55]
    slope = np.diff(dq[sliding]) * BENCH.sim.physics_rate
    bearing = 0.002 * dq[sliding[:-1]]  # the bench's own damping
    np.testing.assert_allclose(slope * INERTIA, -0.1 - bearing, rtol=0.02)
    assert dq.min() >= -1e-12
    assert np.ptp(q[-50:]) == 0.0


@pytest.mark.pybullet
def test_friction_of_several_effects_adds_up():
    pair = [
        {"name": "coulomb_friction", "torque": 0.1},
        {"name": "stribeck_friction", "torque": 0.1},
    ]
    assert np.all(swing(pair, tau=0.19)[0] == 0.0)
    assert swing(pair, tau=0.21)[0][-1] > 0.0


def test_friction_in_proportion_to_the_load_holds_what_it_carries():
    gear = [{"name": "load_friction", "share": 0.9}]
    free = swing([], tau=0.2, steps=100)[0]
    assert 0.0 < swing(gear, tau=0.2, steps=100)[0][-1] < 0.2 * free[-1]


def test_viscous_friction_decays_and_is_stable_however_large():
    def kick(t):
        return 0.5 if t < 0.05 else 0.0

    _, dq, _ = swing([{"name": "viscous_friction", "damping": 0.1}], tau=kick, gravity=False)
    rate = -np.diff(np.log(dq[60:120])) * BENCH.sim.physics_rate
    np.testing.assert_allclose(rate, 0.102 / INERTIA, rtol=0.05)
    _, stiff, _ = swing([{"name": "viscous_friction", "damping": 1000.0}], tau=kick)
    assert np.abs(stiff).max() <= 1.01 * 0.5 * 0.001 / INERTIA, "what one step makes, no more"


def test_what_a_torque_brakes_and_what_the_engine_brakes_is_the_whole_budget():
    budget, dq = np.array([1.0, 1.0, 1.0, 0.0]), np.array([5.0, -5.0, 0.01, 0.0])
    motor, drag = both = np.empty((2, 4))
    split(budget, dq, np.full(4, 0.1), both)
    np.testing.assert_array_equal(motor, [0.0, 0.0, 1.0, 0.0])
    np.testing.assert_array_equal(np.abs(drag) + motor, budget)
    assert np.all(drag * dq <= 0.0)


def test_an_added_spring_raises_the_frequency_as_it_should():
    k = 1.0
    q, _, _ = swing([{"name": "added_stiffness", "stiffness": k}], begin=0.1, steps=2000)
    crossings = np.flatnonzero((q[:-1] > 0.0) & (q[1:] <= 0.0))
    period = np.mean(np.diff(crossings)) / BENCH.sim.physics_rate
    assert period == pytest.approx(2.0 * math.pi * math.sqrt(INERTIA / (ARM * 9.81 + k)), rel=0.01)


def test_an_armature_slows_the_swing_as_it_should():
    q, _, _ = swing([{"name": "armature", "inertia": INERTIA}], begin=0.1, steps=3000)
    crossings = np.flatnonzero((q[:-1] > 0.0) & (q[1:] <= 0.0))
    period = np.mean(np.diff(crossings)) / BENCH.sim.physics_rate
    assert period == pytest.approx(2.0 * math.pi * math.sqrt(2 * INERTIA / (ARM * 9.81)), rel=0.01)


class Bare:
    """A world of three joints, for laws that are called by hand."""

    dt = 0.001

    def __init__(self):
        self.robot = robot.load("hyq")
        self.driven = self.robot.driven

    def joint_index(self, pattern):
        return np.arange(12)


def by_hand(name, q=None, dq=None, tau=None, calls=1, **values):
    """Torque of the first joint after some calls with the same arguments."""
    effect = effects.make(name, **values)
    effect.configure(Bare())
    effect.reset(np.random.default_rng(0))
    q, dq, tau = (np.full(12, 0.0 if v is None else v) for v in (q, dq, tau))
    hook = effect.on_drive if isinstance(effect, DriveEffect) else effect.on_torque
    for _ in range(calls):
        out = hook(tau, q, dq, 0.001, 0.0)
    return out[0]


def test_limits_and_errors_of_the_drive():
    effort = robot.load("hyq").effort[0]
    assert by_hand("torque_limit", tau=1e4, reduction=0.75) == pytest.approx(0.25 * effort)
    assert by_hand("torque_speed_line", tau=1e4, dq=2.0, slope=0.25) == pytest.approx(0.5 * effort)
    assert by_hand("torque_speed_line", tau=-1e2, dq=2.0, slope=0.5) == -1e2, "braking is free"
    assert by_hand("torque_constant_error", tau=10.0, error=-0.2) == pytest.approx(8.0)
    assert by_hand("torque_limit", tau=1e4, rated=8.0, reduction=0.75) == pytest.approx(2.0)
    assert by_hand("torque_speed_line", tau=1e4, dq=2.0, rated=8.0, slope=0.25) == 4.0
    half = 0.5 * robot.load("hyq").effort
    assert by_hand("supply_sag", tau=half.min(), sag=0.0) == pytest.approx(half.min())


@pytest.mark.parametrize("time", [0.01, 0.0007])
def test_a_lag_is_exact_in_the_mean_of_each_step(time):
    """Also where it is shorter than a step: it delays the impulse of a torque by its time."""
    effect = effects.make("actuator_lag", time=time)
    effect.configure(Bare())
    effect.reset(np.random.default_rng(0))
    zero, dt = np.zeros(12), 0.001
    effect.on_drive(zero, zero, zero, dt, 0.0)
    out = [effect.on_drive(zero + 1.0, zero, zero, dt, 0.0)[0] for _ in range(200)]
    late = time * np.exp(-np.arange(201) * dt / time)  # of the impulse, at the ends of steps
    np.testing.assert_allclose(out, 1.0 + np.diff(late) / dt, rtol=1e-9)
    assert np.sum(1.0 - np.array(out)) * dt == pytest.approx(time, rel=1e-6)


def test_play_gives_no_torque_until_the_motor_is_across():
    effect = effects.make("backlash", width=0.02, inertia=0.01)
    effect.configure(Bare())
    effect.reset(np.random.default_rng(0))
    zero = np.zeros(12)
    assert effect.on_drive(zero + 1.0, zero, zero, 0.001, 0.0)[0] == 1.0
    out = [effect.on_drive(zero - 1.0, zero, zero, 0.001, 0.0)[0] for _ in range(60)]
    free = out.index(-1.0)
    assert free * 0.001 == pytest.approx(math.sqrt(2.0 * 0.02 * 0.01 / 1.0), abs=0.002)
    assert set(out[:free]) == {0.0}
    assert set(out[free:]) == {-1.0}


def test_hysteresis_forgets_and_a_maxwell_spring_relaxes():
    far = by_hand("hysteresis", dq=1.0, calls=500, torque=2.0, stroke=0.02)
    assert far == pytest.approx(-2.0, rel=1e-6)
    steady = by_hand("viscoelasticity", dq=1.0, calls=2000, stiffness=3.0, time=0.1)
    assert steady == pytest.approx(-3.0 * 0.1, rel=1e-6), "a damper of stiffness times time"


def test_a_saturated_spring_gives_no_more_and_the_others_what_they_should():
    bench = robot.load("spring_mass")
    rest = {"spring_saturation": -2.0, "stiffness_error": -7.5, "rest_angle_error": -4.0}
    values = {
        "spring_saturation": {"lost": 1.0, "torque": 2.0},
        "stiffness_error": {"error": 0.5},
        "rest_angle_error": {"offset": 0.02},
    }
    for name, wanted in rest.items():
        with Simulation(effects=[effects.make(name, **values[name])], robot=bench) as sim:
            hook = sim._effects[0].on_torque
            spring = np.array([-50.0 * 0.1])
            got = hook(spring, np.array([0.1]), np.zeros(1), sim.physics_dt, 0.0)
            assert got[0] == pytest.approx(wanted), name


def test_the_order_of_listing_is_the_order_of_the_laws():
    def last(*names):
        listed = {
            "torque_limit": {"name": "torque_limit", "reduction": 0.9},
            "torque_constant_error": {"name": "torque_constant_error", "error": 1.0},
        }
        return swing([listed[n] for n in names], tau=1.0, steps=2)[2][-1]

    assert last("torque_limit", "torque_constant_error") == pytest.approx(0.4)
    assert last("torque_constant_error", "torque_limit") == pytest.approx(0.2)


def test_one_call_for_many_effects_is_the_same_as_one_call_for_each():
    listed = [
        {"name": "actuator_lag", "time": 0.01},
        {"name": "added_stiffness", "stiffness": 0.5},
        {"name": "hysteresis", "torque": 0.05},
        {"name": "end_stop", "angle": 0.2, "start": 0.1},
        {"name": "torque_limit", "reduction": 0.5, "stop": 0.3},
    ]
    together = swing(listed, tau=lambda t: math.sin(20.0 * t))
    apart = [{"name": "push"}] * 0
    for spec in listed:  # something else between them keeps them apart
        apart += [spec, {"name": "test_apart"}]
    try:

        class Apart(effects.Effect, name="test_apart"):
            """Does nothing, in the way."""

            def on_torque(self, tau, q, dq, dt, t):
                return tau

        np.testing.assert_array_equal(swing(apart, tau=lambda t: math.sin(20.0 * t)), together)
    finally:
        effects.EFFECTS.pop("test_apart")


SERVO = robot.load("servo_pendulum")
SERVO = replace(SERVO, sensors=SERVO.sensors.replace(exact=True))
EFFORT, STALL = SERVO.effort[0], SERVO.drives["pivot"].stall_torque


def swung(plant, *listed):
    """Positions of a servo that jumps to and fro, (T, 1)."""
    t = np.arange(150) / plant.control_rate
    wanted = np.where(np.sin(2.0 * np.pi * 1.3 * t) > 0.0, 1.2, -0.8)[:, None]
    return Bolted(plant, effects.from_list(listed)).run(wanted).q


def test_a_weak_servo_has_a_weak_motor_and_no_clutch():
    """Behind rotor and gear a limit would let the rotor run away, which nothing does."""
    effect = {"name": "torque_limit", "reduction": 0.4}
    weak = replace(SERVO, effort=0.6 * SERVO.effort)
    np.testing.assert_allclose(swung(SERVO, effect), swung(weak), atol=1e-12)
    assert np.abs(swung(SERVO, effect) - swung(SERVO)).max() > 0.01


def test_a_torque_constant_scales_all_that_the_motor_does():
    effect = {"name": "torque_constant_error", "error": -0.3}
    drive = SERVO.drives["pivot"].replace(stall_torque=0.7 * STALL)
    other = replace(SERVO, drives={"pivot": drive}, effort=0.7 * SERVO.effort)
    np.testing.assert_allclose(swung(SERVO, effect), swung(other), atol=1e-12)
    assert np.abs(swung(SERVO, effect) - swung(SERVO)).max() > 0.01


@pytest.mark.parametrize(
    ("effect", "speed", "left"),
    [
        ({"name": "supply_sag", "sag": 0.2}, 0.0, 0.8 * EFFORT),
        ({"name": "supply_sag", "sag": 0.2}, 6.6, 0.45 * EFFORT),  # at half the load
        ({"name": "torque_speed_line", "slope": 0.1}, 5.0, 0.5 * EFFORT),
        ({"name": "torque_speed_line", "slope": 0.1}, -5.0, EFFORT),  # it brakes
    ],
)
def test_what_a_motor_gives_at_a_speed(effect, speed, left):
    made = effects.from_list([effect])[0]
    made.configure(Setting(SERVO, SERVO.sim, 1e-3))
    made.reset(np.random.default_rng(0))
    rows = np.array([SERVO.drives["pivot"].row(EFFORT)])
    changed = made.on_motor(rows, np.ones(1), np.array([speed]), 1e-3, 0.0)
    assert motor_torque(changed[0], 1.0, speed) == pytest.approx(left, rel=1e-3)
    tau = np.array([9.0])
    np.testing.assert_array_equal(made.on_drive(tau, *np.zeros((2, 1)), 1e-3, 0.0), tau)


@pytest.mark.parametrize(
    ("name", "values"),
    [("sensor_bias", {"q": 0.01}), ("sensor_gain", {"q": -0.2}), ("joint_offset", {"offset": 0.02}),
     ("sensor_nonlinearity", {"quadratic": 0.3, "cubic": -0.2})],
)  # fmt: skip
def test_what_sensors_that_are_off_say_leads_back_to_what_is(name, values):
    """Of one time and of many, by one effect and by another after it."""
    rng, world = np.random.default_rng(3), Bare()
    wrong = [effects.make(name, **values), effects.make("sensor_gain", q=0.05)]
    for effect in wrong:
        effect.configure(world)
        effect.reset(rng)
    at, rest = Layout(12, 4), world.robot.standing
    true = rng.uniform(-0.3, 0.3, (5, at.size))
    true[:, at["q"]] += rest
    said = true.copy()
    for effect in wrong:
        effect.measure(said, at, 0.0)
    for row, read in zip(true, said, strict=True):
        one = row.copy()
        for effect in wrong:
            effect.measure(one, at, 0.0)
        np.testing.assert_array_equal(one, read)
        q, dq = behind(wrong, read[at["q"]], read[at["dq"]], feet=4)
        np.testing.assert_allclose(q, row[at["q"]], atol=1e-4)
        np.testing.assert_allclose(dq, row[at["dq"]], atol=1e-3)


@pytest.mark.parametrize("cubic", [0.4, -0.4, 10.0])
def test_where_a_bent_curve_leads_nowhere_a_robot_is_where_it_was_read(cubic):
    wrong = effects.make("sensor_nonlinearity", cubic=cubic)
    wrong.configure(Bare())
    wrong.reset(np.random.default_rng(0))
    at, far, rest = Layout(12, 4), np.linspace(-3.0, 3.0, 12), Bare().robot.standing
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        q, dq = behind([wrong], rest + far, far, feet=4)
    assert np.isfinite([q, dq]).all()
    outer = np.abs(far) > 2.0
    np.testing.assert_array_equal(q[outer], (rest + far)[outer])
    said = np.zeros(at.size)
    said[at["q"]] = q
    wrong.measure(said, at, 0.0)
    off, was = np.abs(said[at["q"]] - rest - far), np.abs(cubic * far**3)
    assert (off <= was + 1e-9).all()


@pytest.mark.parametrize("name", ["hyq_leg", "linear_axis", "servo_pendulum"])
def test_the_gain_of_a_sensor_turns_about_the_zero_of_that_sensor(name):
    """Not about the standing pose: at 0 it is right, elsewhere off by its share; so is the speed."""
    plant = robot.load(name)
    made = effects.make("sensor_gain", q=0.1)
    made.configure(Setting(plant, plant.sim, 1e-3))
    made.reset(np.random.default_rng(0))
    at = Layout(len(plant.joints), len(plant.feet))
    values = np.zeros((3, at.size))
    values[1, at["q"]], values[2, at["dq"]] = plant.standing + 0.5, 2.0
    made.measure(values, at, 0.0)
    np.testing.assert_array_equal(values[0], 0.0)
    np.testing.assert_allclose(values[1, at["q"]], 1.1 * (plant.standing + 0.5))
    np.testing.assert_allclose(values[2, at["dq"]], 2.2)
