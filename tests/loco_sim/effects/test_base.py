# SPDX-License-Identifier: Apache-2.0
"""Contracts that every registered effect keeps; a new effect is tested by registering it.

An effect needs one entry in `STRONG`: parameters with which it clearly shows.
"""

import json
from dataclasses import dataclass, fields

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import parameter
from loco_sim import effects
from loco_sim.effects.base import EFFECTS, Effect, overrides, streams, windows
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot

STRONG = {
    "actuation_delay": {"delay": 0.01},
    "actuator_lag": {"time": 0.02},
    "added_stiffness": {"stiffness": 100.0, "rest": 0.1},
    "armature": {"inertia": 0.5},
    "asymmetric_friction": {"forward": 5.0, "backward": 8.0},
    "backlash": {"width": 0.05, "inertia": 0.1},
    "cable_force": {"stiffness": 500.0, "length": 0.5},
    "com_offset": {"offset": (0.1, 0.05, 0.0)},
    "command_delay": {"delay": 0.012},
    "command_rate_limit": {"slowness": 20.0},
    "command_dropout": {"probability": 0.5},
    "constant_force": {"force": (0.0, 100.0, 0.0)},
    "coulomb_friction": {"torque": 5.0},
    "coupled_friction": {"torque": 5.0, "damping": 0.5, "stroke": 0.05},
    "cubic_stiffness": {"cubic": 1000.0},
    "end_stop": {"angle": 0.02, "stiffness": 100.0, "damping": 1.0},
    "foot_friction": {"error": -0.9},
    "friction_compensation": {"torque": 5.0, "damping": 0.5},
    "gravity_compensation": {"share": 0.5},
    "ground_compliance": {"compliance": 1e-4},
    "ground_height": {"height": 0.02, "foot": "lf_foot"},
    "hysteresis": {"torque": 5.0},
    "imu_tilt": {"roll": 0.1, "pitch": -0.2, "yaw": 0.3},
    "joint_offset": {"offset": 0.1},
    "learned_residual": {"weights": (5.0,) * 18, "travel": 9.0, "speed": 99.0, "load_range": 99.0},
    "load_friction": {"share": 0.3},
    "payload": {"mass": 10.0, "position": (0.3, 0.0, 0.0)},
    "push": {"force": (0.0, 100.0, 0.0), "random": 50.0},
    "quantisation": {"step": 0.01},
    "rest_angle_error": {"offset": 0.2},
    "sensor_bias": {"q": 0.1, "tau": 1.0, "gyro": (0.1, 0, 0), "accelerometer": (0, 0, 1.0)},
    "sensor_gain": dict.fromkeys(("q", "tau", "grf", "gyro", "accelerometer"), 0.1),
    "sensor_latency": {"delay": 0.01},
    "sensor_noise": dict.fromkeys(("q", "dq", "tau", "grf", "orientation", "gyro"), 0.01)
    | {"accelerometer": 0.1},
    "sensor_nonlinearity": {"quadratic": 1.0, "cubic": 1.0},
    "sensor_stuck": {"channel": "q", "index": 0},
    "series_elasticity": {"compliance": 0.002, "inertia": 0.1},
    "slip": {"loss": 1.0, "duration": 0.05},
    "slope": {"pitch": 0.2, "roll": 0.1},
    "soft_patches": {"compliance": 1e-3, "share": 0.9, "flat": 0.0},
    "spring_saturation": {"lost": 1.0, "torque": 0.01},
    "stiffness_error": {"error": 0.5},
    "stribeck_friction": {"torque": 5.0, "velocity": 1.0},
    "supply_sag": {"sag": 0.5},
    "torque_bias": {"torque": 5.0},
    "torque_ripple": {"sine": 5.0, "cosine": 2.0},
    "terrain": {"roughness": 0.03, "flat": 0.0},
    "torque_constant_error": {"error": 0.3},
    "torque_hold": {"period": 0.01},
    "torque_limit": {"reduction": 0.9},
    "torque_speed_line": {"slope": 10.0},
    "trunk_flex": {"compliance": 0.01, "damping": 1.0},
    "viscoelasticity": {"stiffness": 200.0},
    "viscous_friction": {"damping": 5.0},
}
NAMES = effects.names()
ON_HYQ = effects.applicable(robot.load("hyq"))
WINDOWED = [name for name in ON_HYQ if not EFFECTS[name].lasting]


def strong(name, **more):
    return effects.make(name, **STRONG[name], **more)


def test_every_effect_has_strong_parameters_here():
    assert set(STRONG) == set(EFFECTS)


def test_default_parameters_switch_effects_off(plant, run, as_bytes):
    listed = plant([effects.make(name) for name in ON_HYQ])
    assert as_bytes(run(listed)) == as_bytes(run(plant()))


@pytest.fixture(scope="module")
def untouched(hyq, run, as_bytes):
    """Bytes of a run without effects."""
    with Simulation() as sim:
        return as_bytes(run(sim))


@pytest.mark.parametrize("name", ON_HYQ)
def test_strong_parameters_show_and_reset_starts_over(name, plant, run, as_bytes, untouched):
    sim = plant([strong(name)], seed=4)
    first = as_bytes(run(sim))
    assert first != untouched
    assert as_bytes(run(sim)) == first


@pytest.mark.parametrize("name", ["command_dropout", "push", "sensor_noise"])
def test_another_seed_gives_another_run(name, plant, run, as_bytes):
    sim = plant([strong(name)], seed=4)
    first = as_bytes(run(sim))
    sim.reset(seed=5)
    assert as_bytes(run(sim)) != first


@pytest.mark.parametrize("name", WINDOWED[::3])  # the window is minded in one place
def test_outside_its_window_the_effect_does_nothing(name, plant, run, as_bytes):
    states, bare = run(plant([strong(name, start=0.08)])), run(plant())
    assert as_bytes(states[:20]) == as_bytes(bare[:20])
    assert as_bytes(states[21:]) != as_bytes(bare[21:])
    never = strong(name, start=0.04, stop=0.04)
    assert as_bytes(run(plant([never]))) == as_bytes(bare)


@pytest.mark.parametrize("name", ON_HYQ)
def test_hooks_do_not_change_the_arrays_they_are_given(name, plant, run):
    effect, sim = strong(name), plant()
    effect.configure(sim._world)
    effect.reset(np.random.default_rng(0))
    state = run(sim, 5)[-1]
    q, dq, tau = state.q.copy(), state.dq.copy(), state.tau.copy()
    for _ in range(3):
        effect.on_command(state.q, state.dq, 0.0)
        effect.on_torque(state.tau, state.q, state.dq, 0.001, 0.0)
        effect.on_measurement(state)
    for mine, kept in ((state.q, q), (state.dq, dq), (state.tau, tau)):
        np.testing.assert_array_equal(mine, kept)


@pytest.mark.parametrize("name", NAMES)
def test_it_survives_the_way_through_an_experiment_file(name):
    effect = strong(name)
    (again,) = effects.from_list(json.loads(json.dumps(effects.to_list([effect]))))
    assert again == effect
    assert type(again) is type(effect)


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_has_a_meaning_and_a_unit(name):
    for f in fields(EFFECTS[name]):
        assert f.metadata["doc"]
        assert f.metadata["unit"]
    assert EFFECTS[name].__doc__.strip()


def test_adding_an_effect_leaves_the_noise_of_another_alone(plant, run):
    alone = run(plant([strong("sensor_noise")], seed=1))
    beside = [effects.make("command_dropout"), strong("sensor_noise"), effects.make("push")]
    assert run(plant(beside, seed=1))[-1].q.tobytes() == alone[-1].q.tobytes()


def test_an_effect_listed_twice_has_two_streams():
    first, second = streams([effects.make("push"), effects.make("push")], 0)
    assert first.random() != second.random()


def test_two_effects_have_two_streams():
    push, noise = streams([effects.make("push"), effects.make("sensor_noise")], 0)
    assert push.random() != noise.random()


def test_effects_act_in_the_order_in_which_they_are_listed(plant, run):
    noise, stuck = strong("sensor_noise"), {"channel": "q"}
    frozen_last = run(plant([noise, effects.make("sensor_stuck", **stuck)]), 10)
    assert frozen_last[4].q.tobytes() == frozen_last[9].q.tobytes()
    noisy_last = run(plant([effects.make("sensor_stuck", **stuck), strong("sensor_noise")]), 10)
    assert noisy_last[4].q.tobytes() != noisy_last[9].q.tobytes()


def test_only_overridden_hooks_are_called():
    noise = strong("sensor_noise")
    assert overrides(noise, "on_measurement")
    assert not overrides(noise, "on_torque")
    assert windows([noise], "on_torque", 0.001) == []
    ((start, stop, hook),) = windows([strong("sensor_noise", stop=2.0)], "on_measurement", 0.001)
    assert (start, stop) == (0, 2000)
    assert hook.__name__ == "on_measurement"


def test_an_unknown_effect_lists_those_that_exist():
    with pytest.raises(NameUnknownError, match=r"mean 'push'\?.*available: actuation_delay"):
        effects.make("pusch")


def test_an_unknown_parameter_lists_those_that_exist():
    with pytest.raises(NameUnknownError, match="available: delay, start, stop"):
        effects.make("command_delay", latency=0.1)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("command_delay", {"delay": -0.1}),
        ("command_delay", {"delay": "long"}),
        ("push", {"force": [1.0, 2.0]}),
        ("push", {"start": 2.0, "stop": 1.0}),
        ("payload", {"mass": 1.0, "start": 1.0}),
        ("payload", {"mass": 1.0, "stop": 1.0}),
    ],
)
def test_values_out_of_range_are_refused(name, values):
    with pytest.raises(ParameterError):
        effects.make(name, **values)


@pytest.mark.parametrize("specs", [["push"], [{"force": [1, 2, 3]}], [3]])
def test_a_list_entry_without_a_name_is_refused(specs):
    with pytest.raises(ParameterError, match=r"effects\[0\]"):
        effects.from_list(specs)


def test_no_list_is_no_effects():
    assert effects.from_list(None) == []
    assert effects.from_list([]) == []


def test_a_name_can_be_taken_only_once():
    with pytest.raises(ParameterError, match="push"):

        class Again(Effect, name="push"):
            """Takes a name that is taken."""


def test_a_new_effect_is_a_class_and_nothing_else(plant, run, as_bytes):
    try:

        @dataclass
        class Weak(Effect, name="test_weak"):
            """Takes a share of the torque away."""

            share: float = parameter(0.0, "share that is lost", low=0.0, high=1.0)

            def on_torque(self, tau, q, dq, dt, t):
                return (1.0 - self.share) * tau

        assert as_bytes(run(plant([Weak()]))) == as_bytes(run(plant()))
        limp = run(plant(effects.from_list([{"name": "test_weak", "share": 1.0}])))
        assert np.abs(limp[-1].tau).max() == 0.0
    finally:
        EFFECTS.pop("test_weak")
