# SPDX-License-Identifier: Apache-2.0
"""What every effect promises, on every robot on which it makes sense.

One-joint benches and Tigrillo, whose worlds are built in a blink; HyQ is in `test_base`.
"""

import copy
import math
from dataclasses import fields, replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.effects.base import EFFECTS, ON_TORQUES, overrides
from loco_sim.effects.chain import JointEffect
from loco_sim.effects.identity import PLANT_SIGNALS, SENSOR_SIGNALS, SITES
from loco_sim.effects.places import outward
from loco_sim.effects.readings import Layout, Measuring
from loco_sim.effects.rows import MEMORY
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.servo import TorqueDrive

NAMES = effects.names()
BENCHES = ("linear_axis", "pendulum", "servo_pendulum", "spring_mass")
ROBOTS = {name: robot.load(name) for name in (*BENCHES, "tigrillo")}
IN_MUJOCO = {f"{name}, mujoco": robot.load(name, {"sim.engine": "mujoco"}) for name in ROBOTS}
ROBOTS |= IN_MUJOCO
PAIRS = [(r, e) for r in ROBOTS for e in effects.applicable(ROBOTS[r])]
PASSIVE = [(r, e) for r, e in PAIRS if ROBOTS[r].name in BENCHES and EFFECTS[e].identity.passive]

# Where the typical strength of the prior does not show on a small robot.
CLEAR = {
    "cable_force": {"stiffness": 50.0, "length": 0.1, "point": (0.0, 0.0, -0.1)},
    "added_stiffness": {"stiffness": 0.5},  # more needs finer steps on a shank of 20 g
    "end_stop": {"angle": 0.001},
    "learned_residual": {"weights": (0.05,) * 18, "travel": 9.0, "speed": 99.0, "load_range": 99.0},
    "ground_height": {"height": 0.003, "foot": "lf_foot"},
    "series_elasticity": {"compliance": 0.5},
    "push": {"force": (1.0, 0.5, 0.2), "random": 0.5, "point": (0.0, 0.0, -0.1)},
    "constant_force": {"force": (1.0, 0.5, 0.2), "point": (0.0, 0.0, -0.1)},
    "payload": {"mass": 0.2, "position": (0.02, 0.0, -0.01)},
    "sensor_bias": {"q": 0.1, "tau": 1.0, "gyro": (0.1, 0, 0), "accelerometer": (0, 0, 1.0)},
    "sensor_stuck": {"channel": "q"},
    "spring_saturation": {"lost": 1.0, "torque": 0.01},
    "slip": {"loss": 1.0, "duration": 0.02},
    "soft_patches": {"compliance": 2e-3, "damping": 5.0, "share": 0.9, "flat": 0.0},
    "torque_hold": {"period": 0.015},  # a torque that is commanded is held for 10 ms anyway
    "torque_limit": {"reduction": 0.95},
    "torque_speed_line": {"slope": 10.0},
    "trunk_flex": {"compliance": 0.01, "damping": 0.05},
    "torque_bias": {"torque": 0.1},
    "torque_ripple": {"sine": 0.05, "cosine": 0.05},
    "coupled_friction": {"torque": 0.02, "damping": 0.001, "stroke": 0.1},
    "friction_compensation": {"torque": 0.01, "damping": 0.001},
    "command_dropout": {"probability": 0.5},
    "quantisation": {"step": 0.02},
}


def clear(name, **more):
    """The effect with a strength that shows: of the prior, or in `CLEAR`."""
    values = {}
    for key in EFFECTS[name].identity.strengths:
        low, typical, high = EFFECTS[name].identity.priors[key]
        value = typical if low > 0.0 else high
        now = getattr(EFFECTS[name], key, 0.0)
        values[key] = tuple(value for _ in now) if isinstance(now, tuple) else value
    return effects.make(name, **(CLEAR.get(name) or values), **more)


def plant(name, listed=(), seed=0, **more):
    return Simulation(effects=listed, seed=seed, robot=ROBOTS[name], **more)


def run(sim, ticks=12, tau=0.5):
    """Measured states, true positions and velocities of a robot that is moved about."""
    measured, truth = [sim.reset()], [(sim.true_q, sim.true_dq)]
    n, rest = len(sim.robot.joints), sim.robot.standing
    for k in range(ticks):
        wave = math.sin(2.0 * math.pi * k / 10.0)
        command = MotionCommand(k, k * sim.dt, rest + 0.3 * wave, np.zeros(n))
        flags = np.ones(len(sim.robot.feet), dtype=bool)
        trunk = TrunkTorque(k, k * sim.dt, np.full(n, tau * wave), np.zeros(6), flags)
        measured.append(sim.step(command, trunk))
        truth.append((sim.true_q, sim.true_dq))
    return measured, np.array(truth)


def as_bytes(states):
    return b"".join(np.asarray(getattr(s, f.name)).tobytes() for s in states for f in fields(s))


@pytest.fixture(scope="module")
def bare():
    """Run of each robot without effects."""
    made = {}
    for name in ROBOTS:
        with plant(name) as sim:
            made[name] = run(sim)
    return made


@pytest.mark.parametrize("name", ROBOTS)
def test_effects_that_are_listed_but_off_change_no_byte(name, bare):
    listed = [effects.make(e) for e in effects.applicable(ROBOTS[name])]
    assert all(e.absent() for e in listed)
    with plant(name, listed) as sim:
        measured, truth = run(sim)
    assert as_bytes(measured) == as_bytes(bare[name][0])
    assert truth.tobytes() == bare[name][1].tobytes()


@pytest.mark.parametrize(("name", "effect"), PAIRS)
def test_an_effect_changes_what_it_says_and_nothing_else(name, effect, bare):
    below = (
        ROBOTS[name].name == "spring_mass" and effect == "end_stop"
    )  # where its weight takes the mass
    made = effects.make(effect, angle=-0.001) if below else clear(effect)
    with plant(name, [made]) as sim:
        measured, truth = run(sim)
        assert as_bytes(run(sim)[0]) == as_bytes(measured), "the same seed gives another run"
    before, still = bare[name]
    touches = set(EFFECTS[effect].identity.touches)
    if touches & set(PLANT_SIGNALS):
        assert as_bytes(measured) != as_bytes(before)
        return
    assert truth.tobytes() == still.tobytes(), "a sensor moved the robot"
    changed = {
        signal
        for signal in SENSOR_SIGNALS
        if any(
            getattr(a, signal).tobytes() != getattr(b, signal).tobytes()
            for a, b in zip(measured, before, strict=True)
        )
    }
    assert changed
    assert changed <= touches
    assert all(
        a.contact.tobytes() == b.contact.tobytes() for a, b in zip(measured, before, strict=True)
    )


MEASURING = [(r, e) for r, e in PAIRS if issubclass(EFFECTS[e], Measuring)]


@pytest.mark.parametrize(("name", "effect"), MEASURING)
def test_readings_of_a_run_change_as_those_of_its_samples_and_no_others(name, effect):
    made, rng, times = clear(effect), np.random.default_rng(0), 0.01 * np.arange(5)
    with plant(name, [made]) as sim:
        run(sim)
        at = Layout(len(sim.robot.joints), len(sim.robot.feet))
        values = rng.normal(size=(len(times), at.size))
        memory = rng.normal(size=(len(times), len(sim.robot.joints), MEMORY))
        twin = made if made.remembers else copy.deepcopy(made)
        each, whole = values.copy(), values.copy()
        for row, own, t in zip(each, memory, times, strict=True):
            if made.remembers:
                made.memory[:] = own[made.in_chain]
            made.measure(row, at, t)
        twin.measure_run(whole, at, times, memory)
    assert whole.tobytes() == each.tobytes()
    changed = {s for s in SENSOR_SIGNALS if np.any(each[:, at[s]] != values[:, at[s]])}
    assert changed <= set(EFFECTS[effect].identity.touches)


@pytest.mark.parametrize("effect", NAMES)
def test_the_hooks_are_those_of_the_signals_it_touches(effect):
    cls, touches = EFFECTS[effect], set(EFFECTS[effect].identity.touches)
    hooks = {signal: f"on_{signal}" for signal in ("command", "drive", "torque", "brake")}
    for signal, hook in hooks.items():
        assert overrides(effects.make(effect), hook) == (signal in touches)
    assert overrides(effects.make(effect), "on_measurement") == bool(touches & set(SENSOR_SIGNALS))
    assert overrides(effects.make(effect), "on_step") <= bool(touches & {"force", "model"})
    assert cls.lasting <= ("model" in touches)


IN_JOINTS = [e for e in NAMES if any(f.name == "joint" for f in fields(EFFECTS[e]))]


@pytest.fixture(scope="module")
def tigrillo():
    """A state of Tigrillo and its world, for hooks that are called by hand."""
    with plant("tigrillo") as sim:
        yield run(sim, 3)[0][-1], sim._world


@pytest.mark.parametrize("effect", IN_JOINTS)
def test_joints_that_are_not_named_are_left_alone(effect, tigrillo):
    sprung = getattr(EFFECTS[effect], "among", "") == "sprung"
    joint = "rf_kfe_joint" if sprung else "rf_hfe_joint"
    one, made = ROBOTS["tigrillo"].joints.index(joint), clear(effect, joint=joint)
    also = {outward(ROBOTS["tigrillo"])[one]} if effect == "coupled_friction" else set()
    state, world = tigrillo
    rng = np.random.default_rng(0)
    made.configure(world)
    made.reset(rng)
    tau, q, dq = rng.normal(size=8), state.q, rng.normal(size=8)
    for hook in (*ON_TORQUES, "on_brake"):
        if overrides(made, hook):
            given = (tau,) if hook in ON_TORQUES else (np.zeros(8), tau)
            difference = getattr(made, hook)(*given, q, dq, 0.001, 1.0) - given[0]
            assert set(np.flatnonzero(difference)) <= {one} | also
    assert set(np.flatnonzero(made.on_command(q, dq, 0.0)[0] - q)) <= {one}
    if set(EFFECTS[effect].identity.touches) <= set(SENSOR_SIGNALS):
        assert set(np.flatnonzero(made.on_measurement(state).q - state.q)) <= {one}


@pytest.mark.parametrize(("name", "effect"), PASSIVE)
def test_a_passive_effect_makes_no_energy(name, effect):
    """Let go of an undriven bench: the energy, that in the effect too, only falls.

    The integrator takes a step's work too early or too late, no more; so the energy may
    rise by what one step changes in the kinetic energy, at most.
    """
    made = clear(effect)
    dt = 1.0 / ROBOTS[name].sim.physics_rate
    away = ROBOTS[name].standing + (
        0.03 if ROBOTS[name].name in ("linear_axis", "spring_mass") else 0.8
    )
    limp = replace(ROBOTS[name], drives={j: TorqueDrive() for j in ROBOTS[name].drives})
    with Simulation(effects=[made], robot=limp, dt=dt, standing=away) as sim:
        n = len(limp.joints)
        nothing = MotionCommand(0, 0.0, np.zeros(n), np.zeros(n))
        total, kinetic = [], []
        for _ in range(600):
            sim.step(nothing)
            kinetic.append(sim.kinetic_energy())
            if len(kinetic) % 7 == 0:
                stored = sim.potential_energy() + made.energy(sim.true_q, sim.true_dq)
                total.append(kinetic[-1] + stored)
    rise = np.max(total - np.minimum.accumulate(total))
    assert rise <= 2.0 * np.max(np.abs(np.diff(kinetic))) + 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_an_effect_that_does_not_apply_says_why(name):
    for effect in set(NAMES) - set(effects.applicable(ROBOTS[name])):
        with pytest.raises(ParameterError, match=f"effect {effect} does not apply to robot"):
            plant(name, [effects.make(effect)])


def test_everything_applies_to_tigrillo_and_all_of_it_runs_at_once():
    fitting = effects.applicable(ROBOTS["tigrillo"])
    assert set(NAMES) - set(fitting) == {"gravity_compensation"}, "its base moves"
    with plant("tigrillo", [clear(name) for name in fitting]) as sim:
        measured, _ = run(sim, 10)
    assert np.isfinite(measured[-1].q).all()


# ---- what is known about an effect -------------------------------------------------


@pytest.mark.parametrize("effect", NAMES)
def test_what_is_known_is_complete(effect):
    known = EFFECTS[effect].identity
    assert known.site in SITES
    assert len(known.equation) > 5
    assert len(known.source) > 10
    assert known.touches
    assert set(known.touches) <= {*PLANT_SIGNALS, *SENSOR_SIGNALS}
    assert known.look_alikes
    for look_alike in known.look_alikes:
        assert look_alike.name in EFFECTS
        assert look_alike.name != effect
        assert len(look_alike.experiment) > 10


@pytest.mark.parametrize("effect", NAMES)
def test_priors_lie_within_bounds_and_zero_is_absent(effect):
    known = EFFECTS[effect].identity
    declared = {f.name: f for f in fields(EFFECTS[effect])}
    for name, prior in known.priors.items():
        meta = declared[name].metadata
        assert meta["unit"]
        assert math.isfinite(meta["low"])
        assert math.isfinite(meta["high"])
        assert meta["low"] <= prior.low < prior.typical < prior.high <= meta["high"]
        assert prior.low > 0.0 or prior.low < 0.0 < prior.high
    for name in known.strengths:
        assert not np.any(declared[name].default)
    assert effects.make(effect).absent()
    assert not clear(effect).absent()
    assert set(known.strengths) <= set(known.priors)


@pytest.mark.parametrize("effect", [e for e in NAMES if EFFECTS[e].identity.priors])
def test_values_beyond_the_bounds_are_refused_in_one_line(effect):
    for name in EFFECTS[effect].identity.priors:
        (f,) = (f for f in fields(EFFECTS[effect]) if f.name == name)
        for value in (f.metadata["low"] - 1.0, f.metadata["high"] + 1.0, math.nan, "much"):
            wrong = (value,) * len(f.default) if isinstance(f.default, tuple) else value
            with pytest.raises(ParameterError, match=name) as error:
                effects.make(effect, **{name: wrong})
            assert "\n" not in str(error.value)


def test_a_joint_that_does_not_exist_is_named():
    with pytest.raises(Exception, match="elbow"):
        plant("pendulum", [effects.make("coulomb_friction", torque=0.1, joint="elbow")])
    with pytest.raises(ParameterError, match=r"lf_kfe_joint: no joint with a drive"):
        plant("tigrillo", [effects.make("actuator_lag", time=0.1, joint="lf_*")])


class _Untouchable:
    """A random stream that nobody may ask."""

    def __getattr__(self, name):
        raise AssertionError(f"rng.{name} was asked for")


@pytest.mark.parametrize("effect", NAMES)
def test_only_effects_that_say_so_keep_or_ask_their_random_stream(effect):
    made, stream = clear(effect), _Untouchable()
    if EFFECTS[effect].draws or isinstance(made, JointEffect):
        return
    made.reset(stream)
    assert not any(value is stream for value in vars(made).values())
