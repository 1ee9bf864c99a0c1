# SPDX-License-Identifier: Apache-2.0
"""Control periods in the compiled loop are those of the ordinary one, bit by bit."""

from __future__ import annotations

import dataclasses
import importlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from loco_control.exceptions import DivergedError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.effects.base import Effect
from loco_sim.plant.compiled import Compiled, ordinary
from loco_sim.plant.orders import CommandSequence
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.world.world import Base

MUJOCO = {"sim.engine": "mujoco"}
ROBOTS = {"tigrillo": {}, "hyq_leg": {}, "servo_pendulum": {}}
STRONG = {  # where the prior has no typical size, or one that throws a small robot
    "cable_force": {"stiffness": 20.0, "anchor": [0.3, 0.2, 0.5], "length": 0.1},
    "torque_bias": {"torque": 0.05},
    "torque_ripple": {"sine": 0.03, "cosine": -0.02},
    "coupled_friction": {"torque": 0.02, "damping": 0.001, "stroke": 0.1},
    "friction_compensation": {"torque": 0.01, "damping": 0.001},
    "command_dropout": {"probability": 0.4},
    "constant_force": {"force": [0.5, 0.3, -0.2]},
    "push": {"force": [0.5, 0.3, -0.2], "random": 0.4, "shortest": 0.003, "longest": 0.02},
    "sensor_stuck": {"channel": "q"},
    "added_stiffness": {"stiffness": 0.5},
    "series_elasticity": {"compliance": 0.5},
    "slip": {"loss": 0.9, "duration": 0.01},
    "trunk_flex": {"compliance": 0.01},
}
ORDINARY = {"soft_patches"}  # looks where feet are in each step, which only Python does


def load(name: str, more: dict | None = None) -> robot.Robot:
    return robot.load(name, {**MUJOCO, **ROBOTS.get(name, {}), **(more or {})})


def typical(name: str) -> dict:
    priors = effects.EFFECTS[name].identity.priors
    values = {key: prior.typical or prior.high for key, prior in priors.items()}
    for key, value in values.items():
        default = getattr(effects.EFFECTS[name], key)
        if isinstance(default, tuple):
            values[key] = [value] * len(default)
    return {"name": name, **values, **STRONG.get(name, {})}


def run(plant, listed, compiled: bool, ticks=20, amplitude=0.2):
    """Every number that the plant says in a run, a row per tick, and why it fell."""
    n, feet = len(plant.joints), len(plant.feet)
    stance = np.random.default_rng(1).uniform(size=(ticks, feet)) < 0.7
    with Simulation(effects=effects.from_list(listed), seed=3, robot=plant) as sim:
        if not compiled:
            sim._slow_reason = "a test"
        sim.reset()
        assert isinstance(sim.loop, Compiled) == compiled
        rows = []
        for k in range(ticks):
            q = plant.standing + amplitude * np.sin(0.4 * k + np.arange(n))
            torque = TrunkTorque(k, k * sim.dt, np.full(n, 0.1), np.zeros(6), stance[k])
            state = sim.step(MotionCommand(k, k * sim.dt, q, 0.1 * q), torque)
            truth = sim.ground_truth()
            said = [*dataclasses.astuple(state), *dataclasses.astuple(truth), sim.true_dq]
            rows.append(np.concatenate([np.ravel(np.asarray(x, dtype=float)) for x in said]))
        return np.array(rows), sim.fallen


@pytest.mark.parametrize("name", ROBOTS)
def test_every_effect_does_the_same_in_both_loops(name):
    plant, claimed = load(name), 0
    bare, _ = run(plant, [], True)
    for effect in effects.applicable(plant):
        listed = [typical(effect)]
        assert bool(ordinary(effects.from_list(listed))) == (effect in ORDINARY), effect
        if effect in ORDINARY:
            continue
        fast, why = run(plant, listed, True)
        slow, reason = run(plant, listed, False)
        assert fast.tobytes() == slow.tobytes(), effect
        assert why == reason
        claimed += fast.tobytes() != bare.tobytes()
    assert claimed >= 0.8 * len(effects.applicable(plant))  # most do something that soon


def test_effects_that_come_and_go_and_mix():
    listed = [
        {"name": "command_delay", "delay": 0.01, "start": 0.02},
        {"name": "series_elasticity", "compliance": 0.5},
        {"name": "joint_offset", "offset": 0.05, "start": 0.03},
        {"name": "coulomb_friction", "torque": 0.01, "stop": 0.1},
        {"name": "push", "force": [0.3, 0.1, 0.0], "start": 0.02, "stop": 0.05},
        {"name": "slip", "loss": 1.0, "duration": 0.02, "stop": 0.07},
        {"name": "sensor_latency", "delay": 0.013},
        {"name": "payload", "mass": 0.1},
    ]
    plant = load("tigrillo")
    fast, slow = (run(plant, listed, compiled) for compiled in (True, False))
    assert fast[0].tobytes() == slow[0].tobytes()
    assert fast[0].tobytes() != run(plant, listed[:-1], True)[0].tobytes()


def test_a_robot_falls_at_the_same_tick_in_both_loops():
    plant = load("tigrillo")
    listed = [{"name": "push", "force": [0.0, 40.0, 0.0]}]
    (fast, why), (slow, reason) = (run(plant, listed, c, ticks=60) for c in (True, False))
    assert why
    assert why == reason
    assert fast.tobytes() == slow.tobytes()


@pytest.mark.parametrize("compiled", [True, False])
def test_what_explodes_is_told_in_both_loops_and_nothing_is_printed(compiled, capfd, tmp_path,
                                                                   monkeypatch):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    plant = load("tigrillo")
    with Simulation(robot=plant) as sim:
        sim._slow_reason = "" if compiled else "a test"
        sim.reset()
        sim._world.put(plant.standing, np.full(len(plant.joints), 1e300))
        with pytest.raises(DivergedError):
            for k in range(5):
                still = np.zeros(len(plant.joints))
                sim.step(MotionCommand(k, k * sim.dt, plant.standing, still))
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_effects_without_a_compiled_law_take_the_ordinary_loop(caplog):
    class Wild(Effect):
        """An effect of somebody else."""

        def on_torque(self, tau, q, dq, dt, t):
            return 1.1 * tau

    class Curious(Effect):
        """Another, which looks at the world."""

        def on_step(self, world, t):
            world.push((0.0, 0.0, 1.0 + world.base().position[2]))

    plant = load("tigrillo")
    for effect, why in ((Wild(), "no compiled law"), (Curious(), "looks at the world")):
        assert why in ordinary([effect])
        with caplog.at_level("INFO"), Simulation(effects=[effect], robot=plant) as sim:
            sim.reset()
            assert not isinstance(sim.loop, Compiled)
            sim.step(MotionCommand(0, 0.0, plant.standing, np.zeros(len(plant.joints))))
        assert why in caplog.text
    late = effects.from_list([typical("series_elasticity"), typical("command_delay")])
    assert "after series_elasticity" in ordinary(late)


# ---- whole runs ----------------------------------------------------------------------


def orders(plant, ticks=30, ramps=(False, False, False)) -> CommandSequence:
    n, rng = len(plant.joints), np.random.default_rng(5)
    phase = 0.4 * np.arange(ticks)[:, None] + np.arange(n)
    stance = rng.uniform(size=(ticks, len(plant.feet))) < 0.7
    power = np.where(rng.uniform(size=(ticks, 2)) < 0.1, 0.5, 1.0)
    q = plant.standing + 0.2 * np.sin(phase)
    return CommandSequence(q, 0.1 * np.cos(phase), np.full((ticks, n), 0.05), power, ramps, stance)


def followed(sim, told) -> np.ndarray:
    rows = []
    for state in sim.follow(told):
        said = [*dataclasses.astuple(state), *dataclasses.astuple(sim.ground_truth()), sim.true_q]
        rows.append(np.concatenate([np.ravel(np.asarray(x, dtype=float)) for x in said]))
    return np.array(rows)


@pytest.mark.parametrize("name", ["tigrillo", "hyq_leg", "servo_pendulum"])
def test_a_run_that_is_known_beforehand_is_the_same_as_step_by_step(name):
    plant = load(name)
    some = ["slip", "push", "command_dropout", "sensor_noise", "stribeck_friction",
            "series_elasticity"]  # fmt: skip
    told, listed = orders(plant), [typical(e) for e in some if e in effects.applicable(plant)]
    with Simulation(effects=effects.from_list(listed), robot=plant, seed=2) as sim:
        sim.reset()
        assert isinstance(sim.loop, Compiled)
        fast = followed(sim, told)
        later = followed(sim, told)
        sim._slow_reason = "a test"
        sim.reset()
        assert followed(sim, told).tobytes() == fast.tobytes()
        assert followed(sim, told).tobytes() == later.tobytes()
    assert len(fast) == len(told.q)


def test_a_run_begins_anew_in_any_state_and_effects_keep_to_the_clock():
    plant = load("tigrillo")
    told, joints = orders(plant), len(plant.joints)
    start = plant.standing + 0.02, np.full(joints, 0.1)
    push = {"name": "push", "force": [0.0, 3.0, 0.0], "start": 0.2, "stop": 0.3}
    slip = {"name": "slip", "loss": 0.9, "duration": 0.02}
    base = Base((0.1, 0.2, 0.25), (0.0, 0.0, 0.1, np.sqrt(0.99)), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0))
    with Simulation(effects=effects.from_list([push, slip]), robot=plant, seed=2) as sim:
        sim.place(*start, base)
        first = followed(sim, told)
        sim.place(*start, base)  # whatever happened before
        assert followed(sim, told).tobytes() == first.tobytes()
        sim.place(*start, base, tick=15)
        late = followed(sim, told)
    with Simulation(effects=effects.from_list([push, slip]), robot=plant, seed=2) as sim:
        sim.place(*start, base)
        assert followed(sim, told).tobytes() == first.tobytes()
    shift = {"start": 0.2 - 15 * sim.dt, "stop": 0.3 - 15 * sim.dt}
    with Simulation(effects=effects.from_list([{**push, **shift}]), robot=plant) as sim:
        sim.place(*start, base)
        alone = followed(sim, told)
    with Simulation(effects=effects.from_list([push]), robot=plant) as sim:
        sim.place(*start, base, tick=15)
        assert np.array_equal(followed(sim, told)[:, -joints:], alone[:, -joints:])
    assert not np.array_equal(late[:, -joints:], first[:, -joints:])


def test_ramps_are_what_finer_commands_say():
    plant = load("servo_pendulum")
    ramp = orders(plant, 30, (True, True, True))
    parts = 10
    fine_t, t = np.arange(30 * parts) / parts, np.arange(30)
    fine = [np.interp(fine_t, t, part[:, 0])[:, None] for part in ramp[:3]]
    flags = np.repeat(ramp.stance, parts, axis=0)
    with Simulation(robot=plant) as sim:
        steps = sim._steps
        assert steps == parts
        coarse = followed(sim, ramp._replace(power=None))
    held = CommandSequence(*fine, None, (False, False, False), flags)
    with Simulation(robot=plant, dt=plant.control_rate**-1 / parts) as sim:
        exact = followed(sim, held)[::parts]
    np.testing.assert_allclose(coarse[:, -1], exact[:, -1], atol=1e-12)


def test_threads_say_the_same_as_one_after_the_other():
    plants = [load("tigrillo", {"sim.friction": mu}) for mu in (0.3, 0.5, 0.7, 0.9)]

    def one(plant):
        with Simulation(robot=plant) as sim:
            return followed(sim, orders(plant)).tobytes()

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(one, plants)) == [one(plant) for plant in plants]


def test_a_run_that_explodes_ends_after_the_row_before():
    plant = load("tigrillo")
    with Simulation(robot=plant) as sim:
        for why in ("", "a test"):
            sim._slow_reason = why
            sim.reset()
            sim._world.put(plant.standing, np.full(len(plant.joints), 1e300))
            rows = 0
            with pytest.raises(DivergedError):
                for _ in sim.follow(orders(plant)):
                    rows += 1
            assert rows == 1


def test_without_the_engines_library_steps_go_through_python(monkeypatch):
    plant = load("servo_pendulum")
    with Simulation(robot=plant) as sim:
        assert isinstance(sim.loop, Compiled)
        fast = followed(sim, orders(plant))
        monkeypatch.setattr(importlib.import_module("loco_sim.world.mujoco"), "_library", str)
        sim.reset()
        assert not isinstance(sim.loop, Compiled)
        assert followed(sim, orders(plant)).tobytes() == fast.tobytes()


def test_drives_that_were_weakened_stay_so_where_orders_say_nothing_of_it():
    plant = load("servo_pendulum")
    told, runs = orders(plant)._replace(power=None), []
    for why in ("", "a test"):
        with Simulation(robot=plant) as sim:
            sim._slow_reason = why
            sim.reset()
            sim.power(0.6)
            runs.append(followed(sim, told).tobytes())
            sim.reset()
            assert followed(sim, told).tobytes() != runs[-1]
    assert runs[0] == runs[1]
